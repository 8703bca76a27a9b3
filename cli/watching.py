"""A running pipeline on the terminal: one bar for the stage at work, one line for each stage that is done."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.markup import escape
from rich.progress import Progress, TaskID
from rich.table import Table

from photogram.cli.stage_lines import sentence
from photogram.cli.time_left import TimeLeft
from photogram.project import Project
from photogram.stages import Stage

WEIGHTS = {
    "photographs": 0.3,
    "features": 16.0,
    "matches": 8.0,
    "tie_points": 0.1,
    "orientation": 2.0,
    "transfer": 4.0,
    "intersection": 0.1,
    "adjustment": 8.0,
    "dense": 25.0,
    "surface": 1.0,
    "relief": 0.4,
    "orthophoto": 12.0,
    "comparison": 1.5,
    "results": 15.0,
}
"""Seconds that each stage takes in a survey of about fifteen photographs, two cores: how the stages compare."""


def stage_weights(survey: Project, until: str | None = None) -> dict[str, float]:
    """Return the weights of the stages up to ``until``, in order; what a survey does not ask for weighs nothing."""
    names = list(WEIGHTS)
    asked = {
        "dense": survey.dense.enabled,
        "orthophoto": survey.orthophoto.enabled,
        "comparison": survey.reference is not None,
    }
    last = len(names) if until is None else names.index(until) + 1
    return {name: WEIGHTS[name] * asked.get(name, True) for name in names[:last]}


class Terminal:
    """The watcher of a pipeline that shows it on the terminal."""

    def __init__(self, progress: Progress, weights: Mapping[str, float]) -> None:
        self._progress = progress
        self._left = TimeLeft(weights)
        self._task: TaskID | None = None

    def begin(self, stage: Stage) -> None:
        """Start a stage."""
        self._left.begin(stage.name)
        self._task = self._progress.add_task(stage.title, total=None, text="", left=self._left.words)

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""
        self._left.advance(done, total)
        if self._task is not None:
            shown = escape(text)
            self._progress.update(self._task, description=stage.title, completed=done, total=total or None, text=shown)

    def end(self, stage: Stage, seconds: float | None, summary: Mapping[str, Any]) -> None:
        """End a stage."""
        self._left.end(stage.name, seconds)
        if self._task is not None:
            self._progress.remove_task(self._task)
            self._task = None
        took = "up to date" if seconds is None else f"{seconds:.1f} s"
        line = Table.grid(padding=(0, 2, 0, 0))
        line.add_column(style="bold", width=20)
        line.add_column(justify="right", width=11)
        line.add_column(style="dim")
        line.add_row(stage.title, took, escape(sentence(stage.name, summary)))
        self._progress.console.print(line)
