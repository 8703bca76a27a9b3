"""Polygons over the cells of a grid: how much of each cell they cover, and what their outline adds to an integral."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.grid import MapGrid, Window

BLOCK_CELLS = 32
"""Side of the blocks that are first looked at as a whole."""

Geometry = Any  # of shapely, which has no types


def window_of(polygon: Geometry, grid: MapGrid) -> Window | None:
    """Return the window of a grid that a polygon reaches into, None where it lies beyond."""
    west, south, east, north = polygon.bounds
    return grid.common(
        Window(
            int(np.floor((grid.north_map_m - north) / grid.cell_m)),
            int(np.floor((west - grid.west_map_m) / grid.cell_m)),
            int(np.ceil((grid.north_map_m - south) / grid.cell_m)),
            int(np.ceil((east - grid.west_map_m) / grid.cell_m)),
        )
    )


def window_of_all(polygons: Sequence[Geometry], grid: MapGrid) -> Window:
    """Return the window of a grid that polygons together reach into, all of it where they lie beyond."""
    windows = [window for polygon in polygons if (window := window_of(polygon, grid)) is not None] or [grid.whole]
    return Window(
        min(w.row for w in windows), min(w.column for w in windows),
        max(w.row_end for w in windows), max(w.column_end for w in windows),
    )  # fmt: skip


def box_of(grid: MapGrid) -> Geometry:
    """Return a polygon that every cell of a grid lies in, a cell wider on each side."""
    west, east, south, north = grid.extent_map_m
    return shapely.box(west - grid.cell_m, south - grid.cell_m, east + grid.cell_m, north + grid.cell_m)


def _boxes(grid: MapGrid, row: IntArray, column: IntArray, row_end: IntArray, column_end: IntArray) -> Any:  # noqa: ANN401
    west, east = grid.west_map_m + column * grid.cell_m, grid.west_map_m + column_end * grid.cell_m
    north, south = grid.north_map_m - row * grid.cell_m, grid.north_map_m - row_end * grid.cell_m
    return shapely.box(west, south, east, north)


def coverage(polygon: Geometry, grid: MapGrid, window: Window) -> FloatArray:
    """Return the share (rows, columns) of each cell of a window, 0 to 1, that lies within a polygon: exact."""
    out = np.zeros(window.shape)
    shapely.prepare(polygon)
    starts = [
        np.arange(*span, BLOCK_CELLS) for span in ((window.row, window.row_end), (window.column, window.column_end))
    ]
    row, column = (a.ravel() for a in np.meshgrid(*starts, indexing="ij"))
    row_end = np.minimum(row + BLOCK_CELLS, window.row_end)
    column_end = np.minimum(column + BLOCK_CELLS, window.column_end)
    block = _boxes(grid, row, column, row_end, column_end)
    whole, touched = shapely.contains_properly(polygon, block), shapely.intersects(polygon, block)
    for n in np.flatnonzero(touched):
        inner = Window(int(row[n]), int(column[n]), int(row_end[n]), int(column_end[n]))
        out[inner.within(window)] = 1.0 if whole[n] else _shares(polygon, grid, inner)
    return out


def _shares(polygon: Geometry, grid: MapGrid, window: Window) -> FloatArray:
    rows, columns = np.arange(window.row, window.row_end), np.arange(window.column, window.column_end)
    row, column = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    cell = _boxes(grid, row, column, row + 1, column + 1)
    share = shapely.contains_properly(polygon, cell).astype(np.float64)
    cut = np.flatnonzero((share == 0.0) & shapely.intersects(polygon, cell))
    share[cut] = shapely.area(shapely.intersection(cell[cut], polygon)) / grid.cell_m**2
    return np.asarray(share.reshape(window.shape))


@dataclass(frozen=True, eq=False)
class OutlineSamples:
    """Short pieces (S,) of the outline of a polygon, to integrate along it.

    ``place_map_m`` (S, 2) their middles; ``step_m`` (S, 2) their length times the normal that points out; ``corner``
    (S, 2) the corners of the outline at the ends of the side they belong to, counted over all rings; ``share`` (S,) how
    far along that side they are, 0 to 1; ``corners`` how many there are.
    """

    place_map_m: FloatArray
    step_m: FloatArray
    corner: IntArray
    share: FloatArray
    corners: int

    def slopes(self, values: FloatArray, chosen: BoolArray | IntArray) -> FloatArray:
        """Return what an integral over the polygon gains (corners, 2) when a corner moves by 1 m east and north, from
        the integrand (C,) at the ``chosen`` pieces: ∮ f φ n ds with the hat function φ of the corner."""
        out = np.zeros((self.corners, 2))
        share, step = self.share[chosen], self.step_m[chosen] * values[:, None]
        for end, weight in ((0, 1.0 - share), (1, share)):
            np.add.at(out, self.corner[chosen, end], step * weight[:, None])
        return out


def outline_samples(polygon: Geometry, step_m: float) -> OutlineSamples:
    """Return the outline of a polygon in pieces of at most ``step_m``."""
    place = []
    normal = []
    corner = []
    share = []
    first = 0
    for ring in _rings(polygon):
        count = len(ring) - 1
        side = np.diff(ring, axis=0)
        pieces = np.maximum(np.ceil(np.linalg.norm(side, axis=1) / step_m), 1).astype(np.int64)
        of = np.repeat(np.arange(count), pieces)
        number = np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        along = (number + 0.5) / pieces[of]
        place.append(ring[of] + along[:, None] * side[of])
        normal.append(np.column_stack([side[of, 1], -side[of, 0]]) / pieces[of, None])
        corner.append(first + np.column_stack([of, (of + 1) % count]))
        share.append(along)
        first += count
    joined = [np.concatenate(a) for a in (place, normal, share)]
    return OutlineSamples(joined[0], joined[1], np.concatenate(corner), joined[2], first)


def _rings(polygon: Geometry) -> Iterator[FloatArray]:
    """Yield the rings (K, 2) of a polygon, the polygon on the left of each."""
    for part in shapely.get_parts(polygon):
        oriented = shapely.geometry.polygon.orient(part)
        for ring in (oriented.exterior, *oriented.interiors):
            yield shapely.get_coordinates(ring)
