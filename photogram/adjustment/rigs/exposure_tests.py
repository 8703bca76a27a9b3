"""Reliability of the exposures of cameras on one body: were both cameras triggered together, is the body stiff?

The misfits of an exposure, three turns and three shifts in their standard deviations, with the Jacobian A on the two
poses and the relative pose, have the covariance Q = I − A Σ Aᵀ; see photogram.adjustment.reliability.
"""

from dataclasses import dataclass

import numpy as np

from photogram.adjustment.reliability import left_out, minimal_detectable_blunder, w_tests
from photogram.arrays import FloatArray
from photogram.constraints.rigs import exposure_sigmas
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.rigs.exposures import estimated, linearised, misfits, taking_part, values_by_rig
from photogram.results import Adjustment, ExposureTests


def _adjusted(problem: Problem, state: State, covariances: Covariances) -> FloatArray:
    """Return the covariances (E, 6, 6) of the adjusted exposures that take part, in units of their stated sigmas."""
    every, layout = taking_part(problem.block), covariances.layout
    linear = linearised(every, state.rotation, state.position, values_by_rig(problem.block, state.common))
    covariance = np.empty((len(every), 6, 6))
    for n, (pair, rig) in enumerate(zip(every.pairs, every.rig.tolist(), strict=True)):
        joint = covariances.joint(pair)
        at = np.concatenate([np.arange(12), 12 + layout.columns_of_rig(rig)])
        A = linear.jacobian[n]
        covariance[n] = A @ joint[np.ix_(at, at)] @ A.T
    return covariance


def exposure_tests(
    problem: Problem, state: State, fixed: Covariances, counted_problem: Problem, counted: Covariances
) -> ExposureTests:
    """Return what is to say of the exposures of a solved problem, and the covariances of its relative poses;
    covariances as of reliability."""
    rigs, every = problem.block.rigs, taking_part(problem.block)
    tests = ExposureTests.unknown(len(rigs), len(exposure_sigmas(rigs)))
    if not len(every):
        return tests
    for k in estimated(problem.block).tolist():
        tests.relative_covariance[k] = counted.rig(k)
    adjusted = _adjusted(problem, state, fixed)
    if counted is not fixed:
        # what is considered stays in the residuals: see photogram.adjustment.reliability
        adjusted = 2.0 * adjusted - _adjusted(counted_problem, state, counted)
    misfit = misfits(every, state.rotation, state.position, values_by_rig(problem.block, state.common))
    whitened = misfit / every.sigma
    at = every.number
    sigma = every.sigma
    tests.misfit[at] = misfit
    tests.redundancy[at], tests.w[at] = w_tests(whitened, adjusted)
    residual, spread = left_out(whitened, adjusted)
    tests.left_out[at] = residual * sigma
    tests.left_out_covariance[at] = spread * sigma[:, :, None] * sigma[:, None, :]
    return tests


@dataclass(frozen=True, eq=False)
class RigReliability:
    """How well the exposures of a rig are tested: ``exposures`` that took part and ``rejected`` ones, their
    ``redundancy`` numbers on the average (6,), the largest |w| (6,) and the medians of what is detected at least (6,),
    rad and m."""

    exposures: int
    rejected: int
    redundancy: FloatArray
    largest_w: FloatArray
    detectable: FloatArray


def rig_reliabilities(result: Adjustment) -> list[RigReliability]:
    """Return how well the exposures of every rig of an adjustment are tested."""
    reliabilities, start = [], 0
    for rig in result.block.rigs:
        part = slice(start, start + len(rig.exposures))
        start = part.stop
        r, w = result.tests.exposures.redundancy[part], result.tests.exposures.w[part]
        own = np.isfinite(r).all(axis=1)
        rejected = int(np.isinf(rig.exposure_sigma).any(axis=1).sum())
        if not own.any():
            none = np.full(6, np.nan)
            reliabilities.append(RigReliability(0, rejected, none, none, none))
            continue
        least = np.median(minimal_detectable_blunder(rig.exposure_sigma[own], r[own]), axis=0)
        largest = np.abs(np.where(np.isfinite(w[own]), w[own], 0.0)).max(axis=0)
        reliabilities.append(RigReliability(int(own.sum()), rejected, r[own].mean(axis=0), largest, least))
    return reliabilities
