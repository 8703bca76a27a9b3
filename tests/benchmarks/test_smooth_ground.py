"""What the benchmark of smooth ground calls smooth, and what it finds off there."""

import numpy as np
from smooth_ground import SQUARE_CELLS, covered, differences, smooth_ground

from photogram.grid import MapGrid

SIDE_M, ROUGH_FROM_M = 20.0, 12.0


def _cloud() -> np.ndarray:
    """Return points (N, 3) of a dome, with noise of 2 cm in the west and 40 cm from ROUGH_FROM_M on."""
    rng = np.random.default_rng(5)
    plan = rng.uniform(0.0, SIDE_M, (60000, 2))
    noise = np.where(plan[:, 0] < ROUGH_FROM_M, 0.02, 0.4) * rng.standard_normal(len(plan))
    return np.column_stack([plan + np.array([1000.0, 2000.0]), _dome(*plan.T) + noise])


def _dome(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 100.0 + 0.002 * (x - 10.0) ** 2 - 0.001 * y * (x - 10.0)


def test_ground_is_smooth_where_the_cloud_scatters_little() -> None:
    """All but a window beside the rough part, and nothing in it."""
    lattice, ground = smooth_ground(_cloud(), 0.15, 1.1)
    east = lattice.west_map_m - 1000.0 + (np.arange(lattice.columns) + 0.5) * lattice.cell_m
    known = np.isfinite(ground)
    assert known[:, (east > 1.5) & (east < ROUGH_FROM_M - 1.5)].mean() > 0.7  # the others hold no point
    assert not known[:, east > ROUGH_FROM_M].any()
    y = 20.0 - (np.arange(lattice.rows) + 0.5) * lattice.cell_m + (lattice.north_map_m - 2020.0)
    assert np.nanmax(np.abs(ground - _dome(east[None, :], y[:, None]))) < 0.15


def test_what_differs_is_found_whatever_the_datum_and_the_bend() -> None:
    """A surface 7 m above the cloud with another dome, and a patch 0.8 m off."""
    lattice, ground = smooth_ground(_cloud(), 0.15, 1.1)
    grid = MapGrid(1000.0, 2020.0, 0.05, 400, 400)
    x, y = (np.arange(400) + 0.5) * 0.05, 20.0 - (np.arange(400) + 0.5) * 0.05
    heights = (_dome(x[None, :], y[:, None]) + 7.0 + 0.003 * (x[None, :] - 4.0) ** 2).astype(np.float32)
    heights[100:140, 100:140] += np.float32(0.8)
    off = differences(heights, grid, lattice, ground)
    patch = np.zeros(off.shape, bool)
    patch[100:140, 100:140] = True
    assert np.nanmin(off[patch]) > 0.5
    assert np.nanmax(np.abs(off[~patch])) < 0.3


def test_a_point_covers_its_square() -> None:
    grid = MapGrid(1000.0, 2020.0, 0.05, 50, 30)  # no whole number of squares
    point = [1000.0 + 0.05 * 9.5, 2020.0 - 0.05 * 48.5, 3.0]
    found = covered(np.array([point, [0.0, 0.0, 0.0]]), grid)
    expected = np.zeros((50, 30), bool)
    expected[48:, SQUARE_CELLS : 2 * SQUARE_CELLS] = True
    assert np.array_equal(found, expected)
