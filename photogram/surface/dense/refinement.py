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

from typing import NamedTuple

import numpy as np

from photogram.arrays import BoolArray, ByteArray, Float32Array, Int32Array, IntArray
from photogram.compilation import njit
from photogram.surface.dense.correlation import (
    LEFT_OUT,
    Agreement,
    fill_agreement,
    leave_out_hidden,
    scratch_for_agreement,
    views_of_patch,
)
from photogram.surface.dense.lattice import (
    TERMS,
    CellWindow,
    Crops,
    GroundCells,
    LatticeNodes,
    Scratch,
    fill_lattice,
    fill_places,
    fill_plan,
    nodes_of,
    sample_lattice,
    scratch_for_samples,
)
from photogram.surface.dense.window_sums import PatchWindows, Sums, Window, fill_correlations, scratch_for_sums

ALIKE = 0.7
"""A photograph that correlates with those that agree by this much of their own correlation is one of them."""

FARTHEST = 1.5
"""How far from the middle of three heights, in their distance, a parabola's peak is believed."""

PROBES = (0.0, -1.0, 1.0, -3.0, 3.0)
"""Heights that are tried, in the distance of the first three: the last two where those do not hold the best."""

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
    rays: ByteArray


class InitialHeights(NamedTuple):
    """What is refined: heights ``z``, a smooth version of them, ``surface`` (rows, columns each), along which windows
    lie, and its ``slope`` (rows, columns, 2) in m per cell.

    Three heights ``probe_m`` apart are tried. Samples within ``tolerance_m`` of the plane of a cell lie on its surface,
    and count for the standard deviation by their distance in pixels, ``independent``: closer ones share pixels.
    ``doubt_m`` is the standard deviation of a height that photographs do not tell.
    """

    z: Float32Array
    surface: Float32Array
    slope: Float32Array
    probe_m: float
    tolerance_m: float
    independent: float
    doubt_m: float


class _Patch(NamedTuple):
    """The cells of a patch in rows of ``width``, and their ``views`` (K,), whose ``places`` (K, 2, TERMS) are counted
    as ``nodes``; the ``surface`` (per_cell², …) on the lattice, and how many of its places lie on the same surface as
    the cell in the middle of a window, ``supported`` (n,)."""

    box: CellWindow
    width: int
    views: IntArray
    places: Float32Array
    nodes: LatticeNodes
    surface: Float32Array
    supported: Float32Array


class _Scratch(NamedTuple):
    """Room to work in: as the functions name it; ``partly`` (K, side²) for one window, ``which`` (side²,) its
    samples, ``middle``, ``east`` and ``south`` (cells,) the planes of windows, ``wanted`` (cells,) which of them are
    asked for."""

    samples: Float32Array
    pairs: Float32Array
    plan: Scratch
    sums: Sums
    agreement: Agreement
    partly: Float32Array
    which: Int32Array
    middle: Float32Array
    east: Float32Array
    south: Float32Array
    wanted: BoolArray


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _count_support(
    surface: Float32Array, start: np.uint64, middle: Float32Array, east: Float32Array, south: Float32Array,
    place: tuple[float, float], tolerance_m: float, out: Float32Array,
) -> None:  # fmt: skip
    """Add one to ``out`` (n,) where a place of the windows lies within a tolerance of their planes."""
    limit, i, j = np.float32(tolerance_m), np.float32(place[0]), np.float32(place[1])
    for n in range(len(out)):
        k = np.uint64(n)
        over = surface[k + start] - middle[n] - i * south[n] - j * east[n]
        out[n] += np.float32(1.0) if abs(over) < limit else np.float32(0.0)


@njit(inline="always")
def _fill_supported(patch: _Patch, start: InitialHeights, per_cell: int, half: int, rooms: _Scratch) -> None:
    """Fill how many samples of the window of each cell lie within the tolerance of its plane.

    Where they are fewer than a third, the surface says nothing, and all are taken.
    """
    side, box, m, n, size = 2 * half + 1, patch.box, per_cell, len(patch.supported), patch.surface.shape[1]
    middle, east, south = rooms.middle[:n], rooms.east[:n], rooms.south[:n]
    for r in range(box.rows):
        for c in range(box.columns):
            k, row, column = r * patch.width + c, box.row + r, box.column + c
            middle[k] = start.surface[row, column]
            east[k], south[k] = start.slope[row, column, 0] / m, start.slope[row, column, 1] / m
    patch.supported[:] = np.float32(0.0)
    lattice = patch.surface.ravel()
    for i in range(side):
        for j in range(side):
            at = np.uint64((i % m * m + j % m) * size + i // m * patch.width + j // m)
            place = (float(i - half), float(j - half))
            _count_support(lattice, at, middle, east, south, place, start.tolerance_m, patch.supported)
    for k in range(n):
        if 3 * patch.supported[k] < side * side:
            patch.supported[k] = side * side


@njit(cache=True, nogil=True)
def _find_support(
    patch: _Patch, k: int, start: InitialHeights, per_cell: int, half: int, rooms: _Scratch
) -> Int32Array:
    """Return which samples of the lattice lie in the window of cell ``k`` and on its surface."""
    side, m, size, many, lattice = 2 * half + 1, per_cell, patch.surface.shape[1], 0, patch.surface.ravel()
    middle, east, south = rooms.middle[k], rooms.east[k], rooms.south[k]
    for i in range(side):
        for j in range(side):
            at = (i % m * m + j % m) * size + i // m * patch.width + j // m + k
            over = lattice[at] - middle - np.float32(i - half) * south - np.float32(j - half) * east
            if abs(over) < start.tolerance_m:
                rooms.which[many] = at
                many += 1
    return rooms.which[:many]


@njit(cache=True, nogil=True)
def _product(a: Float32Array, b: Float32Array) -> np.float32:
    """Return the scalar product of two vectors (n,), in an order of its own that keeps the processor busy."""
    s, t, u, v = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
    whole = len(a) // 4 * 4
    for k in range(0, whole, 4):
        s += a[k] * b[k]
        t += a[k + 1] * b[k + 1]
        u += a[k + 2] * b[k + 2]
        v += a[k + 3] * b[k + 3]
    for k in range(whole, len(a)):
        s += a[k] * b[k]
    return (s + t) + (u + v)


@njit(cache=True, nogil=True)
def _total(a: Float32Array) -> np.float32:
    """Return the sum of a vector (n,), as `_product`."""
    s, t, u, v = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
    whole = len(a) // 4 * 4
    for k in range(0, whole, 4):
        s, t, u, v = s + a[k], t + a[k + 1], u + a[k + 2], v + a[k + 3]
    for k in range(whole, len(a)):
        s += a[k]
    return (s + t) + (u + v)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_partly(
    samples: Float32Array, which: Int32Array, noise: float, p: Float32Array, n: int, pairs: Float32Array
) -> None:
    """Fill the correlations ``pairs`` (K, K, …) of cell ``n`` from some samples of its window alone."""
    count, many = len(samples), len(which)
    for i in range(count):
        own, a = samples[i].ravel(), p[i, :many]
        for k in range(many):
            a[k] = own[which[k]]
        mean = _total(a) / np.float32(many)
        for k in range(many):
            a[k] -= mean
        square = _product(a, a)
        scale = np.float32(1.0 / np.sqrt(square + many * noise * noise))
        for k in range(many):
            a[k] *= scale
        pairs[i, i, n] = square * scale * scale
        for j in range(i):
            product = _product(a, p[j, :many])
            pairs[i, j, n] = product if product == product else np.float32(0.0)
            pairs[j, i, n] = pairs[i, j, n]


@njit(cache=True, nogil=True)
def _fill_pairs(
    crops: Crops, ground: GroundCells, patch: _Patch, window: Window, start: InitialHeights, layers: tuple[int, int],
    rooms: _Scratch, pairs: Float32Array,
) -> None:  # fmt: skip
    """Fill the correlations of the views, ``pairs`` (5, K, K, n), over the windows of a patch at some of PROBES, the
    first and the one after the last; of windows that lie partly on another surface those of ``rooms.wanted`` alone."""
    first, end = layers
    seen, m, half = len(patch.views), ground.per_cell, window.half
    size, whole = patch.surface.shape[1], (2 * half + 1) ** 2
    samples = rooms.samples[: 5 * seen * m * m * size].reshape(5, seen, m * m, size)
    for layer in range(first, end):
        above_m = PROBES[layer] * start.probe_m
        for i in range(seen):
            sample_lattice(
                crops, patch.views[i], patch.places[i], patch.nodes, half, m, patch.surface, above_m, rooms.plan,
                samples[layer, i],
            )  # fmt: skip
        fill_correlations(samples[layer], window, m, patch.width, rooms.sums, pairs[layer])
    for k in range(len(patch.supported)):
        if rooms.wanted[k] and patch.supported[k] < whole:
            which = _find_support(patch, k, start, m, half, rooms)
            for layer in range(first, end):
                _fill_partly(samples[layer], which, window.noise, rooms.partly, k, pairs[layer])
    for layer in range(first, end):
        leave_out_hidden(ground, patch.box, patch.width, pairs[layer])


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _parabola(pairs: Float32Array, k: int, used: IntArray, best: float, layers: tuple[int, int]) -> tuple[float, float]:
    """Return where the parabola through the correlations of three heights has its peak, in their distance from the
    middle one, NaN where it has none, and how much it bends."""
    below, above = _mean_correlation(pairs[layers[0]], k, used)[0], _mean_correlation(pairs[layers[1]], k, used)[0]
    bend = 2.0 * best - below - above
    return 0.5 * (above - below) / bend if bend > 0.0 else np.nan, bend


@njit(cache=True, nogil=True)
def _agreeing(pairs: Float32Array, k: int, agreement: Agreement, using: IntArray) -> IntArray:
    """Return which photographs tell the height of a cell (K,): 1 for those that agree."""
    used = using[: len(pairs)]
    for i in range(len(pairs)):
        used[i] = 1 if agreement.sums[i, k] > LEFT_OUT else 0
    _take_in_alike(pairs, k, used)
    return used


@njit(cache=True, nogil=True)
def _height_at_peak(
    pairs: Float32Array, at: tuple[int, int], k: int, supported: float, widely: bool, start: InitialHeights,
    used: IntArray, out: Refined,
) -> bool:  # fmt: skip
    """Fill the height of a cell from three of PROBES, those ``widely`` apart or not; returns whether these hold its
    best."""
    best, kept = _mean_correlation(pairs[0], k, used)
    layers, probe = ((3, 4), PROBES[4] * start.probe_m) if widely else ((1, 2), start.probe_m)
    shift, bend = _parabola(pairs, k, used, best, layers)
    out.correlation[at], out.rays[at] = best, kept
    if not abs(shift) <= FARTHEST:
        out.height[at], out.sigma[at] = start.z[at], start.doubt_m
        return False
    peak, length = min(best + 0.5 * bend * shift * shift, 1.0), 0.0
    for i in range(len(used)):
        length += pairs[0, i, i, k] / kept if used[i] == 1 else 0.0
    freedom = max(supported * start.independent - 2.0, 1.0)
    noise = BETWEEN_PIXELS * np.sqrt(max(length - peak, 1e-4) / freedom)
    out.height[at], out.correlation[at] = start.surface[at] + probe * shift, peak
    out.sigma[at] = probe * noise * np.sqrt(2.0 / ((kept - 1) * bend))
    return True


@njit(cache=True, nogil=True)
def _find_known(z: Float32Array, box: CellWindow, width: int, known: BoolArray) -> bool:
    """Note which cells of a box, in rows of ``width``, have a height to be refined; returns whether any has."""
    found = False
    known[: box.rows * width] = False
    for r in range(box.rows):
        for c in range(box.columns):
            has = not np.isnan(z[box.row + r, box.column + c])
            known[r * width + c] = has
            found |= has
    return found


@njit(inline="always")
def _refine_patch(
    crops: Crops, ground: GroundCells, patch: _Patch, window: Window, start: InitialHeights, rooms: _Scratch,
    using: IntArray, out: Refined,
) -> None:  # fmt: skip
    """Fill the heights of a patch: of each three probes the next are asked where the last leave something to tell."""
    seen, n, box, wanted = len(patch.views), len(patch.supported), patch.box, rooms.wanted
    pairs = rooms.pairs[: 5 * seen * seen * n].reshape(5, seen, seen, n)
    _fill_pairs(crops, ground, patch, window, start, (0, 1), rooms, pairs)
    fill_agreement(pairs[0], window.kept, rooms.agreement)
    for k in range(n):
        wanted[k] &= rooms.agreement.used[k] >= 1.5
    for widely in (False, True):
        if not wanted[:n].any():
            return
        _fill_pairs(crops, ground, patch, window, start, (3, 5) if widely else (1, 3), rooms, pairs)
        for r in range(box.rows):
            for c in range(box.columns):
                k, at = r * patch.width + c, (box.row + r, box.column + c)
                if wanted[k]:
                    used = _agreeing(pairs[0], k, rooms.agreement, using)
                    wanted[k] = not _height_at_peak(pairs, at, k, patch.supported[k], widely, start, used, out)


@njit(inline="always")
def _rooms(most: int, per_cell: int, cells: int, whole: int) -> _Scratch:
    """Return room for patches of up to ``cells`` places in a phase and windows of ``whole`` samples."""
    return _Scratch(
        np.zeros(5 * most * per_cell * per_cell * cells, np.float32), np.zeros(5 * most * most * cells, np.float32),
        scratch_for_samples(cells), scratch_for_sums(most, per_cell, cells), scratch_for_agreement(most, cells),
        np.zeros((most, whole), np.float32), np.zeros(whole, np.int32), np.zeros(cells, np.float32),
        np.zeros(cells, np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.bool_),
    )  # fmt: skip


@njit(cache=True, nogil=True)
def refine_heights(
    crops: Crops, ground: GroundCells, windows: PatchWindows, start: InitialHeights, out: Refined
) -> None:
    """Fill heights to a fraction of a hypothesis.

    Three heights are tried, and where they do not hold the best, three further apart. A cell whose best is not near
    them keeps the height of ``start.z``, which its neighbours told. One that fewer than two photographs see has no
    height (NaN).
    """
    rows, columns = start.z.shape
    most, m, largest = ground.views.shape[2], ground.per_cell, windows.half.max()
    more = 2 * largest // m
    cells = (ground.patch + more) ** 2 + more
    rooms = _rooms(most, m, cells, (2 * largest + 1) ** 2)
    lattice, supported = np.zeros(m * m * cells, np.float32), np.empty(cells, np.float32)
    places, views, using = np.empty((most, 2, TERMS), np.float32), np.empty(most, np.int64), np.empty(most, np.int64)
    out.height[:], out.sigma[:], out.correlation[:], out.rays[:] = np.nan, np.nan, 0.0, 0
    for row in range(0, rows, ground.patch):
        for column in range(0, columns, ground.patch):
            box = CellWindow(row, column, min(ground.patch, rows - row), min(ground.patch, columns - column))
            at = row // ground.patch, column // ground.patch
            window = Window(windows.half[at], windows.noise, windows.kept[at])
            half, more = window.half, 2 * window.half // m
            seen, width = views_of_patch(ground, box, views), box.columns + more
            if seen < 2 or not _find_known(start.z, box, width, rooms.wanted):
                continue
            n, size = box.rows * width, (box.rows + more) * width + more
            on = lattice[: m * m * size].reshape(m * m, size)
            fill_lattice(start.surface, box, m, half, width, on)
            around = start.surface[row : row + box.rows, column : column + box.columns]
            nodes = nodes_of(box, half / m, around.min() - start.probe_m, around.max() + start.probe_m)
            fill_plan(nodes, box, width, rooms.plan, size)
            for i in range(seen):
                fill_places(crops, ground, nodes, views[i], places[i])
            patch = _Patch(box, width, views[:seen], places[:seen], nodes, on, supported[:n])
            _fill_supported(patch, start, m, half, rooms)
            _refine_patch(crops, ground, patch, window, start, rooms, using, out)
