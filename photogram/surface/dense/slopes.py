"""Slopes of a surface without its walls, and the surface that has them: hypotheses count from it.

Windows that lie along a hillside or a roof hold what photographs show of it; a level window does not. So the heights
that are tried lie above and below a surface with the slopes of what is known so far, but without its walls: a wall in
it would tie the edge of a roof to where the coarser level has seen it. A coarser level knows no steep faces from walls;
where pairs of photographs have told them (`steep_places`), the surface has these slopes too.
"""

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter, uniform_filter

from photogram.arrays import Float32Array, FloatArray
from photogram.surface.planes import STEEPEST

STEEPEST_GENTLE = 1.0
"""What rises by more than its run is a wall where nothing but a coarser level is known; elsewhere `planes.STEEPEST`."""

SMOOTH_CELLS = 3.0
"""Standard deviation of the Gaussian that smooths the slopes of the gentle surface."""


def slopes_without_walls(
    surface: Float32Array, cell_m: float, steepest: Float32Array | float = STEEPEST_GENTLE
) -> Float32Array:
    """Return what a surface (rows, columns) rises by to the next cell to the east and to the south (rows, columns, 2);
    none where it rises by more than ``steepest`` times its run, of all or of each cell."""
    smooth = uniform_filter(np.where(np.isfinite(surface), surface, np.float32(0.0)), 3, mode="nearest")
    slope = np.zeros((*surface.shape, 2), np.float32)
    for axis in (0, 1):
        if surface.shape[axis] > 1:
            ahead = np.diff(smooth, axis=axis, append=np.take(smooth, [-1], axis=axis))
            behind = np.diff(smooth, axis=axis, prepend=np.take(smooth, [0], axis=axis))
            # the gentler of both sides: beside a wall the surface is that of its own side
            slope[..., 1 - axis] = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
    steep = np.abs(slope).max(axis=-1) > steepest * np.float32(cell_m)
    slope[steep | ~np.isfinite(surface)] = 0.0
    return slope


def surface_along(surface: Float32Array, cell_m: float, steep_m: Float32Array, share: Float32Array) -> Float32Array:
    """Return the surface (rows, columns) along which windows lie; its mean is 0.

    Its slopes are, by least squares, nearest to those of ``surface`` without its walls, smoothed, and where ground is
    steep, by the ``share`` (rows, columns) of 0 to 1 there, to all slopes of ``steep_m``. The normal equations are
    Poisson's with the slopes' divergence, and nothing flows out at the border: the cosine transform solves them
    (Frankot & Chellappa 1988, as a least-squares problem with natural boundaries).
    """
    gentle = slopes_without_walls(surface, cell_m).astype(np.float64)
    rows, columns = surface.shape
    divergence = np.zeros(surface.shape)
    for axis in (0, 1):
        rise = gaussian_filter(gentle[..., 1 - axis], SMOOTH_CELLS, mode="nearest")
        between = _between(rise, axis)
        if share.any():
            weight = _between(share, axis)
            rise = np.diff(steep_m, axis=axis)
            between += weight * (np.where(np.abs(rise) > STEEPEST * cell_m, 0.0, rise) - between)
        divergence += np.diff(between, axis=axis, prepend=0.0, append=0.0)
    bend = _cosines(rows)[:, None] + _cosines(columns)
    bend[0, 0] = 1.0
    spectrum = dctn(divergence, norm="ortho") / bend
    spectrum[0, 0] = 0.0
    return np.ascontiguousarray(idctn(spectrum, norm="ortho"), dtype=np.float32)


def _between(values: FloatArray | Float32Array, axis: int) -> FloatArray:
    """Return the means of neighbours along an axis."""
    return np.asarray(0.5 * (np.delete(values, 0, axis) + np.delete(values, -1, axis)), dtype=np.float64)


def _cosines(count: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the eigenvalues of second differences of ``count`` values with natural boundaries."""
    return np.asarray(2.0 * np.cos(np.pi * np.arange(count) / count) - 2.0)
