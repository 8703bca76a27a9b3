"""A running pipeline: one bar for the stage at work and one line for each stage that is done on the terminal, warnings
alone, or an event for each of these."""

import time
from collections.abc import Callable, Mapping

from rich.markup import escape
from rich.progress import Progress, TaskID
from rich.table import Table

from photogram.pipeline.stage import Stage, Watcher
from photogram.pipeline.stage_names import StageName
from photogram.pipeline.store.stage_summary import Summary
from photogram.terminal.console import console
from photogram.terminal.events import EventLines
from photogram.terminal.interruption import raise_if_interrupted
from photogram.terminal.time_left import TimeLeft

LEAST_PAUSE_S = 0.5
"""Between two events of progress."""

UP_TO_DATE = "up to date"


class Terminal(Watcher):
    """The watcher of a pipeline that shows it on the terminal; ``predicted`` are the seconds of the stages."""

    def __init__(self, progress: Progress, predicted: Mapping[str, float]) -> None:
        self._progress = progress
        self._left = TimeLeft(predicted)
        self._task: TaskID | None = None

    def begin(self, stage: Stage) -> None:
        """Start a stage."""
        raise_if_interrupted()
        if self._task is not None:  # of a stage that has to wait until another is made again
            self._progress.remove_task(self._task)
        self._left.begin(stage.name, is_uneven=stage.is_uneven)
        self._task = self._progress.add_task(stage.title, total=None, text="", left=self._left.words)

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""
        raise_if_interrupted()
        self._left.advance(done, total)
        if self._task is not None:
            words = escape(text)
            self._progress.update(self._task, description=stage.title, completed=done, total=total or None, text=words)

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:
        """End a stage."""
        self._left.end(stage.name, seconds)
        if self._task is not None:
            self._progress.remove_task(self._task)
            self._task = None
        took = UP_TO_DATE if seconds is None else f"{seconds:.1f} s"
        line = Table.grid(padding=(0, 2, 0, 0))
        line.add_column(style="bold", width=20)
        line.add_column(justify="right", width=11)
        line.add_column(style="dim")
        line.add_row(stage.title, took, escape(stage.line(summary)))
        self._progress.console.print(line)

    def warn(self, text: str) -> None:
        """Say what is doubtful."""
        say_warning(text, self._progress)


def say_warning(text: str, progress: Progress | None = None) -> None:
    """Print a warning, above the bars where there are any."""
    target = console if progress is None else progress.console
    target.print(f"[bold yellow]Warning:[/bold yellow] {escape(text)}", soft_wrap=True)


class Quiet(Watcher):
    """The watcher of a pipeline that says warnings alone."""

    def begin(self, stage: Stage) -> None:  # noqa: ARG002
        """Start a stage."""
        raise_if_interrupted()

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:  # noqa: ARG002
        """Report progress within a stage."""
        raise_if_interrupted()

    def warn(self, text: str) -> None:
        """Say what is doubtful."""
        say_warning(text)


class EventWatcher(Watcher):
    """The watcher of a pipeline that writes events; of progress within a stage one in half a second, and the last."""

    def __init__(
        self, lines: EventLines, predicted: Mapping[str, float], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._lines, self._clock = lines, clock
        self._left = TimeLeft(predicted, clock)
        self._event_at = -LEAST_PAUSE_S
        self._stage: StageName | None = None
        self._done, self._total = 0, 0

    def _seconds_left(self) -> float | None:
        left = self._left.left()
        return None if left is None else left.seconds

    def begin(self, stage: Stage) -> None:
        """Start a stage."""
        raise_if_interrupted()
        self._stage, self._done, self._total = stage.name, 0, 0
        self._left.begin(stage.name, is_uneven=stage.is_uneven)
        self._lines.say("begin", stage.title, stage=self._stage, seconds_left=self._seconds_left())
        self._event_at = self._clock()

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""
        raise_if_interrupted()
        self._left.advance(done, total)
        self._done, self._total = done, total
        if self._clock() - self._event_at < LEAST_PAUSE_S and not 0 < total == done:
            return
        self._event_at = self._clock()
        left_s = self._seconds_left()
        self._lines.say("advance", text, stage=stage.name, done=done, total=total or None, seconds_left=left_s)

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:
        """End a stage."""
        self._left.end(stage.name, seconds)
        words = stage.line(summary)
        text = words if seconds is not None else f"{UP_TO_DATE}: {words}" if words else UP_TO_DATE
        total = self._total or None
        self._lines.say("end", text, stage=stage.name, done=self._done, total=total, seconds_left=self._seconds_left())
        self._stage = None

    def warn(self, text: str) -> None:
        """Say what is doubtful."""
        self._lines.say("warning", text, stage=self._stage, seconds_left=self._seconds_left())
