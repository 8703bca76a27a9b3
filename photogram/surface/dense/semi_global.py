"""Semi-global regularisation of a cost volume whose every cell has hypotheses of its own.

Hirschmüller (2008, eq. 12–14): along straight paths from eight directions the cost of a hypothesis is its own plus that
of the cheapest way to it, where a step to the next hypothesis costs ``small_step``, any larger one ``large_step``. The
sum over the paths is minimal at the height that suits both the pictures and the neighbourhood. Hypotheses are whole
numbers common to all cells; a cell tries those from ``first`` on, as many as its share of the volume holds (Rothermel
et al. 2012), so that narrow ranges on a known surface cost little.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, Float32Array, Int32Array, IntArray
from photogram.compilation import njit

FULL_COST = 254
"""Cost of the worst hypothesis; that of the best is 0."""

_DIRECTIONS = np.array([[0, 1], [1, 0], [0, -1], [-1, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]])


@dataclass(frozen=True, eq=False)
class CostVolume:
    """Costs (T,) uint8 of all hypotheses of all cells (rows, columns), cell after cell, row by row.

    Cell n has the hypotheses ``first[n]``, ``first[n]`` + 1, …, with the costs from ``start[n]`` to ``start[n + 1]``;
    a cell without any takes no part. ``guide`` (rows, columns): a grey value of each cell; where it changes,
    large steps are cheaper.
    """

    cost: ByteArray
    start: IntArray
    first: Int32Array
    guide: Float32Array

    @property
    def shape(self) -> tuple[int, int]:
        """Return the numbers of rows and columns."""
        rows, columns = self.guide.shape
        return rows, columns


@njit(cache=True, nogil=True)
def _along_path(
    cost: ByteArray,
    start: IntArray,
    first: Int32Array,
    guide: Float32Array,
    row: int,
    column: int,
    step: tuple[int, int],
    penalties: tuple[float, float, float],
    before: Int32Array,
    now: Int32Array,
    total: NDArray[np.uint16],
) -> None:
    """Add to ``total`` the costs along one path from a cell on."""
    rows, columns = guide.shape
    small, large, contrast = np.int32(penalties[0]), penalties[1], penalties[2]
    count_before, first_before, best_before, guide_before = 0, 0, np.int32(0), np.float32(0)
    while 0 <= row < rows and 0 <= column < columns:
        n = row * columns + column
        at, count, lowest = start[n], start[n + 1] - start[n], np.int32(1 << 28)
        grey = guide[row, column]
        if count_before == 0:
            for k in range(count):
                now[k] = cost[at + k]
                lowest = min(lowest, now[k])
        else:
            change = abs(grey - guide_before)
            jump = best_before + np.int32(max(large / (1.0 + change / contrast), penalties[0] + 1.0))
            shift = first[n] - first_before
            for k in range(count):
                j = k + shift
                way = jump
                if 0 <= j < count_before:
                    way = min(way, before[j])
                if 1 <= j <= count_before:
                    way = min(way, before[j - 1] + small)
                if -1 <= j < count_before - 1:
                    way = min(way, before[j + 1] + small)
                now[k] = cost[at + k] + way - best_before
                lowest = min(lowest, now[k])
        for k in range(count):
            total[at + k] += np.uint16(now[k])
        before, now = now, before
        count_before, first_before, best_before, guide_before = count, first[n], lowest, grey
        row += step[0]
        column += step[1]


@njit(cache=True, nogil=True)
def _all_paths(
    cost: ByteArray,
    start: IntArray,
    first: Int32Array,
    guide: Float32Array,
    directions: IntArray,
    penalties: tuple[float, float, float],
    most: int,
) -> NDArray[np.uint16]:
    rows, columns = guide.shape
    total = np.zeros(len(cost), np.uint16)
    before, now = np.empty(most, np.int32), np.empty(most, np.int32)
    for d in range(len(directions)):
        dr, dc = directions[d, 0], directions[d, 1]
        if dr != 0:
            row = 0 if dr > 0 else rows - 1
            for column in range(columns):
                _along_path(cost, start, first, guide, row, column, (dr, dc), penalties, before, now, total)
        if dc != 0:
            column = 0 if dc > 0 else columns - 1
            for row in range(rows):
                at_corner = (row == 0 and dr > 0) or (row == rows - 1 and dr < 0)
                if not at_corner:
                    _along_path(cost, start, first, guide, row, column, (dr, dc), penalties, before, now, total)
    return total


@njit(cache=True, nogil=True)
def _best(
    cost: ByteArray,
    total: NDArray[np.uint16],
    start: IntArray,
    first: Int32Array,
    rows: int,
    columns: int,
) -> tuple[Float32Array, Float32Array]:
    """Return the best hypothesis of each cell, with its fraction, and its own cost."""
    best = np.full((rows, columns), np.nan, np.float32)
    own = np.full((rows, columns), np.nan, np.float32)
    for n in range(rows * columns):
        at, count = start[n], start[n + 1] - start[n]
        if count == 0:
            continue
        k = 0
        for j in range(1, count):
            if total[at + j] < total[at + k]:
                k = j
        low, fraction = np.float64(total[at + k]), 0.0
        if 0 < k < count - 1:
            left, right = np.float64(total[at + k - 1]), np.float64(total[at + k + 1])
            bend = left - 2.0 * low + right
            if bend > 0.0:
                fraction = 0.5 * (left - right) / bend
        best[n // columns, n % columns] = first[n] + k + fraction
        own[n // columns, n % columns] = cost[at + k]
    return best, own


def regularised(
    volume: CostVolume, small_step: float, large_step: float, contrast: float
) -> tuple[Float32Array, Float32Array]:
    """Return the best hypothesis (rows, columns) of each cell, to a fraction, and what it costs by itself.

    ``small_step`` and ``large_step`` are penalties in units of cost; the large one falls with the change of the guide,
    to half at a change of ``contrast``. Cells without hypotheses are NaN.
    """
    rows, columns = volume.shape
    most = int(np.diff(volume.start).max(initial=0))
    penalties = (float(small_step), float(large_step), float(contrast))
    total = _all_paths(volume.cost, volume.start, volume.first, volume.guide, _DIRECTIONS, penalties, most)
    best, own = _best(volume.cost, total, volume.start, volume.first, rows, columns)
    return best, own
