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

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import Float32Array, FloatArray, IntArray
from photogram.compilation import njit
from photogram.surface.dense.correlation import (
    FAST,
    LEFT_OUT,
    LOOKED_UP,
    Crops,
    Ground,
    Window,
    agreement,
    dot,
    look_up_row,
    normalise,
    sample,
    sample_square,
    share_of,
    window_at,
)

ALIKE = 0.7
"""A photograph that correlates with those that agree by this much of their own correlation is one of them."""

FARTHEST = 1.5
"""How far from the middle of three heights, in their distance, a parabola's peak is believed."""

WIDER = 3.0
"""How many times as far apart the heights of the second trial are."""

BETWEEN_PIXELS = 2.0
"""By how much bilinear samples, a pixel apart, scatter less about their mean than their noise moves the height.
Interpolation takes 5/9 of the variance of white noise away, none of it from what all of a window has in common: 1.5 for
a texture without detail, and more for one with; this is what simulated planes give at noise from a half to four grey
values, with two to five photographs."""


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _support(
    z: Float32Array,
    ground: Ground,
    half: int,
    cell: tuple[int, int],
    tilt: tuple[float, float],
    tolerance: float,
    offset: Float32Array,
) -> int:
    """Fill ``offset`` with the samples of a window that lie within ``tolerance`` (m) of its plane; returns how many.

    Where they are fewer than a third, the surface says nothing, and all are taken.
    """
    rows, columns = z.shape
    middle, side = z[cell[0], cell[1]], 2 * half + 1
    many = 0
    for j in range(-half, half + 1):
        for i in range(-half, half + 1):
            r = int(np.floor(cell[0] + j * ground.spacing + 0.5))
            c = int(np.floor(cell[1] + i * ground.spacing + 0.5))
            within = 0 <= r < rows and 0 <= c < columns
            if within and abs(z[r, c] - middle - tilt[0] * i - tilt[1] * j) < tolerance:
                offset[many, 0], offset[many, 1] = i, j
                many += 1
    if 3 * many >= side * side:
        return many
    for k in range(side * side):
        offset[k, 0], offset[k, 1] = k % side - half, k // side - half
    return side * side


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _samples(
    crop: Float32Array, size: tuple[int, int], way: FloatArray, offset: Float32Array, half: int, out: Float32Array
) -> bool:
    """Fill ``out`` with what a crop shows of window ``way``: all of it where nothing is left out of ``offset``."""
    if len(offset) == (2 * half + 1) ** 2:
        return bool(sample_square(crop, size, way, half, out))
    return bool(sample(crop, size, way, offset, half, out))


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def _correlations_with(p: Float32Array, m: Float32Array, used: IntArray) -> tuple[float, int]:
    """Add the photographs that are like those in use; returns the mean correlation of all pairs, and how many there
    are. ``m`` (n,) is room to work in."""
    count, n = p.shape
    m[:] = np.float32(0.0)
    for i in range(count):
        if used[i] == 1:
            for k in range(n):
                m[k] += p[i, k]
    length, among, kept = np.sqrt(dot(m, m)) + 1e-12, 0.0, 0
    for i in range(count):
        if used[i] == 1:
            among += dot(p[i], m) / length
            kept += 1
    for i in range(count):
        # those in use are in the mean themselves
        if used[i] == 0 and dot(p[i], m) / length > ALIKE * among / kept:
            used[i] = 1
    return _mean_correlation(p, m, used)  # type: ignore[no-any-return]


@njit(cache=True, nogil=True, fastmath=FAST)  # type: ignore[misc, unused-ignore]
def _mean_correlation(p: Float32Array, m: Float32Array, used: IntArray) -> tuple[float, int]:
    """Return the mean correlation of all pairs of the photographs in use, and how many they are."""
    count, n = p.shape
    m[:] = np.float32(0.0)
    alone, kept = 0.0, 0
    for i in range(count):
        if used[i] == 1:
            kept += 1
            alone += dot(p[i], p[i])
            for k in range(n):
                m[k] += p[i, k]
    return (dot(m, m) - alone) / (kept * (kept - 1)), kept


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _correlation_at(
    crops: Crops,
    views: IntArray,
    used: IntArray,
    found: FloatArray,
    t: float,
    window: Window,
    offset: Float32Array,
    way: FloatArray,
    p: Float32Array,
    m: Float32Array,
) -> float:
    """Return the mean correlation of all pairs of the photographs in use at the height ``t`` of `window_at`; ``way``
    (6,), ``p`` (count, n) and ``m`` (n,) are room to work in."""
    for i in range(len(views)):
        if used[i] == 1:
            v = views[i]
            window_at(found[i], t, way)
            crop, size = crops.pixels[crops.start[v] :], (crops.width[v], crops.height[v])
            if not _samples(crop, size, way, offset, window.half, p[i]):
                p[i] = np.float32(0.0)
            normalise(p[i], window.noise)
    return float(_mean_correlation(p, m, used)[0])


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def refine_heights(
    crops: Crops,
    ground: Ground,
    window: Window,
    z: Float32Array,
    slope: Float32Array,
    probe_m: float,
    tolerance_m: float,
    doubt_m: float,
    height: Float32Array,
    sigma: Float32Array,
    correlation: Float32Array,
    rays: NDArray[np.uint8],
) -> None:
    """Fill heights, their standard deviations in m, the mean correlations and the numbers of photographs (rows, columns
    each) from a surface ``z`` with the ``slope`` (rows, columns, 2) in m per sample.

    Three heights ``probe_m`` apart are tried, and where they do not hold the best, three further apart. A cell whose
    best is not near them keeps the height of ``z``, which its neighbours told, with the standard deviation ``doubt_m``.
    One that fewer than two photographs see has no height (NaN).
    """
    rows, columns = z.shape
    most, n = ground.views.shape[2], (2 * window.half + 1) ** 2
    room, m, own, a = np.empty((most, n), np.float32), np.empty(n, np.float32), np.empty(most), np.empty(most)
    offsets, middle, found = np.empty((n, 2), np.float32), np.empty(columns), np.empty((columns, most, LOOKED_UP))
    view, used, way = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(6)
    for r in range(rows):
        middle[:] = z[r]
        look_up_row(crops, ground, r, middle - probe_m, middle + probe_m, slope[r], found)
        for c in range(columns):
            height[r, c], sigma[r, c], correlation[r, c], rays[r, c] = np.nan, np.nan, 0.0, 0
            if np.isnan(z[r, c]):
                continue
            tilt = (np.float64(slope[r, c, 0]), np.float64(slope[r, c, 1]))
            many = _support(z, ground, window.half, (r, c), tilt, tolerance_m, offsets)
            offset, mean, seen = offsets[:many], m[:many], 0
            for i in range(most):
                v = ground.views[r // ground.patch, c // ground.patch, i]
                if v >= 0:
                    crop, size = crops.pixels[crops.start[v] :], (crops.width[v], crops.height[v])
                    if _samples(crop, size, found[c, i], offset, window.half, room[seen, :many]):
                        own[seen], view[seen] = normalise(room[seen, :many], window.noise), v
                        found[c, seen] = found[c, i]
                        seen += 1
            if seen < 2:
                continue
            p, views, using = room[:seen, :many], view[:seen], used[:seen]
            agreement(p, own, share_of(seen, window.kept), mean, a)
            for i in range(seen):
                using[i] = 1 if a[i] > LEFT_OUT else 0
            best, kept = _correlations_with(p, mean, using)
            correlation[r, c], rays[r, c] = best, kept
            shift, bend, probe = np.nan, 0.0, probe_m
            for _ in range(2):
                t = probe / probe_m
                below = _correlation_at(crops, views, using, found[c], -t, window, offset, way, p, mean)
                above = _correlation_at(crops, views, using, found[c], t, window, offset, way, p, mean)
                bend = 2.0 * best - below - above
                shift = 0.5 * (above - below) / bend if bend > 0.0 else np.nan
                if abs(shift) <= FARTHEST:
                    break
                probe *= WIDER
            if not abs(shift) <= FARTHEST:
                height[r, c], sigma[r, c] = middle[c], doubt_m
                continue
            peak, length = min(best + 0.5 * bend * shift * shift, 1.0), 0.0
            for i in range(seen):
                length += own[i] * using[i] / kept
            noise = BETWEEN_PIXELS * np.sqrt(max(length - peak, 1e-4) / (many - 2))
            height[r, c], correlation[r, c] = middle[c] + probe * shift, peak
            sigma[r, c] = probe * noise * np.sqrt(2.0 / ((kept - 1) * bend))
