"""Watchers of a pipeline: what reaches the terminal, and which events a program gets, by a clock of their own."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from photogram.cli.work.schema import event_schema
from photogram.pipeline.pipeline import STAGES
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.terminal.events import EventLines
from photogram.terminal.progress import LEAST_PAUSE_S, EventWatcher, Quiet

STAGE = {stage.name: stage for stage in STAGES}


class Clock:
    """A clock that goes as it is told."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def told() -> Iterator[tuple[EventWatcher, Clock, list[dict[str, Any]]]]:
    clock, events = Clock(), list[dict[str, Any]]()
    lines = EventLines(lambda line: events.append(json.loads(line)), clock)
    yield EventWatcher(lines, {"features": 10.0, "matches": 30.0}, clock), clock, events
    validator = Draft202012Validator(event_schema())
    for event in events:
        assert list(validator.iter_errors(event)) == []


def test_events_of_a_stage_and_its_time_left(told: tuple[EventWatcher, Clock, list[dict[str, Any]]]) -> None:
    watcher, clock, events = told
    watcher.begin(STAGE["features"])
    for piece in range(1, 101):
        clock.now += 0.1
        watcher.advance(STAGE["features"], piece, 100, f"{piece}.jpg")
    watcher.end(STAGE["features"], 10.0, {"key_points": [10, 20]})
    assert events[0] == {
        "event": "begin", "stage": "features", "done": 0, "total": None, "text": STAGE["features"].title,
        "seconds": 0.0, "seconds_left": 40.0,
    }  # fmt: skip
    advances = [event for event in events if event["event"] == "advance"]
    assert len(advances) == pytest.approx(10.0 / LEAST_PAUSE_S, abs=3)
    assert advances[-1]["done"] == advances[-1]["total"] == 100
    assert advances[-1]["text"] == "100.jpg"
    left_s = [event["seconds_left"] for event in events]
    assert left_s == sorted(left_s, reverse=True)
    assert events[-1]["event"] == "end"
    assert events[-1]["seconds"] == pytest.approx(10.0)
    assert events[-1]["seconds_left"] == pytest.approx(30.0, abs=1.5)
    assert "15 key points" in events[-1]["text"]


def test_what_is_up_to_date_says_so(told: tuple[EventWatcher, Clock, list[dict[str, Any]]]) -> None:
    watcher, _, events = told
    watcher.begin(STAGE["features"])
    watcher.end(STAGE["features"], None, {"key_points": [10, 20]})
    assert events[-1]["text"].startswith("up to date: ")
    assert events[-1]["seconds_left"] == pytest.approx(30.0)


def test_a_piece_of_unknown_number_has_no_total(told: tuple[EventWatcher, Clock, list[dict[str, Any]]]) -> None:
    watcher, clock, events = told
    watcher.begin(STAGE["adjustment"])
    clock.now += 1.0
    watcher.advance(STAGE["adjustment"], 0, 0, "round 2")
    watcher.warn("doubtful")
    assert [(e["event"], e["total"], e["text"]) for e in events[1:]] == [
        ("advance", None, "round 2"),
        ("warning", None, "doubtful"),
    ]
    assert events[-1]["stage"] == "adjustment"


def test_the_schema_knows_the_stages_and_refuses_what_is_not_said() -> None:
    validator = Draft202012Validator(event_schema())
    event = {"event": "begin", "stage": "dense", "done": 0, "total": None, "text": "", "seconds": 1.0,
             "seconds_left": None}  # fmt: skip
    assert validator.is_valid(event)
    for wrong in ({"stage": "denes"}, {"event": "start"}, {"seconds": -1.0}, {"done": None}, {"more": 1}):
        assert not validator.is_valid(event | wrong), wrong
    assert all(validator.is_valid(event | {"stage": name}) for name in STAGE_NAMES)


def test_quiet_says_warnings_alone(capsys: pytest.CaptureFixture[str]) -> None:
    watcher = Quiet()
    watcher.begin(STAGE["features"])
    watcher.advance(STAGE["features"], 1, 2, "a.jpg")
    watcher.end(STAGE["features"], 1.0, {"key_points": [1]})
    assert capsys.readouterr().out == ""
    watcher.warn("a file [1] was damaged")
    assert capsys.readouterr().out == "Warning: a file [1] was damaged\n"
