"""Where a ray leaves the cells of a grid that it crosses, and which comes next."""

import numpy as np

from photogram.arrays import FloatArray
from photogram.compilation import njit


@njit(cache=True)
def leave_cell(cell: int, side: float, origin: float, step: float) -> float:
    """Return the parameter of a ray where it leaves a cell along one axis: ``side`` is that of a cell, ``origin`` and
    ``step`` the ray's in the same unit; infinity where the ray runs along the cell."""
    if step > 0.0:
        return ((cell + 1) * side - origin) / step
    if step < 0.0:
        return (cell * side - origin) / step
    return float(np.inf)


@njit(cache=True)
def next_cell(column: int, row: int, along: float, up: float, direction: FloatArray) -> tuple[int, int]:
    """Return column and row of the next cell of a ray that leaves the columns of one at ``along`` and its rows at
    ``up``."""
    if along <= up:
        return column + (1 if direction[0] > 0.0 else -1), row
    return column, row + (1 if direction[1] > 0.0 else -1)
