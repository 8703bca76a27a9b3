"""The joint adjustment: Levenberg–Marquardt on the factor graph, outlier rounds, covariances.

Poses, calibration, tie points, control points, GNSS offsets and other common errors are estimated together. Tie points
carry a robust loss and are tested between rounds, with re-admission; control points, marks and GNSS positions are never
down-weighted.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photogram.adjustment.assumed_gnss import GnssScatter, gnss_scatters, gnss_steady, gnss_table, with_gnss_factors
from photogram.adjustment.common_errors import (
    MOST_CHANGES,
    What,
    estimates,
    left_arm,
    next_change,
    values_after,
    with_attitude_errors,
)
from photogram.adjustment.estimated_sigmas import (
    Factors,
    TieGroups,
    TieScatter,
    as_stated,
    factors_of,
    improved,
    joined,
    scattering,
    table,
    taken_by_cameras,
    tie_groups,
    tie_scatter,
    weighted,
    with_gnss_sigmas,
)
from photogram.adjustment.gnss_offsets import implied_offsets
from photogram.adjustment.ground_points import ground_points, mark_residuals_px, unmet
from photogram.adjustment.oriented_subset import registered_block, with_all_marks, with_all_photographs, without_marks
from photogram.adjustment.outliers import (
    agreeing_observations,
    first_agreement,
    noise_scale,
    outlier_limit_px,
    settled,
    without_narrow,
)
from photogram.adjustment.partial_control import control_positions
from photogram.adjustment.reliability import reliability
from photogram.adjustment.solvability import UnheldError, check_determined, check_in_front, undetermined, weak_parts
from photogram.adjustment.variance_components import variance_components
from photogram.arrays import FloatArray, IntArray
from photogram.camera import Pose
from photogram.errors import AdjustmentError, check_range
from photogram.factors.common_errors import values_of, with_values
from photogram.factors.consider import with_considered
from photogram.factors.covariance import Covariances, covariances
from photogram.factors.elimination.levenberg_marquardt import Minimum
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.reprojection import Observations, residuals
from photogram.factors.elimination.state import State
from photogram.factors.free_network import minimal_datum, relative_covariances
from photogram.factors.graph import IndeterminateError, Problem, cost, ground_graph
from photogram.factors.joint_covariance import joint_ground_covariance, points_redundancy, ray_covariances
from photogram.factors.minimisation import minimise_graph, minimise_problem
from photogram.results import Adjustment, EstimatedSigmas, Reliability, VarianceComponents
from photogram.survey import Block

Progress = Callable[[str], None]
_LOG = logging.getLogger(__name__)

LEFT_OUT = 0.25  # of the oriented photographs, that may be left out for the rest to be adjusted
MOST_LOST_MARKS = 3
MOST_REWEIGHTED = 3  # adjustments with sigmas that the covariances of the one before ask for


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


def minimise(
    problem: Problem, state: State, settings: AdjustmentSettings, progress: Progress = lambda _: None
) -> Minimum:
    """Minimise the cost by Levenberg–Marquardt with the engine of the settings; both take the same steps.

    Raises IndeterminateError when the linear system has no unique solution.
    """

    def watch(iteration: int, value: float) -> None:
        progress(f"iteration {iteration}: cost {value:.6g}")

    limits = settings.maximum_iterations, settings.relative_tolerance
    if settings.engine == "reference":
        return minimise_graph(problem, state, *limits, watch)
    return minimise_problem(problem, state, *limits, watch, settings.solver)


def start_state(block: Block, flights: tuple[str, ...]) -> State:
    """Return the starting values of a block whose photographs are all oriented."""
    return State(
        block.oriented_cameras(),
        block.tie_points.position_world_m.copy(),
        control_positions(block)[0],
        np.zeros((len(flights), 3)),
        values_of(block.common_errors),
    )


def without_attitudes(block: Block) -> Block:
    """Return the block without measured attitudes: those of a free network have oriented its frame, and would strain
    its datum."""
    bare = (replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None) for p in block.photographs)
    return replace(block, photographs=tuple(bare))


def make_problem(block: Block, settings: AdjustmentSettings) -> Problem:
    """Return the problem of a block, with all its tie-point observations and, unless the settings have none, a common
    error of the measured attitudes of each flight.

    Raises AdjustmentError naming every photograph that has no pose, or a control point that nothing places.
    """
    missing = [p.name for p, pose in zip(block.photographs, block.poses, strict=True) if pose is None]
    if missing:
        raise AdjustmentError(f"not oriented, so they cannot be adjusted: {', '.join(missing)}")
    if block.is_free:
        block = without_attitudes(block)
    elif settings.common_errors == "auto":
        block = with_attitude_errors(block)
    tie, control = block.tie_points, block.control_points.with_role("control")
    flights: tuple[str, ...] = ()
    position, axes = control_positions(block)
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


@dataclass(frozen=True, eq=False)
class Solved:
    """The end of the outlier rounds: the ``whole`` problem with the sigmas that were used, the ``problem`` of the
    observations that took part, and its minimum. ``limit_px`` (N,) bounded the residuals, ``factors`` multiply stated
    sigmas by ``groups``."""

    whole: Problem
    problem: Problem
    minimum: Minimum
    used: NDArray[np.bool_]
    limit_px: FloatArray
    groups: TieGroups
    factors: Factors
    rounds: int
    iterations: int


def _with_cameras_held(block: Block) -> Block:
    return replace(block, cameras=tuple(replace(c, sigmas=np.zeros_like(c.sigmas)) for c in block.cameras))


def _solve_rounds(
    stated: Problem, state: State, settings: AdjustmentSettings, progress: Progress, sigmas: EstimatedSigmas | None
) -> Solved:
    """Alternate between choosing the observations that agree, adjusting with them and estimating their sigmas, until
    choice and sigmas settle. ``sigmas`` are those that are used, None where they are to be estimated."""
    groups, estimating = tie_groups(stated.block), sigmas is None
    factors = as_stated(groups) if sigmas is None else factors_of(stated.block, groups, sigmas)
    whole, steady = weighted(stated, groups, factors), not estimating
    angle, iterations = float(np.deg2rad(settings.minimum_ray_angle_deg)), 0
    first, chosen, points = first_agreement(whole, state, settings.first_outlier_threshold_px, angle)
    used: NDArray[np.bool_] = np.zeros(len(whole.tie), dtype=bool)
    limit_px = np.full(len(whole.tie), first)
    draft = replace(settings, relative_tolerance=max(1e-3, settings.relative_tolerance))
    for number in range(1, settings.maximum_rounds + 1):
        last = number == settings.maximum_rounds or (number > 2 and steady and settled(used, chosen))
        used = chosen
        problem = whole.with_tie_observations(whole.tie.select(used))
        check_determined(problem)
        if number == 1 and not last and first > settings.first_outlier_threshold_px:
            # Poses so far off would bend the calibration to fit them.
            problem = replace(problem, block=_with_cameras_held(whole.block))
        progress(f"round {number}: {len(problem.tie)} observations of {len(np.unique(problem.tie.point))} tie points")
        minimum = minimise(problem, replace(state, tie_point=points), settings if last else draft, progress)
        iterations += minimum.iterations
        if last:
            break
        state = minimum.state
        if estimating and number > 1:  # what the first round keeps says nothing of the noise yet
            found = tie_scatter(problem, state, groups.select(used), limit_px[used], taken_by_cameras(problem))
            better = factors if found is None else improved(found, factors, groups)
            steady, factors = better.are_near(factors), better
            whole = weighted(stated, groups, factors)
        part = whole.tie.select(used)
        scale = noise_scale(residuals(part, state.cameras, state.tie_point), part.point, len(state.tie_point))
        limit_px = outlier_limit_px(whole.block.tie_points, scale, settings.outlier_threshold)
        _LOG.debug(
            "round %d: %d of %d observations took part, cost %.6g after %d iterations; they scatter by %.3g sigma, "
            "that stated times %s",
            number, len(problem.tie), len(used), minimum.cost, minimum.iterations, scale, factors.group,
        )  # fmt: skip
        chosen, points = agreeing_observations(whole, state, limit_px, angle)
    check_in_front(problem, minimum.state)
    used = without_narrow(whole.block.tie_points, minimum.state, used, angle)
    return Solved(whole, problem, minimum, used, limit_px, groups, factors, number, iterations)


def sigma0_and_redundancy(problem: Problem, state: State) -> tuple[float, int]:
    """Return sigma0 = sqrt(vᵀPv / r) of the minimised squares, and the redundancy r."""
    block = problem.block
    graph = ground_graph(problem)
    image = 2 * (len(problem.tie) + len(problem.marks))
    ground = sum(graph.at(i).dim() for i in range(graph.size())) - int(np.isinf(problem.control_sigma_m).sum())
    points = 3 * (len(np.unique(problem.tie.point)) + len(state.control) + len(state.offset))
    unknowns = 6 * len(block.photographs) + points + len(state.common) + sum(len(f) for f in problem.free)
    redundancy = image + ground - unknowns
    tie = residuals(problem.tie, state.cameras, state.tie_point)
    robust, weight, _ = robust_terms(tie, problem.robust_loss, problem.robust_threshold)
    squares = 2.0 * (cost(problem, graph, state) - 0.5 * float(robust.sum())) + float(np.sum(weight[:, None] * tie**2))
    return float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan"), redundancy


@dataclass(frozen=True, eq=False)
class _Judged:
    """A solved block with only what took part, (P,) of whose tie points are ``kept``: its covariances with focal
    lengths as ``held`` and with those ``counted`` that are considered, reliability with both and with the held alone,
    and what scatters by how much."""

    block: Block
    kept: NDArray[np.bool_]
    problem: Problem
    state: State
    held: Covariances
    counted: Problem
    covariances: Covariances
    tested: Reliability
    tested_held: Reliability
    sigma0: float
    redundancy: int
    components: VarianceComponents
    ties: TieScatter | None
    gnss: list[GnssScatter]


def _judged(solved: Solved, stated: Block, settings: AdjustmentSettings) -> _Judged:
    """Return a solved block with its covariances, and what its observations scatter by; ``stated`` is the block with
    all its observations and the sigmas as stated."""
    whole, state = solved.whole.block, solved.minimum.state
    kept = np.bincount(whole.tie_points.point[solved.used], minlength=len(whole.tie_points)) >= 2
    mine = kept[whole.tie_points.point] & solved.used
    tie = replace(whole.tie_points, position_world_m=state.tie_point).select(kept, solved.used)
    cameras = tuple(c.with_parameters(q) for c, q in zip(whole.cameras, state.parameters, strict=True))
    poses = tuple(Pose(R, C) for R, C in zip(state.rotation, state.position, strict=True))
    common = with_values(whole, state.common)
    adjusted = replace(whole, cameras=cameras, poses=poses, tie_points=tie, common_errors=common)
    state = replace(state, tie_point=tie.position_world_m)
    problem = solved.problem.with_tie_observations(Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px))
    held = covariances(problem, state)
    counted = with_considered(problem, state)
    found = held if counted is problem else covariances(counted, state)
    tested = reliability(problem, state, held, counted, found)
    tested_held = tested if counted is problem else reliability(problem, state, held)
    sigma0, redundancy = sigma0_and_redundancy(problem, state)
    groups = solved.groups.select(mine)
    names = _median_sigmas(stated, groups) if settings.estimate_sigmas else None
    components = variance_components(problem, state, held, tested, redundancy, names)
    ties, gnss = None, list[GnssScatter]()
    if settings.estimate_sigmas:
        # what is considered changes no estimate, so it changes no sigma either
        plain = components if counted is problem else variance_components(problem, state, held, tested_held, redundancy)
        of_ties = float(plain.redundancy[plain.group == "tie_points"].sum())
        taken = float(points_redundancy(problem, state).sum()) - of_ties
        ties = tie_scatter(problem, state, groups, solved.limit_px[mine], taken)
        gnss = gnss_scatters(problem, tested_held)
    return _Judged(
        adjusted,
        kept,
        problem,
        state,
        held,
        counted,
        found,
        tested,
        tested_held,
        sigma0,
        redundancy,
        components,
        ties,
        gnss,
    )


def _median_sigmas(stated: Block, groups: TieGroups) -> dict[str, float]:
    """Return the medians of the stated sigmas of the groups of variance components for which others are estimated."""
    medians = {"tie_points": float(np.median(groups.stated_px))} if len(groups.stated_px) else {}
    gnss = [p.gnss_sigma_m for p in stated.photographs if p.gnss_sigma_m is not None]
    if gnss:
        plan_and_height = np.array(gnss)
        medians["gnss_plan"] = float(np.median(plan_and_height[:, :2]))
        medians["gnss_height"] = float(np.median(plan_and_height[:, 2]))
    return medians


def _reweighted(solved: Solved, judged: _Judged, stated: Problem, settings: AdjustmentSettings) -> Solved | None:
    """Return the block adjusted again with the sigmas that its covariances ask for, None where these stay.

    In the rounds the redundancy of tie points was that of many beside little else, here it is exact; GNSS positions of
    assumed sigmas need their redundancy numbers.
    """
    factors = solved.factors if judged.ties is None else improved(judged.ties, solved.factors, solved.groups)
    block = with_gnss_factors(solved.whole.block, judged.gnss)
    if factors.are_near(solved.factors) and gnss_steady(solved.whole.block, block):
        return None
    whole = weighted(replace(stated, block=replace(block, tie_points=stated.block.tie_points)), solved.groups, factors)
    problem = whole.with_tie_observations(whole.tie.select(solved.used))
    minimum = minimise(problem, solved.minimum.state, settings)
    iterations = solved.iterations + minimum.iterations
    return replace(solved, whole=whole, problem=problem, minimum=minimum, factors=factors, iterations=iterations)


@dataclass(frozen=True, eq=False)
class _Unknowns:
    """The common errors of positions on their way among the unknowns: those ``barred`` since they were dropped, what
    explains the measurements ``as_well`` as one of them, and how many changes there were."""

    barred: tuple[What, ...] = ()
    as_well: Mapping[tuple[str, int | None], str] = field(default_factory=dict)
    changes: int = 0


def _with_common_error(
    solved: Solved, judged: _Judged, settings: AdjustmentSettings, so_far: _Unknowns, progress: Progress
) -> tuple[Solved, _Unknowns] | None:
    """Return the block adjusted again from the present state with a common error of positions added or dropped, None
    where the unknowns are right."""
    if settings.common_errors == "none" or so_far.changes == MOST_CHANGES:
        return None
    change = next_change(judged.problem, judged.state, judged.held, judged.tested_held, so_far.barred)
    if change is None:
        return None
    names = ", ".join(error.kind.replace("_", " ") for error in change.errors)
    _LOG.debug("common errors: %s", names or "none")
    whole = replace(solved.whole, block=replace(solved.whole.block, common_errors=change.errors))
    problem = whole.with_tie_observations(whole.tie.select(solved.used))
    state = solved.minimum.state
    start = replace(state, common=values_after(solved.problem, state, change.errors))
    progress(f"common errors: {names}")
    minimum = minimise(problem, start, settings, progress)
    iterations = solved.iterations + minimum.iterations
    dropped = () if change.dropped is None else (change.dropped,)
    known = _Unknowns((*so_far.barred, *dropped), {**so_far.as_well, **change.as_well}, so_far.changes + 1)
    return replace(solved, whole=whole, problem=problem, minimum=minimum, iterations=iterations), known


def adjust(
    block: Block,
    settings: AdjustmentSettings,
    progress: Progress = lambda _: None,
    *,
    start: Sequence[FloatArray] = (),
    sigmas: EstimatedSigmas | None = None,
) -> Adjustment:
    """Adjust a block jointly, reject mismatched observations, and compute covariances, in the block's world frame, m.

    Photographs without a pose take no part; tie points need no position to start from. ``start`` holds the interior
    orientation (11,) of each camera to start from, where it is not the given one, which stays the mean of the priors;
    what is held stays as given. ``sigmas`` are those of another adjustment of these observations: they are used as
    they are, and none are estimated. A single photograph or mark that keeps the rest from a solution is left out,
    with the reason in ``warnings``. Raises AdjustmentError naming the variable that is not determined, and what it
    lacks.
    """
    part, oriented = block, len(registered_block(block)[1])
    if not oriented:
        raise AdjustmentError("no photograph is oriented")
    left: dict[int, str] = {}
    marks = np.ones(len(block.control_points.mark_point), dtype=bool)
    lost_marks: list[str] = []
    while True:
        solvable, kept = registered_block(part)
        try:
            adjusted = _adjust_oriented(solvable, settings, progress, start, sigmas)
            break
        except UnheldError as fault:
            left |= {int(kept[i]): why for i, why in fault.photographs.items()}
            lost_marks += fault.marks.values()
            if (
                len(left) > max(1.0, LEFT_OUT * oriented)
                or oriented - len(left) < 2
                or len(lost_marks) > MOST_LOST_MARKS
            ):
                raise
            marks[_of_all(block, marks, kept)[list(fault.marks)]] = False
            poses = tuple(None if i in left else pose for i, pose in enumerate(block.poses))
            part = without_marks(replace(block, poses=poses), marks)
    names = [photograph.name for photograph in block.photographs]
    said = [f"Photograph {names[i]} is left out: {why}" for i, why in left.items()]
    said += [f"A mark is left out: {why}" for why in lost_marks]
    reason = tuple(left.get(i, "") for i in range(len(names))) if left else ()
    adjusted = replace(adjusted, warnings=(*said, *adjusted.warnings), reason=reason)
    if len(kept) < len(block.poses):
        adjusted = with_all_photographs(adjusted, part, kept)
    return adjusted if marks.all() else with_all_marks(adjusted, block, marks)


def _of_all(block: Block, marks: NDArray[np.bool_], kept: IntArray) -> IntArray:
    """Return the numbers in ``block`` of the marks ``marks`` (M,) in the photographs ``kept`` (K,)."""
    return np.flatnonzero(marks & np.isin(block.control_points.mark_photograph, kept))


def _adjust_oriented(
    block: Block,
    settings: AdjustmentSettings,
    progress: Progress,
    start: Sequence[FloatArray],
    sigmas: EstimatedSigmas | None,
) -> Adjustment:
    """Adjust a block whose photographs all have a pose to start from."""
    estimating = settings.estimate_sigmas and sigmas is None
    used = None if estimating else sigmas or EstimatedSigmas.none()
    whole = make_problem(block if used is None else with_gnss_sigmas(block, used), settings)
    try:
        first = start_state(whole.block, whole.flights)
        if len(start):
            free = np.array([camera.sigmas > 0.0 for camera in block.cameras])
            moved = np.where(free, np.array(start), first.parameters)
            first = replace(first, cameras=first.cameras._replace(parameters=moved))
        solved = _solve_rounds(whole, first, settings, progress, used)
        progress("covariances")
        judged, unknowns = _judged(solved, block, settings), _Unknowns()
        reweighted = 0 if estimating else MOST_REWEIGHTED
        while True:
            changed = _with_common_error(solved, judged, settings, unknowns, progress)
            if changed is not None:
                solved, unknowns = changed
            elif reweighted < MOST_REWEIGHTED:
                again = _reweighted(solved, judged, whole, settings)
                if again is None:
                    break
                solved, reweighted = again, reweighted + 1
            else:
                break
            judged = _judged(solved, block, settings)
    except IndeterminateError as fault:
        raise undetermined(whole, fault) from fault
    final, final_state, state, tie = judged.problem, judged.state, solved.minimum.state, judged.block.tie_points
    held, found, counted, tested = judged.held, judged.covariances, judged.counted, judged.tested
    ground, ground_covariance = ground_points(final, final_state, found)
    estimated = EstimatedSigmas.none()
    if settings.estimate_sigmas:
        ties = table(block, solved.groups.select(judged.kept[solved.whole.tie.point] & solved.used), solved.factors,
                     judged.ties)  # fmt: skip
        estimated = joined(ties, gnss_table(block, judged.block, judged.gnss))
    poses, R, tie_covariance = found.poses, state.rotation, found.tie_point
    joint = joint_ground_covariance(counted, final_state, found, ground)
    if block.is_free:
        relative = relative_covariances(counted, final_state, found, ground, joint)
        poses, tie_covariance, joint = relative.poses, relative.tie_point, relative.ground
        own = np.arange(3 * len(ground)).reshape(-1, 3)
        ground_covariance = joint[own[:, :, None], own[:, None, :]]
    held_flights, implied, implied_covariance = implied_offsets(final, final_state, held)
    arm = left_arm(final, final_state, held)
    tie_residual = residuals(final.tie, state.cameras, tie.position_world_m)
    return Adjustment(
        block=judged.block,
        sigma0=judged.sigma0,
        redundancy=judged.redundancy,
        residual_px=tie_residual * tie.sigma_px[:, None],
        mark_residual_px=mark_residuals_px(block, ground, state),
        position_covariance_m2=R @ poses[:, 3:, 3:] @ R.transpose(0, 2, 1),
        rotation_covariance_rad2=poses[:, :3, :3],
        calibration_covariance=np.array([found.calibration(c) for c in range(len(block.cameras))]),
        tie_point_covariance_m2=tie_covariance,
        ground_world_m=ground,
        ground_covariance_m2=ground_covariance,
        flights=whole.flights,
        offset_world_m=state.offset,
        offset_covariance_m2=np.array([found.offset(f) for f in range(len(whole.flights))]).reshape(-1, 3, 3),
        iterations=solved.iterations,
        rounds=solved.rounds,
        converged=solved.minimum.converged,
        cost=solved.minimum.cost,
        discarded_observations=int(np.count_nonzero(~solved.used)),
        discarded_points=int(np.count_nonzero(~judged.kept)),
        reliability=tested,
        ground_joint_covariance_m2=joint,
        tie_point_ray_covariance_m2=ray_covariances(final, final_state),
        components=judged.components,
        sigmas=estimated,
        held_flights=held_flights,
        implied_offset_world_m=implied,
        implied_offset_covariance_m2=implied_covariance,
        left_arm_camera_m=arm.arm_camera_m,
        left_arm_sigma_m=arm.sigma_m,
        left_arm_p=arm.p,
        common_errors=estimates(final, final_state, held, found, dict(unknowns.as_well)),
        warnings=(*unmet(block, ground), *weak_parts(counted, final_state, found), *scattering(estimated)),
    )
