"""Sigmas that nobody has stated, at which what they belong to scatters as they say.

Each step of their estimation takes an adjustment and its redundancy numbers; the tie points are summarised meanwhile.
"""

from dataclasses import replace

import numpy as np

from photogram.adjustment.assessment import Assessed
from photogram.adjustment.effort import during
from photogram.adjustment.problem import AdjustmentSettings, minimise, with_sigmas_of
from photogram.adjustment.reliability import reliability
from photogram.adjustment.shutters.rolling_shutter import moving
from photogram.adjustment.stochastic_model.assumed_sigmas import (
    assumed_scatters,
    assumed_steady,
    with_assumed_factors,
)
from photogram.factors.covariance import covariances
from photogram.factors.elimination.loss import steering
from photogram.factors.elimination.summary import summarise
from photogram.survey import Block

MOST_STEPS = 30


@during("sigmas")
def steady_sigmas(assessment: Assessed, assumed: Block, settings: AdjustmentSettings) -> Block:
    """Return the block of a solution with those of its sigmas that nobody has stated as its observations scatter;
    ``assumed`` is the block with what was assumed.

    Raises IndeterminateError where it is not determined with them.
    """
    problem, state, scatters = assessment.problem, assessment.state, assessment.assumed
    block = with_assumed_factors(problem.block, scatters)
    if assumed_steady(problem.block, block):
        return problem.block
    loss = steering(problem.robust_loss, problem.robust_threshold)
    summary = summarise(problem.tie, moving(problem.block, state.cameras), state.tie_point, loss)
    none = problem.tie.select(np.zeros(len(problem.tie), dtype=bool))
    problem, state = replace(problem, tie=none, summary=summary), replace(state, tie_point=np.zeros((0, 3)))
    for _ in range(MOST_STEPS):
        problem = with_sigmas_of(problem, block)
        state = minimise(problem, state, settings, near=True).state
        tested = reliability(problem, state, covariances(problem, state))
        block = with_assumed_factors(block, assumed_scatters(problem, tested, assumed))
        if assumed_steady(problem.block, block):
            break
    return block
