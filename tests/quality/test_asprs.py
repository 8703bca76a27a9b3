"""Accuracy as the ASPRS standards state it: their worked examples, exact identities, and when nothing may be stated."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from makers import ground_point

from photogram.errors import SettingError
from photogram.quality.asprs import (
    ReportSettings,
    asprs_accuracy,
    axis_targets_m,
    blunders,
    coarse_survey,
    statement_h,
    statement_v,
    systematic,
)
from photogram.report.numbers.completion import asprs_numbers, product_accuracies
from photogram.report.record.ground import AxisRole

Array = np.ndarray[Any, np.dtype[np.float64]]


def alternating(rmse_m: tuple[float, float, float], count: int = 30) -> Array:
    """Differences without a mean whose RMSE is exactly the one given."""
    return np.outer(np.where(np.arange(count) % 2, 1.0, -1.0), rmse_m)


@pytest.mark.parametrize(
    ("fit_cm", "survey_cm", "product_cm"),
    # RMSE_V1, RMSE_V2, RMSE_V: the first is that of table 7.4 in Edition 2
    [
        (1.00, 2.0, 2.24),
        (2.00, 2.0, 2.83),
        (3.00, 2.0, 3.61),
        (4.00, 2.0, 4.47),
        (5.00, 2.0, 5.39),
        (10.00, 2.0, 10.20),
    ],
)
def test_worked_examples_of_the_standard_in_height(fit_cm: float, survey_cm: float, product_cm: float) -> None:
    sigma = np.full((30, 3), survey_cm / 100)
    found = asprs_accuracy(alternating((0.01, 0.01, fit_cm / 100)), sigma)
    assert found.rmse_v_m * 100 == pytest.approx(product_cm, abs=0.005)


def test_survey_in_plan_counts_with_both_its_axes() -> None:
    """RMSE_H2 = √2 c: 1 cm of fit per axis and 2 cm of survey per axis make √(1.414² + 2.828²) cm in plan."""
    found = asprs_accuracy(alternating((0.01, 0.01, 0.01)), np.full((30, 3), 0.02))
    assert found.fit_h_m == pytest.approx(0.01 * math.sqrt(2))
    assert found.survey_h_m == pytest.approx(0.02 * math.sqrt(2))
    assert found.rmse_h_m == pytest.approx(0.031623, abs=1e-6)
    assert found.rmse_3d_m == pytest.approx(math.hypot(0.031623, 0.022361), abs=1e-6)


@given(st.integers(2, 40).flatmap(lambda n: st.lists(st.tuples(*[st.floats(-5, 5)] * 3), min_size=n, max_size=n)))
def test_rmse_mean_and_standard_deviation_belong_together(rows: list[tuple[float, float, float]]) -> None:
    """n RMSE² = n mean² + (n − 1) sd² on every axis, and space is plan and height together."""
    difference = np.array(rows)
    found = asprs_accuracy(difference, np.full(difference.shape, 0.01))
    n = len(rows)
    for axis in found.axes:
        assert n * axis.rmse_m**2 == pytest.approx(n * axis.mean_m**2 + (n - 1) * axis.sd_m**2, abs=1e-9)
    assert found.fit_h_m == pytest.approx(np.sqrt(np.mean(np.sum(difference[:, :2] ** 2, axis=1))), abs=1e-12)
    assert found.rmse_3d_m**2 == pytest.approx(found.rmse_h_m**2 + found.rmse_v_m**2)


def test_point_that_checks_one_axis_counts_there_alone() -> None:
    difference = alternating((0.01, 0.02, 0.03), 6)
    difference[0, :2], difference[1, 2], difference[2, 0] = np.nan, np.nan, np.nan
    sigma = np.full((6, 3), 0.01)
    sigma[0], sigma[1] = 9.0, 9.0  # of what does not count, and of what does
    found = asprs_accuracy(difference, sigma)
    assert (found.n_h, found.n_v) == (4, 5)
    assert [axis.n for axis in found.axes] == [4, 4, 5]
    assert found.survey_h_m == pytest.approx(math.sqrt((2 * 81 + 3 * 2e-4) / 4))
    assert found.survey_v_m == pytest.approx(math.sqrt((81 + 4e-4) / 5))


def test_statement_from_thirty_points_is_that_of_the_standard() -> None:
    found = asprs_accuracy(alternating((0.01, 0.01, 0.01)), np.full((30, 3), 0.02))
    assert statement_h(found.n_h, found.rmse_h_m, 0.05) == (
        "This data set was tested to meet ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2, "
        "Version 2 (2024) for a 5.0 (cm) RMSE_H Horizontal Positional Accuracy Class. The tested horizontal positional "
        "accuracy was found to be RMSE_H = 3.2 (cm)."
    )
    assert statement_v(found.n_v, found.rmse_v_m, 0.05) == (
        "This data set was tested to meet ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2, "
        "Version 2 (2024) for a 5.0 (cm) RMSE_V Vertical Accuracy Class. The Non-Vegetated Vertical Accuracy (NVA) was "
        "found to be RMSE_V = 2.2 (cm)."
    )


def test_statement_below_thirty_points_is_the_reduced_one() -> None:
    found = asprs_accuracy(alternating((0.01, 0.01, 0.01), 29), np.full((29, 3), 0.02))
    assert statement_h(found.n_h, found.rmse_h_m, 0.05) == (
        "This data set was tested as required by ASPRS Positional Accuracy Standards for Digital Geospatial Data, "
        "Edition 2, Version 2 (2024). Although the Standards call for a minimum of thirty (30) checkpoints, this test "
        "was performed using ONLY 29 checkpoints. This data set was produced to meet a 5.0 (cm) RMSE_H Horizontal "
        "Positional Accuracy Class. The tested horizontal positional accuracy was found to be RMSE_H = 3.2 (cm) using "
        "the reduced number of checkpoints."
    )
    vertical = statement_v(found.n_v, found.rmse_v_m, 0.05)
    assert vertical is not None
    assert vertical.endswith("was found to be RMSE_V = 2.2 (cm) using the reduced number of checkpoints.")
    assert "ONLY 29 checkpoints" in vertical


def test_nothing_is_stated_that_was_not_met_or_not_tested() -> None:
    found = asprs_accuracy(alternating((0.01, 0.01, 0.01)), np.full((30, 3), 0.02))
    assert statement_h(found.n_h, found.rmse_h_m, 0.0316) is None  # the fit alone, 1.4 cm, would have met it
    assert statement_v(found.n_v, found.rmse_v_m, 0.0223) is None
    nothing = asprs_accuracy(np.zeros((0, 3)), np.zeros((0, 3)))
    assert statement_h(nothing.n_h, nothing.rmse_h_m, 1.0) is None
    assert statement_v(nothing.n_v, nothing.rmse_v_m, 1.0) is None
    assert math.isnan(nothing.rmse_3d_m)


def test_blunder_and_systematic_error_are_named_beyond_the_limits_of_the_standard() -> None:
    settings = ReportSettings(target_rmse_h_m=0.02 * math.sqrt(2), target_rmse_v_m=0.03)
    assert axis_targets_m(settings) == pytest.approx((0.02, 0.02, 0.03))
    difference = alternating((0.001, 0.001, 0.001), 8)
    difference[3, 1], difference[5, 2] = 0.0601, -0.0899  # limits of 0.06 and 0.09 m
    names = [f"C{i}" for i in range(8)]
    (sentence,) = blunders(difference, names, settings)
    assert sentence.startswith("check point C3, northing: +0.060 m is beyond three times")
    biased = np.tile([0.0051, -0.0049, -0.0076], (8, 1))  # limits of 0.005, 0.005 and 0.0075 m
    found = systematic(asprs_accuracy(biased, np.full((8, 3), 0.001)), settings)
    assert [s.split(":")[0] for s in found] == ["easting", "height"]
    assert blunders(difference, names, ReportSettings()) == []


def test_check_points_must_be_twice_as_good_as_the_target() -> None:
    settings = ReportSettings(target_rmse_v_m=0.03)
    assert coarse_survey(asprs_accuracy(alternating((0.01,) * 3), np.full((30, 3), 0.0149)), settings) == []
    (sentence,) = coarse_survey(asprs_accuracy(alternating((0.01,) * 3), np.full((30, 3), 0.0151)), settings)
    assert "in height" in sentence


def test_legacy_figures_are_those_of_the_nssda_and_given_on_demand_alone() -> None:
    points = [ground_point(f"C{i}", "check", (0.01, -0.01, 0.02)) for i in range(4)]
    assert asprs_numbers(points, ReportSettings())["legacy_95"] is None
    legacy = asprs_numbers(points, ReportSettings(legacy_95=True))["legacy_95"]
    assert legacy is not None
    assert legacy["horizontal_m"] == pytest.approx(1.7308 * 0.01 * math.sqrt(2))
    assert legacy["vertical_m"] == pytest.approx(1.96 * 0.02)


def test_control_points_never_enter() -> None:
    check = [ground_point("C1", "check", (0.01, 0.02, 0.03)), ground_point("C2", "check", (-0.02, 0.01, 0.01))]
    alone = asprs_numbers(check, ReportSettings())
    with_control = asprs_numbers([ground_point("G1", "control", (9.0, 9.0, 9.0)), *check], ReportSettings())
    assert with_control == alone
    assert alone["n_h"] == alone["n_v"] == 2


@pytest.mark.parametrize("roles", [["control", "control", "check"], ["control", "left out", "check"]])
def test_point_with_roles_per_axis_enters_with_those_it_checks(roles: list[AxisRole]) -> None:
    mixed, check = ground_point("H1", "control", (5.0, 5.0, 0.03)), ground_point("C1", "check", (0.01, 0.0, 0.04))
    mixed["axis_roles"] = roles
    found = asprs_numbers([mixed, check], ReportSettings())
    assert (found["n_h"], found["n_v"]) == (1, 2)
    assert found["fit_rmse_h_m"] == pytest.approx(0.01)
    assert found["fit_rmse_v_m"] == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2))


def test_point_without_marks_does_not_enter() -> None:
    points = [ground_point("C1", "check", (0.01, 0.0, 0.04)), ground_point("C2", "check")]
    assert asprs_numbers(points, ReportSettings())["n_v"] == 1


def test_sentence_says_why_nothing_is_stated() -> None:
    points = [ground_point(f"C{i}", "check", (0.01, 0.0, 0.04)) for i in range(5)]
    found = asprs_numbers(points, ReportSettings(target_rmse_v_m=0.01))
    assert found["statements"] == []
    assert "set report.target_rmse_h_m" in found["not_stated"][0]
    assert "0.045 m (n = 5) does not meet the class of 0.010 m" in found["not_stated"][1]
    assert all("not tested" in s for s in asprs_numbers([], ReportSettings())["not_stated"])


def test_sum_and_statement_need_a_stated_survey_of_every_point_in_use() -> None:
    """Thirty points; where one of unknown accuracy is in use there is no sum of that direction, whatever the rest."""
    sigma = np.full((30, 3), 0.02)
    sigma[4] = np.nan
    found = asprs_accuracy(alternating((0.01, 0.01, 0.01)), sigma)
    assert found.fit_h_m == pytest.approx(0.01 * math.sqrt(2))
    assert np.isnan([found.survey_h_m, found.survey_v_m, found.rmse_h_m, found.rmse_v_m, found.rmse_3d_m]).all()
    assert statement_h(found.n_h, found.rmse_h_m, 9.0) is None
    assert statement_v(found.n_v, found.rmse_v_m, 9.0) is None
    assert coarse_survey(found, ReportSettings(target_rmse_h_m=0.001, target_rmse_v_m=0.001)) == []
    difference = alternating((0.01, 0.01, 0.01))
    difference[4, :2] = np.nan  # in use in height alone
    found = asprs_accuracy(difference, sigma)
    assert found.rmse_h_m == pytest.approx(0.031623, abs=1e-6)
    assert math.isnan(found.rmse_v_m)


def test_a_point_of_assumed_accuracy_takes_the_statement_from_what_it_checks_alone() -> None:
    points = [ground_point(f"C{i}", "check", (0.01, 0.0, 0.01)) for i in range(4)]
    height = ground_point("H1", "control", (5.0, 5.0, 0.01)) | {"surveyed_sigma_assumed": True}
    height["axis_roles"] = ["control", "control", "check"]
    found = asprs_numbers([*points, height], ReportSettings(target_rmse_h_m=0.05, target_rmse_v_m=0.05))
    assert found["survey_assumed"] == "the accuracy of the survey of 1 of 5 check points (H1) is only assumed"
    assert found["rmse_h_m"] == pytest.approx(math.hypot(0.01, 0.01 * math.sqrt(2)))
    assert found["rmse_v_m"] is None
    (statement,) = found["statements"]
    assert "Horizontal Positional" in statement
    assert found["not_stated"] == [
        "No statement of vertical accuracy: the accuracy of the survey of 1 of 5 check points (H1) is only assumed; "
        "enter it as sigma_m, and remove sigma_assumed."
    ]
    unused = ground_point("C9", "check") | {"surveyed_sigma_assumed": True}
    control = ground_point("G1", "control", (0.1, 0.1, 0.1)) | {"surveyed_sigma_assumed": True}
    settings = ReportSettings()
    assert asprs_numbers([*points, unused, control], settings) == asprs_numbers(points, settings)


@pytest.mark.parametrize("value", [0.0, -0.01, math.inf, math.nan])
def test_target_must_be_a_length(value: float) -> None:
    with pytest.raises(SettingError, match=r"^target_rmse_h_m: must be from 0.0001 to 1000 m, found "):
        ReportSettings(target_rmse_h_m=value)


def test_products_have_statements_of_their_own(full_report: Any) -> None:
    """Of the surface model in height and of the orthophoto in plan, from their own check points."""
    settings = ReportSettings(target_rmse_h_m=0.05, target_rmse_v_m=0.02)
    surface, orthophoto = product_accuracies(full_report, settings)
    test, shown = full_report["dense"]["check_points"], full_report["orthophoto"]["check_points"]
    assert (surface["product"], surface["where"], surface["n"]) == ("dsm.tif", "height", test["n"])
    assert surface["rmse_m"] == test["rmse_v_m"]
    assert surface["statement"] is None
    said = "dsm.tif: its tested RMSE of 0.029 m (n = 4) does not meet the class of 0.020 m"
    assert said in str(surface["not_stated"])
    assert (orthophoto["product"], orthophoto["where"], orthophoto["n"]) == ("orthophoto.tif", "plan", 3)
    assert orthophoto["rmse_m"] == shown["rmse_h_m"]
    assert orthophoto["not_stated"] is None
    assert "ONLY 3 checkpoints" in str(orthophoto["statement"])
    assert "RMSE_H = 2.4 (cm)" in str(orthophoto["statement"])


def test_no_statement_of_a_product_without_class_or_points(full_report: Any) -> None:
    surface, orthophoto = product_accuracies(full_report, ReportSettings())
    assert "set report.target_rmse_v_m" in str(surface["not_stated"])
    assert "set report.target_rmse_h_m" in str(orthophoto["not_stated"])
    few = full_report["dense"]["check_points"] | {"n": 1, "rmse_m": None, "survey_rmse_m": None, "rmse_v_m": None}
    report = full_report | {"dense": full_report["dense"] | {"check_points": few}}
    del report["orthophoto"]
    (surface,) = product_accuracies(report, ReportSettings(target_rmse_v_m=0.05))
    assert surface["not_stated"] == "No statement of the vertical accuracy of dsm.tif: it is tested at 1 check point."


def test_no_statement_of_a_product_where_the_survey_is_only_assumed(full_report: Any) -> None:
    dense, shown = full_report["dense"], full_report["orthophoto"]
    unknown: dict[str, Any] = {"survey_rmse_m": None, "rmse_v_m": None, "survey_rmse_h_m": None, "rmse_h_m": None}
    report = full_report | {
        "dense": dense | {"check_points": dense["check_points"] | unknown},
        "orthophoto": shown | {"check_points": shown["check_points"] | unknown},
    }
    surface, orthophoto = product_accuracies(report, ReportSettings(target_rmse_h_m=0.05, target_rmse_v_m=0.05))
    assert (surface["statement"], orthophoto["statement"]) == (None, None)
    why = (
        "the accuracy of the survey of its check points is only assumed; enter it as sigma_m, and remove sigma_assumed."
    )
    assert surface["not_stated"] == f"No statement of the vertical accuracy of dsm.tif: {why}"
    assert orthophoto["not_stated"] == f"No statement of the horizontal accuracy of orthophoto.tif: {why}"
    assert surface["fit_rmse_m"] == dense["check_points"]["rmse_m"]
