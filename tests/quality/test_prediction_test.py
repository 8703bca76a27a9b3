"""Check points and points left out against what was predicted of them, on simulated surveys."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from makers import LEAST_SQUARES, ground_point, simulated
from scipy.stats import kstest
from seeds import limit, seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.quality.prediction_test import (
    SIGNIFICANCE,
    PredictedAgainstAchieved,
    contradicting_points,
    leave_one_out,
    predicted_against_achieved,
    shares,
)
from photogram.report.numbers.statistics import consistency_numbers
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=5, check_points=6, control_sigma_m=(0.005, 0.005, 0.008),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), gnss_sigma_m=(0.1, 0.1, 0.15),
)  # fmt: skip

# nothing but satellites of 2 m: all points err together
ADRIFT = replace(
    PLAN, control_points=0, gnss_sigma_m=(2.0, 2.0, 3.0), gnss_offset_sigma_m=(0.0, 0.0, 0.0), mark_sigma_px=0.2
)


@cache
def adjusted(seed: int, plan: SurveyPlan) -> Adjustment:
    return adjust(simulated(plan, seed, tie_points=120).block, LEAST_SQUARES)


def test_shares_known_by_hand() -> None:
    found = shares(np.array([0.5, -1.5, 2.5, -3.5, np.nan, 0.0]))
    assert (found.n, found.within_1, found.within_2, found.within_3) == (5, 0.4, 0.6, 0.8)
    assert found.mean_z == pytest.approx(-0.4)
    assert found.rms_z == pytest.approx(np.sqrt((0.25 + 2.25 + 6.25 + 12.25) / 5))
    nothing = shares(np.full(3, np.nan))
    assert nothing.n == 0
    assert np.isnan([nothing.mean_z, nothing.rms_z, nothing.within_1]).all()


@pytest.mark.parametrize(("plan", "control"), [(PLAN, 5), (ADRIFT, 0)])
def test_differences_of_check_points_follow_their_joint_covariance(plan: SurveyPlan, control: int) -> None:
    """p is uniform. It would not be, were the check points taken for independent: they share their photographs."""
    p, z, apart = [], [], []
    for seed in seeds(40):
        found = predicted_against_achieved(adjusted(seed, plan))
        assert found is not None
        assert (found.n, found.dof) == (6, 18)
        p.append(found.p)
        z.append(found.z[control:])
        apart.append(float(np.nansum(found.distance2)))
        assert np.isnan(found.z[:control]).all()
    assert kstest(p, "uniform").pvalue > 0.01
    assert np.sqrt(np.mean(np.array(z) ** 2)) == pytest.approx(1.0, abs=limit(0.12 if control else 0.3, 40))
    if not control:
        assert np.std(apart) > 2.0 * np.sqrt(2 * 18)


def test_a_survey_that_is_worse_than_it_says_is_told_so() -> None:
    good = adjusted(7, PLAN)
    found = predicted_against_achieved(good)
    assert found is not None
    assert found.consistent
    assert found.sentence.startswith("6 check points: the differences are as large as predicted")
    points = good.block.control_points
    bent = points.position_world_m.copy()
    bent[5:] += np.random.default_rng(0).normal(0, 0.15, (6, 3))
    worse = replace(good, block=replace(good.block, control_points=replace(points, position_world_m=bent)))
    found = predicted_against_achieved(worse)
    assert found is not None
    assert not found.consistent
    assert found.p < 0.001
    assert "times as large as predicted (χ² =" in found.sentence
    assert "p below 0.001" in found.sentence
    modest = replace(good, block=replace(good.block, control_points=replace(points, sigma_m=20.0 * points.sigma_m)))
    found = predicted_against_achieved(modest)
    assert found is not None
    assert not found.consistent
    assert "only" in found.sentence
    assert "too large" in found.sentence


def moved(result: Adjustment, point: int, by_m: tuple[float, float, float]) -> Adjustment:
    """The same adjustment with a check point surveyed elsewhere."""
    points = result.block.control_points
    position = points.position_world_m.copy()
    position[point] += by_m
    return replace(result, block=replace(result.block, control_points=replace(points, position_world_m=position)))


@pytest.mark.parametrize("plan", [PLAN, ADRIFT])
def test_check_point_with_a_blunder_is_named_and_no_other(plan: SurveyPlan) -> None:
    """Of points that err together by metres a blunder of 0.3 m is named too, since the others predict it."""
    named, accused = 0, 0
    for seed in seeds(40):
        result = adjusted(seed, plan)
        clean = predicted_against_achieved(result)
        g = len(result.block.control_points) - 1 - seed % 6
        found = predicted_against_achieved(moved(result, g, (0.3, 0.0, 0.0)))
        assert clean is not None
        assert found is not None
        names = [suspect.name for suspect in found.suspects]
        named += names == [result.block.control_points.name[g]]
        accused += len(clean.suspects)
    assert accused == 0
    assert named >= 0.95 * len(seeds(40))


def test_a_block_that_is_worse_than_it_says_accuses_nobody() -> None:
    """Errors of four times the predicted size, correlated, beside five control points left out: of 200 blocks a few
    name a point, as without the other tests nearly all would."""
    rng, accused, alone = np.random.default_rng(3), 0, 0
    point = np.repeat(np.arange(5), 3)
    for _ in range(200):
        common = rng.standard_normal((15, 4))
        covariance = np.diag(rng.uniform(0.5, 2.0, 15)) + common @ common.T
        d = 4.0 * np.linalg.cholesky(covariance) @ rng.standard_normal(15)
        others = [(3, 16.0 * float(np.sum(rng.standard_normal(3) ** 2))) for _ in range(5)]
        accused += bool(contradicting_points(d, covariance, point, others))
        alone += bool(contradicting_points(d, covariance, point, [(300, 300.0)] * 9))
    assert accused <= 10
    assert alone >= 190


def test_test_of_a_point_is_what_all_lose_without_it() -> None:
    """Independent points: T is the square sum of its own differences; two of them are named one after the other."""
    d, point = np.array([0.3, -0.4, 0.2, 12.0, 0.0, 0.5, 0.1, 9.0, -0.2, 0.2, 0.6, 0.1]), np.repeat(np.arange(4), 3)
    found = contradicting_points(d, np.eye(12), point)
    assert [g for g, _ in found] == [1, 2]
    assert [t for _, t in found] == pytest.approx([144.25, 81.05])
    assert contradicting_points(d[:6], np.eye(6), point[:6]) == []  # one other point cannot say which of the two


def test_blunder_of_hundreds_of_metres_accuses_its_point_alone() -> None:
    """Errors that are correlated with it make its neighbours as improbable: both probabilities are 0 to the machine."""
    result = adjusted(7, ADRIFT)
    found = predicted_against_achieved(moved(result, 3, (400.0, -300.0, 50.0)))
    assert found is not None
    assert [suspect.name for suspect in found.suspects] == [result.block.control_points.name[3]]


def test_suspect_check_point_is_marked_in_the_report() -> None:
    result = moved(adjusted(7, PLAN), 6, (0.0, 0.5, 0.0))
    points = [
        ground_point(name, "check" if g > 4 else "control") for g, name in enumerate(result.block.control_points.name)
    ]
    numbers = consistency_numbers(result, points)
    assert [p["name"] for p in points if p["suspect"]] == ["C02"]
    assert [p["suspect"] for p in points[5:]] == [False, True, False, False, False, False]
    assert numbers.predicted_against_achieved is not None
    assert points[6]["verdict"] is not None
    assert points[6]["verdict"].startswith(
        "check point C02 fits neither the block nor the other check points: northing"
    )
    assert points[6]["verdict"] in numbers.predicted_against_achieved["sentence"]


def test_what_the_report_holds() -> None:
    result = adjusted(7, PLAN)
    points = [ground_point(name) for name in result.block.control_points.name]
    numbers = consistency_numbers(result, points)
    achieved = numbers.predicted_against_achieved
    assert achieved is not None
    assert achieved["n"] == 6
    assert achieved["chi2"]["dof"] == 18
    assert set(achieved["axes"]) == {"easting", "northing", "height"}
    assert achieved["axes"]["height"]["n"] == 6
    z = np.array([p["z"] for p in points[5:]], dtype=float)
    assert achieved["axes"]["height"]["rms_z"] == pytest.approx(np.sqrt(np.mean(z[:, 2] ** 2)))
    assert all(p["z"] is None and p["mahalanobis"] is None for p in points[:5])
    assert all(p["mahalanobis"] is not None and p["mahalanobis"] > 0 for p in points[5:])
    assert numbers.leave_one_out is not None
    assert set(numbers.leave_one_out) == {"n", "rmse_m", "mean_m", "rmse_h_m", "rmse_v_m", "rms_z", "max"}


def test_leave_one_out_summarises_every_control_point() -> None:
    result = adjusted(7, PLAN)
    found = leave_one_out(result)
    off = result.tests.reliability.ground_left_out_m[:5]
    assert found is not None
    assert found.n == 5
    assert found.rmse_h_m == pytest.approx(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))))
    assert found.rmse_v_m == pytest.approx(np.sqrt(np.mean(off[:, 2] ** 2)))
    assert found.mean_m == pytest.approx(tuple(off.mean(axis=0)))
    worst = int(np.argmax(np.linalg.norm(off, axis=1)))
    assert found.worst == f"G0{worst + 1}"
    assert found.worst_m == pytest.approx(tuple(off[worst]))


def test_points_left_out_scatter_as_predicted() -> None:
    z = []
    for seed in seeds(40):
        found = leave_one_out(adjusted(seed, PLAN))
        assert found is not None
        z.append(found.rms_z)
    assert np.sqrt(np.mean(np.array(z) ** 2)) == pytest.approx(1.0, abs=limit(0.12, 40))


def test_without_points_nothing_is_said() -> None:
    plan = replace(PLAN, control_points=0, check_points=0, gnss_offset_sigma_m=(0.0, 0.0, 0.0))
    result = adjust(simulated(plan, 1, tie_points=120).block, AdjustmentSettings())
    assert predicted_against_achieved(result) is None
    assert leave_one_out(result) is None
    numbers = consistency_numbers(result, [])
    assert numbers.predicted_against_achieved is None
    assert numbers.leave_one_out is None


def test_a_prediction_is_consistent_within_both_tails() -> None:
    found = PredictedAgainstAchieved(0, np.zeros((0, 3)), np.zeros(0), {}, 1.0, 1, 0.5)
    tail = SIGNIFICANCE / 2
    for p, consistent in ((0.99 * tail, False), (1.01 * tail, True), (1 - 1.01 * tail, True), (1 - 0.99 * tail, False)):
        assert replace(found, p=p).consistent is consistent
