"""Which measurement of the ground is wrong: alternatives tested against each other, one after the other left out.

Every control point, in one axis, in plan or as a whole, and every mark is tested: left out, everything else predicts
it, and the weighted square sum of the adjustment falls by T = lᵀ C⁻¹ l, with l predicted minus measured and C its
covariance; without a blunder T is χ² with as many degrees of freedom as there are coordinates (Förstner & Wrobel 2016,
sec. 4.6.4). Of all alternatives the one that is least likely by chance is blamed. It is left out, the rest is adjusted
again and tested again, until nothing contradicts it: what a blunder spreads to its neighbours is not blamed on them,
and who is found innocent in the end is taken back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from photogram.accuracy import suspects
from photogram.errors import PhotogramError
from photogram.survey import Adjustment, Block, BoolArray, ControlPoints, FloatArray

MOST_BLUNDERS = 6
INNOCENT = 0.001  # probability by chance above which what was left out is taken back
PARTS = ((0,), (1,), (2,), (0, 1), (0, 1, 2))  # axes of a point that may be wrong together
Adjuster = Callable[[Block], Adjustment]


@dataclass(frozen=True)
class Accusation:
    """What the rest contradicts: some ``axes`` of the control point ``point``, or its mark in ``photograph``.

    ``off`` predicted minus measured, along ``axes`` in m or along u and v in px, with its ``sigma``; ``statistic`` T.
    """

    point: str
    photograph: str | None
    axes: tuple[int, ...]
    off: tuple[float, ...]
    sigma: tuple[float, ...]
    statistic: float

    @property
    def log_chance(self) -> float:
        """Return the logarithm of the probability of such a contradiction by chance."""
        return float(chi2.logsf(self.statistic, len(self.off)))


def _accusation(
    point: str, photograph: str | None, axes: Sequence[int], left_out: FloatArray, covariance: FloatArray
) -> Accusation:
    """Blame some of the coordinates that were left out together: the others are given back.

    The normal matrix C⁻¹ of what was left out holds those of every part, so that no other factorisation is needed.
    """
    information = np.linalg.inv(covariance)
    own = np.ix_(axes, axes)
    spread = np.linalg.inv(information[own])
    right = (information @ left_out)[list(axes)]
    off = spread @ right
    return Accusation(
        point,
        photograph,
        tuple(axes),
        tuple(off.tolist()),
        tuple(np.sqrt(np.diag(spread)).tolist()),
        float(right @ off),
    )


def accusations(result: Adjustment) -> Iterator[Accusation]:
    """Yield every alternative: the parts of all control points, and all their marks, that something else determines."""
    r, points, photographs = result.reliability, result.block.control_points, result.block.photographs
    for g, name in enumerate(points.name):
        known = np.flatnonzero(np.isfinite(r.ground_left_out_m[g]))
        place = {axis: n for n, axis in enumerate(known.tolist())}
        left_out, covariance = r.ground_left_out_m[g, known], r.ground_left_out_covariance_m2[g][np.ix_(known, known)]
        for axes in PARTS:
            if set(axes) <= set(place):
                found = _accusation(name, None, [place[axis] for axis in axes], left_out, covariance)
                yield replace(found, axes=axes)
    for m in np.flatnonzero(np.isfinite(r.mark_left_out_px).all(axis=1)).tolist():
        name, photograph = points.name[points.mark_point[m]], photographs[points.mark_photograph[m]].name
        yield _accusation(name, photograph, (0, 1), r.mark_left_out_px[m], r.mark_left_out_covariance_px2[m])


def without(block: Block, accused: Sequence[Accusation]) -> Block:
    """Return the block with what is accused left out: coordinates become checks, marks go."""
    points = block.control_points
    controlled, kept = points.controlled.copy(), np.ones(len(points.mark_point), dtype=bool)
    names = [photograph.name for photograph in block.photographs]
    for a in accused:
        g = points.name.index(a.point)
        if a.photograph is None:
            controlled[g, list(a.axes)] = False
        else:
            kept &= (points.mark_point != g) | (points.mark_photograph != names.index(a.photograph))
    return replace(block, control_points=_with(points, controlled, kept))


def _with(points: ControlPoints, controlled: BoolArray, kept: BoolArray) -> ControlPoints:
    return replace(
        points,
        role=tuple("control" if row.any() else "check" for row in controlled),
        controlled=controlled,
        mark_photograph=points.mark_photograph[kept],
        mark_point=points.mark_point[kept],
        mark_pixel=points.mark_pixel[kept],
        mark_sigma_px=points.mark_sigma_px[kept],
    )


@dataclass(frozen=True, eq=False)
class Search:
    """What was blamed, and the survey adjusted without it."""

    accused: tuple[Accusation, ...]
    result: Adjustment


def _contradicted(result: Adjustment) -> bool:
    return any(suspect.kind != "GNSS position" for suspect in suspects(result))


def _chance_of_coordinates(a: Accusation, result: Adjustment) -> float:
    """Return the logarithm of the probability that coordinates which took no part lie so far from their prediction."""
    points, frame = result.block.control_points, result.block.frame
    g, axes = points.name.index(a.point), frame.rotation_world_from_map(np.zeros(3))
    own = axes[:, list(a.axes)]
    covariance = own.T @ (result.ground_covariance_m2[g] + axes @ np.diag(points.sigma_m[g] ** 2) @ axes.T) @ own
    off = own.T @ (result.ground_world_m[g] - points.position_world_m[g])
    if not np.isfinite(off).all():
        return -np.inf
    return float(chi2.logsf(off @ np.linalg.solve(covariance, off), len(off)))


def _innocent(accused: Sequence[Accusation], block: Block, result: Adjustment, adjust: Adjuster) -> list[Accusation]:
    """Return those accused that the rest does not contradict; a mark is tested by taking it back alone."""
    innocent = []
    for a in accused:
        chance = -np.inf
        if a.photograph is None:
            chance = _chance_of_coordinates(a, result)
        else:
            try:
                taken_back = adjust(without(block, [b for b in accused if b is not a]))
            except PhotogramError:
                continue  # what cannot even be adjusted is not innocent
            same = (b for b in accusations(taken_back) if (b.point, b.photograph) == (a.point, a.photograph))
            chance = max((b.log_chance for b in same), default=-np.inf)
        if chance > np.log(INNOCENT):
            innocent.append(a)
    return innocent


def search(block: Block, result: Adjustment, adjust: Adjuster, accused: Sequence[Accusation] = ()) -> Search:
    """Blame and leave out, until nothing that was measured on the ground contradicts the rest.

    ``result`` is that of ``block`` without what is ``accused`` beforehand; ``adjust`` adjusts a block.
    """
    blamed, current = list(accused), result
    while len(blamed) < MOST_BLUNDERS and _contradicted(current):
        blamed.append(min(accusations(current), key=lambda a: a.log_chance))
        try:
            current = adjust(without(block, blamed))
        except PhotogramError:
            blamed.pop()  # nothing is left that could say it is wrong
            break
    if accused or len(blamed) > 1:
        innocent = _innocent(blamed, block, current, adjust)
        if innocent:
            blamed = [a for a in blamed if a not in innocent]
            current = adjust(without(block, blamed))
    return Search(tuple(blamed), current)
