"""The mesh of a tile: a triangulation of its cells, skirts at its borders, and how far it lies from finer heights.

All cells at the borders of a tile are vertices, so that neighbours of the same level meet. Between levels skirts hang
down to the lowest cell of the border within a step of the coarsest level: the edge of a mesh of any level lies between
heights of such cells, so no gap is seen below it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.delivery.thinned_tin import ThinnedTin, heights_of, thinned_tin
from photogram.delivery.tiles.quadtree import Quadtree, Tile, sampled
from photogram.errors import SurfaceError
from photogram.files.maps.rasters import RasterFile
from photogram.grid import MapGrid
from photogram.survey import Raster

MOST_VERTICES = 20_000
"""Of a tile."""

_BELOW_M = 0.01


@dataclass(frozen=True, eq=False)
class TileMesh:
    """Triangles of a tile, and its skirts."""

    tin: ThinnedTin
    skirt_top: IntArray
    """Vertices (K,) of the triangulation that skirts hang from, one for each edge it is an end of."""
    skirt_bottom_m: FloatArray
    """Heights (K,) down to which they hang; two by two they are an edge."""
    off_95_m: float
    """95 of 100 of the finer level's cells, or of the finest level its own, lie less from the mesh, vertically."""
    greatest_m: float
    """The greatest of these distances."""


def tile_mesh(file: RasterFile, tree: Quadtree, tile: Tile, seen: BoolArray | None, error_m: float) -> TileMesh | None:
    """Return the mesh of a tile within ``error_m`` of its own cells, unless that takes more than MOST_VERTICES; None
    where fewer than three of its cells have a height. Cells (SIDE + 1, SIDE + 1) that are not ``seen`` have none.
    Raises ProjectError where the file is damaged."""
    finest = tile.level == tree.depth
    finer, count = (1, tree.side + 1) if finest else (2, 2 * tree.side + 1)
    stride = tree.stride(tile.level) // finer
    heights, cells = sampled(file, tree.corner(tile), stride, (count, count)), tree.cells_of(tile)
    own = np.ascontiguousarray(heights[::finer, ::finer])
    if seen is not None:
        own[~seen] = np.nan
    fixed = np.zeros(own.shape, dtype=bool)
    fixed[[0, -1]] = fixed[:, [0, -1]] = True
    try:
        tin = thinned_tin(cells.raster(own), error_m, MOST_VERTICES, fixed)
    except SurfaceError:
        return None
    if not len(tin.triangle):
        return None
    centre_m = (finer - 1) * cells.cell_m / (2 * finer)
    fine = MapGrid(cells.west_map_m + centre_m, cells.north_map_m - centre_m, cells.cell_m / finer, count, count)
    off = np.abs(heights_of(tin, fine).astype(np.float64) - heights)
    off = off[np.isfinite(off)]
    top, bottom_m = _skirts(file, tree, tile, tin, cells.raster(own))
    return TileMesh(tin, top, bottom_m, float(np.percentile(off, 95)), float(off.max()))


def _skirts(
    file: RasterFile, tree: Quadtree, tile: Tile, tin: ThinnedTin, raster: Raster
) -> tuple[IntArray, FloatArray]:
    """Return which vertices (K,) skirts hang from, edge by edge, and down to what heights (K,)."""
    column = np.rint((tin.vertex_map_m[:, 0] - raster.west_map_m) / raster.cell_m - 0.5).astype(np.int64)
    row = np.rint((raster.north_map_m - tin.vertex_map_m[:, 1]) / raster.cell_m - 0.5).astype(np.int64)
    edges = np.sort(np.vstack([tin.triangle[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]), axis=1)
    edges, times = np.unique(edges, axis=0, return_counts=True)
    outer = edges[times == 1]
    top, bottom_m = [np.empty(0, np.int64)], [np.empty(0)]
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        if not tree.holds(Tile(tile.level, tile.column + right, tile.row + down)):
            continue
        across, along = (row, column) if down else (column, row)
        line = tree.side if max(down, right) > 0 else 0
        ends = outer[(across[outer] == line).all(axis=1)].reshape(-1)
        top.append(ends)
        bottom_m.append(_lowest_m(file, tree, tile, line, along_row=bool(down))[along[ends]] - _BELOW_M)
    return np.concatenate(top), np.concatenate(bottom_m)


def _lowest_m(file: RasterFile, tree: Quadtree, tile: Tile, line: int, *, along_row: bool) -> FloatArray:
    """Return, for each cell of a tile (SIDE + 1,) on a line of its border, the lowest height of the raster on that line
    within a step of the coarsest level."""
    stride, around = tree.stride(tile.level), tree.stride(0) // tree.every
    row, column = tree.corner(tile)
    step, count = stride // tree.every, tree.side * stride // tree.every + 1 + 2 * around
    if along_row:
        values = sampled(file, (row + line * stride, column - around * tree.every), tree.every, (1, count))
    else:
        values = sampled(file, (row - around * tree.every, column + line * stride), tree.every, (count, 1))
    heights = np.nan_to_num(values.reshape(-1).astype(np.float64), nan=np.inf)
    return np.asarray(minimum_filter1d(heights, 2 * around + 1, mode="nearest")[around : count - around : step])
