"""Positions of a receiver that has stopped, or is slower than the camera: the same figures for photograph after
photograph."""

from collections.abc import Sequence
from datetime import datetime

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, FloatArray, IntArray

SAME_M = 0.01
"""No receiver in the air repeats itself this closely; a frozen one repeats every digit."""

FEWEST = 3
"""Photographs at different times that must have one position before it is not accepted as measured."""


def clusters(position_m: FloatArray, gap_m: float) -> IntArray:
    """Return the number (N,) of the single-linkage cluster of each position (N, k): chains with no gap longer than
    this, which is good to a tenth.

    Positions within a tenth of the gap count as one, so that the number of links stays small.
    """
    cells, cell_of = np.unique(np.round(position_m / (0.1 * gap_m)), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(10.0, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    return np.asarray(connected_components(links, directed=False)[1][cell_of.ravel()], dtype=np.int64)


def frozen_positions(
    position_m: FloatArray, times: Sequence[datetime | None], captures: Sequence[str | None] = ()
) -> BoolArray:
    """Return which positions (F, 3), in m along any axes, were not measured when their photographs were taken.

    Those are the positions that FEWEST photographs or more have in common to SAME_M, taken at as many different
    ``times``; the first of them was measured, unless there is no other position in the block. Photographs taken at
    once, as by several cameras on one aircraft, may share a position: those of one identifier in ``captures`` (F,) are
    one moment, whatever their clocks say; without any times only a block in which every photograph has the same
    position is frozen. NaN marks photographs without a position, which are never frozen.
    """
    frozen = np.zeros(len(position_m), dtype=bool)
    captures = captures or (None,) * len(position_m)
    known = np.flatnonzero(np.isfinite(position_m).all(axis=1))
    if len(known) < FEWEST:
        return frozen
    label = clusters(position_m[known], SAME_M)
    for group in np.flatnonzero(np.bincount(label) >= FEWEST):
        own, whole = known[label == group], np.count_nonzero(label == group) == len(known)
        clock = {i: time.replace(tzinfo=None) for i in own.tolist() if (time := times[i]) is not None}
        moments = {i: captures[i] or time for i, time in clock.items()}
        frozen[own] = len(set(moments.values())) >= FEWEST or (not moments and whole)
        if moments and not whole:
            first = moments[min(clock, key=clock.__getitem__)]
            frozen[[i for i, moment in moments.items() if moment == first]] = False
    return frozen
