"""The client's part: its figures are those of the record, and check points alone tell the accuracy."""

import math
from copy import deepcopy

import pytest
from makers import Json

from photogram.quality.asprs import ReportSettings
from photogram.report.client.contents import MOST_BY_STANDARD, MOST_POINTS, client_part
from photogram.report.numbers.completion import complete
from photogram.report.numbers.overall import length


def test_check_points_alone_are_shown_with_their_own_figures(full_report: Json) -> None:
    part = client_part(full_report)
    points = {p["name"]: p for p in full_report["control_points"]}
    assert part.check_points
    for row in part.check_points:
        for axis, role in enumerate(points[row.name]["axis_roles"]):
            expected = points[row.name]["residual_m"][axis] if role == "check" else None
            assert row.difference_m[axis] == expected
    heights = [row.difference_m[2] for row in part.check_points if row.difference_m[2] is not None]
    assert part.rmse_m[2] == pytest.approx(math.sqrt(sum(h**2 for h in heights) / len(heights)))


def test_accuracy_is_the_verdict_and_what_check_points_say(full_report: Json) -> None:
    said = [fact.text for fact in client_part(full_report).accuracy]
    assert said[0] == full_report["verdict"]["sentence"]
    for figure in full_report["verdict"]["figures"]:
        assert any(length(figure["rmse_m"]) in text and "kept out" in text for text in said)


def test_without_check_points_the_accuracy_is_called_predicted(full_report: Json) -> None:
    points = [p for p in full_report["control_points"] if "check" not in p["axis_roles"]]
    bare = deepcopy(full_report)
    bare["control_points"] = points
    part = client_part(complete(bare, ReportSettings()))
    assert part.check_points == []
    assert part.rmse_m == (None, None, None)
    said = " ".join(fact.text for fact in part.accuracy)
    assert "predicted, not tested" in said
    assert "RMSE" not in said


@pytest.mark.parametrize(("by_standard", "most"), [(False, MOST_POINTS), (True, MOST_BY_STANDARD)])
def test_of_many_check_points_those_furthest_off_are_shown(full_report: Json, by_standard: bool, most: int) -> None:
    report = deepcopy(full_report)
    report["standard"] = full_report["standard"] if by_standard else None
    model = next(p for p in report["control_points"] if p["role"] == "check" and p["residual_m"])
    report["control_points"] = [
        {**model, "name": f"C{n}", "residual_m": [0.0, 0.0, 0.001 * n]} for n in range(MOST_POINTS + 30)
    ]
    part = client_part(report)
    assert [row.name for row in part.check_points] == [
        f"C{n}" for n in range(MOST_POINTS + 30 - most, MOST_POINTS + 30)
    ]
    assert part.checked == MOST_POINTS + 30
