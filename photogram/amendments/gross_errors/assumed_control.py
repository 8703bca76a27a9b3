"""Control points whose standard deviations are only assumed: some are tested together by what the others scatter by.

A wrong point raises the scatter that all of them are given together, and hides behind it; two of them hide each other.
So the coordinates E of up to three points are predicted by all the rest, and their distances d from the survey are
compared with the covariance C that they have if E scatters as the other points do: dᵀ C⁻¹ d over the number of
coordinates is compared with F (several outliers with an unknown variance factor: Koch 2007, sec. 4.2.3).

With the residuals v of an adjustment with the variances S and the covariance Q of the adjusted points, the photographs
alone have the normal matrix N = Q⁻¹ − S⁻¹ and the right side b = Q⁻¹ v; with φ² S of the other points alone, the
distances are the elements of (N + φ⁻² S⁻¹)⁻¹ b, and φ² is their variance component (Förstner 1979).

The points of such a list come from one receiver or one hand: one that is wrong is wrong as a whole, since a height that
is left of it would go on bending the block.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np
from scipy.stats import chi2, f

from photogram.adjustment.stochastic_model.assumed_sigmas import LEAST_CONTROL_M, PRIOR
from photogram.amendments.gross_errors.hypothesis import Hypothesis
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.results import Adjustment

ALARMS = 0.02
"""Probability of a false alarm in the tests of all control points together. More than of stated sigmas: a point of a
hand-held receiver that is left out for nothing is no loss, one that is off by ten times its scatter is."""

MOST_TOGETHER = 3
"""Points of a group."""
MOST_COMPARED = 9
"""Points of which groups are made: those that are the least likely by themselves."""
FEWEST_LEFT = 4.0
"""Redundancy that is left to tell the scatter of the others."""

_STEPS, _STEADY = 30, 0.01
_LEAST, _TINY = 1e-9, 1e-300


@dataclass(frozen=True, eq=False)
class AssumedControl:
    """Coordinates (k,) of control points of assumed sigmas: the number of the ``point`` of each, the ``variance_m2``
    that is used, and the normal matrix (k, k) and the right side (k,) of the photographs alone."""

    point: IntArray
    variance_m2: FloatArray
    normal: FloatArray
    right: FloatArray

    @staticmethod
    def of(result: Adjustment) -> AssumedControl:
        """Return it of an adjustment."""
        block, points = result.block, result.block.control_points
        axes = block.frame.rotation_world_from_map(np.zeros(3))
        known = points.used & points.sigma_assumed[:, None] & np.isfinite(result.estimates.ground_world_m)
        rows = np.flatnonzero(known.ravel())
        turn = np.kron(np.eye(len(points)), axes)[:, rows]
        Q = turn.T @ np.nan_to_num(result.covariances.ground_joint_m2) @ turn
        off = ((result.estimates.ground_world_m - points.position_world_m) @ axes).ravel()[rows]
        variance = points.sigma_m.ravel()[rows] ** 2
        inverse = np.linalg.inv(Q) if len(rows) else Q
        value, vector = np.linalg.eigh(inverse - np.diag(1.0 / variance))
        normal = (vector * np.maximum(value, 0.0)) @ vector.T
        return AssumedControl(rows // 3, variance, normal, inverse @ off)

    def solved(self, others: BoolArray, factor2: float) -> tuple[FloatArray, FloatArray] | None:
        """Return adjusted minus surveyed coordinates (k,) and the covariance (k, k) of the adjusted ones, if the
        coordinates of the ``others`` (k,) alone count, with ``factor2`` times their variances; None where these do not
        determine them."""
        N = self.normal + np.diag(np.where(others, 1.0 / (factor2 * self.variance_m2), 0.0))
        scale = np.sqrt(np.diag(N))
        if not (scale > 0.0).all() or np.linalg.eigvalsh(N / np.outer(scale, scale))[0] < _LEAST:
            return None
        Q = np.linalg.inv(N)
        return Q @ self.right, Q

    def scatter2(self, others: BoolArray) -> tuple[float, float] | None:
        """Return the factor of the variances of ``others`` (k,) by their residuals, and the redundancy that tells it;
        None where there is too little."""
        least, factor2, redundancy = LEAST_CONTROL_M**2 / float(self.variance_m2.min()), 1.0, 0.0
        for _ in range(_STEPS):
            solved = self.solved(others, factor2)
            if solved is None:
                return None
            off, Q = solved
            variance = factor2 * self.variance_m2[others]
            redundancy = float(np.sum(1.0 - np.diag(Q)[others] / variance))
            if redundancy < FEWEST_LEFT:
                return None
            ratio = (float(np.sum(off[others] ** 2 / variance)) + PRIOR / factor2) / (redundancy + PRIOR)
            factor2, before = max(least, factor2 * ratio), factor2
            if abs(factor2 / before - 1.0) < _STEADY:
                break
        return factor2, redundancy

    def log_chance(self, group: Sequence[int]) -> float:
        """Return the logarithm of the probability by chance that points are this far from what the others predict, 0
        where too few are left to tell."""
        own = np.isin(self.point, group)
        scatter = self.scatter2(~own)
        solved = None if scatter is None else self.solved(~own, scatter[0])
        if scatter is None or solved is None:
            return 0.0
        (factor2, redundancy), (off, Q) = scatter, solved
        C = np.diag(factor2 * self.variance_m2[own]) + Q[np.ix_(own, own)]
        d = int(np.count_nonzero(own))
        T = float(off[own] @ np.linalg.solve(C, off[own]))
        return float(f.logsf(T / d, d, redundancy))


def scatter_of_assumed(result: Adjustment) -> float:
    """Return the factor by which control points of assumed sigmas scatter more than these, or less; 1 where too few
    tell."""
    control = AssumedControl.of(result)
    scatter = control.scatter2(np.ones(len(control.point), dtype=bool)) if len(control.point) else None
    return 1.0 if scatter is None else float(np.sqrt(scatter[0]))


def outlying_points(result: Adjustment, tests: Sequence[Hypothesis]) -> Iterator[Hypothesis]:
    """Yield, of the hypotheses ``tests`` on control points, those that a point of assumed sigmas is wrong as a whole,
    alone or with others, their statistics those of χ² that are as likely as F is among all groups of as many."""
    points = result.block.control_points
    names = {a.name: a for a in tests if len(a.axes) == np.count_nonzero(points.used[points.name.index(a.name)])}
    if not names:
        return
    control = AssumedControl.of(result)
    alone = {g: control.log_chance([g]) for g in (points.name.index(name) for name in names)}
    compared = sorted(alone, key=lambda g: alone[g])[:MOST_COMPARED]
    best = dict[int, tuple[float, tuple[int, ...]]]()
    for g, chance in alone.items():
        best[g] = chance + float(np.log(len(names) * MOST_TOGETHER)), (g,)
    for size in range(2, MOST_TOGETHER + 1):
        groups = float(np.log(comb(len(names), size) * MOST_TOGETHER))
        for group in combinations(compared, size):
            chance = control.log_chance(group) + groups
            best |= {g: min(best[g], (chance, group)) for g in group}
    for g, (chance, group) in best.items():
        a = names[points.name[g]]
        statistic = float(chi2.isf(np.clip(np.exp(chance) / len(best), _TINY, 1.0), len(a.axes)))
        yield replace(a, statistic=statistic, together=tuple(points.name[h] for h in group if h != g))
