"""What the terminal says at the end of a run, and while other commands work."""

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from rich.progress import Progress

from photogram.change.work import compare as run_compare
from photogram.cli.work import view as run_view
from photogram.files.clouds.points import write_xyz
from photogram.simulation.work import plan as run_plan
from photogram.survey import PointCloud
from photogram.terminal import console as terminal

Run = Callable[..., Any]


@pytest.mark.usefixtures("undrawn")
def test_adjust_ends_with_the_report_and_the_words_for_the_view(
    adjusted_survey: Path, photogram: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(adjusted_survey)
    report, view = photogram("adjust", "project.yaml").out.splitlines()[-2:]
    assert report == "Report: results/deliverables/report.html"
    assert view == "3-D view: photogram view results --open"
    monkeypatch.chdir("/")
    report, view = photogram("adjust", adjusted_survey / "project.yaml", "--until", "results").out.splitlines()[-2:]
    assert Path(report.removeprefix("Report: ")).is_file()
    assert photogram(*shlex.split(view)[3:-1]).code == 0


# ---- progress of the other commands ----------------------------------------------------------------------------------


@pytest.fixture
def bar(monkeypatch: pytest.MonkeyPatch) -> Console:
    """A terminal that records what is drawn on it."""
    console = Console(force_terminal=True, width=200, record=True, highlight=False)
    for module in (terminal, run_compare, run_plan, run_view):
        monkeypatch.setattr(module, "console", console)
    monkeypatch.setattr(run_plan, "errors", console)
    update = Progress.update

    def drawn(self: Progress, *values: Any, **named: Any) -> None:
        update(self, *values, **named)
        self.refresh()

    monkeypatch.setattr(Progress, "update", drawn)
    return console


def test_compare_shows_which_cloud_is_at_work(bar: Console, photogram: Run, tmp_path: Path) -> None:
    points = [[float(x), float(y), 0.1 * x] for x in range(12) for y in range(12)]
    for name in ("first", "second", "reference"):
        write_xyz(tmp_path / f"{name}.txt", PointCloud(np.array(points)))
    clouds = [tmp_path / "first.txt", tmp_path / "second.txt"]
    assert photogram("compare", *clouds, "--reference", tmp_path / "reference.txt", "--output", tmp_path).code == 0
    drawn = bar.export_text()
    for words in ("reading reference.txt", "triangulating reference.txt", "first.txt", "second.txt"):
        assert words in drawn, words


def test_plan_shows_which_change_is_at_work_and_json_stays_json(bar: Console, photogram: Run) -> None:
    outcome = photogram("plan", "--area", "40x40", "--gsd", "0.04", "--json")
    assert outcome.code == 0, outcome.err
    drawn = bar.export_text()
    for words in ("the flight as planned", "one more oblique strip"):
        assert words in drawn, words


def test_view_shows_what_it_does(bar: Console, photogram: Run, adjusted_survey: Path) -> None:
    assert photogram("view", adjusted_survey / "results").code == 0
    drawn = bar.export_text()
    for words in ("reading dense.laz", "thinning and packing", "writing view.html"):
        assert words in drawn, words


def test_json_of_a_plan_is_all_of_standard_output(photogram: Run) -> None:
    outcome = photogram("plan", "--area", "40x40", "--gsd", "0.04", "--json", "--no-changes")
    assert json.loads(outcome.out)
    assert outcome.err == ""
