"""A focal length that something moves which the camera model leaves out: not believed, and not held without a sigma."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import AdjustmentSettings
from photogram.adjustment.self_calibration import held_parameters
from photogram.quality.gross_errors.snooped_adjustment import Verdict, adjust_and_judge
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block, whole_survey_plan

SETTINGS = AdjustmentSettings()
LENS = 0.06
"""k1 of a lens that the given camera does without: its pictures pull the focal length, each part by another amount."""

PLAN = replace(
    whole_survey_plan(800), strips=3, photographs_per_strip=6, calibration_source="laboratory", control_points=0,
    check_points=6, relief_m=8.0, radial=(LENS, 0.0, 0.0, 0.0), tangential=(0.0, 0.0),
    calibration_sigmas=(0.02 * 800 / 1.2, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip


@cache
def judged(plan: SurveyPlan = PLAN, seed: int = 2) -> Verdict:
    block = simulate_block(
        plan, seed, tie_points=1500, sigma_px=0.3, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5
    ).block
    camera = replace(block.cameras[0], focal_px=plan.focal_px, radial=np.zeros(4))
    return adjust_and_judge(replace(block, cameras=(camera,)), SETTINGS)


def test_the_source_is_not_rejected_where_parts_of_the_pictures_disagree() -> None:
    verdict = judged()
    decision = verdict.focal_lengths["simulated"]
    assert abs(decision.says.focal_px - PLAN.focal_px) > 3.0 * decision.given_sigma_px, "the pictures want another"
    assert decision.says.model_sigma_px > 3.0 * decision.says.formal_sigma_px
    assert not decision.says.trustworthy
    assert not [b for b in verdict.blunders if b.kind == "focal length"]


def test_what_is_settled_lies_near_the_source_and_its_sigma_counts() -> None:
    verdict = judged()
    result, decision = verdict.result, verdict.focal_lengths["simulated"]
    camera, sigma = result.block.cameras[0], float(np.sqrt(result.calibration_covariance[0, 0, 0]))
    assert camera.focal_px == decision.settled.focal_px
    assert sigma == pytest.approx(decision.settled.sigma_px, rel=1e-6)
    assert abs(camera.focal_px - PLAN.focal_px) < abs(decision.says.focal_px - PLAN.focal_px)
    assert abs(camera.focal_px - PLAN.focal_px) < 3.0 * sigma
    height_m = np.sqrt(np.median(result.tie_point_covariance_m2[:, 2, 2]))
    assert height_m > 0.7 * sigma / camera.focal_px * PLAN.flying_height_m
    given = (replace(camera, focal_px=PLAN.focal_px),)
    assert (
        "parts of the images disagree" in held_parameters(given, result, verdict.focal_lengths)["simulated"]["focal_px"]
    )


def test_with_the_lens_in_the_model_there_is_nothing_to_settle() -> None:
    right = replace(PLAN, calibration_sigmas=(0.02 * 800 / 1.2, 2.0, 2.0, 0.5, 0.1, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert judged(right).focal_lengths == {}
    assert judged(right).rejected == ()
