"""The joint adjustment as a factor graph: the problem, its factors on everything but image points, and its cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import calibration_sigmas, calibrations
from photogram.factors.common_errors import attitude_errors, parts, position_effects
from photogram.factors.constraints import constraint_factor, taking_part
from photogram.factors.elimination.loss import RobustLoss, robust_terms
from photogram.factors.elimination.reprojection import (
    Observations,
    calibration_scale,
    residuals,
)
from photogram.factors.elimination.state import State
from photogram.factors.elimination.summary import TiePointSummary
from photogram.factors.linearised.alike import Factors, together
from photogram.factors.priors import (
    OWN_OFFSET_SIGMA_M,
    common_offset_prior,
    gnss_position,
    measured_attitude,
    offset_prior,
    surveyed_position,
    vector_prior,
)
from photogram.factors.rigs.exposures import exposure_factors, rig_priors, values_by_rig
from photogram.factors.surfaces.known_surface import surface_factors
from photogram.factors.variables import (
    CALIBRATION,
    COMMON_ERROR,
    CONTROL_POINT,
    GNSS_OFFSET,
    INDEX,
    RIG,
    key,
    kind_and_index,
)
from photogram.projection import PARAMETERS
from photogram.survey import Block


class IndeterminateError(ArithmeticError):
    """The linear system has no unique solution; ``variable`` is the kind and index that is named, None when none is."""

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
    further: tuple[Factors, ...] = ()
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


def ground_factors(problem: Problem) -> tuple[Factors, ...]:
    """Return the factors on control points, GNSS positions, attitudes, common errors, calibrations, constraints,
    rigs and a known surface, and further ones, alike ones together."""
    return together(_ground_factors(problem))


def _ground_factors(problem: Problem) -> Iterator[Factors]:
    block = problem.block
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    for g in range(len(problem.control_world_m)):
        sigma_m, along = problem.control_sigma_m[g], problem.control_axes[g]
        yield surveyed_position(g, problem.control_world_m[g], sigma_m, along)
    effects, attitude_error = position_effects(block), attitude_errors(block)
    for i, photograph in enumerate(block.photographs):
        if photograph.gnss_world_m is not None and photograph.gnss_sigma_m is not None:
            flight = problem.flights.index(photograph.flight) if problem.flights else None
            arm = photograph.lever_arm_camera_m
            position, sigma_m = photograph.gnss_world_m, photograph.gnss_sigma_m
            yield gnss_position(i, position, sigma_m, flight, axes, arm, effects[i])
        if photograph.attitude_world_from_camera is not None and photograph.attitude_sigma_rad is not None:
            attitude, sigma = photograph.attitude_world_from_camera, photograph.attitude_sigma_rad
            error = attitude_error[i] if attitude_error[i] >= 0 else None
            yield measured_attitude(i, attitude, sigma, heading_known=photograph.heading_known, error=error)
    if block.datum_sigma_m > 0.0 and len(problem.flights) > 1:
        yield common_offset_prior(len(problem.flights), block.gnss_offset_sigma_m, block.datum_sigma_m, axes)
    else:
        for f in range(len(problem.flights)):
            yield offset_prior(f, np.maximum(block.gnss_offset_sigma_m, OWN_OFFSET_SIGMA_M), axes)
    yield from _vector_priors(problem)
    for placed in taking_part(block):
        yield constraint_factor(placed, block.frame, problem.control_world_m)
    yield from rig_priors(block)
    yield from exposure_factors(block)
    yield from surface_factors(block, problem.free, problem.scale)
    yield from problem.further


def _vector_priors(problem: Problem) -> Iterator[Factors]:
    """Yield the priors of common errors and calibrations."""
    cameras = problem.block.cameras
    for k, common in enumerate(problem.block.common_errors):
        yield from vector_prior(key(COMMON_ERROR, k), np.zeros(len(common.sigma)), common.sigma)
    expected, sigmas = calibrations(cameras), calibration_sigmas(cameras)
    for c, (free, unit) in enumerate(zip(problem.free, problem.scale, strict=True)):
        yield from vector_prior(key(CALIBRATION, c), (expected[c] / unit)[free], (sigmas[c] / unit)[free])


class GroundValues:
    """The values of all variables but the tie points, in a state of a problem."""

    def __init__(self, problem: Problem, state: State) -> None:
        self._problem, self._state = problem, state

    def poses(self, variables: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the rotations (n, 3, 3), world from camera, and projection centres (n, 3) of poses (n,)."""
        index = variables & INDEX
        rotation: FloatArray = self._state.rotation[index]
        position: FloatArray = self._state.position[index]
        return rotation, position

    def velocities(self, variables: IntArray) -> FloatArray:
        """Return the velocities (n, 3) of poses (n,), m/s."""
        return np.asarray(self._state.velocity[variables & INDEX])

    def vectors(self, variables: IntArray) -> FloatArray:
        """Return the values (n, d) of variables (n,) of one kind that are no poses."""
        kind, index = kind_and_index(int(variables[0]))[0], variables & INDEX
        state, problem = self._state, self._problem
        if kind == CONTROL_POINT:
            return np.asarray(state.control[index])
        if kind == GNSS_OFFSET:
            return np.asarray(state.offset[index])
        if kind == RIG:
            return np.asarray(values_by_rig(problem.block, state.common)[index])
        if kind == COMMON_ERROR:
            where = parts(problem.block.common_errors)
            return np.array([state.common[where[k]] for k in index.tolist()])
        return np.array([(state.parameters[c] / problem.scale[c])[problem.free[c]] for c in index.tolist()])


def cost(problem: Problem, factors: tuple[Factors, ...], state: State) -> float:
    """Return half the sum of squared whitened residuals, those of tie points under the robust loss."""
    tie = problem.tie.with_penalty(residuals(problem.tie, state.cameras, state.tie_point))
    marks = problem.marks.with_penalty(residuals(problem.marks, state.cameras, state.control))
    robust, _, _ = robust_terms(tie, problem.robust_loss, problem.robust_threshold)
    summarised = 0.0 if problem.summary is None else problem.summary.cost_at(state.cameras)
    values = GroundValues(problem, state)
    ground = sum((factor.cost(values) for factor in factors), 0.0)
    return 0.5 * float(robust.sum() + np.sum(marks**2)) + summarised + ground
