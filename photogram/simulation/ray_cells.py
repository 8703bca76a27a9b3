"""Where a ray leaves the cells of a grid that it crosses."""

import numpy as np

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
