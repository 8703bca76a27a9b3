"""What residuals have in common, from noise with and without a pattern, and from blocks whose camera model is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment import AdjustmentSettings, adjust
from photogram.camera import Camera
from photogram.diagnosis import diagnose
from photogram.report.page_figures import residual_caption
from photogram.residual_patterns import residual_pattern, residual_patterns
from photogram.simulation import SurveyPlan, simulate_block
from photogram.survey import Adjustment, FloatArray

CAMERA = Camera("c", 4000, 3000, 2300.0, np.array([1999.5, 1499.5]))
NOISE_PX = 0.5


def places(count: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform([-0.5, -0.5], [3999.5, 2999.5], (count, 2))


def noise(count: int, seed: int) -> FloatArray:
    return np.random.default_rng(1000 + seed).normal(scale=NOISE_PX, size=(count, 2))


def wave(pixel: FloatArray, rms_px: float, length_px: float = 1600.0) -> FloatArray:
    """Return a pattern that is the same in all photographs: waves of the RMS for a coordinate."""
    phase = 2 * np.pi * pixel / length_px
    return np.sqrt(2.0) * rms_px * np.column_stack([np.sin(phase[:, 1]), np.cos(phase[:, 0])])


def test_noise_is_no_pattern() -> None:
    """What chance puts into the means is taken off: the pattern of noise is far below its standard error of a mean."""
    found = [residual_pattern(CAMERA, places(20_000, seed), noise(20_000, seed)) for seed in range(50)]
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
    """Adjust a simulated block whose pictures have a pattern that no parameter of its camera can follow."""
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
    sentence = next(w for w in diagnose(wrong).warnings if "have a pattern" in w)
    assert f"{found.pattern_px:.2g} px" in sentence
    assert "px: more than chance." in residual_caption("simulated", found)


def test_a_camera_that_the_model_fits_is_not() -> None:
    right = adjusted(0.0)
    found = residual_patterns(right)["simulated"]
    assert not found.significant
    assert not [w for w in diagnose(right).warnings if "have a pattern" in w]
    assert "px: too little to be told." in residual_caption("simulated", found)
    assert "in common" not in residual_caption("simulated", None)
