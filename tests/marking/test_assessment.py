"""What marks say while they are made, in simulated surveys whose truth is known."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from makers import in_best_photograph, marks_of, without_marks

from photogram.errors import AdjustmentError
from photogram.files.tables.surveyed_points import Mark, MarkKey, PointRole, Proposal, SurveyedPoint
from photogram.marking.files.actions import MarkState
from photogram.marking.page.assessment import (
    RAW_SIGMA_PX,
    agreeing_proposals,
    assessed,
    is_off_target,
    isotropic_px,
    marked_block,
)
from photogram.marking.page.snapping import Snapped
from photogram.marking.predictions import predicted_places
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import SimulatedBlock, simulate_block, whole_survey_plan
from photogram.survey import Block

PLAN = replace(whole_survey_plan(), control_points=12, check_points=4)


@pytest.fixture(scope="module")
def made() -> SimulatedBlock:
    return simulate_block(PLAN, 1)


@pytest.fixture(scope="module")
def whole(made: SimulatedBlock) -> Block:
    """A survey of tags and all its marks."""
    return tagged_block(made.block)


@pytest.fixture(scope="module")
def numbers(whole: Block) -> dict[str, int]:
    return {p.name: i for i, p in enumerate(whole.photographs)}


def roles_of(block: Block) -> dict[str, PointRole]:
    return dict(zip(block.control_points.name, block.control_points.role, strict=True))


def marks_of_points(block: Block, points: Iterable[int]) -> dict[MarkKey, Mark]:
    """The simulated marks of points, as a person has made them."""
    sigma = float(block.control_points.mark_sigma_px[0])
    every = (mark for g in points for mark in marks_of(block, g))
    return {(point, name): Mark(point, name, pixel, (sigma, sigma), kind="circle") for point, name, pixel in every}


def state_of(marks: dict[MarkKey, Mark], *added: SurveyedPoint) -> MarkState:
    return MarkState(marks, frozenset(), {}, {point.name: point for point in added})


def moved(mark: Mark, du: float) -> Mark:
    return replace(mark, pixel=(mark.pixel[0] + du, mark.pixel[1]))


# ---- the block of a snapshot -----------------------------------------------------------------------------------------


def test_points_and_marks_are_in_order_and_the_rest_is_left(whole: Block, numbers: dict[str, int]) -> None:
    names = whole.control_points.name
    order = (names[5], names[2], names[7])
    marks = marks_of_points(whole, (2, 5, 9))
    odd = Mark(names[2], "of another survey.jpg", (1.0, 2.0))
    block = marked_block(whole, state_of({**marks, odd.key: odd}), dict.fromkeys(order, "control"), numbers)
    made = block.control_points
    assert made.name == order
    np.testing.assert_array_equal(made.position_world_m, whole.control_points.position_world_m[[5, 2, 7]])
    np.testing.assert_array_equal(made.sigma_m, whole.control_points.sigma_m[[5, 2, 7]])
    pairs = list(zip(made.mark_point.tolist(), made.mark_photograph.tolist(), strict=True))
    assert pairs == sorted(pairs)
    assert {(order[g], whole.photographs[i].name) for g, i in pairs} == {p for p in marks if p[0] != names[9]}
    for m, (g, i) in enumerate(pairs):
        assert tuple(made.mark_pixel[m]) == marks[order[g], whole.photographs[i].name].pixel
    assert (block.poses, block.cameras, block.photographs) == (whole.poses, whole.cameras, whole.photographs)


def test_roles_decide_what_is_control_and_what_has_no_coordinates(whole: Block, numbers: dict[str, int]) -> None:
    a, b, c = whole.control_points.name[:3]
    made = marked_block(whole, state_of({}), {a: "check", b: "tie", c: "control"}, numbers).control_points
    assert made.role == ("check", "check", "control")
    assert np.isfinite(made.position_world_m).all(axis=1).tolist() == [True, False, True]
    assert np.isinf(made.sigma_m[1]).all()


def test_a_point_that_was_added_lies_where_the_map_says(whole: Block, numbers: dict[str, int]) -> None:
    east, north, height = PLAN.origin_map_m
    name = whole.control_points.name[0]
    sigma = (0.01, 0.02, 0.03)
    state = state_of(
        {},
        SurveyedPoint("new", (east, north, height + 4.0), sigma),
        SurveyedPoint("roof"),
        SurveyedPoint(name, PLAN.origin_map_m, sigma),
    )
    made = marked_block(whole, state, {"new": "control", "roof": "tie", name: "control"}, numbers).control_points
    np.testing.assert_allclose(made.position_world_m[[0, 2]], [[0.0, 0.0, 4.0], [0.0, 0.0, 0.0]], atol=1e-6)
    np.testing.assert_array_equal(made.sigma_m[[0, 2]], [sigma, sigma])
    assert np.isnan(made.position_world_m[1]).all()


def test_a_mark_has_one_standard_deviation_with_the_same_mean_square(whole: Block, numbers: dict[str, int]) -> None:
    point, photograph, pixel = marks_of(whole, 0)[0]
    mark = Mark(point, photograph, pixel, (0.3, 0.4))
    assert isotropic_px(mark) == pytest.approx(np.sqrt((0.09 + 0.16) / 2.0))
    assert isotropic_px(replace(mark, sigma_px=None)) == RAW_SIGMA_PX
    made = marked_block(whole, state_of({mark.key: mark}), roles_of(whole), numbers).control_points
    assert made.mark_sigma_px.tolist() == [isotropic_px(mark)]


def test_a_mark_is_off_target_where_it_is_farther_than_its_standard_deviation_allows() -> None:
    click, variance_px2 = Mark("P", "a.jpg", (100.0, 50.0), (1.0, 1.0)), 0.01 * np.eye(2)
    assert is_off_target(click, Snapped((104.0, 50.0), variance_px2, "circle"))
    assert not is_off_target(click, Snapped((102.0, 52.0), variance_px2, "circle"))
    assert is_off_target(replace(click, sigma_px=(0.2, 0.2)), Snapped((100.5, 50.7), variance_px2, "circle"))


# ---- what the marks say --------------------------------------------------------------------------------------------


def test_without_marks_the_tags_say_where_points_are(whole: Block, numbers: dict[str, int]) -> None:
    said = assessed(whole, state_of({}), roles_of(whole), numbers)
    alone = predicted_places(without_marks(whole))
    assert said.problem == ""
    assert said.comparison is None
    assert not said.compared
    assert said.places is not None
    np.testing.assert_allclose(said.places.pixel, alone.pixel, atol=1e-6)
    assert said.names == whole.control_points.name
    assert said.sigma_m(said.names[0]) is None
    np.testing.assert_array_equal(said.position_world_m, whole.control_points.position_world_m)


def test_marks_of_some_points_shrink_all_ellipses(made: SimulatedBlock, whole: Block, numbers: dict[str, int]) -> None:
    state = state_of(marks_of_points(whole, range(6)), SurveyedPoint("roof"), SurveyedPoint("cellar"))
    name, photograph, pixel = "roof", *marks_of(whole, 8)[0][1:]
    second = marks_of(whole, 8)[1]
    roof = {
        (name, photograph): Mark(name, photograph, pixel, (0.3, 0.3)),
        (name, second[1]): Mark(name, second[1], second[2], (0.3, 0.3)),
    }
    state = replace(state, marks={**state.marks, **roof})
    roles: dict[str, PointRole] = {**roles_of(whole), name: "tie", "cellar": "tie"}
    said = assessed(whole, state, roles, numbers)
    assert said.problem == ""
    assert said.comparison is not None
    assert said.places is not None
    assert not any(one.rejected for one in said.compared.values())
    assert set(said.compared) <= set(state.marks)
    assert len(said.compared) > 0.8 * len(state.marks)
    before = predicted_places(without_marks(whole))
    assert np.median(said.places.radius_px) < 0.7 * np.median(before.radius_px)
    sigma = said.sigma_m(said.names[0])
    assert sigma is not None
    assert (sigma <= 1.01 * whole.control_points.sigma_m[0]).all(), "its survey alone says as much"
    assert said.sigma_m(whole.control_points.name[9]) is None, "nobody has marked it"
    assert said.sigma_m("cellar") is None
    assert said.sigma_m("?") is None
    off_m = said.position_world_m[said.names.index(name)] - made.truth.control_position_world_m[8]
    assert np.linalg.norm(off_m[:2]) < 10.0, "two rays of poses that are 2 m and 1° off"
    assert np.isnan(said.position_world_m[said.names.index("cellar")]).all()


def test_a_mark_that_contradicts_the_others_is_rejected(whole: Block, numbers: dict[str, int]) -> None:
    marks = marks_of_points(whole, range(16))
    wrong = in_best_photograph(whole)[:2]
    marks[wrong] = moved(marks[wrong], 30.0)
    said = assessed(whole, state_of(marks), roles_of(whole), numbers)
    assert [place for place, one in said.compared.items() if one.rejected] == [wrong]
    np.testing.assert_allclose(said.compared[wrong].off_px, [30.0, 0.0], atol=4.0)
    assert said.comparison is not None
    assert any(wrong[1] in str(blunder) for blunder in said.comparison.blunders)


def test_a_click_off_a_target_has_no_other_mark_accused(whole: Block, numbers: dict[str, int]) -> None:
    """With five marks in a photograph that tags place to 2 m, another explains 5 px of one nearly as well."""
    marks, place = marks_of_points(whole, range(16)), ("G10", "sim_0018.JPG")
    assert sum(photograph == place[1] for _, photograph in marks) == 5
    meant = {place: Snapped(marks[place].pixel, 0.01 * np.eye(2), "checker")}
    accused = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False).tolist():
        u, v = marks[place].pixel + 5.0 * np.array([np.cos(angle), np.sin(angle)])
        state = state_of({**marks, place: replace(marks[place], pixel=(u, v), sigma_px=None, kind="raw")})
        alone, said = (assessed(whole, state, roles_of(whole), numbers, off_target) for off_target in ({}, meant))
        accused += [at for at, one in alone.compared.items() if one.rejected and at != place]
        assert not any(one.rejected for at, one in said.compared.items() if at != place)
        assert said.off_target == meant
    assert accused, "or the test shows nothing"


def test_where_marks_cannot_be_compared_the_block_without_them_says_the_places(
    whole: Block, numbers: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_comparison(*_: object) -> None:
        raise AdjustmentError("photograph 3 is not determined")

    monkeypatch.setattr("photogram.marking.page.assessment.compared_marks", no_comparison)
    state = state_of(marks_of_points(whole, (0, 1)))
    said = assessed(whole, state, roles_of(whole), numbers)
    assert said.problem == "photograph 3 is not determined"
    assert said.comparison is None
    assert said.sigma_m(said.names[0]) is None
    assert said.places is not None
    np.testing.assert_allclose(said.places.pixel, predicted_places(without_marks(whole)).pixel, atol=1e-6)
    assert said.marks == state.marks


def test_where_nothing_says_anything_there_are_no_places(whole: Block, numbers: dict[str, int]) -> None:
    lost = replace(whole, poses=tuple(None for _ in whole.poses))
    for marks in ({}, marks_of_points(whole, (0, 1))):
        said = assessed(lost, state_of(marks), roles_of(whole), numbers)
        assert said.places is None
        assert "no photograph" in said.problem
        assert not said.compared
        np.testing.assert_array_equal(said.position_world_m, whole.control_points.position_world_m)


# ---- proposals that agree ------------------------------------------------------------------------------------------


def test_true_proposals_agree_and_one_that_is_30_px_off_does_not(whole: Block, numbers: dict[str, int]) -> None:
    every = marks_of_points(whole, range(16))
    kept = {place: mark for place, mark in every.items() if place[0] in whole.control_points.name[:4]}
    proposals = {place: Proposal(mark, 0.9) for place, mark in every.items() if place not in kept}
    wrong = next(place for place in proposals if sum(p[0] == place[0] for p in proposals) > 5)
    proposals[wrong] = Proposal(moved(every[wrong], 30.0), 0.95)
    rare = {place for place in proposals if sum(p[0] == place[0] for p in proposals) < 3}
    found = agreeing_proposals(whole, state_of(kept), roles_of(whole), numbers, proposals)
    assert wrong not in found
    assert not found & rare
    assert not found & set(kept)
    assert len(found) >= 0.95 * len(set(proposals) - rare - {wrong})
    assert len(proposals) > 40


def test_two_proposals_of_a_point_agree_with_nobody(whole: Block, numbers: dict[str, int]) -> None:
    every = marks_of_points(whole, range(12))
    name = whole.control_points.name[8]
    kept = {place: mark for place, mark in every.items() if place[0] != name}
    own = {place: Proposal(mark, 0.9) for place, mark in every.items() if place[0] == name}
    assert len(own) >= 3
    two = dict(list(own.items())[:2])
    assert not agreeing_proposals(whole, state_of(kept), roles_of(whole), numbers, two)
    three = dict(list(own.items())[:3])
    assert agreeing_proposals(whole, state_of(kept), roles_of(whole), numbers, three) == set(three)
    first = next(iter(three))
    one_marked = {**kept, first: every[first]}
    two = {place: proposal for place, proposal in three.items() if place != first}
    assert agreeing_proposals(whole, state_of(one_marked), roles_of(whole), numbers, two) == set(two)


def test_a_mark_counts_where_it_is_proposed_elsewhere(whole: Block, numbers: dict[str, int]) -> None:
    """What a person has marked is not the proposal's to change."""
    every = marks_of_points(whole, range(8))
    place = next(iter(every))
    odd = {place: Proposal(moved(every[place], 40.0), 0.9)}
    assert agreeing_proposals(whole, state_of(every), roles_of(whole), numbers, odd) <= {place}
    strange = {("?", place[1]): Proposal(Mark("?", place[1], (5.0, 5.0)), 1.0)}
    assert not agreeing_proposals(whole, state_of(every), roles_of(whole), numbers, strange)
