"""From photographs and a table of coordinates to a report, as a new user goes: init, mark in the browser, adjust."""

import csv
import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from seeds import ALL

from photogram.files.marks.mark_table import read_marks
from photogram.simulation.simulated_survey import SurveyPlan, render_photographs, simulate
from photogram.simulation.survey_files import write_survey

pytest.importorskip("selenium", reason="selenium is not installed")

from lib.marking_hand import Hand, marking

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
NOISE_PX = 1.0
GSD_M = 0.067

pytestmark = pytest.mark.survey


def true_marks(table: Path) -> dict[str, dict[str, np.ndarray[Any, Any]]]:
    places: dict[str, dict[str, np.ndarray[Any, Any]]] = {}
    with table.open(encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            places.setdefault(row["name"], {})[row["photograph"]] = np.array([float(row["u"]), float(row["v"])])
    return places


@pytest.mark.usefixtures("undrawn")
def test_a_new_user_marks_in_the_browser_and_gets_a_report(
    small_plan: SurveyPlan, tmp_path: Path, photogram: Run, edit: Edit,
    open_browser: Callable[..., AbstractContextManager[Any]],
) -> None:  # fmt: skip
    plan = small_plan if ALL else replace(small_plan, control_points=5, check_points=3)
    survey = simulate(replace(plan, calibration_source="exif"), 3)
    write_survey(tmp_path, survey, render_photographs(survey))
    truth = {name: places for name, places in true_marks(tmp_path / "marks.csv").items() if len(places) > 1}
    crs = survey.frame.crs
    for made in ("marks.csv", "control.txt", "check.txt"):
        (tmp_path / made).unlink()
    project = tmp_path / "project.yaml"
    options = ("--control", tmp_path / "points.csv", "--crs", crs, "--heights", "ellipsoidal", "--project", project)
    drafted = photogram("init", tmp_path / "photographs", *options)
    assert drafted.code == 0, drafted.err
    assert "photogram mark" in drafted.out

    with open_browser() as chrome, marking(project) as address:
        hand = Hand(chrome, address, truth, NOISE_PX, 1)
        for point, places in truth.items():
            if hand.point != point:
                hand.choose(point)
            for photograph in hand.photographs():
                if photograph in places:
                    hand.mark(photograph)
        state = hand.settled()
        assert [p["name"] for p in state["points"] if p["wrong"]] == []
        hand.leave()
    marks = read_marks(tmp_path / "marks.csv")
    assert {mark.key for mark in marks} == {(name, i) for name, places in truth.items() for i in places}
    off = np.array([np.subtract(mark.pixel, truth[mark.point][mark.photograph]) for mark in marks])
    assert np.sqrt(np.mean(off**2)) < 0.45  # the known places are whole pixels: 0.29 px of it

    def shortened(values: dict[str, Any]) -> None:
        values |= {"dense": {"enabled": False}, "orthophoto": {"enabled": False}}

    edit(project, shortened)
    adjusted = photogram("adjust", project, "--quiet")
    assert adjusted.code == 0, adjusted.err
    report = json.loads((tmp_path / "results" / "quality/report.json").read_text(encoding="utf-8"))
    assert sum(kind["marks"] for kind in report["marks"]["kinds"]) == len(marks)
    assert report["check_points"]["rmse_h_m"] < 1.5 * GSD_M
    assert "checker" in (tmp_path / "results" / "deliverables/report.html").read_text(encoding="utf-8")
