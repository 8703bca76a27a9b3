"""The joint adjustment: Levenberg–Marquardt on the factor graph, outlier rounds, covariances.

Poses, calibration, tie points, control points, GNSS offsets and other common errors are estimated together. Tie points
carry a robust loss and are tested between rounds, with re-admission; control points, marks and GNSS positions are never
down-weighted.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from photogram.adjustment.assessment import Assessed, assessed
from photogram.adjustment.common_errors import (
    MOST_CHANGES,
    What,
    estimates,
    next_change,
    residual_lever_arm,
    values_after,
)
from photogram.adjustment.constraint_tests import constraint_tests
from photogram.adjustment.gnss_offsets import implied_offsets
from photogram.adjustment.ground_points import ground_points, mark_residuals_px, unmet
from photogram.adjustment.oriented_subset import registered_block, with_all_marks, with_all_photographs, without_marks
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.rigs.exposure_tests import exposure_tests
from photogram.adjustment.rounds import Solved, solve_rounds
from photogram.adjustment.shutters.rolling_shutter import (
    Readouts,
    Shutters,
    free_readouts,
    is_clear,
    is_significant,
    neighbours_scatter_m_s,
    readout_estimates,
    requested,
    with_readouts,
    without_rolling,
)
from photogram.adjustment.solvability import UndeterminedPartError, undetermined, weak_parts
from photogram.adjustment.stochastic_model.assumed_gnss import gnss_steady, gnss_table, with_gnss_factors
from photogram.adjustment.stochastic_model.estimated_sigmas import (
    improved,
    joined,
    scattering,
    table,
    weighted,
    with_gnss_sigmas,
)
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Pose, calibration_sigmas
from photogram.errors import AdjustmentError
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.free_network import relative_covariances
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.joint_covariance import joint_ground_covariance, ray_covariances
from photogram.projection import PARAMETERS, READOUT, recalibrated
from photogram.results import Adjustment, AdjustmentCovariances, Decisions, EstimatedSigmas, Estimates, StatisticalTests
from photogram.survey import Block
from photogram.wording import Progress, silent

_LOG = logging.getLogger(__name__)

LEFT_OUT = 0.25  # of the oriented photographs, that may be left out for the rest to be adjusted
MOST_LOST_MARKS = 3
MOST_REWEIGHTED = 3  # adjustments with sigmas that the covariances of the one before ask for


def _solved_again(
    solved: Solved, whole: Problem, start: State, settings: AdjustmentSettings, progress: Progress = silent
) -> Solved:
    """Return ``whole``, with the observations that took part, adjusted again from ``start``."""
    problem = whole.with_tie_observations(whole.tie.select(solved.used))
    minimum = minimise(problem, start, settings, progress)
    iterations = solved.iterations + minimum.iterations
    return replace(solved, whole=whole, problem=problem, minimum=minimum, iterations=iterations)


def _reweighted(solved: Solved, assessment: Assessed, stated: Problem, settings: AdjustmentSettings) -> Solved | None:
    """Return the block adjusted again with the sigmas that its covariances ask for, None where these stay.

    In the rounds the redundancy of tie points was that of many beside little else, here it is exact; GNSS positions of
    assumed sigmas need their redundancy numbers.
    """
    factors = solved.factors if assessment.ties is None else improved(assessment.ties, solved.factors, solved.groups)
    block = with_gnss_factors(solved.whole.block, assessment.gnss)
    if factors.are_near(solved.factors) and gnss_steady(solved.whole.block, block):
        return None
    whole = weighted(replace(stated, block=replace(block, tie_points=stated.block.tie_points)), solved.groups, factors)
    return replace(_solved_again(solved, whole, solved.minimum.state, settings), factors=factors)


@dataclass(frozen=True, eq=False)
class _Unknowns:
    """The common errors of positions on their way among the unknowns: those ``barred`` since they were dropped, what
    explains the measurements ``as_well`` as one of them, and how many changes there were."""

    barred: tuple[What, ...] = ()
    as_well: Mapping[tuple[str, int | None], str] = field(default_factory=dict)
    changes: int = 0


def _with_common_error(
    solved: Solved, assessment: Assessed, settings: AdjustmentSettings, so_far: _Unknowns, progress: Progress
) -> tuple[Solved, _Unknowns] | None:
    """Return the block adjusted again from the present state with a common error of positions added or dropped, None
    where the unknowns are right."""
    if settings.common_errors == "none" or so_far.changes == MOST_CHANGES:
        return None
    change = next_change(assessment.problem, assessment.state, assessment.fixed, assessment.tested_fixed, so_far.barred)
    if change is None:
        return None
    names = ", ".join(error.kind.replace("_", " ") for error in change.errors)
    _LOG.debug("common errors: %s", names or "none")
    whole = replace(solved.whole, block=replace(solved.whole.block, common_errors=change.errors))
    state = solved.minimum.state
    start = replace(state, common=values_after(solved.problem, state, change.errors))
    progress(0, 0, f"common errors: {names}")
    dropped = () if change.dropped is None else (change.dropped,)
    known = _Unknowns((*so_far.barred, *dropped), {**so_far.as_well, **change.as_well}, so_far.changes + 1)
    return _solved_again(solved, whole, start, settings, progress), known


def _without_none(solved: Solved, none: BoolArray, settings: AdjustmentSettings, progress: Progress) -> Solved | None:
    """Return the block adjusted again with those of the read-out times that are ``none`` (C,) and still unknowns held
    at zero, None without any."""
    zeroed = none & free_readouts(solved.whole.block.cameras)
    if not zeroed.any():
        return None
    progress(0, 0, "no rolling shutter: the read-out time is held at zero")
    whole = replace(solved.whole, block=without_rolling(solved.whole.block, zeroed))
    state = solved.minimum.state
    parameters = state.parameters.copy()
    parameters[zeroed, READOUT] = 0.0
    start = replace(state, cameras=recalibrated(state.cameras, parameters))
    return _solved_again(solved, whole, start, settings, progress)


def adjust(
    block: Block,
    settings: AdjustmentSettings,
    progress: Progress = silent,
    *,
    start: Sequence[FloatArray] = (),
    sigmas: EstimatedSigmas | None = None,
) -> Adjustment:
    """Adjust a block jointly, reject mismatched observations, and compute covariances, in the block's world frame, m.

    Photographs without a pose take no part; tie points need no position to start from. ``start`` holds the interior
    orientation (12,) of each camera to start from, with or without the coefficients of a lens field, where it is not
    the given one, which stays the mean of the priors; what is held stays as given. ``sigmas`` are those of another
    adjustment of these observations: they are used as they are, and none are estimated. A single photograph or mark
    that keeps the rest from a solution is left out, with the reason in ``warnings``. Raises AdjustmentError naming the
    variable that is not determined, and what it lacks.
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
        except UndeterminedPartError as error:
            left |= {int(kept[i]): why for i, why in error.photographs.items()}
            lost_marks += error.marks.values()
            if (
                len(left) > max(1.0, LEFT_OUT * oriented)
                or oriented - len(left) < 2
                or len(lost_marks) > MOST_LOST_MARKS
            ):
                raise
            marks[_of_all(block, marks, kept)[list(error.marks)]] = False
            poses = tuple(None if i in left else pose for i, pose in enumerate(block.poses))
            part = without_marks(replace(block, poses=poses), marks)
    names = block.photograph_names
    sentences = [f"Photograph {names[i]} is left out: {why}" for i, why in left.items()]
    sentences += [f"A mark is left out: {why}" for why in lost_marks]
    reason = tuple(left.get(i, "") for i in range(len(names))) if left else ()
    adjusted = replace(
        adjusted, warnings=(*sentences, *adjusted.warnings), decisions=replace(adjusted.decisions, reason=reason)
    )
    if len(kept) < len(block.poses):
        adjusted = with_all_photographs(adjusted, part, kept)
    return adjusted if marks.all() else with_all_marks(adjusted, block, marks)


def _of_all(block: Block, marks: BoolArray, kept: IntArray) -> IntArray:
    """Return the numbers in ``block`` of the marks ``marks`` (M,) in the photographs ``kept`` (K,)."""
    return np.flatnonzero(marks & np.isin(block.control_points.mark_photograph, kept))


@dataclass(frozen=True, eq=False)
class _Ended:
    """The end of an adjustment of a ``block``: the problem as stated, its solution, what that is worth, and the
    shutters as they were found."""

    block: Block
    whole: Problem
    solved: Solved
    assessment: Assessed
    unknowns: _Unknowns
    shutters: Shutters


@dataclass(frozen=True, eq=False)
class _Rolling:
    """Where an adjustment was when cameras ``there`` (C,) turned out to have rolling shutters."""

    there: BoolArray
    poses: tuple[Pose, ...]
    parameters: FloatArray
    tie_point: FloatArray

    @staticmethod
    def at(state: State, there: BoolArray) -> _Rolling:
        """Return what to start from again at a state."""
        poses = zip(state.rotation, state.position, state.velocity, strict=True)
        return _Rolling(there, tuple(Pose(R, C, v) for R, C, v in poses), state.parameters, state.tie_point)


def _adjust_oriented(
    block: Block,
    settings: AdjustmentSettings,
    progress: Progress,
    start: Sequence[FloatArray],
    sigmas: EstimatedSigmas | None,
) -> Adjustment:
    """Adjust a block whose photographs all have a pose to start from: read-out times that nobody states are held at
    zero until the photographs show one, and again where it comes out as none."""
    asked = requested(block.cameras)
    ended = _adjust_block(without_rolling(block, asked), settings, progress, start, sigmas, asked)
    while isinstance(ended, _Rolling):
        progress(0, 0, "rolling shutter: the read-out time is estimated")
        asked = asked & ~ended.there
        tie_points = replace(block.tie_points, position_world_m=ended.tie_point)
        rolling = replace(without_rolling(block, asked), poses=ended.poses, tie_points=tie_points)
        ended = _adjust_block(rolling, settings, progress, ended.parameters, sigmas, asked, again=True)
    shutters = ended.shutters
    if asked.any():
        _, one_step = _significant_readouts(ended.assessment, asked)
        shutters = replace(shutters, readouts=shutters.readouts.combined(one_step, asked))
    scatter_m_s = neighbours_scatter_m_s(ended.assessment.problem, ended.assessment.state)
    return with_readouts(_judged(ended, settings), shutters, scatter_m_s)


def _adjust_block(
    block: Block,
    settings: AdjustmentSettings,
    progress: Progress,
    start: Sequence[FloatArray] | FloatArray,
    sigmas: EstimatedSigmas | None,
    asked: BoolArray,
    *,
    again: bool = False,
) -> _Ended | _Rolling:
    """Adjust a block with the unknowns that it has, and find its common errors and sigmas; no longer than until one of
    the cameras ``asked`` (C,) turns out to have a rolling shutter, since all is done ``again`` with it."""
    estimating = settings.estimate_sigmas and sigmas is None
    used = None if estimating else sigmas or EstimatedSigmas.none()
    whole = make_problem(block if used is None else with_gnss_sigmas(block, used), settings)

    def stop(problem: Problem, state: State, number: int) -> bool:
        return bool(is_clear(problem, state, asked, number).any())

    try:
        first = start_state(whole)
        if len(start):
            free, moved = calibration_sigmas(block.cameras) > 0.0, first.parameters.copy()
            given = np.array(start)[:, : moved.shape[1]]
            moved[:, : given.shape[1]] = np.where(free[:, : given.shape[1]], given, moved[:, : given.shape[1]])
            first = replace(first, cameras=recalibrated(first.cameras, moved))
        solved = solve_rounds(whole, first, settings, progress, used, stop if asked.any() else None, 2 if again else 1)
        if solved.stopped:
            there = is_clear(solved.problem, solved.minimum.state, asked, solved.rounds)
            return _Rolling.at(solved.minimum.state, there)
        progress(0, 0, "covariances")
        assessment = assessed(solved, block, settings)
        there = _significant_readouts(assessment, asked)[0] if asked.any() else asked
        if there.any():
            return _Rolling.at(solved.minimum.state, there)
        ended = _settled(solved, assessment, whole, block, settings, progress, estimating=estimating)
        return _Ended(block, whole, *ended)
    except IndeterminateError as error:
        raise undetermined(whole, error) from error


def _significant_readouts(assessment: Assessed, asked: BoolArray) -> tuple[BoolArray, Readouts]:
    return is_significant(assessment.problem, assessment.state, assessment.fixed, asked)


def _settled(
    solved: Solved,
    assessment: Assessed,
    whole: Problem,
    block: Block,
    settings: AdjustmentSettings,
    progress: Progress,
    *,
    estimating: bool,
) -> tuple[Solved, Assessed, _Unknowns, Shutters]:
    """Adjust again until the common errors among the unknowns are right, read-out times that are none are held at zero
    and, where they are ``estimating``, the sigmas stay; ``whole`` is the problem as stated of the ``block``."""
    unknowns, shutters = _Unknowns(), Shutters.unknown(len(block.cameras))
    reweighted = 0 if estimating else MOST_REWEIGHTED
    while True:
        changed = _with_common_error(solved, assessment, settings, unknowns, progress)
        if changed is not None:
            solved, unknowns = changed
        else:
            shutters = readout_estimates(
                assessment.problem, assessment.state, assessment.fixed, assessment.covariances, shutters
            )
            again = _without_none(solved, shutters.readouts.none, settings, progress)
            if again is None and reweighted < MOST_REWEIGHTED:
                again, reweighted = _reweighted(solved, assessment, whole, settings), reweighted + 1
            if again is None:
                return solved, assessment, unknowns, shutters
            solved = again
        assessment = assessed(solved, block, settings)


def _judged(ended: _Ended, settings: AdjustmentSettings) -> Adjustment:
    try:
        return _result(ended, settings)
    except IndeterminateError as error:
        raise undetermined(ended.whole, error) from error


def _field_covariances(covariances: Covariances, cameras: int) -> FloatArray:
    """Return the covariances (cameras, K, K) of the coefficients of lens fields, (0, 0, 0) without any."""
    if covariances.layout.unit.shape[1] == PARAMETERS:
        return np.zeros((0, 0, 0))
    return np.array([covariances.lens(c)[PARAMETERS:, PARAMETERS:] for c in range(cameras)])


def _result(ended: _Ended, settings: AdjustmentSettings) -> Adjustment:
    """Return the result of an adjustment, with what it is worth."""
    block, solved, assessment = ended.block, ended.solved, ended.assessment
    final, final_state = assessment.problem, assessment.state
    state, tie = solved.minimum.state, assessment.block.tie_points
    fixed, covariances, counted = assessment.fixed, assessment.covariances, assessment.counted
    ground, ground_covariance = ground_points(final, final_state, covariances)
    estimated = EstimatedSigmas.none()
    if settings.estimate_sigmas:
        groups = solved.groups.select(assessment.kept[solved.whole.tie.point] & solved.used)
        ties = table(block, groups, solved.factors, assessment.ties)
        estimated = joined(ties, gnss_table(block, assessment.block, assessment.gnss))
    poses, tie_covariance = covariances.poses, covariances.tie_point
    joint = joint_ground_covariance(counted, final_state, covariances, ground)
    if block.is_free:
        relative = relative_covariances(counted, final_state, covariances, ground, joint)
        poses, tie_covariance = relative.poses, relative.tie_point
        joint = relative.ground
        own = np.arange(3 * len(ground)).reshape(-1, 3)
        ground_covariance = joint[own[:, :, None], own[:, None, :]]
    R = state.rotation
    flights_without_offset, implied, implied_covariance = implied_offsets(final, final_state, fixed)
    arm = residual_lever_arm(final, final_state, fixed)
    tie_residual = residuals(final.tie, state.cameras, tie.position_world_m)
    return Adjustment(
        block=assessment.block,
        sigma0=assessment.sigma0,
        redundancy=assessment.redundancy,
        iterations=solved.iterations,
        rounds=solved.rounds,
        converged=solved.minimum.converged,
        cost=solved.minimum.cost,
        estimates=Estimates(
            residual_px=tie_residual * tie.sigma_px[:, None],
            mark_residual_px=mark_residuals_px(block, ground, state),
            ground_world_m=ground,
            flights=final.flights,
            offset_world_m=state.offset,
        ),
        covariances=AdjustmentCovariances(
            position_m2=R @ poses[:, 3:, 3:] @ R.transpose(0, 2, 1),
            rotation_rad2=poses[:, :3, :3],
            calibration=np.array([covariances.calibration(c) for c in range(len(block.cameras))]),
            tie_point_m2=tie_covariance,
            tie_point_ray_m2=ray_covariances(final, final_state),
            ground_m2=ground_covariance,
            ground_joint_m2=joint,
            offset_m2=np.array([covariances.offset(f) for f in range(len(final.flights))]).reshape(-1, 3, 3),
            lens_field_px2=_field_covariances(covariances, len(block.cameras)),
        ),
        tests=StatisticalTests(
            reliability=assessment.tested,
            components=assessment.components,
            constraints=constraint_tests(final, final_state, fixed, counted, covariances, ground),
            exposures=exposure_tests(final, final_state, fixed, counted, covariances),
            implied_offset_world_m=implied,
            implied_offset_covariance_m2=implied_covariance,
            residual_lever_arm_m=arm.arm_camera_m,
            residual_lever_arm_sigma_m=arm.sigma_m,
            residual_lever_arm_p=arm.p,
        ),
        decisions=Decisions(
            flights_without_offset=flights_without_offset,
            common_errors=estimates(final, final_state, fixed, covariances, dict(ended.unknowns.as_well)),
            sigmas=estimated,
            rejected_observations=int(np.count_nonzero(~solved.used)),
            rejected_points=int(np.count_nonzero(~assessment.kept)),
        ),
        warnings=(*unmet(block, ground), *weak_parts(counted, final_state, covariances), *scattering(estimated)),
    )
