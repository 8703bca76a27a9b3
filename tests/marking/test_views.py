"""What the page is told of a session."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from makers import in_best_photograph, marks_of, wait_until_assessed, without_marks

from photogram.amendments.gross_errors.blunder_naming import Blunder
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint
from photogram.marking.mark_comparison import ComparedMark
from photogram.marking.page.session import MarkingSession
from photogram.marking.page.snapping import Snapped
from photogram.marking.page.views import LEAST_SPAN_PX, Views, accused, off_target_words, said_of, span_px
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan

PLAN = replace(whole_survey_plan(), control_points=24, check_points=4)


def test_a_survey_before_between_and_after_its_marks(tmp_path: Path) -> None:
    whole = tagged_block(simulate_block(PLAN, 2).block)
    session = MarkingSession(without_marks(whole), tmp_path / "j", tmp_path / "marks.csv")
    views = Views(session)
    before = views.state()
    names = [point["name"] for point in before["points"]]
    assert before["first"] == names[0]
    assert names == list(whole.control_points.name)
    assert before["computing"]
    assert views.point(names[0])["photographs"] == [], "it is not known yet, but will be"
    session.start()
    wait_until_assessed(session)
    told = views.point(names[0])
    assert 0 < len(told["photographs"]) <= len(whole.photographs)
    assert told["span_px"] > LEAST_SPAN_PX
    inside = [p["inside"] for p in told["photographs"]]
    assert inside == sorted(inside, reverse=True)
    for g in range(len(names)):
        for mark in marks_of(whole, g):
            session.mark(*mark)
    wrong = in_best_photograph(whole)
    session.mark(wrong[0], wrong[1], (wrong[2][0] + 25.0, wrong[2][1]))
    wait_until_assessed(session)
    after, point = views.state(), views.point(wrong[0])
    json.dumps([after, point, views.plan()], allow_nan=False)
    assert [p["name"] for p in after["points"] if p["wrong"]] == [wrong[0]]
    assert any(wrong[1] in sentence for sentence in after["blunders"])
    (bad,) = [p for p in point["photographs"] if p["rejected"]]
    assert bad["name"] == wrong[1]
    assert "others put it" in bad["words"]
    good = [p for p in after["points"] if not p["wrong"]]
    assert all("sigma of the point" in p["words"] for p in good if p["marks"] > 2)
    assert any(p["enough"] for p in good)
    session.close()


def test_a_point_that_was_added_is_shown_without_coordinates(tmp_path: Path) -> None:
    whole = tagged_block(simulate_block(PLAN, 2).block)
    session = MarkingSession(without_marks(whole), tmp_path / "j", tmp_path / "marks.csv")
    views = Views(session)
    session.add_point(SurveyedPoint("roof"))
    assert views.state()["points"][-1] | {"words": "", "short": ""} == {
        "name": "roof",
        "role": "tie",
        "surveyed": False,
        "marks": 0,
        "proposals": 0,
        "wrong": False,
        "doubtful": 0,
        "enough": False,
        "words": "",
        "short": "",
    }
    assert "roof" not in [place["name"] for place in views.plan()["points"]]
    with pytest.raises(KeyError):
        views.point("cellar")
    session.close()


def test_who_owns_the_target_that_a_mark_is_on_is_innocent() -> None:
    assert accused(Blunder("wrong target", ("P1", "P2"), "a.JPG", "")) == ("P1",)
    assert accused(Blunder("exchanged points", ("P1", "P2"), None, "")) == ("P1", "P2")


def test_words_of_a_click_off_a_target() -> None:
    mark = Mark("P1", "a.JPG", (100.0, 50.0))
    target = Snapped((103.0, 54.0), np.eye(2), "checker")
    assert off_target_words(mark, target) == "5.0 px off the centre of a checker target"
    matched = Snapped((100.0, 45.0), np.eye(2), "matched")
    assert off_target_words(mark, matched) == "5.0 px off what the other marks show"


def test_a_point_that_tells_most_comes_next_and_none_that_has_enough(tmp_path: Path) -> None:
    plan = replace(whole_survey_plan(), control_points=4, check_points=1)
    block = tagged_block(simulate_block(plan, 1).block)
    session = MarkingSession(without_marks(block), tmp_path / "j", tmp_path / "marks.csv")
    views = Views(session)
    session.start()
    wait_until_assessed(session)
    first, *others = block.control_points.name
    following = views.point(first)["next"]
    assert following in others
    seen = {name: len(views.point(name)["photographs"]) for name in others}
    assert seen[str(following)] > min(seen.values()), "a point of two photographs tells less than one of ten"
    session.close()


def test_words_of_a_mark() -> None:
    def compared(rejected: bool, *fits: str) -> ComparedMark:
        return ComparedMark(0, np.array([6.0, 1.6]), np.eye(2), fits, rejected)

    assert said_of(compared(True, "P7"), 4) == (
        "6.2 px from where the four others put it, 1.4 px expected; it would fit P7"
    )
    assert said_of(compared(True), 1) == "6.2 px from where the other puts it, 1.4 px expected"
    assert said_of(compared(False), 12) == "6.2 px from the 12 others, 1.4 px expected"
    assert said_of(compared(False), 3, is_calibrated=False).endswith("1.4 px expected before calibration")


def test_right_marks_are_as_far_from_the_others_as_is_expected_before_calibration(tmp_path: Path) -> None:
    """Marks of four points at their true places, while only tags place the photographs: tens of px, none accused."""
    block = tagged_block(simulate_block(PLAN, 2).block)
    points = block.control_points
    few = points.mark_point < 4
    marked = replace(
        points,
        mark_point=points.mark_point[few],
        mark_photograph=points.mark_photograph[few],
        mark_pixel=points.mark_pixel[few],
        mark_covariance_px2=points.mark_covariance_px2[few],
    )
    session = MarkingSession(replace(block, control_points=marked), tmp_path / "j", tmp_path / "marks.csv")
    session.start()
    wait_until_assessed(session)
    shown = [p for name in points.name[:4] for p in Views(session).point(name)["photographs"] if p["mark"]]
    assessment = session.snapshot().assessment
    session.close()
    assert assessment is not None
    compared = list(assessment.compared.values())
    assert len(compared) == few.sum()
    assert np.median([one.distance_px for one in compared]) > 20.0
    assert 0.7 < np.sqrt(np.mean([(one.distance_px / one.expected_px) ** 2 for one in compared])) < 1.4
    assert not any(photograph["rejected"] for photograph in shown)
    assert all(p["words"].endswith("px expected before calibration") for p in shown)


def test_the_ellipse_fills_a_third_of_a_patch() -> None:
    assert span_px([100.0, 90.0, 300.0], [(4000, 3000)]) == 600.0
    assert span_px([2.0], [(4000, 3000)]) == LEAST_SPAN_PX
    assert span_px([1e5], [(4000, 3000)]) == 4000.0
