"""The joint adjustment as GTSAM's graph: state, linearisation and the Levenberg–Marquardt step that GTSAM solves.

This is the reference: every tie point is a variable and every observation a factor of the linear graph. The few
factors on poses, control points, common errors and calibrations are linearised one by one; image observations together
by one compiled kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray, IntArray
from photogram.factors.common_errors import parts
from photogram.factors.elimination.levenberg_marquardt import Trial
from photogram.factors.elimination.loss import LEAST_CURVATURE, steer
from photogram.factors.elimination.reprojection import Linearisation, Observations, linearise, residuals
from photogram.factors.elimination.similarity_steps import bend_of, bent
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem, cost, ground_factors
from photogram.factors.linearised.alike import Factors
from photogram.factors.reference.native import in_gtsam
from photogram.factors.rigs.exposures import estimated, values_by_rig
from photogram.factors.variables import (
    CALIBRATION,
    COMMON_ERROR,
    CONTROL_POINT,
    GNSS_OFFSET,
    POSE,
    RIG,
    TIE_POINT,
    indeterminate_variable,
    key,
    kind_and_index,
)
from photogram.projection import recalibrated


def ground_graph(problem: Problem) -> gtsam.NonlinearFactorGraph:
    """Return the factors of a problem on everything but image points, as GTSAM's."""
    graph = gtsam.NonlinearFactorGraph()
    for factors in ground_factors(problem):
        for factor in in_gtsam(factors):
            graph.add(factor)
    return graph


def ground_values(problem: Problem, state: State) -> gtsam.Values:
    """Return the values of all variables but the tie points."""
    values = gtsam.Values()
    for i in range(len(state.rotation)):
        values.insert(key(POSE, i), gtsam.Pose3(gtsam.Rot3(state.rotation[i]), state.position[i]))
    for g in range(len(state.control)):
        values.insert(key(CONTROL_POINT, g), state.control[g])
    for f in range(len(state.offset)):
        values.insert(key(GNSS_OFFSET, f), state.offset[f])
    for k, part in enumerate(parts(problem.block.common_errors)):
        values.insert(key(COMMON_ERROR, k), state.common[part])
    if problem.block.rigs:
        relative = values_by_rig(problem.block, state.common)
        for k in estimated(problem.block).tolist():
            values.insert(key(RIG, k), relative[k])
    for c, free in enumerate(problem.free):
        if len(free):
            values.insert(key(CALIBRATION, c), (state.parameters[c] / problem.scale[c])[free])
    return values


def reprojection_factors(
    observations: Observations,
    linear: Linearisation,
    weight: FloatArray,
    point_kind: str,
    free: tuple[IntArray, ...],
    scale: FloatArray,
) -> list[gtsam.JacobianFactor]:
    """Return one linear factor per observation, on its pose, its point and, where parameters are free, its calibration.

    ``weight`` (N,) multiplies squared residuals (robust weights); ``free`` lists per camera the indices of free
    parameters; ``scale`` (cameras, 12 + K) their units.
    """
    root = np.sqrt(weight)[:, None]
    b = -linear.residual * root
    J_pose, J_point = linear.pose * root[:, None], linear.point * root[:, None]
    J_camera = linear.calibration * root[:, None] * scale[linear.camera][:, None, :]
    reduced = [np.ascontiguousarray(J_camera[:, :, indices]) for indices in free]
    unit = gtsam.noiseModel.Unit.Create(2)
    poses = [key(POSE, i) for i in range(int(observations.photograph.max(initial=-1)) + 1)]
    points = [key(point_kind, i) for i in range(int(observations.point.max(initial=-1)) + 1)]
    calibrations = [key(CALIBRATION, c) for c in range(len(free))]
    factors = []
    for i, (p, x, c) in enumerate(
        zip(observations.photograph.tolist(), observations.point.tolist(), linear.camera.tolist(), strict=True)
    ):
        if len(free[c]):
            factors.append(
                gtsam.JacobianFactor(
                    points[x], J_point[i], poses[p], J_pose[i], calibrations[c], reduced[c][i], b[i], unit
                )
            )
        else:
            factors.append(gtsam.JacobianFactor(points[x], J_point[i], poses[p], J_pose[i], b[i], unit))
    return factors


def variable_size(problem: Problem, variable: int) -> int:
    """Return the number of unknowns of a variable."""
    kind, index = kind_and_index(variable)
    if kind == CALIBRATION:
        return len(problem.free[index])
    if kind == COMMON_ERROR:
        return len(problem.block.common_errors[index].sigma)
    return 6 if kind in (POSE, RIG) else 3


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """One linearisation: the linear graph, its elimination order, and the diagonal of its normal equations per
    variable."""

    graph: gtsam.GaussianFactorGraph
    ordering: gtsam.Ordering
    diagonal: dict[int, FloatArray]
    variables: tuple[int, ...]


def linearise_tie_points(problem: Problem, state: State, least_curvature: float) -> Linearisation:
    """Return the residuals and Jacobians of the tie points' observations under the robust loss, calibration in its
    units."""
    linear = linearise(problem.tie, state.cameras, state.tie_point)
    turn, residual = steer(linear.residual, problem.robust_loss, problem.robust_threshold, least_curvature)
    calibration = turn @ linear.calibration * problem.scale[linear.camera][:, None, :]
    return Linearisation(residual, turn @ linear.pose, calibration, turn @ linear.point, linear.camera)


def linearise_ground(problem: Problem, graph: gtsam.NonlinearFactorGraph, state: State) -> gtsam.GaussianFactorGraph:
    """Return the linear graph of everything but the tie points: GTSAM's factors, and the marks of control points."""
    linear = graph.linearize(ground_values(problem, state))
    marks = linearise(problem.marks, state.cameras, state.control)
    for factor in reprojection_factors(
        problem.marks, marks, np.ones(len(problem.marks)), CONTROL_POINT, problem.free, problem.scale
    ):
        linear.push_back(factor)
    return linear


def _diagonal(
    problem: Problem, ground: gtsam.GaussianFactorGraph, tie: Linearisation, state: State
) -> dict[int, FloatArray]:
    """Return the diagonal of the normal equations of every variable."""
    diagonal: dict[int, FloatArray] = {}

    def add(variable: int, squares: FloatArray) -> None:
        diagonal[variable] = diagonal[variable] + squares if variable in diagonal else squares

    for i in range(ground.size()):
        factor = ground.at(i)
        squares = np.sum(factor.jacobian()[0] ** 2, axis=0)
        start = 0
        for variable in factor.keys():  # noqa: SIM118 - a factor is no dictionary
            size = variable_size(problem, variable)
            add(variable, squares[start : start + size])
            start += size
    o = problem.tie
    pose, point = np.zeros((len(state.rotation), 6)), np.zeros((len(state.tie_point), 3))
    np.add.at(pose, o.photograph, np.sum(tie.pose**2, axis=1))
    np.add.at(point, o.point, np.sum(tie.point**2, axis=1))
    calibration = np.zeros_like(state.parameters)
    np.add.at(calibration, tie.camera, np.sum(tie.calibration**2, axis=1))
    for i, squares in enumerate(pose):
        add(key(POSE, i), squares)
    for p in np.unique(o.point).tolist():
        add(key(TIE_POINT, p), point[p])
    for c, free in enumerate(problem.free):
        if len(free):
            add(key(CALIBRATION, c), calibration[c, free])
    return diagonal


def linearise_all(
    problem: Problem, graph: gtsam.NonlinearFactorGraph, state: State, least_curvature: float = 1.0
) -> LinearSystem:
    """Linearise the whole graph at ``state``; tie points come first in the elimination order, calibrations last.

    ``least_curvature`` bounds that of the robust loss, 1 for weights alone.
    """
    linear = linearise_ground(problem, graph, state)
    tie = linearise_tie_points(problem, state, least_curvature)
    diagonal = _diagonal(problem, linear, tie, state)
    unit_scale = np.ones_like(state.parameters)
    for factor in reprojection_factors(
        problem.tie, tie, np.ones(len(problem.tie)), TIE_POINT, problem.free, unit_scale
    ):
        linear.push_back(factor)
    variables = (
        [key(TIE_POINT, int(p)) for p in np.unique(problem.tie.point)]
        + [key(CONTROL_POINT, g) for g in range(len(state.control))]
        + [key(GNSS_OFFSET, f) for f in range(len(state.offset))]
        + [key(POSE, i) for i in range(len(state.rotation))]
        + [key(COMMON_ERROR, k) for k in range(len(problem.block.common_errors))]
        + [key(RIG, k) for k in estimated(problem.block).tolist()]
        + [key(CALIBRATION, c) for c, free in enumerate(problem.free) if len(free)]
    )
    ordering = gtsam.Ordering()
    for variable in variables:
        ordering.push_back(variable)
    return LinearSystem(linear, ordering, diagonal, tuple(variables))


@dataclass(frozen=True, eq=False)
class Step:
    """A step in the tangent of a state, and the cost that the linear model says it saves."""

    values: gtsam.VectorValues
    predicted_decrease: float


def damped_step(system: LinearSystem, damping: float) -> Step:
    """Solve the linear graph with Marquardt's damping (diagonal scaled by 1 + ``damping``); GTSAM eliminates and
    substitutes.

    Raises IndeterminateError, with the variable that GTSAM names, when there is no unique solution.
    """
    damped = gtsam.GaussianFactorGraph()
    damped.push_back(system.graph)
    units = {n: gtsam.noiseModel.Unit.Create(n) for n in {len(diagonal) for diagonal in system.diagonal.values()}}
    for variable in system.variables:
        diagonal = system.diagonal[variable]
        n = len(diagonal)
        damped.push_back(gtsam.JacobianFactor(variable, np.diag(np.sqrt(damping * diagonal)), np.zeros(n), units[n]))
    try:
        values = damped.optimize(system.ordering)
    except RuntimeError as error:
        raise IndeterminateError(indeterminate_variable(str(error))) from error
    # Half of δᵀ(λ D δ − g): as a difference of two costs it would drown in their rounding.
    damped_norm = sum(float(system.diagonal[v] @ values.at(v) ** 2) for v in system.variables)
    return Step(values, 0.5 * (damping * damped_norm - float(system.graph.gradientAtZero().dot(values))))


def _gather(values: gtsam.VectorValues, kind: str, indices: IntArray | range, size: int) -> FloatArray:
    return np.array([values.at(key(kind, int(i))) for i in indices]).reshape(-1, size)


def retract(problem: Problem, state: State, step: Step, near: bool = True) -> State:
    """Move ``state`` by ``step``: R Exp(ω), C + R v, and sums for everything else; ``near`` the minimum the
    block's rotation and scale exactly."""
    v, common = step.values, problem.block.common_errors
    pose = _gather(v, POSE, range(len(state.rotation)), 6)
    seen = np.unique(problem.tie.point)
    turned, moved = np.einsum("nij,nkj->kni", state.rotation, pose.reshape(-1, 2, 3))
    bend, tie_point = np.zeros((4, 3)), state.tie_point.copy()
    if near:
        bend = bend_of(state.position, moved, turned)
    if len(seen):
        tie_point[seen] += _gather(v, TIE_POINT, seen, 3) + bent(bend, tie_point[seen])
    parameters = state.parameters.copy()
    for c, free in enumerate(problem.free):
        if len(free):
            parameters[c, free] += v.at(key(CALIBRATION, c)) * problem.scale[c][free]
    return State(
        recalibrated(state.cameras, parameters)._replace(
            rotation=state.rotation @ Rotation.from_rotvec(pose[:, :3]).as_matrix(),
            position=state.position + moved + bent(bend, state.position),
        ),
        tie_point,
        state.control + _gather(v, CONTROL_POINT, range(len(state.control)), 3) + bent(bend, state.control),
        state.offset + _gather(v, GNSS_OFFSET, range(len(state.offset)), 3),
        state.common
        + np.concatenate(
            [
                np.zeros(0),
                *(v.at(key(COMMON_ERROR, k)) for k in range(len(common))),
                *(v.at(key(RIG, k)) for k in estimated(problem.block).tolist()),
            ]
        ),
    )


def _behind(observations: Observations, state: State, points: FloatArray) -> IntArray:
    """Return how many rays of each point (P, 3) come from behind their camera."""
    whitened = residuals(observations, state.cameras, points)
    return np.bincount(observations.point, ~np.isfinite(whitened[:, 0]), minlength=len(points)).astype(np.int64)


def kept_in_front(problem: Problem, before: State, after: State) -> State:
    """Return the state ``after`` a step with the points back in place that it took behind one of their cameras."""
    points = {}
    for name, observations in (("tie_point", problem.tie), ("control", problem.marks)):
        old, new = getattr(before, name), getattr(after, name)
        lost = _behind(observations, after, new) > _behind(observations, before, old)
        points[name] = np.where(lost[:, None], old, new)
    return replace(after, **points)


@dataclass(frozen=True, eq=False)
class ReferenceSystem:
    """A problem as Levenberg–Marquardt sees it, every step solved by GTSAM."""

    problem: Problem
    ground: gtsam.NonlinearFactorGraph
    factors: tuple[Factors, ...]

    def cost(self, state: State) -> float:
        """Return the cost of a state."""
        return cost(self.problem, self.factors, state)

    def linearise(self, state: State, near: bool) -> Callable[[float], Trial]:
        """Return what gives the step of a damping from a state."""
        system = linearise_all(self.problem, self.ground, state, LEAST_CURVATURE if near else 1.0)

        def step(damping: float) -> Trial:
            solution = damped_step(system, damping)
            moved = kept_in_front(self.problem, state, retract(self.problem, state, solution, near))
            return Trial(moved, self.cost(moved), solution.predicted_decrease)

        return step
