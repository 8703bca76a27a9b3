"""Gross contradictions found by a robust adjustment of everything that was measured beside the tie points.

The block is adjusted with control points, marks, GNSS positions, attitudes, constraints, exposures of cameras on one
body and given focal lengths under the loss of Geman and McClure, which takes all weight from what lies far off; its
scale falls from one at which most agree to that of the stated standard deviations (graduated non-convexity: Black &
Rangarajan 1996; Yang et al. 2020). So blunders of any size cannot bend the block to which they are compared, and which
of them hide each other does not matter. Tie points hold the shape; those that disagree from the start are left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from photogram.adjustment.constraint_tests import whitened_misfits
from photogram.adjustment.effort import during
from photogram.adjustment.oriented_subset import registered_block
from photogram.adjustment.outliers import first_agreement
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.stochastic_model.assumed_sigmas import CONTROL, CONTROL_PARTS
from photogram.adjustment.stochastic_model.estimated_sigmas import sigmas_of
from photogram.amendments.gross_errors.data_snooping import PRICE
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.arrays import BoolArray, FloatArray
from photogram.constraints.between_points import observations, with_sigmas
from photogram.constraints.rigs import Companion, exposure_names
from photogram.errors import AdjustmentError
from photogram.factors.common_errors import attitude_groups, common_shifts
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.rigs.exposures import whitened_exposures
from photogram.gnss import UNKNOWN_M
from photogram.measures.mark_covariances import scaled
from photogram.projection import recalibrated
from photogram.results import EstimatedSigmas
from photogram.sfm.marked_points import intersected_marks
from photogram.survey import Block, ControlPoints

LIMIT = 4.0
"""Sigmas within which the loss is nearly square."""

OFF = 0.2
"""Weight below which a measurement counts as grossly off in the end."""

STEP, ROUNDS_AT_END, ROUNDS_SCATTERING = 3.0, 3, 8
"""By which the scale falls from round to round, and rounds at its end; more where it is itself looked for."""

FEWEST_SCATTERING = 4
"""Control points of assumed sigmas, from which they may scatter more instead of being wrong."""

MOSTLY = 0.5
"""Share of the control points that contradict the rest, beyond which their stated sigmas may be wrong instead."""

MOST_WRONG, NEARLY_ALL = 0.3, 0.85
"""Share of the control points that may be wrong beside what the others scatter by, and of their coordinates from which
that is taken where more would be."""

AT_ANOTHER = 0.02
"""Of the extent of the control points, within which one lies where another was surveyed."""

DATUM = 7
"""Unknowns of a similarity, which control points determine before they contradict each other: their scale is that of
(n + 8) / 2 of n coordinates (least quantile of squares: Rousseeuw & Leroy 1987, sec. 3.4), or of half of them."""

_FAR = LIMIT * float(np.sqrt(OFF**-0.5 - 1.0))
_ITERATIONS, _TOLERANCE, _MOST_ROUNDS, _MOST_RAYS = 12, 1e-3, 14, 30_000


@dataclass(frozen=True, eq=False)
class _Misfits:
    """Residuals in standard deviations, per coordinate, of control points in plan and in height (G, 2), of marks (M,),
    GNSS positions (N,), attitudes (N,), observations of constraints (K,), exposures (E,) and focal lengths (cameras,);
    NaN for what is not there."""

    control: FloatArray
    mark: FloatArray
    gnss: FloatArray
    attitude: FloatArray
    constraint: FloatArray
    exposure: FloatArray
    focal: FloatArray

    def kinds(self) -> Iterator[FloatArray]:
        """Yield the residuals of each kind that are there."""
        for values in (self.control[:, 0], self.control[:, 1], self.mark, self.gnss, self.attitude,
                       self.constraint, self.exposure):  # fmt: skip
            if np.isfinite(values).any():
                yield values[np.isfinite(values)]

    def scale(self) -> float:
        """Return the scale of the loss at which most of each kind agree."""
        return max([1.0, *(3.0 * float(np.median(values)) / LIMIT for values in self.kinds())])


def _misfits(problem: Problem, state: State, adjusted: Problem) -> _Misfits:
    """Return the residuals of everything but the tie points, in the standard deviations of ``problem``; surfaces lie
    where the sigmas of the ``adjusted`` problem have them."""
    block, points = problem.block, problem.block.control_points
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    count = len(block.photographs)
    control, mark = np.full((len(points), 2), np.nan), np.full(len(points.mark_point), np.nan)
    own = np.flatnonzero(np.array(points.role) == "control")
    if len(own):
        off = np.einsum("gji,gj->gi", problem.control_axes, state.control - problem.control_world_m)
        whitened = np.where(np.isfinite(problem.control_sigma_m), off / problem.control_sigma_m, np.nan)
        control[own, 0], control[own, 1] = np.linalg.norm(whitened[:, :2], axis=1) / np.sqrt(2.0), abs(whitened[:, 2])
    used = np.isin(points.mark_point, own) & np.isfinite(points.mark_sigma_px)
    v = residuals(problem.marks, state.cameras, state.control)
    mark[used] = np.where(np.isfinite(v).all(axis=1), np.linalg.norm(v, axis=1) / np.sqrt(2.0), np.inf)
    gnss, attitude = np.full(count, np.nan), np.full(count, np.nan)
    shift = common_shifts(block, state.common, state.rotation)
    for group in attitude_groups(block, state.rotation, state.common):
        attitude[group.photograph] = np.linalg.norm(group.misfit_rad, axis=1) / np.sqrt(3.0)
    whole = (p.attitude_sigma_rad if p.heading_known else None for p in block.photographs)
    attitude /= np.array([np.nan if sigma is None else sigma for sigma in whole])
    for i, photograph in enumerate(block.photographs):
        measured = photograph.measured_centre_world_m(state.rotation[i])
        if measured is not None and photograph.gnss_sigma_m is not None:
            offset = state.offset[problem.flights.index(photograph.flight)] if problem.flights else np.zeros(3)
            away = axes.T @ (state.position[i] - offset - shift[i] - measured)
            gnss[i] = np.linalg.norm(away / photograph.gnss_sigma_m) / np.sqrt(3.0)
    sigma_px = np.array([c.sigmas[0] if 0.0 < c.sigmas[0] < np.inf else np.nan for c in block.cameras])
    focal = abs(state.parameters[:, 0] - np.array([c.focal_px for c in block.cameras])) / sigma_px
    constraint = np.abs(whitened_misfits(block, state, state.control, adjusted.block.constraints))
    exposure = np.linalg.norm(whitened_exposures(block, state.rotation, state.position, state.common), axis=1)
    return _Misfits(control, mark, gnss, attitude, constraint, exposure / np.sqrt(6.0), focal)


def _weakened(block: Block, misfits: _Misfits, scale: float) -> Block:
    """Return the block with the standard deviations of what does not fit raised, as the loss at ``scale`` weights
    it."""

    def times(misfit: FloatArray) -> FloatArray:
        # the weight of the loss is 1 / (1 + x²)²: infinite misfits get none
        return np.where(np.isfinite(misfit), 1.0 + np.minimum(np.nan_to_num(misfit) / (LIMIT * scale), 1e6) ** 2, 1e12)

    points = block.control_points
    plan, height = times(misfits.control).T
    control = points.sigma_m * np.where(points.controlled, np.column_stack([plan, plan, height]), 1.0)
    marks = scaled(points.mark_covariance_px2, np.where(np.isnan(misfits.mark), 1.0, times(misfits.mark)))
    gnss = times(misfits.gnss)
    attitude = times(misfits.attitude)
    focal = times(misfits.focal)
    photographs = tuple(
        replace(
            p,
            gnss_sigma_m=None if p.gnss_sigma_m is None else p.gnss_sigma_m * gnss[i],
            attitude_sigma_rad=p.attitude_sigma_rad
            if p.attitude_sigma_rad is None or not p.heading_known
            else p.attitude_sigma_rad * attitude[i],
        )
        for i, p in enumerate(block.photographs)
    )
    cameras = tuple(
        c if np.isnan(misfits.focal[k]) else replace(c, sigmas=np.concatenate([[c.sigmas[0] * focal[k]], c.sigmas[1:]]))
        for k, c in enumerate(block.cameras)
    )
    weakened = replace(points, sigma_m=control, mark_covariance_px2=marks)
    stated = np.array([sigma for constraint in block.constraints for sigma in constraint.sigmas_m])
    weaker = stated * np.where(np.isnan(misfits.constraint), 1.0, times(misfits.constraint))
    rigs, start = list[Companion](), 0
    for rig in block.rigs:
        end = start + len(rig.exposures)
        own = misfits.exposure[start:end]
        rigs.append(replace(rig, exposure_sigma=rig.exposure_sigma * np.where(np.isnan(own), 1.0, times(own))[:, None]))
        start = end
    return replace(
        block,
        cameras=cameras,
        photographs=photographs,
        control_points=weakened,
        constraints=with_sigmas(block.constraints, weaker.tolist()),
        rigs=tuple(rigs),
    )


def _thinned(problem: Problem) -> Problem:
    """Return the problem with no more than some ten thousand rays of tie points."""
    thin = int(np.ceil(len(problem.tie) / _MOST_RAYS))
    return problem if thin <= 1 else problem.with_tie_observations(problem.tie.select(problem.tie.point % thin == 0))


@dataclass(frozen=True, eq=False)
class Gross:
    """What contradicts most of the rest grossly, the ``sigmas`` of control points that are only assumed, where most of
    these scatter more, and by which factor the stated ones are ``contradicted`` by most points themselves, 1 where they
    are not."""

    suspects: tuple[Hypothesis, ...]
    sigmas: EstimatedSigmas
    contradicted: float = 1.0


@dataclass(frozen=True, eq=False)
class _Robust:
    """The end of a robust adjustment: residuals in the standard deviations of the block, the factor by which control
    points scatter more, in plan as in height, since of ten points either alone says too little, and where it has the
    control points (G', 3)."""

    misfits: _Misfits
    factor: float
    control_world_m: FloatArray


@during("gross errors")
def gross_suspects(block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray] = ()) -> Gross:
    """Return what contradicts most of the rest grossly; ``start`` holds the interior orientations (12,) of the cameras
    to start from, where they are not the given ones.

    Where control points of assumed sigmas are suspected, or most of all, that they scatter more competes with their
    being wrong: by the likelihood of either. Raises AdjustmentError where the block cannot be adjusted whatever is left
    out.
    """
    part, _ = registered_block(block)
    whole = make_problem(part, settings)
    state = start_state(whole)
    controls = np.array(part.control_points.role) == "control"
    met = intersected_marks(part)[0][controls]
    state = replace(state, control=np.where(np.isfinite(met), met, state.control))
    if len(start):
        moved, given = state.parameters.copy(), np.array(start)[:, : state.parameters.shape[1]]
        moved[:, : given.shape[1]] = given
        state = replace(state, cameras=recalibrated(state.cameras, moved))
    angle = float(np.deg2rad(settings.minimum_ray_angle_deg))
    _, agreeing, places = first_agreement(whole, state, settings.first_outlier_threshold_px, angle)
    ties = _thinned(whole.with_tie_observations(whole.tie.select(agreeing))).tie
    begun = whole.with_tie_observations(ties), replace(state, tie_point=places)
    robust, points = _robust(*begun, settings), part.control_points
    contradicts = any(True for _ in _suspects(part, robust.misfits))
    apart = _where_control_stands_apart(*begun, settings) if contradicts else None
    if apart is not None:
        robust = min(robust, apart, key=lambda each: _unlikely(each, points.sigma_assumed & controls))
    off = np.nanmax(robust.misfits.control, axis=1, initial=0.0) > _FAR
    scattering, contradicted = points.sigma_assumed & controls, 1.0
    if np.count_nonzero(off) > MOSTLY * np.count_nonzero(controls):
        scattering = controls
    shifted = _shifted(*begun, settings) if off.any() else None
    if shifted is not None and _unlikely(shifted, scattering) + PRICE < _unlikely(robust, scattering):
        flights = sorted({p.flight for p in part.photographs if p.gnss_world_m is not None})
        offsets = (unmeasured("GNSS offset", flight) for flight in flights)
        return Gross((*offsets, *_suspects(part, shifted.misfits)), EstimatedSigmas.none())
    enough = settings.estimate_sigmas and np.count_nonzero(scattering) >= FEWEST_SCATTERING
    if enough and off[scattering].any() and not _exchanged(robust.control_world_m, points, off):
        most = min(0.8, 0.5 + 0.5 * (DATUM + 1) / (3 * np.count_nonzero(scattering)))
        runs = [_robust(*begun, settings, scattering, share) for share in (most, 0.5)]
        robust = min(robust, *runs, key=lambda each: _unlikely(each, scattering))
        if _wrong(robust, scattering) > MOST_WRONG:
            robust = _robust(*begun, settings, scattering, NEARLY_ALL)
        if robust.factor > 1.0 and not points.sigma_assumed[scattering].all():
            contradicted = robust.factor
    control = np.where(scattering[:, None], robust.misfits.control / robust.factor, robust.misfits.control)
    suspects = tuple(_suspects(part, replace(robust.misfits, control=control)))
    return Gross(suspects, _sigmas(points, scattering, robust.factor), contradicted)


def _robust(
    problem: Problem,
    state: State,
    settings: AdjustmentSettings,
    scattering: BoolArray | None = None,
    share: float = 0.5,
    scale: float | None = None,
) -> _Robust:
    """Adjust a block under the loss, whose ``scale``, of all kinds if None, falls to that of the standard deviations;
    of control points that are ``scattering`` (G,), to that of a ``share`` of their coordinates."""
    part, ties, factor = problem.block, problem.tie, 1.0
    quick = replace(settings, maximum_iterations=_ITERATIONS, relative_tolerance=_TOLERANCE)
    misfits = _misfits(problem, state, problem)
    scale = misfits.scale() if scale is None else scale
    left = ROUNDS_AT_END if scattering is None else ROUNDS_SCATTERING
    for _ in range(_MOST_ROUNDS):
        given, now = part, misfits
        if scattering is not None:
            within = _quantiles(share)
            factor = max(1.0, float(np.nanquantile(misfits.control[scattering] / within, share)))
            given = _scattering(part, scattering, factor)
            own = misfits.control / factor * (scale / min(scale, STEP))  # their scale has fallen already
            now = replace(misfits, control=np.where(scattering[:, None], own, misfits.control))
        problem_now = make_problem(_weakened(given, now, scale), quick).with_tie_observations(ties)
        try:
            state = minimise(problem_now, state, quick).state
        except IndeterminateError as error:
            raise AdjustmentError("no subset of the observations determines the block") from error
        misfits = _misfits(problem, state, problem_now)
        left -= scale == 1.0
        if not left:
            break
        scale = max(1.0, scale / STEP)
    return _Robust(misfits, factor, state.control)


def _where_control_stands_apart(problem: Problem, state: State, settings: AdjustmentSettings) -> _Robust | None:
    """Return the robust adjustment that begins at the scale of everything but the control points, None where theirs is
    no larger or GNSS does not place the block: most of them may be wrong, and at their scale bend it beyond return."""
    if not any(p.gnss_world_m is not None for p in problem.block.photographs):
        return None
    misfits = _misfits(problem, state, problem)
    others = replace(misfits, control=np.full_like(misfits.control, np.nan)).scale()
    return _robust(problem, state, settings, scale=others) if misfits.scale() > STEP * others else None


def _shifted(problem: Problem, state: State, settings: AdjustmentSettings) -> _Robust | None:
    """Return the robust adjustment with offsets of the GNSS positions that may be any, None where there are none, or
    where they may be already."""
    block = problem.block
    known = any(p.gnss_world_m is not None for p in block.photographs)
    if not known or block.is_free or np.all(block.gnss_offset_sigma_m >= UNKNOWN_M):
        return None
    open_block = replace(block, gnss_offset_sigma_m=np.full(3, UNKNOWN_M))
    opened = make_problem(open_block, settings).with_tie_observations(problem.tie)
    return _robust(opened, replace(state, offset=np.zeros((len(opened.flights), 3))), settings)


def _exchanged(control_world_m: FloatArray, points: ControlPoints, off: BoolArray) -> bool:
    """Return whether most of the control points that are ``off`` (G,) lie where another one was surveyed: their names
    are wrong, not what they were surveyed to."""
    controls = np.flatnonzero(np.array(points.role) == "control")
    surveyed = points.position_world_m[controls]
    apart = np.linalg.norm(control_world_m[:, None] - surveyed, axis=2)
    apart[np.diag_indices(len(apart))] = np.inf
    extent = float(np.linalg.norm(np.ptp(surveyed, axis=0)))
    elsewhere = apart.min(axis=1) < AT_ANOTHER * extent
    return bool(np.mean(elsewhere[off[controls]]) > MOSTLY)


def _quantiles(share: float) -> FloatArray:
    """Return below what a ``share`` of the misfits of control points lies, in plan, over both axes, and in height."""
    return np.array([np.sqrt(-np.log(1.0 - share)), norm.ppf(0.5 * (1.0 + share))])


def _wrong(robust: _Robust, scattering: BoolArray) -> float:
    """Return the share of the control points that are ``scattering`` (G,) which are off all the same."""
    misfits = robust.misfits.control[scattering] / robust.factor
    return float(np.mean(np.nanmax(misfits, axis=1, initial=0.0) > _FAR))


def _scattering(block: Block, scattering: BoolArray, factor: float) -> Block:
    """Return a block with the sigmas of control points (G,) multiplied by a factor."""
    points = block.control_points
    sigma_m = np.where(scattering[:, None], points.sigma_m * factor, points.sigma_m)
    return replace(block, control_points=replace(points, sigma_m=sigma_m))


def _unlikely(robust: _Robust, scattering: BoolArray) -> float:
    """Return twice the negative logarithm of the likelihood of an explanation, but for a constant: of control points
    that may be ``scattering`` (G,) squares and their normalisation, a wrong one being distributed as widely as it is
    off; of everything else squares up to the limit; and PRICE for all that is wrong."""
    control = np.where(scattering[:, None], robust.misfits.control / robust.factor, np.nan)
    known = np.isfinite(control)
    off = known & (control > _FAR)
    each = np.where(off, 1.0 + 2.0 * np.log(np.where(off, control, 1.0)), np.where(known, control, 0.0) ** 2)
    total = float(np.sum(np.array([2.0, 1.0]) * (each + 2.0 * np.log(robust.factor) * known)))
    total += PRICE * float(np.count_nonzero(off.any(axis=1)))
    others = replace(robust.misfits, control=np.where(scattering[:, None], np.nan, robust.misfits.control))
    for values in others.kinds():
        total += float(np.sum(np.minimum(values, _FAR) ** 2)) + PRICE * float(np.count_nonzero(values > _FAR))
    return total


def _sigmas(points: ControlPoints, scattering: BoolArray, factor: float) -> EstimatedSigmas:
    """Return the sigmas with which control points that scatter more begin, none where they do not."""
    if factor == 1.0:
        return EstimatedSigmas.none()
    rows = list[tuple[str, str, int, float, float, float, float, float]]()
    for kind, axes in CONTROL_PARTS:
        sigma_m = points.sigma_m[scattering][:, axes]
        known = sigma_m[np.isfinite(sigma_m)]
        if len(known):
            median = float(np.median(known))
            rows.append((kind, CONTROL, len(known), 0.0, median, factor * median, factor * median, factor))
    return sigmas_of(rows)


def _suspects(block: Block, misfits: _Misfits) -> Iterator[Hypothesis]:
    limit = _FAR
    points, names = block.control_points, block.photograph_names
    for g in np.flatnonzero((misfits.control > limit).any(axis=1)).tolist():
        wrong = (misfits.control[g] > limit) | points.sigma_assumed[g]  # of one hand: wrong as a whole
        axes = tuple(np.flatnonzero(points.controlled[g] & np.repeat(wrong, [2, 1])).tolist())
        unknown = (float("nan"),) * len(axes)
        yield Hypothesis("control point", points.name[g], None, axes, unknown, unknown, float("inf"))
    for m in np.flatnonzero(misfits.mark > limit).tolist():
        yield unmeasured("mark", points.name[points.mark_point[m]], names[points.mark_photograph[m]])
    for i in np.flatnonzero(misfits.gnss > limit).tolist():
        yield unmeasured("GNSS position", names[i])
    for i in np.flatnonzero(misfits.attitude > limit).tolist():
        yield unmeasured("attitude", names[i])
    for o, misfit in zip(observations(block.constraints), misfits.constraint.tolist(), strict=True):
        if misfit > limit:
            yield unmeasured(o.kind, o.label)
    for (photograph, _), misfit in zip(exposure_names(block.rigs), misfits.exposure.tolist(), strict=True):
        if misfit > limit:
            yield unmeasured("exposure", photograph)
    for c in np.flatnonzero(misfits.focal > limit).tolist():
        yield unmeasured("focal length", block.cameras[c].name)
