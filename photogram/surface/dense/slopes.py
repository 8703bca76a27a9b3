"""Slopes of a surface without its walls, and the gentle surface that has them: hypotheses count from it.

Windows that lie along a hillside or a roof hold what photographs show of it; a level window does not. So the heights
that are tried lie above and below a surface with the slopes of what is known so far, but without its walls: a wall in
it would tie the edge of a roof to where the coarser level has seen it.
"""

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter, uniform_filter

from photogram.arrays import Float32Array

STEEPEST = 1.0
"""What rises by more than its run is a wall."""

SMOOTH_CELLS = 3.0
"""Standard deviation of the Gaussian that smooths the slopes of the gentle surface."""


def slopes_without_walls(surface: Float32Array, cell_m: float) -> Float32Array:
    """Return what a surface (rows, columns) rises by to the next cell to the east and to the south (rows, columns, 2);
    none where it is as steep as a wall."""
    smooth = uniform_filter(np.where(np.isfinite(surface), surface, np.float32(0.0)), 3, mode="nearest")
    slope = np.zeros((*surface.shape, 2), np.float32)
    for axis in (0, 1):
        if surface.shape[axis] > 1:
            ahead = np.diff(smooth, axis=axis, append=np.take(smooth, [-1], axis=axis))
            behind = np.diff(smooth, axis=axis, prepend=np.take(smooth, [0], axis=axis))
            # the gentler of both sides: beside a wall the surface is that of its own side
            slope[..., 1 - axis] = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
    steep = np.abs(slope).max(axis=-1) > STEEPEST * cell_m
    slope[steep | ~np.isfinite(surface)] = 0.0
    return slope


def gentle_surface(surface: Float32Array, cell_m: float) -> Float32Array:
    """Return the surface (rows, columns) whose slopes are nearest to those of ``surface`` without its walls, smoothed,
    by least squares; its mean is 0.

    The normal equations are Poisson's with the slopes' divergence, and nothing flows out at the border: the cosine
    transform solves them (Frankot & Chellappa 1988, as a least-squares problem with natural boundaries).
    """
    slope = slopes_without_walls(surface, cell_m).astype(np.float64)
    east, south = (gaussian_filter(slope[..., k], SMOOTH_CELLS, mode="nearest") for k in (0, 1))
    rows, columns = surface.shape
    divergence = np.zeros(surface.shape)
    for rise, axis in ((east, 1), (south, 0)):
        between = 0.5 * (np.delete(rise, 0, axis) + np.delete(rise, -1, axis))
        divergence += np.diff(between, axis=axis, prepend=0.0, append=0.0)
    bend = _cosines(rows)[:, None] + _cosines(columns)
    bend[0, 0] = 1.0
    spectrum = dctn(divergence, norm="ortho") / bend
    spectrum[0, 0] = 0.0
    return np.ascontiguousarray(idctn(spectrum, norm="ortho"), dtype=np.float32)


def _cosines(count: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the eigenvalues of second differences of ``count`` values with natural boundaries."""
    return np.asarray(2.0 * np.cos(np.pi * np.arange(count) / count) - 2.0)
