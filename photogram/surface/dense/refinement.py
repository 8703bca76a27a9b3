"""Heights to a fraction of a hypothesis, and how well the photographs tell them.

Around the height that the regularised cost volume gives, the window is tilted with the surface and keeps only those of
its samples that lie on the same surface, so that a wall beside the cell does not pull at it. The height is where the
mean correlation s of all pairs of photographs is largest: a parabola through three heights.

The sum of squares of K normalised photographs about their mean is Q = (K − 1) (l − s), l being the mean of their
squared lengths: 1, or less where the noise that is allowed for has shortened them. It is that of a least-squares
adjustment with one unknown, the height (Grün 1985 does it with more), so the noise of a sample is
σ₀² = Q / ((K − 1) (n − 2)) = (l − s) / (n − 2), two having gone into mean and length, and the variance of the height

    σ_h² = 2 β² σ₀² / (∂²Q/∂h²) = 2 β² (l − s) / ((n − 2) (K − 1) c),    c = −∂²s/∂h².

β is BETWEEN_PIXELS: samples a pixel apart, interpolated between the same pixels, share their noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import Float32Array, IntArray
from photogram.compilation import njit
from photogram.surface.dense.correlation import (
    LEFT_OUT,
    Window,
    Workroom,
    fill_agreement,
    fill_correlations,
    workroom,
)
from photogram.surface.dense.lattice import (
    FAST,
    TERMS,
    Box,
    Crops,
    Ground,
    Nodes,
    Room,
    fill_lattice,
    fill_places,
    fill_plan,
    nodes_of,
    sample_lattice,
)

ALIKE = 0.7
"""A photograph that correlates with those that agree by this much of their own correlation is one of them."""

FARTHEST = 1.5
"""How far from the middle of three heights, in their distance, a parabola's peak is believed."""

WIDER = 3.0
"""How much wider the three heights are chosen where the first do not hold the best one."""

BETWEEN_PIXELS = 2.0
"""How much larger the noise that counts is than that of the residuals, because samples lie between pixels: bilinear
interpolation takes 5/9 of the variance of white noise away, none of it from what all of a window has in common: 1.5 for
a texture without detail, and more for one with; this is what simulated planes give at noise from a half to four grey
values, with two to five photographs."""


class Refined(NamedTuple):
    """Heights of the cells of a block (rows, columns), their standard deviations in m, the mean correlations and the
    numbers of photographs."""

    height: Float32Array
    sigma: Float32Array
    correlation: Float32Array
    rays: NDArray[np.uint8]


class _Patch(NamedTuple):
    """The cells of a patch in rows of ``width``, and their ``views`` (K,), whose ``places`` (K, 2, TERMS) are counted
    as ``nodes``; the ``surface`` (per_cell², …) on the lattice, and which of its places lie on the same surface as the
    cell in the middle of a window: ``support`` (n, side²), ``supported`` (n,) how many."""

    box: Box
    width: int
    views: IntArray
    places: Float32Array
    nodes: Nodes
    surface: Float32Array
    support: NDArray[np.int32]
    supported: IntArray


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def own_side_mean(z: Float32Array, slope: Float32Array, tolerance_m: float, half: int, out: Float32Array) -> None:
    """Fill ``out`` (rows, columns) with the mean of heights ``z`` over ± ``half`` cells, less what the ``slope``
    (rows, columns, 2), in m per cell to the east and to the south, explains; of those cells alone that lie within a
    tolerance of the plane of the cell in the middle. NaN stays."""
    rows, columns = z.shape
    for r in range(rows):
        for c in range(columns):
            total, many, middle = np.float32(0.0), 0, z[r, c]
            for i in range(max(r - half, 0), min(r + half + 1, rows)):
                for j in range(max(c - half, 0), min(c + half + 1, columns)):
                    over = z[i, j] - middle - slope[r, c, 0] * (j - c) - slope[r, c, 1] * (i - r)
                    if abs(over) < tolerance_m:
                        total += np.float32(over)
                        many += 1
            out[r, c] = middle + total / np.float32(max(many, 1))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _fill_support(
    patch: _Patch, surface: Float32Array, slope: Float32Array, per_cell: int, half: int, tolerance_m: float
) -> None:
    """Fill which samples of the window of each cell lie within a tolerance (m) of its plane.

    Where they are fewer than a third, the surface says nothing, and all are taken.
    """
    side, box, m = 2 * half + 1, patch.box, per_cell
    for r in range(box.rows):
        for c in range(box.columns):
            n, many = r * patch.width + c, 0
            middle = surface[box.row + r, box.column + c]
            east, south = slope[box.row + r, box.column + c, 0] / m, slope[box.row + r, box.column + c, 1] / m
            for i in range(side):
                for j in range(side):
                    at = n + i // m * patch.width + j // m
                    over = patch.surface[i % m * m + j % m, at] - middle - east * (j - half) - south * (i - half)
                    if abs(over) < tolerance_m:
                        patch.support[n, many] = i * side + j
                        many += 1
            patch.supported[n] = many if 3 * many >= side * side else side * side


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")  # type: ignore[misc, unused-ignore]
def _fill_partly(
    samples: Float32Array, patch: _Patch, n: int, window: Window, per_cell: int, p: Float32Array, pairs: Float32Array
) -> None:
    """Fill the correlations ``pairs`` (K, K, …) of cell ``n`` from those samples of its window that lie on its surface.

    ``p`` (K, side²) is room to work in.
    """
    many, m, side = patch.supported[n], per_cell, 2 * window.half + 1
    count = len(samples)
    for i in range(count):
        mean = np.float32(0.0)
        for k in range(many):
            row, column = patch.support[n, k] // side, patch.support[n, k] % side
            p[i, k] = samples[i, row % m * m + column % m, n + row // m * patch.width + column // m]
            mean += p[i, k]
        mean /= np.float32(many)
        square = np.float32(0.0)
        for k in range(many):
            p[i, k] -= mean
            square += p[i, k] * p[i, k]
        least = np.float32(many * window.noise * window.noise)
        scale = np.float32(1.0) / np.sqrt(square + least)
        for k in range(many):
            p[i, k] *= scale
        pairs[i, i, n] = square * scale * scale
        for j in range(i):
            product = np.float32(0.0)
            for k in range(many):
                product += p[i, k] * p[j, k]
            pairs[i, j, n] = pairs[j, i, n] = product if product == product else np.float32(0.0)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _fill_pairs(
    crops: Crops,
    patch: _Patch,
    window: Window,
    per_cell: int,
    above_m: float,
    plan: Room,
    room: Workroom,
    samples: Float32Array,
    p: Float32Array,
    pairs: Float32Array,
) -> None:
    """Fill ``pairs`` (K, K, n) with the correlations of the views over the windows of a patch ``above_m`` over its
    surface; ``samples`` (K, per_cell², …) and ``p`` (K, side²) are room to work in."""
    for i in range(len(patch.views)):
        sample_lattice(
            crops, patch.views[i], patch.places[i], patch.nodes, window.half, per_cell, patch.surface, above_m, plan,
            samples[i],
        )  # fmt: skip
    fill_correlations(samples, window, per_cell, patch.width, room, pairs)
    whole = (2 * window.half + 1) ** 2
    for r in range(patch.box.rows):
        for n in range(r * patch.width, r * patch.width + patch.box.columns):
            if patch.supported[n] < whole:
                _fill_partly(samples, patch, n, window, per_cell, p, pairs)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _mean_correlation(pairs: Float32Array, n: int, used: IntArray) -> tuple[float, int]:
    """Return the mean correlation of all pairs of the photographs in use, and how many they are."""
    total, kept = 0.0, 0
    for i in range(len(used)):
        if used[i] == 1:
            kept += 1
            for j in range(i):
                if used[j] == 1:
                    total += pairs[i, j, n]
    return 2.0 * total / max(kept * (kept - 1), 1), kept


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _take_in_alike(pairs: Float32Array, n: int, used: IntArray) -> None:
    """Add the photographs that are like those in use."""
    count, among, kept = len(used), 0.0, 0
    for i in range(count):
        if used[i] == 1:
            kept += 1
            for j in range(count):
                among += pairs[i, j, n] if used[j] == 1 else 0.0
    for i in range(count):
        if used[i] == 0 and pairs[i, i, n] == pairs[i, i, n]:
            alike = 0.0
            for j in range(count):
                # those in use are in the mean themselves
                alike += pairs[i, j, n] if used[j] == 1 else 0.0
            if alike > ALIKE * among / kept:
                used[i] = 2
    for i in range(count):
        used[i] = min(used[i], 1)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def refine_heights(
    crops: Crops,
    ground: Ground,
    window: Window,
    independent: float,
    z: Float32Array,
    surface: Float32Array,
    slope: Float32Array,
    probe_m: float,
    tolerance_m: float,
    doubt_m: float,
    found: Refined,
) -> None:
    """Fill heights from ``z`` and a smooth version of it, ``surface`` (rows, columns each), along which windows lie,
    with the ``slope`` (rows, columns, 2) in m per cell.

    Three heights ``probe_m`` apart are tried, and where they do not hold the best, three further apart. A cell whose
    best is not near them keeps the height of ``z``, which its neighbours told, with the standard deviation ``doubt_m``.
    One that fewer than two photographs see has no height (NaN). ``independent``: share of the samples of a window that
    count for the standard deviation, for they may lie closer than a pixel.
    """
    rows, columns = z.shape
    most, m, half = ground.views.shape[2], ground.per_cell, window.half
    more, whole = 2 * half // m, (2 * half + 1) ** 2
    room, plan = workroom(most, ground.patch, m, half)
    lattice = np.zeros(m * m * plan.east.size, np.float32)
    shown, p = np.zeros(most * lattice.size, np.float32), np.empty((most, whole), np.float32)
    five = np.zeros(5 * most * most * plan.east.size, np.float32)
    support, supported = np.empty((plan.east.size, whole), np.int32), np.empty(plan.east.size, np.int64)
    places, views, using = np.empty((most, 2, TERMS), np.float32), np.empty(most, np.int64), np.empty(most, np.int64)
    found.height[:], found.sigma[:], found.correlation[:], found.rays[:] = np.nan, np.nan, 0.0, 0
    for row in range(0, rows, ground.patch):
        for column in range(0, columns, ground.patch):
            box = Box(row, column, min(ground.patch, rows - row), min(ground.patch, columns - column))
            seen = 0
            for v in ground.views[row // ground.patch, column // ground.patch]:
                if v >= 0:
                    views[seen] = v
                    seen += 1
            if seen < 2:
                continue
            width = box.columns + more
            n, size = box.rows * width, (box.rows + more) * width + more
            on = lattice[: m * m * size].reshape(m * m, size)
            fill_lattice(surface, box, m, half, width, on)
            around = surface[row : row + box.rows, column : column + box.columns]
            nodes = nodes_of(box, half / m, around.min() - probe_m, around.max() + probe_m)
            here = Room(plan.east[:size], plan.south[:size], plan.at, plan.right, plan.down)
            fill_plan(nodes, box, width, here)
            for i in range(seen):
                fill_places(crops, ground, nodes, views[i], places[i])
            patch = _Patch(box, width, views[:seen], places[:seen], nodes, on, support, supported)
            _fill_support(patch, surface, slope, m, half, tolerance_m)
            samples = shown[: seen * m * m * size].reshape(seen, m * m, size)
            pairs = five[: 5 * seen * seen * n].reshape(5, seen, seen, n)
            for layer in range(3):
                _fill_pairs(
                    crops, patch, window, m, (layer - 1) * probe_m, plan, room, samples, p, pairs[layer]
                )  # fmt: skip
            fill_agreement(pairs[1], window.kept, room)
            widely = False
            for r in range(box.rows):
                for c in range(box.columns):
                    k, at, used = r * width + c, (row + r, column + c), using[:seen]
                    if np.isnan(z[at]) or room.used[k] < 1.5:
                        continue
                    for i in range(seen):
                        used[i] = 1 if room.sums[i, k] > LEFT_OUT else 0
                    _take_in_alike(pairs[1], k, used)
                    best, kept = _mean_correlation(pairs[1], k, used)
                    shift, probe, bend = np.nan, probe_m, 0.0
                    for wide in range(2):
                        low, high = (0, 2) if wide == 0 else (3, 4)
                        if wide == 1 and not widely:
                            for layer in range(3, 5):
                                above = WIDER * probe_m * (2 * layer - 7)
                                _fill_pairs(crops, patch, window, m, above, plan, room, samples, p, pairs[layer])
                            widely = True
                        below = _mean_correlation(pairs[low], k, used)[0]
                        above = _mean_correlation(pairs[high], k, used)[0]
                        bend = 2.0 * best - below - above
                        shift = 0.5 * (above - below) / bend if bend > 0.0 else np.nan
                        if abs(shift) <= FARTHEST:
                            break
                        probe *= WIDER
                    found.correlation[at], found.rays[at] = best, kept
                    if not abs(shift) <= FARTHEST:
                        found.height[at], found.sigma[at] = z[at], doubt_m
                        continue
                    peak, length = min(best + 0.5 * bend * shift * shift, 1.0), 0.0
                    for i in range(seen):
                        length += pairs[1, i, i, k] / kept if used[i] == 1 else 0.0
                    samples_in_use = supported[k] * independent
                    noise = BETWEEN_PIXELS * np.sqrt(max(length - peak, 1e-4) / max(samples_in_use - 2.0, 1.0))
                    found.height[at], found.correlation[at] = surface[at] + probe * shift, peak
                    found.sigma[at] = probe * noise * np.sqrt(2.0 / ((kept - 1) * bend))
