"""Outlier rounds: choose the observations that agree, adjust with them, estimate their sigmas, until both settle."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.effort import during
from photogram.adjustment.outliers import (
    agreeing_observations,
    first_agreement,
    noise_scale,
    outlier_limit_px,
    settled,
    within_depths,
    without_narrow,
)
from photogram.adjustment.problem import AdjustmentSettings, minimise
from photogram.adjustment.shutters.rolling_shutter import ORDINARY_S, moved_on, renewed
from photogram.adjustment.solvability import check_determined, check_in_front
from photogram.adjustment.stochastic_model.estimated_sigmas import (
    Factors,
    TieGroups,
    factors_of,
    improved,
    taken_by_cameras,
    tie_groups,
    tie_scatter,
    weighted,
)
from photogram.arrays import BoolArray, FloatArray
from photogram.factors.elimination.levenberg_marquardt import Minimum
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.results import EstimatedSigmas
from photogram.survey import Block
from photogram.wording import Progress

_LOG = logging.getLogger(__name__)

MOST_RENEWED = 4  # estimates of velocities with everything else, before read-out times that go on moving stay


@dataclass(frozen=True, eq=False)
class Solved:
    """The end of the outlier rounds: the ``whole`` problem with the sigmas that were used, the ``problem`` of the
    observations that took part, and its minimum. ``limit_px`` (N,) bounded the residuals, ``factors`` multiply stated
    sigmas by ``groups``; ``stopped`` before they had settled."""

    whole: Problem
    problem: Problem
    minimum: Minimum
    used: BoolArray
    limit_px: FloatArray
    groups: TieGroups
    factors: Factors
    rounds: int
    iterations: int
    stopped: bool = False


def _with_cameras_fixed(block: Block) -> Block:
    return replace(
        block,
        cameras=tuple(
            replace(c, sigmas=np.zeros_like(c.sigmas), field=None if c.field is None else c.field.fixed)
            for c in block.cameras
        ),
    )


@during("outlier rounds")
def solve_rounds(
    stated: Problem,
    state: State,
    settings: AdjustmentSettings,
    progress: Progress,
    sigmas: EstimatedSigmas,
    stop: Callable[[Problem, State, int], bool] | None,
    *,
    estimating: bool,
    first_round: int = 1,
    near: bool = False,
) -> Solved:
    """Alternate between choosing the observations that agree, adjusting with them and estimating their sigmas, until
    choice and sigmas settle. ``sigmas`` are those to begin with, which stay where none are ``estimating``. After the
    first round, and the second, when mismatches are out, ``stop`` may end them; ``first_round`` is 2 where others have
    been before, and ``near`` says that ``state`` is one at which mismatches can be told."""
    groups = tie_groups(stated.block)
    factors = factors_of(stated.block, groups, sigmas)
    whole, steady = weighted(stated, groups, factors), not estimating
    angle, iterations = float(np.deg2rad(settings.minimum_ray_angle_deg)), 0
    first, chosen, points = first_agreement(whole, state, settings.first_outlier_threshold_px, angle)
    used: BoolArray = np.zeros(len(whole.tie), dtype=bool)
    limit_px = np.full(len(whole.tie), first)
    if near and first == settings.first_outlier_threshold_px:
        limit_px = outlier_limit_px(whole.block.tie_points, 1.0, settings.outlier_threshold)
        chosen, points = agreeing_observations(whole, replace(state, tie_point=points), limit_px, angle)
    draft, reached = replace(settings, relative_tolerance=max(1e-3, settings.relative_tolerance)), None
    for number in range(min(first_round, settings.maximum_rounds), settings.maximum_rounds + 1):
        last = number == settings.maximum_rounds or (number > 2 and steady and settled(used, chosen))
        used = chosen
        problem = whole.with_tie_observations(whole.tie.select(used))
        check_determined(problem)
        if number == 1 and not last and first > settings.first_outlier_threshold_px:
            # Poses so far off would bend the calibration to fit them.
            problem = replace(problem, block=_with_cameras_fixed(whole.block))
        seen = np.count_nonzero(np.bincount(problem.tie.point))
        progress(0, 0, f"round {number}: {len(problem.tie)} observations of {seen} tie points")
        moving = False
        if last and reached is not None:
            state = renewed(problem, reached, together=True, least_s=ORDINARY_S)
            moving = moved_on(reached, state)
        minimum = minimise(
            problem, replace(state, tie_point=points), settings if last else draft, progress, near=near or number > 1
        )
        iterations += minimum.iterations
        if last:
            for _ in range(MOST_RENEWED if moving else 0):
                again = renewed(problem, minimum.state, together=True)
                if not moved_on(minimum.state, again):
                    break
                minimum = minimise(problem, again, settings, progress, near=True)
                iterations += minimum.iterations
            break
        if stop is not None and number <= 2 and stop(problem, minimum.state, number):
            return Solved(whole, problem, minimum, used, limit_px, groups, factors, number, iterations, stopped=True)
        reached = minimum.state
        state = renewed(problem, reached)
        if estimating and number > 1:  # what the first round keeps says nothing of the noise yet
            scatter = tie_scatter(problem, state, groups.select(used), limit_px[used], taken_by_cameras(problem))
            better = factors if scatter is None else improved(scatter, factors, groups)
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
        chosen = within_depths(whole.block, state, chosen, points)
    check_in_front(problem, minimum.state)
    used = without_narrow(whole.block.tie_points, minimum.state, used, angle)
    return Solved(whole, problem, minimum, used, limit_px, groups, factors, number, iterations)
