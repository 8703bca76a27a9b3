"""Two surveys of simulated ground that has changed, with errors as photogram's surfaces have them and truth beside.

An epoch's surface is the ground shifted, tilted and bent as a block is, each by a random number of stated standard
deviation, plus noise that is correlated over the width of a matching window. Nothing is written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter

from photogram.arrays import Float32Array, FloatArray
from photogram.files.maps.rasters import RasterFile
from photogram.grid import MapGrid, Window
from photogram.volumes.surfaces import BlockErrors, SurfaceFiles

CRS = "EPSG:25832"
CORNER = 500_000.0, 6_000_000.0
WINDOW = 5
"""Cells that a moving average of white noise goes over: its correlation is that of windows that share pixels."""

Ground = Callable[[FloatArray, FloatArray], FloatArray]
"""Heights of the true ground at eastings and northings."""


@dataclass(frozen=True)
class MemoryRaster(RasterFile):
    """A raster that lies in memory."""

    values: Float32Array | None = None

    def read(self, window: Window) -> Float32Array:
        """Return a window as the file would."""
        out = np.full(window.shape, np.nan, dtype=np.float32)
        inner = self.grid.common(window)
        if inner is not None and self.values is not None:
            out[inner.within(window)] = self.values[inner.slices]
        return out


@dataclass(frozen=True)
class Errors:
    """Standard deviations of an epoch, m; tilt and dome at the radius of the block."""

    own_m: tuple[float, float] = (0.01, 0.03)
    """Of a cell's own, from one side of the grid to the other."""
    shift_m: tuple[float, float, float] = (0.015, 0.015, 0.02)
    tilt_m: float = 0.01
    dome_m: float = 0.005
    radius_m: float = 100.0


@dataclass(frozen=True, eq=False)
class Drawn:
    """The errors of one epoch of a block, drawn."""

    shift_m: FloatArray
    slope: FloatArray
    dome_m: float

    @staticmethod
    def of(errors: Errors, rng: np.random.Generator) -> Drawn:
        """Draw them."""
        return Drawn(
            rng.standard_normal(3) * errors.shift_m,
            rng.standard_normal(2) * errors.tilt_m / errors.radius_m,
            float(rng.standard_normal() * errors.dome_m),
        )


def grid_at(east_m: float, north_m: float, side_m: float, cell_m: float) -> MapGrid:
    """Return a grid around a place of a block, whose middle is CORNER."""
    n = round(side_m / cell_m)
    west = np.round((CORNER[0] + east_m - side_m / 2) / cell_m) * cell_m
    north = np.round((CORNER[1] + north_m + side_m / 2) / cell_m) * cell_m
    return MapGrid(float(west), float(north), cell_m, n, n)


def correlated_noise(shape: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Return noise (rows, columns) of standard deviation 1 that is correlated over WINDOW cells."""
    rows, columns = shape
    white = rng.standard_normal((rows + WINDOW, columns + WINDOW))
    return np.asarray(uniform_filter(white, WINDOW)[:rows, :columns] * WINDOW)


def place_of(grid: MapGrid) -> tuple[FloatArray, FloatArray]:
    """Return eastings and northings (rows, columns) of all cells from the middle of the block."""
    east, north = grid.centres_map_m(grid.whole)
    x, y = np.meshgrid(east - CORNER[0], north - CORNER[1])
    return x, y


def common_error_m(drawn: Drawn, errors: Errors, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return what tilt, dome and the shift in height do at places from the middle of the block."""
    dome = drawn.dome_m * (x**2 + y**2) / errors.radius_m**2
    return np.asarray(drawn.shift_m[2] + drawn.slope[0] * x + drawn.slope[1] * y + dome)


def common_variance_m2(errors: Errors, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the variance of ``common_error_m``."""
    tilt, dome = errors.tilt_m / errors.radius_m, errors.dome_m / errors.radius_m**2
    square = x**2 + y**2
    return np.asarray(errors.shift_m[2] ** 2 + tilt**2 * square + (dome * square) ** 2)


def epoch(
    ground: Ground, grid: MapGrid, errors: Errors, rng: np.random.Generator, drawn: Drawn | None = None,
    name: str = "dsm.tif", whole_only: bool = False,
) -> SurfaceFiles:  # fmt: skip
    """Return a survey of true ground with the standard deviations that its errors have."""
    x, y = place_of(grid)
    drawn = drawn or Drawn.of(errors, rng)
    own = np.broadcast_to(np.linspace(*errors.own_m, grid.columns), x.shape)
    seen = ground(x - drawn.shift_m[0], y - drawn.shift_m[1])
    height = seen + common_error_m(drawn, errors, x, y) + own * correlated_noise((grid.rows, grid.columns), rng)
    step = 0.5 * grid.cell_m
    rise_east = (ground(x + step, y) - ground(x - step, y)) / (2 * step)
    rise_north = (ground(x, y + step) - ground(x, y - step)) / (2 * step)
    plan = (errors.shift_m[0] * rise_east) ** 2 + (errors.shift_m[1] * rise_north) ** 2
    whole = np.sqrt(own**2 + common_variance_m2(errors, x, y) + plan)

    def raster(part: str, values: FloatArray) -> MemoryRaster:
        return MemoryRaster(Path(name.replace(".tif", f"{part}.tif")), grid, CRS, values=values.astype(np.float32))

    block = BlockErrors(errors.shift_m[0], errors.shift_m[1], errors.tilt_m / errors.radius_m, CORNER)
    return SurfaceFiles(
        raster("", height), raster("_sigma", whole), None if whole_only else raster("_sigma_own", own), None, None,
        block, WINDOW * grid.cell_m,
    )  # fmt: skip


@dataclass(frozen=True)
class Heap:
    """A heap at a place of the block: a cone of an angle of repose with a round top, on uneven ground."""

    east_m: float
    north_m: float
    radius_m: float
    slope: float

    def height(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return its height above the ground; negative slopes make a pit."""
        distance = np.hypot(x - self.east_m, y - self.north_m)
        blunt = np.hypot(distance, 0.15 * self.radius_m)
        return np.asarray(self.slope * np.maximum(np.hypot(self.radius_m, 0.15 * self.radius_m) - blunt, 0.0))


def uneven(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return heights of ground that was there before."""
    return np.asarray(40.0 + 0.03 * x - 0.02 * y + 0.3 * np.sin(x / 7.0) * np.cos(y / 9.0))
