"""Whether a fitted pattern is a target, or something natural that resembles one.

A sum over all pixels can be good where one part is wrong: a stone is bright all around but for one side, a shadow's
edge is half of a cross. So every sector of the pattern is asked by itself, and each level against the noise.

Among many stones one is round. So a target must differ from the ground by more than the ground's own blobs do, whose
strength is √det H σ² with the Hessian H of the grey values under a Gaussian blur σ (Lindeberg 1998): an edge, of a kerb
or a shadow, has none.

No limit of one of these alone finds a target that is small and blurred on rough ground and refuses a round stone: the
one is weak in one respect, the other in another. So besides wide limits there is one for the sum of their logarithms, a
linear discriminant (Fisher 1936) with the weights of a logistic regression (Cox 1958) between the targets and the
ground of rendered photographs.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray, nmad
from photogram.marking.targets.fitting import Fit, outside_share, pixels
from photogram.marking.targets.initial_values import second_derivatives, texture
from photogram.marking.targets.picture import (
    BLUR,
    CX,
    CY,
    FIRST,
    FREE,
    MOST_PX,
    OUTSIDE,
    SECOND,
    SHAPE,
    Pattern,
)

SECTORS = 8
LEAST_PIXELS = 4
"""Pixels that make a sector worth asking."""
LEAST_AROUND = 30
"""Pixels around a target from which the ground is known."""
LEAST_SEEN, FROM_EDGE_PX = 0.5, 3.0
"""Share of a pattern's pixels that the patch must show, and how far within it the centre must lie."""
LEAST_OUTER_EDGE = 0.08
"""By how much a ring must stand out from the ground, over its contrast: else it is the circle that it encloses."""
AROUND_PX, FURTHER_PX = 10, 20
"""How far around a target the texture is taken, and how far the ground's blobs."""
BLOB_PX, MOST_BLOBS = 2.0, 0.9
"""Blur under which blobs are taken, and the share of the ground where they are weaker than the usual strongest."""
LEAST_EXPLAINED = 0.91
"""Share of the variance that the picture of any pattern must explain; like the next two a wide limit."""
LEAST_CONTRAST_DN = 25.0
LEAST_OVER_BLOBS = 12.0
UNEXPECTED = 1.25
"""By how much the score of a target that nobody expects must be larger: it is looked for in many more places."""
SMALL, SMALL_PX = 4.0, 4.5
"""By how much the score of a circle must be larger that is no wider than this: the inside of a ring, or a pebble."""
SADDLES = (Pattern.FIELDS, Pattern.DISC_OF_QUADRANTS, Pattern.SQUARE_OF_QUADRANTS)
OPEN = (Pattern.FIELDS, Pattern.OPEN_CROSS, Pattern.OPEN_CORNER)


@dataclass(frozen=True, eq=False)
class Ground:
    """What the ground in a patch (H, W) is like."""

    texture: FloatArray
    """Grey values without what is finer or coarser than what could pass for a target."""
    blobs: FloatArray
    """Strength of blobs, DN."""


def ground(grey: FloatArray) -> Ground:
    """Return what the ground in a patch (H, W) of grey values is like."""
    smooth = cv2.GaussianBlur(grey, (0, 0), BLOB_PX)
    lxx, lyy, lxy = second_derivatives(smooth)
    return Ground(texture(grey), BLOB_PX**2 * np.sqrt(np.maximum(lxx * lyy - lxy**2, 0.0)))


@dataclass(frozen=True)
class Evidence:
    """What speaks for a target."""

    explained: float
    """Share of the variance of its pixels, weighted or not, that the picture explains."""
    contrast_dn: float
    """Difference of its levels, of a ring from what it encloses."""
    contrast_over_noise: float
    """The same over the standard deviation of the residuals in the target."""
    contrast_over_texture: float
    """The same over the scatter of the texture further around."""
    contrast_over_blobs: float
    """The same over the strength that one in ten places of the ground exceeds as a blob."""
    contrast_over_strongest_blob: float
    """The same over the strength of the strongest blob of the ground."""
    outer_edge: float
    """By how much a ring stands out from what lies around it, over its contrast; negative where the levels only rise or
    only fall inwards, as in a blurred circle; infinite for all but rings."""
    weakest_sector: float
    """Share of the squares that the picture explains in the sector where it does so least."""
    width_px: float
    """Shorter axis."""
    length_px: float
    """Longer axis."""
    sharpness: float
    """Narrowest part, a bar or a quadrant, over the blur."""
    shape: float
    """The pattern's own proportion: width of a bar over its length, inner over outer circle."""
    sigma_px: float
    """Largest standard deviation of the centre in any direction."""

    @property
    def score(self) -> float:
        """The discriminant: the larger, the more a target."""
        terms = (
            (-0.7, max(1.0 - self.explained, 1e-4)),
            (1.75, self.contrast_over_noise),
            (1.0, self.contrast_over_texture),
            (1.75, self.contrast_over_blobs),
            (1.25, self.contrast_over_strongest_blob),
            (1.0, self.length_px),
            (-1.4, self.sigma_px + 0.01),
        )
        return sum(weight * math.log(max(value, 1e-9)) for weight, value in terms)


def axes_px(fit: Fit) -> tuple[float, float]:
    """Return the longer and the shorter axis of a pattern, of an open one as far as it was fitted."""
    extent = fit.reach if fit.pattern in OPEN else 1.0
    half = np.linalg.svd(np.linalg.inv(fit.theta[2:6].reshape(2, 2)), compute_uv=False) * extent
    whole = 1.0 if fit.pattern in (Pattern.CORNER, Pattern.OPEN_CORNER) else 2.0
    return float(whole * half[0]), float(whole * half[1])


def _around(fit: Fit, field: FloatArray, near_px: int, far_px: int) -> FloatArray:
    """Return the values (N,) of a field (H, W) in a belt around a target."""
    height, width = field.shape
    own = np.zeros(field.shape, np.uint8)
    own[fit.place[:, 1], fit.place[:, 0]] = 1
    low = np.maximum(fit.place.min(axis=0) - far_px, 0)
    high = np.minimum(fit.place.max(axis=0) + far_px + 1, [width, height])
    part = own[low[1] : high[1], low[0] : high[0]]
    near, far = (cv2.dilate(part, np.ones((2 * n + 1, 2 * n + 1), np.uint8)) for n in (near_px, far_px))
    return np.asarray(field[low[1] : high[1], low[0] : high[0]][(far > 0) & (near == 0)], np.float64)


def _beyond_px(fit: Fit) -> int:
    """Return how much further than the pixels that were fitted the target itself reaches: a board has more fields."""
    return round(axes_px(fit)[0]) if fit.pattern == Pattern.FIELDS else 0


def _texture_scatter(fit: Fit, around: Ground) -> float:
    """Return the scatter of the texture around a target, 0 where too little of it is seen."""
    beyond = _beyond_px(fit)
    value = _around(fit, around.texture, 2 + beyond, AROUND_PX + beyond)
    return nmad(value) if len(value) >= LEAST_AROUND else 0.0


def _blob_strengths(fit: Fit, around: Ground) -> tuple[float, float]:
    """Return the usual and the largest strength of the ground's blobs around a target, DN; 0 where too little of the
    ground is seen."""
    beyond = _beyond_px(fit)
    value = _around(fit, around.blobs, 3 + beyond, FURTHER_PX + beyond)
    return (float(np.quantile(value, MOST_BLOBS)), float(value.max())) if len(value) >= LEAST_AROUND else (0.0, 0.0)


def contrast_dn(fit: Fit) -> float:
    """Return the difference of the levels of a pattern, of a ring from what it encloses."""
    level = fit.theta[[i for i in (OUTSIDE, FIRST, SECOND) if i in FREE[fit.pattern]]]
    # of bars narrower than their blur only the product of width and contrast is known
    return min(float(abs(level[-1] - level[-2])), float(np.ptp(fit.grey)))


def evidence(fit: Fit, around: Ground) -> Evidence:
    """Return what speaks for a fitted pattern; ``around`` is the ground of the patch."""
    theta, pattern = fit.theta, fit.pattern
    place = fit.place.astype(np.float64)
    outside = outside_share(pattern, theta, place)
    contrast = contrast_dn(fit)
    own = outside <= 0.9
    noise = float(np.sqrt(np.mean(fit.residual[own] ** 2))) if own.any() else np.inf
    usual, strongest = _blob_strengths(fit, around)
    length, width = axes_px(fit)
    part = 0.5 * width if pattern in SADDLES else width
    if pattern in (Pattern.CROSS, Pattern.CORNER, Pattern.CROSSED_SQUARE):
        part = width * float(theta[SHAPE])
    elif pattern in (Pattern.OPEN_CROSS, Pattern.OPEN_CORNER):
        part = width / fit.reach
    elif pattern == Pattern.RING:
        part = 0.5 * width * min(1.0 - float(theta[SHAPE]), 2.0 * float(theta[SHAPE]))
    return Evidence(
        fit.explained_at_best,
        contrast,
        contrast / max(noise, 0.5),
        contrast / max(_texture_scatter(fit, around), 0.5),
        contrast / max(usual, 1.0),
        contrast / max(strongest, 1.0),
        _outer_edge(fit),
        _weakest_sector(fit, outside),
        width,
        length,
        part / float(theta[BLUR]),
        float(theta[SHAPE]),
        float(np.sqrt(np.linalg.eigvalsh(fit.covariance_px2)[1])),
    )


def _outer_edge(fit: Fit) -> float:
    """Return by how much a ring stands out from what lies around it, as of Evidence."""
    if fit.pattern != Pattern.RING:
        return np.inf
    outside, ring, inside = (float(fit.theta[i]) for i in (OUTSIDE, FIRST, SECOND))
    return (ring - outside) * float(np.sign(ring - inside)) / max(abs(ring - inside), 1e-9)


def _weakest_sector(fit: Fit, outside: FloatArray) -> float:
    """Return the share of squares explained in the sector around the middle where it is least."""
    A = fit.theta[2:6].reshape(2, 2)
    q = (fit.place - fit.theta[[CX, CY]]) @ A.T
    if fit.pattern in (Pattern.CORNER, Pattern.OPEN_CORNER):
        return _weakest_bar(fit, q)
    turn = np.arctan2(q[:, 1], q[:, 0]) / (2.0 * np.pi)
    # of saddles halves of whole quadrants, else sectors around bars
    shift = 0.0 if fit.pattern in SADDLES else 0.5 / SECTORS
    sector = np.floor((turn + shift) * SECTORS).astype(np.int64) % SECTORS
    counted = outside < 0.98 if fit.pattern in SADDLES else np.ones(len(q), bool)
    return _weakest(fit, sector, counted)


def _weakest_bar(fit: Fit, q: FloatArray) -> float:
    """Return the same for the thirds of both bars and what lies next to them, the last with what lies behind it."""
    end = fit.reach if fit.pattern == Pattern.OPEN_CORNER else 1.0
    third = np.clip(np.floor(3.0 * np.maximum(q[:, 0], q[:, 1]) / end), 0, 2).astype(np.int64)
    return _weakest(fit, 3 * (q[:, 0] > q[:, 1]) + third, np.ones(len(q), bool))


def _weakest(fit: Fit, sector: IntArray, counted: BoolArray) -> float:
    mean = float(np.average(fit.grey, weights=fit.weight))
    weakest = 1.0
    for index in np.unique(sector[counted]):
        own = counted & (sector == index)
        if own.sum() < LEAST_PIXELS:
            continue
        total = float((fit.weight[own] * (fit.grey[own] - mean) ** 2).sum())
        left = float((fit.weight[own] * fit.residual[own] ** 2).sum())
        weakest = min(weakest, 1.0 - left / max(total, 1e-9))
    return weakest


@dataclass(frozen=True)
class Least:
    """What a target must show at least; of the standard deviation, at most."""

    score: float
    sharpness: float
    explained: float = LEAST_EXPLAINED
    weakest_sector: float = 0.65
    contrast_over_noise: float = 10.0
    contrast_over_texture: float = 5.0
    contrast_over_strongest_blob: float = 4.5
    width_px: float = 3.5
    length_px: float = 7.0
    sigma_px: float = 0.5
    shape: tuple[float, float] = (0.0, 0.5)


@dataclass(frozen=True)
class Judgement:
    """Whether a pattern that explains its pixels is a target."""

    score: float
    """Its discriminant."""
    limit: float
    """What that must reach."""
    is_target: bool
    """Whether it does, and none of the wide limits is broken."""


def is_target(fit: Fit, around: Ground, is_expected: bool = True) -> bool:
    """Return whether a fitted pattern is a target, as judged."""
    judgement = judged(fit, around, is_expected)
    return judgement is not None and judgement.is_target


def judged(fit: Fit, around: Ground, is_expected: bool = True) -> Judgement | None:
    """Return what is to be thought of a fitted pattern, None where it does not explain its pixels; ``around`` as of
    evidence. More is asked of one that nobody expects where it is."""
    least = LEAST[fit.pattern]
    if fit.explained_at_best < least.explained:  # as of most, and the rest takes time
        return None
    seen = evidence(fit, around)
    is_small = fit.pattern == Pattern.CIRCLE and seen.width_px < SMALL_PX
    limit = least.score + (0.0 if is_expected else UNEXPECTED) + (SMALL if is_small else 0.0)
    return Judgement(seen.score, limit, seen.score >= limit and _holds(seen, least, fit, around))


def _holds(seen: Evidence, least: Least, fit: Fit, around: Ground) -> bool:
    """Return whether no wide limit is broken."""
    return (
        seen.weakest_sector >= least.weakest_sector
        and seen.contrast_dn >= LEAST_CONTRAST_DN
        and seen.contrast_over_noise >= least.contrast_over_noise
        and seen.contrast_over_texture >= least.contrast_over_texture
        and seen.contrast_over_blobs >= LEAST_OVER_BLOBS
        and seen.contrast_over_strongest_blob >= least.contrast_over_strongest_blob
        and seen.outer_edge >= LEAST_OUTER_EDGE
        and seen.width_px >= least.width_px
        and least.length_px <= seen.length_px <= 140.0
        and seen.length_px <= 4.0 * seen.width_px
        and seen.sharpness >= least.sharpness
        and seen.sigma_px <= least.sigma_px
        and least.shape[0] <= seen.shape <= least.shape[1]
        and _is_seen(fit, around)
    )


def _is_seen(fit: Fit, around: Ground) -> bool:
    """Return whether the patch shows the centre of a pattern, and enough of its pixels."""
    side, centre = 2 * math.ceil(MOST_PX) + 2, fit.theta[[CX, CY]]
    if (np.minimum(centre, np.array(around.texture.shape)[::-1] - 1.0 - centre) < FROM_EDGE_PX).any():
        return False
    whole = fit.theta.copy()
    whole[[CX, CY]] += side // 2 - np.floor(centre)
    there = pixels(fit.pattern, whole, (side, side), fit.reach)
    return there is not None and len(fit.place) >= LEAST_SEEN * len(there)


LEAST: dict[Pattern, Least] = {
    Pattern.FIELDS: Least(24.0, 1.0, explained=0.96, weakest_sector=0.85, contrast_over_texture=3.0, length_px=6.3),
    Pattern.DISC_OF_QUADRANTS: Least(22.3, 0.8),
    Pattern.SQUARE_OF_QUADRANTS: Least(21.8, 0.8),
    Pattern.CIRCLE: Least(23.2, 1.2, contrast_over_noise=13.0, length_px=4.5),
    Pattern.RING: Least(24.5, 0.35, explained=0.945, shape=(0.15, 0.85)),
    Pattern.CROSS: Least(23.3, 0.3, width_px=4.5, shape=(0.0, 0.42)),
    Pattern.CROSSED_SQUARE: Least(23.0, 0.4, contrast_over_noise=11.0, width_px=4.5, shape=(0.08, 0.42)),
    Pattern.OPEN_CROSS: Least(
        24.5, 0.7, contrast_over_noise=14.0, contrast_over_texture=3.5, width_px=2.5, length_px=3.3
    ),
    Pattern.CORNER: Least(
        21.0,
        0.4,
        explained=0.915,
        weakest_sector=0.75,
        contrast_over_strongest_blob=3.5,
        width_px=4.5,
        sigma_px=1.1,
        shape=(0.08, 0.42),
    ),
    Pattern.OPEN_CORNER: Least(
        22.6, 0.6, explained=0.95, weakest_sector=0.75, contrast_over_strongest_blob=8.0, sigma_px=1.1
    ),
}
"""By pattern, the score between those of targets and of ground; `benchmarks/targets.py` prints what this finds, and
what it takes for a target that is none."""
