"""Slopes without walls, and the gentle surface that has them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.surface.dense.slopes import slopes_without_walls, surface_along
from photogram.surface.planes import STEEPEST

CELL_M = 0.5


def gentle_surface(surface: np.ndarray) -> np.ndarray:
    return surface_along(surface, CELL_M, surface, np.zeros(surface.shape, np.float32))


def hillside(rows: int, columns: int, east: float, south: float) -> np.ndarray:
    row, column = np.mgrid[:rows, :columns]
    return np.asarray(CELL_M * (east * column + south * row), np.float32)


def test_a_wall_has_no_slope_and_its_two_sides_have_their_own() -> None:
    surface = hillside(30, 40, 0.2, -0.1)
    surface[:, 20:] += 6.0
    slope = slopes_without_walls(surface, CELL_M)
    east, south = slope[2:-2, 2:-2, 0], slope[2:-2, 2:-2, 1]
    beside = np.isclose(east, 0.2 * CELL_M, atol=1e-5)
    assert np.all(beside[:, :16])
    assert np.all(beside[:, 20:])
    assert np.abs(east).max() < 0.2 * CELL_M + 1e-5
    assert np.allclose(south[:, :16], -0.1 * CELL_M, atol=1e-5)
    assert slopes_without_walls(surface, CELL_M).dtype == np.float32


@settings(max_examples=30)
@given(st.integers(1, 40), st.integers(1, 40), st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
def test_a_hillside_is_its_own_gentle_surface(rows: int, columns: int, east: float, south: float) -> None:
    """But for the outermost cells, where the smoothing sees one side."""
    surface = hillside(rows, columns, east, south)
    gentle = gentle_surface(surface)
    assert gentle.shape == surface.shape
    assert abs(gentle.mean()) < 1e-4
    if min(rows, columns) > 30:
        inner = (slice(14, -14), slice(14, -14))
        rise = [np.diff(v[inner], axis=axis) for v in (gentle, surface) for axis in (0, 1)]
        assert np.abs(rise[0] - rise[2]).max() < 0.05 * CELL_M
        assert np.abs(rise[1] - rise[3]).max() < 0.05 * CELL_M


def test_a_house_leaves_the_ground_as_it_is() -> None:
    surface = hillside(90, 90, 0.3, 0.1)
    surface[30:60, 30:60] += 7.0
    gentle = gentle_surface(surface)
    away = gentle - hillside(90, 90, 0.3, 0.1)
    assert np.ptp(away[8:-8, 8:-8]) < 1.0


def test_a_gabled_roof_keeps_its_slopes() -> None:
    """45° to either side of its ridge, 40 cells wide, on walls of 5 m."""
    row, column = np.mgrid[:100, :100]
    on_roof = (np.abs(column - 49.5) < 20) & (np.abs(row - 49.5) < 30)
    rise = 0.9
    surface = np.where(on_roof, 5.0 + rise * CELL_M * (20 - np.abs(column - 49.5)), 0.0).astype(np.float32)
    gentle = gentle_surface(surface)
    west = np.diff(gentle[45:55, 36:44], axis=1) / CELL_M
    east = np.diff(gentle[45:55, 56:64], axis=1) / CELL_M
    assert np.median(west) == pytest.approx(rise, abs=0.2)
    assert np.median(east) == pytest.approx(-rise, abs=0.2)


def test_holes_are_level() -> None:
    surface = hillside(20, 20, 0.2, 0.0)
    surface[5:9, 5:9] = np.nan
    slope = slopes_without_walls(surface, CELL_M)
    assert np.all(slope[5:9, 5:9] == 0.0)
    assert np.isfinite(slope).all()


def heap(rows: int, columns: int, rise: float) -> np.ndarray:
    """A frustum in the middle, its top 20 cells wide, 10 cells high on ground that rises to the east."""
    row, column = np.mgrid[:rows, :columns]
    away = np.hypot(row - (rows - 1) / 2, column - (columns - 1) / 2)
    height = np.clip(10.0 - rise * (away - 10.0), 0.0, 10.0)
    return np.asarray(CELL_M * (height + 0.1 * column), np.float32)


@pytest.mark.parametrize("rise", [1.0, 2.7, 5.0])
def test_where_pairs_have_told_a_steep_face_the_surface_has_it(rise: float) -> None:
    """The ground of the coarser level has no heap."""
    truth, share = heap(80, 90, rise), np.zeros((80, 90), np.float32)
    share[12:-12, 12:-12] = 1.0
    along = surface_along(hillside(80, 90, 0.1, 0.0), CELL_M, truth, share)
    away = along - truth
    assert np.ptp(away[14:-14, 14:-14]) < 0.2 * CELL_M


def test_a_wall_that_pairs_have_told_is_none_of_the_surface() -> None:
    truth, share = hillside(60, 60, 0.1, 0.2), np.ones((60, 60), np.float32)
    house = truth.copy()
    house[20:40, 20:40] += 7.0
    along = surface_along(truth, CELL_M, house, share)
    assert np.ptp((along - truth)[4:-4, 4:-4]) < 0.7
    slope = slopes_without_walls(house, CELL_M, STEEPEST)
    assert np.abs(slope).max() <= STEEPEST * CELL_M
