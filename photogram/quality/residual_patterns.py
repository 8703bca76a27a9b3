"""Whether residuals have a pattern in common at the same places of all photographs: what the camera model leaves out.

Noise differs from photograph to photograph; what a lens, a correction within the camera or a rolling shutter does to
the picture is the same in all, and averages out over nothing. The picture plane is divided into squares, and the means
of the residuals in them are compared with their standard errors (χ²). The mean square of the means, less what chance
alone puts there, is the mean square of the pattern, as the variance between groups in an analysis of variance with
random effects (Searle, Casella & McCulloch 1992, sec. 3.6).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera
from photogram.factors.consider import without_considered
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.functionals import Solvable, factored, responses_to_pixels
from photogram.factors.graph import Problem
from photogram.quality.deformation import height_modes, places_of
from photogram.results import Adjustment

SQUARES = 10
"""Squares along the width of a photograph."""

FEWEST_RESIDUALS, FEWEST_SQUARES = 20, 12
"""Residuals in a square that counts, and such squares for which anything is said."""

SIGNIFICANCE = 0.001

FOLLOWED = 3.0
"""What the block follows of an error of the camera model, over what it leaves in the residuals: poses and calibration
take up the smooth part. Simulated lens patterns of two to eight half waves along a side leave 0.3 to 0.6 of their RMS;
with this, heights are as uncertain as predicted (benchmarks/model_errors.py)."""

ALIKE = 2.0
"""Squares over which such an error stays alike: a fifth of the width of a picture."""

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
    significant = p < SIGNIFICANCE and pattern > WORTH_TELLING * residual
    return ResidualPattern(pattern, residual, chance, int(enough.sum()), significant)


def _sums(square: IntArray, values: FloatArray, squares: int) -> FloatArray:
    """Return the sums (squares, 2) of values (N, 2) by their squares (N,)."""
    return np.stack([np.bincount(square, value, squares) for value in values.T], axis=-1)


def residual_patterns(result: Adjustment) -> dict[str, ResidualPattern]:
    """Return the pattern of every camera with tie points enough, by its name."""
    block = result.block
    camera_of = np.array([photograph.camera for photograph in block.photographs], dtype=np.int64)
    of_each = _by_camera(
        block.cameras, camera_of[block.tie_points.photograph], block.tie_points.pixel, result.estimates.residual_px
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


def pattern_covariance_m2(problem: Problem, state: State, solvable: Solvable) -> FloatArray:
    """Return what errors of the camera models do to the heights of a block, judged by the patterns of their residuals:
    the covariance (4, 4), m², of mean, slopes east and north and dome, as Deformation has them.

    NaN where nothing is known of patterns or of the block, zero where no pattern is significant. An error is a shift of
    each square of the picture plane, of FOLLOWED times the RMS of the pattern, whose correlation falls with the
    distance d of two squares as exp(−(d / ALIKE)²): R C Rᵀ with the responses R of the four functions to all squares.
    A focal length that is held does not follow such an error, whatever its sigma says of it.
    """
    places = places_of(problem, state)
    if places is None:
        return np.full((4, 4), np.nan)
    constant = without_considered(problem)
    if constant is not problem:
        problem, solvable = constant, factored(constant, state)
    a = np.zeros((len(places.points), 3, 4))
    a[:, 2] = height_modes(state.tie_point[places.points, :2], places.centre_world_m, places.radius_m).T
    response = responses_to_pixels(problem, state, solvable, places.points, a)
    tie = problem.tie
    whitened = residuals(tie, state.cameras, state.tie_point)
    covariance, known = np.zeros((4, 4)), False
    for camera, own, pattern in _by_camera(
        problem.block.cameras, state.cameras.camera[tie.photograph], tie.pixel, whitened * tie.sigma_px[:, None]
    ):
        known = True
        if not pattern.significant:
            continue
        square, squares = squares_of(camera, tie.pixel[own])
        together = np.stack([_sums(square, response[own, :, k], squares) for k in range(4)])
        variance_px2 = (FOLLOWED * pattern.pattern_px) ** 2
        covariance += variance_px2 * np.einsum("kic,ij,ljc->kl", together, _likeness(squares), together)
    return covariance if known else np.full((4, 4), np.nan)


def _likeness(squares: int) -> FloatArray:
    """Return the correlation (squares, squares) of the shifts of squares by their distance."""
    number = np.arange(squares)
    place = np.column_stack([number % SQUARES, number // SQUARES])
    distance = np.linalg.norm(place[:, None] - place[None], axis=2)
    return np.asarray(np.exp(-((distance / ALIKE) ** 2)))
