"""Whether a fitted pattern is a target, or a likeness that nature made.

A sum over all pixels can be good where one part is wrong: a stone is bright all around but for one side, a shadow's
edge is half of a cross. So every sector of the pattern is asked by itself, and each level against the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.targets.fitting import Fit
from photogram.targets.picture import BLUR, CX, CY, FIRST, FREE, OUTSIDE, SECOND, SHAPE, Pattern, level_shares
from photogram.targets.starts import texture_scatter

SECTORS = 8
LEAST_PIXELS = 4
"""Pixels that make a sector worth asking."""
AROUND_PX = 10
"""How far around a target its texture is taken."""
SADDLES = (Pattern.FIELDS, Pattern.DISC_OF_QUADRANTS, Pattern.SQUARE_OF_QUADRANTS)
OPEN = (Pattern.FIELDS, Pattern.OPEN_CROSS, Pattern.OPEN_CORNER)


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


def _texture_scatter(fit: Fit, band: FloatArray) -> float:
    """Return the scatter of a texture (H, W) further around a target."""
    height, width = band.shape
    own = np.zeros(band.shape, np.uint8)
    own[fit.place[:, 1], fit.place[:, 0]] = 1
    low = np.maximum(fit.place.min(axis=0) - AROUND_PX, 0)
    high = np.minimum(fit.place.max(axis=0) + AROUND_PX + 1, [width, height])
    part = own[low[1] : high[1], low[0] : high[0]]
    near, far = (cv2.dilate(part, np.ones((2 * n + 1, 2 * n + 1), np.uint8)) for n in (2, AROUND_PX))
    value = band[low[1] : high[1], low[0] : high[0]][(far > 0) & (near == 0)]
    if len(value) < 30:
        return 0.0
    return texture_scatter(value)


def evidence(fit: Fit, band: FloatArray | None = None) -> Evidence:
    """Return what speaks for a fitted pattern; ``band`` (H, W) is the texture of the patch."""
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
    if pattern in (Pattern.CROSS, Pattern.CORNER):
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
        np.inf if band is None else contrast / max(_texture_scatter(fit, band), 0.5),
        _weakest_sector(fit, outside),
        width,
        length,
        part / float(theta[BLUR]),
        float(theta[SHAPE]),
    )


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
    """Return the same for the near and far halves of both bars and for what lies between them and outside."""
    end = fit.reach if fit.pattern == Pattern.OPEN_CORNER else 1.0
    far = np.maximum(q[:, 0], q[:, 1]) > 0.5 * end
    return _weakest(fit, 2 * (q[:, 0] > q[:, 1]).astype(int) + far, np.ones(len(q), bool))


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


def is_target(fit: Fit, band: FloatArray | None = None) -> bool:
    """Return whether a fitted pattern is a target; ``band`` as of evidence."""
    least = LEAST[fit.pattern]
    if fit.explained < least.explained:  # as of most, and the rest takes time
        return False
    return _is_enough(evidence(fit, band), least) and _sigma_px(fit) <= least.sigma_px


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
    contrast_dn: float = 20.0
    contrast_over_noise: float = 9.0
    contrast_over_ground: float = 3.0
    contrast_over_texture: float = 7.0
    width_px: float = 3.5
    length_px: float = 7.0
    sigma_px: float = 0.5
    shape: tuple[float, float] = (0.0, 0.5)


LEAST: dict[Pattern, Least] = {
    Pattern.FIELDS: Least(0.97, 0.8, 1.5, contrast_dn=40.0, contrast_over_texture=0.0),
    Pattern.DISC_OF_QUADRANTS: Least(0.90, 0.6, 1.2),
    Pattern.SQUARE_OF_QUADRANTS: Least(0.90, 0.6, 1.2),
    Pattern.CIRCLE: Least(0.92, 0.75, 1.5, contrast_over_ground=5.0, width_px=4.5),
    Pattern.RING: Least(0.88, 0.6, 0.6, shape=(0.15, 0.85)),
    Pattern.CROSS: Least(0.90, 0.6, 0.15, width_px=4.5, shape=(0.0, 0.42)),
    Pattern.OPEN_CROSS: Least(0.94, 0.8, 0.9, contrast_dn=35.0, width_px=2.5, length_px=3.3),
    Pattern.CORNER: Least(0.93, 0.7, 0.5, width_px=4.5),
    Pattern.OPEN_CORNER: Least(0.92, 0.75, 0.9),
}
"""By pattern; `benchmarks/targets.py` prints what this finds, and what it takes for a target that is none."""
