"""Velocities that photographs show themselves, beside what the positions of their neighbours tell.

Between two exposures nothing flies straight: a velocity from the positions before and after is off by decimetres a
second. A photograph read by a rolling shutter shows its own velocity, most of it along and across its rows. It is
estimated from the prior that the neighbours give: between rounds while all else rests, before the last one with
everything else (``factors.joint_velocities``). What the neighbours' velocities scatter by is the standard deviation σ
that makes the measurements of all photographs most likely, the points at rest: with the normal equations S_i v = h_i of
their departures, the poses eliminated,

    −2 log L(σ) = Σ_i log det(I + σ² S_i) − h_iᵀ (S_i + I/σ²)⁻¹ h_i

(marginal likelihood, empirical Bayes; Efron & Morris 1973). Where σ = 0 is as likely the neighbours are right.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.compilation import njit
from photogram.factors.elimination.kernels import robust
from photogram.factors.elimination.loss import KINDS
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.joint_velocities import Together, joint_velocities, readout_sigmas
from photogram.projection import (
    READOUT,
    OrientedCameras,
    project_point_jacobians,
    share_at_row,
    without_fields,
)
from photogram.results import SIGNIFICANCE

LEAST_M_S, MOST_M_S = 1e-3, 10.0
"""Between which the standard deviation of the neighbours' velocities is looked for."""

UNKNOWNS = 9


@njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(
    photograph: IntArray, point: IntArray, pixel: FloatArray, bare: FloatArray, sigma: FloatArray,
    cameras: OrientedCameras, X: FloatArray, loss: int, threshold: float,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return the normal equations (N, 9, 9) and (N, 9) of pose and velocity of each photograph, its points at rest."""
    matrix, right = np.zeros((len(cameras.camera), UNKNOWNS, UNKNOWNS)), np.zeros((len(cameras.camera), UNKNOWNS))
    A, B = np.zeros((2, 6)), np.zeros((2, 3))
    row = np.zeros(UNKNOWNS)
    C, residual = np.zeros((2, cameras.parameters.shape[1])), np.zeros(2)
    for i in range(len(photograph)):
        p = photograph[i]
        c = cameras.camera[p]
        u, v, depth = project_point_jacobians(cameras, p, X[point[i]], pixel[i, 1], A, C, B)
        if not depth > 0.0:
            continue
        residual[0], residual[1] = (u - bare[i, 0]) / sigma[i], (v - bare[i, 1]) / sigma[i]
        weight = robust(residual[0] ** 2 + residual[1] ** 2, loss, threshold)[1]
        way = -cameras.parameters[c, READOUT] * share_at_row(pixel[i, 1], cameras.size_px[c, 1])
        for k in range(2):
            for a in range(6):
                row[a] = A[k, a] / sigma[i]
            for a in range(3):
                row[6 + a] = way * B[k, a] / sigma[i]
            for a in range(UNKNOWNS):
                right[p, a] -= weight * row[a] * residual[k]
                for b in range(UNKNOWNS):
                    matrix[p, a, b] += weight * row[a] * row[b]
    return matrix, right


def _of_velocity(matrix: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations (N, 3, 3) and (N, 3) of the velocities, poses eliminated; zero of a photograph whose
    own points do not hold its pose."""
    S, h = np.zeros((len(matrix), 3, 3)), np.zeros((len(matrix), 3))
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", matrix), np.finfo(float).tiny))
    unit = matrix / (scale[:, :, None] * scale[:, None, :])
    determined = np.linalg.eigvalsh(unit[:, :6, :6])[:, 0] > 1e-10
    pose, both = matrix[determined, :6, :6], matrix[determined, :6, 6:]
    solved = np.linalg.solve(pose, np.concatenate([both, right[determined, :6, None]], axis=2))
    S[determined] = matrix[determined, 6:, 6:] - np.swapaxes(both, 1, 2) @ solved[:, :, :3]
    h[determined] = right[determined, 6:] - (np.swapaxes(both, 1, 2) @ solved[:, :, 3:])[..., 0]
    return S, h


def scatter_m_s(S: FloatArray, h: FloatArray) -> float:
    """Return the standard deviation, m/s, of departures whose normal equations are S (N, 3, 3) and h (N, 3); zero where
    it is not significant."""

    def less_than_zero(logarithm: float) -> float:
        variance = float(np.exp(2.0 * logarithm))
        explained = np.linalg.solve(S + np.eye(3) / variance, h[..., None])[..., 0]
        return float(np.sum(np.linalg.slogdet(np.eye(3) + variance * S)[1]) - np.sum(h * explained))

    bounds = float(np.log(LEAST_M_S)), float(np.log(MOST_M_S))
    minimum = minimize_scalar(less_than_zero, bounds=bounds, method="bounded")
    # On the bound of what a standard deviation can be, half of chance lies below it.
    return float(np.exp(minimum.x)) if -minimum.fun > chi2.isf(2.0 * SIGNIFICANCE, 1) else 0.0


@dataclass(frozen=True, eq=False)
class Departures:
    """How the photographs ``free`` (N,) depart from the velocities ``expected_m_s`` (N, 3) of neighbours and tags:
    normal equations ``matrix`` (F, 3, 3) and ``right`` (F, 3) of each, poses eliminated and points at rest, and what
    they scatter by, m/s, zero where that is not significant."""

    expected_m_s: FloatArray
    free: BoolArray
    matrix: FloatArray
    right: FloatArray
    scatter_m_s: float

    def one_by_one(self) -> FloatArray:
        """Return the most likely velocities (N, 3) in the world, m/s, of each photograph while all else rests."""
        if self.scatter_m_s == 0.0:
            return self.expected_m_s
        velocity, prior = self.expected_m_s.copy(), np.eye(3) / self.scatter_m_s**2
        velocity[self.free] += np.linalg.solve(self.matrix + prior, self.right[..., None])[..., 0]
        return velocity

    def together(self, problem: Problem, state: State, least_s: float = 0.0) -> Together:
        """Return the most likely velocities in the world, m/s, at a minimum, estimated with everything else, and the
        read-out times that go with them, looked for from ``least_s`` on. Raises IndeterminateError or SingularError
        where that is not determined."""
        if self.scatter_m_s == 0.0:
            return Together(self.expected_m_s, state.parameters[:, READOUT])
        return joint_velocities(problem, state, self.expected_m_s, self.free, self.scatter_m_s, self.matrix, least_s)

    def readout_sigmas(self, problem: Problem, state: State) -> FloatArray | None:
        """Return the standard deviations (C,) of the read-out times, s, with the velocities as unknowns, None where
        these are as expected. Raises IndeterminateError or SingularError where something else is not determined."""
        if self.scatter_m_s == 0.0:
            return None
        return readout_sigmas(problem, state, self.free, self.scatter_m_s, self.matrix)


def departures(problem: Problem, state: State, expected_m_s: FloatArray, free: BoolArray) -> Departures:
    """Return how photographs depart from the velocities ``expected_m_s`` (N, 3), where they may (``free``), at the end
    of a round."""
    tie, cameras = problem.tie, state.cameras
    bare = without_fields(cameras, tie.photograph, tie.pixel)
    matrix, right = _normal_equations(
        tie.photograph, tie.point, tie.pixel, bare, tie.sigma_px, cameras, state.tie_point,
        KINDS[problem.robust_loss], problem.robust_threshold,
    )  # fmt: skip
    S, h = _of_velocity(matrix[free], right[free])
    h += np.einsum("nij,nj->ni", S, cameras.velocity[free] - expected_m_s[free])
    return Departures(expected_m_s, free, S, h, scatter_m_s(S, h))
