"""Blunders in control points and marks of simulated surveys: found, named, and not rejected on others."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.gross_errors.blunder_naming import Blunder, name_blunders
from photogram.amendments.gross_errors.data_snooping import Search, contradictions, search, without
from photogram.amendments.gross_errors.hypothesis import unmeasured
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.quality.accuracy import CheckAccuracy
from photogram.report.numbers.verdicts import control_test, control_verdict, effect_sentence
from photogram.report.record.ground import CheckPointsRecord
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=4, control_points=7, check_points=3,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip


@cache
def survey(origin_m: tuple[float, float, float] = PLAN.origin_map_m) -> Block:
    made = simulate_block(
        replace(PLAN, origin_map_m=origin_m), 3, tie_points=300, mismatches=0.02,
        start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3,
    )  # fmt: skip
    return made.block


def adjusted(block: Block) -> Adjustment:
    return adjust(block, AdjustmentSettings())


def judged(block: Block) -> Verdict:
    return adjust_with_snooping(block, AdjustmentSettings())


def surveyed(block: Block) -> FloatArray:
    return np.round(block.frame.map_from_world(block.control_points.position_world_m), 3)


def with_surveyed(block: Block, position_map_m: FloatArray) -> Block:
    points = replace(block.control_points, position_world_m=block.frame.world_from_map(position_map_m))
    return replace(block, control_points=points)


def with_marks(block: Block, pixel: FloatArray) -> Block:
    return replace(block, control_points=replace(block.control_points, mark_pixel=pixel))


def recorded(found: CheckAccuracy) -> CheckPointsRecord:
    """Return an accuracy as a report holds it."""
    return {
        "n": found.n,
        "n_axis": list(found.n_axis),
        "rmse_m": list(found.rmse_m),
        "mean_m": list(found.mean_m),
        "rmse_h_m": found.rmse_h_m,
        "rmse_v_m": found.rmse_v_m,
    }


def gross(block: Block) -> tuple[Blunder, ...]:
    """The blunders of a survey that goes on without them, nearly as good as the clean one."""
    verdict, clean = judged(block), judged(survey(block.frame.origin_map_m))
    assert not verdict.check_before.rmse_v_m < 2.0 * verdict.check_after.rmse_v_m, "worse with them, or nothing at all"
    assert verdict.check_after.rmse_h_m < clean.check_after.rmse_h_m + 0.01
    assert verdict.check_after.rmse_v_m < clean.check_after.rmse_v_m + 0.02
    assert contradictions(verdict.result) == []
    return verdict.blunders


def test_a_survey_without_blunders_is_left_as_it_is() -> None:
    verdict = judged(survey())
    assert verdict.blunders == ()
    assert verdict.check_before == verdict.check_after
    sentence = control_verdict(verdict.result, 0, [])
    assert sentence is not None
    assert sentence.startswith("agrees with all other observations (|w| at most ")
    assert control_verdict(verdict.result, 8, []) is None


def test_a_height_is_named_and_the_check_points_gain_without_it() -> None:
    place = surveyed(survey())
    place[2, 2] += 0.62
    verdict = judged(with_surveyed(survey(), place))
    (blunder,) = verdict.blunders
    assert (blunder.kind, blunder.points) == ("height", ("G03",))
    assert "predict a different height, -0.5" in blunder.sentence
    assert verdict.check_after.rmse_v_m < 0.5 * verdict.check_before.rmse_v_m
    effect = effect_sentence(recorded(verdict.check_before), recorded(verdict.check_after))
    assert effect is not None
    assert "with them in the adjustment, the RMSE of 3 check points would be" in effect


def test_a_mark_is_named_with_its_photograph() -> None:
    points = survey().control_points
    pixel = points.mark_pixel.copy()
    pixel[5] += (4.0, -3.0)
    (blunder,) = judged(with_marks(survey(), pixel)).blunders
    photograph = survey().photographs[points.mark_photograph[5]].name
    assert (blunder.kind, blunder.points, blunder.photograph) == (
        "mark",
        (points.name[points.mark_point[5]],),
        photograph,
    )


def test_exchanged_points_are_named() -> None:
    place = surveyed(survey())
    place[[1, 4]] = place[[4, 1]]
    (blunder,) = gross(with_surveyed(survey(), place))
    assert (blunder.kind, blunder.points) == ("exchanged points", ("G02", "G05"))


def test_a_mark_on_another_point_s_target_is_named() -> None:
    points = survey().control_points
    control = np.array(points.role)[points.mark_point] == "control"
    in_one = next(
        rows
        for i in range(len(survey().photographs))
        if len(rows := np.flatnonzero(control & (points.mark_photograph == i))) > 1
    )
    pixel = points.mark_pixel.copy()
    pixel[in_one[0]] = pixel[in_one[1]] + (0.3, 0.2)
    (blunder,) = gross(with_marks(survey(), pixel))
    names = tuple(points.name[points.mark_point[m]] for m in in_one[:2])
    assert (blunder.kind, blunder.points) == ("wrong target", names)


def mistyped(text: str, how: str) -> str:
    return (
        f"{text[0]}{(int(text[1]) + 3) % 10}{text[2:]}"
        if how == "one digit"
        else text[0] + text[2] + text[1] + text[3:]
    )


@pytest.mark.parametrize("how", ["one digit", "two exchanged"])
def test_a_mistyped_height_is_named_with_what_was_meant(how: str) -> None:
    place = surveyed(survey())
    meant = f"{place[3, 2]:.3f}"
    assert meant[1] != meant[2], "the simulated height must have digits that can be exchanged"
    place[3, 2] = float(mistyped(meant, how))
    (blunder,) = gross(with_surveyed(survey(), place))
    assert (blunder.kind, blunder.points) == ("mistyped", ("G04",))
    assert f"height {mistyped(meant, how)} looks mistyped for {meant}" in blunder.sentence


def test_exchanged_easting_and_northing_are_named() -> None:
    block = survey((500040.0, 500000.0, 120.0))
    place = surveyed(block)
    place[0, :2] = place[0, 1::-1]
    (blunder,) = gross(with_surveyed(block, place))
    assert (blunder.kind, blunder.points) == ("exchanged axes", ("G01",))


def test_two_blunders_are_both_named_and_nobody_else() -> None:
    place = surveyed(survey())
    place[2, 2] += 0.4
    place[5, 0] -= 0.35
    named = {(blunder.kind, blunder.points) for blunder in judged(with_surveyed(survey(), place)).blunders}
    assert named == {("height", ("G03",)), ("plan", ("G06",))}


def test_an_innocent_that_was_accused_beforehand_is_taken_back() -> None:
    points, photographs = survey().control_points, survey().photographs
    whole = unmeasured("control point", "G02")
    mark = unmeasured("mark", points.name[points.mark_point[0]], photographs[points.mark_photograph[0]].name)
    position, attitude = (unmeasured(kind, photographs[3].name) for kind in ("GNSS position", "attitude"))
    focal = unmeasured("focal length", survey().cameras[0].name)
    for rejected in ([whole], [mark], [whole, mark], [position], [attitude], [focal], [whole, position, focal]):
        found = search(survey(), adjusted(without(survey(), rejected)), adjusted, rejected)
        assert found.rejected == ()
        np.testing.assert_array_equal(
            found.result.estimates.ground_world_m, adjusted(survey()).estimates.ground_world_m
        )


def test_the_test_of_a_whole_point_is_the_quadratic_form_of_what_is_tested() -> None:
    off, covariance = np.array([0.1, np.nan, -0.2]), np.diag([0.01, np.nan, 0.04])
    test = control_test(off, covariance)
    assert test is not None
    assert test["value"] == pytest.approx(2.0)
    assert test["dof"] == 2
    assert test["p"] == pytest.approx(np.exp(-1.0))
    assert control_test(np.full(3, np.nan), covariance) is None


def test_no_statement_is_made_where_only_the_point_itself_determines() -> None:
    result = adjusted(survey())
    r = result.tests.reliability
    redundancy = r.ground_redundancy.copy()
    redundancy[0] = (0.5, 0.5, 0.0)
    sentence = control_verdict(
        replace(result, tests=replace(result.tests, reliability=replace(r, ground_redundancy=redundancy))), 0, []
    )
    assert sentence is not None
    assert sentence.startswith("no statement possible in height: this point alone determines it; agrees with")


def test_a_mark_that_no_lens_can_have_is_told_in_words() -> None:
    block = survey()
    result = adjusted(block)
    points = result.block.control_points
    g, i = int(points.mark_point[0]), int(points.mark_photograph[0])
    pose = result.block.poses[i]
    assert pose is not None
    place = result.estimates.ground_world_m.copy()
    place[g] = pose.position_world_m - 5.0 * pose.rotation_world_from_camera[:, 2]
    behind = replace(result, estimates=replace(result.estimates, ground_world_m=place))
    suspect = unmeasured("mark", points.name[g], block.photographs[i].name)
    (blunder,) = name_blunders(block, Search((suspect,), behind))
    assert "nan" not in blunder.sentence
    assert "beyond the edge of its lens" in blunder.sentence
