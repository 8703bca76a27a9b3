"""Whole surveys with known truth, from a folder of photographs to the report, as a user runs them.

The photographs are rendered once: 24 of a consumer drone, with an EXIF focal length and positions good to 2 m.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.stats import chi2
from seeds import ALL, seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.report.record.report import Report, oriented
from photogram.sfm.similarity import fit_similarity
from photogram.simulation.simulated_survey import (
    SimulatedSurvey,
    SurveyPlan,
    render_photographs,
    rtk_plan,
    simulate,
    simulate_block,
    whole_survey_plan,
)
from photogram.simulation.survey_files import shuffled_names, write_survey

Run = Callable[..., Any]
Pictures = dict[str, np.ndarray]
PLAN = whole_survey_plan(800)
SEED = 1
FOREIGN = ("sim_0010.JPG", "sim_0020.JPG")


@pytest.fixture(scope="session")
def survey() -> SimulatedSurvey:
    return simulate(PLAN, SEED)


@pytest.fixture(scope="session")
def pictures(survey: SimulatedSurvey) -> Pictures:
    return dict(render_photographs(survey))


SPARSE: dict[str, Any] = {"dense": {"enabled": False}, "orthophoto": {"enabled": False}}
"""No dense surface: these tests are about orientation."""


def settle(folder: Path, photogram: Run, *options: str) -> Path:
    """Write project.yaml with `photogram init`, and settings that keep the test short."""
    project = folder / "project.yaml"
    outcome = photogram("init", folder / "photographs", "--crs", PLAN.crs, "--project", project, *options)
    assert outcome.code == 0, outcome.err
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    values["features"] = {**(values.get("features") or {}), "maximum": 1500 if ALL else 1000}
    values |= SPARSE
    project.write_text(yaml.safe_dump(values, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return project


def adjusted(project: Path) -> Report:
    report = run_pipeline(load_project(project))
    assert report["adjustment"]["converged"]
    return report


def truth_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "truth.json").read_text(encoding="utf-8")))


def unregistered(report: Report) -> set[str]:
    return {name for name, photograph in report["photographs"].items() if not photograph["registered"]}


def errors_m(found: Mapping[str, Any], truth: Mapping[str, Any]) -> np.ndarray:
    """Errors (N, 3) of positions in the map, in the order of the names."""
    return np.array([np.subtract(position, truth[name]) for name, position in sorted(found.items())])


def ground(report: Report, role: str) -> dict[str, list[float]]:
    points = report["control_points"]
    return {p["name"]: p["adjusted_map_m"] for p in points if p["role"] == role and p["adjusted_map_m"] is not None}


def plan_and_height_rms(error: np.ndarray) -> tuple[float, float]:
    return float(np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1)))), float(np.sqrt(np.mean(error[:, 2] ** 2)))


def assert_right(report: Report, folder: Path, *, of: int = 10) -> None:
    """Check points, against the surveyed and the true positions, within one GSD in plan and one and a half in
    height."""
    truth, check = truth_of(folder), report["check_points"]
    gsd_m = truth["gsd_m"]
    assert check["n"] == of
    assert check["rmse_h_m"] <= 1.0 * gsd_m
    assert check["rmse_v_m"] <= 1.5 * gsd_m
    plan, height = plan_and_height_rms(errors_m(ground(report, "check"), truth["ground_points_map_m"]))
    assert plan <= 1.0 * gsd_m
    assert height <= 1.5 * gsd_m


def test_the_photographs_are_those_of_an_ordinary_survey(survey: SimulatedSurvey) -> None:
    control = survey.control_points.with_role("control")
    assert len(survey.photographs) == 24
    assert (len(control), len(survey.control_points)) == (6, 16)
    assert np.bincount(control.mark_photograph, minlength=24).max() < 4, "nothing can be resected from control"
    assert survey.approximate_camera.radial.tolist() == [0, 0, 0, 0]


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_consumer_positions_and_six_control_points(
    survey: SimulatedSurvey, pictures: Pictures, tmp_path: Path, photogram: Run
) -> None:
    write_survey(tmp_path, survey, pictures.items())
    tables = ("--control", str(tmp_path / "points.csv"), "--marks", str(tmp_path / "marks.csv"))
    report = adjusted(settle(tmp_path, photogram, *tables))
    assert not unregistered(report)
    assert report["block"]["registered"] == report["block"]["photographs"] == 24
    assert len(report["block"]["components"]) == 1
    assert_right(report, tmp_path)


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_block_without_control_keeps_its_shape(
    survey: SimulatedSurvey, pictures: Pictures, tmp_path: Path, photogram: Run
) -> None:
    """All points are check points; place, turn and scale are those of GNSS, the rest is the block's own."""
    write_survey(tmp_path, survey, pictures.items())
    everything = tmp_path / "every_point.txt"
    control, check = ((tmp_path / n).read_text(encoding="utf-8").splitlines() for n in ("control.txt", "check.txt"))
    everything.write_text("\n".join([*control, *check[1:]]) + "\n", encoding="utf-8")
    report = adjusted(settle(tmp_path, photogram, "--check", str(everything)))
    assert not unregistered(report)
    truth, found = truth_of(tmp_path), ground(report, "check")
    assert len(found) == 16
    names = sorted(found)
    source, target = np.array([found[n] for n in names]), np.array([truth["ground_points_map_m"][n] for n in names])
    place = target.mean(axis=0)
    fit = fit_similarity(source - place, target - place)
    plan, height = plan_and_height_rms(fit.points(source - place) - (target - place))
    assert plan <= 1.0 * truth["gsd_m"]
    assert height <= 2.0 * truth["gsd_m"]
    # what GNSS of 2 m, and its offset, leave of the position
    assert np.linalg.norm((source - target).mean(axis=0)) < 4.0 * np.linalg.norm(PLAN.gnss_offset_sigma_m)


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_no_positions_and_shuffled_names(pictures: Pictures, tmp_path: Path, photogram: Run) -> None:
    bare = simulate(replace(PLAN, gnss_tags=False), SEED)
    names = shuffled_names(bare)
    assert sorted(names.values()) != list(names.values())
    write_survey(tmp_path, bare, pictures.items(), names=names)
    control, check = tmp_path / "control.txt", tmp_path / "check.txt"
    report = adjusted(settle(tmp_path, photogram, "--control", str(control), "--check", str(check)))
    assert not unregistered(report)
    assert report["block"]["registered"] == 24
    assert_right(report, tmp_path)
    truth, photographs = truth_of(tmp_path), report["photographs"]
    centres = errors_m({n: p["position_map_m"] for n, p in oriented(photographs).items()}, truth["positions_map_m"])
    assert np.linalg.norm(centres, axis=1).max() < 0.02 * PLAN.flying_height_m


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_photographs_of_another_site_are_left_out(
    survey: SimulatedSurvey, pictures: Pictures, tmp_path: Path, photogram: Run
) -> None:
    """Every tenth photograph shows another site, under tags that say it is this one."""
    elsewhere = simulate(PLAN, SEED + 100)
    chosen = [i for i, p in enumerate(elsewhere.photographs) if p.name in FOREIGN]
    seen = replace(
        elsewhere,
        photographs=tuple(elsewhere.photographs[i] for i in chosen),
        truth=replace(elsewhere.truth, poses=tuple(elsewhere.truth.poses[i] for i in chosen)),
    )
    write_survey(tmp_path, survey, pictures.items(), foreign=dict(render_photographs(seen)))
    control, check = tmp_path / "control.txt", tmp_path / "check.txt"
    report = adjusted(settle(tmp_path, photogram, "--control", str(control), "--check", str(check)))
    assert unregistered(report) == set(FOREIGN)
    assert report["block"]["registered"] == 22
    assert_right(report, tmp_path)


def predicted_and_true(plan: SurveyPlan, seed: int) -> tuple[float, float]:
    """The predicted sigma and the true error of the height of one check point, in metres."""
    block = simulate_block(
        plan, seed, tie_points=80, detection=0.5, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5
    )
    result = adjust(block.block, AdjustmentSettings())
    point = seed % len(block.block.control_points)
    error = result.estimates.ground_world_m[point, 2] - block.truth.control_position_world_m[point, 2]
    return float(np.sqrt(result.covariances.ground_m2[point, 2, 2])), float(error)


def test_heights_without_control_are_as_uncertain_as_predicted() -> None:
    """RTK, no control, the focal length known to 1 %: nadir blocks, then with 15 % of oblique photographs."""
    nadir, oblique = (
        np.array([predicted_and_true(rtk_plan(oblique=o), seed) for seed in seeds(50, 20)]) for o in (False, True)
    )
    low, high = (chi2.ppf(q, len(nadir)) for q in (0.005, 0.995))
    for sigma, error in (nadir.T, oblique.T):
        assert np.all(np.abs(error) < 4.0 * sigma)
        assert low < np.sum((error / sigma) ** 2) < high
    assert np.count_nonzero(oblique[:, 0] >= nadir[:, 0]) <= 1  # one that two oblique photographs miss
    assert np.median(oblique[:, 0] / nadir[:, 0]) < 0.6
    assert np.sqrt(np.mean(oblique[:, 1] ** 2)) < 0.75 * np.sqrt(np.mean(nadir[:, 1] ** 2))
    # 1 % of the flying height is what the focal length alone leaves open
    assert 2.0 * rtk_plan().gsd_m < np.median(nadir[:, 0]) < 0.01 * rtk_plan().flying_height_m
