"""What the process of a task says in events, as NodeODM tells it: lines of a console, and a share in per cent."""

from collections.abc import Iterable, Sequence

from photogram.background.runs import MOST_EVENTS, Runs
from photogram.pipeline.stage_names import StageName
from photogram.terminal.events import Event

BEGUN, WORKED_OUT = 1.0, 95.0
"""Per cent: once the project file is written, and when the survey is worked out and only packed."""


def all_events(runs: Runs) -> list[Event]:
    """Return what a process has said so far."""
    events = list[Event]()
    while True:
        more = runs.view(len(events)).events
        events += more
        if len(more) < MOST_EVENTS:
            return events


def lines_of(events: Iterable[Event]) -> list[str]:
    """Return the lines of a console that say the events; how far a stage is, is not among them."""
    lines, titles, began = list[str](), dict[StageName, str](), dict[StageName, float]()
    for event in events:
        stage, text = event["stage"], event["text"]
        match event["event"]:
            case "begin" if stage is not None:
                titles[stage], began[stage] = text, event["seconds"]
                lines.append(f"{text} …")
            case "end" if stage is not None:
                took_s = event["seconds"] - began.get(stage, event["seconds"])
                lines.append(f"{titles.get(stage, stage)}: {text} ({took_s:.1f} s)")
            case "warning":
                lines.append(f"Warning: {text}")
            case "error":
                lines.append(f"Error: {text}")
            case "begin" | "end" | "done" if text:
                lines.append(text)
    return [line for text in lines for line in text.splitlines()]


def share_percent(events: Iterable[Event]) -> float:
    """Return how far the process is, in per cent; it never falls."""
    share = 0.0
    for event in events:
        left = event["seconds_left"]
        if event["stage"] is not None and left is not None:
            whole = event["seconds"] + left
            worked = event["seconds"] / whole if whole else 0.0
            share = max(share, BEGUN + (WORKED_OUT - BEGUN) * worked)
        elif event["event"] == "done":
            share = max(share, WORKED_OUT)
    return share


def last_error(events: Sequence[Event]) -> str:
    """Return the error that ended a process, empty where it said none."""
    return next((event["text"] for event in reversed(events) if event["event"] == "error"), "")


def from_line(lines: Sequence[str], first: int) -> list[str]:
    """Return the lines from one on; of a negative number so many last ones."""
    return list(lines[first:])
