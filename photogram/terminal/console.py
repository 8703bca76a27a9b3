"""The terminal: where the commands print, and bars of their progress."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.progress import Progress as Bars
from rich.text import Text

from photogram.terminal.interruption import raise_if_interrupted
from photogram.terminal.time_left import TimeLeft
from photogram.wording import Progress

console = Console(highlight=False)
errors = Console(stderr=True, highlight=False)


class TimeLeftColumn(ProgressColumn):
    """The time left of a task, from the callable in its field ``left``."""

    def render(self, task: Task) -> Text:
        """Return the words for a task."""
        left: Callable[[], str] | None = task.fields.get("left")
        return Text("" if left is None else left(), style="cyan")


@contextmanager
def bars(to: Console | None = None) -> Iterator[Bars]:
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
    with Bars(*columns, console=target, transient=True, disable=not target.is_terminal) as progress:
        yield progress


@contextmanager
def steps(title: str, to: Console | None = None) -> Iterator[Progress]:
    """Show one bar while the block runs, and give what reports progress to it."""
    left = TimeLeft({title: 1.0})
    left.begin(title)
    with bars(to) as progress:
        task = progress.add_task(title, total=None, text="", left=left.words)

        def report(done: int, of: int, text: str) -> None:
            raise_if_interrupted()
            left.advance(done, of)
            progress.update(task, completed=done, total=of or None, text=escape(text))

        yield report
