"""What a command tells a program that runs it: one JSON object on a line of standard output for each event.

Imports nothing that computes, so that an error of the project file is an event as well.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Literal

import typer
from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict

from photogram.pipeline.stage_names import StageName
from photogram.terminal.exit_codes import in_words

EventName = Literal["begin", "advance", "end", "warning", "error", "done"]
Pieces = Annotated[int, Field(ge=0)]
Seconds = Annotated[float, Field(ge=0)]


@with_config(ConfigDict(strict=True, allow_inf_nan=False, extra="forbid"))
class Event(TypedDict):
    """One line of `--json`: what happened, in which stage (null outside of all), `done` of `total` pieces of that stage
    (null while their number is not known), words for people, the seconds since the command began, and those that it
    will still take (null while they are not known)."""

    event: EventName
    stage: StageName | None
    done: Pieces
    total: Pieces | None
    text: str
    seconds: Seconds
    seconds_left: Seconds | None


def _print(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()  # a program reads it while the work goes on


class EventLines:
    """Writes events as lines; the clock starts with it."""

    def __init__(self, write: Callable[[str], None] = _print, clock: Callable[[], float] = time.monotonic) -> None:
        self._write, self._clock = write, clock
        self._start = clock()

    def say(
        self,
        event: EventName,
        text: str = "",
        *,
        stage: StageName | None = None,
        done: int = 0,
        total: int | None = None,
        seconds_left: float | None = None,
    ) -> None:
        """Write an event."""
        line: Event = {
            "event": event,
            "stage": stage,
            "done": done,
            "total": total,
            "text": text,
            "seconds": round(self._clock() - self._start, 3),
            "seconds_left": None if seconds_left is None else round(seconds_left, 1),
        }
        self._write(json.dumps(line))

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Write what the block raises as an error, and hand it on."""
        try:
            yield
        except (typer.Exit, typer.Abort, BrokenPipeError):
            raise
        except (Exception, KeyboardInterrupt) as cause:
            self.say("error", in_words(cause))
            raise


@contextmanager
def event_lines(wanted: bool) -> Iterator[EventLines | None]:
    """Give what writes events, among them what the block raises; None where they are not wanted."""
    if not wanted:
        yield None
        return
    lines = EventLines()
    with lines.errors():
        yield lines
