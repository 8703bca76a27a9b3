"""Profiles of authorities: figures traceable to their keys, classes from check points alone, none from too few."""

import pytest
from makers import Json

from photogram.quality.asprs import ReportSettings
from photogram.report.numbers.completion import complete
from photogram.report.standards.pec_pcd import LEAST_POINTS


def with_check_points(report: Json, count: int, off_m: float) -> Json:
    """Return a report whose only check points are ``count`` copies of one, off by so much in plan and in height."""
    model = next(p for p in report["control_points"] if p["role"] == "check" and p["residual_m"])
    control = [p for p in report["control_points"] if "check" not in p["axis_roles"]]
    check = [{**model, "name": f"C{n}", "residual_m": [off_m, 0.0, -off_m]} for n in range(count)]
    return {**report, "control_points": [*control, *check]}


@pytest.mark.parametrize("profile", ["asprs-2024", "pec-pcd"])
def test_every_figure_is_that_of_its_key(full_report: Json, profile: str) -> None:
    report = complete(full_report, ReportSettings(standard=profile, target_rmse_h_m=0.05))  # type: ignore[arg-type]
    record = report["standard"]
    assert record is not None
    assert record["figures"]
    for figure in record["figures"]:
        value: object = report
        for part in figure["key"].split("."):
            value = value[part]  # type: ignore[index]
        assert figure["value_m"] == value
        assert figure["n"] in (report["asprs"]["n_h"], report["asprs"]["n_v"])


def test_none_is_made_unless_asked_for(full_report: Json) -> None:
    assert complete(full_report, ReportSettings())["standard"] is None


def test_statements_of_asprs_are_those_of_the_record(full_report: Json) -> None:
    report = complete(full_report, ReportSettings(standard="asprs-2024", target_rmse_h_m=5.0))
    assert report["standard"]["statements"] == report["asprs"]["statements"] != []  # type: ignore[index]


def test_classes_follow_from_the_check_points(full_report: Json) -> None:
    report = with_check_points(full_report, 20, 0.2)
    record = complete(report, ReportSettings(standard="pec-pcd"))["standard"]
    assert record is not None
    # 0.2 m is beyond EP 0.17 m of class A at 1:1000, and within 0.34 m at 1:2000; in height beyond 1/6 m of both
    rows = {row["scale"]: (row["plan"], row["height"]) for row in record["scales"]}
    assert rows == {1000: ("B", "B"), 2000: ("A", "B"), 5000: ("A", "A")}
    assert record["statements"] == [
        "Class A in plan at 1:2000 and smaller scales.",
        "Class A in height at 1:5000 and smaller scales.",
    ]
    assert record["not_stated"] == []


@pytest.mark.parametrize(("count", "words"), [(0, "no check points"), (1, "1 check point,"), (9, "9 check points")])
def test_too_few_points_state_no_class(full_report: Json, count: int, words: str) -> None:
    record = complete(with_check_points(full_report, count, 0.01), ReportSettings(standard="pec-pcd"))["standard"]
    assert record is not None
    assert record["scales"] == []
    assert record["statements"] == []
    assert len(record["not_stated"]) == 2
    assert all(words in text for text in record["not_stated"])
    assert count < LEAST_POINTS
