"""How well photographs agree on a height: windows of ground, seen by several photographs, correlated with each other.

A window is a square of places of the lattice (`lattice`) around a cell. With the samples p̂ of a photograph reduced by
their mean and scaled to unit length, the mean correlation of all pairs of K photographs is (|Σ p̂|² − K) / (K (K − 1)):
no photograph is the reference. Those that agree least, behind a tree or a wall, are left out of the sum.

Windows of neighbouring cells share most of their samples. So nothing is done window by window: of each pair of
photographs the products of all samples are summed over all windows at once, first along columns, then along rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import Float32Array, IntArray
from photogram.compilation import njit
from photogram.surface.dense.lattice import (
    FAST,
    TERMS,
    Box,
    Crops,
    Ground,
    Room,
    fill_lattice,
    fill_places,
    fill_plan,
    nodes_of,
    sample_lattice,
)
from photogram.surface.dense.semi_global import FULL_COST

NEUTRAL = FULL_COST // 2
"""Cost of a hypothesis without any correlation, and of one that fewer than two photographs see."""

LEFT_OUT = np.float32(-1e10)
"""What `fill_agreement` says of a photograph that was left out; sums of correlations lie far above."""

LAYERS = 16
"""Neighbouring hypotheses whose places are interpolated between the same heights."""


class Window(NamedTuple):
    """``half``: places of the lattice from the middle to the edge; ``noise``: grey values that count as noise;
    ``kept``: share of the photographs that must agree."""

    half: int
    noise: float
    kept: float


class Workroom(NamedTuple):
    """Room to work in for the cells of a patch and up to N views.

    ``columns`` (per_cell, lattice), ``mean``, ``scale``, ``sums`` (N, cells), and one number each for a cell:
    ``score``, ``seen``, ``used``, ``worst``, ``lowest``.
    """

    columns: Float32Array
    mean: Float32Array
    scale: Float32Array
    sums: Float32Array
    score: Float32Array
    seen: Float32Array
    used: Float32Array
    worst: Float32Array
    lowest: Float32Array


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def workroom(most: int, patch: int, per_cell: int, half: int) -> tuple[Workroom, Room]:
    """Return room for patches of ``patch`` × ``patch`` cells and windows of ± ``half`` places in ``most`` views."""
    side = patch + 2 * half // per_cell
    cells = side * side + 2 * half // per_cell
    several = (most, cells)
    room = Workroom(
        np.zeros((per_cell, cells), np.float32), np.zeros(several, np.float32), np.zeros(several, np.float32),
        np.zeros(several, np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.float32),
        np.zeros(cells, np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.float32),
    )  # fmt: skip
    plan = Room(
        np.zeros(cells, np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.int32),
        np.zeros(cells, np.float32), np.zeros(cells, np.float32),
    )  # fmt: skip
    return room, plan


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def _set_sum(a: Float32Array, b: Float32Array, c: Float32Array, out: Float32Array) -> None:
    for k in range(len(out)):
        out[k] = a[k] + b[k] + c[k]


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def _add_sum(a: Float32Array, b: Float32Array, out: Float32Array) -> None:
    for k in range(len(out)):
        out[k] += a[k] + b[k]


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def _set_products(
    a0: Float32Array, b0: Float32Array, a1: Float32Array, b1: Float32Array, a2: Float32Array, b2: Float32Array,
    out: Float32Array,
) -> None:  # fmt: skip
    for k in range(len(out)):
        out[k] = a0[k] * b0[k] + a1[k] * b1[k] + a2[k] * b2[k]


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def _add_products(
    a0: Float32Array, b0: Float32Array, a1: Float32Array, b1: Float32Array, out: Float32Array
) -> None:  # fmt: skip
    for k in range(len(out)):
        out[k] += a0[k] * b0[k] + a1[k] * b1[k]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _part(a: Float32Array, d: int, j: int, per_cell: int, width: int, n: int) -> Float32Array:
    """Return the samples (n,) of phase column ``j`` that are ``d`` places to the south of the first of a window."""
    at = d // per_cell * width
    return a[d % per_cell * per_cell + j, at : at + n]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _along_rows(columns: Float32Array, half: int, out: Float32Array) -> None:
    """Fill ``out`` (n,) with the sums over 2 ``half`` + 1 places along the rows of ``columns`` (per_cell, n + …)."""
    m, n = columns.shape[0], len(out)
    _set_sum(columns[0, :n], columns[1 % m, 1 // m : 1 // m + n], columns[2 % m, 2 // m : 2 // m + n], out)
    for d in range(3, 2 * half + 1, 2):
        e = d + 1
        _add_sum(columns[d % m, d // m : d // m + n], columns[e % m, e // m : e // m + n], out)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _sum_of_windows(a: Float32Array, half: int, width: int, columns: Float32Array, out: Float32Array) -> None:
    """Fill ``out`` (n,) with the sums of samples ``a`` (per_cell², …) of rows of ``width`` cells over all windows."""
    m, n = columns.shape[0], columns.shape[1]
    for j in range(m):
        _set_sum(_part(a, 0, j, m, width, n), _part(a, 1, j, m, width, n), _part(a, 2, j, m, width, n), columns[j])
        for d in range(3, 2 * half + 1, 2):
            _add_sum(_part(a, d, j, m, width, n), _part(a, d + 1, j, m, width, n), columns[j])
    _along_rows(columns, half, out)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _product_of_windows(
    a: Float32Array, b: Float32Array, half: int, width: int, columns: Float32Array, out: Float32Array
) -> None:
    """As `_sum_of_windows`, of the products of ``a`` and ``b``."""
    m, n = columns.shape[0], columns.shape[1]
    for j in range(m):
        _set_products(
            _part(a, 0, j, m, width, n), _part(b, 0, j, m, width, n),
            _part(a, 1, j, m, width, n), _part(b, 1, j, m, width, n),
            _part(a, 2, j, m, width, n), _part(b, 2, j, m, width, n), columns[j],
        )  # fmt: skip
        for d in range(3, 2 * half + 1, 2):
            _add_products(
                _part(a, d, j, m, width, n), _part(b, d, j, m, width, n),
                _part(a, d + 1, j, m, width, n), _part(b, d + 1, j, m, width, n), columns[j],
            )  # fmt: skip
    _along_rows(columns, half, out)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def _to_scale(square: Float32Array, mean: Float32Array, n: float, noise: float, scale: Float32Array) -> None:
    """Turn sums of squares of windows of n samples into squared lengths, given the sums ``mean``, which become
    means."""
    count, least = np.float32(n), np.float32(n * noise * noise)
    for k in range(len(square)):
        length = max(square[k] - mean[k] * mean[k] / count, np.float32(0.0))
        shown = square[k] == square[k]
        scale[k] = np.float32(1.0) / np.sqrt(length + least) if shown else np.float32(0.0)
        square[k] = length / (length + least) if shown else np.float32(np.nan)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def _to_correlation(
    product: Float32Array, one: Float32Array, other: Float32Array, n: float, of_one: Float32Array,
    of_other: Float32Array, mirrored: Float32Array,
) -> None:  # fmt: skip
    """Turn sums of products of windows of n samples into correlations, 0 where one of the two is not shown."""
    share = np.float32(1.0 / n)
    for k in range(len(product)):
        value = (product[k] - one[k] * other[k] * share) * of_one[k] * of_other[k]
        product[k] = value if value == value else np.float32(0.0)
        mirrored[k] = product[k]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def fill_correlations(
    samples: Float32Array, window: Window, per_cell: int, width: int, room: Workroom, pairs: Float32Array
) -> None:
    """Fill ``pairs`` (K, K, n) with the correlations of K views over the windows of n cells in rows of ``width``.

    (i, i, n) is the squared length of the normalised samples, NaN where a view does not show a window. ``samples`` (K,
    per_cell², …) are those of the lattice.
    """
    count, _, n = pairs.shape
    more, size = 2 * window.half // per_cell, float((2 * window.half + 1) ** 2)
    columns = room.columns.ravel()[: per_cell * (n + more)].reshape(per_cell, n + more)
    for i in range(count):
        mean, scale, own = room.mean[i, :n], room.scale[i, :n], pairs[i, i]
        _sum_of_windows(samples[i], window.half, width, columns, mean)
        _product_of_windows(samples[i], samples[i], window.half, width, columns, own)
        _to_scale(own, mean, size, window.noise, scale)
        for j in range(i):
            _product_of_windows(samples[i], samples[j], window.half, width, columns, pairs[i, j])
            _to_correlation(pairs[i, j], mean, room.mean[j, :n], size, scale, room.scale[j, :n], pairs[j, i])


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def share_of(count: int, share: float) -> int:
    """Return how many of ``count`` photographs must agree, two at least."""
    return max(min(count, 2), int(np.ceil(share * count)))


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def _sum_up(pair: Float32Array, total: Float32Array) -> None:
    for k in range(len(total)):
        total[k] += pair[k]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def _find_worst(a: Float32Array, number: int, worst: Float32Array, lowest: Float32Array) -> None:
    """Note where a view's sum of correlations is the lowest so far of those not left out."""
    i = np.float32(number)
    for k in range(len(a)):
        lower = (a[k] > LEFT_OUT) & (a[k] < lowest[k])
        worst[k] = i if lower else worst[k]
        lowest[k] = a[k] if lower else lowest[k]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def _leave_out(pair: Float32Array, number: int, worst: Float32Array, a: Float32Array) -> None:
    """Take the correlation with view ``number`` from a sum where that is the worst."""
    i, none = np.float32(number), np.float32(0.0)
    for k in range(len(a)):
        a[k] -= pair[k] if worst[k] == i else none


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def _mark_left_out(number: int, worst: Float32Array, a: Float32Array) -> None:
    i = np.float32(number)
    for k in range(len(a)):
        a[k] = LEFT_OUT if worst[k] == i else a[k]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def fill_agreement(pairs: Float32Array, share: float, room: Workroom) -> None:
    """Fill ``room.score`` (n,) with the mean correlation of all ``pairs`` (K, K, n) of those views that agree best, a
    ``share`` of the ``room.seen`` (n,) that show a window, −1 where these are fewer than two.

    ``room.used`` (n,) says how many they are. ``room.sums`` (K, n) is on return the sum of a view's correlations with
    the others, LEFT_OUT or less for one that is not among them. The one that agrees least goes first, and the others
    are looked at again without it.
    """
    count, _, n = pairs.shape
    seen, used, score = room.seen[:n], room.used[:n], room.score[:n]
    worst, lowest, part = room.worst[:n], room.lowest[:n], np.float32(share)
    seen[:], score[:] = np.float32(0.0), np.float32(0.0)
    for i in range(count):
        a, own = room.sums[i, :n], pairs[i, i]
        a[:] = np.float32(0.0)
        for j in range(count):
            if j != i:
                _sum_up(pairs[i, j], a)
        for k in range(n):
            shown = own[k] == own[k]
            seen[k] += np.float32(1.0) if shown else np.float32(0.0)
            score[k] += a[k] if shown else np.float32(0.0)
            a[k] = a[k] if shown else np.float32(2.0) * LEFT_OUT
    most = 0
    for number in range(2, count + 1):
        most = max(most, number - share_of(number, share))
    used[:] = seen
    for _ in range(most):
        worst[:], lowest[:] = np.float32(-1.0), np.float32(1e10)
        for i in range(count):
            _find_worst(room.sums[i, :n], i, worst, lowest)
        for k in range(n):
            more = used[k] > max(min(seen[k], np.float32(2.0)), np.ceil(part * seen[k]))
            worst[k] = worst[k] if more else np.float32(-1.0)
            score[k] -= np.float32(2.0) * lowest[k] if more else np.float32(0.0)
            used[k] -= np.float32(1.0) if more else np.float32(0.0)
        for i in range(count):
            for j in range(count):
                if j != i:
                    _leave_out(pairs[i, j], j, worst, room.sums[i, :n])
            _mark_left_out(i, worst, room.sums[i, :n])
    for k in range(n):
        among = used[k] * (used[k] - np.float32(1.0))
        score[k] = score[k] / among if used[k] > np.float32(1.5) else np.float32(-1.0)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _box_of(first: NDArray[np.int32], count: IntArray, patch: Box, k: int) -> Box:
    """Return the cells of a patch around all that have the hypothesis ``k``; no rows where none has."""
    top, bottom, left, right = patch.row + patch.rows, -1, patch.column + patch.columns, -1
    for r in range(patch.row, patch.row + patch.rows):
        for c in range(patch.column, patch.column + patch.columns):
            if 0 <= k - first[r, c] < count[r, c]:
                top, bottom, left, right = min(top, r), max(bottom, r), min(left, c), max(right, c)
    return Box(top, left, max(bottom - top + 1, 0), max(right - left + 1, 0))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _range_of(first: NDArray[np.int32], count: IntArray, patch: Box) -> tuple[int, int]:
    """Return the lowest hypothesis of a patch's cells, and the one after the highest."""
    low, high = 1 << 30, -(1 << 30)
    for r in range(patch.row, patch.row + patch.rows):
        for c in range(patch.column, patch.column + patch.columns):
            if count[r, c] > 0:
                low, high = min(low, first[r, c]), max(high, first[r, c] + count[r, c])
    return low, high


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def fill_costs(
    crops: Crops,
    ground: Ground,
    window: Window,
    step_m: float,
    start: IntArray,
    first: NDArray[np.int32],
    count: IntArray,
    surface: Float32Array,
    cost: NDArray[np.uint8],
) -> None:
    """Fill the costs of all hypotheses: hypothesis k of a cell is the height k ``step_m`` over ``surface`` (rows,
    columns), along which its window lies.

    The hypotheses of a cell, ``count`` (rows, columns) from ``first`` (rows, columns) on, have their costs from
    ``start`` (rows, columns) on.
    """
    rows, columns, _ = ground.foot.shape
    most, m, half = ground.views.shape[2], ground.per_cell, window.half
    room, plan = workroom(most, ground.patch, m, half)
    more = 2 * half // m
    places, views = np.empty((most, 2, TERMS), np.float32), np.empty(most, np.int64)
    lattice = np.zeros(m * m * plan.east.size, np.float32)
    shown, correlations = np.zeros(most * lattice.size, np.float32), np.zeros(most * most * plan.east.size, np.float32)
    for row in range(0, rows, ground.patch):
        for column in range(0, columns, ground.patch):
            patch = Box(row, column, min(ground.patch, rows - row), min(ground.patch, columns - column))
            seen = 0
            for v in ground.views[row // ground.patch, column // ground.patch]:
                if v >= 0:
                    views[seen] = v
                    seen += 1
            low, high = _range_of(first, count, patch)
            around = surface[row : row + patch.rows, column : column + patch.columns]
            lowest, highest = around.min(), around.max()
            for k0 in range(low, high, LAYERS):
                k1 = min(k0 + LAYERS, high)
                nodes = nodes_of(patch, half / m, lowest + k0 * step_m, highest + (k1 - 1) * step_m)
                placed, before = False, Box(-1, -1, 0, 0)
                for k in range(k0, k1):
                    box = _box_of(first, count, patch, k)
                    if box.rows == 0:
                        continue
                    if not placed:
                        for i in range(seen):
                            fill_places(crops, ground, nodes, views[i], places[i])
                        placed = True
                    width = box.columns + more
                    n, size = box.rows * width, (box.rows + more) * width + more
                    on = lattice[: m * m * size].reshape(m * m, size)
                    if box != before:
                        fill_lattice(surface, box, m, half, width, on)
                        here = Room(plan.east[:size], plan.south[:size], plan.at, plan.right, plan.down)
                        fill_plan(nodes, box, width, here)
                        before = box
                    samples = shown[: seen * m * m * size].reshape(seen, m * m, size)
                    for i in range(seen):
                        sample_lattice(crops, views[i], places[i], nodes, half, m, on, k * step_m, plan, samples[i])
                    pairs = correlations[: seen * seen * n].reshape(seen, seen, n)
                    fill_correlations(samples, window, m, width, room, pairs)
                    fill_agreement(pairs, window.kept, room)
                    for r in range(box.rows):
                        for c in range(box.columns):
                            at = k - first[box.row + r, box.column + c]
                            if 0 <= at < count[box.row + r, box.column + c]:
                                score, byte = room.score[r * width + c], NEUTRAL
                                if room.used[r * width + c] > 1.5:
                                    byte = int(min(max(NEUTRAL * (1.0 - score) + 0.5, 0.0), float(FULL_COST)))
                                cost[start[box.row + r, box.column + c] + at] = np.uint8(byte)
