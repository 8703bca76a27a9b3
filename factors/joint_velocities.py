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

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.compilation import njit
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
    matrices ``inverse`` (P, 3, 3) of the points; whose each observation is; how many photographs there are."""

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
    photographs: int

    def right(self) -> FloatArray:
        """Return −Jᵀ r (N, 3)."""
        return -_summed(self.velocity, self.residual, self.of_photograph, self.photographs)

    def product(self, velocity: FloatArray) -> FloatArray:
        """Return the normal matrix without the prior times velocities (N, 3)."""
        moved = _applied(self.velocity, velocity, self.of_photograph)
        changed = moved - self._by_cameras(self._cameras(self._without_points(moved)))
        return _summed(self.velocity, self._without_points(changed), self.of_photograph, self.photographs)

    def _without_points(self, values: FloatArray) -> FloatArray:
        """Return Q times values (M, 2)."""
        pull = _summed(self.point, values, self.of_point, len(self.inverse))
        return values - _applied(self.point, (self.inverse @ pull[..., None])[..., 0], self.of_point)

    def _cameras(self, values: FloatArray) -> FloatArray:
        """Return S⁻¹ Aᵀ times values (M, 2)."""
        layout = self.found.layout
        columns = np.zeros((layout.columns + layout.border, 1))
        own = _summed(self.pose, values, self.of_photograph, self.photographs)
        columns[: layout.columns, 0] = own[layout.photograph_at].ravel()
        owner, parameter = layout.free_parameters
        shared = _summed(self.calibration, values, self.of_camera, len(layout.unit))
        columns[layout.columns : layout.columns + len(owner), 0] = shared[owner, parameter]
        return self.found.solve(columns)[:, 0]

    def _by_cameras(self, change: FloatArray) -> FloatArray:
        """Return A times a change of poses and border."""
        layout = self.found.layout
        owner, parameter = layout.free_parameters
        pose = np.zeros((self.photographs, 6))
        pose[layout.photograph_at] = change[: layout.columns].reshape(-1, 6)
        lens = np.zeros_like(layout.unit)
        lens[owner, parameter] = change[layout.columns : layout.columns + len(owner)]
        return _applied(self.pose, pose, self.of_photograph) + _applied(self.calibration, lens, self.of_camera)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _sum_into(rows: FloatArray, values: FloatArray, of: IntArray, out: FloatArray) -> None:
    for m in range(len(of)):
        for r in range(2):
            for k in range(rows.shape[2]):
                out[of[m], k] += rows[m, r, k] * values[m, r]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _apply(rows: FloatArray, changes: FloatArray, of: IntArray, out: FloatArray) -> None:
    for m in range(len(of)):
        for r in range(2):
            total = 0.0
            for k in range(rows.shape[2]):
                total += rows[m, r, k] * changes[of[m], k]
            out[m, r] = total


def _summed(rows: FloatArray, values: FloatArray, of: IntArray, count: int) -> FloatArray:
    """Return the sums (count, k) of rows (M, 2, k) times values (M, 2), by whose (M,) they are."""
    out = np.zeros((count, rows.shape[2]))
    _sum_into(rows, values, of, out)
    return out


def _applied(rows: FloatArray, changes: FloatArray, of: IntArray) -> FloatArray:
    """Return rows (M, 2, k) times the changes (N, k) of whose (M,) they are."""
    out = np.empty(rows.shape[:2])
    _apply(rows, changes, of, out)
    return out


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
    normal = np.stack([_summed(point, point[..., k], tie.point, len(state.tie_point)) for k in range(3)], axis=1)
    normal[np.bincount(tie.point, minlength=len(normal)) < 2] = np.eye(3)
    return _System(
        found, way[:, None, None] * point, point, root[:, None, None] * linear.pose,
        root[:, None, None] * linear.calibration * found.layout.unit[linear.camera][:, None],
        root[:, None] * linear.residual, np.asarray(np.linalg.inv(normal)), tie.point, tie.photograph, linear.camera,
        len(cameras.camera),
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
