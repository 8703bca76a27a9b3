"""Alternatives to a solved block: other measurements beside the same tie points, which one quadratic form stands for.

Whether a control point is wrong, a receiver lags or a prior is too tight is decided between solutions that differ in a
few measurements. Near the block that has been solved they need no ray: its tie points, their sigmas and the choice of
those that agree are the same (photogram.factors.elimination.summary). What is decided so is adjusted with all rays
afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.assessment import assessed
from photogram.adjustment.effort import during
from photogram.adjustment.oriented_subset import registered_block, with_all_photographs
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.rounds import Solved
from photogram.adjustment.shutters.rolling_shutter import Shutters, free_readouts, moving, without_rolling
from photogram.adjustment.solutions.ended import Ended, adjustment_of
from photogram.adjustment.solutions.unknowns import Unknowns, with_common_error
from photogram.adjustment.solvability import undetermined
from photogram.adjustment.stochastic_model.estimated_sigmas import as_stated, tie_groups, with_assumed_sigmas
from photogram.camera import calibration_sigmas, calibrations
from photogram.factors.elimination.loss import steering
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.elimination.summary import TiePointSummary, followed, summarise
from photogram.factors.graph import IndeterminateError
from photogram.projection import recalibrated
from photogram.results import Adjustment
from photogram.survey import Block
from photogram.wording import Progress, silent


@dataclass(frozen=True, eq=False)
class Summarised:
    """A solved block and the summary of its tie points."""

    result: Adjustment
    summary: TiePointSummary


def _observations(block: Block) -> Observations:
    tie = block.tie_points
    return Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px)


@during("alternatives")
def summarised(result: Adjustment, settings: AdjustmentSettings) -> Summarised:
    """Return a solved block with the summary of the tie points that took part, at its solution."""
    block, _ = registered_block(result.block)
    loss = steering(settings.robust_loss, settings.robust_threshold)
    cameras = moving(block, block.oriented_cameras())
    return Summarised(result, summarise(_observations(block), cameras, block.tie_points.position_world_m, loss))


@during("alternatives")
def summarised_at(base: Summarised, other: Adjustment, settings: AdjustmentSettings) -> Summarised:
    """Return the tie points of a solved block, with the same observations, summarised where an alternative to it is."""
    block, _ = registered_block(other.block)
    tie = registered_block(base.result.block)[0].tie_points
    loss = steering(settings.robust_loss, settings.robust_threshold)
    observations = _observations(replace(block, tie_points=tie))
    points = followed(base.summary, observations, tie.position_world_m, block.oriented_cameras(), loss)
    moved = replace(base.result.block.tie_points, position_world_m=points)
    return summarised(replace(other, block=replace(other.block, tie_points=moved)), settings)


def _as_solved(block: Block, solved: Adjustment) -> Block:
    """Return ``block`` where it was ``solved``: with its poses, its common errors and the sigmas of its positions, with
    read-out times held where they were, and without tie points."""
    held = ~free_readouts(solved.block.cameras) & free_readouts(block.cameras)
    tie = block.tie_points
    none = np.zeros(len(tie), dtype=bool)
    return replace(
        without_rolling(with_assumed_sigmas(block, solved.decisions.sigmas), held),
        poses=solved.block.poses,
        common_errors=solved.block.common_errors,
        tie_points=tie.select(none),
    )


@during("alternatives")
def alternative(
    base: Summarised, block: Block, settings: AdjustmentSettings, progress: Progress = silent
) -> Adjustment:
    """Return the adjustment of ``block``, which differs from the solved one in what is measured beside the tie points,
    from the summary of these. It has no tie points.

    Raises AdjustmentError naming the variable that is not determined.
    """
    solved, whole = base.result, _as_solved(block, base.result)
    part, kept = registered_block(whole)
    problem = replace(make_problem(part, settings), summary=base.summary)
    first = start_state(problem)
    free, given = calibration_sigmas(part.cameras) > 0.0, calibrations(part.cameras)
    parameters = np.where(free, calibrations(solved.block.cameras)[:, : given.shape[1]], given)
    first = replace(first, cameras=recalibrated(first.cameras, parameters))
    try:
        minimum = minimise(problem, first, settings, progress, near=True)
        groups, none = tie_groups(part), np.zeros(0, dtype=bool)
        now = Solved(problem, problem, minimum, none, np.zeros(0), groups, as_stated(groups), 0, minimum.iterations)
        quick = replace(settings, estimate_sigmas=False)
        assessment, unknowns = assessed(now, part, quick), Unknowns()
        while (changed := with_common_error(now, assessment, settings, unknowns, progress)) is not None:
            now, unknowns = changed
            assessment = assessed(now, part, quick)
        shutters = Shutters.unknown(len(part.cameras))
        result = adjustment_of(Ended(part, problem, now, assessment, unknowns, shutters), quick)
    except IndeterminateError as error:
        raise undetermined(problem, error) from error
    decisions = replace(
        result.decisions,
        sigmas=solved.decisions.sigmas,
        reason=solved.decisions.reason,
        rejected_observations=solved.decisions.rejected_observations,
        rejected_points=solved.decisions.rejected_points,
        readout_s=solved.decisions.readout_s,
        readout_sigma_s=solved.decisions.readout_sigma_s,
    )
    result = replace(result, decisions=decisions)
    return with_all_photographs(result, whole, kept) if len(kept) < len(whole.poses) else result
