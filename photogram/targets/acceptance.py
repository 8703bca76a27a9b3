"""Whether a fitted pattern is a target, or a likeness that nature made.

A sum over all pixels can be good where one part is wrong: a stone is bright all around but for one side, a shadow's
edge is half of a cross. So every sector of the pattern is asked by itself, and each level against the noise.

Among many stones one is round. So a target must differ from the ground by more than the ground's own blobs do, whose
strength is √det H σ² with the Hessian H of the grey values under a Gaussian blur σ (Lindeberg 1998): an edge, of a kerb
or a shadow, has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.targets.fitting import Fit
from photogram.targets.picture import BLUR, CX, CY, FIRST, FREE, OUTSIDE, SECOND, SHAPE, Pattern, level_shares
from photogram.targets.starts import texture, texture_scatter

SECTORS = 8
LEAST_PIXELS = 4
"""Pixels that make a sector worth asking."""
LEAST_OUTER_EDGE = 0.15
"""By how much a ring must stand out from the ground, over its contrast: else it is the circle that it encloses."""
AROUND_PX, FURTHER_PX = 10, 20
"""How far around a target the texture is taken, and how far the ground's blobs."""
BLOB_PX, MOST_BLOBS = 2.0, 0.9
"""Blur under which blobs are taken, and the share of the ground where they are weaker than what is compared."""
USUAL_MISFIT = 0.03
"""Share of the squares left unexplained for which the contrast over blobs is asked as it stands: it must be more where
more is left, by the fourth root, which tells stones from targets best."""
SMALL_PX, OF_SMALL = 9.5, 1.5
"""Length below which a target might be a stone or a leaf, and how many times as much is asked of it."""
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
    second, mixed = np.array([[1.0, -2.0, 1.0]]), np.array([[1.0, 0.0, -1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0]])
    lxx, lyy, lxy = (cv2.filter2D(smooth, cv2.CV_64F, kernel) for kernel in (second, second.T, 0.25 * mixed))
    return Ground(texture(grey), BLOB_PX**2 * np.sqrt(np.maximum(lxx * lyy - lxy**2, 0.0)))


@dataclass(frozen=True)
class Evidence:
    """What speaks for a target."""

    explained: float
    """Share of the variance of its pixels that the picture explains."""
    contrast_dn: float
    """Difference of its levels, of a ring from what it encloses."""
    contrast_over_noise: float
    """The same over the standard deviation of the residuals in the target."""
    contrast_over_ground: float
    """The same over the standard deviation of what lies beside it."""
    contrast_over_texture: float
    """The same over the scatter of the texture further around, infinite where none is asked."""
    contrast_over_blobs: float
    """The same over the strength of the ground's blobs, by the share explained and the size as above."""
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


def _texture_scatter(fit: Fit, around: Ground) -> float:
    """Return the scatter of the texture around a target."""
    value = _around(fit, around.texture, 2, AROUND_PX)
    return texture_scatter(value) if len(value) >= 30 else 0.0


def _blob_strength(fit: Fit, around: Ground, length_px: float) -> float:
    """Return the strength of the ground's blobs around a target, DN, as a target that leaves as much unexplained and is
    as long must exceed it."""
    value = _around(fit, around.blobs, 3, FURTHER_PX)
    strength = float(np.quantile(value, MOST_BLOBS)) if len(value) >= 30 else 0.0
    misfit = float((max(1.0 - fit.explained, 1e-6) / USUAL_MISFIT) ** 0.25)
    return strength * misfit * (OF_SMALL if length_px < SMALL_PX else 1.0)


def evidence(fit: Fit, around: Ground | None = None) -> Evidence:
    """Return what speaks for a fitted pattern; ``around`` is the ground of the patch."""
    theta, pattern = fit.theta, fit.pattern
    place = fit.place.astype(np.float64)
    shares = level_shares(pattern, theta, place)
    outside = shares.outside if OUTSIDE in FREE[pattern] else np.zeros(len(place))
    level = theta[[i for i in (OUTSIDE, FIRST, SECOND) if i in FREE[pattern]]]
    # of bars narrower than their blur only the product of width and contrast is known
    contrast = min(float(abs(level[-1] - level[-2])), float(np.ptp(fit.grey)))
    beside = outside > 0.9
    noise = float(np.sqrt(np.mean(fit.residual[~beside] ** 2))) if (~beside).any() else np.inf
    ground = float(np.std(fit.residual[beside])) if beside.sum() >= 8 else noise
    length, width = axes_px(fit)
    part = 0.5 * width if pattern in SADDLES else width
    if pattern in (Pattern.CROSS, Pattern.CORNER, Pattern.CROSSED_SQUARE):
        part = width * float(theta[SHAPE])
    elif pattern in (Pattern.OPEN_CROSS, Pattern.OPEN_CORNER):
        part = width / fit.reach
    elif pattern == Pattern.RING:
        part = 0.5 * width * min(1.0 - float(theta[SHAPE]), 2.0 * float(theta[SHAPE]))
    return Evidence(
        fit.explained,
        contrast,
        contrast / max(noise, 0.5),
        contrast / max(ground, 0.5),
        np.inf if around is None else contrast / max(_texture_scatter(fit, around), 0.5),
        np.inf if around is None else contrast / max(_blob_strength(fit, around, length), 0.3),
        _outer_edge(fit),
        _weakest_sector(fit, outside),
        width,
        length,
        part / float(theta[BLUR]),
        float(theta[SHAPE]),
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
    """Return the same for the thirds of both bars and what lies beside them, the last with what lies behind it."""
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


def is_target(fit: Fit, around: Ground | None = None) -> bool:
    """Return whether a fitted pattern is a target; ``around`` as of evidence."""
    least = LEAST[fit.pattern]
    if fit.explained < least.explained:  # as of most, and the rest takes time
        return False
    return _is_enough(evidence(fit, around), least) and _sigma_px(fit) <= least.sigma_px


def _sigma_px(fit: Fit) -> float:
    """Return the largest standard deviation of a centre in any direction."""
    return float(np.sqrt(np.linalg.eigvalsh(fit.covariance_px2)[1]))


def _is_enough(found: Evidence, least: Least) -> bool:
    return (
        found.weakest_sector >= least.weakest_sector
        and found.contrast_dn >= least.contrast_dn
        and found.contrast_over_noise >= least.contrast_over_noise
        and found.contrast_over_ground >= least.contrast_over_ground
        and found.contrast_over_texture >= least.contrast_over_texture
        and found.contrast_over_blobs >= least.contrast_over_blobs
        and found.outer_edge >= LEAST_OUTER_EDGE
        and found.width_px >= least.width_px
        and least.length_px <= found.length_px <= 140.0
        and found.length_px <= 4.0 * found.width_px
        and found.sharpness >= least.sharpness
        and least.shape[0] <= found.shape <= least.shape[1]
    )


@dataclass(frozen=True)
class Least:
    """What a target must show at least; of the standard deviation, at most."""

    explained: float
    weakest_sector: float
    sharpness: float
    contrast_dn: float = 30.0
    contrast_over_noise: float = 9.0
    contrast_over_ground: float = 3.0
    contrast_over_texture: float = 5.0
    contrast_over_blobs: float = 17.0
    width_px: float = 3.5
    length_px: float = 7.0
    sigma_px: float = 0.5
    shape: tuple[float, float] = (0.0, 0.5)


LEAST: dict[Pattern, Least] = {
    Pattern.FIELDS: Least(
        0.975,
        0.9,
        1.5,
        contrast_dn=40.0,
        contrast_over_noise=14.0,
        contrast_over_texture=0.0,
        contrast_over_blobs=10.5,
        length_px=6.3,
    ),
    Pattern.DISC_OF_QUADRANTS: Least(0.90, 0.7, 1.2, contrast_over_noise=13.0),
    Pattern.SQUARE_OF_QUADRANTS: Least(0.92, 0.7, 1.2, contrast_over_noise=14.0),
    Pattern.CIRCLE: Least(0.92, 0.65, 1.5, contrast_over_noise=13.0, contrast_over_ground=4.5, width_px=4.5),
    Pattern.RING: Least(0.89, 0.7, 0.6, contrast_dn=25.0, shape=(0.15, 0.85)),
    Pattern.CROSS: Least(0.89, 0.65, 0.7, contrast_over_noise=12.0, width_px=4.5, shape=(0.0, 0.42)),
    Pattern.CROSSED_SQUARE: Least(
        0.92, 0.75, 0.5, contrast_dn=40.0, contrast_over_noise=11.0, width_px=4.5, shape=(0.08, 0.42)
    ),
    Pattern.OPEN_CROSS: Least(
        0.95,
        0.85,
        0.8,
        contrast_dn=35.0,
        contrast_over_noise=14.0,
        contrast_over_blobs=13.0,
        width_px=2.5,
        length_px=3.3,
    ),
    Pattern.CORNER: Least(
        0.905, 0.7, 0.45, contrast_over_noise=11.0, contrast_over_blobs=12.5, width_px=4.5, sigma_px=0.8
    ),
    Pattern.OPEN_CORNER: Least(0.975, 0.75, 0.9, contrast_over_noise=13.0, contrast_over_blobs=13.5, sigma_px=0.8),
}
"""By pattern; `benchmarks/targets.py` prints what this finds, and what it takes for a target that is none."""
