"""Surfaces on disk: what their files say of their errors, and windows of them on another grid."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from changed_surveys import write_epochs
from lib.simulated_changes import CRS, Errors, MemoryRaster, epoch, grid_at, uneven

from photogram.grid import MapGrid, Window
from photogram.volumes.surfaces import (
    BlockErrors,
    SurfaceFiles,
    labels,
    open_rasters,
    same_cells,
    surface_cells,
    surface_path,
)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_epochs(tmp_path_factory.mktemp("epochs"))[1]


def test_what_lies_beside_a_surface_is_found(results: Path) -> None:
    assert surface_path(results.parent) == results / "deliverables/dsm.tif"
    surface = open_rasters(results / "deliverables/dsm.tif", None, None, None, local=False)
    assert surface.correlation_m == pytest.approx(1.0)
    assert surface.block is None
    assert surface.sigma_source == "dsm_sigma.tif, dsm_sigma_own.tif"
    cells = surface_cells(surface, surface.heights.grid, Window(-3, 5, 70, 60))
    assert np.isnan(cells.height_m[:3]).all()
    assert np.isnan(cells.height_m[65:69, 37:42]).all()
    assert np.all(cells.width[np.isfinite(cells.height_m)] == 1.0)


def test_both_parts_add_up_to_the_whole(results: Path) -> None:
    surface = open_rasters(results / "deliverables/dsm.tif", None, None, None, local=False)
    surface = replace(surface, block=BlockErrors(0.015, 0.01, 1e-4))
    window = Window(20, 20, 60, 60)
    cells = surface_cells(surface, surface.heights.grid, window)
    assert surface.sigma is not None
    whole = surface.sigma.read(window)
    np.testing.assert_allclose(np.sqrt(cells.own_m**2 + np.sum(cells.pattern_m**2, axis=0)), whole, rtol=1e-5)
    assert np.abs(cells.pattern_m[0]).max() > 0.001  # on the heap a shift raises slopes
    far = replace(surface, block=BlockErrors(10.0, 10.0, 1.0))  # a report that says more than the raster
    cells = surface_cells(far, surface.heights.grid, window)
    np.testing.assert_allclose(np.sqrt(cells.own_m**2 + np.sum(cells.pattern_m**2, axis=0)), whole, rtol=1e-5)


def test_patterns_have_the_sign_of_what_a_shift_does() -> None:
    rng = np.random.default_rng(1)
    none = Errors(own_m=(0.0, 0.0), shift_m=(0.05, 0.05, 0.02), tilt_m=0.0, dome_m=0.0)
    grid = grid_at(0.0, 0.0, 20.0, 0.2)
    surface = epoch(uneven, grid, none, rng)
    x, y = (a - at for a, at in zip(np.meshgrid(*grid.centres_map_m(grid.whole)), (5e5, 6e6), strict=True))
    assert isinstance(surface.heights, MemoryRaster)
    true = replace(surface, heights=replace(surface.heights, values=uneven(x, y).astype(np.float32)))
    cells = surface_cells(true, grid, grid.whole)
    inner = slice(3, -3), slice(3, -3)
    for pattern, moved in ((0, uneven(x - 0.05, y)), (1, uneven(x, y - 0.05))):
        np.testing.assert_allclose(cells.pattern_m[pattern][inner], (moved - uneven(x, y))[inner], atol=1e-4)


def test_a_plane_on_another_grid_is_itself() -> None:
    def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(10.0 + 0.1 * (x - 100.0) - 0.2 * (y - 50.0))

    own = MapGrid(100.0, 50.0, 0.5, 40, 60)
    grid = MapGrid(101.13, 49.37, 0.2, 50, 80)
    heights, sigma = (
        MemoryRaster(Path("a.tif"), own, CRS, values=v.astype(np.float32))
        for v in (plane(*np.meshgrid(*own.centres_map_m(own.whole))), np.full((40, 60), 0.03))
    )
    surface = SurfaceFiles(heights, sigma, None, None, None, None, 2.5)
    assert not same_cells(own, grid)
    cells = surface_cells(surface, grid, Window(5, 7, 40, 70))
    expected = plane(*np.meshgrid(*grid.centres_map_m(Window(5, 7, 40, 70))))
    np.testing.assert_allclose(cells.height_m, expected, atol=1e-5)
    np.testing.assert_allclose(cells.pattern_m[4], 0.03, rtol=1e-6)  # nothing tells the parts apart: all is common
    beyond = surface_cells(surface, grid, Window(-20, -20, 5, 5))
    assert np.isnan(beyond.height_m[:10]).all()


def test_cells_that_lie_on_each_other() -> None:
    grid = MapGrid(600_000.0, 6_000_000.0, 0.1, 3000, 4000)
    assert same_cells(grid, replace(grid, west_map_m=600_012.3, north_map_m=5_999_999.9, rows=10))
    assert not same_cells(grid, replace(grid, west_map_m=600_012.35))
    assert not same_cells(grid, replace(grid, cell_m=0.1001))


def test_surfaces_are_told_apart_by_their_folders() -> None:
    assert labels(Path("/a/b.tif"), Path("/c/d.tif")) == ("b.tif", "d.tif")
    may, june = Path("/s/may/results/deliverables/dsm.tif"), Path("/s/june/dsm.tif")
    assert labels(may, june) == ("may/dsm.tif", "june/dsm.tif")
