"""Signed distances of points to a mesh: the triangles of a reference in plan, above it positive.

The mesh has one height at each place, so above and below are those of the plumb line. The nearest point may lie on
another triangle than the one beneath: triangles are looked up in rings of square cells around the point, until the next
ring is further away in plan than the nearest triangle in space.
"""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.grid import known_cells_map_m
from photogram.quality.cloud_comparison import TriangulatedCloud, triangulate
from photogram.survey import PointCloud, Raster


@dataclass(frozen=True, eq=False)
class _Cells:
    """Triangles (T, 3, 3) by the cells of a grid that their bounding boxes reach into: those of cell k are
    ``triangle[first[k]:first[k + 1]]``."""

    corners_m: FloatArray
    low_m: FloatArray
    cell_m: float
    shape: tuple[int, int]
    first: IntArray
    triangle: IntArray


def mesh_of(reference: Raster | PointCloud) -> TriangulatedCloud:
    """Return the mesh of a reference: of a surface through its cell centres, of a cloud through its points, without the
    triangles that bridge gaps. Raises SurfaceError for fewer than three points, or points on one line."""
    if isinstance(reference, PointCloud):
        return triangulate(reference)
    return triangulate(PointCloud(known_cells_map_m(reference)), 1.5 * reference.cell_m)


def mesh_distances(points_map_m: FloatArray, mesh: TriangulatedCloud) -> FloatArray:
    """Return the distance (N,) in m of points (N, 3) to a mesh, positive above it; NaN beside it and over its gaps."""
    height = points_map_m[:, 2] - mesh.heights(points_map_m)
    over = np.flatnonzero(np.isfinite(height))
    out = np.full(len(points_map_m), np.nan)
    if len(over):
        points = np.ascontiguousarray(points_map_m[over] - mesh.origin_map_m)
        cells = _cells(mesh)
        nearest = np.empty(len(over))
        _nearest(
            points, np.abs(height[over]), cells.corners_m, cells.low_m, cells.cell_m, np.array(cells.shape),
            cells.first, cells.triangle, nearest,
        )  # fmt: skip
        out[over] = np.copysign(nearest, height[over])
    return out


def _cells(mesh: TriangulatedCloud) -> _Cells:
    vertex = mesh.points.position_map_m - mesh.origin_map_m
    corners = np.ascontiguousarray(vertex[mesh.triangulation.simplices[~mesh.bridging]])
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    corner, end = low.min(axis=0), high.max(axis=0)
    cell_m = float(max(2.0 * np.median(high - low), 1e-3, np.max(end - corner) / 4000))
    shape = tuple(int(n) for n in np.floor((end - corner) / cell_m) + 1)
    first, last = (np.floor((place - corner) / cell_m).astype(np.int64) for place in (low, high))
    count = np.prod(last - first + 1, axis=1)
    triangle = np.repeat(np.arange(len(corners)), count)
    number = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    across = (last - first + 1)[triangle, 0]
    column, row = first[triangle, 0] + number % across, first[triangle, 1] + number // across
    cell = row * shape[0] + column
    order = np.argsort(cell, kind="stable")
    starts = np.zeros(shape[0] * shape[1] + 1, np.int64)
    np.cumsum(np.bincount(cell, minlength=shape[0] * shape[1]), out=starts[1:])
    return _Cells(corners, corner, cell_m, (shape[0], shape[1]), starts, triangle[order])


@njit(cache=True, nogil=True)
def _square_distance(p: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Return the square of the distance of a point (3,) to a triangle (Ericson 2005, Real-Time Collision Detection,
    5.1.5)."""
    ab, ac, ap = b - a, c - a, p - a
    d1, d2 = np.dot(ab, ap), np.dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return float(np.dot(ap, ap))
    bp = p - b
    d3, d4 = np.dot(ab, bp), np.dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return float(np.dot(bp, bp))
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        off = ap - (d1 / (d1 - d3)) * ab
        return float(np.dot(off, off))
    cp = p - c
    d5, d6 = np.dot(ab, cp), np.dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return float(np.dot(cp, cp))
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        off = ap - (d2 / (d2 - d6)) * ac
        return float(np.dot(off, off))
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        off = bp - ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b)
        return float(np.dot(off, off))
    whole = va + vb + vc
    off = ap - (vb / whole) * ab - (vc / whole) * ac
    return float(np.dot(off, off))


@njit(cache=True, nogil=True)
def _nearest(
    points: FloatArray,
    at_most: FloatArray,
    corners: FloatArray,
    low: FloatArray,
    cell: float,
    shape: IntArray,
    first: IntArray,
    triangle: IntArray,
    out: FloatArray,
) -> None:
    columns, rows = shape[0], shape[1]
    for n in range(len(points)):
        p = points[n]
        best = at_most[n] * at_most[n]
        column, row = int((p[0] - low[0]) // cell), int((p[1] - low[1]) // cell)
        for ring in range(max(columns, rows) + 1):
            if ring > 1 and ((ring - 1) * cell) ** 2 >= best:
                break
            for r in range(row - ring, row + ring + 1):
                if r < 0 or r >= rows:
                    continue
                step = 1 if abs(r - row) == ring else max(2 * ring, 1)
                for k in range(column - ring, column + ring + 1, step):
                    if k < 0 or k >= columns:
                        continue
                    for i in range(first[r * columns + k], first[r * columns + k + 1]):
                        corner = corners[triangle[i]]
                        best = min(best, _square_distance(p, corner[0], corner[1], corner[2]))
        out[n] = np.sqrt(best)
