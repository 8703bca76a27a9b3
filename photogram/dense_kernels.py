"""How well photographs agree on a height: windows of ground, seen by several photographs, correlated with each other.

A window is a small piece of ground around a cell, level or tilted; every photograph that sees it is sampled at the
projected places, about one pixel apart. With the samples p̂ of a photograph reduced by their mean and scaled to unit
length, the mean correlation of all pairs of K photographs is (|Σ p̂|² − K) / (K (K − 1)): no photograph is the
reference. Those that agree least, behind a tree or a wall, are left out of the sum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from photogram.semi_global import FULL_COST
from photogram.views import seen_at

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]

NEUTRAL = FULL_COST // 2
"""Cost of a hypothesis without any correlation, and of one that fewer than two photographs see."""

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Sums may be reordered, so that they fill the processor's lanes; NaN keeps its meaning."""

_OUT = -1e10


class Crops(NamedTuple):
    """Views and the part of each (reduced) picture that a block of cells needs, one after the other in ``pixels``.

    ``model`` (V,), ``q`` (V, 11), ``R`` (V, 3, 3), ``C`` (V, 3), ``radius`` (V,) as in Views; ``start`` (V,), ``left``,
    ``top``, ``width``, ``height`` (V,) of each crop; a pixel (u, v) of the photograph is (u, v) · ``scale`` in the
    reduced picture.
    """

    model: IntArray
    q: FloatArray
    R: FloatArray
    C: FloatArray
    radius: FloatArray
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
    crops: Crops, size: IntArray, margin_px: float, place: FloatArray, out: IntArray, tangent: FloatArray
) -> None:
    """Fill ``out`` (P, N) with the views that see places (P, 3) from straightest above, −1 where there are no more, and
    ``tangent`` (P, N) with the tangents of their angles off the vertical; ``size`` (V, 2) of the photographs."""
    most = out.shape[1]
    for n in range(len(place)):
        X = place[n]
        out[n], tangent[n] = -1, np.inf
        for v in range(len(crops.model)):
            dx, dy, dz = crops.C[v, 0] - X[0], crops.C[v, 1] - X[1], crops.C[v, 2] - X[2]
            lean = np.hypot(dx, dy) / dz if dz > 0.0 else np.inf
            if not lean < tangent[n, most - 1]:
                continue
            x, y, _ = seen_at(crops.model[v], crops.q[v], crops.R[v], crops.C[v], crops.radius[v], X)
            if margin_px <= x <= size[v, 0] - 1 - margin_px and margin_px <= y <= size[v, 1] - 1 - margin_px:
                k = most - 1
                while k > 0 and tangent[n, k - 1] > lean:
                    out[n, k], tangent[n, k] = out[n, k - 1], tangent[n, k - 1]
                    k -= 1
                out[n, k], tangent[n, k] = v, lean


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _place(crops: Crops, v: int, X: FloatArray) -> tuple[float, float]:
    """Return where a crop shows a point, NaN where it does not."""
    x, y, _ = seen_at(crops.model[v], crops.q[v], crops.R[v], crops.C[v], crops.radius[v], X)
    return x * crops.scale - crops.left[v], y * crops.scale - crops.top[v]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def affine(
    crops: Crops, v: int, ground: Ground, cell: tuple[int, int], h: float, slope: tuple[float, float], out: FloatArray
) -> None:
    """Fill ``out`` (6,) with where a crop shows the middle of a window at height ``h``, and its steps to the next
    sample to the east and to the south; ``slope`` is what the window rises by to each of them, in m."""
    X = np.empty(3)
    foot, up = ground.foot[cell[0], cell[1]], ground.up[cell[0], cell[1]]
    for k in range(3):
        X[k] = foot[k] + h * up[k]
    out[0], out[1] = _place(crops, v, X)
    for k in range(3):
        X[k] = foot[k] + ground.east[k] + (h + slope[0]) * up[k]
    x, y = _place(crops, v, X)
    out[2], out[3] = x - out[0], y - out[1]
    for k in range(3):
        X[k] = foot[k] + ground.south[k] + (h + slope[1]) * up[k]
    x, y = _place(crops, v, X)
    out[4], out[5] = x - out[0], y - out[1]


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def sample(crops: Crops, v: int, a: FloatArray, offset: Float32Array, half: int, out: Float32Array) -> bool:
    """Fill ``out`` (n,) with the grey values at ``offset`` (n, 2) samples to the east and to the south of a window's
    middle, bilinear; False where the window of ± ``half`` samples does not lie within the crop."""
    w, h = crops.width[v], crops.height[v]
    reach_x, reach_y = half * (abs(a[2]) + abs(a[4])), half * (abs(a[3]) + abs(a[5]))
    inside = a[0] - reach_x >= 0.0 and a[0] + reach_x < w - 1 and a[1] - reach_y >= 0.0 and a[1] + reach_y < h - 1
    if not inside:
        return False
    base = crops.start[v]
    x0, y0 = np.float32(a[0]), np.float32(a[1])
    xe, ye, xs, ys = np.float32(a[2]), np.float32(a[3]), np.float32(a[4]), np.float32(a[5])
    for k in range(len(offset)):
        e, s = offset[k, 0], offset[k, 1]
        x, y = x0 + e * xe + s * xs, y0 + e * ye + s * ys
        xi, yi = min(max(int(x), 0), w - 2), min(max(int(y), 0), h - 2)
        fx, fy = x - np.float32(xi), y - np.float32(yi)
        at = base + yi * w + xi
        top = crops.pixels[at] + fx * (crops.pixels[at + 1] - crops.pixels[at])
        low = crops.pixels[at + w] + fx * (crops.pixels[at + w + 1] - crops.pixels[at + w])
        out[k] = top + fy * (low - top)
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
def _dot(p: Float32Array, m: Float32Array) -> float:
    total = np.float32(0.0)
    for k in range(len(p)):
        total += p[k] * m[k]
    return float(total)


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def agreement(p: Float32Array, own: FloatArray, least: int, m: Float32Array, a: FloatArray) -> float:
    """Return the mean correlation of all pairs of those ``least`` photographs that agree best.

    ``p`` (count, n) normalised samples, ``own`` (count,) their squared lengths, ``m`` (n,) and ``a`` (count,) are room
    to work in: on return ``a`` is the sum of a photograph's correlations with the others, hugely negative for one that
    was left out. The one that agrees least goes first, and the others are looked at again without it.
    """
    count, n = p.shape
    m[:] = np.float32(0.0)
    for i in range(count):
        for k in range(n):
            m[k] += p[i, k]
    together = 0.0
    for i in range(count):
        a[i] = _dot(p[i], m) - own[i]
        together += a[i]
    used = count
    while used > least:
        worst = -1
        for i in range(count):
            if a[i] > _OUT and (worst < 0 or a[i] < a[worst]):
                worst = i
        together -= 2.0 * a[worst]
        a[worst] = _OUT
        used -= 1
        for i in range(count):
            if a[i] > _OUT:
                a[i] -= _dot(p[i], p[worst])
    return float(together / (used * (used - 1)))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def share_of(count: int, share: float) -> int:
    """Return how many of ``count`` photographs must agree, two at least."""
    return max(min(count, 2), int(np.ceil(share * count)))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def square_offsets(half: int) -> Float32Array:
    """Return the samples (n, 2) of a square window, to the east and to the south of its middle."""
    side = 2 * half + 1
    offset = np.empty((side * side, 2), np.float32)
    for k in range(side * side):
        offset[k, 0], offset[k, 1] = k % side - half, k // side - half
    return offset


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

    Places are interpolated quadratically between the lowest, the middle and the highest hypothesis.
    """
    rows, columns, _ = ground.foot.shape
    offset = square_offsets(window.half)
    most, n = ground.views.shape[2], len(offset)
    p, m, own, a = np.empty((most, n), np.float32), np.empty(n, np.float32), np.empty(most), np.empty(most)
    node, way = np.empty((most, 3, 6)), np.empty(6)
    for r in range(rows):
        for c in range(columns):
            at, count = start[r * columns + c], start[r * columns + c + 1] - start[r * columns + c]
            if count == 0:
                continue
            views = ground.views[r // ground.patch, c // ground.patch]
            low, high = first[r * columns + c] * step_m, (first[r * columns + c] + count - 1) * step_m
            tilt = (np.float64(slope[r, c, 0]), np.float64(slope[r, c, 1]))
            for i in range(most):
                if views[i] >= 0:
                    for t in range(3):
                        affine(crops, views[i], ground, (r, c), low + 0.5 * t * (high - low), tilt, node[i, t])
            for k in range(count):
                t = k / max(count - 1, 1)
                w0, w1, w2 = (1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)
                seen = 0
                for i in range(most):
                    if views[i] >= 0:
                        for e in range(6):
                            way[e] = w0 * node[i, 0, e] + w1 * node[i, 1, e] + w2 * node[i, 2, e]
                        if sample(crops, views[i], way, offset, window.half, p[seen]):
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
    offset, way, grey = np.zeros((1, 2), np.float32), np.empty(6), np.empty(1, np.float32)
    rows, columns = surface.shape
    for r in range(rows):
        for c in range(columns):
            out[r, c] = np.float32(0.0)
            view = ground.views[r // ground.patch, c // ground.patch, 0]
            if view >= 0:
                affine(crops, view, ground, (r, c), np.float64(surface[r, c]), (0.0, 0.0), way)
                if sample(crops, view, way, offset, 0, grey):
                    out[r, c] = grey[0]
