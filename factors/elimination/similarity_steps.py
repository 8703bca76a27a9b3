"""Rotation and scale of a whole block in a step, applied exactly.

Position, rotation and scale of a block may be held by little: GNSS positions of a few metres, a focal length of a few
per cent. A linear step rotates it by ω × X, which enlarges it by ω²/2 as well, and that contradicts every photograph:
steps stay short, dozens of them along a curved valley. Here the rotation w and the scale m that are nearest to the
steps of all photographs (centres C by dC, rotations by ω in the world, c the mean centre)

    min Σ |dC − t − w × (C − c) − m (C − c)|² + ℓ² Σ |ω − w|²,   ℓ² the mean of |C − c|²

are applied exactly: of X − c they make (1 + m) Exp(w) (X − c), a linear step X − c + w × (X − c) + m (X − c), and
the difference is added to the steps of centres and points. It is of the second order, so that the minimum and what the
linear model predicts are the same (a retraction: Absil, Mahony & Sepulchre 2008, sec. 4.1). Far from the minimum, where
wrong measurements pull at everything, steps stay linear.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray

LARGEST_SCALE = 0.5
"""A step beyond this share of the size is no small change of scale; it is taken as it is."""


def _cross(w: FloatArray) -> FloatArray:
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def bend_of(position: FloatArray, moved_m: FloatArray, turned_rad: FloatArray) -> FloatArray:
    """Return what is to be added to a linear step, as the matrix and the centre (4, 3) that ``bent`` takes.

    ``position`` (N, 3) are the centres before it, ``moved_m`` (N, 3) and ``turned_rad`` (N, 3) the steps of centres and
    rotations, all in the world. Zero where these do not determine a rotation.
    """
    bend = np.zeros((4, 3))
    if len(position) < 2:
        return bend
    centre = position.mean(axis=0)
    x, d = position - centre, moved_m - moved_m.mean(axis=0)
    size = float(np.sum(x**2))
    if not size > 0.0:
        return bend
    normal = 2.0 * size * np.eye(3) - x.T @ x
    w = np.linalg.solve(normal, np.cross(x, d).sum(axis=0) + size * turned_rad.mean(axis=0))
    m = float(np.sum(x * d)) / size
    if abs(m) > LARGEST_SCALE:
        return bend
    bend[:3] = (1.0 + m) * Rotation.from_rotvec(w).as_matrix() - (1.0 + m) * np.eye(3) - _cross(w)
    bend[3] = centre
    return bend


def bent(bend: FloatArray, X: FloatArray) -> FloatArray:
    """Return what is added to the linear steps of places X (N, 3), as they are before."""
    return np.asarray((X - bend[3]) @ bend[:3].T)
