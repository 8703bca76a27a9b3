"""Whether residuals have a pattern in common at the same places of all photographs: what the camera model leaves out.

Noise differs from photograph to photograph; what a lens, a correction within the camera or a rolling shutter does to
the picture is the same in all, and averages out over nothing. The picture plane is divided into squares, and the means
of the residuals in them are compared with their standard errors (χ²). The mean square of the means, less what chance
alone puts there, is the mean square of the pattern, as the variance between groups in an analysis of variance with
random effects (Searle, Casella & McCulloch 1992, sec. 3.6).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.functionals import Solvable, responses_to_pixels
from photogram.factors.graph import Problem
from photogram.quality.deformation import height_modes, places_of
from photogram.results import Adjustment

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


def squares_of(camera: Camera, pixel: FloatArray) -> tuple[IntArray, int]:
    """Return in which square each pixel (N, 2) of a camera lies, and how many squares there are."""
    side_px = camera.width_px / SQUARES
    rows = int(np.ceil(camera.height_px / side_px))
    column, row = np.floor((pixel + 0.5) / side_px).astype(np.int64).clip(0, [SQUARES - 1, rows - 1]).T
    return row * SQUARES + column, rows * SQUARES


def residual_pattern(camera: Camera, pixel: FloatArray, residual_px: FloatArray) -> ResidualPattern | None:
    """Return the pattern of residuals (N, 2), px, at pixels (N, 2) of a camera; None where they are too few."""
    square, squares = squares_of(camera, pixel)
    count = np.bincount(square, minlength=squares)
    enough = count >= FEWEST_RESIDUALS
    if enough.sum() < FEWEST_SQUARES:
        return None
    means = _sums(square, residual_px, squares) / np.maximum(count, 1)[:, None]
    scatter = _sums(square, (residual_px - means[square]) ** 2, squares)
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
    """Return the pattern of every camera with tie points enough, by its name."""
    block = result.block
    camera_of = np.array([photograph.camera for photograph in block.photographs], dtype=np.int64)
    of_each = _by_camera(
        block.cameras, camera_of[block.tie_points.photograph], block.tie_points.pixel, result.residual_px
    )
    return {camera.name: pattern for camera, _, pattern in of_each}


def _by_camera(
    cameras: Sequence[Camera], camera_of: IntArray, pixel: FloatArray, residual_px: FloatArray
) -> Iterator[tuple[Camera, BoolArray, ResidualPattern]]:
    """Yield every camera with residuals (N, 2) enough, which of them are its own (N,), and their pattern; those of
    points behind a camera are not finite, and left out."""
    finite = np.isfinite(residual_px).all(axis=1)
    for c, camera in enumerate(cameras):
        own = (camera_of == c) & finite
        pattern = residual_pattern(camera, pixel[own], residual_px[own])
        if pattern is not None:
            yield camera, own, pattern


def pattern_sigmas_m(problem: Problem, state: State, found: Solvable) -> FloatArray:
    """Return how far errors of the camera models, as large as the patterns of their residuals but such that the block
    follows them, tilt and bend it: standard deviations (3,), m, of the slopes east and north and of the dome as
    Deformation has them. NaN where nothing is known of patterns or of the block.

    An error is taken as one shift for each square of the picture plane, independent of the others, with the RMS of the
    pattern: Σ over squares and coordinates of (pattern × sum of the responses in the square)².
    """
    places = places_of(problem, state)
    if places is None:
        return np.full(3, np.nan)
    a = np.zeros((len(places.points), 3, 3))
    a[:, 2] = height_modes(state.tie_point[places.points, :2], places.centre_world_m, places.radius_m)[1:].T
    response = responses_to_pixels(problem, state, found, places.points, a)
    tie = problem.tie
    whitened = residuals(tie, state.cameras, state.tie_point)
    variances = []
    for camera, own, pattern in _by_camera(
        problem.block.cameras, state.cameras.camera[tie.photograph], tie.pixel, whitened * tie.sigma_px[:, None]
    ):
        square, squares = squares_of(camera, tie.pixel[own])
        together = np.stack([_sums(square, response[own, :, k], squares) for k in range(3)])
        variances.append(pattern.pattern_px**2 * np.sum(together**2, axis=(1, 2)))
    return np.sqrt(np.sum(variances, axis=0)) if variances else np.full(3, np.nan)
