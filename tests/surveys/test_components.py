"""Surveys in two pieces, with a gap that no photograph bridges, as a user runs them: adjusted as one system where
something ties them, apart where nothing does."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from photogram.project.draft.component import WRITTEN
from photogram.simulation.simulated_survey import SimulatedSurvey, render_photographs, simulate, whole_survey_plan
from photogram.simulation.survey_files import write_survey

Run = Callable[..., Any]
PLAN = replace(
    whole_survey_plan(640), strips=6, photographs_per_strip=4, side_overlap=0.5, gnss_tags=False, control_points=20,
    check_points=6,
)  # fmt: skip
FLOWN = (0, 1, 4, 5)
"""Strips of the two pieces."""
SPARSE: dict[str, Any] = {"dense": {"enabled": False}, "orthophoto": {"enabled": False}}


@pytest.fixture(scope="module")
def survey() -> SimulatedSurvey:
    return simulate(PLAN, 3)


@pytest.fixture(scope="module")
def pictures(survey: SimulatedSurvey) -> list[tuple[str, np.ndarray]]:
    kept = [p.name for i, p in enumerate(survey.photographs) if i // PLAN.photographs_per_strip in FLOWN]
    return [(name, picture) for name, picture in render_photographs(survey) if name in kept]


def west(survey: SimulatedSurvey) -> list[str]:
    """The ground points of the western piece."""
    points = survey.control_points
    return [n for n, x in zip(points.name, points.position_world_m[:, 0], strict=True) if x < 0.0]


def begun(folder: Path, photogram: Run, survey: SimulatedSurvey, pictures: list[Any], names: list[str]) -> Path:
    """Write photographs and the ground points of these names, and the project of them."""
    write_survey(folder, survey, pictures)
    shown = {name for name, _ in pictures}
    for table in ("points.csv", "marks.csv"):
        head, *rows = (folder / table).read_text(encoding="utf-8").splitlines()
        kept = [r for r in rows if r.split(",")[0] in names and (table == "points.csv" or r.split(",")[1] in shown)]
        (folder / table).write_text("\n".join([head, *kept]) + "\n", encoding="utf-8")
    project = folder / "project.yaml"
    tables = ("--control", folder / "points.csv", "--marks", folder / "marks.csv")
    outcome = photogram("init", folder / "photographs", "--crs", PLAN.crs, "--project", project, *tables)
    assert outcome.code == 0, outcome.err
    values = yaml.safe_load(project.read_text(encoding="utf-8")) | SPARSE
    values["features"] = {"maximum": 1000}
    project.write_text(yaml.safe_dump(values, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return project


def report_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "quality" / "report.json").read_text(encoding="utf-8")))


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_control_points_tie_two_pieces_to_one_system(
    survey: SimulatedSurvey, pictures: list[Any], tmp_path: Path, photogram: Run
) -> None:
    project = begun(tmp_path, photogram, survey, pictures, list(survey.control_points.name))
    (tmp_path / "project_component_2.yaml").write_text(WRITTEN + "\n", encoding="utf-8")
    outcome = photogram("adjust", project)
    assert outcome.code == 0, outcome.err
    assert "No longer apart: project_component_2.yaml and its results are left from an earlier run" in outcome.out
    report = report_of(tmp_path / "results")
    ties = report["block"]["component_ties"]
    assert [t["photographs"] for t in ties] == [8, 8]
    assert [t["placed_by"] for t in ties] == ["control points", "control points"]
    assert report["block"]["registered"] == 16
    check = report["check_points"]
    assert check["n"] >= 4
    assert max(check["rmse_h_m"], check["rmse_v_m"]) < 3.0 * report["block"]["gsd_m"]
    assert report["predicted_against_achieved"]["consistent"]
    assert "components without common tie points" in outcome.out
    assert [path.name for path in tmp_path.glob("project_component_*")] == ["project_component_2.yaml"]
    assert not list(tmp_path.glob("results_component_*"))


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_a_piece_that_nothing_ties_is_delivered_apart(
    survey: SimulatedSurvey, pictures: list[Any], tmp_path: Path, photogram: Run
) -> None:
    project = begun(tmp_path, photogram, survey, pictures, west(survey))
    outcome = photogram("adjust", project)
    assert outcome.code == 0, outcome.err
    report = report_of(tmp_path / "results")
    lost = next(t for t in report["block"]["component_ties"] if not t["adjusted"])
    number = report["block"]["component_ties"].index(lost) + 1
    assert (report["block"]["registered"], lost["photographs"]) == (8, 8)
    said = " ".join(outcome.out.split())
    assert (
        f"Apart: component {number}, 8 photographs that nothing ties to the rest, is a free network of its own" in said
    )
    apart = report_of(tmp_path / f"results_component_{number}")
    assert sorted(apart["photographs"]) == sorted(report["block"]["components"][number - 1])
    assert apart["block"]["registered"] == 8
    assert not apart["local_frame"]["scale_known"]
    events = [json.loads(line) for line in photogram("adjust", project, "--json").out.splitlines()]
    assert events[-1]["event"] == "done"
    assert any(e["event"] == "warning" and e["text"].startswith("Apart: ") for e in events)
    assert sum(e["event"] == "begin" and e["stage"] == "adjustment" for e in events) == 1
