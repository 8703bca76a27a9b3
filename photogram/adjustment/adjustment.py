"""The joint adjustment: Levenberg–Marquardt on the factor graph, outlier rounds, covariances.

Poses, calibration, tie points, control points, GNSS offsets and other common errors are estimated together. Tie points
carry a robust loss and are tested between rounds, with re-admission; control points, marks and GNSS positions are never
down-weighted.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.assessment import Assessed, assessed
from photogram.adjustment.effort import during
from photogram.adjustment.oriented_subset import registered_block, with_all_marks, with_all_photographs, without_marks
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state, with_sigmas_of
from photogram.adjustment.rounds import Solved, solve_rounds
from photogram.adjustment.shutters.rolling_shutter import (
    Readouts,
    Shutters,
    as_decided,
    free_readouts,
    is_clear,
    is_significant,
    neighbours_scatter_m_s,
    readout_estimates,
    requested,
    with_readouts,
    without_rolling,
)
from photogram.adjustment.solutions.ended import Ended, adjustment_of
from photogram.adjustment.solutions.steady_sigmas import steady_sigmas
from photogram.adjustment.solutions.unknowns import Unknowns, solved_again, with_common_error
from photogram.adjustment.solvability import UndeterminedPartError, undetermined
from photogram.adjustment.stochastic_model.assumed_sigmas import assumed_steady
from photogram.adjustment.stochastic_model.estimated_sigmas import (
    improved,
    weighted,
    with_assumed_sigmas,
)
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Pose, calibration_sigmas
from photogram.errors import AdjustmentError
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem
from photogram.projection import READOUT, recalibrated
from photogram.results import Adjustment, EstimatedSigmas
from photogram.survey import Block
from photogram.wording import Progress, silent

_LOG = logging.getLogger(__name__)

LEFT_OUT = 0.25  # of the oriented photographs, that may be left out for the rest to be adjusted
MOST_LOST_MARKS = 3
MOST_REWEIGHTED = 3  # adjustments with sigmas that the covariances of the one before ask for


@during("sigmas")
def _reweighted(
    solved: Solved, assessment: Assessed, block: Block, stated: Problem, settings: AdjustmentSettings
) -> Solved | None:
    """Return the ``block`` adjusted again with the sigmas that its covariances ask for, None where these stay.

    In the rounds the redundancy of tie points was that of many beside little else, here it is exact; sigmas that are
    only assumed need redundancy numbers.
    """
    factors = solved.factors if assessment.ties is None else improved(assessment.ties, solved.factors, solved.groups)
    steady = steady_sigmas(assessment, block, settings)
    if factors.are_near(solved.factors) and assumed_steady(solved.whole.block, steady):
        return None
    now = replace(
        solved.whole.block,
        photographs=steady.photographs,
        control_points=steady.control_points,
        tie_points=stated.block.tie_points,
    )
    whole = weighted(with_sigmas_of(stated, now), solved.groups, factors)
    return replace(solved_again(solved, whole, solved.minimum.state, settings), factors=factors)


@during("rolling shutter")
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
    return solved_again(solved, whole, start, settings, progress)


def adjust(
    block: Block,
    settings: AdjustmentSettings,
    progress: Progress = silent,
    *,
    start: Sequence[FloatArray] = (),
    sigmas: EstimatedSigmas | None = None,
    begun: EstimatedSigmas | None = None,
    near: Adjustment | None = None,
) -> Adjustment:
    """Adjust a block jointly, reject mismatched observations, and compute covariances, in the block's world frame, m.

    Photographs without a pose take no part; tie points need no position to start from. ``start`` holds the interior
    orientation (12,) of each camera to start from, with or without the coefficients of a lens field, where it is not
    the given one, which stays the mean of the priors; what is held stays as given. ``sigmas`` are those of another
    adjustment of these observations: they are used as they are, and none are estimated. ``near`` is another adjustment
    of the same tie points, to begin with: its orientations, sigmas and common errors; ``begun`` are sigmas alone. A
    single photograph or mark that keeps the rest from a solution is left out, with the reason in ``warnings``. Raises
    AdjustmentError naming the variable that is not determined, and what it lacks.
    """
    if near is not None:
        block, start = _begun(block, near), [camera.parameters for camera in near.block.cameras]
    first = _Sigmas(begun or EstimatedSigmas.none(), settings.estimate_sigmas)
    if near is not None:
        first = replace(first, begun=near.decisions.sigmas)
    if sigmas is not None:
        first = _Sigmas(sigmas, estimated=False)
    part, oriented = block, len(registered_block(block)[1])
    if not oriented:
        raise AdjustmentError("no photograph is oriented")
    left: dict[int, str] = {}
    marks = np.ones(len(block.control_points.mark_point), dtype=bool)
    lost_marks: list[str] = []
    while True:
        solvable, kept = registered_block(part)
        try:
            adjusted = _adjust_oriented(solvable, settings, progress, start, first, near)
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


def _begun(block: Block, near: Adjustment) -> Block:
    """Return a block that begins where another adjustment of its tie points ended."""
    poses = (begun or given for begun, given in zip(near.block.poses, block.poses, strict=True))
    return replace(block, poses=tuple(poses), common_errors=near.block.common_errors)


def _of_all(block: Block, marks: BoolArray, kept: IntArray) -> IntArray:
    """Return the numbers in ``block`` of the marks ``marks`` (M,) in the photographs ``kept`` (K,)."""
    return np.flatnonzero(marks & np.isin(block.control_points.mark_photograph, kept))


@dataclass(frozen=True, eq=False)
class _Sigmas:
    """The sigmas with which an adjustment has ``begun``, and whether they are to be ``estimated``."""

    begun: EstimatedSigmas
    estimated: bool


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
    sigmas: _Sigmas,
    near: Adjustment | None,
) -> Adjustment:
    """Adjust a block whose photographs all have a pose to start from: read-out times that nobody states are held at
    zero until the photographs show one, and again where it comes out as none."""
    asked, known = requested(block.cameras), Shutters.unknown(len(block.cameras))
    if near is not None:
        known = as_decided(near)
        asked &= ~free_readouts(near.block.cameras)
        block = without_rolling(block, known.readouts.none & ~asked)
    ended = _adjust_block(
        without_rolling(block, asked), settings, progress, start, sigmas, asked, near=near is not None
    )
    while isinstance(ended, _Rolling):
        progress(0, 0, "rolling shutter: the read-out time is estimated")
        asked = asked & ~ended.there
        tie_points = replace(block.tie_points, position_world_m=ended.tie_point)
        rolling = replace(without_rolling(block, asked), poses=ended.poses, tie_points=tie_points)
        ended = _adjust_block(rolling, settings, progress, ended.parameters, sigmas, asked, again=True)
    shutters = replace(
        ended.shutters, readouts=ended.shutters.readouts.combined(known.readouts, known.readouts.none & ~asked)
    )
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
    sigmas: _Sigmas,
    asked: BoolArray,
    *,
    again: bool = False,
    near: bool = False,
) -> Ended | _Rolling:
    """Adjust a block with the unknowns that it has, and find its common errors and sigmas; no longer than until one of
    the cameras ``asked`` (C,) turns out to have a rolling shutter, since all is done ``again`` with it."""
    whole = make_problem(with_assumed_sigmas(block, sigmas.begun), settings)

    def stop(problem: Problem, state: State, number: int) -> bool:
        return bool(is_clear(problem, state, asked, number).any())

    try:
        first = start_state(whole)
        if len(start):
            free, moved = calibration_sigmas(block.cameras) > 0.0, first.parameters.copy()
            given = np.array(start)[:, : moved.shape[1]]
            moved[:, : given.shape[1]] = np.where(free[:, : given.shape[1]], given, moved[:, : given.shape[1]])
            first = replace(first, cameras=recalibrated(first.cameras, moved))
        solved = solve_rounds(
            whole, first, settings, progress, sigmas.begun, stop if asked.any() else None,
            estimating=sigmas.estimated, first_round=2 if near or again else 1, near=near,
        )  # fmt: skip
        if solved.stopped:
            there = is_clear(solved.problem, solved.minimum.state, asked, solved.rounds)
            return _Rolling.at(solved.minimum.state, there)
        progress(0, 0, "covariances")
        assessment = assessed(solved, block, settings)
        there = _significant_readouts(assessment, asked)[0] if asked.any() else asked
        if there.any():
            return _Rolling.at(solved.minimum.state, there)
        ended = _settled(solved, assessment, whole, block, settings, progress, estimating=sigmas.estimated)
        return Ended(block, whole, *ended)
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
) -> tuple[Solved, Assessed, Unknowns, Shutters]:
    """Adjust again until the common errors among the unknowns are right, read-out times that are none are held at zero
    and, where they are ``estimating``, the sigmas stay; ``whole`` is the problem as stated of the ``block``."""
    unknowns, shutters = Unknowns(), Shutters.unknown(len(block.cameras))
    reweighted = 0 if estimating else MOST_REWEIGHTED
    while True:
        changed = with_common_error(solved, assessment, settings, unknowns, progress)
        if changed is not None:
            solved, unknowns = changed
        else:
            shutters = readout_estimates(
                assessment.problem, assessment.state, assessment.fixed, assessment.covariances, shutters
            )
            again = _without_none(solved, shutters.readouts.none, settings, progress)
            if again is None and reweighted < MOST_REWEIGHTED:
                again, reweighted = _reweighted(solved, assessment, block, whole, settings), reweighted + 1
            if again is None:
                return solved, assessment, unknowns, shutters
            solved = again
        assessment = assessed(solved, block, settings)


def _judged(ended: Ended, settings: AdjustmentSettings) -> Adjustment:
    try:
        return adjustment_of(ended, settings)
    except IndeterminateError as error:
        raise undetermined(ended.whole, error) from error
