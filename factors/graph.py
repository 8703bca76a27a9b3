"""The joint adjustment as a factor graph: state, cost, linearisation and the Levenberg–Marquardt step that GTSAM
solves.

This is the reference: every tie point is a variable and every observation a factor of the linear graph. The few
factors on poses, control points, common errors and calibrations are GTSAM's own and are linearised by GTSAM; image
observations are linearised together by one compiled kernel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray, IntArray
from photogram.camera import calibration_sigmas, calibrations
from photogram.factors.common_errors import attitude_errors, parts, position_effects
from photogram.factors.constraints import constraint_factor, taking_part
from photogram.factors.elimination.loss import RobustLoss, robust_terms, steer
from photogram.factors.elimination.reprojection import (
    Linearisation,
    Observations,
    calibration_scale,
    linearise,
    reprojection_factors,
    residuals,
)
from photogram.factors.elimination.similarity_steps import bend_of, bent
from photogram.factors.elimination.state import State
from photogram.factors.elimination.summary import TiePointSummary
from photogram.factors.priors import (
    OWN_OFFSET_SIGMA_M,
    common_offset_prior,
    gnss_position,
    measured_attitude,
    offset_prior,
    surveyed_position,
    vector_prior,
)
from photogram.factors.rigs.exposures import estimated, exposure_factors, rig_priors, values_by_rig
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
from photogram.projection import PARAMETERS, recalibrated
from photogram.survey import Block


class IndeterminateError(ArithmeticError):
    """The linear system has no unique solution; ``variable`` is the kind and index that GTSAM names, None when it
    names none."""

    def __init__(self, variable: tuple[str, int] | None) -> None:
        super().__init__("the linear system has no unique solution")
        self.variable = variable


@dataclass(frozen=True, eq=False)
class Problem:
    """What is adjusted: observations of tie points and of control points, and the block with its priors.

    All photographs of ``block`` are oriented; ``control`` are its points of role control, ``control_sigma_m`` (G, 3)
    along ``control_axes`` (G, 3, 3), infinite along those that are checks; ``flights`` names the GNSS offsets.
    ``focal_information`` (cameras, cameras), px⁻², is added to the normal equations of the focal lengths for
    covariances, see photogram.factors.consider; None for an adjustment. ``further`` are factors beside those that
    follow from the block, on any of its variables but tie points: a distance between two control points, for one.
    ``summary`` stands for tie points that are not among the observations; the reduced system alone knows it.
    """

    block: Block
    tie: Observations
    marks: Observations
    control_world_m: FloatArray
    control_sigma_m: FloatArray
    control_axes: FloatArray
    flights: tuple[str, ...]
    robust_loss: RobustLoss
    robust_threshold: float
    focal_information: FloatArray | None = None
    further: tuple[gtsam.NonlinearFactor, ...] = ()
    summary: TiePointSummary | None = None

    @cached_property
    def free(self) -> tuple[IntArray, ...]:
        """Return per camera the indices of its free parameters, the coefficients of its lens field last."""
        return tuple(np.flatnonzero(sigmas > 0) for sigmas in calibration_sigmas(self.block.cameras))

    @cached_property
    def scale(self) -> FloatArray:
        """Return per camera the units (cameras, 12 + K) of its calibration variable."""
        cameras = self.block.cameras
        further = calibration_sigmas(cameras).shape[1] - PARAMETERS
        return np.array([calibration_scale(camera.focal_px, further) for camera in cameras])

    def with_tie_observations(self, tie: Observations) -> Problem:
        """Return the same problem with other observations of tie points."""
        return replace(self, tie=tie)


def ground_graph(problem: Problem, *, exposures: bool = True) -> gtsam.NonlinearFactorGraph:
    """Return the factors on control points, GNSS positions, attitudes, common errors, calibrations, constraints and
    rigs, and further ones; without the ``exposures`` of rigs for whoever linearises them together."""
    graph = gtsam.NonlinearFactorGraph()
    block = problem.block
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    for g in range(len(problem.control_world_m)):
        sigma_m, along = problem.control_sigma_m[g], problem.control_axes[g]
        graph.add(surveyed_position(g, problem.control_world_m[g], sigma_m, along))
    effects, attitude_error = position_effects(block), attitude_errors(block)
    for i, photograph in enumerate(block.photographs):
        if photograph.gnss_world_m is not None and photograph.gnss_sigma_m is not None:
            flight = problem.flights.index(photograph.flight) if problem.flights else None
            arm = photograph.lever_arm_camera_m
            position, sigma_m = photograph.gnss_world_m, photograph.gnss_sigma_m
            graph.add(gnss_position(i, position, sigma_m, flight, axes, arm, effects[i]))
        if photograph.attitude_world_from_camera is not None and photograph.attitude_sigma_rad is not None:
            attitude, sigma = photograph.attitude_world_from_camera, photograph.attitude_sigma_rad
            error = attitude_error[i] if attitude_error[i] >= 0 else None
            graph.add(measured_attitude(i, attitude, sigma, heading_known=photograph.heading_known, error=error))
    if block.datum_sigma_m > 0.0 and len(problem.flights) > 1:
        graph.add(common_offset_prior(len(problem.flights), block.gnss_offset_sigma_m, block.datum_sigma_m, axes))
    else:
        for f in range(len(problem.flights)):
            graph.add(offset_prior(f, np.maximum(block.gnss_offset_sigma_m, OWN_OFFSET_SIGMA_M), axes))
    for factor in _vector_priors(problem):
        graph.add(factor)
    for placed in taking_part(block):
        graph.add(constraint_factor(placed, block.frame, problem.control_world_m))
    for factor in (*rig_priors(block), *(exposure_factors(block) if exposures else ()), *problem.further):
        graph.add(factor)
    return graph


def _vector_priors(problem: Problem) -> Iterator[gtsam.NonlinearFactor]:
    """Yield the priors of common errors and calibrations."""
    cameras = problem.block.cameras
    for k, common in enumerate(problem.block.common_errors):
        yield from vector_prior(key(COMMON_ERROR, k), np.zeros(len(common.sigma)), common.sigma)
    expected, sigmas = calibrations(cameras), calibration_sigmas(cameras)
    for c, (free, unit) in enumerate(zip(problem.free, problem.scale, strict=True)):
        yield from vector_prior(key(CALIBRATION, c), (expected[c] / unit)[free], (sigmas[c] / unit)[free])


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


def cost(problem: Problem, graph: gtsam.NonlinearFactorGraph, state: State) -> float:
    """Return half the sum of squared whitened residuals, those of tie points under the robust loss."""
    tie = problem.tie.with_penalty(residuals(problem.tie, state.cameras, state.tie_point))
    marks = problem.marks.with_penalty(residuals(problem.marks, state.cameras, state.control))
    robust, _, _ = robust_terms(tie, problem.robust_loss, problem.robust_threshold)
    summarised = 0.0 if problem.summary is None else problem.summary.cost_at(state.cameras)
    return 0.5 * float(robust.sum() + np.sum(marks**2)) + summarised + float(graph.error(ground_values(problem, state)))


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
