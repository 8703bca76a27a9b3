"""A raster of heights as a triangulation (TIN) of few of its cells, within a vertical error.

Greedy insertion (Garland & Heckbert 1995, algorithm III): of every triangle the cell that lies farthest off becomes a
vertex, and the Delaunay triangulation is made again, until none is off by more than is asked for. Where a triangle
reaches over ground without heights, cells at its edge become vertices, so that the triangles there can be left out.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError

from photogram.arrays import BoolArray, Float32Array, FloatArray, IntArray
from photogram.compilation import njit
from photogram.errors import SurfaceError
from photogram.files.maps.rasters import open_raster
from photogram.grid import MapGrid, Window, block_means
from photogram.surface.contours import interval_for
from photogram.survey import Raster

MOST_CELLS = 16_000_000
"""A larger raster is averaged to so many cells, as for contour lines."""

MOST_VERTICES = 500_000
"""A triangulation has no more: beyond, programs of construction work slowly, and the error that is reached is told."""

DEFAULT_ERROR_INTERVALS = 0.1
"""Of a contour interval that a triangulation may be off by, where nothing else is asked for."""

ROUNDING_M = 1e-4
"""By which heights of single precision may miss it."""

_FIRST_CELLS = 48
_EDGE_CELLS = 64
_APART_CELLS2 = 4.0
_STRIP_CELLS = 4_000_000


@dataclass(frozen=True, eq=False)
class ThinnedTin:
    """Triangles (T) between vertices (V) that are cells of a raster."""

    vertex_map_m: FloatArray
    """Easting, northing, height (V, 3)."""
    triangle: IntArray
    """Vertices (T, 3) of each triangle, counter-clockwise."""
    cell_m: float
    """Side of the cells that it was made of."""
    cells: int
    """How many of them have a height."""
    covered: int
    """How many of these it covers."""
    greatest_m: float
    """Greatest vertical distance of a covered cell, its centre, from the triangles."""
    rms_m: float
    """Root mean square of these distances."""


def reduced_raster(path: Path, *, local: bool = False, most: int = MOST_CELLS) -> Raster:
    """Return the heights of a GeoTIFF, averaged to ``most`` cells where it has more; read strip by strip. A cell of
    which half has no height has none. Raises ProjectError where the file cannot be read."""
    file = open_raster(path, local=local)
    grid = file.grid
    block = max(1, int(np.ceil(np.sqrt(grid.rows * grid.columns / most))))
    rows = block * max(1, _STRIP_CELLS // (grid.columns * block))
    strips = []
    for first in range(0, grid.rows, rows):
        values = file.read(Window(first, 0, min(first + rows, grid.rows), grid.columns))
        if block > 1:
            mean, share = block_means(values, block)
            values = np.where(share >= 0.5, mean, np.nan).astype(np.float32)
        strips.append(values)
    return Raster(np.vstack(strips), grid.west_map_m, grid.north_map_m, grid.cell_m * block)


def interval_of(raster: Raster) -> float:
    """Return the contour interval, m, that the relief of a raster asks for."""
    known = raster.values[np.isfinite(raster.values)]
    low, high = np.percentile(known, [0.5, 99.5]) if len(known) else (0.0, 0.0)
    return interval_for(float(high - low))


def thinned_tin(
    raster: Raster, error_m: float, most: int = MOST_VERTICES, fixed: BoolArray | None = None
) -> ThinnedTin:
    """Return a triangulation of the cells of a raster that is off by ``error_m`` at most, or has ``most`` vertices.

    Cells (R, C) that are ``fixed`` are vertices in any case, where they have a height. Beside the raster some 300 bytes
    for each vertex, and a raster of the same size. Raises SurfaceError where fewer than three cells have a height, or
    all lie on one line.
    """
    heights = np.ascontiguousarray(raster.values, dtype=np.float32)
    chosen = _first_cells(heights)
    if fixed is not None:
        chosen = np.union1d(chosen, np.flatnonzero(fixed & np.isfinite(heights)))
    while True:
        place, triangle = _triangulated(heights, chosen)
        off_m, off, known, empty, edge, edge_cells2 = _looked_over(heights, place, triangle)
        ragged = (known >= _EDGE_CELLS) & (empty >= _EDGE_CELLS) & (edge_cells2 >= _APART_CELLS2)
        wrong = off_m > error_m
        wanted = np.concatenate([off[wrong], edge[ragged & ~wrong]])
        rank = np.concatenate([off_m[wrong], np.zeros(np.count_nonzero(ragged & ~wrong))])
        wanted = wanted[np.argsort(-rank, kind="stable")]
        _, first = np.unique(wanted, return_index=True)
        wanted = wanted[np.sort(first)]
        new = wanted[~np.isin(wanted, chosen)][: max(0, most - len(chosen))]
        if not len(new):
            break
        chosen = np.union1d(chosen, new)
    return _judged(raster, heights, place, triangle[(known > empty) & (known > 0)])


def _first_cells(heights: Float32Array) -> IntArray:
    """Return the indices of the cells to begin with: a coarse lattice, and the convex hull of all that have heights."""
    row, column = np.nonzero(np.isfinite(heights))
    edges = np.flatnonzero(np.diff(row, prepend=-1, append=-1) != 0)
    ends = np.unique(np.concatenate([edges[:-1], edges[1:] - 1])) if len(row) else edges[:0]
    try:
        hull = ends[ConvexHull(np.column_stack([column[ends], row[ends]])).vertices]
    except (QhullError, ValueError) as error:
        raise SurfaceError("a triangulation needs heights in three cells that do not lie on one line") from error
    on_lattice = (row % _FIRST_CELLS == 0) & (column % _FIRST_CELLS == 0)
    width = heights.shape[1]
    return np.unique(np.concatenate([row[hull] * width + column[hull], (row * width + column)[on_lattice]]))


def _triangulated(heights: Float32Array, chosen: IntArray) -> tuple[FloatArray, IntArray]:
    """Return column, row and height (V, 3) of vertices, and the triangles (T, 3) between them that have an area,
    counter-clockwise on the map."""
    row, column = np.divmod(chosen, heights.shape[1])
    place = np.column_stack([column, row, heights.reshape(-1)[chosen]]).astype(np.float64)
    triangle = Delaunay(place[:, :2]).simplices.astype(np.int64)
    a, b, c = (place[triangle[:, i], :2] for i in range(3))
    # rows count downwards
    area2 = (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1]) - (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1])
    turned = np.where((area2 < 0)[:, None], triangle[:, [0, 2, 1]], triangle)
    return place, np.ascontiguousarray(turned[area2 != 0])


def _looked_over(
    heights: Float32Array, place: FloatArray, triangle: IntArray
) -> tuple[FloatArray, IntArray, IntArray, IntArray, IntArray, FloatArray]:
    """Return of each triangle by how much its worst cell is off, and which it is; how many of its cells have heights
    and how many none; which of those beside cells without is farthest from its corners, and the square of that
    distance in cells."""
    count = len(triangle)
    off_m, edge_cells2 = np.zeros(count), np.zeros(count)
    off, known, empty, edge = (np.zeros(count, np.int64) for _ in range(4))
    _look_over(heights, place, triangle, off_m, off, known, empty, edge, edge_cells2)
    return off_m, off, known, empty, edge, edge_cells2


def _judged(raster: Raster, heights: Float32Array, place: FloatArray, triangle: IntArray) -> ThinnedTin:
    """Return the triangulation with its errors against every cell, and the vertices that it uses."""
    tin = np.full(heights.shape, np.nan, np.float32)
    _fill(place, triangle, tin)
    both = np.isfinite(tin) & np.isfinite(heights)
    off = np.abs(tin[both].astype(np.float64) - heights[both])
    used, renumbered = np.unique(triangle, return_inverse=True)
    corner = np.array([raster.west_map_m + raster.cell_m / 2, raster.north_map_m - raster.cell_m / 2, 0.0])
    return ThinnedTin(
        corner + place[used] * [raster.cell_m, -raster.cell_m, 1.0],
        renumbered.reshape(-1, 3).astype(np.int64),
        raster.cell_m,
        int(np.count_nonzero(np.isfinite(heights))),
        int(np.count_nonzero(both)),
        float(off.max(initial=0.0)),
        float(np.sqrt(np.mean(off**2))) if len(off) else 0.0,
    )


def heights_of(tin: ThinnedTin, grid: MapGrid) -> Float32Array:
    """Return the heights (R, C) of a triangulation, whose vertices are cells of a grid, at all cells of it; NaN
    beyond."""
    column = (tin.vertex_map_m[:, 0] - grid.west_map_m) / grid.cell_m - 0.5
    row = (grid.north_map_m - tin.vertex_map_m[:, 1]) / grid.cell_m - 0.5
    out = np.full((grid.rows, grid.columns), np.nan, dtype=np.float32)
    _fill(np.column_stack([np.rint(column), np.rint(row), tin.vertex_map_m[:, 2]]), tin.triangle, out)
    return out


@njit(inline="always")
def _span(y: float, ax: float, ay: float, bx: float, by: float, low: float, high: float) -> tuple[float, float]:
    """Return an interval, widened to where a row meets the side of a triangle."""
    if (ay > y) == (by > y) and ay != y and by != y:
        return low, high
    if ay == by:
        return min(low, ax, bx), max(high, ax, bx)
    share = (y - ay) / (by - ay)
    if share < 0.0 or share > 1.0:
        return low, high
    x = ax + share * (bx - ax)
    return min(low, x), max(high, x)


@njit(inline="always")
def _row_of(y: float, a: FloatArray, b: FloatArray, c: FloatArray) -> tuple[int, int]:
    """Return the first column of a row that lies in a triangle, and the one behind the last."""
    low, high = np.inf, -np.inf
    low, high = _span(y, a[0], a[1], b[0], b[1], low, high)
    low, high = _span(y, b[0], b[1], c[0], c[1], low, high)
    low, high = _span(y, c[0], c[1], a[0], a[1], low, high)
    return int(np.ceil(low - 1e-9)), int(np.floor(high + 1e-9)) + 1


@njit(inline="always")
def _plane(a: FloatArray, b: FloatArray, c: FloatArray) -> tuple[float, float]:
    """Return by how much a triangle rises for a column and for a row."""
    ux, uy, uz, vx, vy, vz = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
    across = ux * vy - uy * vx
    return (uz * vy - uy * vz) / across, (ux * vz - uz * vx) / across


@njit(cache=True, nogil=True)
def _look_over(
    heights: Float32Array,
    place: FloatArray,
    triangle: IntArray,
    off_m: FloatArray,
    off: IntArray,
    known: IntArray,
    empty: IntArray,
    edge: IntArray,
    edge_cells2: FloatArray,
) -> None:
    rows, columns = heights.shape
    for t in range(len(triangle)):
        a, b, c = place[triangle[t, 0]], place[triangle[t, 1]], place[triangle[t, 2]]
        east, south = _plane(a, b, c)
        for row in range(int(min(a[1], b[1], c[1])), int(max(a[1], b[1], c[1])) + 1):
            first, end = _row_of(float(row), a, b, c)
            for column in range(first, end):
                z = heights[row, column]
                if np.isnan(z):
                    empty[t] += 1
                    continue
                known[t] += 1
                away = abs(a[2] + east * (column - a[0]) + south * (row - a[1]) - z)
                if away > off_m[t]:
                    off_m[t], off[t] = away, row * columns + column
                if (
                    (row > 0 and np.isnan(heights[row - 1, column]))
                    or (row + 1 < rows and np.isnan(heights[row + 1, column]))
                    or (column > 0 and np.isnan(heights[row, column - 1]))
                    or (column + 1 < columns and np.isnan(heights[row, column + 1]))
                ):
                    nearest = min(
                        (column - a[0]) ** 2 + (row - a[1]) ** 2,
                        (column - b[0]) ** 2 + (row - b[1]) ** 2,
                        (column - c[0]) ** 2 + (row - c[1]) ** 2,
                    )
                    if nearest > edge_cells2[t]:
                        edge_cells2[t], edge[t] = nearest, row * columns + column


@njit(cache=True, nogil=True)
def _fill(place: FloatArray, triangle: IntArray, out: Float32Array) -> None:
    for t in range(len(triangle)):
        a, b, c = place[triangle[t, 0]], place[triangle[t, 1]], place[triangle[t, 2]]
        east, south = _plane(a, b, c)
        for row in range(int(min(a[1], b[1], c[1])), int(max(a[1], b[1], c[1])) + 1):
            first, end = _row_of(float(row), a, b, c)
            for column in range(first, end):
                out[row, column] = a[2] + east * (column - a[0]) + south * (row - a[1])
