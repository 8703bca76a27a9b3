"""Contradicting height systems, found from marks alone: simulated surveys whose heights are known."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from photogram.project.validation.height_shift import HeightEvidence, HeightShift, height_shift
from photogram.project.validation.heights import _evidence_of_block
from photogram.simulation.observations import simulate_block
from photogram.simulation.survey_plan import SurveyPlan, rtk_plan, whole_survey_plan

PLANS: dict[str, SurveyPlan] = {
    "RTK, laboratory": SurveyPlan(control_points=6),
    "RTK, five points": replace(rtk_plan(), control_points=5),
    "RTK, low": replace(rtk_plan(), control_points=6, flying_height_m=30.0),
    "RTK, EXIF": replace(whole_survey_plan(), gnss_sigma_m=(0.02, 0.02, 0.04), gnss_offset_sigma_m=(0.1, 0.1, 0.15)),
    "RTK, tilted gimbal": replace(rtk_plan(oblique=True), control_points=6, attitude_sigma_deg=3.0),
}
SEEDS = 6


@lru_cache(maxsize=64)
def evidence(plan: str, seed: int) -> HeightEvidence:
    return _evidence_of_block(simulate_block(PLANS[plan], seed, tie_points=50).block, "control")


def raised(given: HeightEvidence, by_m: float, points: slice = slice(None)) -> HeightEvidence:
    position = given.points.position_world_m.copy()
    position[points, 2] += by_m
    return replace(given, points=replace(given.points, position_world_m=position))


def without_attitudes(given: HeightEvidence) -> HeightEvidence:
    return replace(given, rotation_world_from_camera=np.full_like(given.rotation_world_from_camera, np.nan))


def found(given: HeightEvidence) -> HeightShift:
    shift = height_shift(given)
    assert shift is not None
    return shift


@pytest.mark.parametrize("plan", PLANS)
def test_heights_of_one_system_agree_within_the_predicted_sigma(plan: str) -> None:
    shifts = [found(evidence(plan, seed)) for seed in range(SEEDS)]
    scores = np.array([s.shift_m / s.sigma_m for s in shifts])
    assert np.abs(scores).max() < 3.0
    assert np.sqrt(np.mean(scores**2)) < 1.5
    assert max(s.sigma_m for s in shifts) < 6.0


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("by_m", [-44.0, -18.0, 37.0, 80.0])
def test_a_shift_is_found_wherever_the_search_starts(plan: str, by_m: float) -> None:
    # 80 m raises the control above the cameras
    for seed in range(2):
        plain = found(evidence(plan, seed))
        shift = found(raised(evidence(plan, seed), by_m))
        assert shift.shift_m + by_m == pytest.approx(plain.shift_m, abs=0.06)
        assert shift.flying_height_m == pytest.approx(plain.flying_height_m, abs=0.06)


def test_two_points_in_a_photograph_tell_it_without_attitudes() -> None:
    for seed in range(4):
        blind = without_attitudes(evidence("RTK, laboratory", seed))
        assert abs(found(blind).shift_m) < 3.0 * found(blind).sigma_m
        assert found(raised(blind, -44.0)).shift_m == pytest.approx(44.0 + found(blind).shift_m, abs=0.06)


def test_flying_height_is_that_of_the_plan() -> None:
    for seed in range(3):
        shift = found(raised(evidence("RTK, low", seed), -44.0))
        assert shift.flying_height_m == pytest.approx(30.0, abs=6.0)


def test_one_wrong_height_is_no_shift() -> None:
    given = evidence("RTK, laboratory", 1)
    shift = found(raised(given, -44.0, slice(0, 1)))
    assert abs(shift.shift_m) < max(5.0, 4.0 * shift.sigma_m)


def test_one_wrong_mark_is_no_shift() -> None:
    given = evidence("RTK, laboratory", 2)
    pixel = given.points.mark_pixel.copy()
    pixel[0] = [1199.0, 899.0] - pixel[0]
    shift = found(replace(given, points=replace(given.points, mark_pixel=pixel)))
    assert abs(shift.shift_m) < 3.0 * shift.sigma_m


def test_nothing_is_said_of_what_cannot_be_known() -> None:
    given = evidence("RTK, five points", 1)
    nowhere = replace(given, gnss_world_m=np.full_like(given.gnss_world_m, np.nan))
    assert height_shift(nowhere) is None
    one = given.points.with_role("check")
    assert height_shift(replace(given, points=one)) is None
    assert height_shift(raised(given, 400.0)) is None  # no geoid is that high
