"""Standard deviations of GNSS positions that nobody has stated, from their own residuals, by flight, plan and height.

A consumer receiver states no accuracy, and what is assumed for it is several times what neighbouring positions differ
by. The scatter about the offset of a flight is estimated as a variance component (Förstner 1979); what a whole flight
is off by together it cannot show, that is the offset's part. So a flight without an offset among the unknowns keeps
what is assumed. A few blunders must not raise it: squares count up to BEND standard deviations, and are compared with
what normal errors leave below that (Huber 1981, sec. 5.2).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

from photogram.adjustment.reliability import LEAST_REDUNDANCY
from photogram.adjustment.stochastic_model.estimated_sigmas import sigmas_of
from photogram.arrays import BoolArray, FloatArray
from photogram.factors.graph import Problem
from photogram.results import EstimatedSigmas, Reliability, SigmaKind
from photogram.survey import Block

PARTS: tuple[tuple[SigmaKind, slice], ...] = (("gnss_plan", slice(0, 2)), ("gnss_height", slice(2, 3)))

LEAST_M, MOST_M = 0.1, 30.0
"""Bounds of what is estimated. Errors of such a receiver last for minutes, so that many positions have no better mean
than one: below LEAST_M they would hold a block together that they do not determine."""

FEWEST = 10.0
"""Redundancy of a flight in plan or in height, from which its sigma is estimated."""

STEADY = 0.02
"""Relative change below which a sigma stays: each step costs the covariances once more."""

BEND = 2.0
_STEPS = 100
_KEPT = float(chi2.cdf(BEND**2, 3) + BEND**2 * 2.0 * norm.sf(BEND))  # E[min(z², BEND²)]


@dataclass(frozen=True, eq=False)
class GnssScatter:
    """Of one flight, in plan or in height: the ``photographs`` (F,) that take part, the number of coordinates, their
    redundancy, and the ``factor`` by which the sigmas that were used are off."""

    flight: str
    part: SigmaKind
    axes: slice
    photographs: BoolArray
    observations: int
    redundancy: float
    factor: float


def robust_factor(w: FloatArray, redundancy: FloatArray) -> float:
    """Return the factor by which the sigmas of observations (N,) are off, from their tests w and redundancy numbers.

    It solves Σ r min(w²/φ², BEND²) = Σ r E[min(z², BEND²)], z standard normal.
    """
    expected, variance = _KEPT * float(redundancy.sum()), 1.0
    for _ in range(_STEPS):
        kept = float(np.sum(redundancy * np.minimum(w**2 / variance, BEND**2)))
        if abs(kept / expected - 1.0) < 1e-6 or kept == 0.0:
            break
        variance *= kept / expected
    return float(np.sqrt(variance))


def gnss_scatters(problem: Problem, tested: Reliability) -> list[GnssScatter]:
    """Return what GNSS positions of assumed sigmas scatter by, where there are enough of them about an offset."""
    photographs, scatters = problem.block.photographs, list[GnssScatter]()
    assumed = np.array([p.gnss_sigma_assumed and p.gnss_sigma_m is not None for p in photographs], dtype=bool)
    for flight in problem.flights:
        own = assumed & np.array([p.flight == flight for p in photographs], dtype=bool)
        for part, axes in PARTS:
            r, w = tested.gnss_redundancy[own, axes].ravel(), tested.gnss_w[own, axes].ravel()
            known = np.isfinite(w) & (r > LEAST_REDUNDANCY)
            total = float(r[known].sum())
            if total >= FEWEST:
                factor = robust_factor(w[known], r[known])
                scatters.append(GnssScatter(flight, part, axes, own, int(known.sum()), total, factor))
    return scatters


def with_gnss_factors(block: Block, scatters: list[GnssScatter]) -> Block:
    """Return the block with the sigmas of assumed positions multiplied by their factors, within the bounds."""
    photographs = list(block.photographs)
    for scatter in scatters:
        for i in np.flatnonzero(scatter.photographs).tolist():
            sigma = photographs[i].gnss_sigma_m
            if sigma is not None:
                changed = sigma.copy()
                changed[scatter.axes] = np.clip(scatter.factor * sigma[scatter.axes], LEAST_M, MOST_M)
                photographs[i] = replace(photographs[i], gnss_sigma_m=changed)
    return replace(block, photographs=tuple(photographs))


def gnss_steady(before: Block, after: Block) -> bool:
    """Return whether the sigmas of the GNSS positions of two blocks differ by less than STEADY."""
    pairs = ((p.gnss_sigma_m, q.gnss_sigma_m) for p, q in zip(before.photographs, after.photographs, strict=True))
    return all(p is None or q is None or bool(np.all(np.abs(q / p - 1.0) < STEADY)) for p, q in pairs)


def gnss_table(stated: Block, used: Block, scatters: list[GnssScatter]) -> EstimatedSigmas:
    """Return the sigmas of GNSS positions as they were assumed in the block ``stated``, as their ``scatters`` say at
    those of ``used``, and as used."""

    def median(block: Block, scatter: GnssScatter) -> float:
        own = [p.gnss_sigma_m for p, mine in zip(block.photographs, scatter.photographs, strict=True) if mine]
        return float(np.median(np.array(own)[:, scatter.axes]))

    rows = list[tuple[str, str, int, float, float, float, float, float]]()
    for s in scatters:
        assumed_m, used_m = median(stated, s), median(used, s)
        says_m = s.factor * used_m
        rows.append((s.part, s.flight, s.observations, s.redundancy, assumed_m, says_m, used_m, used_m / assumed_m))
    return sigmas_of(rows)
