"""Covariances of linear functions of many variables at once: mean heights, domes, shifts of a whole block.

A point with its own normal matrix V and the block W towards the cameras follows them by −V⁻¹ Wᵀ δ and scatters by V⁻¹
of its own. The function Σ aᵀX of points hence has the column u = −Σ W V⁻¹ a on the reduced system S, and two of them
the covariance Σ aᵀ V⁻¹ b + uᵀ S⁻¹ v (Förstner & Wrobel 2016, sec. 15.4): one column each, however many points.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csc_array, csr_array

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.factors.elimination.bundle import limited_threads
from photogram.factors.elimination.loss import RobustLoss, robust_terms
from photogram.factors.elimination.reduced import Factor, Layout
from photogram.factors.elimination.reprojection import Linearisation, Observations, linearise
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.ground_terms import bundle_of, eliminated
from photogram.projection import PARAMETERS

POINTS_AT_ONCE = 64  # whose three columns each are solved for together
RESPONDING_AT_ONCE = 10_000  # points whose measurements are linearised together


class Solvable(Protocol):
    """A factored reduced system S."""

    @property
    def layout(self) -> Layout:
        """Return where variables sit."""

    def solve(self, columns: FloatArray) -> FloatArray:
        """Return S⁻¹ times columns (6 free + border, k)."""


@dataclass(frozen=True, eq=False)
class Factored:
    """A reduced system whose rows were divided by ``scale``, factored for a few solutions and nothing else."""

    layout: Layout
    factor: Factor
    scale: FloatArray

    def solve(self, columns: FloatArray) -> FloatArray:
        """Return S⁻¹ times columns (6 free + border, k) in the order of the reduced system S."""
        return self.factor.solve_scaled(columns, self.scale)


def factored(problem: Problem, state: State) -> Factored:
    """Factor the reduced system at ``state``: what covariances of functions need, without those of all points.

    Raises IndeterminateError or SingularError where it has no unique solution.
    """
    bundle = bundle_of(problem, state)
    bundle = replace(bundle, loss=bundle.loss.weights_alone())
    with limited_threads(len(bundle.tie)) as pool:
        normal = eliminated(bundle, state, bundle.ground.linearise(state), pool)
        scale = np.sqrt(np.maximum(normal.diagonal(), 1e-300))
        return Factored(bundle.layout, normal.factor(scale=scale), scale)


@dataclass(frozen=True, eq=False)
class Functions:
    """K linear functions of all variables: ``columns`` (6 free + border, K) on the reduced system in its own units, and
    ``own`` (K, K), the covariance that the points' own measurements add."""

    columns: FloatArray
    own: FloatArray

    def shared(self, solvable: Solvable) -> FloatArray:
        """Return the joint covariance (K, K) of the functions that comes from the cameras."""
        covariance = self.columns.T @ solvable.solve(self.columns)
        return np.asarray(0.5 * (covariance + covariance.T))

    def covariance(self, solvable: Solvable) -> FloatArray:
        """Return the joint covariance (K, K) of the functions."""
        return self.own + self.shared(solvable)


def joined(parts: Sequence[Functions]) -> Functions:
    """Return functions of different variables as one list."""
    return Functions(np.concatenate([p.columns for p in parts], axis=1), block_diag(*[p.own for p in parts]))


def _weighted(
    observations: Observations, state: State, points: FloatArray, loss: RobustLoss, limit: float
) -> tuple[Linearisation, FloatArray]:
    """Return the linearisation of observations under the weights of a robust loss, calibration in natural units, and
    the roots (N,) of the weights."""
    linear = linearise(observations, state.cameras, points)
    root = np.sqrt(robust_terms(linear.residual, loss, limit)[1])
    whole = root[:, None, None]
    weighted = Linearisation(
        root[:, None] * linear.residual,
        whole * linear.pose,
        whole * linear.calibration,
        whole * linear.point,
        linear.camera,
    )
    return weighted, root


def _normal(observations: Observations, linear: Linearisation, count: int) -> FloatArray:
    return _summed(observations.point, np.einsum("nri,nrj->nij", linear.point, linear.point), count)


def _summed(point: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Return the sums (count, …) of values (N, …) by the points (N,) that they belong to."""
    n = len(point)
    by_point = csr_array((np.ones(n), (point, np.arange(n))), shape=(count, n))
    return np.asarray(by_point @ values.reshape(n, -1)).reshape(count, *values.shape[1:])


def _camera_rows(layout: Layout, observations: Observations, linear: Linearisation) -> csr_array:
    """Return the Jacobians of observations on the reduced system (2 N, 6 free + border), u and v in turn."""
    o, n = observations, len(observations)
    free = layout.unit > 0
    border = np.full(free.shape, -1)
    border[free] = layout.columns + np.arange(layout.offset_column)
    pose = np.broadcast_to((6 * layout.place[o.photograph][:, None] + np.arange(6))[:, None], (n, 2, 6))
    lens = np.broadcast_to(border[linear.camera][:, None], (n, 2, free.shape[1]))
    values = np.concatenate([linear.pose, linear.calibration * layout.unit[linear.camera][:, None]], axis=2)
    columns = np.concatenate([pose, lens], axis=2)
    rows = np.broadcast_to(np.arange(2 * n).reshape(n, 2, 1), columns.shape)
    used = columns >= 0
    return csr_array((values[used], (rows[used], columns[used])), shape=(2 * n, layout.columns + layout.border))


def functions_of_tie_points(
    problem: Problem, state: State, layout: Layout, points: IntArray, a: FloatArray
) -> Functions:
    """Return the functions Σ aᵀX of tie points with the numbers ``points`` (P,), sorted; ``a`` (P, 3, K).

    The weights of their observations are those of the robust loss. Points need rays that fix them.
    """
    o = problem.tie.select(np.isin(problem.tie.point, points))
    o = Observations(o.photograph, np.searchsorted(points, o.point), o.pixel, o.sigma_px)
    linear, _ = _weighted(o, state, state.tie_point[points], problem.robust_loss, problem.robust_threshold)
    b = np.linalg.solve(_normal(o, linear, len(points)), a)
    moved = np.einsum("nri,nik->nrk", linear.point, b[o.point]).reshape(2 * len(o), -1)
    columns = -np.asarray(_camera_rows(layout, o, linear).T @ moved)
    return Functions(columns, np.einsum("pik,pil->kl", a, b))


def responses_to_pixels(
    problem: Problem, state: State, solvable: Solvable, points: IntArray, a: FloatArray
) -> FloatArray:
    """Return by how much the functions Σ aᵀX of ``functions_of_tie_points`` change when the measurements of all tie
    points (N, 2) move by a pixel along u or v: (N, 2, K), in m per pixel.

    With all Jacobians J and the normal matrix JᵀJ the change is (J (JᵀJ)⁻¹ a)ᵀ times that of the whitened pixels:
    influences of measurements, as external reliability has them (Baarda 1968).
    """
    layout = solvable.layout
    tie = problem.tie
    functions = a.shape[2]
    solved = solvable.solve(functions_of_tie_points(problem, state, layout, points, a).columns)
    of_point = np.zeros((len(state.tie_point), 3, functions))
    of_point[points] = a
    order = np.argsort(tie.point, kind="stable")
    begins = np.searchsorted(tie.point[order], np.arange(len(state.tie_point) + 1))
    response = np.empty((len(tie), 2, functions))
    for first in range(0, len(state.tie_point), RESPONDING_AT_ONCE):
        last = min(first + RESPONDING_AT_ONCE, len(state.tie_point))
        rays = order[begins[first] : begins[last]]
        o = tie.select(rays)
        o = Observations(o.photograph, o.point - first, o.pixel, o.sigma_px)
        response[rays] = _responses(problem, state, layout, o, solved, slice(first, last), of_point[first:last])
    return response


def _responses(
    problem: Problem,
    state: State,
    layout: Layout,
    observations: Observations,
    solved: FloatArray,
    part: slice,
    a: FloatArray,
) -> FloatArray:
    """Return the responses (N, 2, K) to all measurements of a ``part`` of the tie points, counted from its first, whose
    functions are ``a`` (P, 3, K)."""
    o, X = observations, state.tie_point[part]
    linear, root = _weighted(o, state, X, problem.robust_loss, problem.robust_threshold)
    V = _normal(o, linear, len(X))
    V[np.bincount(o.point, minlength=len(X)) < 2] = np.eye(3)
    moved = _moved_by_cameras(layout, o, linear, solved)
    rest = a - _summed(o.point, linear.point.transpose(0, 2, 1) @ moved, len(X))
    moved += linear.point @ np.linalg.solve(V, rest)[o.point]
    return np.asarray(moved * (root / o.sigma_px)[:, None, None])


def _moved_by_cameras(
    layout: Layout, observations: Observations, linear: Linearisation, solved: FloatArray
) -> FloatArray:
    """Return by how much whitened measurements (N, 2, K) move with the changes (6 free + border, K) of the cameras."""
    o, functions = observations, solved.shape[1]
    fixed = np.zeros((1, 6, functions))  # the place of a photograph that is fixed is −1, the last
    pose = np.concatenate([solved[: layout.columns].reshape(-1, 6, functions), fixed])[layout.place[o.photograph]]
    lens, free = np.zeros((*layout.unit.shape, functions)), layout.unit > 0
    lens[free] = solved[layout.columns : layout.columns + layout.offset_column] * layout.unit[free][:, None]
    return np.asarray(linear.pose @ pose + linear.calibration @ lens[linear.camera])


def functions_of_positions(state: State, layout: Layout, weight: FloatArray) -> Functions:
    """Return the weighted sums (N,) of projection centres: east, north, up of the world, m."""
    columns = np.zeros((layout.columns + layout.border, 3))
    rows = 6 * layout.place[:, None] + np.arange(3, 6)
    columns[rows] = weight[:, None, None] * state.rotation.transpose(0, 2, 1)
    return Functions(columns, np.zeros((3, 3)))


def functions_of_attitudes(layout: Layout, weight: FloatArray) -> Functions:
    """Return the weighted sums (N,) of rotations about the cameras' own x and y axes, rad."""
    columns = np.zeros((layout.columns + layout.border, 2))
    for axis in range(2):
        columns[6 * layout.place + axis, axis] = weight
    return Functions(columns, np.zeros((2, 2)))


def functions_of_border(layout: Layout) -> Functions:
    """Return every parameter (cameras, 12) of all calibrations in natural units, zero where fixed, then the GNSS
    offsets (flights, 3), each flattened."""
    cameras, offsets = len(layout.unit), layout.common_column - layout.offset_column
    columns = np.zeros((layout.columns + layout.border, cameras * PARAMETERS + offsets))
    owner, parameter = layout.free_parameters
    interior = np.flatnonzero(parameter < PARAMETERS)
    rows = np.concatenate([interior, np.arange(layout.offset_column, layout.common_column)])
    of = np.concatenate([(owner * PARAMETERS + parameter)[interior], cameras * PARAMETERS + np.arange(offsets)])
    columns[layout.columns + rows, of] = layout.border_unit[rows]
    return Functions(columns, np.zeros((columns.shape[1],) * 2))


@dataclass(frozen=True, eq=False)
class Intersected:
    """P points that are intersected from observations and took no part in the adjustment: which of them ``known`` (P,)
    their rays fix, V⁻¹ (P, 3, 3) of their own normal matrices, zero for others, and W V⁻¹ (6 free + border, 3 P)."""

    known: BoolArray
    inverse: FloatArray
    columns: csc_array

    def joint(self, solvable: Solvable) -> FloatArray:
        """Return the joint covariance (3 P, 3 P) of all points in the world, m², NaN for those that are not known."""
        columns = self.columns.toarray()
        joint = columns.T @ solvable.solve(columns)
        own = np.arange(columns.shape[1]).reshape(-1, 3)
        joint[own[:, :, None], own[:, None, :]] += self.inverse
        unknown = np.repeat(~self.known, 3)
        joint[unknown], joint[:, unknown] = np.nan, np.nan
        return joint


def intersected(observations: Observations, points_world_m: FloatArray, state: State, layout: Layout) -> Intersected:
    """Return points at ``points_world_m`` (P, 3) as ``observations``, sorted by point, intersect them."""
    count = len(points_world_m)
    linear = linearise(observations, state.cameras, points_world_m)
    V = _normal(observations, linear, count)
    known = np.bincount(observations.point, minlength=count) >= 2
    known[known] = np.linalg.cond(V[known]) < 1e12
    inverse = np.zeros((count, 3, 3))
    inverse[known] = np.linalg.inv(V[known])
    rows, ray = _camera_rows(layout, observations, linear), np.arange(2 * len(observations))
    at = 3 * np.repeat(observations.point, 2)[:, None] + np.arange(3)
    moved = (linear.point @ inverse[observations.point]).reshape(-1, 3)
    shape = len(ray), 3 * count
    W = rows.T @ csr_array((moved.ravel(), (np.repeat(ray, 3), at.ravel())), shape=shape)
    return Intersected(known, inverse, W.tocsc())


def intersected_covariances(
    observations: Observations, points_world_m: FloatArray, state: State, solvable: Solvable
) -> FloatArray:
    """Return the covariances (P, 3, 3), m², of points that are intersected from ``observations``, sorted by point, and
    took no part in the adjustment; infinite where the rays do not fix a point."""
    points = intersected(observations, points_world_m, state, solvable.layout)
    count, known, inverse = len(points_world_m), points.known, points.inverse
    covariance = np.full((count, 3, 3), np.inf)
    for start in range(0, count, POINTS_AT_ONCE):
        end = min(count, start + POINTS_AT_ONCE)
        columns = points.columns[:, 3 * start : 3 * end].toarray()
        each = columns.shape[0], end - start, 3
        shared = np.einsum("cpi,cpj->pij", columns.reshape(each), solvable.solve(columns).reshape(each))
        covariance[start:end] = np.where(known[start:end, None, None], inverse[start:end] + shared, np.inf)
    return covariance
