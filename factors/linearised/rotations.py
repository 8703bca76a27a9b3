"""Rotations in their tangent: the Jacobians of the exponential of SO(3), and attitudes that are off by a common error.

The right Jacobian J at a rotation vector ρ is Exp(ρ + δ) = Exp(ρ) Exp(J δ) (Chirikjian 2012, sec. 10.86; Forster et al.
2017, eq. 8–9).
"""

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray

SMALL_RAD = 1e-4
"""Angle below which the Jacobians of SO(3) are taken from their series."""
UP = np.array([0.0, 0.0, 1.0])


def cross(vector: FloatArray) -> FloatArray:
    """Return the matrices (n, 3, 3) of the cross products with vectors (n, 3)."""
    matrix = np.zeros((len(vector), 3, 3))
    x, y, z = vector.T
    matrix[:, 0, 1], matrix[:, 1, 0] = -z, z
    matrix[:, 0, 2], matrix[:, 2, 0] = y, -y
    matrix[:, 1, 2], matrix[:, 2, 1] = -x, x
    return matrix


def right_jacobian(vector: FloatArray) -> FloatArray:
    """Return the right Jacobians of SO(3) (n, 3, 3) at rotation vectors (n, 3), rad."""
    angle = np.linalg.norm(vector, axis=1)
    a = np.where(angle < SMALL_RAD, 1.0, angle)
    first = np.where(angle < SMALL_RAD, 0.5 - angle**2 / 24.0, (1.0 - np.cos(a)) / a**2)
    second = np.where(angle < SMALL_RAD, 1.0 / 6.0 - angle**2 / 120.0, (a - np.sin(a)) / a**3)
    V = cross(vector)
    return np.asarray(np.eye(3) - first[:, None, None] * V + second[:, None, None] * (V @ V))


def inverse_right_jacobian(vector: FloatArray) -> FloatArray:
    """Return the inverses (n, 3, 3) of the right Jacobians of SO(3) at rotation vectors (n, 3), rad, shorter than π."""
    angle = np.linalg.norm(vector, axis=1)
    a = np.where(angle < SMALL_RAD, 1.0, angle)
    second = np.where(angle < SMALL_RAD, 1.0 / 12.0 + angle**2 / 720.0, 1.0 / a**2 - 0.5 / (a * np.tan(0.5 * a)))
    V = cross(vector)
    return np.asarray(np.eye(3) + 0.5 * V + second[:, None, None] * (V @ V))


def attitude_misfits(
    measured: FloatArray, rotation_world_from_camera: FloatArray, bias: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return e = Log(R̃ᵀ Exp(h z) R Exp(b)) (n, 3) of measured attitudes R̃ (n, 3, 3) and rotations R, and its Jacobians
    on the poses' turns (n, 3, 3) and on the ``bias`` (n, 3, d).

    The bias (n, d) is the boresight b, with h behind it where the compass counts, or nothing at all.
    """
    boresight = bias[:, :3] if bias.shape[1] else np.zeros((len(bias), 3))
    B = Rotation.from_rotvec(boresight).as_matrix()
    turned = rotation_world_from_camera @ B
    predicted, columns = turned, [right_jacobian(boresight)][: bias.shape[1]]
    if bias.shape[1] > 3:
        predicted = Rotation.from_rotvec(bias[:, 3:] * UP).as_matrix() @ turned
        columns.append(turned[:, 2, :, None])
    e = Rotation.from_matrix(np.swapaxes(measured, 1, 2) @ predicted).as_rotvec()
    inverse = inverse_right_jacobian(e)
    of_bias = np.concatenate([np.zeros((len(e), 3, 0)), *columns], axis=2)
    return e, inverse @ np.swapaxes(B, 1, 2), inverse @ of_bias
