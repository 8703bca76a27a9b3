"""Errors that neighbours share, because the windows they were matched in share pixels.

Two windows of width L, d apart, have the share (1 − |dx|/L)(1 − |dy|/L) of their pixels in common, and so much do their
errors correlate. Summed over all neighbours that makes an area L² in which errors count as one.
"""

from functools import lru_cache

import numpy as np
from scipy.ndimage import convolve1d
from scipy.spatial.distance import pdist

from photogram.arrays import FloatArray

_DISC_POINTS = 600


def correlation_weights(correlation_m: float, step_m: float) -> FloatArray:
    """Return the correlations (2 K + 1,) along a row of cells ``step_m`` apart, from −K to K steps; 1 for itself."""
    reach = max(int(np.ceil(correlation_m / step_m)) - 1, 0)
    return np.asarray(np.maximum(1.0 - np.abs(np.arange(-reach, reach + 1)) * step_m / correlation_m, 0.0))


def reach_cells(correlation_m: float, cell_m: float) -> int:
    """Return how many cells away errors still correlate."""
    return len(correlation_weights(correlation_m, cell_m)) // 2


def gathered(weighted: FloatArray, correlation_m: float, cell_m: float) -> FloatArray:
    """Return at each cell (..., rows, columns) the sum of ρ times the values of all cells around; none lie beyond the
    array."""
    weights = correlation_weights(correlation_m, cell_m)
    across = convolve1d(weighted, weights, axis=-1, mode="constant")
    return np.asarray(convolve1d(across, weights, axis=-2, mode="constant"))


@lru_cache(maxsize=1024)
def mean_correlation(diameter_over_correlation: float) -> float:
    """Return the mean correlation of two places anywhere in a disc, of a diameter in correlation lengths.

    By the points of a Fibonacci spiral, which are spread evenly over a disc (Vogel 1979).
    """
    n = np.arange(_DISC_POINTS) + 0.5
    radius, angle = np.sqrt(n / _DISC_POINTS) * diameter_over_correlation / 2, n * np.pi * (3.0 - np.sqrt(5.0))
    rho = [np.maximum(1.0 - pdist((radius * f(angle))[:, None]), 0.0) for f in (np.cos, np.sin)]
    pairs = 2.0 * float(np.sum(rho[0] * rho[1]))
    return (pairs + _DISC_POINTS) / _DISC_POINTS**2  # each stands for a piece of the disc, with itself too


def independent_points(count: FloatArray, radius_m: float, correlation_m: float) -> FloatArray:
    """Return how many independent points the mean of ``count`` (N,) points in a disc is worth: n / (1 + (n − 1) ρ̄).

    With fewer points than most discs have, at a rim, they lie closer together: in a disc that is smaller as well.
    """
    if correlation_m <= 0.0 or not len(count):
        return count
    filled = np.minimum(np.sqrt(count / max(float(np.median(count)), 1.0)), 1.0)
    ratio, of = np.unique(np.round(2.0 * radius_m / correlation_m * filled, 2), return_inverse=True)
    rho = np.array([mean_correlation(float(r)) for r in ratio])[of]
    return np.asarray(count / (1.0 + np.maximum(count - 1.0, 0.0) * rho))
