"""Epochs of one site, as a user runs them: adjusted together, a surface of each, and what has changed, against the
truth of a rendered site."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from lib.simulated.epochs import Mound, change_m, simulate_epochs

from photogram.change.epochs.epochs import Pair, output_of, pairs_of, share_stages, survey_of
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.store.workspace import Workspace
from photogram.simulation.simulated_survey import render_photographs, whole_survey_plan
from photogram.simulation.survey_files import write_survey

Run = Callable[..., Any]
PLAN = replace(
    whole_survey_plan(480), strips=2, photographs_per_strip=4, control_points=4, check_points=0, side_overlap=0.6,
    gnss_sigma_m=(0.015, 0.015, 0.02), gnss_offset_sigma_m=(0.03, 0.03, 0.05), relief_m=4.0, trees=10, buildings=1,
)  # fmt: skip
MOUNDS = (Mound(0.0, 0.0, 14.0, 2.0),)


def command(*arguments: object) -> str:
    """What `photogram` says, as a process of its own."""
    called = [sys.executable, "-m", "photogram.cli.main", *map(str, arguments)]
    return subprocess.run(called, check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("epochs")
    for name, survey in zip(("may", "june"), simulate_epochs(PLAN, 3, MOUNDS), strict=True):
        write_survey(folder / "flown", survey, render_photographs(survey))
        shutil.move(folder / "flown" / "photographs", folder / "photographs" / name)
    path = folder / "project.yaml"
    command("init", folder / "photographs", "--recursive", "--project", path)
    text = path.read_text(encoding="utf-8") + "\northophoto: {enabled: false}\nterrain: {enabled: false}\nepochs:\n"
    text += "  - {name: may, photographs: [may/*]}\n  - {name: june, photographs: [june/*]}\n"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def said(project: Path) -> str:
    return command("epochs", project)


def read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a raster, NaN without data, and where its cells are (2, rows, columns) in the world."""
    with rasterio.open(path) as raster:
        values = raster.read(1).astype(np.float64)
        values[values == raster.nodata] = np.nan
        rows, columns = np.mgrid[0 : raster.height, 0 : raster.width]
        east, north = rasterio.transform.xy(raster.transform, rows.ravel(), columns.ravel())
    world = PLAN.frame.world_from_map(np.column_stack([east, north, np.full(len(east), PLAN.origin_map_m[2])]))
    return values, world[:, 0].reshape(values.shape), world[:, 1].reshape(values.shape)


@pytest.mark.survey
def test_the_difference_is_the_change_and_nothing_else(project: Path, said: str) -> None:
    assert "Epoch may: " in said
    assert "Epoch june: " in said
    folder = project.parent / "results_june_minus_may"
    (difference, x, y), (sigma, _, _), (code, _, _) = (
        read(folder / name) for name in ("difference.tif", "difference_sigma.tif", "change.tif")
    )
    true = change_m(MOUNDS, x, y)
    known = np.isfinite(sigma)
    unchanged = known & (np.hypot(x, y) > MOUNDS[0].radius_m + 2.0)
    assert abs(np.median(difference[unchanged])) < 0.25 * PLAN.gsd_m
    assert np.mean(code[unchanged] != 0) < 0.1
    assert np.nanmedian(sigma[unchanged]) < 0.5 * PLAN.gsd_m
    changed = known & (true > 2.0 * 1.96 * np.nan_to_num(sigma)) & (true > 0.2)
    assert np.mean(code[changed] == 2) > 0.95
    volume = np.nansum(difference[known & (true > 0.0)]) / np.nansum(true[known & (true > 0.0)])
    assert volume == pytest.approx(1.0, abs=0.03)


@pytest.mark.survey
def test_each_epoch_has_a_surface_of_its_own_photographs(project: Path, said: str) -> None:
    assert said
    whole = json.loads((project.parent / "results/quality/report.json").read_text(encoding="utf-8"))
    assert "each epoch has a surface of its own" in whole["dsm"]["left_out"]
    assert whole["block"]["registered"] == 16
    for name in ("may", "june"):
        report = json.loads((project.parent / f"results_{name}/quality/report.json").read_text(encoding="utf-8"))
        assert report["dense"]["photographs"]["used"] <= 8
        for key in ("registered", "tie_points", "observations", "components"):
            assert report["block"][key] == whole["block"][key]
        assert sorted(report["gnss"]["flights"]) == ["june", "may"]


@pytest.mark.survey
def test_what_is_done_is_not_done_again(project: Path, said: str) -> None:
    assert said
    stages = sorted(project.parent.glob("work*/*.stage/stage.json"))
    before = {path: path.stat().st_mtime_ns for path in stages}
    assert "up to date" in command("epochs", project)
    assert {path: path.stat().st_mtime_ns for path in stages} == before


@pytest.mark.survey
def test_stages_are_shared_and_not_copied(project: Path, said: str) -> None:
    assert said
    survey = load_project(project)
    own = survey_of(survey, "may")
    one, other = (w / "adjustment.stage" / "adjustment.npz" for w in (survey.work, own.work))
    assert one.read_bytes() == other.read_bytes()
    share_stages(Workspace(survey.work), Workspace(own.work))  # nothing to do
    assert not list(own.work.glob("*.partial"))
    assert survey_of(survey, "june").photographs_without_products == frozenset(survey.epochs[0].photographs)


def test_three_epochs_are_compared_in_turn_and_from_first_to_last(project: Path) -> None:
    survey = load_project(project)
    first, second = survey.epochs
    three = replace(survey, epochs=(first, second, replace(second, name="july")))
    assert pairs_of(survey) == [Pair("may", "june")]
    assert pairs_of(three) == [Pair("may", "june"), Pair("june", "july"), Pair("may", "july")]
    assert output_of(three, Pair("may", "july")).name == "results_july_minus_may"


def test_a_project_without_epochs_says_so(tmp_path: Path, project: Path, photogram: Run) -> None:
    text = project.read_text(encoding="utf-8").split("epochs:")[0]
    shutil.copytree(project.parent / "photographs", tmp_path / "photographs")
    (tmp_path / "project.yaml").write_text(text, encoding="utf-8")
    outcome = photogram("epochs", tmp_path / "project.yaml")
    assert outcome.code != 0
    assert "epochs: none are given: name two or more" in outcome.err
