"""How well photographs agree on a height: windows of ground, seen by several photographs, correlated with each other.

A window is a small piece of ground around a cell, level or tilted; every photograph that sees it is sampled at the
projected places, about one pixel apart. With the samples p̂ of a photograph reduced by their mean and scaled to unit
length, the mean correlation of all pairs of K photographs is (|Σ p̂|² − K) / (K (K − 1)): no photograph is the
reference. Those that agree least, behind a tree or a wall, are left out of the sum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import Float32Array, FloatArray, IntArray
from photogram.compilation import njit
from photogram.projection import OrientedCameras, seen_at
from photogram.surface.dense.semi_global import FULL_COST

NEUTRAL = FULL_COST // 2
"""Cost of a hypothesis without any correlation, and of one that fewer than two photographs see."""

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Sums may be reordered, so that they fill the processor's lanes; NaN keeps its meaning."""

LEFT_OUT = -1e10
"""What `agreement` says of a photograph that was left out; sums of correlations lie far above."""

LOOKED_UP = 11
"""Numbers by which `look_up_row` says how a view shows the window of a cell."""

_EDGE_PX = 0.01
"""How far from a crop's edge a sample must stay, so that rounding to 32 bits cannot take it beyond."""


class Crops(NamedTuple):
    """Cameras and the part of each (reduced) picture that a block of cells needs, one after the other in ``pixels``.

    ``start`` (V,), ``left``, ``top``, ``width``, ``height`` (V,) of each crop; a pixel (u, v) of the photograph is
    (u, v) · ``scale`` in the reduced picture.
    """

    cameras: OrientedCameras
    start: IntArray
    left: IntArray
    top: IntArray
    width: IntArray
    height: IntArray
    pixels: Float32Array
    scale: float


class Ground(NamedTuple):
    """The cells of a block: vertical lines ``foot`` and ``up`` (rows, columns, 3), the steps ``east`` and ``south``
    (3,) to the next sample of a window, ``spacing`` cells away, and ``views`` (rows / patch, columns / patch, N): in
    which views the cells of a patch of ``patch`` × ``patch`` cells are matched, −1 for none."""

    foot: FloatArray
    up: FloatArray
    east: FloatArray
    south: FloatArray
    spacing: float
    views: IntArray
    patch: int


class Window(NamedTuple):
    """``half``: samples from the middle to the edge; ``noise``: grey values that count as noise; ``kept``: share of the
    photographs that must agree."""

    half: int
    noise: float
    kept: float


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def nearest_views(
    cameras: OrientedCameras, margin_px: float, place: FloatArray, out: IntArray, tangent: FloatArray
) -> None:
    """Fill ``out`` (P, N) with the views that see places (P, 3) from straightest above, −1 where there are no more, and
    ``tangent`` (P, N) with the tangents of their angles off the vertical."""
    most, C = out.shape[1], cameras.position
    for n in range(len(place)):
        X = place[n]
        out[n], tangent[n] = -1, np.inf
        for v in range(len(cameras.camera)):
            dx, dy, dz = C[v, 0] - X[0], C[v, 1] - X[1], C[v, 2] - X[2]
            lean = np.hypot(dx, dy) / dz if dz > 0.0 else np.inf
            if not lean < tangent[n, most - 1]:
                continue
            x, y, _ = seen_at(cameras, v, X)
            width, height = cameras.size_px[cameras.camera[v], 0], cameras.size_px[cameras.camera[v], 1]
            if margin_px <= x <= width - 1 - margin_px and margin_px <= y <= height - 1 - margin_px:
                k = most - 1
                while k > 0 and tangent[n, k - 1] > lean:
                    out[n, k], tangent[n, k] = out[n, k - 1], tangent[n, k - 1]
                    k -= 1
                out[n, k], tangent[n, k] = v, lean


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _raise(foot: FloatArray, up: FloatArray, h: float, X: FloatArray) -> None:
    """Fill ``X`` (3,) with the place at a height over the foot of a vertical."""
    for k in range(3):
        X[k] = foot[k] + h * up[k]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def look_up_row(
    crops: Crops,
    ground: Ground,
    row: int,
    low: FloatArray,
    high: FloatArray,
    slope: Float32Array,
    out: FloatArray,
) -> None:
    """Fill ``out`` (columns, N, LOOKED_UP) with how its views show the windows of a row's cells.

    They lie at heights from ``low`` to ``high`` (columns,), NaN for a cell that is left out; ``slope`` (columns, 2) is
    what a window rises by, in m, to the next sample to the east and to the south.

    The eleven are the place of the middle in the crop, the steps to the next samples to the east and to the south, all
    halfway up; the places at ``low`` and at ``high``; and how much the depth grows from halfway to ``high``, as a share
    of it. A place is NaN where a view does not show it.
    """
    X, views = np.empty(3), ground.views[row // ground.patch]
    for start in range(0, len(low), ground.patch):
        for i in range(views.shape[1]):
            v = views[start // ground.patch, i]
            if v < 0:
                continue
            scale, left, top = crops.scale, crops.left[v], crops.top[v]
            for c in range(start, min(start + ground.patch, len(low))):
                if np.isnan(low[c]):
                    continue
                found, foot, up = out[c, i], ground.foot[row, c], ground.up[row, c]
                middle = 0.5 * (low[c] + high[c])
                _raise(foot, up, middle, X)
                x, y, depth = seen_at(crops.cameras, v, X)
                found[0], found[1] = x * scale - left, y * scale - top
                _raise(foot, up, middle + slope[c, 0], X)
                for k in range(3):
                    X[k] += ground.east[k]
                x, y, _ = seen_at(crops.cameras, v, X)
                found[2], found[3] = x * scale - left - found[0], y * scale - top - found[1]
                _raise(foot, up, middle + slope[c, 1], X)
                for k in range(3):
                    X[k] += ground.south[k]
                x, y, _ = seen_at(crops.cameras, v, X)
                found[4], found[5] = x * scale - left - found[0], y * scale - top - found[1]
                _raise(foot, up, low[c], X)
                x, y, nearest = seen_at(crops.cameras, v, X)
                found[6], found[7] = x * scale - left, y * scale - top
                _raise(foot, up, high[c], X)
                x, y, farthest = seen_at(crops.cameras, v, X)
                found[8], found[9] = x * scale - left, y * scale - top
                found[10] = 0.5 * (farthest - nearest) / depth


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def window_at(found: FloatArray, t: float, out: FloatArray) -> None:
    """Fill ``out`` (6,), place and steps of a window, at the height ``t``, −1 the lowest and 1 the highest, from what
    look_up_row ``found``: the place is quadratic in it, the steps grow as the depth becomes less."""
    w0, w1, w2 = 0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)
    out[0] = w0 * found[6] + w1 * found[0] + w2 * found[8]
    out[1] = w0 * found[7] + w1 * found[1] + w2 * found[9]
    nearer = 1.0 / (1.0 + t * found[10])
    for e in range(2, 6):
        out[e] = nearer * found[e]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _within(a: FloatArray, half: int, size: tuple[int, int]) -> bool:
    """Return whether a window of ± ``half`` samples lies within a crop."""
    reach_x, reach_y = half * (abs(a[2]) + abs(a[4])) + _EDGE_PX, half * (abs(a[3]) + abs(a[5])) + _EDGE_PX
    across = a[0] - reach_x >= 0.0 and a[0] + reach_x < size[0] - 1
    return bool(across and a[1] - reach_y >= 0.0 and a[1] + reach_y < size[1] - 1)


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def _grey(crop: Float32Array, w: int, x: np.float32, y: np.float32) -> np.float32:
    """Return a grey value between the pixels of a crop that is ``w`` wide, bilinear; 32-bit places fill the lanes."""
    xi, yi = np.int32(x), np.int32(y)
    fx, fy = x - np.float32(xi), y - np.float32(yi)
    at = np.int64(yi * np.int32(w) + xi)
    top = crop[at] + fx * (crop[at + 1] - crop[at])
    low = crop[at + w] + fx * (crop[at + w + 1] - crop[at + w])
    return np.float32(top + fy * (low - top))


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def sample(
    crop: Float32Array, size: tuple[int, int], a: FloatArray, offset: Float32Array, half: int, out: Float32Array
) -> bool:
    """Fill ``out`` (n,) with the grey values of a crop of ``size`` at ``offset`` (n, 2) samples to the east and to the
    south of the middle of window ``a``, bilinear; False where ± ``half`` samples do not lie within it."""
    if not _within(a, half, size):
        return False
    w = size[0]
    x0, y0 = np.float32(a[0]), np.float32(a[1])
    xe, ye, xs, ys = np.float32(a[2]), np.float32(a[3]), np.float32(a[4]), np.float32(a[5])
    for k in range(len(offset)):
        e, s = offset[k, 0], offset[k, 1]
        x, y = x0 + e * xe + s * xs, y0 + e * ye + s * ys
        out[k] = _grey(crop, w, x, y)
    return True


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def sample_square(crop: Float32Array, size: tuple[int, int], a: FloatArray, half: int, out: Float32Array) -> bool:
    """Fill ``out`` ((2 ``half`` + 1)²,) with a whole window, row by row from north to south; otherwise as `sample`, and
    faster by a fifth, for most of the time of the matching is spent here."""
    if not _within(a, half, size):
        return False
    w = size[0]
    xe, ye, xs, ys = np.float32(a[2]), np.float32(a[3]), np.float32(a[4]), np.float32(a[5])
    n = 0
    for j in range(-half, half + 1):
        x = np.float32(a[0]) + np.float32(j) * xs - np.float32(half) * xe
        y = np.float32(a[1]) + np.float32(j) * ys - np.float32(half) * ye
        for _ in range(2 * half + 1):
            out[n] = _grey(crop, w, x, y)
            x, y, n = x + xe, y + ye, n + 1
    return True


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def normalise(p: Float32Array, noise: float) -> float:
    """Reduce samples by their mean and scale them to unit length, or less where there is little but noise; returns the
    square of their length then."""
    n = len(p)
    mean = np.float32(0.0)
    for k in range(n):
        mean += p[k]
    mean /= np.float32(n)
    square = np.float32(0.0)
    for k in range(n):
        p[k] -= mean
        square += p[k] * p[k]
    scale = np.float32(1.0 / np.sqrt(square + n * noise * noise))
    for k in range(n):
        p[k] *= scale
    return float(square * scale * scale)


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def dot(p: Float32Array, m: Float32Array) -> float:
    """Return the scalar product of two vectors (n,)."""
    total = np.float32(0.0)
    for k in range(len(p)):
        total += p[k] * m[k]
    return float(total)


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def agreement(p: Float32Array, own: FloatArray, least: int, m: Float32Array, a: FloatArray) -> float:
    """Return the mean correlation of all pairs of those ``least`` photographs that agree best.

    ``p`` (count, n) normalised samples, ``own`` (count,) their squared lengths, ``m`` (n,) and ``a`` (count,) are room
    to work in: on return ``a`` is the sum of a photograph's correlations with the others, LEFT_OUT for one that is not
    among them. The one that agrees least goes first, and the others are looked at again without it.
    """
    count, n = p.shape
    m[:] = np.float32(0.0)
    for i in range(count):
        for k in range(n):
            m[k] += p[i, k]
    together = 0.0
    for i in range(count):
        a[i] = dot(p[i], m) - own[i]
        together += a[i]
    used = count
    while used > least:
        worst = -1
        for i in range(count):
            if a[i] > LEFT_OUT and (worst < 0 or a[i] < a[worst]):
                worst = i
        together -= 2.0 * a[worst]
        a[worst] = LEFT_OUT
        used -= 1
        for i in range(count):
            if a[i] > LEFT_OUT:
                a[i] -= dot(p[i], p[worst])
    return float(together / (used * (used - 1)))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def share_of(count: int, share: float) -> int:
    """Return how many of ``count`` photographs must agree, two at least."""
    return max(min(count, 2), int(np.ceil(share * count)))


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def fill_costs(
    crops: Crops,
    ground: Ground,
    window: Window,
    step_m: float,
    start: IntArray,
    first: NDArray[np.int32],
    slope: Float32Array,
    cost: NDArray[np.uint8],
) -> None:
    """Fill the costs of all hypotheses: hypothesis k of a cell is the height k ``step_m`` over the base, its window
    tilted by ``slope`` (rows, columns, 2), in m per sample to the east and to the south.

    Places are interpolated quadratically between the lowest, the middle and the highest hypothesis, and the steps from
    sample to sample grow as the depth becomes less.
    """
    rows, columns, _ = ground.foot.shape
    most, n = ground.views.shape[2], (2 * window.half + 1) ** 2
    p, m, own, a = np.empty((most, n), np.float32), np.empty(n, np.float32), np.empty(most), np.empty(most)
    found, way = np.empty((columns, most, LOOKED_UP)), np.empty(6)
    low, high = np.empty(columns), np.empty(columns)
    for r in range(rows):
        for c in range(columns):
            count = start[r * columns + c + 1] - start[r * columns + c]
            low[c] = first[r * columns + c] * step_m if count > 0 else np.nan
            high[c] = low[c] + (count - 1) * step_m
        look_up_row(crops, ground, r, low, high, slope[r], found)
        for c in range(columns):
            at, count = start[r * columns + c], start[r * columns + c + 1] - start[r * columns + c]
            views = ground.views[r // ground.patch, c // ground.patch]
            for k in range(count):
                t, seen = 2.0 * k / max(count - 1, 1) - 1.0, 0
                for i in range(most):
                    v = views[i]
                    if v >= 0:
                        window_at(found[c, i], t, way)
                        crop, size = crops.pixels[crops.start[v] :], (crops.width[v], crops.height[v])
                        if sample_square(crop, size, way, window.half, p[seen]):
                            own[seen] = normalise(p[seen], window.noise)
                            seen += 1
                cost[at + k] = NEUTRAL
                if seen >= 2:
                    score = agreement(p[:seen], own, share_of(seen, window.kept), m, a)
                    cost[at + k] = np.uint8(min(max(NEUTRAL * (1.0 - score) + 0.5, 0.0), float(FULL_COST)))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def grey_of_cells(crops: Crops, ground: Ground, surface: Float32Array, out: Float32Array) -> None:
    """Fill ``out`` (rows, columns) with the grey values of a surface (m over the base), each in the first of its views;
    0 where that does not show it."""
    rows, columns = surface.shape
    X, at, grey = np.empty(3), np.zeros(6), np.empty(1, np.float32)
    for r in range(rows):
        for c in range(columns):
            out[r, c] = np.float32(0.0)
            v = ground.views[r // ground.patch, c // ground.patch, 0]
            if v < 0:
                continue
            _raise(ground.foot[r, c], ground.up[r, c], np.float64(surface[r, c]), X)
            x, y, _ = seen_at(crops.cameras, v, X)
            at[0], at[1] = x * crops.scale - crops.left[v], y * crops.scale - crops.top[v]
            crop, size = crops.pixels[crops.start[v] :], (crops.width[v], crops.height[v])
            if sample_square(crop, size, at, 0, grey):
                out[r, c] = grey[0]
