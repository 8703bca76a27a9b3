"""The process of a task, without its survey: what it writes to the project file, and how its command's end is told."""

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from photogram.errors import ReportError, WorkspaceError
from photogram.node import process
from photogram.node.options import checked_options
from photogram.node.process import FAILED, INTERRUPTED, ground_sampling_m
from photogram.node.tasks import Task, TaskFolder
from photogram.pipeline.pipeline import load_project
from photogram.terminal.events import EventLines

UUID = "01234567-89ab-4cde-8f01-23456789abcd"


def test_the_ground_sampling_distance_is_that_of_flying_height_and_focal_length(survey: Path) -> None:
    """40 m and 604 px, whatever cells the project asks for."""
    project = load_project(survey / "project.yaml")
    assert ground_sampling_m(project) == pytest.approx(40.0 / 604.0, rel=0.05)
    finer = replace(project, surface=replace(project.surface, cell_m=0.01))
    assert ground_sampling_m(finer) == ground_sampling_m(project)


@pytest.mark.parametrize(("ignore", "cells"), [(False, (0.066, 0.3)), (True, (0.02, 0.3))])
def test_cells_are_as_fine_as_the_photographs_resolve(survey: Path, ignore: bool, cells: tuple[float, float]) -> None:
    said: list[str] = []
    given = {"orthophoto-resolution": 2, "dem-resolution": 30, "ignore-gsd": ignore}
    options = checked_options(json.dumps([{"name": name, "value": value} for name, value in given.items()]))
    lines = process._settings(TaskFolder(survey), options, EventLines(said.append))
    assert lines["orthophoto", "cell_m"] == pytest.approx(cells[0], rel=0.05)
    assert lines["surface", "cell_m"] == cells[1]
    assert len(said) == (not ignore)
    assert all("orthophoto-resolution: 2 cm is finer than the photographs resolve" in line for line in said)


@pytest.mark.parametrize(("code", "outcome"), [(0, 0), (1, 1), (130, INTERRUPTED), (-signal.SIGINT, INTERRUPTED)])
def test_the_end_of_the_command_is_that_of_the_task(code: int, outcome: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "call", lambda *_, **__: code)
    assert process._called(["adjust"]) == outcome


def test_a_command_that_the_system_ended_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "call", lambda *_, **__: -signal.SIGTERM)
    with pytest.raises(WorkspaceError, match=r"the system ended the work \(SIGTERM"):
        process._called(["adjust"])


def test_a_report_that_cannot_be_printed_is_a_warning(survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_: object) -> Path:
        raise ReportError("no browser is installed")

    said: list[str] = []
    monkeypatch.setattr(subprocess, "call", lambda *_, **__: 0)
    monkeypatch.setattr(process, "print_report", refused)
    folder = TaskFolder(survey)
    assert process._adjusted(folder, {}, EventLines(said.append)) == 0
    assert "no report.pdf, report.html is there: no browser is installed" in said[0]
    assert process._adjusted(folder, {"skip-report": True}, EventLines(said.append)) == 0
    assert len(said) == 1


def test_an_error_is_an_event_and_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = TaskFolder(tmp_path)
    folder.write(Task(UUID, "none", 0))
    folder.images.mkdir()
    monkeypatch.setattr(sys, "argv", ["process", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        process.main()
    assert ended.value.code == FAILED
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert events[-1]["event"] == "error"
    assert "no photographs" in events[-1]["text"]
    monkeypatch.setattr(process, "_done", lambda *_: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        process.main()
    assert "a defect of photogram (ZeroDivisionError" in capsys.readouterr().out
