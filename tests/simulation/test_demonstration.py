"""The built-in demonstration, from rendering to the comparison with its truth."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.judgement import judge
from photogram.simulation.simulated_survey import SurveyPlan, demonstration_plan

Run = Callable[..., Any]


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_built_in_demonstration(tmp_path: Path, photogram: Run) -> None:
    outcome = photogram("demo", tmp_path / "demo", "--seed", "1")
    assert outcome.code == 0, outcome.err
    report = json.loads((tmp_path / "demo/results/quality/report.json").read_text())
    judgement = judge(tmp_path / "demo", report)
    assert len(report["photographs"]) == 12
    assert judgement.check_points == 8
    assert judgement.check_rmse_plan_m <= 1.0 * judgement.gsd_m
    assert judgement.check_rmse_height_m <= 1.5 * judgement.gsd_m
    assert judgement.nmad_m["linear_3view"] >= 2.0 * judgement.nmad_m["adjusted"]
    assert abs(judgement.focal_error_px) < 4.0 * judgement.focal_sigma_px
    assert report["adjustment"]["converged"]
    marks = [m["pixel"] for p in report["control_points"] if p["role"] == "control" for m in p["marks"]]
    assert np.array_equal(marks, np.round(marks)), "control marks are read to whole pixels"
    for figure in (judgement.check_rmse_plan_m, judgement.check_rmse_height_m, judgement.nmad_m["adjusted"]):
        assert f"{figure:.4f}" in outcome.out

    # a second demonstration in the same folder keeps the photographs and finds everything done
    assert photogram("demo", tmp_path / "demo").out.count("up to date") == 16


def test_judgement_is_that_of_the_truth(finished_survey: Path) -> None:
    """The figures of a judgement against a second reckoning from the files."""
    report = json.loads((finished_survey / "results/quality/report.json").read_text())
    truth = json.loads((finished_survey / "truth.json").read_text())
    judgement = judge(finished_survey, report)
    assert judgement.gsd_m == pytest.approx(40.0 / 600.0)
    error = np.array(
        [
            np.subtract(report["photographs"][name]["position_map_m"], centre)
            for name, centre in truth["positions_map_m"].items()
        ]
    )
    assert judgement.camera_rmse_m == pytest.approx(np.sqrt((error**2).sum() / len(error)))
    assert judgement.check_points == report["check_points"]["n"]
    assert judgement.check_rmse_height_m == report["check_points"]["rmse_v_m"]
    assert judgement.focal_error_px == report["cameras"]["simulated"]["focal_px"] - 600.0
    clouds = report["clouds"]
    assert judgement.gain == pytest.approx(clouds["linear_3view"]["nmad_m"] / clouds["adjusted"]["nmad_m"])


def test_photographs_are_rendered_once_for_each_plan_and_seed(
    survey: Path, small_plan: SurveyPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def refuse(plan: SurveyPlan, seed: int) -> None:
        asked.append((plan, seed))
        raise NotImplementedError

    monkeypatch.setattr("photogram.simulation.demonstration.simulate", refuse)
    seed = json.loads((survey / "truth.json").read_text())["seed"]
    assert write_demonstration(survey, seed, lambda *_: None, small_plan) == survey / "project.yaml"
    others = [(small_plan, seed + 1), (dataclasses.replace(small_plan, trees=7), seed), (demonstration_plan(), seed)]
    for plan, other in others:
        with pytest.raises(NotImplementedError):
            write_demonstration(survey, other, lambda *_: None, plan)
    assert asked == others
