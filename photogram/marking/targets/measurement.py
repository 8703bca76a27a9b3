"""Measure targets in a patch of a photograph: near a rough place, or wherever there are some."""

from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray, IntArray
from photogram.marking.targets.acceptance import SADDLES, Judgement, axes_px, contrast_dn, ground, judged
from photogram.marking.targets.coded import find_coded
from photogram.marking.targets.cross_initial_values import cross_initial_values
from photogram.marking.targets.fitting import Fit, fit
from photogram.marking.targets.initial_values import (
    InitialValues,
    corner_initial_values,
    region_initial_values,
    regions,
    saddle_initial_values,
    saddles,
)
from photogram.marking.targets.kinds import Kind, MeasuredCentre
from photogram.marking.targets.picture import Pattern

GreyPatch = ByteArray | Float32Array

REACH_PX = 10.0
"""How far from a rough place the centre of a target may lie."""
FOCAL_PX = 3000.0
"""Focal length where none is given, shorter than that of most cameras: what it stands for is an upper bound."""
LOOK_PX = 75
"""How much of a patch around a rough place, beyond the reach, is looked at."""
FITS = 4
"""How many starts of each pattern are fitted around one place, at most."""
CLOSE = (Pattern.FIELDS, Pattern.CORNER, Pattern.OPEN_CORNER, Pattern.CROSS, Pattern.OPEN_CROSS)
CLOSE_SHARE = 0.4
"""Patterns whose centre lies near the rough place: nearer than so many of their lengths."""
LEAST_START = 0.5
"""Share of its squares that a start must explain to be fitted."""
UNEXPLAINED = 6.0
"""Of several fits the one is taken that explains most squares, less so many times the squares it leaves."""
PERSPECTIVE = {
    Pattern.CIRCLE: 1.0,
    Pattern.RING: 0.5,
    Pattern.DISC_OF_QUADRANTS: 0.2,
    Pattern.SQUARE_OF_QUADRANTS: 0.3,
    Pattern.CROSS: 0.3,
    Pattern.CROSSED_SQUARE: 0.3,
}
"""What share of the eccentricity of its outer edge the fitted centre has: where lines cross in it, they hold it."""
_KINDS = {
    Pattern.FIELDS: Kind.CHEQUERED,
    Pattern.DISC_OF_QUADRANTS: Kind.CHECKER,
    Pattern.SQUARE_OF_QUADRANTS: Kind.CHECKER,
    Pattern.CIRCLE: Kind.CIRCLE,
    Pattern.RING: Kind.RING,
    Pattern.CROSS: Kind.CROSS,
    Pattern.OPEN_CROSS: Kind.CROSS,
    Pattern.CORNER: Kind.CORNER,
    Pattern.OPEN_CORNER: Kind.CORNER,
    Pattern.CROSSED_SQUARE: Kind.CROSS,
}


def snap(
    grey: GreyPatch, start_px: FloatArray, reach_px: float = REACH_PX, focal_px: float = FOCAL_PX
) -> MeasuredCentre | None:
    """Return the target in a patch (H, W) of grey values whose centre lies at most ``reach_px`` from a rough place
    (2,), column and row; None where there is none. The patch should show twice the size of the target around it.
    ``focal_px`` is the focal length, px: the centre of a large circle that leans is not quite that of its ellipse."""
    near = np.asarray(start_px, np.float64)
    if not (np.isfinite(near).all() and grey.ndim == 2 and min(grey.shape) >= 9):
        return None
    look = LOOK_PX + reach_px
    low = np.maximum(np.floor(near - look).astype(int), 0)
    high = np.ceil(near + look).astype(int) + 1
    part = grey[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
    if min(part.shape) < 9:
        return None
    place = near - low
    own = part.astype(np.float64)
    fits = _accepted(own, _initial_values_near(own, place, reach_px), FITS, is_expected=True)
    nearest = min((_distance(f, place) for f in fits if f.pattern in SADDLES), default=np.inf)
    # of a board's corners the nearest is meant, and none that lies beyond the fields around the rough place; two
    # sides of a square, and rows of its fields, pass for an L or a cross whose corner lies far from it
    fits = [f for f in fits if f.pattern not in SADDLES or _distance(f, place) <= nearest + 1.0]
    fits = [f for f in fits if f.pattern not in CLOSE or _distance(f, place) <= CLOSE_SHARE * axes_px(f)[0] + 1.0]
    measured = [
        (_gain(f) * _nearness(_distance(f, place) / reach_px), _measured(f, low, focal_px))
        for f in fits
        if _distance(f, place) <= reach_px
    ]
    measured += [
        (_coded_gain(c), replace(c, centre_px=c.centre_px + low))
        for c in find_coded(part)
        if np.hypot(*(c.centre_px - place)) <= reach_px
    ]
    return max(measured, key=lambda pair: pair[0])[1] if measured else None


@dataclass(frozen=True, eq=False)
class Candidate:
    """What resembles a target, and is none that is sure."""

    centre_px: FloatArray
    """Column and row (2,)."""
    judgement: Judgement
    """Why it is not."""


def propose(grey: GreyPatch, focal_px: float = FOCAL_PX) -> list[MeasuredCentre]:
    """Return all targets in a patch (H, W) of grey values, the most certain first; ``focal_px`` as of snap."""
    return targets_and_candidates(grey, focal_px)[0]


def targets_and_candidates(grey: GreyPatch, focal_px: float = FOCAL_PX) -> tuple[list[MeasuredCentre], list[Candidate]]:
    """Return all targets in a patch as ``propose``, and what resembles one elsewhere in it, each place once."""
    if grey.ndim != 2 or min(grey.shape) < 9:
        return [], []
    own = grey.astype(np.float64)
    starts = _initial_values(own, 10 + own.size // 2500)
    zero = np.zeros(2, int)
    ranked = [(_coded_gain(c), c) for c in find_coded(grey)]
    fits = _judged(own, starts, 4 + own.size // 10_000, is_expected=False)
    fits = [(f, judgement) for f, judgement in fits if f.pattern != Pattern.OPEN_CROSS]
    ranked += [(_gain(f), _measured(f, zero, focal_px)) for f, judgement in fits if judgement.is_target]
    ranked.sort(key=lambda pair: -pair[0])
    kept: list[MeasuredCentre] = []
    for _, target in ranked:
        apart = [np.hypot(*(target.centre_px - k.centre_px)) > 0.5 * max(target.size_px, k.size_px) for k in kept]
        if all(apart):
            kept.append(target)
    candidates: list[Candidate] = []
    for f, judgement in sorted(fits, key=lambda pair: pair[1].limit - pair[1].score):
        taken = [*(k.centre_px for k in kept), *(c.centre_px for c in candidates)]
        if not judgement.is_target and all(_distance(f, place) > 0.5 * axes_px(f)[0] for place in taken):
            candidates.append(Candidate(f.theta[:2].copy(), judgement))
    return kept, candidates


def _initial_values(
    grey: FloatArray, saddle_count: int, near: FloatArray | None = None, reach_px: float = np.inf
) -> list[InitialValues]:
    starts: list[InitialValues] = []
    for centre, normals in saddles(grey, saddle_count, near, reach_px):
        starts += saddle_initial_values(grey, centre, normals, (0.7, 1.8))
    for region in regions(grey, near, reach_px):
        starts += region_initial_values(grey, region)
    return starts


def _initial_values_near(grey: FloatArray, near: FloatArray, reach_px: float) -> list[InitialValues]:
    starts = _initial_values(grey, 10, near, reach_px)
    starts += corner_initial_values(grey, near, reach_px)
    starts += cross_initial_values(grey, near, reach_px)
    apart = [float(np.hypot(*(s.theta[:2] - near))) / reach_px for s in starts]
    # where a click is, its target is rather than a larger one next to it, and of a board's corners the nearest is meant
    return [
        replace(s, promise=s.promise * float(np.exp(-(10.0 if s.pattern == Pattern.FIELDS else 3.0) * d**2)))
        for s, d in zip(starts, apart, strict=True)
        if d <= 1.0 + 3.0 / reach_px
    ]


def _accepted(grey: FloatArray, starts: list[InitialValues], most: int, is_expected: bool) -> list[Fit]:
    """Return the fits that are targets, as judged."""
    return [fitted for fitted, judgement in _judged(grey, starts, most, is_expected) if judgement.is_target]


def _judged(grey: FloatArray, starts: list[InitialValues], most: int, is_expected: bool) -> list[tuple[Fit, Judgement]]:
    """Return the fits that explain their pixels, of starts that differ, the most promising first: at most so many of
    each pattern, or one that promises much would leave no room for another that is true."""
    found: list[tuple[Fit, Judgement]] = []
    taken: list[InitialValues] = []
    around = ground(grey)
    for start in sorted(starts, key=lambda s: -s.promise):
        same = [other for other in taken if other.pattern == start.pattern]
        if len(same) >= most or start.explained < LEAST_START or any(_alike(start, other) for other in same):
            continue
        taken.append(start)
        fitted = fit(grey, start.pattern, start.theta, start.reach)
        if fitted is None or np.hypot(*(fitted.theta[:2] - start.theta[:2])) > _leash(start):
            continue
        judgement = judged(fitted, around, is_expected)
        if judgement is not None:
            found.append((fitted, judgement))
    return found


def _leash(start: InitialValues) -> float:
    """Return how far from its start a fit may end, px."""
    return 2.0 + 0.25 / float(np.sqrt(abs(np.linalg.det(start.theta[2:6].reshape(2, 2)))))


def _alike(one: InitialValues, other: InitialValues) -> bool:
    if one.pattern != other.pattern or np.hypot(*(one.theta[:2] - other.theta[:2])) > 0.7:
        return False
    ratio = one.theta[2:6].reshape(2, 2) @ np.linalg.inv(other.theta[2:6].reshape(2, 2))
    value = np.linalg.svd(ratio, compute_uv=False)
    is_close = bool(value[0] < 1.2 and value[1] > 0.83)
    return is_close and (one.pattern not in (Pattern.CROSS, Pattern.CORNER) or float(np.trace(ratio)) > 1.8)


def _gain(fitted: Fit) -> float:
    return fitted.variation * (1.0 - UNEXPLAINED * (1.0 - fitted.explained))


def _coded_gain(centre: MeasuredCentre) -> float:
    """Return the gain of a coded target: no pattern within it, and no frame around it, is preferred to it."""
    return 1e12 + centre.size_px


def _nearness(distance: float) -> float:
    """Return the weight of a target at a distance from the rough place, in units of the reach."""
    return float(np.exp(-10.0 * distance**2))


def _distance(fitted: Fit, place: FloatArray) -> float:
    return float(np.hypot(*(fitted.theta[:2] - place)))


def _measured(fitted: Fit, shift: IntArray, focal_px: float) -> MeasuredCentre:
    covariance = fitted.covariance_px2
    if fitted.pattern in PERSPECTIVE:
        eccentricity = eccentricity_px2(fitted.theta[2:6].reshape(2, 2), focal_px)
        covariance = covariance + PERSPECTIVE[fitted.pattern] ** 2 * eccentricity
    return MeasuredCentre(
        _KINDS[fitted.pattern],
        fitted.theta[:2] + shift,
        covariance,
        fitted.explained,
        axes_px(fitted)[0],
        contrast_dn(fitted),
    )


def eccentricity_px2(A: FloatArray, focal_px: float) -> FloatArray:
    """Return the square (2, 2) of the vector from the image of a circle's centre to the centre of its ellipse.

    ``A`` maps the ellipse to a unit circle. With semi-axes a and b it is b √(a² − b²) / f long and lies along the minor
    axis (Dold 1996, for a circle near the axis of the camera); the ellipse does not show its sign.
    """
    direction, half, _ = np.linalg.svd(np.linalg.inv(A))
    length = half[1] * np.sqrt(max(half[0] ** 2 - half[1] ** 2, 0.0)) / focal_px
    return np.asarray(length**2 * np.outer(direction[:, 1], direction[:, 1]))
