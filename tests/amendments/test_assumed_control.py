"""Control points of assumed sigmas: what the others predict for some of them, and who is named, against real
adjustments without them and against the truth."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.gross_errors.assumed_control import (
    ALARMS,
    AssumedControl,
    outlying_points,
    scatter_of_assumed,
)
from photogram.amendments.gross_errors.data_snooping import hypotheses, without
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.results import Adjustment
from photogram.simulation.observations import simulate_block
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block, Role

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=6, gnss_tags=False, control_points=9, check_points=4, control_sigma_m=(2.0,) * 3
)
SETTINGS = AdjustmentSettings(estimate_sigmas=False, lens_field="none", robust_loss="none", outlier_threshold=50.0)


@cache
def block_of(sigma_m: float, wrong: int = 0, scatter_m: float = 2.0) -> Block:
    """Return a block whose control points scatter by 2 m, of which some are off by 25 m more, alike."""
    plan = replace(PLAN, control_sigma_m=(scatter_m,) * 3)
    block = simulate_block(plan, 2, tie_points=500, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.2).block
    points = block.control_points
    position = points.position_world_m.copy()
    position[:wrong] += [6.0, 14.0, 20.0]
    sigma = np.full((len(points), 3), sigma_m)
    alone = np.array([role == "control" for role in points.role])
    points = replace(points, position_world_m=position, sigma_m=sigma, sigma_assumed=alone)
    return replace(block, control_points=points)


@cache
def adjusted(sigma_m: float, wrong: int = 0, scatter_m: float = 2.0) -> Adjustment:
    return adjust(block_of(sigma_m, wrong, scatter_m), SETTINGS)


def of_control(result: Adjustment) -> list[Hypothesis]:
    return [a for a in hypotheses(result) if a.kind == "control point"]


def test_one_point_is_predicted_as_its_reliability_says() -> None:
    result = adjusted(2.0)
    control, tests = AssumedControl.of(result), result.tests.reliability
    for g in range(3):
        own = control.point == g
        solved = control.solved(~own, 1.0)
        assert solved is not None
        off, Q = solved
        np.testing.assert_allclose(off[own], tests.ground_left_out_m[g], rtol=1e-4, atol=1e-4)
        C = np.diag(control.variance_m2[own]) + Q[np.ix_(own, own)]
        np.testing.assert_allclose(C, tests.ground_left_out_covariance_m2[g], rtol=1e-3, atol=1e-3)


def test_two_points_are_predicted_as_an_adjustment_without_them_does() -> None:
    result = adjusted(0.05, scatter_m=0.05)
    block, names = result.block, result.block.control_points.name
    control = AssumedControl.of(result)
    own = np.isin(control.point, [0, 4])
    solved = control.solved(~own, 1.0)
    assert solved is not None
    rejected = [unmeasured("control point", names[g]) for g in (0, 4)]
    real = adjust(without(block_of(0.05, scatter_m=0.05), rejected), SETTINGS)
    off = real.estimates.ground_world_m[[0, 4]] - block.control_points.position_world_m[[0, 4]]
    np.testing.assert_allclose(solved[0][own], off.ravel(), atol=0.005)  # of 2 to 15 cm
    covariance = real.covariances.ground_m2[[0, 4]]
    for k in range(2):
        own_k = np.flatnonzero(own)[3 * k : 3 * k + 3]
        np.testing.assert_allclose(solved[1][np.ix_(own_k, own_k)], covariance[k], rtol=0.05, atol=5e-5)


def test_the_scatter_of_the_points_is_found_whatever_was_assumed() -> None:
    for sigma_m in (0.5, 2.0, 8.0):
        assert scatter_of_assumed(adjusted(sigma_m)) == pytest.approx(2.0 / sigma_m, rel=0.35)
    assert scatter_of_assumed(adjusted(8.0)) == pytest.approx(0.25 * scatter_of_assumed(adjusted(2.0)), rel=0.08)


def test_two_points_that_hide_each_other_are_named_together() -> None:
    result = adjusted(8.0, 2)
    names = result.block.control_points.name
    first, second, *_ = sorted(outlying_points(result, of_control(result)), key=lambda a: a.log_chance)
    assert {first.name, second.name} == set(names[:2])
    assert first.together == (second.name,)
    assert first.log_chance < np.log(ALARMS / 9)
    assert len(first.axes) == 3


def test_nobody_is_named_where_nobody_is_wrong() -> None:
    for sigma_m in (0.5, 2.0, 8.0):
        result = adjusted(sigma_m)
        assert min(a.log_chance for a in outlying_points(result, of_control(result))) > np.log(ALARMS / 9)


def test_both_are_rejected_as_a_whole_and_stay_so() -> None:
    block = block_of(0.03, 2)
    verdict = adjust_with_snooping(block, AdjustmentSettings(lens_field="none"))
    rejected = [a for a in verdict.rejected if a.kind == "control point"]
    assert {a.name for a in rejected} == set(block.control_points.name[:2])
    assert {a.axes for a in rejected} == {(0, 1, 2)}


@pytest.mark.parametrize("count", [3, 4])
def test_too_few_points_name_nobody(count: int) -> None:
    block = block_of(2.0)
    points = block.control_points
    roles: list[Role] = ["control" if g < count else "check" for g in range(len(points))]
    result = adjust(replace(block, control_points=points.with_roles(roles)), SETTINGS)
    tests = of_control(result)
    assert len(tests) >= count - 3  # three points alone contradict nobody
    assert all(a.log_chance == 0.0 for a in outlying_points(result, tests))
    if count == 3:
        assert scatter_of_assumed(result) == 1.0
