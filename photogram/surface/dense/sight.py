"""Which photographs see the cells of steep ground: those that its own slope faces, and that nothing else hides.

A photograph that does not see a cell shows something else where the cell would be, and says nothing of its height.
"""

import numpy as np

from photogram.arrays import BoolArray, Float32Array, FloatArray, IntArray
from photogram.compilation import njit
from photogram.grid import Verticals

GRAZING = 0.12
"""Cosine of the angle between the line of sight and the normal below which a photograph shows a cell too obliquely."""


def hidden_cells(
    position_world_m: FloatArray, views: IntArray, patch: int, lines: Verticals, steps: tuple[FloatArray, FloatArray],
    surface: Float32Array, slope: Float32Array, told: BoolArray, tolerance_m: float,
) -> tuple[BoolArray, Float32Array]:  # fmt: skip
    """Return which of the ``told`` cells (rows, columns) the ``views`` (patch rows, patch columns, N) of their patches
    do not see (rows, columns, N), and how well each view sees those of a patch (patch rows, patch columns, N).

    ``surface`` (rows, columns) and its ``slope`` (rows, columns, 2), per cell to the ``steps`` east and south; what
    stands above the line of sight by more than a tolerance hides a cell, if it is told.
    """
    rows, columns = surface.shape
    hidden = np.zeros((rows, columns, views.shape[2]), dtype=np.bool_)
    known = np.where(told, surface, np.float32(np.nan))
    facing = np.zeros(views.shape, np.float32)
    _fill_hidden(
        position_world_m, views, patch, lines.foot_world_m, lines.up, steps[0], steps[1], known,
        slope, tolerance_m, float(surface.max()), hidden, facing,
    )  # fmt: skip
    return hidden, facing


@njit(cache=True, nogil=True)
def _fill_hidden(
    position: FloatArray, views: IntArray, patch: int, foot: FloatArray, up: FloatArray, east: FloatArray,
    south: FloatArray, surface: Float32Array, slope: Float32Array, tolerance_m: float, top: float,
    hidden: BoolArray, facing: Float32Array,
) -> None:  # fmt: skip
    rows, columns = surface.shape
    per_east = 1.0 / (east[0] ** 2 + east[1] ** 2 + east[2] ** 2)
    per_south = 1.0 / (south[0] ** 2 + south[1] ** 2 + south[2] ** 2)
    cell = 1.0 / np.sqrt(per_east)
    for r in range(rows):
        for c in range(columns):
            z, e, s = float(surface[r, c]), float(slope[r, c, 0]), float(slope[r, c, 1])
            if np.isnan(z):
                continue
            for i in range(views.shape[2]):
                v = views[r // patch, c // patch, i]
                if v < 0:
                    continue
                a, b, h = 0.0, 0.0, 0.0
                for k in range(3):
                    d = position[v, k] - foot[r, c, k] - z * up[r, c, k]
                    a += d * east[k]
                    b += d * south[k]
                    h += d * up[r, c, k]
                a, b = a * per_east, b * per_south
                length = np.sqrt((a * cell) ** 2 + (b * cell) ** 2 + h * h)
                cosine = (h - a * e - b * s) / (length * np.sqrt(1.0 + (e * e + s * s) / (cell * cell)))
                if cosine < GRAZING:
                    hidden[r, c, i] = True
                    continue
                away = np.hypot(a, b)
                if away > 1e-6 and _is_hidden(surface, r, c, b / away, a / away, h / away, z + tolerance_m, top):
                    hidden[r, c, i] = True
                    continue
                facing[r // patch, c // patch, i] += np.float32(cosine)


@njit(cache=True, nogil=True)
def _is_hidden(
    surface: Float32Array, r: int, c: int, south: float, east: float, rise: float, z: float, top: float
) -> bool:
    """Return whether the surface stands above the line of sight from a cell, which rises by ``rise`` a cell."""
    rows, columns = surface.shape
    k = 1
    while z + rise * k < top:
        i, j = int(np.floor(r + south * k + 0.5)), int(np.floor(c + east * k + 0.5))
        if not (0 <= i < rows and 0 <= j < columns):
            return False
        if surface[i, j] > z + rise * k:
            return True
        k += 1
    return False
