"""Runs in processes of their own: what they say, and how each end of theirs is told."""

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from photogram.background.runs import ERRORS, LOCK, NOTE, Runs, RunState, RunView
from photogram.errors import WorkspaceError
from photogram.files.portable import try_lock

PATIENCE_S = 60.0


def waited(runs: Runs, wanted: Callable[[RunView], bool]) -> RunView:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        view = runs.view()
        if wanted(view):
            return view
        time.sleep(0.1)
    raise AssertionError(f"still {runs.view()}")


def ended(view: RunView) -> bool:
    return view.state not in ("running", "paused")


def test_before_any_run_there_is_none(tmp_path: Path) -> None:
    assert Runs(tmp_path / "work").view() == RunView("none", None, None, (), 0, None, "")


def test_a_run_says_what_a_terminal_would_hear(survey: Path) -> None:
    runs = Runs(survey / "work" / "runs")
    runs.start("adjust", ["adjust", str(survey / "project.yaml"), "--json", "--until", "photographs"])
    with pytest.raises(WorkspaceError, match="a run is under way already"):
        runs.start("adjust", ["adjust", str(survey / "project.yaml"), "--json"])
    view = waited(runs, ended)
    assert view.state == "done"
    assert [e["event"] for e in view.events if e["stage"] == "photographs"][-1] == "end"
    assert view.next == len(view.events) > 0
    rest = Runs(survey / "work" / "runs").view(after=view.next - 1)  # another server
    assert rest.events == view.events[-1:]


def test_an_error_is_told_in_its_own_words(tmp_path: Path) -> None:
    runs = Runs(tmp_path / "work")
    runs.start("adjust", ["adjust", str(tmp_path / "missing.yaml"), "--json"])
    view = waited(runs, ended)
    assert view.state == "failed"
    assert "missing.yaml" in view.text


def test_where_nothing_can_be_interrupted_a_run_is_ended_and_goes_on(
    survey: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on Windows."""
    monkeypatch.setattr("photogram.background.runs.HAS_GROUPS", False)
    runs = Runs(survey / "work" / "runs")
    runs.start("adjust", ["adjust", str(survey / "project.yaml"), "--json"])
    waited(runs, lambda view: any(e["stage"] is not None for e in view.events))
    runs.pause()
    runs.stop()
    assert waited(runs, ended).state == "stopped"
    runs.start("adjust", ["adjust", str(survey / "project.yaml"), "--json", "--until", "photographs"])
    assert waited(runs, ended).state == "done"


def test_who_holds_the_lock_is_the_run(tmp_path: Path) -> None:
    runs, other = Runs(tmp_path / "work"), Runs(tmp_path / "work")
    runs.pause()  # of nothing
    runs.stop()
    (tmp_path / "work").mkdir(parents=True)
    with (tmp_path / "work" / LOCK).open("ab") as lock:
        assert try_lock(lock.fileno())
        with pytest.raises(WorkspaceError, match="a run is under way already"):
            other.start("adjust", ["adjust", "project.yaml"])
    assert runs.view().state == "none"


@pytest.mark.parametrize(
    ("number", "state", "words"),
    [(signal.SIGINT, "stopped", ""), (signal.SIGKILL, "failed", "It was ended from outside")],
)
def test_a_run_is_held_and_ended(number: signal.Signals, state: RunState, words: str, survey: Path) -> None:
    runs = Runs(survey / "work" / "runs")
    runs.start("adjust", ["adjust", str(survey / "project.yaml"), "--json"])
    waited(runs, lambda view: any(e["stage"] is not None for e in view.events))
    runs.pause()
    assert runs.view().state == "paused"
    heard = runs.view().next
    time.sleep(0.5)
    assert runs.view().next <= heard + 1  # one line may have been under way
    runs.resume()
    assert runs.view().state == "running"
    if number == signal.SIGINT:
        runs.stop()
    else:
        os.killpg(json.loads((survey / "work" / "runs" / NOTE).read_text())["pid"], number)
    view = waited(runs, ended)
    assert view.state == state
    if number == signal.SIGKILL:
        assert words in view.text or (survey / "work" / "runs" / ERRORS).read_text().strip() == view.text
    runs.start("adjust", ["adjust", str(survey / "project.yaml"), "--json", "--until", "photographs"])
    assert waited(runs, ended).state == "done"
