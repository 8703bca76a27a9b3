"""The test of the machine: that it does the work it times, and that what is slower comes out slower."""

import threading
from dataclasses import asdict

import numpy as np
import pytest

from photogram.pipeline.costs import self_test
from photogram.pipeline.costs.self_test import REFERENCE_S, flat_ground, measured_speed, seconds_at_once, texture
from photogram.surface.dense.tile_matching import DenseSettings, match_block


def test_the_piece_of_ground_is_matched_where_it_lies() -> None:
    scene, level, window, prior = flat_ground()
    found = match_block(scene, level, window, prior, DenseSettings()).heights
    assert found is not None
    assert found.height_m.shape == window.shape
    assert np.isfinite(found.height_m).mean() > 0.99
    assert np.nanmedian(np.abs(found.height_m)) < 0.1 * level.step_m
    assert np.all(found.seen == 6)


def test_the_picture_has_key_points_and_is_the_same_every_time() -> None:
    assert np.array_equal(texture(128, 1), texture(128, 1))
    assert not np.array_equal(texture(128, 1), texture(128, 2))
    assert 15 < texture(512, 1).std() < 25
    assert len(self_test._features()()) > 1000  # type: ignore[arg-type]
    assert len(self_test._matches()()) == self_test.DESCRIPTORS // 4  # type: ignore[arg-type]


def test_the_first_round_does_not_count_and_all_workers_are_at_it() -> None:
    now, calls, lock = [0.0], [], threading.Lock()
    at_once = threading.Barrier(3, timeout=20)

    def work() -> None:
        at_once.wait()
        with lock:
            calls.append(now[0])
            now[0] += 5.0 if len(calls) <= 3 else 0.5 if len(calls) <= 6 else 0.25

    assert seconds_at_once(work, 3, lambda: now[0]) == pytest.approx(0.75)
    assert len(calls) == 3 * (1 + self_test.LEAST_ROUNDS)


def test_ratios_are_to_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    factor = {"_plain": 1.5, "_features": 2.0, "_matches": 3.0, "_dense": 4.0}
    for name in factor:
        monkeypatch.setattr(self_test, name, lambda name=name: name)
    monkeypatch.setattr(
        self_test, "seconds_at_once", lambda name, _workers: factor[name] * REFERENCE_S[name.removeprefix("_")]
    )
    monkeypatch.setattr(self_test, "kernels", lambda _rooms: (9, 9))
    assert asdict(measured_speed(2)) == pytest.approx({"features": 2.0, "matches": 3.0, "dense": 4.0, "plain": 1.5})
    monkeypatch.setattr(self_test, "kernels", lambda _rooms: (8, 9))  # not tested: compiling would take minutes
    assert asdict(measured_speed(2)) == pytest.approx({"features": 2.0, "matches": 3.0, "dense": 1.5, "plain": 1.5})
