"""From a block to the problem that is minimised: what is measured and unknown, where it starts, how it is run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from photogram.adjustment.common_errors import with_attitude_errors
from photogram.adjustment.partial_control import control_positions
from photogram.adjustment.rigs.rig_starts import with_rig_starts, without_companion_positions
from photogram.adjustment.shutters.rolling_shutter import in_motion
from photogram.arrays import FloatArray
from photogram.constraints.between_points import labels
from photogram.errors import AdjustmentError, check_range
from photogram.factors.common_errors import values_of
from photogram.factors.constraints import is_scaled, taking_part, without_shape
from photogram.factors.elimination.levenberg_marquardt import Minimum
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.elimination.state import State
from photogram.factors.free_network import minimal_datum
from photogram.factors.graph import Problem
from photogram.factors.minimisation import minimise_graph, minimise_problem
from photogram.factors.rigs.exposures import rig_values
from photogram.survey import Block
from photogram.wording import Progress, silent


@dataclass(frozen=True)
class AdjustmentSettings:
    """How the joint adjustment is run; thresholds are in sigmas of the measurement."""

    tie_point_sigma_px: float = 0.5
    robust_loss: Literal["none", "huber", "cauchy"] = "huber"
    robust_threshold: float = 3.0
    outlier_threshold: float = 4.0
    first_outlier_threshold_px: float = 40.0  # of rays before anything is adjusted; more where poses are worse
    minimum_ray_angle_deg: float = 1.0
    maximum_rounds: int = 10
    maximum_iterations: int = 200  # per round
    relative_tolerance: float = 1e-9  # of the cost, between accepted steps; 1e-3 before the last round
    common_errors: Literal["auto", "none"] = "auto"  # of attitudes and positions, estimated where they show
    lens_field: Literal["auto", "always", "none"] = "auto"  # beside the cameras' parameters, where residuals show one
    estimate_sigmas: bool = True  # of tie points, and of GNSS positions where they are assumed, from their residuals
    engine: Literal["fast", "reference"] = "fast"  # points eliminated in one pass, or variables of GTSAM's graph
    solver: Literal["banded", "gtsam"] = "banded"  # of the fast engine's reduced system

    def __post_init__(self) -> None:
        for name in ("tie_point_sigma_px", "robust_threshold", "outlier_threshold", "first_outlier_threshold_px"):
            check_range(name, getattr(self, name), 1e-3)
        check_range("minimum_ray_angle_deg", self.minimum_ray_angle_deg, 0.0, 90.0)
        check_range("maximum_rounds", self.maximum_rounds, 1)
        check_range("maximum_iterations", self.maximum_iterations, 1)
        check_range("relative_tolerance", self.relative_tolerance, 0.0, 0.1)


def minimise(problem: Problem, state: State, settings: AdjustmentSettings, progress: Progress = silent) -> Minimum:
    """Minimise the cost by Levenberg–Marquardt with the engine of the settings; both take the same steps.

    Raises IndeterminateError when the linear system has no unique solution.
    """

    def watch(iteration: int, value: float) -> None:
        progress(0, 0, f"iteration {iteration}: cost {value:.6g}")

    limits = settings.maximum_iterations, settings.relative_tolerance
    if settings.engine == "reference":
        return minimise_graph(problem, state, *limits, watch)
    return minimise_problem(problem, state, *limits, watch, settings.solver)


def start_state(block: Block, flights: tuple[str, ...]) -> State:
    """Return the starting values of a block whose photographs are all oriented."""
    return State(
        in_motion(block, block.oriented_cameras()),
        block.tie_points.position_world_m.copy(),
        control_positions(block)[0],
        np.zeros((len(flights), 3)),
        np.concatenate([values_of(block.common_errors), rig_values(block)]),
    )


def without_attitudes(block: Block) -> Block:
    """Return the block without measured attitudes: those of a free network have oriented its frame, and would strain
    its datum."""
    bare = (replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None) for p in block.photographs)
    return replace(block, photographs=tuple(bare))


def check_constraints(block: Block, control_world_m: FloatArray) -> None:
    """Raise AdjustmentError for constraints that mean nothing: heights and planes in a network without a vertical or a
    scale, a plane through points (G, 3) in one line."""
    for placed in taking_part(block):
        constraint, name = placed.constraint, labels(block.constraints)[placed.number]
        if block.is_free and constraint.kind in ("height difference", "level surface"):
            raise AdjustmentError(
                f"{constraint.kind} {name}: a network without georeference has no vertical that heights could be "
                "counted along: give control points, or leave it out"
            )
        if block.is_free and constraint.kind == "plane" and not is_scaled(block):
            raise AdjustmentError(
                f"plane {name}: a network without a scale has no metres for its standard deviation: give a distance"
            )
        whole = np.ones(len(placed.index), dtype=bool)
        if constraint.kind == "plane" and without_shape(constraint, control_world_m[placed.index], whole):
            raise AdjustmentError(
                f"plane {name}: its points lie in one line, through which many planes go: add one beside it"
            )


def make_problem(block: Block, settings: AdjustmentSettings) -> Problem:
    """Return the problem of a block, with all its tie-point observations and, unless the settings have none, a common
    error of the measured attitudes of each flight.

    Raises AdjustmentError naming every photograph that has no pose, a control point that nothing places, or a
    constraint that means nothing.
    """
    missing = [p.name for p, pose in zip(block.photographs, block.poses, strict=True) if pose is None]
    if missing:
        raise AdjustmentError(f"not oriented, so they cannot be adjusted: {', '.join(missing)}")
    if block.rigs:
        block = without_companion_positions(with_rig_starts(block))
    if block.is_free:
        block = without_attitudes(block)
    elif settings.common_errors == "auto":
        block = with_attitude_errors(block)
    tie, control = block.tie_points, block.control_points.with_role("control")
    flights: tuple[str, ...] = ()
    position, axes = control_positions(block)
    check_constraints(block, position)
    if np.any(block.gnss_offset_sigma_m > 0):
        flights = tuple(sorted({p.flight for p in block.photographs if p.gnss_world_m is not None}))
    return Problem(
        block,
        Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px),
        Observations(
            control.mark_photograph,
            control.mark_point,
            control.mark_pixel,
            control.mark_sigma_px,
        ).select(np.isfinite(control.mark_sigma_px)),
        position,
        np.where(control.controlled, control.sigma_m, np.inf),
        axes,
        flights,
        settings.robust_loss,
        settings.robust_threshold,
        further=minimal_datum(block),
    )
