"""Errors of a difference between the places at which they are known: exact at these, linear between, never wilder."""

import numpy as np
import pytest
from lib.simulated_changes import Errors, epoch, grid_at, uneven

from photogram.grid import MapGrid
from photogram.volumes.differences import UNCHANGED, difference_of
from photogram.volumes.joint_errors import JointErrors

GRID = MapGrid(1000.0, 2080.0, 0.5, 160, 160)
PLACES = np.array([[1000.0, 2000.0], [1080.0, 2000.0], [1000.0, 2080.0], [1080.0, 2080.0], [1040.0, 2040.0]])


def errors(up: np.ndarray, east: float = 0.0, north: float = 0.0) -> JointErrors:
    factor = np.zeros((len(PLACES), 3, 1))
    factor[:, 0], factor[:, 1], factor[:, 2, 0] = east, north, up
    return JointErrors(PLACES, factor)


def flat() -> np.ndarray:
    return np.zeros((GRID.rows, GRID.columns))


def test_a_plane_of_errors_is_a_plane_between_the_places() -> None:
    tilt = errors(0.01 * (PLACES[:, 0] - 1040.0))
    (pattern,) = tilt.patterns(GRID, GRID.whole, flat(), flat())
    easts, _ = GRID.centres_map_m(GRID.whole)
    # the last nodes lie beyond the places
    np.testing.assert_allclose(pattern, np.tile(0.01 * (easts - 1040.0), (GRID.rows, 1)), atol=3e-3)


def test_a_window_is_a_part_of_the_whole() -> None:
    bent = errors(np.array([0.0, 1.0, 2.0, 1.0, 3.0]))
    (whole,) = bent.patterns(GRID, GRID.whole, flat(), flat())
    window = next(iter(GRID.tiles(64)))
    (part,) = bent.patterns(GRID, window, flat()[: window.shape[0], : window.shape[1]], flat()[:64, :64])
    np.testing.assert_allclose(part, whole[window.row : window.row_end, window.column : window.column_end], atol=1e-9)
    assert whole.min() >= 0.0
    assert whole.max() <= 3.0


def test_beyond_the_places_errors_are_those_of_the_next() -> None:
    far = MapGrid(1200.0, 2080.0, 0.5, 16, 16)
    (pattern,) = errors(np.full(5, 0.2)).patterns(far, far.whole, np.zeros((16, 16)), np.zeros((16, 16)))
    np.testing.assert_allclose(pattern, 0.2)
    assert errors(np.full(5, 0.2)).causes == 1


def test_a_shift_in_plan_raises_what_rises() -> None:
    rising = np.full((GRID.rows, GRID.columns), 0.5)
    east, north = (errors(np.zeros(5), **{axis: 0.02}) for axis in ("east", "north"))
    np.testing.assert_allclose(east.patterns(GRID, GRID.whole, flat(), rising), -0.01, atol=1e-12)
    np.testing.assert_allclose(north.patterns(GRID, GRID.whole, rising, flat()), 0.01, atol=1e-12)


def test_the_difference_of_epochs_takes_them_for_what_both_state_by_themselves() -> None:
    rng, grid = np.random.default_rng(1), grid_at(0.0, 0.0, 12.0, 0.2)
    earlier, later = (epoch(uneven, grid, Errors(), rng) for _ in range(2))
    nothing = JointErrors(np.array([[grid.west_map_m, grid.north_map_m]]), np.zeros((1, 3, 2)))
    alone, together = difference_of(earlier, later), difference_of(earlier, later, nothing)
    assert together.patterns() == 2 != alone.patterns()
    a, b = (d.cells(d.grid.whole) for d in (alone, together))
    np.testing.assert_array_equal(a.difference_m, b.difference_m)
    np.testing.assert_allclose(b.sigma_m, b.own_m)
    assert np.nanmedian(a.sigma_m) > np.nanmedian(b.sigma_m)
    assert np.mean(b.codes == UNCHANGED) <= np.mean(a.codes == UNCHANGED)
    assert pytest.approx(0.0) == np.abs(b.pattern_m).max()
