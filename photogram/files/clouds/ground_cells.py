"""The ground of a laser survey as a grid: points of LAS or LAZ that are classified as ground, in cells.

A cell has the mean of its points, each brought to the middle of the cell along the slope of the ground there, so that
relief within a cell is no noise.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.errors import ProjectError
from photogram.files.clouds.points import las_parts, las_units, opened_las
from photogram.geodesy.crs import NO_CRS
from photogram.survey import Raster

GROUND = 2
"""Class of ground (ASPRS, LAS 1.4 R15, table 17)."""

PER_CELL = 8.0
"""Points of a cell in the mean: of those that fall where they like, one cell in 3000 has none then."""

MOST_CELLS = 25_000_000
"""Of a grid: points in few places far from each other would ask for more."""

BESIDE = 0.4
"""Of a side, beyond which the middle of a cell's points lies too far beside its own: at the edge of the ground."""

_SLOPES = 3
"""How often slopes are taken from the heights of the cells, and these again along them."""


@dataclass(frozen=True, eq=False)
class GroundCells:
    """The ground of a cloud around a site."""

    raster: Raster
    """Heights of the cells, m."""
    crs: str
    """What the file names as its CRS, NO_CRS where it names none."""
    of_point: float
    """Root mean square of 1/√n, n the points of a cell: its standard deviation over that of a point."""


def read_ground_cells(path: Path, low_m: FloatArray, high_m: FloatArray, crs: str = NO_CRS) -> GroundCells | None:
    """Return the ground within easting and northing ``low_m`` (2,) and ``high_m`` (2,) as a grid, None where the file
    has no ground there. Coordinates of a file without a CRS are in the units of ``crs``.

    Raises ProjectError where the file is missing or damaged, or no point of it is classified as ground.
    """
    inside, ground = list[FloatArray](), 0
    with opened_las(path) as reader:
        parsed = reader.header.parse_crs()
        named = NO_CRS if parsed is None else str(parsed.to_wkt())
        factors = las_units(reader.header, crs).factors
        for part in las_parts(path, reader):
            points = np.column_stack([part.x, part.y, part.z])[np.asarray(part.classification) == GROUND] * factors
            ground += len(points)
            inside.append(points[((points[:, :2] >= low_m) & (points[:, :2] <= high_m)).all(axis=1)])
    if not ground:
        raise ProjectError(
            f"point cloud {path}: no point of it is classified as ground (class {GROUND}): classify it, or give a "
            "height model of bare ground as GeoTIFF"
        )
    points = np.concatenate(inside)
    return _cells(points, named) if len(points) else None


def _cell_m(points: FloatArray) -> float:
    """Return a side of cells with PER_CELL points in the mean of those that have any, to two digits; more where there
    would be too many."""
    extent = np.maximum(np.ptp(points[:, :2], axis=0), 1e-3)
    side = float(np.sqrt(2.0 * PER_CELL * np.prod(extent) / len(points)))
    place = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / side).astype(np.int64)
    occupied = len(np.unique(place, axis=0))
    side = float(np.sqrt(max(PER_CELL * occupied * side**2 / len(points), np.prod(extent) / MOST_CELLS)))
    digit = 10.0 ** (np.floor(np.log10(side)) - 1.0)
    return float(np.ceil(side / digit) * digit)


def _slope(values: FloatArray, cell_m: float, axis: int) -> FloatArray:
    """Return the slope of heights (R, C) along an axis: between both neighbours, to one where the other is missing, 0
    without any."""
    padded = np.pad(values, [(1, 1) if k == axis else (0, 0) for k in range(2)], constant_values=np.nan)
    before, after = (np.take(padded, range(k, k + values.shape[axis]), axis=axis) for k in (0, 2))
    whole, one, other = (after - before) / 2.0, after - values, values - before
    found = np.where(np.isfinite(whole), whole, np.where(np.isfinite(one), one, other))
    return np.nan_to_num(found / cell_m)


def _cells(points: FloatArray, crs: str) -> GroundCells | None:
    """Return points (N, 3) of the ground as a grid, None where none of its cells has points around its middle."""
    cell_m = _cell_m(points)
    west = float(np.floor(points[:, 0].min() / cell_m) * cell_m)
    north = float(np.ceil(points[:, 1].max() / cell_m) * cell_m)
    x, y = (points[:, 0] - west) / cell_m, (north - points[:, 1]) / cell_m
    column, row = x.astype(np.int64), y.astype(np.int64)
    shape = int(row.max()) + 1, int(column.max()) + 1
    cell: IntArray = row * shape[1] + column
    count = np.bincount(cell, minlength=shape[0] * shape[1])
    level = float(points[:, 2].mean())
    z, values = points[:, 2] - level, np.full(shape, np.nan)
    east, south = (x - column - 0.5) * cell_m, (y - row - 0.5) * cell_m
    off = (np.abs(np.bincount(cell, part, minlength=len(count))) for part in (east, south))
    known = (count > 0) & (np.maximum(*off) <= BESIDE * cell_m * count)
    if not known.any():
        return None
    along = np.zeros(len(z))
    for _ in range(_SLOPES):
        sums = np.bincount(cell, z - along, minlength=len(count))
        values.ravel()[known] = sums[known] / count[known]
        along = _slope(values, cell_m, 1).ravel()[cell] * east + _slope(values, cell_m, 0).ravel()[cell] * south
    raster = Raster((values + level).astype(np.float32), west, north, cell_m)
    return GroundCells(raster, crs, float(np.sqrt(np.mean(1.0 / count[known]))))
