"""Wrong inputs of every kind, on equal terms: left out and named, nobody else accused, the survey as good as clean."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.gross_errors.blunder_naming import withdrawn_attitudes
from photogram.amendments.gross_errors.data_snooping import contradictions, scatter, simplified, without
from photogram.amendments.gross_errors.hypothesis import unmeasured
from photogram.amendments.gross_errors.robust_start import gross_suspects
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.errors import AdjustmentError
from photogram.sfm.mark_scale import picture_factor
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

SETTINGS = AdjustmentSettings()
RTK = SurveyPlan(
    strips=3, photographs_per_strip=5, forward_overlap=0.78, control_points=7, check_points=4,
    gnss_sigma_m=(0.02, 0.02, 0.03), gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip
NO_GNSS = replace(RTK, gnss_tags=False)


@cache
def survey(plan: SurveyPlan = RTK, seed: int = 5) -> Block:
    return simulate_block(
        plan, seed, tie_points=300, mismatches=0.02, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3
    ).block


@cache
def clean(plan: SurveyPlan = RTK) -> Verdict:
    return adjust_with_snooping(survey(plan), SETTINGS)


def with_photograph(block: Block, i: int, **changed: Any) -> Block:
    photographs = list(block.photographs)
    photographs[i] = replace(photographs[i], **changed)
    return replace(block, photographs=tuple(photographs))


def moved(block: Block, i: int, off_m: Sequence[float]) -> Block:
    position = block.photographs[i].gnss_world_m
    assert position is not None
    return with_photograph(block, i, gnss_world_m=position + np.array(off_m))


def with_pixels(block: Block, pixel: FloatArray) -> Block:
    return replace(block, control_points=replace(block.control_points, mark_pixel=pixel))


def with_focal(block: Block, factor: float) -> Block:
    camera: Camera = block.cameras[0]
    given = factor * RTK.focal_px
    changed = replace(camera, focal_px=given, sigmas=np.concatenate([[0.03 * given], camera.sigmas[1:]]))
    return replace(block, cameras=(changed,))


def assert_as_good_as_clean(verdict: Verdict, plan: SurveyPlan = RTK) -> None:
    before, after = clean(plan).check_after, verdict.check_after
    assert after.n == before.n
    assert after.rmse_h_m < before.rmse_h_m + 0.015
    assert after.rmse_v_m < before.rmse_v_m + 0.025
    assert contradictions(verdict.result) == []


def test_a_clean_survey_is_accused_of_nothing() -> None:
    for plan in (RTK, NO_GNSS):
        assert clean(plan).rejected == ()
        assert gross_suspects(survey(plan), SETTINGS).suspects == ()


@pytest.mark.parametrize(
    "off_m", [(0.4, -0.2, 0.1), (1.2, 0.9, 0.0), (-4.0, 3.0, 0.0), (12.0, 0.0, 2.0), (60.0, 80.0, 0.0)]
)
def test_a_wrong_gnss_position_is_named_and_no_control_point(off_m: Sequence[float]) -> None:
    verdict = adjust_with_snooping(moved(survey(), 7, off_m), SETTINGS)
    (blunder,) = verdict.blunders
    assert (blunder.kind, blunder.photograph) == ("GNSS position", survey().photographs[7].name)
    predicted_m = float(blunder.sentence.split("predict it ")[1].split()[0])
    assert predicted_m == pytest.approx(float(np.linalg.norm(off_m)), abs=0.1)
    assert_as_good_as_clean(verdict)
    assert verdict.result.block.photographs[7].gnss_world_m is None


def test_a_turned_attitude_is_named() -> None:
    attitude = survey().photographs[4].attitude_world_from_camera
    assert attitude is not None
    for angle in (8.0, 40.0, 170.0):
        turned = attitude @ Rotation.from_rotvec(np.radians(angle) * np.array([0.6, 0.0, 0.8])).as_matrix()
        verdict = adjust_with_snooping(with_photograph(survey(), 4, attitude_world_from_camera=turned), SETTINGS)
        (blunder,) = verdict.blunders
        assert (blunder.kind, blunder.photograph) == ("attitude", survey().photographs[4].name)
        assert float(blunder.sentence.split(" by ")[1].split("°")[0]) == pytest.approx(angle, abs=4.0)
        assert_as_good_as_clean(verdict)


@pytest.mark.parametrize("factor", [0.8, 0.88, 1.15])
def test_a_wrong_focal_length_is_named_and_no_control_point(factor: float) -> None:
    verdict = adjust_with_snooping(with_focal(survey(), factor), SETTINGS)
    (blunder,) = verdict.blunders
    assert (blunder.kind, blunder.camera) == ("focal length", "simulated")
    camera = verdict.result.block.cameras[0]
    sigma = float(np.sqrt(verdict.result.covariances.calibration[0, 0, 0]))
    assert abs(camera.focal_px - RTK.focal_px) < 3.0 * sigma
    assert 0.0 < sigma < 0.01 * RTK.focal_px
    assert verdict.focal_lengths["simulated"].says.trustworthy
    assert_as_good_as_clean(verdict)


def test_two_wrong_inputs_at_once_do_not_hide_each_other() -> None:
    points = survey().control_points
    pixel, m = points.mark_pixel.copy(), int(np.flatnonzero(points.mark_point == 2)[0])
    pixel[m] = pixel[m][::-1] * 0.4 + 30.0
    both = with_focal(moved(with_pixels(survey(), pixel), 9, (5.0, 5.0, 0.0)), 1.15)
    verdict = adjust_with_snooping(both, SETTINGS)
    assert {b.kind for b in verdict.blunders} <= {"mark", "wrong target", "GNSS position", "focal length"}
    assert {a.what for a in verdict.rejected} == {
        ("mark", points.name[2], survey().photographs[points.mark_photograph[m]].name),
        ("GNSS position", survey().photographs[9].name, None),
        ("focal length", "simulated", None),
    }
    assert_as_good_as_clean(verdict)


@pytest.mark.parametrize("plan", [RTK, NO_GNSS], ids=["RTK", "no GNSS"])
@pytest.mark.parametrize("off_m", [1.0, 30.0, 1000.0])
def test_a_mistyped_point_is_named_whatever_its_size(plan: SurveyPlan, off_m: float) -> None:
    points = survey(plan).control_points
    position = points.position_world_m.copy()
    position[3, 1] += off_m
    spoilt = replace(survey(plan), control_points=replace(points, position_world_m=position))
    verdict = adjust_with_snooping(spoilt, SETTINGS)
    assert {a.what for a in verdict.rejected} == {("control point", points.name[3], None)}
    assert_as_good_as_clean(verdict, plan)


def test_gnss_off_control_as_a_whole_is_one_offset_and_no_point_is_accused() -> None:
    block = survey()
    for i in range(len(block.photographs)):
        block = moved(block, i, (0.3, -0.2, 0.5))
    verdict = adjust_with_snooping(block, SETTINGS)
    (blunder,) = verdict.blunders
    assert blunder.kind == "GNSS offset"
    result = verdict.result
    sigma = np.sqrt(np.diag(result.covariances.offset_m2[0]))
    assert np.all(np.abs(result.estimates.offset_world_m[0] - [-0.3, 0.2, -0.5]) < 3.0 * sigma)
    assert_as_good_as_clean(verdict)


def test_a_mark_of_a_check_point_far_from_the_others_is_named() -> None:
    points = survey().control_points
    g = int(np.flatnonzero(np.array(points.role) == "check")[0])
    own = np.flatnonzero(points.mark_point == g)
    assert len(own) >= 4
    pixel = points.mark_pixel.copy()
    pixel[own[1]] += (250.0, -180.0)
    verdict = adjust_with_snooping(with_pixels(survey(), pixel), SETTINGS)
    assert {a.what for a in verdict.rejected} == {
        ("mark", points.name[g], survey().photographs[points.mark_photograph[own[1]]].name)
    }
    assert_as_good_as_clean(verdict)


def test_sigmas_that_are_too_small_for_all_accuse_nobody() -> None:
    """RTK said to be good to a quarter of what it is: not forty wrong positions, but a wrong sigma."""
    block = survey()
    for i, photograph in enumerate(block.photographs):
        assert photograph.gnss_sigma_m is not None
        block = with_photograph(block, i, gnss_sigma_m=0.25 * photograph.gnss_sigma_m)
    verdict = adjust_with_snooping(block, SETTINGS)
    assert not [a for a in verdict.rejected if a.kind == "GNSS position"]
    assert scatter(verdict.result)["GNSS position"] > 1.2


@pytest.mark.parametrize("factor", [0.5, 0.9, 2.0])
def test_marks_of_pictures_of_another_size_are_named_as_that(factor: float) -> None:
    points = survey().control_points
    oriented = replace(survey(), poses=clean().result.block.poses)
    block = with_pixels(oriented, (points.mark_pixel + 0.5) * factor - 0.5)
    found = picture_factor(block)
    assert found == pytest.approx(1.0 / factor, rel=0.01)
    verdict = adjust_with_snooping(block, SETTINGS)
    (blunder,) = verdict.blunders
    assert blunder.kind == "picture size"
    assert f"multiplied by {found:.3g}" in blunder.sentence
    assert picture_factor(oriented) is None


def test_a_point_with_wrong_coordinates_and_marks_is_simplified_to_the_whole_point() -> None:
    whole = [unmeasured("control point", "G01"), unmeasured("mark", "G01", "a.jpg"), unmeasured("mark", "G02", "a.jpg")]
    assert [(a.kind, a.name, a.axes) for a in simplified(whole)] == [
        ("mark", "G02", (0, 1)),
        ("control point", "G01", (0, 1, 2)),
    ]
    assert simplified(whole[1:]) == whole[1:]


def test_what_is_left_out_does_not_touch_the_result() -> None:
    """A left-out coordinate or mark may have any value: the result is the same to the last bit."""
    points = survey().control_points
    names = [p.name for p in survey().photographs]
    accused = [
        unmeasured("control point", points.name[1]),
        unmeasured("mark", points.name[points.mark_point[0]], names[points.mark_photograph[0]]),
        unmeasured("GNSS position", names[3]),
        unmeasured("attitude", names[6]),
    ]
    position, pixel = points.position_world_m.copy(), points.mark_pixel.copy()
    position[1] += (3.0, -2.0, 1.0)
    pixel[0] += 40.0
    spoilt = replace(survey(), control_points=replace(points, position_world_m=position, mark_pixel=pixel))
    spoilt = moved(spoilt, 3, (4.0, 4.0, 4.0))
    results = [adjust(without(block, accused), SETTINGS) for block in (survey(), spoilt)]
    for a, b in zip(*(r.block.poses for r in results), strict=True):
        assert a is not None
        assert b is not None
        np.testing.assert_array_equal(a.position_world_m, b.position_world_m)
    np.testing.assert_array_equal(results[0].estimates.ground_world_m, results[1].estimates.ground_world_m)
    assert results[0].redundancy == results[1].redundancy
    assert results[0].sigma0 == results[1].sigma0


def test_attitudes_that_were_withdrawn_beforehand_are_named_unless_a_whole_flight_lost_them() -> None:
    believed = with_photograph(survey(), 2, attitude_world_from_camera=None, attitude_sigma_rad=None)
    (blunder,) = withdrawn_attitudes(survey(), believed, clean().result)
    assert (blunder.kind, blunder.photograph) == ("attitude", survey().photographs[2].name)
    everyone = survey()
    for i in range(len(everyone.photographs)):
        everyone = with_photograph(everyone, i, heading_known=False)
    assert withdrawn_attitudes(survey(), everyone, clean().result) == []


def test_attitudes_of_a_whole_flight_are_named_together_with_what_they_are_off_by() -> None:
    pitched, believed = survey(), survey()
    turn = Rotation.from_rotvec(np.deg2rad([10.0, 0.0, 0.0])).as_matrix()
    for i, pose in enumerate(clean().result.block.poses):
        assert pose is not None
        off = pose.rotation_world_from_camera @ turn
        pitched = with_photograph(pitched, i, attitude_world_from_camera=off, attitude_sigma_rad=0.03)
        believed = with_photograph(believed, i, attitude_world_from_camera=None, attitude_sigma_rad=None)
    (blunder,) = withdrawn_attitudes(pitched, believed, clean().result)
    assert blunder.kind == "attitude"
    assert f"attitudes of {len(pitched.photographs)} photographs of flight" in blunder.sentence
    assert "by 10.0° in common (about the camera's axes right, down, forward +10.0, " in blunder.sentence
    assert "and by 0.0° beside that" in blunder.sentence


def test_where_too_little_is_left_every_culprit_is_named() -> None:
    """Three control points hold a block without GNSS; the marks of two of them lie elsewhere in all photographs."""
    plan = replace(NO_GNSS, control_points=3)
    points, rng = survey(plan).control_points, np.random.default_rng(1)
    wrong = np.isin(points.mark_point, [0, 1])
    pixel = points.mark_pixel.copy()
    pixel[wrong] = rng.uniform([0.0, 0.0], [plan.width_px - 1.0, plan.height_px - 1.0], (int(wrong.sum()), 2))
    with pytest.raises(AdjustmentError) as fault:
        adjust_with_snooping(with_pixels(survey(plan), pixel), SETTINGS)
    assert "too few are left without it" in str(fault.value)
    for name in points.name[:2]:
        assert f"mark of {name} in sim_" in str(fault.value)
