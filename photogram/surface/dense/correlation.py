"""How well photographs agree on a height: windows of ground, seen by several photographs, correlated with each other.

A window is a square of places of the lattice (`lattice`) around a cell. With the samples p̂ of a photograph reduced by
their mean and scaled to unit length, the mean correlation of all pairs of K photographs is (|Σ p̂|² − K) / (K (K − 1)):
no photograph is the reference. Those that agree least, behind a tree or a wall, are left out of the sum.

Heights are tried patch by patch, all cells of a patch that have a hypothesis at once.
"""

from typing import NamedTuple

import numpy as np

from photogram.arrays import ByteArray, Float32Array, Int32Array, IntArray
from photogram.compilation import njit
from photogram.surface.dense.lattice import (
    TERMS,
    CellWindow,
    Crops,
    GroundCells,
    Scratch,
    fill_lattice,
    fill_part,
    fill_places,
    fill_plan,
    nodes_of,
    sample_lattice,
    scratch_for_samples,
)
from photogram.surface.dense.semi_global import FULL_COST
from photogram.surface.dense.window_sums import PatchWindows, Sums, Window, fill_correlations, scratch_for_sums

NEUTRAL = FULL_COST // 2
"""Cost of a hypothesis without any correlation, and of one that fewer than two photographs see."""

LEFT_OUT = np.float32(-1e10)
"""What `fill_agreement` says of a photograph that was left out; sums of correlations lie far above."""

LAYERS = 16
"""Neighbouring hypotheses whose places are interpolated between the same heights."""


class Agreement(NamedTuple):
    """How well views agree on a height of n cells: the ``score``, the mean correlation of all pairs of those that agree
    best, −1 where these are fewer than two; how many views have ``seen`` a window and how many are ``used``, float32;
    and the ``sums`` (K, n) of a view's correlations with the others in use, LEFT_OUT or less for one that is not.
    ``worst`` and ``lowest`` (n,) are room."""

    score: Float32Array
    seen: Float32Array
    used: Float32Array
    sums: Float32Array
    worst: Float32Array
    lowest: Float32Array


class Hypotheses(NamedTuple):
    """The heights that are tried: hypothesis k of a cell is the height k ``step_m`` over ``surface`` (rows, columns),
    along which its window lies. A cell has ``number`` of them from ``first`` on (rows, columns each), and their costs
    stand from ``start`` (rows, columns) on."""

    surface: Float32Array
    step_m: float
    first: Int32Array
    number: IntArray
    start: IntArray


class _Layer(NamedTuple):
    """Room for one height of a patch: ``places`` (K, 2, TERMS), the ``surface`` of the patch and of a box of it on the
    lattice, the ``samples`` and the correlations of ``pairs``, flat."""

    places: Float32Array
    surface: Float32Array
    part: Float32Array
    samples: Float32Array
    pairs: Float32Array


@njit(cache=True, nogil=True)
def scratch_for_agreement(most: int, cells: int) -> Agreement:
    """Return room for the agreement of ``most`` views on up to ``cells`` cells."""
    return Agreement(
        np.zeros(cells, np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.float32),
        np.zeros((most, cells), np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.float32),
    )  # fmt: skip


@njit(cache=True, nogil=True)
def share_of(count: int, share: float) -> int:
    """Return how many of ``count`` photographs must agree, two at least."""
    return max(min(count, 2), int(np.ceil(share * count)))


@njit(cache=True, nogil=True)
def views_of_patch(ground: GroundCells, box: CellWindow, out: IntArray) -> int:
    """Fill ``out`` with the views in which the cells of a patch are looked up; returns how many."""
    seen = 0
    for v in ground.views[box.row // ground.patch, box.column // ground.patch]:
        if v >= 0:
            out[seen] = v
            seen += 1
    return seen


@njit(cache=True, nogil=True)
def leave_out_hidden(ground: GroundCells, box: CellWindow, width: int, pairs: Float32Array) -> None:
    """Make the ``pairs`` (K, K, n) of cells of a box, in rows of ``width``, what they are without the views that do not
    see these."""
    if ground.hidden.shape[0] == 0:
        return
    for slot in range(ground.hidden.shape[2]):
        i = 0
        for earlier in range(slot):
            i += ground.views[box.row // ground.patch, box.column // ground.patch, earlier] >= 0
        if ground.views[box.row // ground.patch, box.column // ground.patch, slot] < 0:
            continue
        for r in range(box.rows):
            for c in range(box.columns):
                if ground.hidden[box.row + r, box.column + c, slot]:
                    n = r * width + c
                    for j in range(len(pairs)):
                        pairs[i, j, n], pairs[j, i, n] = np.float32(0.0), np.float32(0.0)
                    pairs[i, i, n] = np.float32(np.nan)


@njit(cache=True, nogil=True)
def _add(pair: Float32Array, total: Float32Array) -> None:
    for k in range(len(total)):
        total[k] += pair[k]


@njit(cache=True, nogil=True)
def _find_worst(a: Float32Array, number: int, worst: Float32Array, lowest: Float32Array) -> None:
    """Note where a view's sum of correlations is the lowest so far of those not left out."""
    i = np.float32(number)
    for k in range(len(a)):
        lower = (a[k] > LEFT_OUT) & (a[k] < lowest[k])
        worst[k] = i if lower else worst[k]
        lowest[k] = a[k] if lower else lowest[k]


@njit(cache=True, nogil=True)
def _leave_out(pair: Float32Array, number: int, worst: Float32Array, a: Float32Array) -> None:
    """Take the correlation with view ``number`` from a sum where that is the worst."""
    i, none = np.float32(number), np.float32(0.0)
    for k in range(len(a)):
        a[k] -= pair[k] if worst[k] == i else none


@njit(cache=True, nogil=True)
def _mark_left_out(number: int, worst: Float32Array, a: Float32Array) -> None:
    i = np.float32(number)
    for k in range(len(a)):
        a[k] = LEFT_OUT if worst[k] == i else a[k]


@njit(cache=True, nogil=True)
def _sum_up(pairs: Float32Array, agreement: Agreement) -> None:
    """Fill the sums of the correlations of each view, their sum, and how many views show a window."""
    count, _, n = pairs.shape
    seen, score = agreement.seen[:n], agreement.score[:n]
    seen[:], score[:] = np.float32(0.0), np.float32(0.0)
    for i in range(count):
        a, own = agreement.sums[i, :n], pairs[i, i]
        a[:] = np.float32(0.0)
        for j in range(count):
            if j != i:
                _add(pairs[i, j], a)
        for k in range(n):
            shown = own[k] == own[k]
            seen[k] += np.float32(1.0) if shown else np.float32(0.0)
            score[k] += a[k] if shown else np.float32(0.0)
            a[k] = a[k] if shown else np.float32(2.0) * LEFT_OUT


@njit(cache=True, nogil=True, error_model="numpy")
def fill_agreement(pairs: Float32Array, share: float, agreement: Agreement) -> None:
    """Fill ``agreement`` from the correlations of all ``pairs`` (K, K, n): a ``share`` of the views that show a window
    must agree.

    The one that agrees least goes first, and the others are looked at again without it.
    """
    count, _, n = pairs.shape
    seen, used, score = agreement.seen[:n], agreement.used[:n], agreement.score[:n]
    worst, lowest, part = agreement.worst[:n], agreement.lowest[:n], np.float32(share)
    _sum_up(pairs, agreement)
    used[:], most = seen, 0
    for number in range(2, count + 1):
        most = max(most, number - share_of(number, share))
    for _ in range(most):
        worst[:], lowest[:] = np.float32(-1.0), np.float32(1e10)
        for i in range(count):
            _find_worst(agreement.sums[i, :n], i, worst, lowest)
        for k in range(n):
            more = used[k] > max(min(seen[k], np.float32(2.0)), np.ceil(part * seen[k]))
            worst[k] = worst[k] if more else np.float32(-1.0)
            score[k] -= np.float32(2.0) * lowest[k] if more else np.float32(0.0)
            used[k] -= np.float32(1.0) if more else np.float32(0.0)
        for i in range(count):
            for j in range(count):
                if j != i:
                    _leave_out(pairs[i, j], j, worst, agreement.sums[i, :n])
            _mark_left_out(i, worst, agreement.sums[i, :n])
    for k in range(n):
        among = used[k] * (used[k] - np.float32(1.0))
        score[k] = score[k] / among if used[k] > np.float32(1.5) else np.float32(-1.0)


@njit(cache=True, nogil=True)
def _box_of(tried: Hypotheses, patch: CellWindow, k: int) -> CellWindow:
    """Return the cells of a patch around all that have the hypothesis ``k``; no rows where none has."""
    top, bottom, left, right = patch.row + patch.rows, -1, patch.column + patch.columns, -1
    for r in range(patch.row, patch.row + patch.rows):
        for c in range(patch.column, patch.column + patch.columns):
            if 0 <= k - tried.first[r, c] < tried.number[r, c]:
                top, bottom, left, right = min(top, r), max(bottom, r), min(left, c), max(right, c)
    return CellWindow(top, left, max(bottom - top + 1, 0), max(right - left + 1, 0))


@njit(cache=True, nogil=True)
def _range_of(tried: Hypotheses, patch: CellWindow) -> tuple[int, int]:
    """Return the lowest hypothesis of a patch's cells, and the one after the highest."""
    low, high = 1 << 30, -(1 << 30)
    for r in range(patch.row, patch.row + patch.rows):
        for c in range(patch.column, patch.column + patch.columns):
            if tried.number[r, c] > 0:
                low, high = min(low, tried.first[r, c]), max(high, tried.first[r, c] + tried.number[r, c])
    return low, high


@njit(cache=True, nogil=True)
def _fill_layer(tried: Hypotheses, box: CellWindow, k: int, width: int, agreement: Agreement, cost: ByteArray) -> None:
    """Fill the costs of hypothesis ``k`` in a box from the agreement on it."""
    for r in range(box.rows):
        for c in range(box.columns):
            row, column, n = box.row + r, box.column + c, r * width + c
            at = k - tried.first[row, column]
            if 0 <= at < tried.number[row, column]:
                byte = NEUTRAL * (1.0 - agreement.score[n]) + 0.5 if agreement.used[n] > 1.5 else float(NEUTRAL)
                cost[tried.start[row, column] + at] = np.uint8(min(max(byte, 0.0), float(FULL_COST)))


@njit(inline="always")
def _fill_patch(
    crops: Crops,
    ground: GroundCells,
    window: Window,
    tried: Hypotheses,
    patch: CellWindow,
    views: IntArray,
    rooms: tuple[_Layer, Scratch, Sums, Agreement],
    cost: ByteArray,
) -> None:
    """Fill the costs of all hypotheses of a patch."""
    layer, room, sums, agreement = rooms
    seen, m, half = len(views), ground.per_cell, window.half
    more, (low, high) = 2 * half // m, _range_of(tried, patch)
    around = tried.surface[patch.row : patch.row + patch.rows, patch.column : patch.column + patch.columns]
    lowest, highest = around.min(), around.max()
    across = patch.columns + more
    whole = layer.surface[: m * m * (patch.rows + more) * across].reshape(m * m, -1)
    fill_lattice(tried.surface, patch, m, half, across, whole)
    for k0 in range(low, high, LAYERS):
        k1, placed = min(k0 + LAYERS, high), False
        nodes = nodes_of(patch, half / m, lowest + k0 * tried.step_m, highest + (k1 - 1) * tried.step_m)
        for k in range(k0, k1):
            box = _box_of(tried, patch, k)
            if box.rows == 0:
                continue
            if not placed:
                for i in range(seen):
                    fill_places(crops, ground, nodes, views[i], layer.places[i])
                placed = True
            width = box.columns + more
            n, size = box.rows * width, (box.rows + more) * width + more
            part = layer.part[: m * m * size].reshape(m * m, size)
            fill_part(whole, patch, across, box, width, part)
            fill_plan(nodes, box, width, room, size)
            samples = layer.samples[: seen * m * m * size].reshape(seen, m * m, size)
            for i in range(seen):
                sample_lattice(
                    crops, views[i], layer.places[i], nodes, half, m, part, k * tried.step_m, room, samples[i]
                )  # fmt: skip
            pairs = layer.pairs[: seen * seen * n].reshape(seen, seen, n)
            fill_correlations(samples, window, m, width, sums, pairs)
            leave_out_hidden(ground, box, width, pairs)
            fill_agreement(pairs, window.kept, agreement)
            _fill_layer(tried, box, k, width, agreement, cost)


@njit(cache=True, nogil=True)
def fill_costs(crops: Crops, ground: GroundCells, windows: PatchWindows, tried: Hypotheses, cost: ByteArray) -> None:
    """Fill the costs of all hypotheses, 0 for perfect agreement, NEUTRAL for none."""
    rows, columns = tried.surface.shape
    most, m = ground.views.shape[2], ground.per_cell
    more = 2 * windows.half.max() // m
    cells = (ground.patch + more) ** 2 + more
    layer = _Layer(
        np.empty((most, 2, TERMS), np.float32), np.zeros(m * m * cells, np.float32),
        np.zeros(m * m * cells, np.float32), np.zeros(most * m * m * cells, np.float32),
        np.zeros(most * most * cells, np.float32),
    )  # fmt: skip
    rooms = (layer, scratch_for_samples(cells), scratch_for_sums(most, m, cells), scratch_for_agreement(most, cells))
    views = np.empty(most, np.int64)
    for row in range(0, rows, ground.patch):
        for column in range(0, columns, ground.patch):
            patch = CellWindow(row, column, min(ground.patch, rows - row), min(ground.patch, columns - column))
            seen = views_of_patch(ground, patch, views)
            if seen >= 2:
                at = row // ground.patch, column // ground.patch
                window = Window(windows.half[at], windows.noise, windows.kept[at])
                _fill_patch(crops, ground, window, tried, patch, views[:seen], rooms, cost)
            else:
                for r in range(row, row + patch.rows):
                    for c in range(column, column + patch.columns):
                        begin = tried.start[r, c]
                        cost[begin : begin + tried.number[r, c]] = NEUTRAL
