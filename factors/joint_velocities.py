"""Velocities of photographs under a rolling shutter, estimated together with everything else.

With the rows J of the velocities, B of the points and A of poses and border, Q = I − B (BᵀB)⁻¹ Bᵀ and the reduced
system S, the departures δ from the velocities of a solution, with the prior of standard deviation σ, have the normal
equations

    (Jᵀ Q J − Jᵀ Q A S⁻¹ Aᵀ Q J + I/σ²) δ = −Jᵀ r + (v₀ − v)/σ²

v₀ those expected, v those of the solution (Schur complement; Förstner & Wrobel 2016, sec. 15.2). The matrix is never
formed: conjugate gradients with the photographs' own blocks as preconditioner need a dozen products (Nocedal & Wright
2006, sec. 5.1). Photograph by photograph, the points at rest, the same is reached only after dozens of rounds. What
marks of control points tell of velocities is passed over.

Everything else follows by −S⁻¹ Aᵀ Q J δ, the read-out times among it. Photographs show how far they moved, so that
where a read-out time goes from T to T' the departures are T / T' of those at T. The longer it is, the more do
departures of a given σ explain, noise too; it is therefore that of the marginal likelihood: with J ∝ T the logarithm
of its determinant has the derivative ν / T, ν the components of velocities that images determine (effective number of
parameters; MacKay 1992). With velocities as unknowns its variance is eᵀ S⁻¹ e, e its column, and what the departures
add to that: by orders of magnitude more than the covariance at given velocities.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.compilation import njit
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.reprojection import Observations, linearise
from photogram.factors.elimination.state import State
from photogram.factors.functionals import Solvable, factored
from photogram.factors.graph import Problem
from photogram.projection import READOUT, share_at_row

RELATIVE = 1e-3
"""Residual of the normal equations over their right side, in the preconditioner's norm, at which they are solved."""
MOST_PRODUCTS = 50
LARGEST_RATIO = 2.0
"""Of the read-out times before and after a step, either way."""
LEAST_LEFT = 0.1
"""Of the curvature of the joint likelihood in a read-out time, that the marginal one has at least."""

kernel = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)


@dataclass(frozen=True, eq=False)
class _System:
    """Whitened rows of tie-point observations (M, 2, ·), sorted by point, that of p from ``first`` (P + 1,) on:
    ``point`` (M, 2, 3), of which those of velocities are ``way`` (M,) times; ``pose`` (M, 2, 6), ``calibration``
    (M, 2, 12 + K) in the units of the reduced system ``reduced``; ``residual`` (M, 2); inverse normal matrices
    ``inverse`` (P, 3, 3) of the points; whose each observation is; how many photographs there are."""

    reduced: Solvable
    first: IntArray
    way: FloatArray
    point: FloatArray
    pose: FloatArray
    calibration: FloatArray
    residual: FloatArray
    inverse: FloatArray
    of_photograph: IntArray
    of_camera: IntArray
    photographs: int

    def right(self) -> FloatArray:
        """Return −Jᵀ r (N, 3)."""
        pulled = np.zeros((self.photographs, 3))
        _velocity_pull(self.way, self.point, self.residual, self.of_photograph, pulled)
        return -pulled

    def change(self, velocity: FloatArray) -> FloatArray:
        """Return S⁻¹ Aᵀ Q J times velocities (N, 3): the change (6 free + border,) that undoes what they do."""
        moved, layout = np.empty_like(self.residual), self.reduced.layout
        pose, lens = np.zeros((self.photographs, 6)), np.zeros((len(layout.unit), self.calibration.shape[2]))
        _move(self.way, self.point, velocity, self.of_photograph, moved)
        take_points(self.first, self.point, self.inverse, moved)
        _camera_pull(self.pose, self.calibration, moved, self.of_photograph, self.of_camera, pose, lens)
        columns = np.zeros((layout.columns + layout.border, 1))
        owner, parameter = layout.free_parameters
        columns[: layout.columns, 0] = pose[layout.photograph_at].ravel()
        columns[layout.columns : layout.columns + len(owner), 0] = lens[owner, parameter]
        return self.reduced.solve(columns)[:, 0]

    def pulled(self, velocity: FloatArray, change: FloatArray) -> FloatArray:
        """Return Jᵀ Q (J v − A x) (N, 3) of velocities v and a change x of poses and border."""
        moved, layout = np.empty_like(self.residual), self.reduced.layout
        pose, lens = np.zeros((self.photographs, 6)), np.zeros((len(layout.unit), self.calibration.shape[2]))
        owner, parameter = layout.free_parameters
        pose[layout.photograph_at] = change[: layout.columns].reshape(-1, 6)
        lens[owner, parameter] = change[layout.columns : layout.columns + len(owner)]
        _move(self.way, self.point, velocity, self.of_photograph, moved)
        take_cameras(self.pose, self.calibration, pose, lens, self.of_photograph, self.of_camera, moved)
        take_points(self.first, self.point, self.inverse, moved)
        pulled = np.zeros((self.photographs, 3))
        _velocity_pull(self.way, self.point, moved, self.of_photograph, pulled)
        return pulled

    def product(self, velocity: FloatArray) -> FloatArray:
        """Return the normal matrix without the prior times velocities (N, 3)."""
        return self.pulled(velocity, self.change(velocity))

    def solve(self, right: FloatArray, free: BoolArray, sigma_m_s: float, own: FloatArray) -> FloatArray:
        """Return the departures (N, 3) of the photographs ``free`` (N,), zero of the others, whose normal equations
        with the prior have the right-hand side ``right`` (N, 3); ``own`` (F, 3, 3) are the matrices of each with all
        else at rest."""
        weight = sigma_m_s**-2.0
        inverse = np.linalg.inv(own + weight * np.eye(3))
        departure, direction = np.zeros_like(right), np.zeros_like(right)
        x, residual = np.zeros_like(right[free]), right[free]
        z = np.einsum("nij,nj->ni", inverse, residual)
        p, rho = z, float(np.sum(residual * z))
        least = RELATIVE**2 * rho
        for _ in range(MOST_PRODUCTS):
            if not rho > least:
                break
            direction[free] = p
            q = self.product(direction)[free] + weight * p
            alpha = rho / float(np.sum(p * q))
            x, residual = x + alpha * p, residual - alpha * q
            z = np.einsum("nij,nj->ni", inverse, residual)
            before, rho = rho, float(np.sum(residual * z))
            p = z + (rho / before) * p
        departure[free] = x
        return departure


@kernel
def _move(way: FloatArray, point: FloatArray, velocity: FloatArray, of: IntArray, out: FloatArray) -> None:
    """Set ``out`` to J times velocities."""
    for m in range(len(of)):
        p = of[m]
        for r in range(2):
            along = point[m, r, 0] * velocity[p, 0] + point[m, r, 1] * velocity[p, 1] + point[m, r, 2] * velocity[p, 2]
            out[m, r] = way[m] * along


@kernel
def _velocity_pull(way: FloatArray, point: FloatArray, values: FloatArray, of: IntArray, out: FloatArray) -> None:
    """Add Jᵀ times values."""
    for m in range(len(of)):
        p, u, v = of[m], way[m] * values[m, 0], way[m] * values[m, 1]
        for k in range(3):
            out[p, k] += point[m, 0, k] * u + point[m, 1, k] * v


@kernel
def take_points(first: IntArray, point: FloatArray, inverse: FloatArray, values: FloatArray) -> None:
    """Replace ``values`` (M, 2) by Q times values: what points do not follow, with the rows ``point`` (M, 2, 3), sorted
    by point, that of p from ``first`` (P + 1,) on, and the ``inverse`` normal matrices that ``points_of`` returns."""
    for p in range(len(first) - 1):
        x, y, z = 0.0, 0.0, 0.0
        for m in range(first[p], first[p + 1]):
            for r in range(2):
                x += point[m, r, 0] * values[m, r]
                y += point[m, r, 1] * values[m, r]
                z += point[m, r, 2] * values[m, r]
        a = inverse[p, 0, 0] * x + inverse[p, 0, 1] * y + inverse[p, 0, 2] * z
        b = inverse[p, 1, 0] * x + inverse[p, 1, 1] * y + inverse[p, 1, 2] * z
        c = inverse[p, 2, 0] * x + inverse[p, 2, 1] * y + inverse[p, 2, 2] * z
        for m in range(first[p], first[p + 1]):
            for r in range(2):
                values[m, r] -= point[m, r, 0] * a + point[m, r, 1] * b + point[m, r, 2] * c


@kernel
def _camera_pull(
    pose: FloatArray, calibration: FloatArray, values: FloatArray, of_photograph: IntArray, of_camera: IntArray,
    own: FloatArray, shared: FloatArray,
) -> None:  # fmt: skip
    """Add Aᵀ times values: of the poses to ``own``, of the cameras to ``shared``."""
    for m in range(len(of_photograph)):
        p, c, u, v = of_photograph[m], of_camera[m], values[m, 0], values[m, 1]
        for k in range(6):
            own[p, k] += pose[m, 0, k] * u + pose[m, 1, k] * v
        for k in range(calibration.shape[2]):
            shared[c, k] += calibration[m, 0, k] * u + calibration[m, 1, k] * v


@kernel
def take_cameras(
    pose: FloatArray, calibration: FloatArray, own: FloatArray, shared: FloatArray, of_photograph: IntArray,
    of_camera: IntArray, values: FloatArray,
) -> None:  # fmt: skip
    """Take A times the changes ``own`` (N, 6) of poses and ``shared`` (C, 12 + K) of cameras from ``values`` (M, 2)."""
    for m in range(len(of_photograph)):
        p, c = of_photograph[m], of_camera[m]
        for r in range(2):
            total = 0.0
            for k in range(6):
                total += pose[m, r, k] * own[p, k]
            for k in range(calibration.shape[2]):
                total += calibration[m, r, k] * shared[c, k]
            values[m, r] -= total


@kernel
def _normal_matrices(first: IntArray, point: FloatArray, out: FloatArray) -> None:
    """Set ``out`` (P, 3, 3) to BᵀB of each point, the unit matrix where it has fewer than two rays."""
    for p in range(len(first) - 1):
        rays = 0
        for m in range(first[p], first[p + 1]):
            seen = False
            for r in range(2):
                for a in range(3):
                    seen = seen or point[m, r, a] != 0.0
                    for b in range(3):
                        out[p, a, b] += point[m, r, a] * point[m, r, b]
            rays += seen
        if rays < 2:
            for a in range(3):
                for b in range(3):
                    out[p, a, b] = 1.0 if a == b else 0.0


def points_of(tie: Observations, point: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """Return where the observations of each of ``count`` points begin (count + 1,), and the inverses (count, 3, 3) of
    the normal matrices of their rows ``point`` (M, 2, 3)."""
    first = np.searchsorted(tie.point, np.arange(count + 1))
    normal = np.zeros((count, 3, 3))
    _normal_matrices(first, point, normal)
    return first, np.asarray(np.linalg.inv(normal))


def _system(problem: Problem, state: State) -> _System:
    tie, cameras = problem.tie, state.cameras
    linear = linearise(tie, cameras, state.tie_point)  # zero where a draft has points behind a camera
    root = np.sqrt(robust_terms(linear.residual, problem.robust_loss, problem.robust_threshold)[1])
    reduced = factored(problem, state)
    point = root[:, None, None] * linear.point
    height = cameras.size_px[linear.camera, 1].astype(float)
    share = share_at_row(np.ascontiguousarray(tie.pixel[:, 1]), height)
    first, inverse = points_of(tie, point, len(state.tie_point))
    return _System(
        reduced, first, -cameras.parameters[linear.camera, READOUT] * share, point, root[:, None, None] * linear.pose,
        root[:, None, None] * linear.calibration * reduced.layout.unit[linear.camera][:, None],
        root[:, None] * linear.residual, inverse, tie.photograph, linear.camera, len(cameras.camera),
    )  # fmt: skip


class Together(NamedTuple):
    """Velocities (N, 3) in the world, m/s, and the read-out times (C,), s, that go with them."""

    velocity_m_s: FloatArray
    readout_s: FloatArray


def _readout_columns(system: _System) -> list[tuple[int, int]]:
    """Return the cameras whose read-out times are unknowns, each with its column of the reduced system."""
    layout = system.reduced.layout
    owner, parameter = layout.free_parameters
    return [(int(owner[k]), layout.columns + int(k)) for k in np.flatnonzero(parameter == READOUT)]


def _determined(own: FloatArray, sigma_m_s: float) -> FloatArray:
    """Return how many components of each velocity (F,) its photograph tells, beside a prior of ``sigma_m_s``."""
    share = np.linalg.solve(own + sigma_m_s**-2.0 * np.eye(3), own)
    return np.asarray(np.trace(share, axis1=1, axis2=2))


def joint_velocities(
    problem: Problem,
    state: State,
    expected_m_s: FloatArray,
    free: BoolArray,
    sigma_m_s: float,
    own: FloatArray,
    least_s: float = 0.0,
) -> Together:
    """Return the velocities in the world, m/s, of the photographs ``free`` (N,) that are most likely beside those
    ``expected_m_s`` (N, 3), which scatter by ``sigma_m_s``, at ``state``, a minimum with the velocities that it has,
    and the read-out times; the others are as expected. ``own`` (F, 3, 3) are the normal matrices of the free ones,
    everything else at rest.

    Departures are looked for as if unknown read-out times were ``least_s`` at least: velocities that are wrong make
    them come out too short, and what departures may explain shrinks with them. Raises IndeterminateError or
    SingularError where the reduced system has no unique solution.
    """
    system, now = _system(problem, state), state.parameters[:, READOUT]
    columns = [(camera, column) for camera, column in _readout_columns(system) if now[camera] != 0.0]
    before = now.copy()
    longer = np.ones_like(now)
    layout = system.reduced.layout
    for camera, _ in columns:
        before[camera] = np.copysign(max(abs(now[camera]), least_s), now[camera])
        longer[camera] = before[camera] / now[camera]
    system = replace(system, way=system.way * longer[system.of_camera])
    owner = state.cameras.camera[free]
    own = own * longer[owner, None, None] ** 2
    right, load = system.right(), np.zeros((layout.columns + layout.border, 1))
    right[free] += sigma_m_s**-2.0 * (expected_m_s - state.velocity)[free]
    determined = np.bincount(owner, _determined(own, sigma_m_s), minlength=len(before))
    for camera, column in columns:
        load[column] = -layout.unit[camera, READOUT] * determined[camera] / before[camera]
    alone = system.reduced.solve(load)[:, 0]
    departure = system.solve(right + system.pulled(np.zeros_like(right), alone), free, sigma_m_s, own)
    change, after = alone - system.change(departure), before.copy()
    for camera, column in columns:
        step = now[camera] + layout.unit[camera, READOUT] * change[column]
        after[camera] = before[camera] * np.clip(step / before[camera], 1.0 / LARGEST_RATIO, LARGEST_RATIO)
    ratio = np.divide(before, after, out=np.zeros_like(after), where=after != 0.0)[state.cameras.camera, None]
    return Together(np.where(free[:, None], state.velocity + ratio * departure, expected_m_s), after)


def readout_sigmas(problem: Problem, state: State, free: BoolArray, sigma_m_s: float, own: FloatArray) -> FloatArray:
    """Return the standard deviations (C,) of the read-out times that are unknowns, s, NaN of the others, where the
    photographs ``free`` (N,) flew at velocities that are known to ``sigma_m_s`` beforehand; ``own`` as
    ``joint_velocities`` has it. From the curvature of the marginal likelihood, that of the joint one less ν / T².

    Raises IndeterminateError or SingularError where the reduced system has no unique solution.
    """
    system = _system(problem, state)
    layout, nothing = system.reduced.layout, np.zeros((system.photographs, 3))
    sigma, cameras = np.full(len(layout.unit), np.nan), len(layout.unit)
    determined = np.bincount(state.cameras.camera[free], _determined(own, sigma_m_s), minlength=cameras)
    for camera, column in _readout_columns(system):
        unit = np.zeros((layout.columns + layout.border, 1))
        unit[column] = 1.0
        alone = system.reduced.solve(unit)[:, 0]
        departure = system.solve(system.pulled(nothing, alone), free, sigma_m_s, own)
        variance = layout.unit[camera, READOUT] ** 2 * (alone[column] - system.change(departure)[column])
        readout_s = state.parameters[camera, READOUT]
        less = determined[camera] * variance / readout_s**2 if readout_s != 0.0 else 0.0
        sigma[camera] = np.sqrt(variance / max(1.0 - less, LEAST_LEFT))
    return sigma
