"""Which of the targets detected in photographs are which ground points.

Where the ellipse of a point holds one target alone, that is taken for it; what the adjustment then rejects is not.
Where ellipses are so wide that each holds several, a photograph's targets are laid over its predicted places as a
whole: compass and position are off for all of them together. What is taken in some photographs gives the compass of
all, so the others are tried again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray, IntArray
from photogram.errors import AdjustmentError
from photogram.marking.mark_comparison import MarkComparison, compared_marks
from photogram.marking.predictions import PredictedPlaces, predicted_places
from photogram.measures.mark_covariances import isotropic_px2
from photogram.survey import Block

WITHIN = float(chi2.isf(1e-3, 2))
"""Square of the distance, in standard deviations, up to which a target may be the point that a place predicts."""
SURE_PX = 60.0
"""Radius of an ellipse up to which the only target in it is taken for its point."""
LAID = 3
"""Targets that must fit the places of a photograph, moved together, before they are taken for the points."""
LAID_PX, LAID_SHARE = 8.0, 0.06
"""How far a target may then be from its place: px, and the share of the distance from the place that was laid on."""
ROUNDS = 8

Pair = tuple[int, int]
"""A point and a photograph, by their numbers."""


@dataclass(frozen=True, eq=False)
class DetectedCentres:
    """Centres of the targets detected in photographs (K)."""

    photograph: IntArray
    """Number (K,) of the photograph."""
    pixel: FloatArray
    """Centre (K, 2), px."""
    sigma_px: FloatArray
    """Standard deviation (K,) of the centre along each axis."""


@dataclass(frozen=True, eq=False)
class Assignment:
    """Targets taken for ground points."""

    target: Mapping[Pair, int]
    """Number of the target by point and photograph."""
    comparison: MarkComparison | None
    """They and the marks that there were, compared with each other, None where nothing could be compared."""


def assigned_targets(block: Block, detected: DetectedCentres, hidden: frozenset[Pair] = frozenset()) -> Assignment:
    """Return which targets are which points of a block, a ``tagged_block`` or an adjusted one with its marks.

    Points keep the marks that they have, and nothing is taken for a point in a photograph that does not show it,
    ``hidden``. Raises AdjustmentError where the block is not determined.
    """
    settings = AdjustmentSettings(estimate_sigmas=False)
    points = block.control_points
    marked = set(zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True)) | hidden
    taken: dict[Pair, int] = {}
    refused: set[tuple[Pair, int]] = set()
    comparison: MarkComparison | None = None
    places = predicted_places(block, settings)
    for number in range(ROUNDS):
        done, used = marked | set(taken), set(taken.values())
        new = {**_alone(places, detected, done), **_laid(places, detected, done)}
        new = {pair: k for pair, k in new.items() if k not in used and (pair, k) not in refused}
        if not new and number > 0:
            break
        whole = with_targets(block, detected, {**taken, **new})
        try:
            comparison = compared_marks(whole, settings)
        except AdjustmentError:  # of what was taken last, for the block itself is determined
            refused |= set(new.items())
            continue
        taken, places = {**taken, **new}, comparison.places
        for pair in _rejected(whole, comparison) & set(taken):
            refused.add((pair, taken.pop(pair)))
    return Assignment(taken, comparison)


def with_targets(block: Block, detected: DetectedCentres, target: Mapping[Pair, int]) -> Block:
    """Return a block with the marks that it has, and those of targets taken for its points."""
    points, pairs = block.control_points, sorted(target)
    k = np.array([target[pair] for pair in pairs], dtype=np.int64)
    made = replace(
        points,
        mark_point=np.concatenate([points.mark_point, np.array([g for g, _ in pairs], dtype=np.int64)]),
        mark_photograph=np.concatenate([points.mark_photograph, np.array([i for _, i in pairs], dtype=np.int64)]),
        mark_pixel=np.concatenate([points.mark_pixel, detected.pixel[k].reshape(-1, 2)]),
        mark_covariance_px2=np.concatenate([points.mark_covariance_px2, isotropic_px2(detected.sigma_px[k])]),
    )
    return replace(block, control_points=made)


def _rejected(block: Block, comparison: MarkComparison) -> set[Pair]:
    """Return the points and photographs whose mark contradicts the others."""
    points = block.control_points
    return {
        (int(points.mark_point[one.mark]), int(points.mark_photograph[one.mark]))
        for one in comparison.marks
        if one.rejected
    }


def _alone(places: PredictedPlaces, detected: DetectedCentres, taken: set[Pair]) -> dict[Pair, int]:
    """Return the targets that lie alone in the ellipse of a place, and in no other's of their photograph."""
    fits: dict[Pair, list[int]] = {}
    claimed: dict[int, int] = {}
    radius = places.radius_px
    for p, (g, i) in enumerate(zip(places.point.tolist(), places.photograph.tolist(), strict=True)):
        for k in _within(places, p, detected):
            fits.setdefault((g, i), []).append(k)
            claimed[k] = claimed.get(k, 0) + 1
    narrow = {(int(places.point[p]), int(places.photograph[p])) for p in np.flatnonzero(radius <= SURE_PX).tolist()}
    return {
        pair: one[0]
        for pair, one in fits.items()
        if len(one) == 1 and claimed[one[0]] == 1 and pair in narrow and pair not in taken
    }


def _within(places: PredictedPlaces, place: int, detected: DetectedCentres) -> list[int]:
    """Return the targets that may be the point of a place."""
    own = np.flatnonzero(detected.photograph == places.photograph[place])
    if not len(own):
        return []
    off = detected.pixel[own] - places.pixel[place]
    spread = places.covariance_px2[place] + detected.sigma_px[own, None, None] ** 2 * np.eye(2)
    T = np.einsum("ki,ki->k", off, np.linalg.solve(spread, off[..., None])[..., 0])
    return [int(k) for k in own[T < WITHIN]]


def _laid(places: PredictedPlaces, detected: DetectedCentres, taken: set[Pair]) -> dict[Pair, int]:
    """Return the targets of each photograph that fit its places when these are moved together."""
    pairs: dict[Pair, int] = {}
    for i in np.unique(detected.photograph).tolist():
        own = [p for p in np.flatnonzero(places.photograph == i).tolist() if (int(places.point[p]), i) not in taken]
        best: dict[int, int] = {}
        least = np.inf
        for p in own:
            for k in _within(places, p, detected):
                fitted, off = _fitted(places, own, p, detected, k)
                if len(fitted) >= LAID and (len(fitted), -off) > (len(best), -least):
                    best, least = fitted, off
        pairs.update({(int(places.point[p]), i): k for p, k in best.items()})
    return pairs


def _fitted(
    places: PredictedPlaces, own: list[int], on: int, detected: DetectedCentres, target: int
) -> tuple[dict[int, int], float]:
    """Return the nearest target of each place of a photograph, all places moved by what lays one on a target, and how
    far off these are in all, px."""
    there = np.flatnonzero(detected.photograph == places.photograph[on])
    moved = places.pixel[own] + detected.pixel[target] - places.pixel[on]
    off = np.linalg.norm(detected.pixel[there][None] - moved[:, None], axis=2)
    reach = LAID_PX + LAID_SHARE * np.linalg.norm(places.pixel[own] - places.pixel[on], axis=1)
    fitted: dict[int, int] = {}
    total = 0.0
    for n in np.argsort(off.min(axis=1), kind="stable").tolist():
        k = int(there[np.argmin(off[n])])
        if off[n].min() <= reach[n] and k not in fitted.values():
            fitted[own[n]] = k
            total += float(off[n].min())
    return fitted, total
