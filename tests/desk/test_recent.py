"""Surveys that were open before, and what runs of them do."""

import json
import os
from pathlib import Path

import pytest

from photogram.background.runs import LOCK, NOTE, OUTPUT
from photogram.desk.recent import MOST, RUNS, RecentSurveys, recent_file


def test_the_last_one_is_first_and_those_that_are_gone_are_not_named(tmp_path: Path) -> None:
    surveys = RecentSurveys(tmp_path / "state" / "desk.json")
    assert surveys.folders() == []
    folders = [tmp_path / str(number) for number in range(MOST + 2)]
    for folder in folders:
        folder.mkdir()
        surveys.remember(folder)
    surveys.remember(folders[-2])
    assert surveys.folders() == [folders[-2], folders[-1], *reversed(folders[2:-2])]
    folders[-1].rmdir()
    assert folders[-1] not in surveys.folders()
    (tmp_path / "state" / "desk.json").write_text("{")
    assert surveys.folders() == []


def test_what_a_run_does_is_told_from_what_it_wrote(finished_survey: Path, tmp_path: Path) -> None:
    """Of two surveys, one of which has its intermediate results elsewhere."""
    surveys = RecentSurveys(tmp_path / "desk.json")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "project.yaml").write_text("photogram: 1\nwork: scratch\n")
    notes = tmp_path / "b" / "scratch" / RUNS
    notes.mkdir(parents=True)
    note = {"pid": os.getpid(), "kind": "adjust", "arguments": [], "began_unix_s": 1.0, "paused": True}
    (notes / NOTE).write_text(json.dumps(note))
    (notes / LOCK).touch()
    event = {
        "event": "advance",
        "stage": "dense",
        "done": 3,
        "total": 9,
        "text": "",
        "seconds": 4.0,
        "seconds_left": 8.0,
    }
    (notes / OUTPUT).write_text(json.dumps({**event, "seconds_left": 8.0}) + "\n" + '{"event": "adv')
    for folder in (finished_survey, tmp_path / "b"):
        surveys.remember(folder)
    other, finished = surveys.views()
    assert (other["name"], other["has_results"]) == ("b", False)
    assert (other["run"], other["stage"], other["seconds_left"]) == ("failed", None, None)  # nobody holds its lock
    assert (finished["run"], finished["stage"], finished["has_results"]) == ("none", None, True)


def test_each_user_has_a_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert recent_file() == tmp_path / "photogram" / "desk.json"
    monkeypatch.delenv("XDG_STATE_HOME")
    assert recent_file().is_relative_to(Path.home())
