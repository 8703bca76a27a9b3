"""Velocities of photographs under a rolling shutter, estimated together with everything else.

With the rows J of the velocities, B of the points and A of poses and border, Q = I − B (BᵀB)⁻¹ Bᵀ and the reduced
system S, the departures δ from the velocities of a solution, with the prior of standard deviation σ, have the normal
equations

    (Jᵀ Q J − Jᵀ Q A S⁻¹ Aᵀ Q J + I/σ²) δ = −Jᵀ r + (v₀ − v)/σ²

v₀ those expected, v those of the solution (Schur complement; Förstner & Wrobel 2016, sec. 15.2). The matrix is never
formed: conjugate gradients with the photographs' own blocks as preconditioner need a dozen products (Nocedal & Wright
2006, sec. 5.1). Photograph by photograph, the points at rest, the same is reached only after dozens of rounds. What
marks of control points tell of velocities is passed over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.reprojection import linearise, residuals
from photogram.factors.elimination.state import State
from photogram.factors.functionals import Solvable, factored
from photogram.factors.graph import Problem
from photogram.projection import READOUT, share_at_row

RELATIVE = 1e-3
"""Residual of the normal equations over their right side, in the preconditioner's norm, at which they are solved."""
MOST_PRODUCTS = 50


@dataclass(frozen=True, eq=False)
class _System:
    """Whitened rows of tie-point observations (M, 2, ·): ``velocity`` and ``point`` (M, 2, 3), ``pose`` (M, 2, 6),
    ``calibration`` (M, 2, 12 + K) in the units of the reduced system ``found``; ``residual`` (M, 2); inverse normal
    matrices ``inverse`` (P, 3, 3) of the points; whose each observation is, and sums of observations by whose they
    are."""

    found: Solvable
    velocity: FloatArray
    point: FloatArray
    pose: FloatArray
    calibration: FloatArray
    residual: FloatArray
    inverse: FloatArray
    of_point: IntArray
    of_photograph: IntArray
    of_camera: IntArray
    by_point: csr_array
    by_photograph: csr_array
    by_camera: csr_array

    def right(self) -> FloatArray:
        """Return −Jᵀ r (N, 3)."""
        return -np.asarray(self.by_photograph @ np.einsum("mri,mr->mi", self.velocity, self.residual))

    def product(self, velocity: FloatArray) -> FloatArray:
        """Return the normal matrix without the prior times velocities (N, 3)."""
        moved = np.einsum("mri,mi->mr", self.velocity, velocity[self.of_photograph])
        changed = moved - self._by_cameras(self._cameras(self._without_points(moved)))
        return np.asarray(self.by_photograph @ np.einsum("mri,mr->mi", self.velocity, self._without_points(changed)))

    def _without_points(self, values: FloatArray) -> FloatArray:
        """Return Q times values (M, 2)."""
        pull = np.asarray(self.by_point @ np.einsum("mri,mr->mi", self.point, values))
        follow = np.einsum("pij,pj->pi", self.inverse, pull)
        return np.asarray(values - np.einsum("mri,mi->mr", self.point, follow[self.of_point]))

    def _cameras(self, values: FloatArray) -> FloatArray:
        """Return S⁻¹ Aᵀ times values (M, 2)."""
        layout = self.found.layout
        columns = np.zeros((layout.columns + layout.border, 1))
        own = np.asarray(self.by_photograph @ np.einsum("mri,mr->mi", self.pose, values))
        columns[: layout.columns, 0] = own[layout.photograph_at].ravel()
        owner, parameter = layout.free_parameters
        shared = np.asarray(self.by_camera @ np.einsum("mri,mr->mi", self.calibration, values))
        columns[layout.columns : layout.columns + len(owner), 0] = shared[owner, parameter]
        return self.found.solve(columns)[:, 0]

    def _by_cameras(self, change: FloatArray) -> FloatArray:
        """Return A times a change of poses and border."""
        layout = self.found.layout
        owner, parameter = layout.free_parameters
        pose = np.zeros((self.by_photograph.shape[0], 6))
        pose[layout.photograph_at] = change[: layout.columns].reshape(-1, 6)
        lens = np.zeros_like(layout.unit)
        lens[owner, parameter] = change[layout.columns : layout.columns + len(owner)]
        moved = np.einsum("mri,mi->mr", self.pose, pose[self.of_photograph])
        return np.asarray(moved + np.einsum("mri,mi->mr", self.calibration, lens[self.of_camera]))


def _system(problem: Problem, state: State) -> _System:
    cameras = state.cameras
    before: BoolArray = np.asarray(np.isfinite(residuals(problem.tie, cameras, state.tie_point)).all(axis=1))
    tie = problem.tie.select(before)  # a draft may have points behind a camera
    linear = linearise(tie, cameras, state.tie_point)
    root = np.sqrt(robust_terms(linear.residual, problem.robust_loss, problem.robust_threshold)[1])
    point = root[:, None, None] * linear.point
    found = factored(problem, state)
    way = -cameras.parameters[linear.camera, READOUT] * share_at_row(
        np.ascontiguousarray(tie.pixel[:, 1]), cameras.size_px[linear.camera, 1].astype(float)
    )
    m = np.arange(len(tie))

    def sums(of: IntArray, count: int) -> csr_array:
        return csr_array((np.ones(len(m)), (of, m)), shape=(count, len(m)))

    by_point = sums(tie.point, len(state.tie_point))
    normal = np.asarray(by_point @ np.einsum("mri,mrj->mij", point, point).reshape(-1, 9)).reshape(-1, 3, 3)
    normal[np.bincount(tie.point, minlength=len(normal)) < 2] = np.eye(3)
    return _System(
        found, way[:, None, None] * point, point, root[:, None, None] * linear.pose,
        root[:, None, None] * linear.calibration * found.layout.unit[linear.camera][:, None],
        root[:, None] * linear.residual, np.linalg.inv(normal), tie.point, tie.photograph, linear.camera, by_point,
        sums(tie.photograph, len(cameras.camera)), sums(linear.camera, len(found.layout.unit)),
    )  # fmt: skip


def joint_velocities(
    problem: Problem, state: State, told_m_s: FloatArray, free: BoolArray, sigma_m_s: float, own: FloatArray
) -> FloatArray:
    """Return the velocities (N, 3) in the world, m/s, of the photographs ``free`` (N,) that are most likely beside
    those ``told_m_s`` (N, 3), which scatter by ``sigma_m_s``, at ``state``, a minimum with the velocities that it has;
    the others are as told. ``own`` (F, 3, 3) are the normal matrices of the free ones, everything else at rest.

    Raises IndeterminateError or SingularError where the reduced system has no unique solution.
    """
    system, weight = _system(problem, state), sigma_m_s**-2.0
    inverse = np.linalg.inv(own + weight * np.eye(3))
    direction, x = np.zeros_like(told_m_s), np.zeros_like(told_m_s[free])
    residual = system.right()[free] + weight * (told_m_s - state.velocity)[free]
    z = np.einsum("nij,nj->ni", inverse, residual)
    p, rho = z, float(np.sum(residual * z))
    least = RELATIVE**2 * rho
    for _ in range(MOST_PRODUCTS):
        if not rho > least:
            break
        direction[free] = p
        q = system.product(direction)[free] + weight * p
        alpha = rho / float(np.sum(p * q))
        x, residual = x + alpha * p, residual - alpha * q
        z = np.einsum("nij,nj->ni", inverse, residual)
        before, rho = rho, float(np.sum(residual * z))
        p = z + (rho / before) * p
    velocity = told_m_s.copy()
    velocity[free] = state.velocity[free] + x
    return velocity
