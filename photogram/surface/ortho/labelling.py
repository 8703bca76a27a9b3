"""Labels of a lattice of blocks: the photograph of each, so that the sum of all costs is small.

Each block has a short list of candidates with their costs; neighbouring blocks of different photographs pay for the
seam between them. The sum is made small by sequential tree-reweighted message passing (Kolmogorov 2006, section 4,
TRW-S) on the grid of blocks, always in the same order.
"""

import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit

DIFFERENCE_UNIT = 1.0 / 255.0
"""Of the numbers that say how much two photographs differ across an edge of the lattice."""

NEVER = np.float32(1e30)
"""Cost of what a list does not have; finite, so that what comes back can be taken off."""


@njit(cache=True, nogil=True)
def _edge_costs(
    first: Int32Array, second: Int32Array, price: float, differ: ByteArray, unit: float, out: Float32Array
) -> None:
    """Fill what each two candidates (K, K) of neighbouring blocks cost: nothing where they are the same photograph."""
    for a in range(len(first)):
        for b in range(len(second)):
            if first[a] < 0 or second[b] < 0:
                out[a, b] = NEVER
            elif first[a] == second[b]:
                out[a, b] = 0.0
            else:
                out[a, b] = price + unit * differ[a, b]


@njit(cache=True, nogil=True, inline="always")
def _send(
    belief: FloatArray, back: Float32Array, edge: Float32Array, turned: bool, message: Float32Array, least: FloatArray
) -> None:
    """Pass a message over an edge of the lattice: ``belief`` (K,) of the sender, already weighted, less what came back
    over the edge; ``turned`` where the columns of ``edge`` (K, K) are the sender's. ``least`` (K,) is room."""
    k, lowest = len(message), np.inf
    for b in range(k):
        least[b] = np.inf
    if turned:
        for b in range(k):
            for a in range(k):
                value = belief[a] - back[a] + edge[b, a]
                least[b] = value if value < least[b] else least[b]
    else:
        for a in range(k):
            own = belief[a] - back[a]
            for b in range(k):
                value = own + edge[a, b]
                least[b] = value if value < least[b] else least[b]
    for b in range(k):
        lowest = least[b] if least[b] < lowest else lowest
    for b in range(k):
        message[b] = least[b] - lowest


@njit(cache=True, nogil=True)
def _sweep(candidate: Int32Array, cost: Float32Array, edge: Float32Array, message: Float32Array, step: int) -> None:
    """Pass messages through the lattice, row by row from the north-west (step 1) or from the south-east (step −1).

    ``edge`` (2, R, C, K, K) are the costs towards the neighbour to the right, and below; ``message`` (4, R, C, K) those
    that a block has from its west, east, north and south.
    """
    rows, columns, k = candidate.shape
    belief, least = np.empty(k), np.empty(k)
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
                back, to = (1, 0) if step > 0 else (0, 1)
                at = j if step > 0 else j - 1
                _send(belief, message[back, i, j], edge[0, i, at], turned, message[to, i, j + step], least)
            if 0 <= i + step < rows:
                back, to = (3, 2) if step > 0 else (2, 3)
                at = i if step > 0 else i - 1
                _send(belief, message[back, i, j], edge[1, at, j], turned, message[to, i + step, j], least)


@njit(cache=True, nogil=True)
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
    rows, columns, k = candidate.shape
    edge = np.empty((2, rows, columns, k, k), np.float32)
    for i in range(rows):
        for j in range(columns):
            own = candidate[i, j]
            if j + 1 < columns:
                _edge_costs(own, candidate[i, j + 1], prices[0][i, j], differ[0][i, j], differ[2], edge[0, i, j])
            if i + 1 < rows:
                _edge_costs(own, candidate[i + 1, j], prices[1][i, j], differ[1][i, j], differ[2], edge[1, i, j])
    finite = np.minimum(cost, NEVER)
    message = np.zeros((4, rows, columns, k), np.float32)
    for _ in range(sweeps):
        for step in (1, -1):  # each literal would be compiled by itself
            _sweep(candidate, finite, edge, message, step)
    label, place = np.full((rows, columns), -1, np.int32), np.full((rows, columns), -1, np.int32)
    for i in range(rows):
        for j in range(columns):
            least = np.inf
            for n in range(k):
                if candidate[i, j, n] < 0:
                    break
                value = finite[i, j, n] + message[1, i, j, n] + message[3, i, j, n]
                if j > 0 and place[i, j - 1] >= 0:
                    value += edge[0, i, j - 1, place[i, j - 1], n]
                if i > 0 and place[i - 1, j] >= 0:
                    value += edge[1, i - 1, j, place[i - 1, j], n]
                if value < least:
                    least, place[i, j], label[i, j] = value, n, candidate[i, j, n]
    return label
