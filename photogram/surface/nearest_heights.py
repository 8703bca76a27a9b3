"""The heights around cells: those met first in each of eight directions, and those of a block."""

import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray
from photogram.compilation import njit

DIRECTIONS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
"""Rows and columns of a step in each direction, from the north-west to the south-east."""

MOST_STEPS = np.iinfo(np.uint8).max


@njit(inline="always")
def _further(is_known: bool, steps: np.uint8, reach: np.uint8) -> np.uint8:
    """Return the steps to a height from the cell behind one that has it or from which it is so many ``steps`` away."""
    one, none = np.uint8(1), np.uint8(0)
    return one if is_known else (none if steps == none or steps >= reach else np.uint8(steps + one))


@njit(cache=True, nogil=True)
def _fill_steps(height: Float32Array, reach: int, out: ByteArray) -> None:
    rows, columns = height.shape
    most = np.uint8(reach)
    for k, (down, right) in enumerate(DIRECTIONS):
        if down == 0:
            for r in range(rows):
                steps = np.uint8(0)
                for n in range(columns):
                    c = n if right < 0 else columns - 1 - n
                    out[k, r, c] = steps
                    steps = _further(not np.isnan(height[r, c]), steps, most)
            continue
        behind = np.zeros(columns + 2, np.uint8)  # what the cells of the row before tell those behind them
        for n in range(rows):
            r = n if down < 0 else rows - 1 - n
            steps_of, of_row, told = out[k, r], height[r], behind[1 + right : 1 + right + columns]
            for c in range(columns):
                steps_of[c] = told[c]
            telling = behind[1 : 1 + columns]
            for c in range(columns):
                telling[c] = _further(not np.isnan(of_row[c]), steps_of[c], most)


def steps_to_heights(height_m: Float32Array, reach_cells: int) -> ByteArray:
    """Return after how many steps in each of DIRECTIONS a height is met (8, rows, columns), 0 where none is within
    ``reach_cells``, which are MOST_STEPS at most."""
    if reach_cells > MOST_STEPS:
        raise ValueError(f"{reach_cells} cells: at most {MOST_STEPS} can be looked over")
    out = np.empty((len(DIRECTIONS), *height_m.shape), np.uint8)
    _fill_steps(height_m, reach_cells, out)
    return out


@njit(inline="always")
def known_of_block(height: Float32Array, side: int, row: int, column: int, known: FloatArray) -> int:
    """Fill the known heights of a block of ``side`` × ``side`` cells, and return how many they are."""
    count = 0
    for r in range(row * side, min((row + 1) * side, height.shape[0])):
        for c in range(column * side, min((column + 1) * side, height.shape[1])):
            if not np.isnan(height[r, c]):
                known[count] = height[r, c]
                count += 1
    return count
