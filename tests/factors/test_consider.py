"""Focal lengths that are held and whose uncertainty counts: against the derivative of the adjustment itself."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.quality.improvements import block_deformation
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=5, check_points=3,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), gnss_offset_sigma_m=(0.3, 0.3, 0.5),
)  # fmt: skip
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=50.0, relative_tolerance=1e-12)
SIGMA_PX = 25.0


@cache
def survey() -> Block:
    return simulate_block(PLAN, 4, tie_points=200, start_position_sigma_m=0.2, start_attitude_sigma_deg=0.2).block


@cache
def held(focal_px: float, considered_px: float = 0.0) -> Adjustment:
    camera = survey().cameras[0]
    sigmas = np.concatenate([[0.0], camera.sigmas[1:]])
    changed = replace(camera, focal_px=focal_px, sigmas=sigmas, considered_focal_sigma_px=considered_px)
    return adjust(replace(survey(), cameras=(changed,)), SETTINGS)


def test_covariances_are_those_of_the_held_block_and_what_the_focal_length_moves() -> None:
    """Σ = Σ_held + S D Sᵀ, S from two adjustments with the focal length held a little higher and lower."""
    f, step = survey().cameras[0].focal_px, 0.5
    plain, counted = held(f), held(f, SIGMA_PX)
    np.testing.assert_allclose(counted.estimates.ground_world_m, plain.estimates.ground_world_m, atol=1e-9)
    higher, lower = held(f + step), held(f - step)
    for name in ("ground", "position"):
        if name == "ground":
            S = (higher.estimates.ground_world_m - lower.estimates.ground_world_m) / (2.0 * step)
            before, after = plain.covariances.ground_m2, counted.covariances.ground_m2
        else:
            places = [np.array([p.position_world_m for p in r.block.poses if p is not None]) for r in (higher, lower)]
            S = (places[0] - places[1]) / (2.0 * step)
            before, after = plain.covariances.position_m2, counted.covariances.position_m2
        expected = before + SIGMA_PX**2 * S[:, :, None] * S[:, None, :]
        np.testing.assert_allclose(after, expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max())
    assert counted.covariances.calibration[0, 0, 0] == pytest.approx(SIGMA_PX**2, rel=1e-6)
    assert plain.covariances.calibration[0, 0, 0] == 0.0


def test_tests_of_residuals_allow_for_the_focal_length() -> None:
    """An error of the held focal length stays in the residuals: their covariance grows, the tests fall."""
    f = survey().cameras[0].focal_px + 20.0
    plain, counted = held(f), held(f, SIGMA_PX)
    for name in ("ground_redundancy", "mark_redundancy", "gnss_redundancy"):
        a, b = getattr(plain.tests.reliability, name), getattr(counted.tests.reliability, name)
        known = np.isfinite(a)
        assert np.all(b[known] >= a[known] - 1e-9)
        assert b[known].sum() > a[known].sum() + 1e-4
    worst = [float(np.nanmax(np.abs(r.tests.reliability.gnss_w))) for r in (plain, counted)]
    assert worst[1] <= worst[0]


def test_the_deformation_of_the_block_counts_it_too() -> None:
    f = survey().cameras[0].focal_px
    sigma = [
        block_deformation(result, SETTINGS, [c.parameters for c in result.block.cameras]).height_sigma_m.mean()
        for result in (held(f), held(f, SIGMA_PX))
    ]
    assert sigma[1] > 1.01 * sigma[0]
