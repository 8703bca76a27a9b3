"""How far heights that were not measured may be off."""

import numpy as np
import pytest

from photogram.grid import MapGrid, Window
from photogram.surface.ortho.unsure_heights import BLOCK_CELLS, UNIFORM, edge_sigma_m, height_ranges_m

GRID = MapGrid(0.0, 0.0, 0.1, 200, 240)


def ranges(height: np.ndarray) -> np.ndarray:
    """Return the ranges of a surface as large as its cells."""
    found = height_ranges_m(GRID, lambda window: height[window.slices].astype(np.float32))
    return found.repeat(BLOCK_CELLS, axis=0).repeat(BLOCK_CELLS, axis=1)[: GRID.rows, : GRID.columns]


def test_what_hides_beside_a_wall_may_lie_on_the_roof_or_on_the_ground() -> None:
    height = np.full((GRID.rows, GRID.columns), 2.0)
    height[80:120, 100:140] = 9.0
    height[80:120, 140:150] = np.nan
    found = ranges(height)
    assert (found[80:120, 140:150] == 7.0).all()
    assert (found[:40] == 0.0).all()


def test_a_wide_hole_has_the_range_of_what_is_around_it() -> None:
    height = np.full((GRID.rows, GRID.columns), 2.0)
    height[:, :100] = 5.0
    height[20:180, 20:220] = np.nan
    found = ranges(height)
    assert found[100, 100] == 3.0
    assert np.isfinite(found).all()
    assert np.isnan(ranges(np.full_like(height, np.nan))).all()


def test_a_uniform_error_has_the_standard_deviation_of_its_range() -> None:
    rng = np.random.default_rng(1)
    assert np.std(rng.uniform(0.0, 7.0, 100_000)) == pytest.approx(7.0 / UNIFORM, rel=0.01)


def test_ranges_depend_on_no_tile() -> None:
    rng = np.random.default_rng(2)
    height = np.where(rng.random((GRID.rows, GRID.columns)) < 0.3, np.nan, rng.random((GRID.rows, GRID.columns)))
    whole = height_ranges_m(GRID, lambda window: height[window.slices].astype(np.float32))
    calls: list[Window] = []

    def part(window: Window) -> np.ndarray:
        calls.append(window)
        return height[window.slices].astype(np.float32)

    np.testing.assert_array_equal(height_ranges_m(GRID, part), whole)
    assert calls


def test_measured_heights_are_unsure_at_edges_alone() -> None:
    height = np.full((40, 60), 2.0, np.float32)
    height[:, 30:] = 8.0
    found = edge_sigma_m(height, 0.1)
    np.testing.assert_allclose(found[:, 28:32], 6.0 / UNIFORM, rtol=1e-6)
    assert not found[:, :28].any()
    assert not found[:, 32:].any()
    assert not edge_sigma_m(np.full((9, 9), np.nan, np.float32), 0.1).any()
