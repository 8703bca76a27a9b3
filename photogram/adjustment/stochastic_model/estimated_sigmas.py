"""Standard deviations of tie points from their own residuals: variance components, iterated.

With the whitened residuals v of a group and its redundancy r, vᵀPv / r estimates the factor by which the group's
variances are off (Förstner 1979; Förstner & Wrobel 2016, sec. 4.2.4). The group's sigmas are multiplied by its root and
the block is adjusted again, until the factors stay. Groups are the key points of a camera and what was transferred to
its photographs by correlation. A photograph whose residuals scatter more than those of its camera's others, a blurred
one, has a factor of its own on top of that.

vᵀPv is that of the robust loss, of the observations that the outlier rounds have kept. Both make it smaller than that
of all errors; by how much is known for normal errors, and divided out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.stats import chi2

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.factors.elimination.loss import robust_terms, robust_weight
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.joint_covariance import points_redundancy
from photogram.measures.mark_covariances import scaled
from photogram.results import EstimatedSigmas, SigmaKind
from photogram.survey import TRANSFERRED, Block
from photogram.wording import some

KEY_POINTS: SigmaKind = "key_points"
CORRELATED: SigmaKind = "transferred"
PHOTOGRAPH: SigmaKind = "photograph"

FLOOR_PX = 0.05
"""Least standard deviation of a group. Residuals of a twentieth of a pixel are no longer noise alone: interpolation
between pixels and what is left of distortion err alike in neighbouring points, so that a smaller sigma would promise
what many of them together do not hold."""

LEAST_REDUNDANCY = 50.0
"""Of a group, from which its sigma is estimated: to 10 %, one standard deviation."""

BLURRED = 1.5
"""Factor over the other photographs of its camera from which a photograph has one of its own."""
LEAST_OF_PHOTOGRAPH = 30.0
"""The redundancy that it needs."""
BY_CHANCE = 1e-6
"""The probability of such a scatter by chance in any one of all photographs."""

STEADY = 0.01
"""Relative change below which a factor stays."""

STAYS = 0.9
MOST_NAMED = 5
_DATUM = 7  # parameters of a similarity: what tie points alone do not determine
_STEPS = 400  # of the integrals of kept_share
_FIXED_POINT_STEPS, _FIXED_POINT_TOLERANCE = 50, 1e-6  # of the sigmas that a scatter asks for
_MOST_CHANGE = 20.0  # factor within which these stay


@dataclass(frozen=True, eq=False)
class TieGroups:
    """Groups of the observations of tie points: ``group`` (N,) is the number of each one's, ``stated_px`` (N,) its
    sigma as stated; ``camera`` (K,) and ``kind`` (K,) say what the groups are, ``camera_of`` (F,) is the number of
    each photograph's camera."""

    group: IntArray
    stated_px: FloatArray
    camera: tuple[str, ...]
    kind: tuple[SigmaKind, ...]
    camera_of: IntArray

    def select(self, keep: BoolArray) -> TieGroups:
        """Keep the observations of the mask (N,)."""
        return replace(self, group=self.group[keep], stated_px=self.stated_px[keep])


@dataclass(frozen=True, eq=False)
class Factors:
    """By what stated sigmas are multiplied: ``group`` (K,) and, on top of that, ``photograph`` (F,)."""

    group: FloatArray
    photograph: FloatArray

    def are_near(self, others: Factors) -> bool:
        """Return whether other factors differ by less than STEADY."""
        pairs = ((self.group, others.group), (self.photograph, others.photograph))
        return all(bool(np.all(np.abs(a / b - 1.0) < STEADY)) for a, b in pairs)


def tie_groups(block: Block) -> TieGroups:
    """Return the groups of a block's observations of tie points: by camera, key points and transferred ones."""
    tie, names = block.tie_points, [camera.name for camera in block.cameras]
    camera_of = np.array([names.index(name) for name in names], dtype=np.int64)[block.camera_of]
    code = 2 * camera_of[tie.photograph] + (tie.feature == TRANSFERRED)
    present = np.bincount(code) > 0
    return TieGroups(
        (np.cumsum(present) - 1)[code],
        tie.sigma_px,
        tuple(names[c // 2] for c in np.flatnonzero(present).tolist()),
        tuple((KEY_POINTS, CORRELATED)[c % 2] for c in np.flatnonzero(present).tolist()),
        camera_of,
    )


def as_stated(groups: TieGroups) -> Factors:
    """Return the factors that leave every sigma as it was stated."""
    return Factors(np.ones(len(groups.kind)), np.ones(len(groups.camera_of)))


def weighted(whole: Problem, groups: TieGroups, factors: Factors) -> Problem:
    """Return a problem with all its observations of tie points at their stated sigmas times ``factors``."""
    tie = whole.block.tie_points
    sigma_px = groups.stated_px * factors.group[groups.group] * factors.photograph[tie.photograph]
    block = replace(whole.block, tie_points=replace(tie, sigma_px=sigma_px))
    return replace(whole, block=block, tie=replace(whole.tie, sigma_px=sigma_px))


def taken_by_cameras(problem: Problem) -> float:
    """Return the redundancy that poses and calibrations take from the tie points where these determine all of them
    but a similarity, as they nearly do."""
    return float(6 * len(problem.block.photographs) + sum(len(f) for f in problem.free) - _DATUM)


def kept_share(problem: Problem, own: FloatArray, limit: FloatArray) -> FloatArray:
    """Return the share (N,) of the squares of normal errors that the robust loss and the outlier limit leave.

    ``own`` (N,) are the redundancy numbers of both coordinates together, ``limit`` (N,) the largest residual that is
    kept, in sigmas. A residual has the variance own / 2 along every direction; that of a point of two rays has all of
    it across its epipolar line. The integrals are taken once for all points of as many rays.
    """
    rays = np.bincount(problem.tie.point)[problem.tie.point]
    number = np.bincount(rays)
    of_own, of_limit = np.bincount(rays, weights=own), np.bincount(rays, weights=limit)
    share = np.ones(len(number))
    for count in np.flatnonzero(number).tolist():
        variance = max(float(of_own[count] / number[count]), 1e-9)
        spread = np.sqrt(variance if count == 2 else 0.5 * variance)
        s = np.linspace(0.0, min(float(of_limit[count] / number[count]), 10.0 * spread), _STEPS)
        density = np.exp(-0.5 * (s / spread) ** 2) * (1.0 if count == 2 else s)
        _, weight, _ = robust_terms(
            np.column_stack([s, np.zeros_like(s)]), problem.robust_loss, problem.robust_threshold
        )
        share[count] = np.trapezoid(weight * s**2 * density, s) / np.trapezoid(density, s) / variance
    return share[rays]


@dataclass(frozen=True, eq=False)
class TieScatter:
    """What the observations of tie points that took part scatter by: of each one (N,) its group and photograph, its
    weighted square vᵀPv at the sigmas that were used, its redundancy, and what the square is expected to be."""

    group: IntArray
    photograph: IntArray
    square: FloatArray
    redundancy: FloatArray
    expected: FloatArray

    def factor(self, of: IntArray, count: int, chosen: BoolArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Return by numbers ``of`` (N,) below ``count`` the factors of the sigmas that were used, 1 without
        redundancy, and the redundancies; of the observations ``chosen`` (N,) where given."""
        part = slice(None) if chosen is None else chosen
        square, expected, redundancy = (
            np.asarray(np.bincount(of[part], weights=w[part], minlength=count), dtype=np.float64)
            for w in (self.square, self.expected, self.redundancy)
        )
        known = (expected > 0.0) & (square > 0.0)
        return np.sqrt(np.where(known, square, 1.0) / np.where(known, expected, 1.0)), redundancy


def tie_scatter(
    problem: Problem, state: State, groups: TieGroups, limit_px: FloatArray, taken: float
) -> TieScatter | None:
    """Return what the observations of tie points scatter by, None where they are too few to say.

    ``groups`` and ``limit_px`` (N,), up to which residuals were kept, are those of the observations of ``problem``;
    ``taken`` is the redundancy that poses and calibrations take from them. Every photograph is taken to take as much,
    from its observations by their share.

    Robust loss and outlier limit take the more from the squares the smaller they are against the errors. What they take
    is hence that at the sigmas which the squares then ask for, found group by group as a fixed point.
    """
    tie, count = problem.tie, len(problem.block.photographs)
    own = points_redundancy(problem, state)
    of_photograph = np.bincount(tie.photograph, weights=own, minlength=count)
    left = np.maximum(of_photograph - taken / count, 0.1 * of_photograph)
    whole = float(own.sum()) - taken
    if not (whole > 0.0 and left.sum() > 0.0):
        return None
    share = np.divide(left, of_photograph, out=np.zeros(count), where=of_photograph > 0.0)
    redundancy = own * share[tie.photograph] * whole / float(left.sum())
    whitened = residuals(tie, state.cameras, state.tie_point)
    of_group = np.bincount(groups.group, weights=redundancy, minlength=len(groups.kind))
    squared, limit = np.einsum("ij,ij->i", whitened, whitened), limit_px / tie.sigma_px
    factor = np.ones(len(groups.kind))
    for _ in range(_FIXED_POINT_STEPS):
        at = factor[groups.group]
        square = squared * robust_weight(squared / at**2, problem.robust_loss, problem.robust_threshold)
        expected = redundancy * kept_share(problem, own, limit / at)
        scatter = TieScatter(groups.group, tie.photograph, square, redundancy, expected)
        asked, _ = scatter.factor(groups.group, len(groups.kind))
        asked = np.where(of_group >= LEAST_REDUNDANCY, np.clip(asked, 1.0 / _MOST_CHANGE, _MOST_CHANGE), 1.0)
        near = np.abs(asked / factor - 1.0).max() < _FIXED_POINT_TOLERANCE
        factor = asked
        if near:
            break
    return scatter


def _blurred(scatter: TieScatter, now: Factors, groups: TieGroups) -> BoolArray:
    """Return which photographs (F,) scatter significantly more than most of their camera's.

    Each is compared with the median of its camera's photographs, so that a few do not raise what they are compared
    with; ``now`` are the factors at which the scatter was taken.
    """
    count = len(groups.camera_of)
    factor, redundancy = scatter.factor(scatter.photograph, count)
    factor, known = factor * now.photograph, redundancy >= LEAST_OF_PHOTOGRAPH
    blurred = np.zeros(count, dtype=bool)
    for camera in np.unique(groups.camera_of).tolist():
        mine = known & (groups.camera_of == camera)
        if not mine.any():
            continue
        ratio = factor / float(np.median(factor[mine]))
        chance = chi2.sf(ratio**2 * redundancy, redundancy)
        # once it has a factor a photograph keeps it a little longer, so that rounds do not alternate
        limit = np.where(now.photograph > 1.0, STAYS * BLURRED, BLURRED)
        blurred |= mine & (ratio > limit) & (chance < BY_CHANCE / count)
    return blurred


def improved(scatter: TieScatter, now: Factors, groups: TieGroups) -> Factors:
    """Return the factors that the scatter at the factors ``now`` asks for.

    A group with less redundancy than LEAST_REDUNDANCY keeps its stated sigma, and none falls below FLOOR_PX, by the
    median of its observations.
    """
    kinds, count = len(groups.kind), len(groups.camera_of)
    blurred = _blurred(scatter, now, groups)
    sharp = ~blurred[scatter.photograph]
    # the factors of photographs are taken out where they go, before those of groups are estimated
    plain = replace(scatter, square=scatter.square * now.photograph[scatter.photograph] ** 2)
    change, redundancy = plain.factor(scatter.group, kinds, sharp)
    stated_px = np.array([np.median(groups.stated_px[groups.group == k]) for k in range(kinds)])
    floor = np.minimum(FLOOR_PX / stated_px, 1.0)
    group = np.where(redundancy >= LEAST_REDUNDANCY, np.maximum(now.group * change, floor), 1.0)
    at_group = replace(plain, square=plain.square * ((now.group / group)[scatter.group]) ** 2)
    photograph, _ = at_group.factor(scatter.photograph, count)
    return Factors(group, np.where(blurred, np.maximum(photograph, 1.0), 1.0))


def table(stated: Block, groups: TieGroups, factors: Factors, scatter: TieScatter | None) -> EstimatedSigmas:
    """Return the sigmas of tie points as stated, as their scatter ``scatter`` at ``factors`` says, and as used; none
    where nothing could be said."""
    if scatter is None:
        return EstimatedSigmas.none()
    rows = list[tuple[str, str, int, float, float, float, float, float]]()
    change, redundancy = scatter.factor(scatter.group, len(groups.kind), factors.photograph[scatter.photograph] == 1.0)
    for k, (camera, kind) in enumerate(zip(groups.camera, groups.kind, strict=True)):
        mine = scatter.group == k
        if mine.any():
            median = float(np.median(groups.stated_px[mine]))
            used, known = median * float(factors.group[k]), redundancy[k] >= LEAST_REDUNDANCY
            says = used * float(change[k]) if known else float("nan")
            n = 2 * int(np.count_nonzero(mine))
            rows.append((kind, camera, n, float(redundancy[k]), median, says, used, float(factors.group[k])))
    own, of_photograph = scatter.factor(scatter.photograph, len(groups.camera_of))
    at_group_px = groups.stated_px * factors.group[groups.group]
    for i in np.flatnonzero(factors.photograph > 1.0).tolist():
        mine, times = scatter.photograph == i, float(factors.photograph[i])
        median, sharp_px = float(np.median(groups.stated_px[mine])), float(np.median(at_group_px[mine]))
        used, n = sharp_px * times, 2 * int(np.count_nonzero(mine))
        says, name = used * float(own[i]), stated.photographs[i].name
        rows.append((PHOTOGRAPH, name, n, float(of_photograph[i]), median, says, used, times))
    return sigmas_of(rows)


def sigmas_of(rows: Sequence[tuple[str, str, int, float, float, float, float, float]]) -> EstimatedSigmas:
    """Return rows of kind, name, observations, redundancy, stated, estimated and used sigma, and factor, as arrays."""
    if not rows:
        return EstimatedSigmas.none()
    kind, of, observations, *figures = zip(*rows, strict=True)
    return EstimatedSigmas(
        np.array(kind, dtype=np.str_),
        np.array(of, dtype=np.str_),
        np.array(observations, dtype=np.int64),
        *(np.array(column, dtype=np.float64) for column in figures),
    )


def joined(first: EstimatedSigmas, second: EstimatedSigmas) -> EstimatedSigmas:
    """Return the rows of both."""
    pairs = ((getattr(first, f.name), getattr(second, f.name)) for f in fields(EstimatedSigmas))
    return EstimatedSigmas(*(np.concatenate(pair) for pair in pairs))


def factors_of(block: Block, groups: TieGroups, sigmas: EstimatedSigmas) -> Factors:
    """Return the factors that were estimated for the groups and photographs of a block; 1 for what ``sigmas`` do not
    name."""
    of_kind = {kind: sigmas.factors(kind) for kind in (KEY_POINTS, CORRELATED)}
    own = sigmas.factors(PHOTOGRAPH)
    return Factors(
        np.array([of_kind[kind].get(camera, 1.0) for camera, kind in zip(groups.camera, groups.kind, strict=True)]),
        np.array([own.get(photograph.name, 1.0) for photograph in block.photographs]),
    )


def stated_again(block: Block, sigmas: EstimatedSigmas) -> Block:
    """Return the block of an adjustment with the sigmas of its tie points as they were stated, before they were
    multiplied by the factors of ``sigmas``."""
    tie, groups = block.tie_points, tie_groups(block)
    factors = factors_of(block, groups, sigmas)
    stated_px = tie.sigma_px / (factors.group[groups.group] * factors.photograph[tie.photograph])
    return replace(block, tie_points=replace(tie, sigma_px=stated_px))


def with_assumed_sigmas(block: Block, sigmas: EstimatedSigmas) -> Block:
    """Return a block with those of the estimated sigmas that were assumed: of GNSS positions, control points and
    marks."""
    plan, height = sigmas.factors("gnss_plan"), sigmas.factors("gnss_height")
    photographs = block.photographs
    if plan or height:
        photographs = tuple(
            p
            if p.gnss_sigma_m is None or not p.gnss_sigma_assumed
            else replace(p, gnss_sigma_m=p.gnss_sigma_m * [*(plan.get(p.flight, 1.0),) * 2, height.get(p.flight, 1.0)])
            for p in photographs
        )
    points = block.control_points
    in_plan, in_height, of_marks = (
        next(iter(sigmas.factors(kind).values()), 1.0) for kind in ("control_plan", "control_height", "marks")
    )
    own, marks = points.sigma_assumed & points.controlled.any(axis=1), points.mark_sigma_assumed[points.mark_point]
    return replace(
        block,
        photographs=photographs,
        control_points=replace(
            points,
            sigma_m=np.where(own[:, None], points.sigma_m * [in_plan, in_plan, in_height], points.sigma_m),
            mark_covariance_px2=points.mark_covariance_px2
            if of_marks == 1.0
            else scaled(points.mark_covariance_px2, np.where(marks, of_marks, 1.0)),
        ),
    )


def with_control_assumed(block: Block) -> Block:
    """Return a block whose control points count as if nobody had stated their sigmas: most of them deny these."""
    points = block.control_points
    assumed = points.sigma_assumed | np.asarray(points.controlled.any(axis=1))
    return replace(block, control_points=replace(points, sigma_assumed=assumed))


def scattering(sigmas: EstimatedSigmas) -> tuple[str, ...]:
    """Return the warning of photographs with a factor of their own, nothing where there are none."""
    own = np.flatnonzero(sigmas.kind == PHOTOGRAPH)
    if not len(own):
        return ()
    worst = own[np.argsort(-sigmas.factor[own], kind="stable")]
    names = some([f"{sigmas.of[k]} ({sigmas.factor[k]:.1f} times)" for k in worst.tolist()], MOST_NAMED)
    return (
        f"Tie points scatter more than in the other photographs of their camera: {names}. They count as much less; "
        "where they are blurred, look for the cause (exposure time, focus), or leave them out",
    )
