"""Compiled loops over the rays of points for their covariances.

Work rows are those of photogram.factors.elimination.kernels.
"""

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.factors.elimination.kernels import (
    CALIBRATION,
    eliminate_coordinates,
    inverse_factor,
    linearise_point,
    mix_rows,
)
from photogram.projection import OrientedCameras


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def two_dots(A: FloatArray, at: int, J: FloatArray, o: int) -> tuple[float, float]:
    """Products of a ray's two Jacobian rows on its pose with six elements of A from ``at`` on."""
    u = np.uint64(at)
    a0, a1, a2 = A[u], A[u + np.uint64(1)], A[u + np.uint64(2)]
    a3, a4, a5 = A[u + np.uint64(3)], A[u + np.uint64(4)], A[u + np.uint64(5)]
    p, q = o, o + 1
    first = J[p, 0] * a0 + J[p, 1] * a1 + J[p, 2] * a2 + J[p, 3] * a3 + J[p, 4] * a4 + J[p, 5] * a5
    return first, J[q, 0] * a0 + J[q, 1] * a1 + J[q, 2] * a2 + J[q, 3] * a3 + J[q, 4] * a4 + J[q, 5] * a5


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def add_pair(o: int, s: int, J: FloatArray, A: FloatArray, at: int, H: FloatArray) -> None:
    """Add Z_oᵀ (A_o C A_sᵀ) Z_s to H, and its transpose; half of both where the rays are the same.

    C is the block of A, column by column, that begins at ``at``.
    """
    v00, v01, v10, v11 = 0.0, 0.0, 0.0, 0.0
    for c in range(6):
        r0, r1 = two_dots(A, at + 6 * c, J, o)
        v00 += r0 * J[s, c]
        v01 += r0 * J[s + 1, c]
        v10 += r1 * J[s, c]
        v11 += r1 * J[s + 1, c]
    half = 0.5 if o == s else 1.0
    for m in range(3):
        t0 = half * (v00 * J[s, 10 + m] + v01 * J[s + 1, 10 + m])
        t1 = half * (v10 * J[s, 10 + m] + v11 * J[s + 1, 10 + m])
        for k in range(3):
            product = J[o, 10 + k] * t0 + J[o + 1, 10 + k] * t1
            H[k, m] += product
            H[m, k] += product


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def covariance_in_world(number: int, M: FloatArray, H: FloatArray, result: FloatArray) -> None:
    """Set a point's covariance L⁻ᵀ (I + H) L⁻¹; H is used up."""
    for k in range(3):
        H[k, k] += 1.0
    for m in range(3):
        h0, h1, h2 = H[0, m], H[1, m], H[2, m]
        H[0, m], H[1, m], H[2, m] = M[0] * h0 + M[1] * h1 + M[3] * h2, M[2] * h1 + M[4] * h2, M[5] * h2
    for k in range(3):
        result[number, k, 0] = M[0] * H[k, 0] + M[1] * H[k, 1] + M[3] * H[k, 2]
        result[number, k, 1] = M[2] * H[k, 1] + M[4] * H[k, 2]
        result[number, k, 2] = M[5] * H[k, 2]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def covariances_of_points(
    begin: int, end: int, first: IntArray, index: IntArray, photograph: IntArray, measured: FloatArray,
    mixing: FloatArray, bare: FloatArray, cameras: OrientedCameras, unit: FloatArray, X: FloatArray, place_of: IntArray,
    free_of: IntArray, loss: int, threshold: float, least: float, prior: FloatArray,
    block_at: IntArray, pairs: FloatArray, own: FloatArray, T: FloatArray, border: FloatArray, result: FloatArray,
) -> int:  # fmt: skip
    """Fill the covariances (P, 3, 3) of a range of points; returns the first that is singular, −1 when none is.

    ``pairs`` (flat) the blocks of the inverse of the poses' matrix, numbered by ``block_at``, ``own`` (free, 6, 6) its
    diagonal blocks, ``T`` (free, border, 6), flat.
    """
    longest, n = 1, len(border)
    for p in range(begin, end):
        longest = max(longest, first[p + 1] - first[p])
    J, V, M = np.zeros((2 * longest, CALIBRATION + unit.shape[1])), np.zeros(12), np.zeros(6)
    G, H = np.zeros((3, n)), np.zeros((3, 3))
    for p in range(begin, end):
        for k in range(12):
            V[k] = prior[index[p], k] if len(prior) else 0.0
        linearise_point(
            first[p], first[p + 1], photograph, measured, bare, cameras, unit, X, index[p], free_of, loss, threshold,
            least, J, V,
        )  # fmt: skip
        if len(mixing):
            mix_rows(first[p], first[p + 1], mixing, prior[index[p]], J, V)
        if not inverse_factor(V, 0.0, M):
            return int(index[p])
        # In the coordinates L⁻¹ of the point every Jacobian on it is Z.
        eliminate_coordinates(2 * (first[p + 1] - first[p]), M, J)
        G[:], H[:] = 0.0, 0.0
        for i in range(first[p], first[p + 1]):
            o, at, camera = 2 * (i - first[p]), place_of[photograph[i]], cameras.camera[photograph[i]]
            for k in range(3):
                for t in range(free_of[camera, 1]):
                    value = J[o, 10 + k] * J[o, CALIBRATION + t] + J[o + 1, 10 + k] * J[o + 1, CALIBRATION + t]
                    G[k, free_of[camera, 0] + t] += value
            if at < 0:
                continue
            for t in range(n):
                r0, r1 = two_dots(T, 6 * (n * at + t), J, o)
                for k in range(3):
                    G[k, t] -= J[o, 10 + k] * r0 + J[o + 1, 10 + k] * r1
            for other in range(first[p], i + 1):
                low = place_of[photograph[other]]
                if low < 0:
                    continue
                if low == at:
                    add_pair(o, 2 * (other - first[p]), J, own, 36 * at, H)
                else:
                    add_pair(o, 2 * (other - first[p]), J, pairs, 36 * block_at[low, at - low], H)
        for k in range(3):
            for s in range(n):
                value = 0.0
                for t in range(n):
                    value += border[s, t] * G[k, t]
                for m in range(3):
                    H[k, m] += value * G[m, s]
        covariance_in_world(index[p], M, H, result)
    return -1
