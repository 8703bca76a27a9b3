"""Wrong focal lengths and picture sizes told from height systems: simulated surveys whose error is known."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from photogram.project.validation.height_shift import HeightEvidence, height_shift
from photogram.project.validation.heights import _evidence_of_block
from photogram.project.validation.image_scale import ScaleFit, fit_scales
from photogram.simulation.observations import simulate_block
from photogram.simulation.survey_plan import SurveyPlan, rtk_plan, whole_survey_plan

PLANS: dict[str, SurveyPlan] = {
    "laboratory": SurveyPlan(control_points=6),
    "five points": replace(rtk_plan(), control_points=5),
    "low": replace(rtk_plan(), control_points=6, flying_height_m=30.0),
    "tilted gimbal": replace(rtk_plan(oblique=True), control_points=6, attitude_sigma_deg=3.0),
}
SURE = np.zeros(1)
OPEN = np.arange(-60.0, 61.0, 10.0)


@lru_cache(maxsize=16)
def evidence(plan: str, seed: int) -> HeightEvidence:
    return _evidence_of_block(simulate_block(PLANS[plan], seed, tie_points=50).block, "control")


def raised(given: HeightEvidence, by_m: float) -> HeightEvidence:
    position = given.points.position_world_m + np.array([0.0, 0.0, by_m])
    return replace(given, points=replace(given.points, position_world_m=position))


def in_pictures(given: HeightEvidence, scale: float) -> HeightEvidence:
    """Marks measured in pictures of another size: the corner of the top-left pixel, at -0.5, is common."""
    pixel = (given.points.mark_pixel + 0.5) * scale - 0.5
    return replace(given, points=replace(given.points, mark_pixel=pixel))


def stated_focal(given: HeightEvidence, factor: float) -> HeightEvidence:
    return replace(given, cameras=[replace(c, focal_px=c.focal_px * factor) for c in given.cameras])


def best(given: HeightEvidence) -> ScaleFit:
    return fit_scales(given, SURE)[0]


@pytest.mark.parametrize("plan", PLANS)
def test_a_sound_survey_has_no_scale(plan: str) -> None:
    for seed in range(6):
        for shifts_m in (SURE, OPEN):
            fits = fit_scales(evidence(plan, seed), shifts_m)
            assert not any(fit.significant for fit in fits)


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("scale", [0.5, 0.75, 0.9])
def test_marks_of_smaller_pictures_are_known_by_their_corner(plan: str, scale: float) -> None:
    for seed in range(2):
        given = in_pictures(evidence(plan, seed), scale)
        fit, shift = best(given), height_shift(given)
        assert (fit.kind, fit.significant) == ("picture size", True)
        assert fit.scale == pytest.approx(scale, rel=0.03)
        assert shift is None or fit.cost < shift.cost - 3.0


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("factor", [1.3, 0.7])
def test_a_wrong_focal_length_explains_as_much_as_a_shift_of_heights(plan: str, factor: float) -> None:
    for seed in range(2):
        given = stated_focal(evidence(plan, seed), factor)
        fit, shift = best(given), height_shift(given)
        assert (fit.kind, fit.significant) == ("focal length", True)
        assert fit.scale == pytest.approx(1.0 / factor, rel=0.03)
        assert shift is not None
        assert fit.cost < shift.cost + 3.0


@pytest.mark.parametrize("plan", PLANS)
def test_a_geoid_height_is_no_focal_length(plan: str) -> None:
    for seed in range(2):
        given = raised(evidence(plan, seed), -44.0)
        shift = height_shift(given)
        assert shift is not None
        for fit in fit_scales(given, SURE):
            assert fit.cost > shift.cost + 0.02 * (fit.cost_without - shift.cost)


def test_pictures_are_told_without_heights_too() -> None:
    for seed in range(3):
        given = evidence("five points", seed)
        fits = fit_scales(in_pictures(given, 0.5), OPEN)
        assert [fit.kind for fit in fits] == ["picture size"]
        assert fits[0].significant
        assert fits[0].scale == pytest.approx(0.5, rel=0.03)
        for by_m in (-44.0, 18.0):
            assert not any(fit.significant for fit in fit_scales(raised(given, by_m), OPEN))
        for factor in (1.3, 0.7):
            assert not any(fit.significant for fit in fit_scales(stated_focal(given, factor), OPEN))


def test_nothing_is_fitted_to_too_few_marks() -> None:
    given = evidence("five points", 1)
    assert fit_scales(replace(given, points=given.points.with_role("check")), SURE) == []


@pytest.mark.parametrize("seed", range(4))
def test_positions_of_a_consumer_drone_raise_no_alarm_and_show_half_size(seed: int) -> None:
    plan = replace(whole_survey_plan(), gnss_offset_sigma_m=(3.0, 3.0, 30.0))
    given = _evidence_of_block(simulate_block(plan, seed, tie_points=50).block, "control")
    assert not any(fit.significant for fit in fit_scales(given, OPEN))
    (fit,) = fit_scales(in_pictures(given, 0.5), OPEN)
    assert fit.significant
    assert fit.scale == pytest.approx(0.5, abs=0.03)
