"""Tie points eliminated from the normal equations by their 3 × 3 Schur complements.

With the normal equations [U W; Wᵀ V] of cameras and tie points (Triggs et al. 2000, sec. 6.1), the reduced system of
the cameras is S = U − Σ_p W_p V_p⁻¹ W_pᵀ, and the covariance of a tie point is V_p⁻¹ + V_p⁻¹ W_pᵀ S⁻¹ W_p V_p⁻¹
(Förstner & Wrobel 2016, sec. 15.4). W_p has rows only for the photographs and cameras that see the point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from photogram.factors.reprojection import Linearisation, Observations
from photogram.survey import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Columns:
    """Where variables sit in the reduced system.

    ``pose`` (photographs,) first column of each pose (6 columns), ``calibration`` (cameras, 8) column of each
    parameter, −1 where it is fixed; ``size`` of the system.
    """

    pose: IntArray
    calibration: IntArray
    size: int


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _inverse3(V: FloatArray, inverse: FloatArray) -> bool:
    a, b, c, d, e, f = V[0, 0], V[0, 1], V[0, 2], V[1, 1], V[1, 2], V[2, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * A + b * B + c * C
    if not determinant > 1e-14 * a * d * f:
        return False
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = A / determinant, B / determinant, C / determinant
    inverse[1, 1], inverse[1, 2] = (a * f - c * c) / determinant, (b * c - a * e) / determinant
    inverse[2, 2] = (a * d - b * b) / determinant
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
    return True


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _gather(
    i: int, photograph: IntArray, camera: IntArray, pose_column: IntArray, calibration_column: IntArray,
    J_pose: FloatArray, J_camera: FloatArray, column: IntArray, J: FloatArray,
) -> int:  # fmt: skip
    """Collect the columns and the Jacobian (2, n) of observation i on the reduced variables; returns n."""
    n = 6
    for k in range(6):
        column[k] = pose_column[photograph[i]] + k
        J[0, k], J[1, k] = J_pose[i, 0, k], J_pose[i, 1, k]
    for k in range(8):
        if calibration_column[camera[i], k] >= 0:
            column[n] = calibration_column[camera[i], k]
            J[0, n], J[1, n] = J_camera[i, 0, k], J_camera[i, 1, k]
            n += 1
    return n


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _eliminate(
    first: IntArray, photograph: IntArray, camera: IntArray, pose_column: IntArray, calibration_column: IntArray,
    J_pose: FloatArray, J_camera: FloatArray, J_point: FloatArray, S: FloatArray, V_inverse: FloatArray,
) -> int:  # fmt: skip
    """Add every tie point's reduced information to S; returns the first point that cannot be intersected, −1 when all
    can."""
    longest = 0
    for p in range(len(first) - 1):
        longest = max(longest, first[p + 1] - first[p])
    column = np.empty((longest, 14), dtype=np.int64)
    W = np.empty((longest, 14, 3))
    size = np.empty(longest, dtype=np.int64)
    J = np.empty((2, 14))
    V = np.empty((3, 3))
    for p in range(len(first) - 1):
        V[:] = 0.0
        for i in range(first[p], first[p + 1]):
            o = i - first[p]
            n = _gather(i, photograph, camera, pose_column, calibration_column, J_pose, J_camera, column[o], J)
            size[o] = n
            for a in range(3):
                for b in range(3):
                    V[a, b] += J_point[i, 0, a] * J_point[i, 0, b] + J_point[i, 1, a] * J_point[i, 1, b]
            for a in range(n):
                for b in range(3):
                    W[o, a, b] = J[0, a] * J_point[i, 0, b] + J[1, a] * J_point[i, 1, b]
                for b in range(n):
                    S[column[o, a], column[o, b]] += J[0, a] * J[0, b] + J[1, a] * J[1, b]
        if not _inverse3(V, V_inverse[p]):
            return p
        for o in range(first[p + 1] - first[p]):
            for a in range(size[o]):
                for q in range(first[p + 1] - first[p]):
                    for b in range(size[q]):
                        total = 0.0
                        for k in range(3):
                            for m in range(3):
                                total += W[o, a, k] * V_inverse[p, k, m] * W[q, b, m]
                        S[column[o, a], column[q, b]] -= total
    return -1


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _point_covariances(
    first: IntArray, photograph: IntArray, camera: IntArray, pose_column: IntArray, calibration_column: IntArray,
    J_pose: FloatArray, J_camera: FloatArray, J_point: FloatArray, V_inverse: FloatArray,
    covariance: FloatArray, result: FloatArray,
) -> None:  # fmt: skip
    column, column2 = np.empty(14, dtype=np.int64), np.empty(14, dtype=np.int64)
    J, J2 = np.empty((2, 14)), np.empty((2, 14))
    M = np.empty((2, 2))
    for p in range(len(first) - 1):
        middle = np.zeros((3, 3))
        for i in range(first[p], first[p + 1]):
            n = _gather(i, photograph, camera, pose_column, calibration_column, J_pose, J_camera, column, J)
            for j in range(first[p], first[p + 1]):
                m = _gather(j, photograph, camera, pose_column, calibration_column, J_pose, J_camera, column2, J2)
                M[:] = 0.0
                for a in range(n):
                    for b in range(m):
                        s = covariance[column[a], column2[b]]
                        for r in range(2):
                            for t in range(2):
                                M[r, t] += J[r, a] * s * J2[t, b]
                middle += J_point[i].T @ M @ J_point[j]
        result[p] = V_inverse[p] + V_inverse[p] @ middle @ V_inverse[p]


def first_observations(point: IntArray, count: int) -> IntArray:
    """Return the index (count + 1,) of each point's first observation in the sorted array ``point`` (N,)."""
    return np.searchsorted(point, np.arange(count + 1)).astype(np.int64)


def eliminate_tie_points(
    observations: Observations, linear: Linearisation, points: int, columns: Columns, S: FloatArray
) -> tuple[FloatArray, int]:
    """Add the reduced information of all tie points to S (size, size), in place.

    Observations sorted by point, their Jacobians weighted and, for calibration, in the units of the reduced system.
    Returns the inverses (points, 3, 3) of the points' own normal matrices and the first point that cannot be
    intersected, −1 when all can.
    """
    V_inverse = np.zeros((points, 3, 3))
    first = first_observations(observations.point, points)
    o = observations
    failed = _eliminate(
        first,
        o.photograph,
        o.camera,
        columns.pose,
        columns.calibration,
        linear.pose,
        linear.calibration,
        linear.point,
        S,
        V_inverse,
    )
    return V_inverse, int(failed)


def tie_point_covariances(
    observations: Observations,
    linear: Linearisation,
    columns: Columns,
    V_inverse: FloatArray,
    covariance: NDArray[np.float64],
) -> FloatArray:
    """Return the covariance (points, 3, 3) in m² of every tie point, from the covariance (size, size) of the reduced
    system."""
    result = np.empty_like(V_inverse)
    first = first_observations(observations.point, len(V_inverse))
    o = observations
    _point_covariances(
        first, o.photograph, o.camera, columns.pose, columns.calibration, linear.pose, linear.calibration, linear.point,
        V_inverse, np.ascontiguousarray(covariance), result,
    )  # fmt: skip
    return result
