"""Triangulated surfaces, designs above all, on the cells of a survey: the height of the triangle at each middle."""

from dataclasses import dataclass, field

import numpy as np

from photogram.arrays import Float32Array, FloatArray
from photogram.compilation import njit
from photogram.errors import FrameError, ProjectError
from photogram.files.maps.rasters import RasterFile
from photogram.files.triangulations.triangulation import Triangulation
from photogram.geodesy.crs import NO_CRS, crs_label, height_system_of, map_units, plan_of
from photogram.grid import MapGrid, Window
from photogram.volumes.extents import Extent, extent_of, no_overlap
from photogram.volumes.surfaces import StatedSigma, SurfaceFiles

APART_M = 0.01
"""By more than this triangles that lie over one another may not differ."""

_NEAR = 1e-7
"""Cells by which the middle of one may lie beside a triangle."""


@dataclass(frozen=True, eq=False)
class TriangulatedRaster(RasterFile):
    """Triangles read as a raster; NaN where the middle of a cell lies in none."""

    corner_map_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """Easting, northing and height (T, 3, 3) of the corners of each triangle."""

    def read(self, window: Window) -> Float32Array:
        """Return the heights (rows, columns) of a window, which may reach beyond the grid. Raises ProjectError where
        two triangles lie over one another."""
        out = np.full(window.shape, np.nan, dtype=np.float32)
        cell_m = self.grid.cell_m
        west, north = self.grid.west_map_m + window.column * cell_m, self.grid.north_map_m - window.row * cell_m
        east, south = west + window.shape[1] * cell_m, north - window.shape[0] * cell_m
        low, high = self.corner_map_m[..., :2].min(axis=1), self.corner_map_m[..., :2].max(axis=1)
        near = (low[:, 0] <= east) & (high[:, 0] >= west) & (low[:, 1] <= north) & (high[:, 1] >= south)
        corner = self.corner_map_m[near]
        place = np.empty_like(corner)
        place[..., 0] = (corner[..., 0] - west) / cell_m - 0.5
        place[..., 1] = (north - corner[..., 1]) / cell_m - 0.5
        place[..., 2] = corner[..., 2]
        row, column, other = _fill(place, out)
        if row >= 0:
            at = f"E {west + (column + 0.5) * cell_m:.2f}, N {north - (row + 0.5) * cell_m:.2f}"
            raise ProjectError(
                f"surface {self.path}: triangles lie over one another at {at}, at {out[row, column]:.2f} and "
                f"{other:.2f} m: export one surface alone"
            )
        return out


def triangulated(
    tin: Triangulation, over: RasterFile, stated: StatedSigma, correlation_m: float
) -> tuple[SurfaceFiles, tuple[str, ...]]:
    """Return a triangulation on the cells of another surface, and what was assumed or converted, in sentences.

    Without a CRS it is taken in the plan of the other's, without a unit in its units. Raises FrameError where the two
    do not overlap.
    """
    crs, units = tin.crs or plan_of(over.crs), map_units(over.crs)
    factors = units.factors if tin.unit is None else np.full(3, tin.unit.length_m)
    corner = tin.corner * factors
    extent = Extent(*(float(f(corner[..., axis])) for axis, f in ((0, np.min), (0, np.max), (1, np.min), (1, np.max))))
    grid = over.grid
    window = grid.common(
        Window(
            int(np.floor((grid.north_map_m - extent.north_m) / grid.cell_m)),
            int(np.floor((extent.west_m - grid.west_map_m) / grid.cell_m)),
            int(np.ceil((grid.north_map_m - extent.south_m) / grid.cell_m)),
            int(np.ceil((extent.east_m - grid.west_map_m) / grid.cell_m)),
        )
    )
    unit = "the units of the map" if tin.unit is None else tin.unit.name
    if window is None:
        raise FrameError(no_overlap((f"{tin.path} (read in {unit})", extent), (str(over.path), extent_of(grid))))
    west, north = grid.west_map_m + window.column * grid.cell_m, grid.north_map_m - window.row * grid.cell_m
    heights = TriangulatedRaster(tin.path, MapGrid(west, north, grid.cell_m, *window.shape), crs, corner_map_m=corner)
    surface = SurfaceFiles(heights, None, None, None, stated, None, correlation_m)
    return surface, tuple(_remarks(tin, over))


def _remarks(tin: Triangulation, over: RasterFile) -> list[str]:
    name, other = tin.path.name, over.path.name
    said = [f"{name}: {len(tin.corner)} triangles on the cells of {other}."]
    if tin.crs is None:
        said.append(f"{name} names no CRS: it is taken in that of {other}, {crs_label(plan_of(over.crs))}.")
    if tin.unit is None:
        said.append(f"{name} states no unit: it is taken in that of the map, {map_units(over.crs).words}.")
    elif tin.unit.length_m != 1.0:
        said.append(f"{name} is in {tin.unit.name}: converted to metres.")
    if tin.heights:
        said.append(f"{name} counts its heights from {tin.heights!r}, which is not compared with those of {other}.")
    elif all(height_system_of(crs)[0] is None for crs in (tin.crs or NO_CRS, over.crs)):
        said.append(f"Neither {name} nor {other} says what its heights count from: they are taken for the same.")
    return said


@njit(cache=True, nogil=True)
def _fill(place: FloatArray, out: Float32Array) -> tuple[int, int, float]:
    """Fill an array with the heights of triangles (T, 3, 3), column, row and height each, whose units are cells;
    return row and column of the first cell in which two differ, and the other height, −1 without any."""
    rows, columns = out.shape
    for t in range(len(place)):
        a, b, c = place[t, 0], place[t, 1], place[t, 2]
        ux, uy, uz, vx, vy, vz = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
        across = ux * vy - uy * vx
        if across == 0.0:
            continue
        east, south = (uz * vy - uy * vz) / across, (ux * vz - uz * vx) / across
        first_row = max(0, int(np.ceil(min(a[1], b[1], c[1]) - _NEAR)))
        last_row = min(rows - 1, int(np.floor(max(a[1], b[1], c[1]) + _NEAR)))
        for row in range(first_row, last_row + 1):
            low, high = np.inf, -np.inf
            for side in range(3):
                p, q = place[t, side], place[t, (side + 1) % 3]
                top, bottom = min(p[1], q[1]), max(p[1], q[1])
                y = min(max(float(row), top), bottom)
                if abs(y - row) > _NEAR:
                    continue
                if p[1] == q[1]:
                    low, high = min(low, p[0], q[0]), max(high, p[0], q[0])
                else:
                    x = p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
                    low, high = min(low, x), max(high, x)
            if low > high:
                continue
            first = int(np.ceil(max(low - _NEAR, 0.0)))
            last = int(np.floor(min(high + _NEAR, columns - 1.0)))
            for column in range(first, last + 1):
                z = a[2] + east * (column - a[0]) + south * (row - a[1])
                there = out[row, column]
                if not np.isnan(there) and abs(there - z) > APART_M:
                    return row, column, z
                out[row, column] = z
    return -1, -1, 0.0
