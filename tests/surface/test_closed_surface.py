"""The surface of orthophotos: sharp where the DSM is sure, smooth in canopy, without holes, the same in any tiles."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from photogram.arrays import Float32Array
from photogram.grid import MapGrid, Window
from photogram.surface.dsm import filled_heights
from photogram.surface.ortho import closed_surface
from photogram.surface.ortho.closed_surface import close_surface, filled_from_coarser

GRID = MapGrid(1000.0, 2000.0, 0.1, 300, 340)
ROWS, COLUMNS = np.mgrid[0:300, 0:340]
HOUSE = (np.abs(ROWS - 80) < 40) & (np.abs(COLUMNS - 90) < 50)
WOOD = (ROWS > 160) & (COLUMNS > 150)
WATER = (ROWS > 200) & (COLUMNS < 100)


def site() -> tuple[Float32Array, Float32Array]:
    """Return a gentle slope with a house, a wood of crowns of which a third is measured, and water without heights; and
    standard deviations."""
    rng = np.random.default_rng(1)
    height = 0.01 * COLUMNS + rng.normal(0.0, 0.02, ROWS.shape)
    height[HOUSE] += 6.0
    crowns = 8.0 + 2.0 * np.sin(ROWS / 6.0) * np.cos(COLUMNS / 7.0) + rng.normal(0.0, 0.3, ROWS.shape)
    height[WOOD] = crowns[WOOD]
    lumps = np.kron(rng.random((60, 68)) < 0.35, np.ones((5, 5), bool))
    height[(WOOD & ~lumps) | WATER] = np.nan
    return height.astype(np.float32), np.full(ROWS.shape, 0.03, np.float32)


def closed(height: Float32Array, sigma: Float32Array) -> tuple[NDArray[Any], NDArray[Any]]:
    filled = filled_heights(height, GRID.cell_m, 25)
    out, spread = np.full(height.shape, np.nan, np.float32), np.full(height.shape, np.nan, np.float32)

    def part(window: Window) -> Any:
        at = window.slices
        return filled[at], np.isfinite(height[at]), sigma[at]

    def write(window: Window, values: Float32Array, sigmas: Float32Array) -> None:
        out[window.slices], spread[window.slices] = values, sigmas

    with ThreadPoolExecutor(2) as pool:
        close_surface(GRID, part, pool, write)
    return out, spread


def test_it_has_no_holes_and_keeps_what_is_sure() -> None:
    height, sigma = site()
    out, spread = closed(height, sigma)
    assert np.isfinite(out).all()
    assert np.isfinite(spread).all()
    sure = (ROWS < 140) & np.isfinite(height)
    np.testing.assert_allclose(out[sure], height[sure], atol=1e-4)
    np.testing.assert_allclose(spread[sure], 0.03, atol=1e-5)


def test_walls_stay_sharp() -> None:
    height, sigma = site()
    out, _ = closed(height, sigma)
    assert np.all(np.abs(out[80, [36, 40, 140, 144]] - 0.01 * np.array([36, 40, 140, 144])) < 0.15)
    assert np.all(out[80, [41, 45, 135, 139]] > 5.9)


def test_canopy_is_smooth_and_knows_its_roughness() -> None:
    height, sigma = site()
    out, spread = closed(height, sigma)
    inner = (ROWS > 190) & (COLUMNS > 180) & (ROWS < 290) & (COLUMNS < 330)
    step = np.abs(np.diff(out, axis=1))[inner[:, 1:]]
    known = np.isfinite(height)
    rough = np.abs(np.diff(height, axis=1))[(inner & known)[:, 1:] & known[:, :-1]]
    assert np.median(step) < 0.2 * np.median(rough)
    assert np.abs(out[inner] - 8.0).max() < 2.5
    assert np.median(spread[inner]) > 0.3


def test_water_takes_the_level_of_its_shore() -> None:
    height, sigma = site()
    out, _ = closed(height, sigma)
    assert np.abs(out[WATER] - 0.01 * COLUMNS[WATER]).max() < 1.2


def test_tiles_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    height, sigma = site()
    once = closed(height, sigma)
    monkeypatch.setattr(closed_surface, "TILE_CELLS", 64)
    again = closed(height, sigma)
    for a, b in zip(once, again, strict=True):
        assert np.array_equal(a, b)


def test_nothing_is_made_of_nothing() -> None:
    out, _ = closed(np.full(ROWS.shape, np.nan, np.float32), np.zeros(ROWS.shape, np.float32))
    assert np.isnan(out).all()


def test_filling_keeps_what_is_known_and_planes_that_surround_a_hole() -> None:
    y, x = np.mgrid[0:64, 0:64]
    plane = (0.5 * x - 0.2 * y).astype(np.float32)
    holed = plane.copy()
    holed[24:40, 28:36] = np.nan
    filled = filled_from_coarser(holed)
    known = np.isfinite(holed)
    assert np.array_equal(filled[known], plane[known])
    assert np.abs(filled - plane).max() < 3.0
    assert np.isnan(filled_from_coarser(np.full((5, 7), np.nan, np.float32))).all()
