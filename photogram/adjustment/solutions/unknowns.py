"""Unknowns that come and go once a block is solved: common errors of its positions."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from photogram.adjustment.assessment import Assessed
from photogram.adjustment.common_errors import MOST_CHANGES, What, next_change, values_after
from photogram.adjustment.effort import during
from photogram.adjustment.problem import AdjustmentSettings, minimise
from photogram.adjustment.rounds import Solved
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.wording import Progress, silent

_LOG = logging.getLogger(__name__)


def solved_again(
    solved: Solved, whole: Problem, start: State, settings: AdjustmentSettings, progress: Progress = silent
) -> Solved:
    """Return ``whole``, with the observations that took part, adjusted again from ``start``."""
    problem = whole.with_tie_observations(whole.tie.select(solved.used))
    minimum = minimise(problem, start, settings, progress, near=True)
    iterations = solved.iterations + minimum.iterations
    return replace(solved, whole=whole, problem=problem, minimum=minimum, iterations=iterations)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The common errors of positions on their way among the unknowns: those ``barred`` since they were dropped, what
    explains the measurements ``as_well`` as one of them, and how many changes there were."""

    barred: tuple[What, ...] = ()
    as_well: Mapping[tuple[str, int | None], str] = field(default_factory=dict)
    changes: int = 0


@during("common errors")
def with_common_error(
    solved: Solved, assessment: Assessed, settings: AdjustmentSettings, so_far: Unknowns, progress: Progress
) -> tuple[Solved, Unknowns] | None:
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
    known = Unknowns((*so_far.barred, *dropped), {**so_far.as_well, **change.as_well}, so_far.changes + 1)
    return solved_again(solved, whole, start, settings, progress), known
