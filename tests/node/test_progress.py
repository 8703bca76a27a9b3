"""Events of a process as lines of a console and a share in per cent."""

from photogram.node.progress import from_line, last_error, lines_of, share_percent
from photogram.pipeline.stage_names import StageName
from photogram.terminal.events import Event, EventName


def event(
    name: EventName, text: str = "", stage: StageName | None = None, seconds: float = 0.0, left: float | None = None
) -> Event:
    return {
        "event": name, "stage": stage, "done": 0, "total": None, "text": text, "seconds": seconds, "seconds_left": left,
    }  # fmt: skip


EVENTS = [
    event("begin", "photogram works on 4 photographs"),
    event("warning", "left out, x.jpg: is damaged"),
    event("begin", "Features", "features", 2.0, 18.0),
    event("advance", "x.jpg", "features", 5.0, 15.0),
    event("end", "800 key points", "features", 6.0, 14.0),
    event("begin", "Matching", "matches", 6.0, 24.0),  # more than was thought
    event("error", "two lines\nof an error"),
]


def test_lines_say_what_happens_and_not_how_far_it_is() -> None:
    assert lines_of(EVENTS) == [
        "photogram works on 4 photographs",
        "Warning: left out, x.jpg: is damaged",
        "Features …",
        "Features: 800 key points (4.0 s)",
        "Matching …",
        "Error: two lines",
        "of an error",
    ]


def test_the_share_never_falls_and_leaves_a_rest_for_packing() -> None:
    shares = [share_percent(EVENTS[:number]) for number in range(len(EVENTS) + 1)]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[4] == 1.0 + 94.0 * 5.0 / 20.0
    assert shares[-1] == 1.0 + 94.0 * 6.0 / 20.0
    assert share_percent([*EVENTS, event("done")]) == 95.0


def test_the_error_is_the_last_one() -> None:
    assert last_error(EVENTS) == "two lines\nof an error"
    assert last_error(EVENTS[:-1]) == ""


def test_lines_are_counted_from_the_beginning_or_the_end() -> None:
    lines = ["a", "b", "c"]
    assert [from_line(lines, first) for first in (0, 2, 5, -2)] == [lines, ["c"], [], ["b", "c"]]
