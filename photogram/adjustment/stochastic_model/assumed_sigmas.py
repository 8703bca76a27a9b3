"""Standard deviations that nobody has stated, from the residuals of what they belong to: GNSS positions, by flight, in
plan and in height; control points, in plan and in height; marks.

What is assumed is a hypothesis. A consumer receiver states no accuracy, and what is assumed for it is several times
what neighbouring positions differ by; a list of points without accuracy may come from a total station or from a
hand-held receiver. The scatter is estimated as a variance component (Förstner 1979). Of positions it is that about the
offset of a flight, since what a whole flight is off by together they cannot show: without an offset among the unknowns
they keep what is assumed. A few blunders must not raise it: squares count up to BEND standard deviations, and are
compared with what normal errors leave below that (Huber 1981, sec. 5.2). Control points are few: what is assumed of
them counts as much as PRIOR observations that scatter so (the conjugate prior of a variance: Koch 2007, sec. 4.3.2).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

from photogram.adjustment.reliability import LEAST_REDUNDANCY
from photogram.adjustment.stochastic_model.estimated_sigmas import sigmas_of
from photogram.arrays import FloatArray, IntArray
from photogram.factors.graph import Problem
from photogram.gnss import UNKNOWN_M
from photogram.measures.mark_covariances import scaled
from photogram.results import EstimatedSigmas, Reliability, SigmaKind
from photogram.survey import Block, ControlPoints

PARTS: tuple[tuple[SigmaKind, slice], ...] = (("gnss_plan", slice(0, 2)), ("gnss_height", slice(2, 3)))

LEAST_M, MOST_M = 0.1, 30.0
"""Bounds of what is estimated. Errors of such a receiver last for minutes, so that many positions have no better mean
than one: below LEAST_M they would hold a block together that they do not determine."""

FEWEST = 10.0
"""Redundancy of a flight in plan or in height, from which its sigma is estimated."""

STEADY = 0.02
"""Relative change below which a sigma stays: each step costs the covariances once more."""

CONTROL_PARTS: tuple[tuple[SigmaKind, slice], ...] = (("control_plan", slice(0, 2)), ("control_height", slice(2, 3)))
CONTROL = "control points"
"""What the one group of all control points of assumed sigmas is called, and that of their marks."""

LEAST_CONTROL_M, MOST_CONTROL_M = 0.002, 50.0
LEAST_MARK_PX, MOST_MARK_PX = 0.1, 20.0
"""Bounds of what is estimated of control points and of marks."""

PRIOR, PRIOR_OF_PART = 0.2, 8.0
"""Observations as which what is assumed of control points and of marks counts, and as which the scatter of all
coordinates counts for that in plan or in height."""

BEND, BEND_OF_CONTROL, EFFICIENCY = 2.0, 1.5, 0.8
"""Standard deviations up to which squares count; of control points fewer, since two of ten may be wrong,
and what is left of their redundancy."""

_STEPS = 100


@dataclass(frozen=True, eq=False)
class AssumedScatter:
    """Of one group of observations: its ``kind``, the flight that it is of or what it is called, the numbers of its
    ``members`` among photographs or ground points, the ``axes`` of their positions, the number of coordinates, their
    redundancy, and the ``factor`` by which the sigmas that were used are off."""

    kind: SigmaKind
    of: str
    members: IntArray
    axes: slice
    observations: int
    redundancy: float
    factor: float


def robust_factor(
    w: FloatArray, redundancy: FloatArray, bend: float = BEND, prior: float = 0.0, prior_factor: float = 1.0
) -> float:
    """Return the factor by which the sigmas of observations (N,) are off, from their tests w and redundancy numbers,
    and from ``prior`` observations that say ``prior_factor``.

    It solves Σ r min(w²/φ², b²) + n (φ₀/φ)² = Σ r E[min(z², b²)] + n, z standard normal and b the ``bend``.
    """
    kept_of_normal = float(chi2.cdf(bend**2, 3) + bend**2 * 2.0 * norm.sf(bend))
    expected, variance = kept_of_normal * float(redundancy.sum()) + prior, 1.0
    for _ in range(_STEPS):
        kept = float(np.sum(redundancy * np.minimum(w**2 / variance, bend**2))) + prior * prior_factor**2 / variance
        if abs(kept / expected - 1.0) < 1e-6 or kept == 0.0:
            break
        variance *= kept / expected
    return float(np.sqrt(variance))


def assumed_scatters(problem: Problem, tested: Reliability, assumed: Block) -> list[AssumedScatter]:
    """Return what observations of assumed sigmas scatter by, where there are enough of them; ``assumed`` is the block
    with the sigmas as they were assumed."""
    return [
        *_of_positions(problem, tested),
        *_of_control(problem.block.control_points, tested, assumed.control_points),
        *_of_marks(problem.block.control_points, tested, assumed.control_points),
    ]


def _of_positions(problem: Problem, tested: Reliability) -> Iterator[AssumedScatter]:
    photographs = problem.block.photographs
    assumed = np.array([p.gnss_sigma_assumed and p.gnss_sigma_m is not None for p in photographs], dtype=bool)
    sigma_m = np.array([np.zeros(3) if p.gnss_sigma_m is None else p.gnss_sigma_m for p in photographs]).reshape(-1, 3)
    for flight in problem.flights:
        own = np.flatnonzero(assumed & np.array([p.flight == flight for p in photographs], dtype=bool))
        for kind, axes in PARTS:
            members = own[sigma_m[own, axes].max(axis=1) < UNKNOWN_M]
            r, w = tested.gnss_redundancy[members, axes].ravel(), tested.gnss_w[members, axes].ravel()
            known = np.isfinite(w) & (r > LEAST_REDUNDANCY)
            total = float(r[known].sum())
            if total >= FEWEST:
                factor = robust_factor(w[known], r[known])
                yield AssumedScatter(kind, flight, members, axes, int(known.sum()), total, factor)


def _of_control(points: ControlPoints, tested: Reliability, assumed: ControlPoints) -> Iterator[AssumedScatter]:
    own = points.sigma_assumed
    r, w = tested.ground_redundancy, tested.ground_w
    known = np.isfinite(w) & (r > LEAST_REDUNDANCY) & own[:, None]
    if not known.any():
        return
    ratio = np.divide(assumed.sigma_m, points.sigma_m, out=np.ones_like(r), where=known)
    whole = robust_factor(w[known], r[known], BEND_OF_CONTROL, PRIOR, float(np.median(ratio[known])))
    mean = _mean_of_variance(float(r[known].sum()))
    for kind, axes in CONTROL_PARTS:
        part = known[:, axes]
        if part.any():
            members = np.flatnonzero(own & points.used[:, axes].any(axis=1))
            these = r[:, axes][part]
            # the ratio of what was assumed in plan and in height is kept unless the points deny it
            of_part = float(np.median(ratio[:, axes][part]) / np.median(ratio[known])) * whole
            factor = mean * robust_factor(w[:, axes][part], these, BEND_OF_CONTROL, PRIOR_OF_PART, of_part)
            yield AssumedScatter(kind, CONTROL, members, axes, int(part.sum()), float(these.sum()), factor)


def _mean_of_variance(redundancy: float) -> float:
    """Return by what the root of the expectation of a variance is larger than the estimate with so much redundancy
    (the inverse gamma distribution: Koch 2007, sec. 2.6.3)."""
    degrees = EFFICIENCY * redundancy + PRIOR
    return float(np.sqrt(degrees / (degrees - 2.0))) if degrees > 4.0 else float(np.sqrt(2.0))


def _of_marks(points: ControlPoints, tested: Reliability, assumed: ControlPoints) -> Iterator[AssumedScatter]:
    own = np.flatnonzero(points.mark_sigma_assumed)
    mine = np.isin(points.mark_point, own)
    r, w = tested.mark_redundancy[mine].ravel(), tested.mark_w[mine].ravel()
    known = np.isfinite(w) & (r > LEAST_REDUNDANCY)
    if known.any():
        before, now = (np.repeat(p.mark_sigma_px[mine], 2)[known] for p in (assumed, points))
        ratio = before / now
        factor = robust_factor(w[known], r[known], BEND_OF_CONTROL, PRIOR, float(np.median(ratio)))
        yield AssumedScatter("marks", CONTROL, own, slice(0, 2), int(known.sum()), float(r[known].sum()), factor)


def with_assumed_factors(block: Block, scatters: Sequence[AssumedScatter]) -> Block:
    """Return the block with assumed sigmas multiplied by their factors, within the bounds."""
    photographs, points = list(block.photographs), block.control_points
    sigma_m, covariance = points.sigma_m.copy(), points.mark_covariance_px2
    for scatter in scatters:
        if scatter.kind in ("gnss_plan", "gnss_height"):
            for i in scatter.members.tolist():
                sigma = photographs[i].gnss_sigma_m
                if sigma is not None:
                    changed = sigma.copy()
                    changed[scatter.axes] = np.clip(scatter.factor * sigma[scatter.axes], LEAST_M, MOST_M)
                    photographs[i] = replace(photographs[i], gnss_sigma_m=changed)
        elif scatter.kind == "marks":
            mine = np.isin(points.mark_point, scatter.members)
            mine &= np.isfinite(points.mark_sigma_px)
            used_px, factor = points.mark_sigma_px[mine], np.ones(len(mine))
            factor[mine] = np.clip(scatter.factor * used_px, LEAST_MARK_PX, MOST_MARK_PX) / used_px
            covariance = scaled(covariance, factor)
        else:
            own = sigma_m[scatter.members, scatter.axes]
            bounded = np.where(np.isfinite(own), np.clip(scatter.factor * own, LEAST_CONTROL_M, MOST_CONTROL_M), own)
            sigma_m[scatter.members, scatter.axes] = bounded
    points = replace(points, sigma_m=sigma_m, mark_covariance_px2=covariance)
    return replace(block, photographs=tuple(photographs), control_points=points)


def assumed_steady(before: Block, after: Block) -> bool:
    """Return whether the sigmas of positions, control points and marks of two blocks differ by less than STEADY."""
    pairs = [(p.gnss_sigma_m, q.gnss_sigma_m) for p, q in zip(before.photographs, after.photographs, strict=True)]
    ratios = [q / p for p, q in pairs if p is not None and q is not None]
    old, new = before.control_points, after.control_points
    for a, b in ((old.sigma_m, new.sigma_m), (old.mark_sigma_px, new.mark_sigma_px)):
        known = np.isfinite(a)
        ratios.append(b[known] / a[known])
    return all(bool(np.all(np.abs(ratio - 1.0) < STEADY)) for ratio in ratios)


def assumed_table(stated: Block, used: Block, scatters: Sequence[AssumedScatter]) -> EstimatedSigmas:
    """Return sigmas as they were assumed in the block ``stated``, as ``scatters`` say at those of ``used``, and as
    used."""

    def median(block: Block, scatter: AssumedScatter) -> float:
        points = block.control_points
        if scatter.kind == "marks":
            values = points.mark_sigma_px[np.isin(points.mark_point, scatter.members)]
        elif scatter.kind in ("gnss_plan", "gnss_height"):
            values = np.array([block.photographs[i].gnss_sigma_m for i in scatter.members.tolist()])[:, scatter.axes]
        else:
            values = points.sigma_m[scatter.members, scatter.axes]
        return float(np.median(values[np.isfinite(values)]))

    rows = list[tuple[str, str, int, float, float, float, float, float]]()
    for s in scatters:
        assumed, in_use = median(stated, s), median(used, s)
        says = s.factor * in_use
        rows.append((s.kind, s.of, s.observations, s.redundancy, assumed, says, in_use, in_use / assumed))
    return sigmas_of(rows)
