"""What a stage of a survey is: everything that any part of photogram knows of it, and who is told what it does."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from photogram.pipeline.stage_costs import Costs
from photogram.pipeline.stage_names import StageName
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage_summary import Summary, SummaryT, summary_from
from photogram.wording import Progress

Settings = Callable[[Run], object]
Work = Callable[[Run, Path, Progress], Summary]
Line = Callable[[Summary], str]


def line_of(kind: type[SummaryT], words: Callable[[SummaryT], str]) -> Line:
    """Return what the terminal says of a finished stage, from ``words`` about a summary of its own ``kind``; of a stage
    that made nothing, why."""

    def line(summary: Summary) -> str:
        for key, nothing in (("not_needed", "not needed"), ("left_out", "left out")):
            if key in summary:
                return f"{nothing}: {summary[key]}"
        return words(summary_from(summary, kind))

    return line


@dataclass(frozen=True)
class Stage:
    """One stage of a survey.

    ``name`` is its folder's, ``title`` what is shown, ``needs`` the stages whose results it reads, ``settings`` what
    else it depends on, ``work`` what it does, ``line`` what is said of it in a sentence with units. ``as_made`` returns
    the settings that its present result was made under where it holds under today's too, None where it does not, or
    there is none. ``products`` are files that are copied into the folder of results where they are there.
    ``is_uneven`` says that its first pieces tell nothing of the time that the rest takes.
    """

    name: StageName
    title: str
    needs: tuple[StageName, ...]
    settings: Settings
    work: Work
    line: Line
    costs: Costs
    as_made: Settings | None = None
    products: tuple[str, ...] = ()
    is_uneven: bool = False


class Watcher:
    """Told by the pipeline what it does; the command line shows it. What a watcher does not override it keeps to
    itself."""

    def begin(self, stage: Stage) -> None:
        """Start a stage."""

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:
        """End a stage; ``seconds`` is None when its result was already there."""

    def warn(self, text: str) -> None:
        """Say what is doubtful, in a sentence."""
