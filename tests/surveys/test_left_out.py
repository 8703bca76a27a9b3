"""What contradicts the rest, from the project file to the report: the survey goes on, and everything says so."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import stored_adjustment, stored_verdict
from photogram.results import Adjustment

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def report_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "results" / "quality/report.json").read_text(encoding="utf-8")))


def spoil(values: dict[str, Any]) -> None:
    """One mark of G03 90 px away, and the height of G05 mistyped by 20 m."""
    points = {p["name"]: p for p in values["control_points"]["list"]}
    marks = points["G03"]["marks"]
    name = sorted(marks)[0]
    marks[name] = [marks[name][0] - 70, marks[name][1] + 60]
    points["G05"]["position_m"][2] += 20.0


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_a_survey_with_a_wrong_mark_and_a_mistyped_height(
    adjusted_survey: Path, edit: Edit, photogram: Callable[..., Any]
) -> None:
    before = report_of(adjusted_survey)
    project = adjusted_survey / "project.yaml"
    edit(project, spoil)
    strict = photogram("adjust", project, "--no-check", "--strict")
    assert strict.code == 1, strict.err
    assert strict.err == "", "it has a result: nothing failed"
    assert strict.out.count("Rejected:") == 2
    again = photogram("adjust", project, "--no-check")
    assert again.code == 0
    report = report_of(adjusted_survey)
    named = {tuple(b["points"]): b for b in report["blunders"]}
    assert set(named) == {("G03",), ("G05",)}
    assert named[("G03",)]["photograph"] is not None
    assert report["blunders_effect"]["check_points_without"]["rmse_v_m"] == report["check_points"]["rmse_v_m"]
    points = {p["name"]: p for p in report["control_points"]}
    assert points["G05"]["axis_roles"][2] == "left out"
    assert points["G05"]["residual_m"][2] == pytest.approx(-20.0, abs=0.3)
    assert [m["left_out"] for m in points["G03"]["marks"]].count(True) == 1
    assert report["check_points"]["n"] == before["check_points"]["n"], "what is left out is no check point"
    assert report["check_points"]["rmse_h_m"] < before["check_points"]["rmse_h_m"] + 0.05
    assert report["check_points"]["rmse_v_m"] < before["check_points"]["rmse_v_m"] + 0.15
    page = (adjusted_survey / "results" / "deliverables/report.html").read_text(encoding="utf-8")
    assert "Rejected, because they contradict all other observations" in page
    reasons = [d["what"] for d in report["discarded"]]
    assert "height of control point G05" in reasons
    assert any(what.startswith("mark of G03 in ") for what in reasons)


@pytest.mark.survey
def test_what_was_left_out_is_left_out_when_it_is_read_back(adjusted_survey: Path, edit: Edit) -> None:
    project = adjusted_survey / "project.yaml"
    edit(project, spoil)
    run_pipeline(load_project(project), until="adjustment")
    with open_run(load_project(project)) as run:
        result: Adjustment = stored_adjustment(run)
        verdict = stored_verdict(run)
        stored = json.loads(run.workspace.file("adjustment", "verdict.json").read_text(encoding="utf-8"))
    assert json.loads(json.dumps(verdict)) == stored
    accused = verdict["accused"]
    points = result.block.control_points
    assert {(kind, name) for kind, name, *_ in accused} == {("mark", "G03"), ("control point", "G05")}
    assert np.isinf(points.sigma_m[points.name.index("G05"), 2])
    assert np.isinf(points.mark_sigma_px[points.mark_point == points.name.index("G03")]).sum() == 1
    assert np.isfinite(result.estimates.ground_world_m).all()
