"""Sigmas that nobody has stated, of GNSS positions, control points and marks: known scatter, blunders, bounds."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.stochastic_model.assumed_sigmas import BEND_OF_CONTROL, LEAST_M, assumed_steady, robust_factor
from photogram.adjustment.stochastic_model.estimated_sigmas import with_assumed_sigmas, with_control_assumed
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=4, photographs_per_strip=6, control_points=5, check_points=2, flights=2,
    gnss_sigma_m=(0.4, 0.4, 0.8), gnss_offset_sigma_m=(2.0, 2.0, 3.0),
)  # fmt: skip
ASSUMED_M = np.array([2.0, 2.0, 3.0])
NAMES = "kind", "stated_sigma", "used_sigma"


def assumed(plan: SurveyPlan, seed: int) -> Block:
    """A survey with the sigmas of a receiver that states none."""
    block = simulate_block(
        plan, seed, tie_points=300, start_position_sigma_m=0.1, start_attitude_sigma_deg=0.1, start_point_sigma_m=0.1
    ).block
    photographs = tuple(replace(p, gnss_sigma_m=ASSUMED_M, gnss_sigma_assumed=True) for p in block.photographs)
    return replace(block, photographs=photographs)


def test_the_factor_is_that_of_the_scatter_and_a_blunder_moves_it_little() -> None:
    rng = np.random.default_rng(1)
    r = rng.uniform(0.2, 1.0, 4000)
    w = 0.3 * rng.standard_normal(4000)
    assert robust_factor(w, r) == pytest.approx(0.3, rel=0.05)
    few, of_few = w[:40].copy(), r[:40]
    before = robust_factor(few, of_few)
    few[0] = 1e3
    assert robust_factor(few, of_few) < 1.15 * before


def test_sigmas_are_found_for_each_flight_in_plan_and_in_height() -> None:
    ratios = []
    for seed in range(5):
        result = adjust(assumed(PLAN, seed), AdjustmentSettings())
        s = result.decisions.sigmas
        mine = np.char.startswith(s.kind, "gnss")
        assert list(zip(s.kind[mine].tolist(), s.of[mine].tolist(), strict=True)) == [
            ("gnss_plan", "1"), ("gnss_height", "1"), ("gnss_plan", "2"), ("gnss_height", "2"),
        ]  # fmt: skip
        np.testing.assert_allclose(s.stated_sigma[mine], [2.0, 3.0, 2.0, 3.0])
        np.testing.assert_allclose(s.estimated_sigma[mine], s.used_sigma[mine], rtol=0.021)
        used = np.array([p.gnss_sigma_m for p in result.block.photographs])
        np.testing.assert_allclose(used[0], [s.used_sigma[mine][0]] * 2 + [s.used_sigma[mine][1]])
        ratios.append(s.used_sigma[mine] / [0.4, 0.8, 0.4, 0.8])
    # redundancies are 20 in plan and 11 in height, so that one estimate has a standard deviation of 0.16 and 0.22
    both_flights = np.reshape(ratios, (10, 2))
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(both_flights), axis=0)), 1.0, atol=0.25)


def test_what_is_stated_or_has_no_offset_stays() -> None:
    block = assumed(PLAN, 1)
    stated = replace(block, photographs=tuple(replace(p, gnss_sigma_assumed=False) for p in block.photographs))
    without_offset = replace(block, gnss_offset_sigma_m=np.zeros(3))
    for given in (stated, without_offset):
        result = adjust(given, AdjustmentSettings())
        assert not np.char.startswith(result.decisions.sigmas.kind, "gnss").any()
        for photograph in result.block.photographs:
            np.testing.assert_array_equal(photograph.gnss_sigma_m, ASSUMED_M)


def test_no_sigma_falls_below_the_bound() -> None:
    result = adjust(assumed(replace(PLAN, gnss_sigma_m=(0.01, 0.01, 0.01)), 2), AdjustmentSettings())
    gnss = np.char.startswith(result.decisions.sigmas.kind, "gnss")
    np.testing.assert_allclose(result.decisions.sigmas.used_sigma[gnss], LEAST_M)


# ---- control points and marks ----------------------------------------------------------------------------------------

HAND_HELD = SurveyPlan(
    strips=4, photographs_per_strip=6, gnss_tags=False, control_points=10, check_points=6,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip
STATED_M = np.array([0.03, 0.03, 0.05])


def listed(seed: int, sigma_m: float, *, assumed: bool = True, wrong: int = 0) -> tuple[Block, FloatArray, set[str]]:
    """A survey whose list of points, of this accuracy, names none; ``wrong`` of them are 10 sigma off."""
    plan = replace(HAND_HELD, control_sigma_m=(sigma_m,) * 3)
    made = simulate_block(plan, seed, tie_points=800, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.2)
    points = made.block.control_points
    position, names = points.position_world_m.copy(), set[str]()
    for g in np.flatnonzero(np.array(points.role) == "control")[:wrong].tolist():
        position[g, :2] += 10.0 * sigma_m * np.array([1.0, (-1.0) ** g])
        names.add(points.name[g])
    every = np.full(len(points), assumed)
    points = replace(
        points, position_world_m=position, sigma_m=np.tile(STATED_M, (len(points), 1)), sigma_assumed=every,
        mark_sigma_assumed=np.zeros(len(points), dtype=bool),
    )  # fmt: skip
    return replace(made.block, control_points=points), made.truth.control_position_world_m, names


def errors_over_sigmas(result: Adjustment, truth: FloatArray) -> FloatArray:
    check = np.array(result.block.control_points.role) == "check"
    off = result.estimates.ground_world_m[check] - truth[check]
    return np.asarray(off / np.sqrt(np.einsum("gii->gi", result.covariances.ground_m2[check])))


def test_points_of_a_hand_held_receiver_scatter_and_nobody_is_accused() -> None:
    z, factors = list[FloatArray](), list[float]()
    for seed in range(8):
        block, truth, _ = listed(seed, 2.0)
        verdict = adjust_with_snooping(block, AdjustmentSettings())
        assert verdict.blunders == ()
        points = verdict.result.block.control_points
        factors.append(float(np.median(points.sigma_m[points.used])) / 2.0)
        z.append(errors_over_sigmas(verdict.result, truth))
    assert 0.75 < float(np.median(factors)) < 1.35
    assert 0.7 < float(np.sqrt(np.mean(np.square(z)))) < 1.35


def test_wrong_points_are_named_by_what_the_others_scatter() -> None:
    named = 0
    for seed in range(6):
        block, _, wrong = listed(seed, 2.0, wrong=1)
        rejected = {a.name for a in adjust_with_snooping(block, AdjustmentSettings()).rejected}
        assert rejected <= wrong
        named += rejected == wrong
    assert named >= 5


def test_what_is_assumed_holds_where_points_say_nothing_else_and_falls_where_they_do() -> None:
    used = []
    for sigma_m in (0.03, 0.005):
        block, _, _ = listed(3, sigma_m)
        result = adjust_with_snooping(block, AdjustmentSettings()).result
        points = result.block.control_points
        used.append(float(np.median(points.sigma_m[points.used])))
        rows = {k: (s, u) for k, s, u in zip(*(getattr(result.decisions.sigmas, n) for n in NAMES), strict=True)}
        assert rows["control_plan"][0] == pytest.approx(0.03)
        assert rows["control_height"][0] == pytest.approx(0.05)
    assert 0.015 < used[0] < 0.06
    assert used[1] < 0.7 * used[0]


def test_stated_sigmas_that_most_points_contradict_are_said_to_be_wrong() -> None:
    block, truth, _ = listed(1, 2.0, assumed=False)
    verdict = adjust_with_snooping(block, AdjustmentSettings())
    assert verdict.blunders == ()
    assert "contradicted by a factor of" in verdict.result.warnings[0]
    assert verdict.contradicted > 20.0
    again = with_assumed_sigmas(with_control_assumed(block), verdict.result.decisions.sigmas)
    np.testing.assert_allclose(again.control_points.sigma_m, verdict.result.block.control_points.sigma_m)
    assert float(np.sqrt(np.mean(np.square(errors_over_sigmas(verdict.result, truth))))) < 2.5
    right, _, _ = listed(1, 0.03, assumed=False)
    stated = adjust_with_snooping(right, AdjustmentSettings()).result
    assert not any("contradicted" in warning for warning in stated.warnings)
    np.testing.assert_array_equal(stated.block.control_points.sigma_m, right.control_points.sigma_m)


def test_the_sigma_of_marks_that_nobody_states_is_that_of_their_scatter() -> None:
    block, _, _ = listed(2, 0.03, assumed=False)
    points = block.control_points
    marks = replace(
        points, mark_covariance_px2=np.tile(np.eye(2), (len(points.mark_point), 1, 1)),
        mark_sigma_assumed=np.ones(len(points), dtype=bool),
    )  # fmt: skip
    result = adjust(replace(block, control_points=marks), AdjustmentSettings())
    row = result.decisions.sigmas.kind == "marks"
    assert result.decisions.sigmas.used_sigma[row] == pytest.approx(HAND_HELD.mark_sigma_px, rel=0.2)
    assert result.block.control_points.mark_sigma_px[0] == pytest.approx(HAND_HELD.mark_sigma_px, rel=0.2)


def test_a_few_wrong_of_many_hardly_move_the_factor_of_control() -> None:
    rng = np.random.default_rng(4)
    w, r = 5.0 * rng.standard_normal(30), np.full(30, 0.8)
    before = robust_factor(w, r, BEND_OF_CONTROL, 1.0, 1.0)
    w[:3] = 100.0
    assert robust_factor(w, r, BEND_OF_CONTROL, 1.0, 1.0) < 1.35 * before
    assert robust_factor(w[:0], r[:0], BEND_OF_CONTROL, 1.0, 0.5) == pytest.approx(0.5)


def test_a_base_that_is_off_is_named_and_not_the_control_points() -> None:
    """All positions of a flight are off alike, by far more than their offset is stated to."""
    plan = replace(
        PLAN, flights=1, control_points=7, gnss_sigma_m=(0.02, 0.02, 0.03), gnss_offset_sigma_m=(0.02, 0.02, 0.03)
    )
    made = simulate_block(plan, 2, tie_points=500, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.2)
    points = made.block.control_points
    assumed = replace(
        points, sigma_m=np.tile(STATED_M, (len(points), 1)), sigma_assumed=np.ones(len(points), dtype=bool)
    )
    for control in (points, assumed):
        for shift_m in ([1.0, 0.0, 0.0], [0.0, -3.0, 0.0]):
            moved = tuple(
                replace(p, gnss_world_m=None if p.gnss_world_m is None else p.gnss_world_m + np.array(shift_m))
                for p in made.block.photographs
            )
            block = replace(made.block, photographs=moved, control_points=control)
            verdict = adjust_with_snooping(block, AdjustmentSettings())
            assert [a.kind for a in verdict.rejected] == ["GNSS offset"]
            z = errors_over_sigmas(verdict.result, made.truth.control_position_world_m)
            assert float(np.sqrt(np.mean(np.square(z)))) < 2.5


def test_points_that_carry_each_other_s_names_do_not_scatter() -> None:
    plan = SurveyPlan(
        strips=3, photographs_per_strip=6, control_points=5, check_points=6, gnss_sigma_m=(0.02, 0.02, 0.03),
        gnss_offset_sigma_m=(0.02, 0.02, 0.03), attitude_sigma_deg=1.0,
    )  # fmt: skip
    made = simulate_block(plan, 2, tie_points=500, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.2)
    points = made.block.control_points
    three = np.flatnonzero(np.array(points.role) == "control")[:3]
    position = points.position_world_m.copy()
    position[three] = position[np.roll(three, 1)]
    block = replace(made.block, control_points=replace(points, position_world_m=position))
    verdict = adjust_with_snooping(block, AdjustmentSettings())
    assert {a.name for a in verdict.rejected} == {points.name[g] for g in three.tolist()}
    assert verdict.contradicted == 1.0


def test_assumed_sigmas_are_steady_where_each_changes_by_less_than_two_per_cent() -> None:
    block = assumed(PLAN, 1)
    photographs, points = block.photographs, block.control_points
    assert photographs[3].gnss_sigma_m is not None
    for factor, steady in ((1.0, True), (1.01, True), (0.99, True), (1.03, False), (0.97, False)):
        one = replace(photographs[3], gnss_sigma_m=photographs[3].gnss_sigma_m * np.array([1.0, 1.0, factor]))
        changed = replace(block, photographs=(*photographs[:3], one, *photographs[4:]))
        assert assumed_steady(block, changed) is steady
        sigma = points.sigma_m.copy()
        sigma[0, 1] *= factor
        assert assumed_steady(block, replace(block, control_points=replace(points, sigma_m=sigma))) is steady
    bare = replace(photographs[0], gnss_world_m=None, gnss_sigma_m=None)
    block = replace(block, photographs=(bare, *photographs[1:]))
    assert assumed_steady(block, block)
