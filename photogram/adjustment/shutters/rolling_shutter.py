"""Rolling shutters: how photographs moved while they were read, and whether a read-out time is there at all.

The velocity of a photograph stands in its tags, or follows from the adjusted positions of its neighbours in time, so
that neither the noise of GNSS nor its absence matters, and from the photograph itself (``own_velocities``). Tags come
first: many drones all but stop for an exposure. The read-out time of a camera is one more parameter of its interior
orientation. In photographs that look straight down along the flight it is an affinity to within relief and changes of
speed, so it is to be estimated in place of b1 and b2, not beside them.

A global shutter has none. Where no source states a read-out time it is held at zero until one step from there would
give it another value (photogram.factors.score_test); an estimate that is zero to within its standard deviation,
T² / σ² below the quantile of χ² with one degree of freedom (Förstner & Wrobel 2016, sec. 4.6.4), is held there, and a
source that claims otherwise is outvoted.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.shutters.own_velocities import Departures, departures
from photogram.adjustment.shutters.readout_correlations import Correlations, correlations
from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera
from photogram.factors.common_errors import velocities
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.reduced import SingularError
from photogram.factors.elimination.reprojection import linearise
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.joint_velocities import points_of, take_cameras, take_points
from photogram.factors.score_test import least_statistic, one_step
from photogram.projection import READOUT, OrientedCameras, recalibrated
from photogram.results import SIGNIFICANCE, Adjustment
from photogram.survey import Block

_LOG = logging.getLogger(__name__)

COARSE_VELOCITY = 0.03
"""Relative error of a velocity from times in whole seconds, beyond which it is not used: what each photograph's own is
off by would pass for a shorter read-out time (errors in variables attenuate)."""

ORDINARY_S = 0.03
"""Read-out time of an ordinary rolling shutter, from which own velocities are first looked for; those that drafts know
have 20 to 74 ms."""

MOVED = 0.03
"""Share of a read-out time by which it changes until velocities are estimated again."""

SURE = {1: 1e4, 2: 1e2}
"""Bound of Rao's statistic from which a read-out time is there, whatever is found meanwhile, after the first round and
after the second: a hundred standard errors while mismatches take part and poses settle, then ten."""


def rolling(cameras: Sequence[Camera]) -> BoolArray:
    """Return which cameras (C,) have a read-out time, known or to be estimated."""
    return np.array([c.readout_s != 0.0 or c.sigmas[READOUT] > 0.0 for c in cameras], dtype=bool)


def in_motion(block: Block, cameras: OrientedCameras) -> OrientedCameras:
    """Return the photographs of a block with their velocities: the measured ones, else those that positions and times
    give; where neither does they keep what they had. As they are where no shutter rolls."""
    return moving(block, cameras) if rolling(block.cameras).any() else cameras


def moving(block: Block, cameras: OrientedCameras) -> OrientedCameras:
    """Return the photographs of a block with their velocities, as ``in_motion``, whatever their shutters."""
    velocity, _ = _known_velocities(block, cameras)
    return cameras._replace(velocity=np.where(np.isfinite(velocity), velocity, cameras.velocity))


def renewed(problem: Problem, state: State, *, together: bool = False, least_s: float = 0.0) -> State:
    """Return the state at the end of a round with the velocities that follow from it: as ``in_motion``, and those that
    positions and times give as the photographs show them, each by itself or ``together`` with everything else, read-out
    times too, looked for from ``least_s`` on."""
    cameras = in_motion(problem.block, state.cameras)
    departing = _departures(problem, state, cameras)
    if departing is None:
        return replace(state, cameras=cameras)
    if together:
        try:
            velocity, readout_s = departing.together(problem, state, least_s)
            parameters = state.parameters.copy()
            parameters[:, READOUT] = readout_s
            return replace(state, cameras=recalibrated(cameras, parameters)._replace(velocity=velocity))
        except (IndeterminateError, SingularError):  # the covariances at the end say what nothing holds
            _LOG.debug("velocities: estimated one by one, since something else is not determined")
    return replace(state, cameras=cameras._replace(velocity=departing.one_by_one()))


def moved_on(before: State, after: State) -> bool:
    """Return whether a read-out time changes so much between two states that velocities are to be estimated again."""
    old, new = before.parameters[:, READOUT], after.parameters[:, READOUT]
    return bool(np.any(np.abs(new - old) > MOVED * np.abs(new)))


def neighbours_scatter_m_s(problem: Problem, state: State) -> float:
    """Return the standard deviation, m/s, by which photographs flew at other velocities than their neighbours tell, for
    each component; zero where none is significant, NaN where no shutter rolls or no velocity comes from neighbours."""
    departing = _departures(problem, state, in_motion(problem.block, state.cameras))
    return float("nan") if departing is None else departing.scatter_m_s


def _departures(problem: Problem, state: State, cameras: OrientedCameras) -> Departures | None:
    """Return how photographs depart from the velocities of their neighbours, None where no shutter rolls or no velocity
    comes from neighbours."""
    if not np.any(cameras.parameters[:, READOUT] != 0.0):
        return None
    velocity, from_positions = _known_velocities(problem.block, cameras)
    free = from_positions & np.isfinite(velocity).all(axis=1)
    if not free.any():
        return None
    departing = departures(problem, state, cameras.velocity, free)
    _LOG.debug("velocities: the neighbours' scatter by %.3g m/s", departing.scatter_m_s)
    return departing


def _known_velocities(block: Block, cameras: OrientedCameras) -> tuple[FloatArray, BoolArray]:
    """Return the velocities (N, 3) that tags, else positions and times, tell, NaN where neither does, and which (N,)
    come from positions. Tags that are zero throughout were never filled in."""
    followed = velocities(block.photographs, cameras.position, COARSE_VELOCITY)
    nothing = np.full(3, np.nan)
    tags = [nothing if p.velocity_world_m_s is None else p.velocity_world_m_s for p in block.photographs]
    tagged = np.array(tags).reshape(-1, 3)
    # the lengths of a free network may have a unit of their own, and its axes any direction
    believed = not block.is_free and bool(np.any(np.nan_to_num(tagged) != 0.0))
    tells = np.isfinite(tagged) & believed
    return np.where(tells, tagged, followed), ~tells.all(axis=1)


def unmoved(block: Block) -> tuple[str, ...]:
    """Return sentences on photographs of an adjusted block whose shutter rolls, but of which nothing tells how they
    moved."""
    sentences = list[str]()
    if not rolling(block.cameras).any():
        return ()
    known = np.isfinite(_known_velocities(block, block.oriented_cameras())[0]).all(axis=1)
    for c in np.flatnonzero(rolling(block.cameras)).tolist():
        camera, own = block.cameras[c], block.camera_of == c
        without = int(np.count_nonzero(own & ~known))
        if camera.readout_s == 0.0 or not without:
            continue
        who = f"{without} of its photographs do not tell how they moved"
        if without == np.count_nonzero(own):
            who = "none of its photographs tells how it moved"
        sentences.append(
            f"Camera {camera.name}: a rolling shutter of {1000.0 * camera.readout_s:.1f} ms cannot be counted, because "
            f"{who}: give speeds in the tags, or positions and times to fractions of a second"
        )
    return tuple(sentences)


def free_readouts(cameras: Sequence[Camera]) -> BoolArray:
    """Return the cameras (C,) whose read-out times are among the unknowns."""
    return np.array([c.sigmas[READOUT] > 0.0 for c in cameras], dtype=bool)


def requested(cameras: Sequence[Camera]) -> BoolArray:
    """Return the cameras (C,) of which no source says that their shutter rolls, and none that it does not: read-out
    times that begin at zero. They are held there until the photographs show one."""
    return np.array([c.readout_s == 0.0 and c.sigmas[READOUT] > 0.0 for c in cameras], dtype=bool)


def is_significant(
    problem: Problem, state: State, covariances: Covariances, asked: BoolArray
) -> tuple[BoolArray, Readouts]:
    """Return for which of the cameras ``asked`` (C,), whose read-out times are held at zero, the photographs show one,
    and what one step would make of them."""
    moved = replace(state, cameras=moving(problem.block, state.cameras))
    estimate, sigma = np.full(len(asked), np.nan), np.full(len(asked), np.nan)
    for c in np.flatnonzero(asked).tolist():
        estimate[c], sigma[c] = one_step(problem, moved, covariances, c, READOUT)
    significant = _significant(estimate, sigma)
    return significant, Readouts(estimate, sigma, significant, np.ones(len(asked)))


def is_clear(problem: Problem, state: State, asked: BoolArray, number: int) -> BoolArray:
    """Return for which of the cameras ``asked`` (C,) the photographs show a read-out time after the first or second
    round of an adjustment, of this ``number``, as ``is_significant`` would say at its end. Of the others one may still
    come out then."""
    moved = replace(state, cameras=moving(problem.block, state.cameras))
    there = [bool(asked[c]) and least_statistic(problem, moved, c, READOUT) > SURE[number] for c in range(len(asked))]
    return np.array(there, dtype=bool)


def _significant(estimate: FloatArray, sigma: FloatArray) -> BoolArray:
    with np.errstate(invalid="ignore"):
        return np.asarray(estimate**2 > float(chi2.isf(SIGNIFICANCE, 1)) * sigma**2)


@dataclass(frozen=True, eq=False)
class Readouts:
    """Read-out times as they were estimated, before those that are zero to within their noise were held there:
    ``estimate_s`` and ``sigma_s`` (cameras,), NaN where none was looked for, ``significant`` (cameras,);
    ``inflation`` (cameras,) of their standard deviations, by what the velocities are off by."""

    estimate_s: FloatArray
    sigma_s: FloatArray
    significant: BoolArray
    inflation: FloatArray

    @staticmethod
    def unknown(cameras: int) -> Readouts:
        """Return those of ``cameras`` of which none was looked for."""
        nothing = np.full(cameras, np.nan)
        return Readouts(nothing, nothing, np.zeros(cameras, dtype=bool), np.ones(cameras))

    @property
    def none(self) -> BoolArray:
        """Return which of them (cameras,) are zero to within their noise."""
        return np.isfinite(self.estimate_s) & ~self.significant

    def combined(self, others: Readouts, theirs: BoolArray) -> Readouts:
        """Return those of cameras of which some, ``theirs`` (cameras,), were held and are in ``others``."""
        return Readouts(
            np.where(theirs, others.estimate_s, self.estimate_s),
            np.where(theirs, others.sigma_s, self.sigma_s),
            np.where(theirs, others.significant, self.significant),
            np.where(theirs, others.inflation, self.inflation),
        )


@dataclass(frozen=True, eq=False)
class Shutters:
    """Read-out times as they were estimated while they were among the unknowns, and their ``correlations`` then."""

    readouts: Readouts
    correlations: Correlations

    @staticmethod
    def unknown(cameras: int) -> Shutters:
        """Return what is known of ``cameras`` of which nothing was looked for."""
        return Shutters(Readouts.unknown(cameras), Correlations.unknown(cameras))


def as_decided(result: Adjustment) -> Shutters:
    """Return the read-out times that an adjustment has looked for; those that it holds at zero as ``none``."""
    held, unknown = ~free_readouts(result.block.cameras), Shutters.unknown(len(result.block.cameras))
    decisions = result.decisions
    if not len(decisions.readout_s):
        return unknown
    inflation = np.ones(len(held))
    return replace(unknown, readouts=Readouts(decisions.readout_s, decisions.readout_sigma_s, ~held, inflation))


def readout_estimates(
    problem: Problem, state: State, covariances: Covariances, counted: Covariances, before: Shutters
) -> Shutters:
    """Return the read-out times that are free, and those that were ``before`` and are held at zero since; at a solution
    with its ``covariances``, and those ``counted`` with what is considered."""
    free = free_readouts(problem.block.cameras)
    if not free.any():
        return before
    now = readouts(problem, state, covariances)
    return Shutters(
        now.combined(before.readouts, ~free), correlations(problem, state, counted).combined(before.correlations, ~free)
    )


def inflation(problem: Problem, state: State, covariances: Covariances, camera: int) -> float:
    """Return by how much the standard deviation of a camera's read-out time is larger than its covariance says, 1 at
    least, because photographs flew at another velocity than their neighbours tell.

    Such an error is common to all points of a photograph. A change of the read-out time by its unit changes residuals
    by J, everything else following; the covariance takes the sum of Jᵀ r over a photograph for one of independent r,
    of the variance Σ JᵀJ. What the sums of all photographs scatter by takes its place (the sandwich estimator with
    clusters: Cameron & Miller 2015, eq. 11). Residuals are those by the neighbours' velocities: what photographs were
    given of their own takes the scatter out of the residuals, and leaves what it does to the read-out time.
    """
    layout, tie = covariances.layout, problem.tie
    owner, parameter = layout.free_parameters
    column = layout.columns + int(np.flatnonzero((owner == camera) & (parameter == READOUT))[0])
    unit = np.zeros((layout.columns + layout.border, 1))
    unit[column] = 1.0
    change = covariances.solve(unit)[:, 0]
    change /= change[column]
    linear = linearise(tie, moving(problem.block, state.cameras), state.tie_point)
    pose, lens = np.zeros((len(layout.place), 6)), np.zeros_like(layout.unit)
    pose[layout.photograph_at] = change[: layout.columns].reshape(-1, 6)
    lens[owner, parameter] = change[layout.columns : layout.columns + len(owner)] * layout.border_unit[: len(owner)]
    J, (first, inverse) = np.zeros_like(linear.residual), points_of(tie, linear.point, len(state.tie_point))
    take_cameras(linear.pose, linear.calibration, pose, lens, tie.photograph, linear.camera, J)
    take_points(first, linear.point, inverse, J)
    sums = np.bincount(tie.photograph, np.einsum("ni,ni->n", J, linear.residual))
    sums = sums[np.bincount(tie.photograph) > 0]
    expected = float(np.sum(J**2))
    if expected == 0.0:  # nothing moved
        return 1.0
    return max(1.0, float(np.sqrt(np.sum(sums**2) * len(sums) / (max(len(sums) - 1, 1) * expected))))


def readouts(problem: Problem, state: State, covariances: Covariances) -> Readouts:
    """Return the read-out times of the cameras that are free, at a solution with its covariances.

    One counts where it is significant, and still is once its prior has the weight that it deserves beside photographs
    of that scatter; one that does not is what both together say. Where the velocities are estimated too its standard
    deviation is that with them as unknowns.
    """
    cameras = problem.block.cameras
    own = _departures(problem, state, in_motion(problem.block, state.cameras))
    joint = None if own is None else own.readout_sigmas(problem, state)
    prior = np.array([(camera.readout_s, camera.sigmas[READOUT]) for camera in cameras]).reshape(-1, 2)
    free = prior[:, 1] > 0.0
    formal = np.array([np.sqrt(covariances.calibration(c)[READOUT, READOUT]) for c in range(len(cameras))])
    estimate = np.where(free, state.parameters[:, READOUT], np.nan)
    if joint is not None:
        sigma = np.where(free, joint, np.nan)
        inflated = np.where(free, sigma / np.where(free, formal, 1.0), 1.0)
        return Readouts(estimate, sigma, free & _significant(estimate, sigma), inflated)
    larger = np.array([inflation(problem, state, covariances, c) if free[c] else 1.0 for c in range(len(cameras))])
    weighed, weighed_sigma = weighed_anew(estimate, np.where(free, formal, np.nan), larger, prior)
    sigma = np.where(free, larger * formal, np.nan)
    counts = free & _significant(estimate, sigma) & _significant(weighed, weighed_sigma)
    return Readouts(np.where(counts, estimate, weighed), np.where(counts, sigma, weighed_sigma), counts, larger)


def weighed_anew(
    estimate_s: FloatArray, sigma_s: FloatArray, inflation: FloatArray, prior_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return estimates (C,) and their standard deviations, s, with the part of the photographs down-weighted by the
    ``inflation`` of its standard deviation.

    ``sigma_s`` are the standard deviations of the adjustment, which took the photographs for better than they are, so
    that a prior (C, 2), value and sigma, counted for too little. The weights of both add up to the adjustment's.
    """
    value = prior_s[:, 0]
    weight = np.divide(1.0, prior_s[:, 1] ** 2, out=np.zeros(len(prior_s)), where=prior_s[:, 1] > 0)
    observed = np.maximum(sigma_s**-2.0 - weight, 0.0)
    moment = (estimate_s * sigma_s**-2.0 - value * weight) / inflation**2
    total = observed / inflation**2 + weight
    return np.asarray((moment + value * weight) / total), np.asarray(total**-0.5)


def without_rolling(block: Block, none: BoolArray) -> Block:
    """Return the block with the read-out times of the cameras ``none`` (C,) held at zero."""
    cameras = list(block.cameras)
    for c in np.flatnonzero(none).tolist():
        sigmas = cameras[c].sigmas.copy()
        sigmas[READOUT] = 0.0
        cameras[c] = replace(cameras[c], readout_s=0.0, sigmas=sigmas)
    return replace(block, cameras=tuple(cameras))


def with_readouts(result: Adjustment, shutters: Shutters, scatter_m_s: float) -> Adjustment:
    """Return an adjustment with what was found of the read-out times, their standard deviations in its calibration
    covariances, and what is to be warned of; with what the neighbours' velocities scatter by."""
    readouts, correlations = shutters.readouts, shutters.correlations
    covariance = result.covariances.calibration.copy()
    covariance[:, READOUT, :] *= readouts.inflation[:, None]
    covariance[:, :, READOUT] *= readouts.inflation[:, None]
    return replace(
        result,
        covariances=replace(result.covariances, calibration=covariance),
        decisions=replace(
            result.decisions,
            readout_s=readouts.estimate_s,
            readout_sigma_s=readouts.sigma_s,
            readout_focal_correlation=correlations.focal_length,
            readout_time_offset_correlation=correlations.time_offset,
            neighbours_scatter_m_s=scatter_m_s,
        ),
        warnings=(
            *result.warnings,
            *unmoved(result.block),
            *correlations.warnings([camera.name for camera in result.block.cameras]),
        ),
    )
