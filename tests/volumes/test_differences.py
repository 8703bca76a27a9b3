"""Differences of two surfaces: their grid, their standard deviations, and what cannot be compared."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lib.simulated_changes import CRS, Errors, MemoryRaster, epoch, grid_at, uneven

from photogram.errors import FrameError
from photogram.grid import MapGrid, Window
from photogram.volumes.differences import LEVEL, LOWERED, RAISED, UNCHANGED, difference_of
from photogram.volumes.surfaces import StatedSigma, SurfaceFiles


def level(height_m: float, grid: MapGrid, crs: str = CRS, sigma: tuple[float, float] = (0.03, 0.04)) -> SurfaceFiles:
    values = np.full((grid.rows, grid.columns), height_m, np.float32)
    raster = MemoryRaster(Path(f"{height_m:g}.tif"), grid, crs, values=values)
    return SurfaceFiles(raster, None, None, None, StatedSigma(*sigma), None, 1.0)


GRID = MapGrid(500_000.0, 6_000_000.0, 0.5, 40, 60)


def test_the_difference_is_later_minus_earlier_with_the_sigmas_of_both() -> None:
    cells = difference_of(level(10.0, GRID), level(10.2, GRID, sigma=(0.0, 0.12))).cells(GRID.whole)
    np.testing.assert_allclose(cells.difference_m, 0.2, atol=1e-6)
    np.testing.assert_allclose(cells.sigma_m, 0.13)  # 0.03, 0.04, 0.12
    assert np.all(cells.codes == UNCHANGED)
    assert LEVEL * 0.13 > 0.2
    risen, sunk = (difference_of(level(10.0, GRID), level(10.0 + d, GRID)).cells(GRID.whole) for d in (0.2, -0.2))
    assert np.all(risen.codes == RAISED)
    assert np.all(sunk.codes == LOWERED)


@pytest.mark.parametrize(
    ("other", "expected", "resampled"),
    [
        (MapGrid(500_005.0, 5_999_990.0, 0.5, 40, 60), MapGrid(500_005.0, 5_999_990.0, 0.5, 20, 50), ()),
        (MapGrid(500_005.0, 5_999_990.0, 0.25, 40, 60), MapGrid(500_005.0, 5_999_990.0, 0.25, 40, 60), ("10.tif",)),
        (MapGrid(500_005.1, 5_999_990.0, 2.0, 4, 6), MapGrid(500_005.0, 5_999_990.0, 0.5, 16, 24), ("11.tif",)),
    ],
)
def test_the_grid_is_that_of_the_finer_one_over_what_both_cover(
    other: MapGrid, expected: MapGrid, resampled: tuple[str, ...]
) -> None:
    difference = difference_of(level(10.0, GRID), level(11.0, other))
    assert difference.grid == expected
    assert difference.resampled == resampled
    inner = difference.cells(Window(6, 6, 12, 14))
    np.testing.assert_allclose(inner.difference_m, 1.0)


def test_a_surface_that_does_not_state_its_height_system_is_named() -> None:
    stated, silent = level(10.0, GRID, "EPSG:25832+7837"), level(11.0, GRID)
    assert difference_of(stated, silent).undeclared_heights == ("11.tif",)
    assert difference_of(silent, stated).undeclared_heights == ("11.tif",)
    assert difference_of(stated, stated).undeclared_heights == ()
    assert difference_of(silent, silent).undeclared_heights == ()


def test_simulated_unchanged_ground_lies_within_the_level_of_detection() -> None:
    rng = np.random.default_rng(1)
    shares, grid = [], grid_at(20.0, 30.0, 12.0, 0.2)
    for _ in range(150):
        earlier, later = (epoch(uneven, grid, Errors(), rng) for _ in range(2))
        difference = difference_of(earlier, later)
        shares.append(np.mean(difference.cells(difference.grid.whole).codes == UNCHANGED))
    assert np.mean(shares) == pytest.approx(0.95, abs=0.02)


def test_on_a_resampled_grid_it_does_too() -> None:
    rng = np.random.default_rng(2)
    shares, own = [], replace(Errors(), shift_m=(0.0, 0.0, 0.0), tilt_m=0.0, dome_m=0.0)
    fine, coarse = grid_at(20.0, 30.0, 12.0, 0.2), grid_at(20.07, 30.11, 14.0, 0.3)
    for _ in range(30):
        difference = difference_of(epoch(uneven, coarse, own, rng), epoch(uneven, fine, own, rng))
        shares.append(np.mean(difference.cells(difference.grid.whole).codes == UNCHANGED))
    assert 0.945 < np.mean(shares) < 0.975  # between cells noise is a little less than the sigma that is interpolated


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(
        FrameError, match=r"their CRS differ, EPSG:25833 and EPSG:25832: reproject one to the other's \(gdalwarp"
    ):
        difference_of(level(10.0, GRID), level(11.0, GRID, "EPSG:25833"))
    with pytest.raises(FrameError, match=r"their heights differ, orthometric \(EPSG:5799\) and orthometric"):
        difference_of(level(10.0, GRID, "EPSG:25832+5783"), level(11.0, GRID, "EPSG:25832+5799"))
    with pytest.raises(FrameError, match="do not overlap"):
        difference_of(level(10.0, GRID), level(11.0, replace(GRID, west_map_m=900_000.0)))
    assert difference_of(level(10.0, GRID, "EPSG:25832+5799"), level(11.0, GRID)).grid == GRID
