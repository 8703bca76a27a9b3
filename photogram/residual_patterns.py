"""Whether residuals have a pattern in common at the same places of all photographs: what the camera model leaves out.

Noise differs from photograph to photograph; what a lens, a correction within the camera or a rolling shutter does to
the picture is the same in all, and averages out over nothing. The picture plane is divided into squares, and the means
of the residuals in them are compared with their standard errors (χ²). The mean square of the means, less what chance
alone puts there, is the mean square of the pattern, as the variance between groups in an analysis of variance with
random effects (Searle, Casella & McCulloch 1992, sec. 3.6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from photogram.camera import Camera
from photogram.survey import Adjustment, FloatArray

IntArray = NDArray[np.int64]

SQUARES = 10
"""Squares along the width of a photograph."""

FEWEST_RESIDUALS, FEWEST_SQUARES = 20, 12
"""Residuals in a square that counts, and such squares for which anything is said."""

SIGNIFICANCE = 0.001

WORTH_TELLING = 0.1
"""A pattern counts from this part of the residuals' RMS on. With many observations smaller ones are significant too:
residuals of one point depend on each other, and rendered pictures are interpolated."""


@dataclass(frozen=True)
class ResidualPattern:
    """What the residuals of tie points of one camera have in common: ``pattern_px`` its RMS for a coordinate,
    ``residual_px`` that of the residuals, ``chance_px`` that of the means of ``squares`` squares without any pattern;
    and whether it is ``significant`` and worth telling."""

    pattern_px: float
    residual_px: float
    chance_px: float
    squares: int
    significant: bool


def residual_pattern(camera: Camera, pixel: FloatArray, residual_px: FloatArray) -> ResidualPattern | None:
    """Return the pattern of residuals (N, 2), px, at pixels (N, 2) of a camera; None where they are too few."""
    side_px = camera.width_px / SQUARES
    rows = int(np.ceil(camera.height_px / side_px))
    column, row = np.floor((pixel + 0.5) / side_px).astype(np.int64).clip(0, [SQUARES - 1, rows - 1]).T
    square = row * SQUARES + column
    count = np.bincount(square, minlength=rows * SQUARES)
    enough = count >= FEWEST_RESIDUALS
    if enough.sum() < FEWEST_SQUARES:
        return None
    means = _sums(square, residual_px, len(count)) / np.maximum(count, 1)[:, None]
    scatter = _sums(square, (residual_px - means[square]) ** 2, len(count))
    n = count[enough, None].astype(np.float64)
    mean, error = means[enough], np.sqrt(scatter[enough] / (n * (n - 1.0)))
    residual, chance = float(np.sqrt(np.mean(residual_px**2))), float(np.sqrt(np.mean(error**2)))
    pattern = float(np.sqrt(max(float(np.mean(mean**2)) - chance**2, 0.0)))
    known = error > 0.0
    p = float(chi2.sf(np.sum((mean[known] / error[known]) ** 2), int(known.sum())))
    told = p < SIGNIFICANCE and pattern > WORTH_TELLING * residual
    return ResidualPattern(pattern, residual, chance, int(enough.sum()), told)


def _sums(square: IntArray, values: FloatArray, squares: int) -> FloatArray:
    """Return the sums (squares, 2) of values (N, 2) by their squares (N,)."""
    return np.stack([np.bincount(square, value, squares) for value in values.T], axis=-1)


def residual_patterns(result: Adjustment) -> dict[str, ResidualPattern]:
    """Return the pattern of every camera with tie points enough."""
    tie, found = result.block.tie_points, {}
    camera_of = np.array([photograph.camera for photograph in result.block.photographs], dtype=np.int64)
    for c, camera in enumerate(result.block.cameras):
        of_camera = camera_of[tie.photograph] == c
        pattern = residual_pattern(camera, tie.pixel[of_camera], result.residual_px[of_camera])
        if pattern is not None:
            found[camera.name] = pattern
    return found
