"""A survey opened as in a notebook: run, read back, and never out of date."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photogram.errors import ProjectError, WorkspaceError
from photogram.pipeline.opened_survey import open_survey
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages.comparison import stored_comparisons
from photogram.pipeline.stages.features import stored_features
from photogram.pipeline.stages.orientation import stored_orientation, transferred_tie_points
from photogram.pipeline.stages.stored_adjustment import stored_adjustment, stored_cloud
from photogram.pipeline.stages.stored_surface import StoredSurface

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def test_results_are_those_that_the_run_holds(adjusted_survey: Path) -> None:
    project = adjusted_survey / "project.yaml"
    opened = open_survey(str(project))
    with open_run(load_project(project)) as run:
        adjustment, cloud, surface = stored_adjustment(run), stored_cloud(run, "adjusted"), StoredSurface(run).heights()
        orientation, tie, features = stored_orientation(run), transferred_tie_points(run), stored_features(run, 1)
        pixels, compared = run.pixels(1), stored_comparisons(run)
    assert opened.adjustment().sigma0 == adjustment.sigma0
    assert np.array_equal(opened.cloud("adjusted").position_map_m, cloud.position_map_m)
    assert np.array_equal(opened.surface().values, surface.values, equal_nan=True)
    assert opened.surface_sigma().values.shape == surface.values.shape
    assert opened.orientation().method == orientation.method
    assert len(opened.tie_points()) == len(tie)
    name = opened.block().photographs[1].name
    assert np.array_equal(opened.features(name).pixel, features.pixel)
    assert np.array_equal(opened.pixels(name), pixels)
    assert opened.comparisons().keys() == compared.keys()
    report = opened.report()  # the folder was copied, and the results with it
    (adjusted_survey / "results/deliverables/dsm.tif").unlink()
    with pytest.raises(WorkspaceError, match="the stage results has not been run"):
        open_survey(project).report()
    assert open_survey(project).update().report()["report_id"] == report["report_id"]
    again = json.loads((adjusted_survey / "results/quality/report.json").read_text(encoding="utf-8"))
    assert report | {"processed": ""} == again | {"processed": ""}  # midnight may have passed
    assert repr(opened) == f"<OpenedSurvey {project}: 4 photographs>"
    assert "<td>EPSG:25832</td>" in opened._repr_html_()


def test_an_update_says_a_line_for_each_stage_and_repeats_nothing(adjusted_survey: Path) -> None:
    said: list[str] = []
    opened = open_survey(adjusted_survey / "project.yaml")
    assert opened.update(until="features", progress=said.append) is opened
    assert said == ["Photographs: up to date", "Features: up to date"]


def test_what_has_not_been_run_is_not_made_up(survey: Path) -> None:
    opened = open_survey(survey / "project.yaml")
    with pytest.raises(WorkspaceError, match=r'call update\(until="adjustment"\)'):
        opened.adjustment()
    opened.update(until="photographs")
    assert len(opened.block().photographs) == 4
    with pytest.raises(WorkspaceError, match="the stage features has not been run"):
        opened.features(opened.block().photographs[0].name)


def test_what_is_out_of_date_is_not_returned(adjusted_survey: Path, edit: Edit) -> None:
    project = adjusted_survey / "project.yaml"

    def raise_point(values: dict[str, Any]) -> None:
        values["control_points"]["list"][0]["position_m"][2] += 1.0

    edit(project, raise_point)
    opened = open_survey(project)
    assert len(opened.features(opened.block().photographs[0].name)) > 100
    with pytest.raises(WorkspaceError, match="the stage adjustment has not been run with this project file"):
        opened.adjustment()


def test_names_that_do_not_exist_are_refused(adjusted_survey: Path) -> None:
    opened = open_survey(adjusted_survey / "project.yaml")
    with pytest.raises(ProjectError, match="there is no cloud 'best'; the clouds are adjusted, linear_2view"):
        opened.cloud("best")
    with pytest.raises(ProjectError, match=r"there is no photograph 'no.jpg'"):
        opened.features("no.jpg")
