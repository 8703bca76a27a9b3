"""Heights of weak texture, each combined with those of its neighbours on the same surface.

Before they are refined the surface along which windows lie is smoothed over the ground of such a window.

A height whose standard deviation is larger than is wanted becomes the mean of those around that lie within its noise of
its plane, each weighted by the inverse of its variance, over as many cells as make it as good as is wanted. Neighbours
share most of their windows: the error of a height is a mean over its window, so of N cells with windows of w cells
only about N / w tell something of their own, and less where the cells are not much more than a window.
"""

import numpy as np
from scipy.ndimage import maximum_filter

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.compilation import njit
from photogram.surface.dense.refinement import own_side_mean
from photogram.surface.dense.slopes import slopes_without_walls
from photogram.surface.planes import STEEPEST

SMOOTH_HALF = 5
"""Cells to each side over which the surface is smoothed."""

WANTED_STEPS, MOST_CELLS = 0.15, 10
"""Standard deviation that is wanted of a height, in steps, and how many cells to each side are combined at most."""

OWN_SIGMA = 2.2
"""How much larger the error of a height of weak texture is than its window tells: noise makes the peak of the
correlation sharper too, and the best of several peaks is taken."""

BEND_STEPS = 0.6
"""What the standard deviation of a height of weak texture grows by, in steps, over the root of noise over texture and
the largest rise over run of the ground that is combined: over so much ground a surface that is not level bends, and the
pairs that tell it see faces badly. How much both do was found on simulated ground."""

NOISE = 3.0
"""Standard deviations of a difference up to which two heights lie on the same surface."""


@njit(cache=True, nogil=True)
def independent_means(side: float, window: float) -> float:
    """Return how many times smaller the variance of the mean of ``side`` × ``side`` heights is than that of one, whose
    error is the mean of white noise over ``window`` × ``window`` cells."""
    if side <= window:
        along = 1.0 - (side * side - 1.0) / (3.0 * side * window)
    else:
        along = window / side * (1.0 - (window * window - 1.0) / (3.0 * window * side))
    return 1.0 / (along * along)


@njit(cache=True, nogil=True)
def combine_with_neighbours(
    z: Float32Array, sigma: Float32Array, slope: Float32Array, window: Float32Array, wanted_m: float, most: int,
    out: Float32Array, out_sigma: Float32Array,
) -> None:  # fmt: skip
    """Fill ``out`` and ``out_sigma`` (rows, columns) with heights that are as good as ``wanted_m``, if ± ``most`` cells
    make them so. ``slope`` is in m per cell to the east and to the south, ``window`` the side of a cell's window in
    cells (rows, columns), 0 where nothing is to be done."""
    rows, columns = z.shape
    for r in range(rows):
        for c in range(columns):
            out[r, c], out_sigma[r, c] = z[r, c], sigma[r, c]
            if np.isnan(z[r, c]) or window[r, c] <= 0.0 or sigma[r, c] <= wanted_m:
                continue
            half, wanted = 1, (sigma[r, c] / wanted_m) ** 2
            while half < most and independent_means(2.0 * half + 1.0, window[r, c]) < wanted:
                half += 1
            total, weight, met, one = 0.0, 0.0, 0, sigma[r, c] * sigma[r, c]
            for i in range(max(r - half, 0), min(r + half + 1, rows)):
                for j in range(max(c - half, 0), min(c + half + 1, columns)):
                    over = z[i, j] - z[r, c] - slope[r, c, 0] * (j - c) - slope[r, c, 1] * (i - r)
                    variance = sigma[i, j] * sigma[i, j]
                    if abs(over) <= NOISE * np.sqrt(variance + one):
                        total += over / variance
                        weight += 1.0 / variance
                        met += 1
            independent = independent_means(np.sqrt(float(met)), window[r, c])
            out[r, c] = z[r, c] + total / weight
            out_sigma[r, c] = min(np.sqrt(met / weight / independent), sigma[r, c])


def smoothed_where_weak(
    surface: Float32Array, slope: Float32Array, weak: BoolArray, tolerance_m: float, cell_m: float
) -> tuple[Float32Array, Float32Array]:
    """Return a surface (rows, columns) without holes, and its slope (rows, columns, 2), smoothed where texture is
    ``weak`` (rows, columns)."""
    if not weak.any():
        return surface, slope
    smooth, along = np.empty_like(surface), slopes_without_walls(surface, cell_m, STEEPEST)
    own_side_mean(surface, along, tolerance_m, SMOOTH_HALF, smooth)
    along = slopes_without_walls(smooth, cell_m, STEEPEST)
    return np.where(weak, smooth, surface), np.where(weak[..., None], along, slope)


def combined_where_weak(
    height: Float32Array, sigma: Float32Array, slope: Float32Array, noise: FloatArray, window: FloatArray,
    step_m: float, cell_m: float,
) -> tuple[Float32Array, Float32Array]:  # fmt: skip
    """Return heights (rows, columns) and their standard deviations, where texture is weak combined with their
    neighbours: ``noise`` is how many times the texture it is there, 0 elsewhere, and ``window`` the side of a cell's
    window in cells (rows, columns)."""
    weak = noise > 0.0
    if not weak.any():
        return height, sigma
    own = np.where(weak, np.float32(OWN_SIGMA) * sigma, sigma)
    out, out_sigma, windows = np.empty_like(height), np.empty_like(sigma), np.where(weak, window, 0.0)
    combine_with_neighbours(
        height, own, slope, windows.astype(np.float32), WANTED_STEPS * step_m, MOST_CELLS, out, out_sigma
    )
    rise = maximum_filter(np.hypot(slope[..., 0], slope[..., 1]) / np.float32(cell_m), 2 * MOST_CELLS + 1)
    bend_m = BEND_STEPS * step_m * np.sqrt(noise) * rise
    return out, np.hypot(out_sigma, bend_m).astype(np.float32)
