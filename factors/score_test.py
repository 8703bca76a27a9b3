"""What a fixed parameter of a camera would become if it were free: its score at a solution without it.

With the change J of the whitened residuals r by the parameter, every tie point following, and its product L = Aᵀ J with
the rows A of poses and border, the score s = −Jᵀ r has the covariance K = JᵀJ − Lᵀ S⁻¹ L, S the reduced system, and one
step would give the parameter s / K (Rao's score test; Förstner & Wrobel 2016, sec. 4.6.4). Control points follow as tie
points do, held by their survey; those of the border (photogram.factors.elimination.reduced) are passed over.
"""

from typing import NamedTuple

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.kernels import inverse_factor, robust
from photogram.factors.elimination.loss import KINDS
from photogram.factors.elimination.points import first_observations
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.ground_terms import GroundTerms
from photogram.projection import PARAMETERS, OrientedCameras, fill_field_slopes, project_point_jacobians, without_fields


class Step(NamedTuple):
    """What one step would give to a parameter, and its standard deviation; NaN where nothing tells it."""

    value: float
    sigma: float


def one_step(problem: Problem, state: State, covariances: Covariances, camera: int, parameter: int) -> Step:
    """Return what one step would give to a ``parameter`` of a camera that is fixed, at the solution ``state`` with its
    ``covariances``; in its own unit. The velocities that a read-out time needs are those of ``state``."""
    layout = covariances.layout
    L = np.zeros(layout.columns + layout.border)
    information, score = 0.0, 0.0
    surveyed = GroundTerms(problem, layout).linearise(state).control
    apart = problem.marks.select(~np.isin(problem.marks.point, layout.coupled))
    order = np.argsort(apart.point, kind="stable")
    for rays, X, known, loss, threshold in (
        (problem.tie, state.tie_point, np.zeros((len(state.tie_point), 3, 3)), KINDS[problem.robust_loss],
         problem.robust_threshold),
        (apart.select(order), state.control, surveyed, KINDS["none"], 1.0),
    ):  # fmt: skip
        own: FloatArray = np.asarray(state.cameras.camera[rays.photograph] == camera).astype(np.float64)
        bare = without_fields(state.cameras, rays.photograph, rays.pixel)
        more = _score(
            first_observations(rays.point, len(X)), rays.photograph, rays.pixel, bare, rays.sigma_px, rays.mixing,
            state.cameras, X,
            known, own, parameter, layout.place, layout.free_of, layout.unit, layout.columns, loss, threshold, L,
        )  # fmt: skip
        information, score = information + more[0], score + more[1]
    left = information - float(L @ covariances.solve(L[:, None])[:, 0])
    if not left > 1e-12 * max(information, 1e-300):
        return Step(float("nan"), float("nan"))
    return Step(score / left, float(1.0 / np.sqrt(left)))


def least_statistic(problem: Problem, state: State, camera: int, parameter: int) -> float:
    """Return Rao's statistic s² / K of a ``parameter`` of a camera that is fixed, χ² with one degree of freedom, at the
    solution ``state``, from the rays of tie points, which follow, as if nothing else were unknown. With all unknowns
    the score is the same and K smaller: where this is significant, the whole is. No covariances are needed."""
    rays, X = problem.tie, state.tie_point
    own: FloatArray = np.asarray(state.cameras.camera[rays.photograph] == camera).astype(np.float64)
    cameras, nothing = len(state.cameras.model), np.zeros(0)
    bare = without_fields(state.cameras, rays.photograph, rays.pixel)
    information, score = _score(
        first_observations(rays.point, len(X)), rays.photograph, rays.pixel, bare, rays.sigma_px, rays.mixing,
        state.cameras, X,
        np.zeros((len(X), 3, 3)), own, parameter, np.full(len(state.position), -1, dtype=np.int64),
        np.zeros((cameras, 3), dtype=np.int64), np.zeros_like(state.cameras.parameters), 0, KINDS[problem.robust_loss],
        problem.robust_threshold, nothing,
    )  # fmt: skip
    return float(score**2 / information) if information > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _score(
    first: IntArray, photograph: IntArray, pixel: FloatArray, bare: FloatArray, sigma: FloatArray,
    mixing: FloatArray,
    cameras: OrientedCameras, X: FloatArray, known: FloatArray, own: FloatArray, parameter: int, place_of: IntArray,
    free_of: IntArray, unit: FloatArray, columns: int, loss: int, threshold: float, L: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Add AᵀJ of all points to L (6 free + border); returns JᵀJ and −Jᵀ r. ``known`` (P, 3, 3) is what is known of
    points beside their rays, ``own`` (N,) 1 for rays of the camera, else 0."""
    longest = 1
    for p in range(len(first) - 1):
        longest = max(longest, first[p + 1] - first[p])
    A, C, B = np.zeros((longest, 2, 6)), np.zeros((longest, 2, unit.shape[1])), np.zeros((longest, 2, 3))
    J, r, V, M = np.zeros((longest, 2)), np.zeros((longest, 2)), np.zeros(12), np.zeros(6)
    information, score, coefficients = 0.0, 0.0, cameras.functions.shape[4]
    for p in range(len(first) - 1):
        V[:] = 0.0
        for a in range(3):
            for b in range(3):
                V[3 * a + b] = known[p, a, b]
        count = first[p + 1] - first[p]
        for n in range(count):
            i = first[p] + n
            u, v, depth = project_point_jacobians(cameras, photograph[i], X[p], pixel[i, 1], A[n], C[n], B[n])
            J[n], r[n] = 0.0, 0.0
            if not depth > 0.0:
                B[n] = 0.0
                continue
            if coefficients:
                c = cameras.camera[photograph[i]]
                fill_field_slopes(cameras, c, pixel[i, 0], pixel[i, 1], 1.0, coefficients, C[n], 0, PARAMETERS)
            du, dv = (u - bare[i, 0]) / sigma[i], (v - bare[i, 1]) / sigma[i]
            if len(mixing):
                dv = mixing[i, 0] * dv + mixing[i, 1] * du
                for rows in (A[n], C[n], B[n]):
                    rows[1] = mixing[i, 0] * rows[1] + mixing[i, 1] * rows[0]
            s = np.sqrt(robust(du * du + dv * dv, loss, threshold)[1])
            for k in range(2):
                r[n, k] = s * (du if k == 0 else dv)
                for a in range(6):
                    A[n, k, a] *= s / sigma[i]
                for a in range(unit.shape[1]):
                    C[n, k, a] *= s / sigma[i]
                for a in range(3):
                    B[n, k, a] *= s / sigma[i]
                J[n, k] = own[i] * C[n, k, parameter]
                for a in range(3):
                    V[9 + a] += B[n, k, a] * J[n, k]
                    for b in range(3):
                        V[3 * a + b] += B[n, k, a] * B[n, k, b]
        if not inverse_factor(V, 0.0, M):
            continue
        y0, y1, y2 = M[0] * V[9], M[1] * V[9] + M[2] * V[10], M[3] * V[9] + M[4] * V[10] + M[5] * V[11]
        x0, x1, x2 = M[0] * y0 + M[1] * y1 + M[3] * y2, M[2] * y1 + M[4] * y2, M[5] * y2
        for a in range(3):
            xa = x0 if a == 0 else (x1 if a == 1 else x2)
            information += xa * (known[p, a, 0] * x0 + known[p, a, 1] * x1 + known[p, a, 2] * x2)
        for n in range(count):
            i = photograph[first[p] + n]
            at, c = 6 * place_of[i], cameras.camera[i]
            for k in range(2):
                j = J[n, k] - B[n, k, 0] * x0 - B[n, k, 1] * x1 - B[n, k, 2] * x2
                information += j * j
                score -= J[n, k] * r[n, k]  # points and cameras rest at the solution
                if at >= 0:
                    for a in range(6):
                        L[at + a] += A[n, k, a] * j
                for t in range(free_of[c, 1]):
                    q = free_of[c, 3 + t]
                    L[columns + free_of[c, 0] + t] += C[n, k, q] * unit[c, q] * j
    return information, score
