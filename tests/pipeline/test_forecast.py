"""What is said before the work: which stages remain, what each takes, and what an earlier run has taught."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from photogram.files.photographs.images import read_tags
from photogram.pipeline.costs.earlier_runs import MOST_FACTOR
from photogram.pipeline.costs.forecast import Forecast, compiled_share, forecast
from photogram.pipeline.costs.self_test import Speed
from photogram.pipeline.input_validation import predicted_costs
from photogram.pipeline.pipeline import STAGES, load_project, remaining_stages
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.project.project import Project

WARM, COLD = (dict.fromkeys(STAGE_NAMES, share) for share in (1.0, 0.0))


def of(project: Project, speed: Speed | None = None, **more: Any) -> Forecast:
    tags = [read_tags(p.path) for p in project.photographs]
    return forecast(STAGES, project, tags, speed or Speed(), 2, **{"compiled": WARM, **more})


def test_nothing_is_there_so_everything_remains(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    assert remaining_stages(project) == STAGE_NAMES
    assert remaining_stages(project, until="matches") == STAGE_NAMES[:4]
    assert not project.work.exists()
    costs = of(project)
    assert [cost.stage for cost in costs.stages] == list(STAGE_NAMES)
    assert costs.seconds == pytest.approx(sum(costs.seconds_by_stage.values()))
    assert costs.memory_bytes == max(cost.memory_bytes for cost in costs.stages) > 3e8


def test_what_is_not_asked_for_takes_no_time_and_is_not_compiled(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    bare = replace(
        project,
        dense=replace(project.dense, enabled=False),
        orthophoto=replace(project.orthophoto, enabled=False),
        contours=replace(project.contours, enabled=False),
        terrain=replace(project.terrain, enabled=False),
        reference=None,
    )
    idle = [cost for cost in of(bare, compiled=COLD).stages if not cost.seconds]
    assert [cost.stage for cost in idle] == ["dense", "volumes", "relief", "orthophoto", "comparison"]
    assert all(cost.compilation_seconds == 0.0 for cost in idle)


def test_a_first_run_compiles_and_a_slow_machine_takes_longer(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    warm, cold, slow = of(project), of(project, compiled=COLD), of(project, Speed(2.0, 2.0, 2.0, 2.0))
    assert warm.compilation_seconds == 0.0
    assert cold.seconds - warm.seconds == pytest.approx(cold.compilation_seconds)
    assert cold.compilation_seconds == pytest.approx(sum(stage.costs.compilation_s for stage in STAGES))
    assert slow.seconds == pytest.approx(2 * warm.seconds)
    assert all(0.0 <= share <= 1.0 for share in compiled_share(STAGES).values())


def test_what_remains_is_what_a_run_would_do(
    adjusted_survey: Path, edit: Callable[[Path, Callable[[dict[str, Any]], object]], None]
) -> None:
    project = adjusted_survey / "project.yaml"
    survey = load_project(project)
    assert remaining_stages(survey) == ()  # though it was made in another folder, before it was copied
    (survey.results / "quality/report.json").unlink()
    assert remaining_stages(survey) == ("results",)
    assert remaining_stages(survey, until="comparison") == ()
    tags = [read_tags(p.path) for p in survey.photographs]
    assert predicted_costs(survey, tags, until="comparison").stages == ()
    assert [cost.stage for cost in predicted_costs(survey, tags).stages] == ["results"]
    assert remaining_stages(survey, start="orthophoto") == ("orthophoto", "comparison", "results")
    edit(project, lambda values: values.update(contours={"interval_m": 0.7}))
    assert remaining_stages(load_project(project)) == ("relief", "results")
    (adjusted_survey / "work/adjustment.stage/stage.json").unlink()
    assert remaining_stages(load_project(project))[:2] == ("adjustment", "dense")


def test_a_stage_is_thought_to_take_what_it_took(adjusted_survey: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    summary = json.loads((adjusted_survey / "work/results.stage/stage.json").read_text(encoding="utf-8"))
    took = summary["seconds"] - summary.get("compilation_seconds", 0.0)
    fresh = of(replace(project, work=adjusted_survey / "elsewhere")).seconds_by_stage["results"]
    learnt = of(project).seconds_by_stage["results"]
    believed = fresh / MOST_FACTOR <= took <= MOST_FACTOR * fresh  # not on a machine that was busy when it was made
    assert learnt == pytest.approx(took if believed else fresh)
    only = of(project, remaining=("results",))
    assert [cost.stage for cost in only.stages] == ["results"]
    assert only.seconds == pytest.approx(learnt)
    assert only.disk_bytes < of(project).disk_bytes


def test_the_machine_is_tested_where_the_work_is_long_enough(survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = load_project(survey / "project.yaml")
    tags = [read_tags(p.path) for p in project.photographs]
    monkeypatch.setattr("photogram.pipeline.input_validation.compiled_share", lambda _: WARM)
    monkeypatch.setattr("photogram.pipeline.input_validation.measured_speed", lambda: Speed(3.0, 3.0, 3.0, 3.0))
    short = predicted_costs(project, tags)
    assert short == predicted_costs(project, tags, test=False)
    monkeypatch.setattr("photogram.pipeline.input_validation.WORTH_TESTING_S", 1.01 * short.seconds)
    assert predicted_costs(project, tags) == short
    monkeypatch.setattr("photogram.pipeline.input_validation.WORTH_TESTING_S", 0.99 * short.seconds)
    assert predicted_costs(project, tags).seconds == pytest.approx(3.0 * short.seconds)
    assert predicted_costs(project, tags, test=False) == short
    monkeypatch.setattr("photogram.pipeline.input_validation.WORTH_TESTING_S", 0.0)
    first = predicted_costs(project, tags, until="photographs")
    assert first == predicted_costs(project, tags, until="photographs", test=False)
