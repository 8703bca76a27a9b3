"""Labels of a lattice of blocks: the photograph of each, so that the sum of all costs is small.

Each block has a short list of candidates with their costs; neighbouring blocks of different photographs pay for the
seam between them. The sum is made small by sequential tree-reweighted message passing (Kolmogorov 2006, section 4,
TRW-S) on the grid of blocks, always in the same order.
"""

from __future__ import annotations

import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit

DIFFERENCE_UNIT = 1.0 / 255.0
"""Of the numbers that say how much two photographs differ across an edge of the lattice."""


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _send(
    belief: FloatArray,
    back: Float32Array,
    mine: Int32Array,
    yours: Int32Array,
    differ: ByteArray,
    turned: bool,
    price: tuple[float, float],
    message: Float32Array,
) -> None:
    """Pass a message over an edge of the lattice: ``belief`` (K,) of the sender, already weighted, less what came back
    over the edge; different photographs cost the first ``price``, and the second times how much they ``differ`` (K, K);
    ``turned`` where its columns are the sender's."""
    least = np.inf
    for a in range(len(mine)):
        if mine[a] >= 0:
            belief[a] -= back[a]
            least = min(least, belief[a])
    if not np.isfinite(least):
        return
    lowest = np.inf
    for b in range(len(yours)):
        if yours[b] < 0:
            continue
        value = np.inf
        for a in range(len(mine)):
            if mine[a] == yours[b]:
                value = min(value, belief[a])
            elif mine[a] >= 0:
                value = min(value, belief[a] + price[0] + price[1] * (differ[b, a] if turned else differ[a, b]))
        message[b] = value
        lowest = min(lowest, value)
    if np.isfinite(lowest):
        for b in range(len(yours)):
            message[b] -= lowest


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _sweep(
    candidate: Int32Array,
    cost: Float32Array,
    prices: tuple[Float32Array, Float32Array],
    differ: tuple[ByteArray, ByteArray, float],
    message: Float32Array,
    step: int,
) -> None:
    """Pass messages through the lattice, row by row from the north-west (step 1) or from the south-east (step −1).

    ``message`` (4, R, C, K) are those that a block has from its west, east, north and south.
    """
    right, below = prices
    differ_right, differ_below, unit = differ
    rows, columns, k = candidate.shape
    belief, copy = np.empty(k), np.empty(k)
    turned = step < 0
    for a in range(rows):
        i = a if step > 0 else rows - 1 - a
        for b in range(columns):
            j = b if step > 0 else columns - 1 - b
            if candidate[i, j, 0] < 0:
                continue
            for n in range(k):
                total = cost[i, j, n] + message[0, i, j, n] + message[1, i, j, n]
                belief[n] = 0.5 * (total + message[2, i, j, n] + message[3, i, j, n])
            if 0 <= j + step < columns:
                at = j if step > 0 else j - 1
                copy[:] = belief
                back, to = (1, 0) if step > 0 else (0, 1)
                _send(
                    copy, message[back, i, j], candidate[i, j], candidate[i, j + step], differ_right[i, at], turned,
                    (right[i, at], unit), message[to, i, j + step],
                )  # fmt: skip
            if 0 <= i + step < rows:
                at = i if step > 0 else i - 1
                copy[:] = belief
                back, to = (3, 2) if step > 0 else (2, 3)
                _send(
                    copy, message[back, i, j], candidate[i, j], candidate[i + step, j], differ_below[at, j], turned,
                    (below[at, j], unit), message[to, i + step, j],
                )  # fmt: skip


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _across(label: int, candidate: Int32Array, differ: ByteArray, n: int) -> float:
    """Return how much the neighbour's label and the candidate n differ."""
    for a in range(len(candidate)):
        if candidate[a] == label:
            return float(differ[a, n])
    return 0.0


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def chosen_labels(
    candidate: Int32Array,
    cost: Float32Array,
    prices: tuple[Float32Array, Float32Array],
    differ: tuple[ByteArray, ByteArray, float],
    sweeps: int,
) -> Int32Array:
    """Return labels (R, C) out of lists ``candidate`` (R, C, K) with costs, sorted, that make small the sum of costs
    and of what differing neighbours pay; −1 where a list is empty.

    ``prices`` are what a seam costs between a block and its neighbour to the right, and below (R, C); ``differ`` how
    much the candidates of a block and those of its neighbour to the right, and below (R, C, K, K), differ besides, in
    numbers of the third.
    """
    right, below = prices
    differ_right, differ_below, unit = differ
    rows, columns, k = candidate.shape
    message = np.zeros((4, rows, columns, k), np.float32)
    for _ in range(sweeps):
        _sweep(candidate, cost, prices, differ, message, 1)
        _sweep(candidate, cost, prices, differ, message, -1)
    label = np.full((rows, columns), -1, np.int32)
    for i in range(rows):
        for j in range(columns):
            least = np.inf
            for n in range(k):
                number = candidate[i, j, n]
                if number < 0:
                    break
                value = cost[i, j, n] + message[1, i, j, n] + message[3, i, j, n]
                if j > 0 and label[i, j - 1] >= 0 and label[i, j - 1] != number:
                    apart = _across(label[i, j - 1], candidate[i, j - 1], differ_right[i, j - 1], n)
                    value += right[i, j - 1] + unit * apart
                if i > 0 and label[i - 1, j] >= 0 and label[i - 1, j] != number:
                    apart = _across(label[i - 1, j], candidate[i - 1, j], differ_below[i - 1, j], n)
                    value += below[i - 1, j] + unit * apart
                if value < least:
                    least, label[i, j] = value, number
    return label
