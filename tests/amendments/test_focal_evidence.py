"""A focal length that something moves which the camera model leaves out: not believed, and not held without a sigma."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.self_calibration import held_parameters
from photogram.amendments.amendment import Proposal, Solution
from photogram.amendments.focal_evidence import FocalLengths
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block

SETTINGS = AdjustmentSettings(lens_field="none")
LENS = 0.06
"""k1 of a lens that the given camera does without: its pictures pull the focal length, each part by another amount."""

PLAN = replace(
    whole_survey_plan(800), strips=3, photographs_per_strip=6, calibration_source="laboratory", control_points=0,
    check_points=6, relief_m=8.0, radial=(LENS, 0.0, 0.0, 0.0), tangential=(0.0, 0.0),
    calibration_sigmas=(0.02 * 800 / 1.2, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip


def block_of(plan: SurveyPlan, seed: int) -> Block:
    block = simulate_block(
        plan, seed, tie_points=1500, sigma_px=0.3, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5
    ).block
    return replace(block, cameras=(replace(block.cameras[0], focal_px=plan.focal_px, radial=np.zeros(4)),))


@cache
def judged(plan: SurveyPlan = PLAN, seed: int = 2) -> Verdict:
    return adjust_with_snooping(block_of(plan, seed), SETTINGS)


def test_the_source_is_not_rejected_where_parts_of_the_pictures_disagree() -> None:
    verdict = judged()
    decision = verdict.focal_lengths["simulated"]
    assert abs(decision.says.focal_px - PLAN.focal_px) > 3.0 * decision.given_sigma_px, "the pictures want another"
    assert decision.says.model_sigma_px > 3.0 * decision.says.formal_sigma_px
    assert not decision.says.trustworthy
    assert not [b for b in verdict.blunders if b.kind == "focal length"]


def test_a_settled_focal_length_that_cannot_be_adjusted_ends_no_survey(monkeypatch: pytest.MonkeyPatch) -> None:
    propose = FocalLengths.propose

    def undetermined(self: FocalLengths, solution: Solution) -> Proposal | None:
        proposal = propose(self, solution)
        if proposal is None:
            return None
        nothing = tuple(
            replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
            for p in proposal.block.photographs
        )
        return replace(proposal, block=replace(proposal.block, photographs=nothing))

    monkeypatch.setattr(FocalLengths, "propose", undetermined)
    verdict = adjust_with_snooping(block_of(PLAN, 2), SETTINGS)
    assert verdict.result.converged
    assert verdict.focal_lengths == {}
    assert [b.kind for b in verdict.blunders] == ["focal length"]
    (warning,) = [w for w in verdict.result.warnings if w.startswith("The focal length of simulated contradicts")]
    assert "could not be settled" in warning


def test_what_is_settled_lies_near_the_source_and_its_sigma_counts() -> None:
    verdict = judged()
    result, decision = verdict.result, verdict.focal_lengths["simulated"]
    camera, sigma = result.block.cameras[0], float(np.sqrt(result.covariances.calibration[0, 0, 0]))
    assert camera.focal_px == decision.settled.focal_px
    assert sigma == pytest.approx(decision.settled.sigma_px, rel=1e-6)
    assert abs(camera.focal_px - PLAN.focal_px) < abs(decision.says.focal_px - PLAN.focal_px)
    assert abs(camera.focal_px - PLAN.focal_px) < 3.0 * sigma
    height_m = np.sqrt(np.median(result.covariances.tie_point_m2[:, 2, 2]))
    assert height_m > 0.7 * sigma / camera.focal_px * PLAN.flying_height_m
    given = (replace(camera, focal_px=PLAN.focal_px),)
    assert (
        "parts of the images disagree" in held_parameters(given, result, verdict.focal_lengths)["simulated"]["focal_px"]
    )


def test_with_the_lens_in_the_model_there_is_nothing_to_settle() -> None:
    right = replace(PLAN, calibration_sigmas=(0.02 * 800 / 1.2, 2.0, 2.0, 0.5, 0.1, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert judged(right).focal_lengths == {}
    assert judged(right).rejected == ()
