"""What the photographs say of a height: correlations against numpy, costs on a known plane."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from photogram.surface.dense.correlation import (
    LEFT_OUT,
    NEUTRAL,
    Window,
    fill_agreement,
    fill_correlations,
    fill_costs,
    share_of,
    workroom,
)

STEP_M = 0.3
REACH = 6
PATCH = 8


def correlations(samples: NDArray[Any], window: Window, per_cell: int, rows: int, columns: int) -> NDArray[np.float32]:
    """Return the correlations (K, K, rows, columns) of samples (K, Y, X) of a lattice, and of nothing beyond it."""
    count, more = len(samples), 2 * window.half // per_cell
    width = columns + more
    phases = np.zeros((count, (rows + more) * per_cell, width * per_cell), np.float32)
    phases[:, : samples.shape[1], : samples.shape[2]] = samples
    phases = phases.reshape(count, rows + more, per_cell, width, per_cell).transpose(0, 2, 4, 1, 3)
    flat = np.zeros((count, per_cell**2, (rows + more) * width + more), np.float32)
    flat[..., : (rows + more) * width] = phases.reshape(count, per_cell**2, -1)
    room, _ = workroom(count, PATCH, per_cell, window.half)
    pairs = np.zeros((count, count, rows * width), np.float32)
    fill_correlations(flat, window, per_cell, width, room, pairs)
    return pairs.reshape(count, count, rows, width)[..., :columns]


def agreed(pairs: NDArray[Any], share: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the scores (n,) of the photographs that agree best, and which these are (K, n)."""
    count, _, n = pairs.shape
    room, _ = workroom(count, PATCH, 1, 1)
    fill_agreement(np.ascontiguousarray(pairs, np.float32), share, room)
    return room.score[:n].copy(), room.sums[:, :n] > LEFT_OUT


def photographs_alike(rng: np.random.Generator, count: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return samples (count, …) of one texture with unlike noise, gain and offset."""
    each = (count, *(1 for _ in shape))
    grey = rng.normal(size=shape) + rng.uniform(0.2, 3.0, each) * rng.normal(size=(count, *shape))
    return np.asarray(rng.uniform(5.0, 30.0, each) * grey + rng.uniform(-60.0, 60.0, each))


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.integers(1, 3), st.integers(1, 4), st.data())
def test_all_windows_at_once_are_each_by_itself(
    seed: int, count: int, per_cell: int, half: int, data: st.DataObject
) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = data.draw(st.integers(1, PATCH)), data.draw(st.integers(1, PATCH))
    shape = tuple((n - 1) * per_cell + 2 * half + 1 for n in (rows, columns))
    samples = photographs_alike(rng, count, shape)
    pairs = correlations(samples, Window(half, 1e-3, 0.5), per_cell, rows, columns)
    side = 2 * half + 1
    for row, column in ((0, 0), (rows - 1, columns - 1), (rows // 2, columns // 3)):
        r, c = row * per_cell, column * per_cell
        expected = np.corrcoef(samples[:, r : r + side, c : c + side].reshape(count, -1))
        assert np.abs(pairs[:, :, row, column] - expected).max() < 2e-4


def test_a_window_that_a_photograph_does_not_show_is_not_a_number() -> None:
    samples = photographs_alike(np.random.default_rng(4), 3, (9, 9))
    samples[1, 0, 8] = np.nan
    pairs = correlations(samples, Window(1, 1.0, 0.5), 2, 4, 4)
    assert np.isnan(pairs[1, 1, 0, 3])
    assert not np.isnan(pairs[1, 1]).ravel()[np.arange(16) != 3].any()
    assert pairs[0, 1, 0, 3] == pairs[2, 1, 0, 3] == 0.0
    assert np.isfinite(pairs[0]).all()


def test_where_there_is_little_but_noise_the_score_shrinks() -> None:
    """Samples of half the noise's variance correlate as if they had a third of their length."""
    texture = np.where(np.add.outer(np.arange(9), np.arange(9)) % 2, 1.0, -1.0)
    texture[4, 4] = 0.0
    whole, three = Window(4, 1e-4, 1.0), 2.0 * np.stack([texture, texture, texture])
    scale = np.sqrt(80 / 81)
    for noise, expected in ((1e-4, 1.0), (2.0 * np.sqrt(2.0) * scale, 1.0 / 3.0)):
        pairs = correlations(three, whole._replace(noise=noise), 1, 1, 1)
        assert agreed(pairs[..., 0], 1.0)[0][0] == pytest.approx(expected, abs=1e-4)
    assert agreed(correlations(0.0 * three, whole._replace(noise=1.0), 1, 1, 1)[..., 0], 1.0)[0][0] == 0.0


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.sampled_from([0.3, 0.5, 0.75, 1.0]))
def test_the_photograph_that_agrees_least_goes_first(seed: int, count: int, share: float) -> None:
    """And the score is the mean correlation of all pairs of the others."""
    rng = np.random.default_rng(seed)
    texture = [photographs_alike(rng, count, (25,)) for _ in range(7)]
    pairs = np.stack([np.atleast_2d(np.corrcoef(samples)) for samples in texture], axis=-1)
    hidden = rng.random((count, 7)) < 0.2
    for n in range(7):
        pairs[hidden[:, n], :, n] = pairs[:, hidden[:, n], n] = 0.0
        pairs[hidden[:, n], hidden[:, n], n] = np.nan
    score, used = agreed(pairs, share)
    for n in range(7):
        left = np.flatnonzero(~hidden[:, n]).tolist()
        least = share_of(len(left), share)
        if len(left) < 2:
            assert score[n] == -1.0
            continue
        while len(left) > least:
            left.remove(min(left, key=lambda i: sum(pairs[i, j, n] for j in left if j != i)))
        assert np.flatnonzero(used[:, n]).tolist() == left
        expected = np.mean([pairs[i, j, n] for i, j in combinations(left, 2)])
        assert score[n] == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(("count", "share", "least"), [(1, 0.5, 1), (2, 0.1, 2), (3, 0.5, 2), (5, 0.5, 3), (6, 1.0, 6)])
def test_two_photographs_at_least_must_agree(count: int, share: float, least: int) -> None:
    assert share_of(count, share) == least


def costs(plane: Any, pictures: Any = None, noise: float = 1.5) -> NDArray[np.uint8]:
    """Return the costs (rows, columns, hypotheses) from REACH steps below the true height to as many above it."""
    rows, columns = plane.grid.rows, plane.grid.columns
    count = 2 * REACH + 1
    start = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns) * count
    cost = np.empty(start.size * count, np.uint8)
    first, counts = np.full(start.shape, -REACH, np.int32), np.full(start.shape, count)
    fill_costs(
        plane.crops(pictures), plane.ground(), Window(2, noise, 0.5), STEP_M, start, first, counts,
        plane.height_m.astype(np.float32), cost,
    )  # fmt: skip
    return cost.reshape(rows, columns, count)


def test_the_true_height_costs_least(photographed_plane: Any) -> None:
    cost = costs(photographed_plane)
    best = cost.argmin(axis=2) - REACH
    assert np.mean(np.abs(best) <= 1) > 0.99
    assert np.mean(best == 0) > 0.9
    assert np.median(cost[..., REACH]) < 0.1 * NEUTRAL
    assert np.median(cost[..., 0]) > 0.5 * NEUTRAL


def test_costs_do_not_depend_on_what_else_is_asked_for(photographed_plane: Any) -> None:
    """Some hypotheses of some cells cost what they cost among all; rounding may move a cost by one."""
    plane, all_of_them = photographed_plane, costs(photographed_plane).astype(int)
    rng = np.random.default_rng(7)
    shape = plane.height_m.shape
    first = rng.integers(-REACH, 3, shape).astype(np.int32)
    count = np.where(rng.random(shape) < 0.3, rng.integers(0, 5, shape), 0)
    count[:20] = 0
    ends = np.cumsum(count.ravel())
    cost = np.full(ends[-1], 255, np.uint8)
    fill_costs(
        plane.crops(), plane.ground(), Window(2, 1.5, 0.5), STEP_M, (ends - count.ravel()).reshape(shape), first, count,
        plane.height_m.astype(np.float32), cost,
    )  # fmt: skip
    cell = np.repeat(np.arange(count.size), count.ravel())
    k = np.arange(len(cost)) - (ends - count.ravel())[cell] + first.ravel()[cell]
    expected = all_of_them.reshape(-1, 2 * REACH + 1)[cell, k + REACH]
    assert np.abs(cost.astype(int) - expected).max() <= 1


def test_gain_and_offset_of_a_photograph_change_nothing(photographed_plane: Any) -> None:
    pictures = list(photographed_plane.pictures)
    expected = costs(photographed_plane, noise=1e-3).astype(int)
    pictures[1] = 0.5 * pictures[1] + 60.0
    pictures[4] = 1.7 * pictures[4] - 30.0
    found = costs(photographed_plane, pictures, noise=1e-3).astype(int)
    assert np.abs(found - expected).max() <= 1  # a cost is a whole number


def test_a_photograph_of_something_else_is_left_out(photographed_plane: Any) -> None:
    pictures = list(photographed_plane.pictures)
    pictures[2] = np.ascontiguousarray(pictures[2][::-1, ::-1])
    cost = costs(photographed_plane, pictures)
    assert np.mean(np.abs(cost.argmin(axis=2) - REACH) <= 1) > 0.97
    assert np.median(cost[..., REACH]) < 0.1 * NEUTRAL


def test_what_fewer_than_two_photographs_show_is_neutral(photographed_plane: Any) -> None:
    plane = photographed_plane
    alone = np.full_like(plane.ground().views, -1)
    alone[..., 0] = 2
    start = np.arange(plane.height_m.size, dtype=np.int64).reshape(plane.height_m.shape)
    cost = np.zeros(start.size, np.uint8)
    fill_costs(
        plane.crops(), plane.ground()._replace(views=alone), Window(2, 1.5, 0.5), STEP_M, start,
        np.zeros(start.shape, np.int32), np.ones(start.shape, np.int64), plane.height_m.astype(np.float32), cost,
    )  # fmt: skip
    assert np.all(cost == NEUTRAL)
