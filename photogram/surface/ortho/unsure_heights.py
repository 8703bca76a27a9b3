"""How far a surface may be off where it was not measured: anywhere between the lowest and the highest height around.

Beside a wall what is not measured lies on the roof or on the ground, and nothing says on which. A height of which no
more is known than that it lies in a range has a standard deviation of the range over √12 (JCGM 100:2008, 4.3.7).
"""

from collections.abc import Callable

import cv2
import numpy as np

from photogram.arrays import Float32Array
from photogram.grid import MapGrid, Window
from photogram.surface.ortho.cell_choice import EDGE_CELLS, height_steps

BLOCK_CELLS = 4
"""Side of the blocks of which the lowest and the highest measured height are known."""

AROUND_BLOCKS = 3
"""Blocks to each side of one whose heights belong to its range: a window of the matching at twice the cell."""

UNIFORM = float(np.sqrt(12.0))
"""Range over standard deviation of what lies anywhere in it with the same probability."""

_TILE_CELLS = 1024


def height_ranges_m(grid: MapGrid, heights_of: Callable[[Window], Float32Array]) -> Float32Array:
    """Return of blocks (R, C) of BLOCK_CELLS cells of a surface how far the measured heights around differ; where there
    are none those that are nearest, in blocks of twice, four times … the side. NaN where nothing is measured at all."""
    blocks = grid.coarser(BLOCK_CELLS)
    low, high = (np.full((blocks.rows, blocks.columns), np.nan, np.float32) for _ in range(2))
    for window in grid.tiles(_TILE_CELLS):
        heights, part = heights_of(window), window.coarser(BLOCK_CELLS).slices
        low[part], high[part] = _reduced(heights, np.fmin), _reduced(heights, np.fmax)
    if not np.isfinite(low).any():
        return low
    low, high = _closed(low, np.fmin), _closed(high, np.fmax)
    side = np.ones((2 * AROUND_BLOCKS + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(high, side) - cv2.erode(low, side), np.float32)


def edge_sigma_m(height: Float32Array, cell_m: float) -> Float32Array:
    """Return what the place of a height edge adds to the standard deviations (rows, columns) of measured heights within
    EDGE_REACH cells of it: there it may be a cell or two aside."""
    step = height_steps(height)
    return np.where(step > EDGE_CELLS * cell_m, step / np.float32(UNIFORM), np.float32(0.0)).astype(np.float32)


def _reduced(values: Float32Array, rule: np.ufunc, cells: int = BLOCK_CELLS) -> Float32Array:
    for axis in (0, 1):
        values = rule.reduceat(values, np.arange(0, values.shape[axis], cells), axis=axis)
    return values


def _closed(values: Float32Array, rule: np.ufunc) -> Float32Array:
    """Return values (R, C) with what is NaN taken from blocks of twice the side, and these from theirs."""
    unknown = np.isnan(values)
    if not unknown.any() or unknown.all() or max(values.shape) == 1:
        return values
    coarser = _closed(_reduced(values, rule, 2), rule)
    rows, columns = values.shape
    parent = coarser.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns]
    return np.where(unknown, parent, values).astype(np.float32)
