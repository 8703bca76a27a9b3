"""Rendered surveys whose ground points are still to be marked, with the true places of the points."""

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import project_points
from photogram.simulation.simulated_survey import SimulatedSurvey, render_photographs, simulate, whole_survey_plan
from photogram.simulation.survey_files import write_survey

EDGE_PX = 12.0
"""From the edge of a photograph, within which nobody marks."""


@dataclass(frozen=True)
class UnmarkedSurvey:
    """A survey folder as it comes home: photographs and a table of points; nothing is marked."""

    project: Path
    """Its project file, as photogram init drafts it."""
    truth_px: Mapping[str, Mapping[str, FloatArray]]
    """True places (2,) of the points by name and photograph, where they can be seen."""


def unmarked_survey(folder: Path, seed: int, points: int, photographs: int) -> UnmarkedSurvey:
    """Render a survey into ``folder`` and draft its project with so many points that at least so many photographs show
    each; other targets lie about."""
    plan = replace(whole_survey_plan(), control_points=16, check_points=8)
    survey = simulate(plan, seed)
    write_survey(folder, survey, render_photographs(survey))
    truth = {name: places for name, places in _true_places(survey).items() if len(places) >= photographs}
    kept = sorted(truth)[:points]
    if len(kept) < points:
        raise SystemExit(f"seed {seed}: only {len(kept)} points are seen {photographs} times: take another")
    header, *rows = (folder / "points.csv").read_text(encoding="utf-8").splitlines()
    table = folder / "given.csv"
    table.write_text("\n".join([header, *(r for r in rows if r.split(",")[0] in kept)]) + "\n", encoding="utf-8")
    for made in ("marks.csv", "control.txt", "check.txt"):
        (folder / made).unlink()
    project = folder / "project.yaml"
    command: list[str | Path] = [Path(sys.executable).with_name("photogram"), "init", folder / "photographs"]
    options: list[str | Path] = ["--control", table, "--crs", survey.frame.crs, "--project", project]
    subprocess.run([*command, *options, "--heights", "ellipsoidal"], check=True, stdout=subprocess.DEVNULL)
    return UnmarkedSurvey(project, {name: truth[name] for name in kept})


def _true_places(survey: SimulatedSurvey) -> dict[str, dict[str, FloatArray]]:
    points, camera = survey.control_points, survey.truth.camera
    seen = set(zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True))
    size = np.array([camera.width_px, camera.height_px])
    places: dict[str, dict[str, FloatArray]] = {name: {} for name in points.name}
    for i, pose in enumerate(survey.truth.poses):
        pixel = project_points(camera, pose, survey.truth.control_position_world_m)
        for g, name in enumerate(points.name):
            if (g, i) in seen and np.all((pixel[g] > EDGE_PX) & (pixel[g] < size - EDGE_PX)):
                places[name][survey.photographs[i].name] = pixel[g]
    return places
