"""What a read-out time can be taken for: correlations against estimated time offsets, and against simulated surveys."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.shutters.readout_correlations import Correlations
from photogram.projection import READOUT
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import CommonError

SETTINGS = AdjustmentSettings(common_errors="none", lens_field="none")
ONE_STRIP = SurveyPlan(
    width_px=1600, height_px=1200, focal_px=1333.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.7,
    strips=1, photographs_per_strip=10, control_points=6, check_points=1, speed_m_s=8.0, velocity_tags=True,
    gnss_offset_sigma_m=(0.0, 0.0, 0.0), calibration_sigmas=(40.0, 16.0, 16.0, 0.1, 0.1, 0.05, 0.0, 0.003, 0.003, 0, 0),
    readout_s=0.033, readout_sigma_s=0.05,
)  # fmt: skip
FORWARD = replace(ONE_STRIP, strips=2, photographs_per_strip=6, oblique_strip=True, control_points=0)
"""With a strip that looks forward a read-out time moves what a time offset moves: seen at another time, elsewhere."""
TIME_OFFSET = CommonError("time_offset", None, 0, np.ones(1), np.zeros(1))


@cache
def adjusted(plan: SurveyPlan, seed: int, time_offset: bool = False) -> Adjustment:
    """Adjust a survey whose read-out time is stated as 30 ± 50 ms, so that it is estimated from the start."""
    block = simulate_block(plan, seed, tie_points=200, sigma_px=0.4).block
    block = replace(block, cameras=(replace(block.cameras[0], readout_s=0.03),))
    return adjust(replace(block, common_errors=(TIME_OFFSET,)) if time_offset else block, SETTINGS)


def test_a_time_offset_that_is_held_correlates_as_one_that_is_estimated() -> None:
    for seed in (1, 2):
        without, beside = adjusted(FORWARD, seed), adjusted(FORWARD, seed, time_offset=True)
        assert beside.decisions.common_errors[-1].error.kind == "time_offset"
        rho, expected = (float(r.decisions.readout_time_offset_correlation[0]) for r in (without, beside))
        assert abs(expected) > 0.5
        assert rho == pytest.approx(expected, abs=0.05)
        # what it would cost the read-out time is what it costs it
        grown = 1.0 / np.sqrt(1.0 - rho**2)
        formal = [float(np.sqrt(r.covariances.calibration[0, READOUT, READOUT])) for r in (without, beside)]
        assert formal[1] / formal[0] == pytest.approx(grown, rel=0.15)


def test_the_correlation_with_the_focal_length_is_that_of_the_covariance() -> None:
    result = adjusted(ONE_STRIP, 1)
    covariance = result.covariances.calibration[0]
    expected = covariance[0, READOUT] / np.sqrt(covariance[0, 0] * covariance[READOUT, READOUT])
    assert float(result.decisions.readout_focal_correlation[0]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("plan", "surveys"), [(FORWARD, 16), (ONE_STRIP, 40)])
def test_estimates_of_many_surveys_correlate_as_predicted(plan: SurveyPlan, surveys: int) -> None:
    """Within two standard errors (1 − ρ²) / √n of a correlation from n surveys."""
    forward = plan is FORWARD
    found = [adjusted(plan, seed, time_offset=forward) for seed in range(1, surveys + 1)]
    T = [float(r.decisions.readout_s[0]) for r in found]
    if forward:
        other = [float(r.decisions.common_errors[-1].estimate[0]) for r in found]
        predicted = float(np.mean([r.decisions.readout_time_offset_correlation[0] for r in found]))
    else:
        other = [r.block.cameras[0].focal_px for r in found]
        predicted = float(np.mean([r.decisions.readout_focal_correlation[0] for r in found]))
    assert predicted < -0.3, "else zero would do as well"
    error = (1.0 - predicted**2) / np.sqrt(surveys)
    assert np.corrcoef(T, other)[0, 1] == pytest.approx(predicted, abs=2.0 * error)


def test_what_nothing_tells_has_no_correlation() -> None:
    """On one strip at one speed a time offset is a shift of the whole block; without positions there is none to see."""
    alone = adjusted(replace(ONE_STRIP, control_points=0), 1)
    assert np.isnan(alone.decisions.readout_time_offset_correlation).all()
    assert np.isfinite(alone.decisions.readout_focal_correlation).all()
    still = adjust(simulate_block(replace(ONE_STRIP, readout_s=0.0, readout_sigma_s=0.0), 1, tie_points=200).block,
                   SETTINGS)  # fmt: skip
    assert np.isnan(still.decisions.readout_focal_correlation).all()
    fixed = replace(ONE_STRIP, calibration_sigmas=(0.0,) * 11)
    assert np.isnan(adjusted(fixed, 1).decisions.readout_focal_correlation).all()
    assert np.isfinite(adjusted(fixed, 1).decisions.readout_time_offset_correlation).all()


def test_a_read_out_time_that_is_not_told_from_another_unknown_is_warned_of() -> None:
    told = Correlations(np.array([0.96, -0.5, np.nan]), np.array([0.2, -0.97, np.nan]))
    focal, offset = told.warnings(["A", "B", "C"])
    assert "Camera A" in focal
    assert "focal length (correlation +0.96)" in focal
    assert "Camera B" in offset
    assert "time offset between exposures and GNSS positions (correlation -0.97)" in offset
