"""Arrays over a map grid kept on disk in blocks: one file per block, written whole, any window read back."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import Float32Array
from photogram.files.atomic import make_folder
from photogram.files.npz_json import read_arrays, write_arrays
from photogram.grid import MapGrid, Window


def _as_it_is(path: Path) -> Path:
    return path


@dataclass(frozen=True)
class BlockFiles:
    """The blocks of ``side`` × ``side`` cells of a grid, in a folder; ``checked`` looks at the file of a block before
    it is read, and returns its path."""

    folder: Path
    grid: MapGrid
    side: int
    checked: Callable[[Path], Path] = _as_it_is

    @property
    def windows(self) -> tuple[Window, ...]:
        """Return the windows of all blocks, row by row."""
        return tuple(self.grid.tiles(self.side))

    def _path(self, block: Window) -> Path:
        return self.folder / f"{block.row:07d}-{block.column:07d}.npz"

    def has(self, block: Window) -> bool:
        """Return whether a block has been written."""
        return self._path(block).is_file()

    def write(self, block: Window, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Write the arrays (rows, columns) of a block."""
        make_folder(self.folder)
        write_arrays(self._path(block), arrays)

    def read(self, window: Window, *names: str) -> tuple[NDArray[Any], ...]:
        """Return arrays over a window. Raises WorkspaceError when one of its blocks is missing or damaged."""
        whole: dict[str, NDArray[Any]] = {}
        first_row, first_column = window.row // self.side * self.side, window.column // self.side * self.side
        for row in range(first_row, window.row_end, self.side):
            for column in range(first_column, window.column_end, self.side):
                block = Window(
                    row, column, min(row + self.side, self.grid.rows), min(column + self.side, self.grid.columns)
                )
                arrays = read_arrays(self.checked(self._path(block)), *names)
                inner = Window(
                    max(row, window.row),
                    max(column, window.column),
                    min(block.row_end, window.row_end),
                    min(block.column_end, window.column_end),
                )
                for name in names:
                    part = arrays[name]
                    target = whole.setdefault(name, np.empty(window.shape, part.dtype))
                    target[inner.within(window)] = part[inner.within(block)]
        return tuple(whole[name] for name in names)


@dataclass(frozen=True)
class GridFile:
    """An array of float32 over a map grid in one file of its own, of which windows are written and read; nothing of it
    is held in between. Cells that were never written are 0."""

    path: Path
    grid: MapGrid

    def _mapped(self, mode: Literal["r", "r+", "w+"]) -> np.memmap[Any, np.dtype[np.float32]]:
        return np.memmap(self.path, np.float32, mode, shape=(self.grid.rows, self.grid.columns))

    def make(self) -> None:
        """Make the file, all cells 0."""
        make_folder(self.path.parent)
        self._mapped("w+").flush()

    def write(self, window: Window, values: Float32Array) -> None:
        """Write values (rows, columns) of a window; several threads may write windows apart from each other."""
        self._mapped("r+")[window.slices] = values

    def flush(self) -> None:
        """Bring what was written to the disk, where processes on other machines find it."""
        self._mapped("r+").flush()

    def read(self, window: Window) -> Float32Array:
        """Return the values (rows, columns) of a window."""
        return np.array(self._mapped("r")[window.slices])
