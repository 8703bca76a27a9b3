"""Fewer points of a cloud that still show all of it evenly."""

import numpy as np

from photogram.arrays import FloatArray, IntArray

_ROUNDS = 12  # of the search for the size of voxels, at most
_ENOUGH = 0.93  # of the points that may be shown end the search
_FINEST = 2.0**-20  # of the extent: three such indices fit an integer of 64 bits


def _cells(position_m: FloatArray, size_m: float) -> tuple[IntArray, FloatArray]:
    """Return the number of the voxel that each point lies in, and its squared distance from the middle, in voxels."""
    place = (position_m - position_m.min(axis=0)) / size_m
    cell = np.floor(place)
    count = cell.max(axis=0).astype(np.int64) + 1
    whole = cell.astype(np.int64)
    number = (whole[:, 0] * count[1] + whole[:, 1]) * count[2] + whole[:, 2]
    return number, np.sum((place - cell - 0.5) ** 2, axis=1)


def even_choice(position_m: FloatArray, maximum: int) -> IntArray:
    """Return the sorted indices of at most ``maximum`` points of (N, 3), as even as the cloud allows.

    Space is divided into voxels, and the point nearest to the middle of each that holds any is taken. The size is
    sought at which nearly ``maximum`` are occupied; points of a surface grow fewer by its square. The choice follows
    from the points alone. Raises ValueError where ``maximum`` is below 1.
    """
    if maximum < 1:
        raise ValueError("at least one point must be chosen")
    if len(position_m) <= maximum:
        return np.arange(len(position_m))
    extent = float(np.ptp(position_m, axis=0).max())
    if extent == 0:
        return np.zeros(1, dtype=np.int64)
    size, best = extent / np.sqrt(maximum), 2 * extent  # one voxel of twice the extent is never too many
    for _ in range(_ROUNDS):
        size = max(size, extent * _FINEST)
        occupied = len(np.unique(_cells(position_m, size)[0]))
        if occupied <= maximum:
            best = min(best, size)
        if _ENOUGH * maximum <= occupied <= maximum or size == extent * _FINEST:
            break
        size *= float(np.clip(np.sqrt(occupied / (0.97 * maximum)), 0.25, 4.0))
    number, distance = _cells(position_m, best)
    order = np.lexsort((distance, number))
    first = np.ones(len(order), dtype=bool)
    first[1:] = np.diff(number[order]) > 0
    return np.sort(order[first])
