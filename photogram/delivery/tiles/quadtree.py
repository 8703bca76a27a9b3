"""Which cells of a raster the tiles of a quadtree have: every tile as many, each level twice as far apart as the one
below it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, log2

import numpy as np

from photogram.arrays import Float32Array
from photogram.files.maps.rasters import RasterFile
from photogram.grid import MapGrid, Window

SIDE = 256
"""Steps from a cell to the next along a side of a tile; tiles share the cells of their borders."""

_STRIP_CELLS = 2_000_000


@dataclass(frozen=True)
class Tile:
    """A tile, by its level, 0 the coarsest, and its place from the north-west corner."""

    level: int
    column: int
    row: int

    @property
    def name(self) -> str:
        """Return the name of its file."""
        return f"{self.level}_{self.column}_{self.row}.glb"


@dataclass(frozen=True)
class Quadtree:
    """Tiles over a raster, of which every ``every``-th cell is a cell of the finest level."""

    grid: MapGrid
    every: int
    side: int

    @property
    def depth(self) -> int:
        """Return the number of the finest level."""
        return max(0, ceil(log2(max(self.grid.rows - 1, self.grid.columns - 1, 1) / (self.side * self.every))))

    def stride(self, level: int) -> int:
        """Return the cells of the raster from one cell of a level to the next."""
        return self.every << (self.depth - level)

    def corner(self, tile: Tile) -> tuple[int, int]:
        """Return row and column in the raster of the north-western cell of a tile."""
        step = self.side * self.stride(tile.level)
        return tile.row * step, tile.column * step

    def cells_of(self, tile: Tile) -> MapGrid:
        """Return the grid whose cells have those of a tile in their middle; beyond the raster it may go on."""
        cell_m, (row, column) = self.stride(tile.level) * self.grid.cell_m, self.corner(tile)
        west = self.grid.west_map_m + (column + 0.5) * self.grid.cell_m - cell_m / 2
        north = self.grid.north_map_m - (row + 0.5) * self.grid.cell_m + cell_m / 2
        return MapGrid(west, north, cell_m, self.side + 1, self.side + 1)

    def holds(self, tile: Tile) -> bool:
        """Return whether a tile reaches over more than the rim of the raster."""
        row, column = self.corner(tile)
        inner = row < self.grid.rows - 1 and column < self.grid.columns - 1
        return inner and row >= 0 and column >= 0

    def children(self, tile: Tile) -> Iterator[Tile]:
        """Yield the tiles of the next finer level in a tile."""
        if tile.level == self.depth:
            return
        for down in (0, 1):
            for right in (0, 1):
                child = Tile(tile.level + 1, 2 * tile.column + right, 2 * tile.row + down)
                if self.holds(child):
                    yield child


def sampled(file: RasterFile, corner: tuple[int, int], stride: int, count: tuple[int, int]) -> Float32Array:
    """Return the heights (rows, columns) of every ``stride``-th cell from a row and column on, NaN beyond the raster;
    read strip by strip. Raises ProjectError where the file is damaged."""
    (row, column), (rows, columns) = corner, count
    values = np.empty(count, dtype=np.float32)
    at_once = max(1, _STRIP_CELLS // (stride * stride * columns))
    for first in range(0, rows, at_once):
        last = min(first + at_once, rows) - 1
        cells = Window(row + first * stride, column, row + last * stride + 1, column + (columns - 1) * stride + 1)
        values[first : last + 1] = file.read(cells)[::stride, ::stride]
    return values
