"""What a stage of a survey is, and who is told what it does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage_summary import StageSummary
from photogram.wording import Progress

Settings = Callable[[Run], object]
Work = Callable[[Run, Path, Progress], StageSummary]


@dataclass(frozen=True)
class Stage:
    """One stage of a survey.

    ``name`` is its folder's, ``title`` what is shown, ``needs`` the stages whose results it reads, ``settings`` what
    else it depends on, ``work`` what it does. ``as_made`` returns the settings that its present result was made under
    where it holds under today's too, None where it does not, or there is none.
    """

    name: str
    title: str
    needs: tuple[str, ...]
    settings: Settings
    work: Work
    as_made: Settings | None = None


class Watcher(Protocol):
    """Told by the pipeline what it does; the command line shows it."""

    def begin(self, stage: Stage) -> None:
        """Start a stage."""

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""

    def end(self, stage: Stage, seconds: float | None, summary: StageSummary) -> None:
        """End a stage; ``seconds`` is None when its result was already there."""

    def warn(self, text: str) -> None:
        """Say what is doubtful, in a sentence."""


@dataclass(frozen=True)
class Silent:
    """A watcher that says nothing."""

    def begin(self, stage: Stage) -> None:
        """Start a stage."""

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""

    def end(self, stage: Stage, seconds: float | None, summary: StageSummary) -> None:
        """End a stage."""

    def warn(self, text: str) -> None:
        """Say what is doubtful."""
