"""What residuals have in common, from noise with and without a pattern, and from blocks whose camera model is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from seeds import seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera
from photogram.factors import functionals
from photogram.factors.functionals import factored, responses_to_pixels
from photogram.quality.deformation import height_modes, places_of
from photogram.quality.diagnosis import diagnose
from photogram.quality.improvements import block_deformation
from photogram.quality.residual_patterns import (
    ALIKE,
    FOLLOWED,
    pattern_covariance_m2,
    residual_pattern,
    residual_patterns,
    squares_of,
)
from photogram.report.figures.page_figures import residual_caption
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

CAMERA = Camera("c", 4000, 3000, 2300.0, np.array([1999.5, 1499.5]))
NOISE_PX = 0.5


def places(count: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform([-0.5, -0.5], [3999.5, 2999.5], (count, 2))


def noise(count: int, seed: int) -> FloatArray:
    return np.random.default_rng(1000 + seed).normal(scale=NOISE_PX, size=(count, 2))


def wave(pixel: FloatArray, rms_px: float, length_px: float = 1600.0) -> FloatArray:
    """Return a pattern that is the same in all photographs: waves of the RMS for a coordinate."""
    phase = 2 * np.pi * pixel / length_px
    return np.asarray(np.sqrt(2.0) * rms_px * np.column_stack([np.sin(phase[:, 1]), np.cos(phase[:, 0])]))


def test_noise_is_no_pattern() -> None:
    """What chance puts into the means is taken off: the pattern of noise is far below its standard error of a mean."""
    found = [residual_pattern(CAMERA, places(20_000, seed), noise(20_000, seed)) for seed in seeds(50)]
    assert all(f is not None and not f.significant for f in found)
    chance = [f.chance_px for f in found if f is not None]
    np.testing.assert_allclose(chance, NOISE_PX / np.sqrt(20_000 / 80), rtol=0.1)
    assert np.mean([f.pattern_px for f in found if f is not None]) < 0.3 * np.mean(chance)


@pytest.mark.parametrize("rms_px", [0.06, 0.15, 0.5])
def test_a_pattern_is_as_large_as_it_was_made(rms_px: float) -> None:
    """Means over squares of a quarter of a wave keep nearly all of it."""
    pixel = places(40_000, 1)
    found = residual_pattern(CAMERA, pixel, noise(40_000, 1) + wave(pixel, rms_px))
    assert found is not None
    assert found.significant
    assert found.pattern_px == pytest.approx(rms_px, rel=0.15)
    assert found.residual_px == pytest.approx(np.hypot(NOISE_PX, rms_px), rel=0.02)


def test_what_is_significant_but_small_is_not_told() -> None:
    pixel = places(400_000, 2)
    found = residual_pattern(CAMERA, pixel, noise(400_000, 2) + wave(pixel, 0.03))
    assert found is not None
    assert found.pattern_px == pytest.approx(0.03, rel=0.2)
    assert not found.significant


def test_too_few_residuals_say_nothing() -> None:
    assert residual_pattern(CAMERA, places(500, 3), noise(500, 3)) is None
    assert residual_pattern(CAMERA, np.zeros((0, 2)), np.zeros((0, 2))) is None
    corner = places(20_000, 3) / [8.0, 8.0]
    assert residual_pattern(CAMERA, corner, noise(20_000, 3)) is None


def test_residuals_without_any_scatter_are_no_pattern() -> None:
    found = residual_pattern(CAMERA, places(20_000, 4), np.zeros((20_000, 2)))
    assert found is not None
    assert (found.pattern_px, found.significant) == (0.0, False)


# ---- adjusted blocks -----------------------------------------------------------------------------------------------


def adjusted(pattern_px: float) -> Adjustment:
    """Adjust a simulated block whose pictures share a pattern that no parameter of its camera can follow."""
    plan = SurveyPlan(strips=4, photographs_per_strip=6, control_points=5, check_points=0)
    block = simulate_block(plan, 5, tie_points=3000).block
    tie, camera = block.tie_points, block.cameras[0]
    bent = tie.pixel + wave(tie.pixel, pattern_px, camera.width_px / 3)
    block = replace(block, tie_points=replace(tie, pixel=bent))
    return adjust(block, AdjustmentSettings(robust_loss="none", outlier_threshold=100.0))


def test_a_camera_that_the_model_does_not_fit_is_named() -> None:
    wrong = adjusted(0.4)
    found = residual_patterns(wrong)["simulated"]
    assert found.significant
    assert 0.2 < found.pattern_px < 0.4
    sentence = next(w for w in diagnose(wrong).warnings if "share a pattern" in w)
    assert f"{found.pattern_px:.2g} px" in sentence
    assert "px: significant." in residual_caption("simulated", found)


def test_a_camera_that_the_model_fits_is_not() -> None:
    right = adjusted(0.0)
    found = residual_patterns(right)["simulated"]
    assert not found.significant
    assert not [w for w in diagnose(right).warnings if "share a pattern" in w]
    assert "px: not significant." in residual_caption("simulated", found)
    assert "systematic part" not in residual_caption("simulated", None)


# ---- what a pattern does to heights --------------------------------------------------------------------------------

PLAN = SurveyPlan(
    focal_px=1000.0, strips=4, photographs_per_strip=5, control_points=0, check_points=0, forward_overlap=0.8,
    side_overlap=0.7, relief_m=4.0, gnss_sigma_m=(0.5, 0.5, 0.5), gnss_offset_sigma_m=(1.0, 1.0, 2.0),
)  # fmt: skip
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=1e6, estimate_sigmas=False)


def moved_block(shift_px: FloatArray | None = None) -> Block:
    """Return a block whose pixels are shifted by ``shift_px`` (squares, 2) for each square of the picture plane."""
    block = simulate_block(
        PLAN, 7, tie_points=1500, start_position_sigma_m=0.1, start_attitude_sigma_deg=0.1, start_point_sigma_m=0.1
    ).block
    if shift_px is None:
        return block
    square, _ = squares_of(block.cameras[0], block.tie_points.pixel)
    return replace(block, tie_points=replace(block.tie_points, pixel=block.tie_points.pixel + shift_px[square]))


def responses(result: Adjustment) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the responses of slopes and dome to the pixels of an adjusted block, their weights, and their points."""
    problem = make_problem(result.block, SETTINGS)
    state = replace(start_state(problem), offset=result.estimates.offset_world_m)
    places = places_of(problem, state)
    assert places is not None
    modes = height_modes(state.tie_point[places.points, :2], places.centre_world_m, places.radius_m)[1:]
    a = np.zeros((len(places.points), 3, 3))
    a[:, 2] = modes.T
    return responses_to_pixels(problem, state, factored(problem, state), places.points, a), modes, places.points


def test_responses_do_not_depend_on_how_many_points_are_done_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    first = adjust(moved_block(), SETTINGS)
    whole, _, _ = responses(first)
    monkeypatch.setattr(functionals, "RESPONDING_AT_ONCE", 97)
    np.testing.assert_allclose(responses(first)[0], whole, rtol=1e-9, atol=1e-12 * np.abs(whole).max())


def test_a_block_moves_with_its_pixels_as_its_responses_say() -> None:
    """Another way to the same: the pixels are shifted, and everything is adjusted again."""
    first = adjust(moved_block(), SETTINGS)
    response, modes, points = responses(first)
    square, squares = squares_of(first.block.cameras[0], first.block.tie_points.pixel)
    for seed in range(3):
        shift_px = np.random.default_rng(seed).normal(scale=0.05, size=(squares, 2))
        second = adjust(moved_block(shift_px), SETTINGS)
        moved_m = (second.block.tie_points.position_world_m - first.block.tie_points.position_world_m)[points, 2]
        predicted = np.einsum("nrk,nr->k", response, shift_px[square])
        np.testing.assert_allclose(modes @ moved_m, predicted, rtol=0.02, atol=2e-4)


def test_predicted_tilt_and_bend_are_what_patterns_do() -> None:
    """Root mean squares over patterns as they are assumed, whose responses are exact, against the standard
    deviations."""
    rms_px = 0.3
    first = adjust(moved_block(np.random.default_rng(99).normal(scale=rms_px, size=(100, 2))), SETTINGS)
    problem = make_problem(first.block, SETTINGS)
    state = replace(start_state(problem), offset=first.estimates.offset_world_m)
    covariance_m2 = pattern_covariance_m2(problem, state, factored(problem, state))
    sigma_m = np.sqrt(np.diag(covariance_m2)[1:])
    found = residual_patterns(first)["simulated"]
    response, _, _ = responses(first)
    square, squares = squares_of(first.block.cameras[0], first.block.tie_points.pixel)
    at = np.column_stack([np.arange(squares) % 10, np.arange(squares) // 10])
    alike = np.exp(-np.sum((at[:, None] - at[None]) ** 2, axis=2) / ALIKE**2)
    shifts_px = np.random.default_rng(1).multivariate_normal(np.zeros(squares), alike, size=(400, 2), method="eigh")
    shifts_px = FOLLOWED * found.pattern_px * shifts_px.transpose(0, 2, 1)
    made = np.einsum("nrk,mnr->mk", response, shifts_px[:, square])
    np.testing.assert_allclose(np.sqrt(np.mean(made**2, axis=0)), sigma_m, rtol=0.15)
    known = block_deformation(first, SETTINGS, [camera.parameters for camera in first.block.cameras])
    np.testing.assert_allclose(known.pattern_sigma_m, sigma_m, rtol=1e-6)
    bent = replace(first, covariances=replace(first.covariances, deformation=known))
    (sentence,) = [w for w in diagnose(bent).warnings if "share a pattern" in w]
    assert f"domes it by {sigma_m[2]:.3f} m" in sentence


def test_without_a_significant_pattern_there_is_no_effect() -> None:
    right = adjusted(0.0)
    known = block_deformation(right, AdjustmentSettings(), [camera.parameters for camera in right.block.cameras])
    np.testing.assert_array_equal(known.pattern_sigma_m, 0.0)
    np.testing.assert_array_equal(known.model_error_covariance_m2, 0.0)


def test_a_focal_length_that_is_held_does_not_follow_a_pattern() -> None:
    """Its uncertainty counts in the covariances, but it stays where it is, whatever the pixels say."""
    shifted = moved_block(np.random.default_rng(99).normal(scale=0.3, size=(100, 2)))
    effects, variances = [], []
    for considered_px in (0.0, 5.0, 200.0):
        camera = shifted.cameras[0]
        held = replace(camera, sigmas=np.zeros_like(camera.sigmas), considered_focal_sigma_px=considered_px)
        result = adjust(replace(shifted, cameras=(held,)), SETTINGS)
        known = block_deformation(result, SETTINGS, [c.parameters for c in result.block.cameras])
        effects.append(known.model_error_covariance_m2)
        variances.append(np.mean(known.height_sigma_m**2))
    np.testing.assert_allclose(effects[1], effects[0], rtol=1e-6)
    np.testing.assert_allclose(effects[2], effects[0], rtol=1e-6)
    assert effects[0][0, 0] > 0.0
    assert variances[0] < variances[1] < variances[2]
