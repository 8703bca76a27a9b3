"""The grid of a raster, and the vertical lines over its cells in the world frame.

Everything that is computed for a cell depends on the cell's place alone, never on the window in which it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, Float32Array, FloatArray, IntArray
from photogram.geodesy.frames import LocalFrame
from photogram.survey import Raster

LATTICE_CELLS = 32
"""Spacing of the nodes at which places are projected exactly; between them a map is flat to 1e-4 of a cell."""

_LIFT_M = 100.0


@dataclass(frozen=True)
class Window:
    """Cells ``row`` to ``row_end`` and ``column`` to ``column_end``, the ends not included."""

    row: int
    column: int
    row_end: int
    column_end: int

    @property
    def shape(self) -> tuple[int, int]:
        """Return the numbers of rows and columns."""
        return self.row_end - self.row, self.column_end - self.column

    @property
    def slices(self) -> tuple[slice, slice]:
        """Return the slices of an array over the whole grid."""
        return slice(self.row, self.row_end), slice(self.column, self.column_end)

    def within(self, outer: Window) -> tuple[slice, slice]:
        """Return the slices of an array over a window that holds this one."""
        rows, columns = self.shape
        row, column = self.row - outer.row, self.column - outer.column
        return slice(row, row + rows), slice(column, column + columns)

    def around(self, margin: int) -> Window:
        """Return the window with ``margin`` cells more on each side, whatever grid it is of."""
        return Window(self.row - margin, self.column - margin, self.row_end + margin, self.column_end + margin)

    def common(self, other: Window) -> Window | None:
        """Return the cells that lie in both windows, None where none do."""
        row, column = max(self.row, other.row), max(self.column, other.column)
        row_end, column_end = min(self.row_end, other.row_end), min(self.column_end, other.column_end)
        return Window(row, column, row_end, column_end) if row < row_end and column < column_end else None

    def tiles(self, side: int) -> Iterator[Window]:
        """Yield windows of ``side`` × ``side`` cells of this one, smaller at the south and east, row by row."""
        for row in range(self.row, self.row_end, side):
            for column in range(self.column, self.column_end, side):
                yield Window(row, column, min(row + side, self.row_end), min(column + side, self.column_end))

    def coarser(self, cells: int) -> Window:
        """Return the window of a grid whose cells are so many times as large, around this one."""
        return Window(self.row // cells, self.column // cells, -(-self.row_end // cells), -(-self.column_end // cells))


@dataclass(frozen=True)
class MapGrid:
    """A grid of square cells in the map."""

    west_map_m: float
    """Easting of the outer corner of cell (0, 0)."""
    north_map_m: float
    """Northing of the outer corner of cell (0, 0)."""
    cell_m: float
    """Side of a cell."""
    rows: int
    """Number of rows, going south."""
    columns: int
    """Number of columns, going east."""

    @staticmethod
    def of(raster: Raster) -> MapGrid:
        """Return the grid of a raster."""
        rows, columns = raster.values.shape
        return MapGrid(raster.west_map_m, raster.north_map_m, raster.cell_m, rows, columns)

    @staticmethod
    def around(points_map_m: FloatArray, cell_m: float) -> MapGrid:
        """Return the smallest grid around points (N, 2 or 3) whose corner is a multiple of the cell."""
        low = np.floor(points_map_m[:, :2].min(axis=0) / cell_m)
        high = np.ceil(points_map_m[:, :2].max(axis=0) / cell_m)
        columns, rows = np.maximum(high - low, 1).astype(int)
        return MapGrid(float(low[0] * cell_m), float(high[1] * cell_m), cell_m, int(rows), int(columns))

    @property
    def whole(self) -> Window:
        """Return the window of all cells."""
        return Window(0, 0, self.rows, self.columns)

    @property
    def extent_map_m(self) -> tuple[float, float, float, float]:
        """Return its outer edges: west, east, south, north."""
        east, south = self.west_map_m + self.columns * self.cell_m, self.north_map_m - self.rows * self.cell_m
        return self.west_map_m, east, south, self.north_map_m

    def raster(self, values: Float32Array) -> Raster:
        """Return values (rows, columns) as a raster."""
        return Raster(values, self.west_map_m, self.north_map_m, self.cell_m)

    def coarser(self, cells: int) -> MapGrid:
        """Return the grid with the same corner whose cells are so many times as large."""
        rows, columns = -(-self.rows // cells), -(-self.columns // cells)
        return MapGrid(self.west_map_m, self.north_map_m, self.cell_m * cells, rows, columns)

    def around_window(self, window: Window, margin: int) -> Window:
        """Return the window with ``margin`` cells on each side, as far as the grid goes."""
        return Window(
            max(window.row - margin, 0),
            max(window.column - margin, 0),
            min(window.row_end + margin, self.rows),
            min(window.column_end + margin, self.columns),
        )

    def common(self, window: Window) -> Window | None:
        """Return the part of a window that lies on the grid, None where none does."""
        return self.whole.common(window)

    def tiles(self, side: int) -> Iterator[Window]:
        """Yield windows of ``side`` × ``side`` cells, smaller at the south and east, row by row."""
        return self.whole.tiles(side)

    def centres_map_m(self, window: Window) -> tuple[FloatArray, FloatArray]:
        """Return eastings (columns,) and northings (rows,) of the centres of a window's cells."""
        column = np.arange(window.column, window.column_end, dtype=np.float64) + 0.5
        row = np.arange(window.row, window.row_end, dtype=np.float64) + 0.5
        return self.west_map_m + column * self.cell_m, self.north_map_m - row * self.cell_m

    def cells_at(self, places_map_m: FloatArray) -> tuple[IntArray, IntArray]:
        """Return row and column (N,) of the cells that places (N, 2 or 3) lie in, −1 both beside the grid."""
        row = np.floor((self.north_map_m - places_map_m[:, 1]) / self.cell_m)
        column = np.floor((places_map_m[:, 0] - self.west_map_m) / self.cell_m)
        on = (row >= 0) & (row < self.rows) & (column >= 0) & (column < self.columns)  # not so where NaN
        return np.where(on, row, -1).astype(np.int64), np.where(on, column, -1).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Verticals:
    """Plumb lines over cell centres: height h of the map is at ``foot_world_m`` + (h − ``base_map_m``) ``up``."""

    base_map_m: float
    """Height of the base points in the map."""
    foot_world_m: FloatArray
    """Base points (rows, columns, 3)."""
    up: FloatArray
    """Step in the world (rows, columns, 3) for a metre of height."""


def vertical_nodes(frame: LocalFrame, grid: MapGrid, window: Window) -> FloatArray:
    """Return base points and steps up (R, C, 6) of the vertical lines at every LATTICE_CELLS-th corner of cells, from
    the last one before a window of a grid to the first one behind it. Raises FrameError where the map has no such
    place."""
    around = window.coarser(LATTICE_CELLS)
    rows = np.arange(around.row, around.row_end + 1) * LATTICE_CELLS
    columns = np.arange(around.column, around.column_end + 1) * LATTICE_CELLS
    east, north = grid.west_map_m + columns * grid.cell_m, grid.north_map_m - rows * grid.cell_m
    base = np.full(rows.size * columns.size, frame.origin_map_m[2])
    place = np.column_stack([np.tile(east, len(rows)), np.repeat(north, len(columns)), base])
    foot = frame.world_from_map(place)
    up = (frame.world_from_map(place + np.array([0.0, 0.0, _LIFT_M])) - foot) / _LIFT_M
    return np.concatenate([foot, up], axis=1).reshape(len(rows), len(columns), 6)


def verticals(frame: LocalFrame, grid: MapGrid, window: Window) -> Verticals:
    """Return the vertical lines over a window of a grid.

    They are projected exactly at every LATTICE_CELLS-th cell, and interpolated linearly between: a vertical is a
    straight line in the world frame, and over so few cells a map does not curve. Raises
    FrameError where the map has no such place.
    """
    nodes = vertical_nodes(frame, grid, window)
    dense = _between(_between(nodes, window.row, window.row_end).swapaxes(0, 1), window.column, window.column_end)
    dense = np.ascontiguousarray(dense.swapaxes(0, 1))
    base = float(frame.origin_map_m[2])
    return Verticals(base, np.ascontiguousarray(dense[..., :3]), np.ascontiguousarray(dense[..., 3:]))


def _between(nodes: FloatArray, first: int, last: int) -> FloatArray:
    """Return values at the centres of cells from ``first`` to ``last`` along the first axis of nodes."""
    place = (np.arange(first, last) + 0.5) / LATTICE_CELLS - first // LATTICE_CELLS
    below = np.floor(place).astype(int)
    weight = (place - below)[:, None, None]
    return np.asarray((1.0 - weight) * nodes[below] + weight * nodes[below + 1])


def cell_steps(frame: LocalFrame, grid: MapGrid) -> tuple[FloatArray, FloatArray]:
    """Return the steps (3,) in the world from a cell to the next to the east and to the south, in the grid's middle."""
    east, north = grid.west_map_m + grid.columns * grid.cell_m / 2, grid.north_map_m - grid.rows * grid.cell_m / 2
    height = frame.origin_map_m[2]
    places = [[east, north], [east + _LIFT_M, north], [east, north - _LIFT_M]]
    world = frame.world_from_map(np.column_stack([np.array(places), np.full(3, height)]))
    scale = grid.cell_m / _LIFT_M
    return np.asarray((world[1] - world[0]) * scale), np.asarray((world[2] - world[0]) * scale)


BAND_CELLS = 2_000_000
"""About as many cells are worked on at once."""


def block_of(shape: tuple[int, ...], maximum: int) -> int:
    """Return how many cells a block has along each side, so that no side of a raster has more than ``maximum``."""
    return max(1, -(-max(shape) // maximum))


def bands(shape: tuple[int, ...], rows_at_once: int = 1) -> Iterator[slice]:
    """Yield slices of rows, each a multiple of ``rows_at_once`` but the last, of about BAND_CELLS cells."""
    rows, columns = shape
    step = max(1, BAND_CELLS // (columns * rows_at_once)) * rows_at_once
    for first in range(0, rows, step):
        yield slice(first, min(first + step, rows))


def block_means(
    values: NDArray[np.generic], block: int, keep: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the means (R, C) of ``block`` × ``block`` cells from the north-west corner, and which share (R, C) of each
    block's cells they are the mean of.

    Cells that are not finite, or not in ``keep``, do not count; a block without any is NaN. Blocks at the south and
    east are as large as there are cells.
    """
    rows, columns = values.shape
    shape = -(-rows // block), -(-columns // block)
    total, count = np.zeros(shape), np.zeros(shape)
    edges = np.arange(0, columns, block)
    for band in bands(values.shape, block):
        part = values[band].astype(np.float64)
        known = np.isfinite(part) if keep is None else np.isfinite(part) & keep[band]
        target = slice(band.start // block, -(-band.stop // block))
        for sums, cells in ((total, np.where(known, part, 0.0)), (count, known.astype(np.float64))):
            across = np.add.reduceat(cells, edges, axis=1)
            sums[target] = np.add.reduceat(across, np.arange(0, len(across), block), axis=0)
    heights, widths = (np.diff([*range(0, n, block), n]) for n in (rows, columns))
    size = heights[:, None] * widths
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan), count / size


def decimated(raster: Raster, maximum: int, keep: BoolArray | None = None) -> tuple[Raster, FloatArray]:
    """Return a raster of at most ``maximum`` cells along each side, means of blocks of a whole number of cells, and the
    share of each block that is known and in ``keep``.

    The corner stays where it was; blocks at the south and east may reach beyond the raster.
    """
    block = block_of(raster.values.shape, maximum)
    means, share = block_means(raster.values, block, keep)
    small = Raster(means.astype(np.float32), raster.west_map_m, raster.north_map_m, block * raster.cell_m)
    return small, share


def known_cells_map_m(raster: Raster) -> FloatArray:
    """Return easting, northing and value (N, 3) of the cells of a raster with data, at their centres, row by row."""
    row, column = np.nonzero(np.isfinite(raster.values))
    east, north = MapGrid.of(raster).centres_map_m(MapGrid.of(raster).whole)
    return np.column_stack([east[column], north[row], raster.values[row, column].astype(np.float64)])
