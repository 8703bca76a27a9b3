"""From a block to the problem that is minimised: what is measured and unknown, where it starts, how it is run."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from photogram.adjustment.common_errors import with_attitude_errors, with_surface_error
from photogram.adjustment.effort import count_solution
from photogram.adjustment.partial_control import control_positions
from photogram.adjustment.rigs.rig_starts import with_rig_starts, without_companion_positions
from photogram.adjustment.shutters.rolling_shutter import in_motion
from photogram.arrays import FloatArray
from photogram.constraints.between_points import labels
from photogram.errors import AdjustmentError
from photogram.factors.common_errors import values_of
from photogram.factors.constraints import is_scaled, taking_part, without_shape
from photogram.factors.elimination.levenberg_marquardt import FIRST, FIRST_NEAR, Minimum
from photogram.factors.elimination.reprojection import Observations, observed_marks
from photogram.factors.elimination.solvers import need_gtsam
from photogram.factors.elimination.state import State
from photogram.factors.free_network import datum_conditions
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.minimisation import minimise_graph, minimise_problem
from photogram.factors.rigs.exposures import rig_values
from photogram.settings.settings import Settings, Within
from photogram.survey import Block, ControlPoints
from photogram.wording import Progress, silent


@dataclass(frozen=True)
class AdjustmentSettings(Settings):
    """How the joint adjustment is run; thresholds are in sigmas of the measurement."""

    tie_point_sigma_px: Annotated[
        float,
        Within(0.001, 100, "px"),
        "Standard deviation of the best tie points: the smallest key points at full quality, and what is measured by "
        "correlation.",
    ] = 0.5
    robust_loss: Annotated[Literal["none", "huber", "cauchy"], "Loss of tie points."] = "huber"
    robust_threshold: Annotated[float, Within(0.001, 1e6, "σ"), "Where the loss begins."] = 3.0
    outlier_threshold: Annotated[float, Within(0.001, 1e6, "σ"), "Residual of a mismatch, at least."] = 4.0
    first_outlier_threshold_px: Annotated[
        float, Within(0.001, 1e6, "px"), "The same before anything is adjusted; more where poses are worse."
    ] = 40.0
    minimum_ray_angle_deg: Annotated[float, Within(0, 90, "°"), "Tie points with narrower rays are left out."] = 1.0
    maximum_rounds: Annotated[int, Within(1, 1000), "Rounds in which mismatches are rejected."] = 10
    maximum_iterations: Annotated[int, Within(1, 100_000), "Iterations in each round."] = 200
    relative_tolerance: Annotated[
        float,
        Within(1e-18, 0.1, or_zero=True),
        "Change of the cost between accepted steps at which it has settled; 1e-3 before the last round.",
    ] = 1e-9
    common_errors: Annotated[
        Literal["auto", "none"], "What attitudes and positions have in common is estimated where it shows, or not."
    ] = "auto"
    lens_field: Annotated[
        Literal["auto", "always", "none"],
        "A smooth field beside the parameters of a camera; `auto`: where residuals show one.",
    ] = "auto"
    estimate_sigmas: Annotated[
        bool, "Sigmas of tie points, and those that are only assumed, are estimated from residuals."
    ] = True
    engine: Annotated[
        Literal["fast", "reference"],
        "Tie points are eliminated in one pass, or are variables of GTSAM's graph: slow, the same result.",
    ] = "fast"
    solver: Annotated[
        Literal["banded", "gtsam"], "What solves the reduced system of the fast engine: the same steps."
    ] = "banded"


def check_engine(settings: AdjustmentSettings) -> None:
    """Raise AdjustmentError where the settings ask for what needs GTSAM, and it is not installed."""
    if settings.engine == "reference":
        need_gtsam("engine: reference")
    if settings.solver == "gtsam":
        need_gtsam("solver: gtsam")


def minimise(
    problem: Problem,
    state: State,
    settings: AdjustmentSettings,
    progress: Progress = silent,
    *,
    near: bool = False,
) -> Minimum:
    """Minimise the cost by Levenberg–Marquardt with the engine of the settings; both take the same steps. ``near`` says
    that ``state`` is the minimum of a problem that differs little. Summaries of tie points are for the fast one alone.

    Raises IndeterminateError when the linear system has no unique solution, AdjustmentError as ``check_engine``.
    """
    taken, rays = 0, len(problem.tie) if problem.summary is None else 0

    def watch(iteration: int, value: float) -> None:
        nonlocal taken
        taken = iteration
        progress(0, 0, f"iteration {iteration}: cost {value:.6g}")

    limits, damping = (settings.maximum_iterations, settings.relative_tolerance), FIRST_NEAR if near else FIRST
    try:
        if settings.engine == "reference" and problem.summary is None:
            minimum = minimise_graph(problem, state, *limits, watch, damping)
        else:
            minimum = minimise_problem(problem, state, *limits, watch, settings.solver, damping)
    except IndeterminateError:
        count_solution(taken + 1, rays)
        raise
    count_solution(minimum.iterations, rays)
    return minimum


def start_state(problem: Problem) -> State:
    """Return the starting values of a problem."""
    block = problem.block
    return State(
        in_motion(block, block.oriented_cameras()),
        block.tie_points.position_world_m.copy(),
        control_positions(block)[0],
        np.zeros((len(problem.flights), 3)),
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


def _control_sigma_m(control: ControlPoints) -> FloatArray:
    return np.where(control.controlled, control.sigma_m, np.inf)


def with_sigmas_of(problem: Problem, block: Block) -> Problem:
    """Return the problem of the same block with other sigmas of its measurements."""
    control = block.control_points.with_role("control")
    return replace(
        problem,
        block=block,
        marks=observed_marks(control, np.isfinite(control.mark_sigma_px)),
        control_sigma_m=_control_sigma_m(control),
        further=datum_conditions(block),
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
    block = with_surface_error(block)
    tie, control = block.tie_points, block.control_points.with_role("control")
    flights: tuple[str, ...] = ()
    position, axes = control_positions(block)
    check_constraints(block, position)
    if np.any(block.gnss_offset_sigma_m > 0):
        flights = tuple(sorted({p.flight for p in block.photographs if p.gnss_world_m is not None}))
    return Problem(
        block,
        Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px),
        observed_marks(control, np.isfinite(control.mark_sigma_px)),
        position,
        _control_sigma_m(control),
        axes,
        flights,
        settings.robust_loss,
        settings.robust_threshold,
        further=datum_conditions(block),
    )
