"""A running pipeline on the terminal: one bar for the stage at work, one line for each stage that is done."""

from __future__ import annotations

from collections.abc import Mapping

from rich.markup import escape
from rich.progress import Progress, TaskID
from rich.table import Table

from photogram.cli.interruption import raise_if_interrupted
from photogram.cli.screen.stage_lines import sentence
from photogram.cli.screen.time_left import TimeLeft
from photogram.pipeline.store.stage import Stage
from photogram.pipeline.store.stage_summary import StageSummary
from photogram.project.project import Project

COARSE_CELLS = 0.3
"""Share of the dense matching where the project asks for a cell size, which is coarser than the photographs' own."""


def stage_weights(survey: Project, until: str | None = None) -> dict[str, float]:
    """Return the weights of the stages up to ``until``, in order; what a survey does not ask for weighs nothing.

    They are seconds, on two cores, fitted to surveys of 3 to 41 photographs of 0.5 to 115 megapixels, and right to a
    factor of three: what matters is how the stages of one survey compare.
    """
    photographs = len(survey.photographs)
    cameras = [survey.cameras[photograph.camera] for photograph in survey.photographs]
    megapixels = sum(camera.width_px * camera.height_px for camera in cameras) / 1e6
    dense = 1.4 * megapixels * (1.0 if survey.surface.cell_m is None else COARSE_CELLS) * survey.dense.enabled
    weights = {
        "photographs": 0.02 * photographs,
        "features": 0.15 * photographs + 0.07 * megapixels,
        "pairs": 0.01 * photographs,
        "matches": 0.6 * photographs,
        "tie_points": 0.01 * photographs,
        "orientation": 0.1 * photographs,
        "transfer": 0.1 * photographs + 0.03 * megapixels,
        "intersection": 0.01 * photographs,
        "adjustment": 1.0 + 0.3 * photographs,
        "dense": dense,
        "surface": 0.5 + 0.03 * dense,
        "relief": 0.1 + 0.01 * dense,
        "orthophoto": 0.3 * megapixels * survey.orthophoto.enabled,
        "comparison": 1.5 if survey.reference is not None else 0.0,
        "results": 6.0 + 0.2 * photographs + 0.03 * megapixels,
    }
    names = list(weights)
    last = len(names) if until is None else names.index(until) + 1
    return {name: weights[name] for name in names[:last]}


class Terminal:
    """The watcher of a pipeline that shows it on the terminal."""

    def __init__(self, progress: Progress, weights: Mapping[str, float]) -> None:
        self._progress = progress
        self._left = TimeLeft(weights)
        self._task: TaskID | None = None

    def begin(self, stage: Stage) -> None:
        """Start a stage."""
        raise_if_interrupted()
        if self._task is not None:  # of a stage that has to wait until another is made again
            self._progress.remove_task(self._task)
        self._left.begin(stage.name)
        self._task = self._progress.add_task(stage.title, total=None, text="", left=self._left.words)

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""
        raise_if_interrupted()
        self._left.advance(done, total)
        if self._task is not None:
            shown = escape(text)
            self._progress.update(self._task, description=stage.title, completed=done, total=total or None, text=shown)

    def end(self, stage: Stage, seconds: float | None, summary: StageSummary) -> None:
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

    def warn(self, text: str) -> None:
        """Say what is doubtful."""
        self._progress.console.print(f"[bold yellow]Warning:[/bold yellow] {escape(text)}", soft_wrap=True)
