"""Solutions in photogram's own file: what is written is read back to the bit, and damage is refused."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_same_cameras, small_solution

from photogram.errors import ExchangeError
from photogram.exchange.formats.recognition import read_solution
from photogram.files.npz_json import read_arrays, write_arrays
from photogram.files.solutions.solution import ForeignSolution, StatedAdjustment
from photogram.files.solutions.stored_solutions import read_stored, write_stored


def assert_same_arrays(found: object, expected: object) -> None:
    for each in fields(expected):  # type: ignore[arg-type]
        np.testing.assert_array_equal(getattr(found, each.name), getattr(expected, each.name), err_msg=each.name)


def without_ground_points(solution: ForeignSolution) -> ForeignSolution:
    return replace(solution, ground_points=None)


def measured(solution: ForeignSolution) -> ForeignSolution:
    """The solution in a frame of its own with a position of each photograph, one of them without sigmas."""
    photographs = tuple(
        replace(p, measured=np.array([7.1, 50.2 + i, 3.0]), measured_sigma_m=None if i == 1 else np.full(3, 0.1 * i))
        for i, p in enumerate(solution.photographs)
    )
    return replace(
        solution, photographs=photographs, frame="topocentric", origin_lla=(50.2, 7.1, 100.0), crs="EPSG:4326",
        stated_tie_sigma_px=0.3, reprojection_rms_px=0.41, left_out=("Nothing “of note”.",),
    )  # fmt: skip


def stating(solution: ForeignSolution) -> ForeignSolution:
    """The solution with what its program says of its own adjustment."""
    n = len(solution.photographs)
    stated = StatedAdjustment(
        np.arange(24).reshape(2, 12) % 3 == 0, True, True, np.array([True, False, False]), 1.25, 17, True,
        np.full((n, 3), 0.01), np.arange(3.0 * n).reshape(n, 3), np.full((3, 3), np.nan), None,
    )  # fmt: skip
    return replace(solution, frame="map", stated=stated)


@pytest.mark.parametrize("change", [lambda s: s, measured, without_ground_points, stating])
def test_everything_comes_back_to_the_bit(tmp_path: Path, change: Callable[[ForeignSolution], ForeignSolution]) -> None:
    given = change(small_solution())
    write_stored(tmp_path / "a.npz", given)
    write_stored(tmp_path / "b.npz", given)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    found = read_solution(tmp_path / "a.npz")
    assert_same_cameras(found, given, tolerance=0.0)
    assert_same_arrays(found.tie_points, given.tie_points)
    assert (found.ground_points is None) == (given.ground_points is None)
    if found.ground_points is not None and given.ground_points is not None:
        assert_same_arrays(found.ground_points, given.ground_points)
    for one, other in zip(found.photographs, given.photographs, strict=True):
        assert (one.name, one.file, one.camera) == (other.name, other.file, other.camera)
        for name in ("measured", "measured_sigma_m"):
            assert (getattr(one, name) is None) == (getattr(other, name) is None)
            if getattr(one, name) is not None:
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in ("program", "frame", "origin_lla", "crs", "stated_tie_sigma_px", "reprojection_rms_px", "left_out"):
        assert getattr(found, name) == getattr(given, name)
    for each in fields(given.stated):
        one, other = (getattr(solution.stated, each.name) for solution in (found, given))
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other, err_msg=each.name)


def test_damage_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    write_stored(path, small_solution())
    assert_refused_or_read(path, lambda: read_stored(path))


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("words", np.frombuffer(b"{}", dtype=np.uint8), "no solution that photogram has stored"),
        ("tie_photograph", np.zeros(3, dtype=np.int64), "shape"),
        ("tie_colour", np.zeros((1, 3), dtype=np.uint8), "shape"),
        ("camera_parameters", np.zeros((2, 10)), "parameters of shape"),
        ("pose_rotation", np.zeros((2, 3, 3)), "no solution"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, name: str, value: np.ndarray, says: str) -> None:
    write_stored(tmp_path / "a.npz", small_solution())
    write_arrays(tmp_path / "b.npz", {**read_arrays(tmp_path / "a.npz"), name: value})
    with pytest.raises(ExchangeError, match=says):
        read_stored(tmp_path / "b.npz")


def test_observations_of_what_is_not_there_are_refused(tmp_path: Path) -> None:
    write_stored(tmp_path / "a.npz", small_solution())
    arrays = read_arrays(tmp_path / "a.npz")
    for name in ("tie_photograph", "ground_mark_photograph", "ground_mark_point"):
        far = arrays[name].copy()
        far[-1] = 99
        write_arrays(tmp_path / "b.npz", {**arrays, name: far})
        with pytest.raises(ExchangeError, match="names what is not there"):
            read_stored(tmp_path / "b.npz")


def test_another_archive_is_none(tmp_path: Path) -> None:
    write_arrays(tmp_path / "a.npz", {"x": np.zeros(3)})
    with pytest.raises(ExchangeError, match=r"a\.npz: is no solution that photogram has stored"):
        read_stored(tmp_path / "a.npz")
    with pytest.raises(ExchangeError, match="cannot be read"):
        read_stored(tmp_path / "absent.npz")
