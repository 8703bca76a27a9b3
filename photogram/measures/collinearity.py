"""Whether points lie in one line, about which they leave a turn open."""

import numpy as np

from photogram.arrays import FloatArray

COLLINEAR = 0.02
"""Second over first principal extent of points that lie in one line."""


def collinear(points: FloatArray) -> bool:
    """Return whether points (N, 3) lie so nearly in one line that they leave a turn about it open, or are too few."""
    if len(points) < 3:
        return True
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(singular[1] < COLLINEAR * singular[0])
