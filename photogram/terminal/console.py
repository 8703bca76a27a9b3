"""The terminal: where the commands print, and bars of their progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.text import Text

from photogram.terminal.interruption import raise_if_interrupted
from photogram.terminal.time_left import TimeLeft

console = Console(highlight=False)
errors = Console(stderr=True, highlight=False)


class TimeLeftColumn(ProgressColumn):
    """The time left of a task, from the callable in its field ``left``."""

    def render(self, task: Task) -> Text:
        """Return the words for a task."""
        left: Callable[[], str] | None = task.fields.get("left")
        return Text("" if left is None else left(), style="cyan")


@contextmanager
def bars(to: Console | None = None) -> Iterator[Progress]:
    """Show progress bars while the block runs, on standard output unless another console is given; on no terminal,
    none."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<20}"),
        BarColumn(),
        TextColumn("{task.fields[text]}"),
        TimeLeftColumn(),
    )
    target = to or console
    with Progress(*columns, console=target, transient=True, disable=not target.is_terminal) as progress:
        yield progress


@contextmanager
def steps(title: str, total: int | None = None, to: Console | None = None) -> Iterator[Callable[[int, int, str], None]]:
    """Show one bar while the block runs, and give what reports progress to it: pieces done, of how many, and which one
    is at work (0 of 0 where their number is not known)."""
    left = TimeLeft({title: 1.0})
    left.begin(title)
    with bars(to) as progress:
        task = progress.add_task(title, total=total, text="", left=left.words)

        def report(done: int, of: int, text: str) -> None:
            raise_if_interrupted()
            left.advance(done, of)
            progress.update(task, completed=done, total=of or None, text=escape(text))

        yield report
