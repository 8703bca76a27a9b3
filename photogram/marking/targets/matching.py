"""Least squares matching (Gruen 1985): the place in a patch that looks like what was marked in other photographs.

A template T with its mark at m and the patch G are related by

    G(c + A (p − m)) = gain · T(p) + offset

for pixels p around m; c is the place, A affine. The patch is interpolated by cubic splines. Both photographs are noisy:
the residuals have the noise of both, and the mark in the template its own, which is no part of the covariance given.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from photogram.arrays import ByteArray, Float32Array, FloatArray, check_shape
from photogram.marking.targets.fitting import centre_covariance
from photogram.marking.targets.kinds import Kind, MeasuredCentre

GreyPatch = ByteArray | Float32Array

HALF_PX = 10
"""Half of the side of what is compared."""
LEAST_CORRELATION = 0.8
LEAST_CONTRAST_DN = 5.0
RIVAL = 0.9
"""Share of the highest correlation that another peak may reach."""
APART_PX = 3
"""From where on it is another peak."""
AGREE = 3.0
"""How many standard deviations the places that single templates give may lie apart, and AGREE_PX."""
AGREE_PX = 0.5
NOISY_SLOPES = 1.15
"""By what standard deviations grow because slopes are those of noisy grey values: errors of simulated pairs with noise
of 1.5 to 6 DN are 1.07 to 1.20 times what is stated without."""
ITERATIONS = 30
BLUR_PX = 0.8
"""Blur of both before they are compared: interpolation smooths noise, most so between pixels, and least squares would
seek the places where it does."""


@dataclass(frozen=True, eq=False)
class Template:
    """A patch (H, W) of grey values of another photograph, and the place (2,) px in it that was marked."""

    grey: GreyPatch
    centre_px: FloatArray

    def __post_init__(self) -> None:
        check_shape("centre_px", self.centre_px, (2,))


def match_centre(
    templates: Sequence[Template], grey: GreyPatch, start_px: FloatArray, reach_px: float = 10.0
) -> MeasuredCentre | None:
    """Return the place in a patch (H, W) of grey values, at most ``reach_px`` from a rough one (2,), that looks like
    what was marked in other photographs; None where nothing does, several places do, or templates disagree.

    Templates should be turned and scaled as the patch is to 15° and a fifth; half of those that match must agree.
    """
    own = np.asarray(grey, np.float64)
    near = np.asarray(start_px, np.float64)
    if not np.isfinite(near).all():
        return None
    single = [m for m in (_matched(t, own, near, reach_px) for t in templates) if m is not None]
    if not single:
        return None
    middle = np.median([m.centre_px for m in single], axis=0)
    agree = [m for m in single if np.hypot(*(m.centre_px - middle)) <= AGREE_PX + AGREE * float(m.sigma_px.max())]
    if 2 * len(agree) < len(templates):
        return None
    # one patch is in all of them: their mean has the noise of one, not of all
    weights = [np.linalg.inv(m.covariance_px2) for m in agree]
    total = np.linalg.inv(np.sum(weights, axis=0))
    centre = total @ np.sum([w @ m.centre_px for w, m in zip(weights, agree, strict=True)], axis=0)
    spread = np.mean([np.outer(m.centre_px - centre, m.centre_px - centre) for m in agree], axis=0)
    return MeasuredCentre(
        Kind.MATCHED,
        centre,
        len(agree) * total + spread,
        float(np.median([m.quality for m in agree])),
        2.0 * HALF_PX + 1.0,
        float(np.median([m.contrast_dn for m in agree])),
    )


def _matched(template: Template, grey: FloatArray, near: FloatArray, reach_px: float) -> MeasuredCentre | None:
    """Return the place that looks like one template, None where there is none or several."""
    step = np.arange(-HALF_PX, HALF_PX + 1)
    du, dv = (d.ravel().astype(np.float64) for d in np.meshgrid(step, step))
    at = np.round(template.centre_px)
    u, v = du + at[0], dv + at[1]
    height, width = template.grey.shape
    if u.min() < 0 or v.min() < 0 or u.max() > width - 1 or v.max() > height - 1:
        return None
    smooth = gaussian_filter(np.asarray(template.grey, np.float64), BLUR_PX)
    pattern = smooth[v.astype(int), u.astype(int)]
    if pattern.std() < LEAST_CONTRAST_DN:
        return None
    offset = np.column_stack([u, v]) - template.centre_px
    start = _correlated(pattern.reshape(len(step), -1), template.centre_px - at, grey, near, reach_px)
    return None if start is None else _refined(pattern, offset, grey, start, near, reach_px)


def _correlated(
    pattern: FloatArray, mark: FloatArray, grey: FloatArray, near: FloatArray, reach_px: float
) -> FloatArray | None:
    """Return the place (2,) where a template (n, n), its mark at ``mark`` (2,) from its middle, correlates best, to a
    pixel; None where it does so nowhere or in several places."""
    margin = HALF_PX + int(np.ceil(reach_px))
    low = np.maximum(np.round(near - mark).astype(int) - margin, 0)
    high = np.minimum(np.round(near - mark).astype(int) + margin + 1, np.array(grey.shape)[::-1])
    if (high - low < pattern.shape[0]).any():
        return None
    part = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]], np.float32)
    score = np.asarray(cv2.matchTemplate(part, pattern.astype(np.float32), cv2.TM_CCOEFF_NORMED), np.float64)
    row, column = (int(i) for i in np.unravel_index(int(np.argmax(score)), score.shape))
    best = float(score[row, column])
    if best < LEAST_CORRELATION - 0.2:
        return None
    rows, columns = np.indices(score.shape)
    other = score[np.maximum(np.abs(rows - row), np.abs(columns - column)) >= APART_PX]
    if other.size and float(other.max()) > RIVAL * best:
        return None
    pixel: FloatArray = np.array([column, row]) + low + HALF_PX + mark
    return pixel


def _refined(
    pattern: FloatArray, offset: FloatArray, grey: FloatArray, start: FloatArray, near: FloatArray, reach_px: float
) -> MeasuredCentre | None:
    """Return the place estimated by least squares from ``start`` (2,), for grey values ``pattern`` (N,) at ``offset``
    (N, 2) from the mark."""
    spline = spline_filter(gaussian_filter(grey, BLUR_PX), order=3)
    theta = np.array([start[0], start[1], 1.0, 0.0, 0.0, 1.0])
    for _ in range(ITERATIONS):
        place = theta[:2] + offset @ theta[2:].reshape(2, 2).T
        if (place < 1).any() or (place > np.array(grey.shape)[::-1] - 2).any():
            return None
        value, slope_u, slope_v = sampled(spline, place)
        design = np.column_stack([pattern, np.ones(len(pattern))])
        level = np.linalg.lstsq(design, value, rcond=None)[0]
        residual = value - design @ level
        turned = (-slope_u[:, None] * offset, -slope_v[:, None] * offset)
        J = np.column_stack([-slope_u, -slope_v, *turned, design])
        step = np.linalg.lstsq(J, residual, rcond=None)[0]
        theta = theta + np.clip(step[:6], -1.0, 1.0)
        if not np.isfinite(theta).all() or np.hypot(*(theta[:2] - near)) > reach_px:
            return None
        if np.abs(step[:2]).max() < 1e-3:
            break
    else:
        return None
    scale = np.linalg.svd(theta[2:].reshape(2, 2), compute_uv=False)
    correlation = float(np.corrcoef(value, pattern)[0, 1])
    if correlation < LEAST_CORRELATION or level[0] < 0.3 or scale[0] > 2.0 or scale[1] < 0.5:
        return None
    pixel = np.round(offset - offset.min(axis=0)).astype(np.int64)
    covariance = centre_covariance(pixel, J, residual, np.ones(len(residual)), np.zeros(len(residual)))
    return MeasuredCentre(
        Kind.MATCHED,
        theta[:2].copy(),
        NOISY_SLOPES**2 * covariance,
        correlation,
        2.0 * HALF_PX + 1.0,
        float(np.ptp(value)),
    )


def sampled(spline: FloatArray, place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return grey values (N,) and their derivatives by column and row at ``place`` (N, 2), of the coefficients (H, W)
    of a cubic spline (Unser, Aldroubi & Eden 1993)."""

    def at(shift_u: float, shift_v: float) -> FloatArray:
        where = [place[:, 1] + shift_v, place[:, 0] + shift_u]
        return np.asarray(map_coordinates(spline, where, order=3, prefilter=False, mode="nearest"), np.float64)

    step = 0.01  # within a piece of the spline the difference is the derivative to 1e-5
    slope_u = (at(step, 0.0) - at(-step, 0.0)) / (2.0 * step)
    slope_v = (at(0.0, step) - at(0.0, -step)) / (2.0 * step)
    return at(0.0, 0.0), slope_u, slope_v
