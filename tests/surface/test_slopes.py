"""Slopes without walls, and the gentle surface that has them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.surface.dense.slopes import gentle_surface, slopes_without_walls

CELL_M = 0.5


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
    gentle = gentle_surface(surface, CELL_M)
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
    gentle = gentle_surface(surface, CELL_M)
    away = gentle - hillside(90, 90, 0.3, 0.1)
    assert np.ptp(away[8:-8, 8:-8]) < 1.0


def test_a_gabled_roof_keeps_its_slopes() -> None:
    """45° to either side of its ridge, 40 cells wide, on walls of 5 m."""
    row, column = np.mgrid[:100, :100]
    on_roof = (np.abs(column - 49.5) < 20) & (np.abs(row - 49.5) < 30)
    rise = 0.9
    surface = np.where(on_roof, 5.0 + rise * CELL_M * (20 - np.abs(column - 49.5)), 0.0).astype(np.float32)
    gentle = gentle_surface(surface, CELL_M)
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
