"""``--quiet`` and ``--json``: what `photogram adjust` prints with them, to the last line, and its exit codes."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest
from jsonschema import Draft202012Validator
from pages import blocks_in

from photogram.cli.work.schema import event_schema
from photogram.errors import ProjectError
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.terminal.events import Event, EventLines, EventName, event_lines
from photogram.terminal.output_modes import Brief, InEvents, Spoken, voice_of

Run = Callable[..., Any]


def events_of(out: str) -> list[dict[str, Any]]:
    """Return the events that were printed; each follows the schema."""
    events = [json.loads(line) for line in out.splitlines()]
    validator = Draft202012Validator(event_schema())
    for event in events:
        assert list(validator.iter_errors(event)) == [], event
    seconds = [event["seconds"] for event in events]
    assert seconds == sorted(seconds)
    return events


@pytest.mark.usefixtures("undrawn")
def test_every_stage_is_told_and_the_verdict_comes_last(adjusted_survey: Path, photogram: Run) -> None:
    outcome = photogram("adjust", adjusted_survey / "project.yaml", "--from", "comparison", "--json")
    assert outcome.code == 0
    assert outcome.err == ""
    events = events_of(outcome.out)
    assert [e["stage"] for e in events if e["event"] == "begin"] == list(STAGE_NAMES)
    assert [e["stage"] for e in events if e["event"] == "end"] == list(STAGE_NAMES)
    assert all(e["text"].startswith("up to date") for e in events if e["event"] == "end" and e["stage"] == "features")
    report = json.loads((adjusted_survey / "results/quality/report.json").read_text(encoding="utf-8"))
    assert events[-1]["event"] == "done"
    assert events[-1]["text"] == report["verdict"]["sentence"]
    assert events[-1]["seconds_left"] == 0.0
    warned = [e["text"] for e in events if e["event"] == "warning"]
    for warning in report["warnings"]:
        assert any(warning["sentence"] in text for text in warned) == (warning["severity"] != "note")


@pytest.mark.usefixtures("undrawn")
def test_quiet_prints_warnings_and_one_line(adjusted_survey: Path, photogram: Run) -> None:
    outcome = photogram("adjust", adjusted_survey / "project.yaml", "--quiet")
    assert outcome.code == 0
    assert outcome.err == ""
    *warnings, last = outcome.out.splitlines()
    assert all(line.startswith("Warning: ") for line in warnings)
    report = json.loads((adjusted_survey / "results/quality/report.json").read_text(encoding="utf-8"))
    assert last.startswith(report["verdict"]["sentence"])
    assert last.endswith("results/deliverables/report.html")


@pytest.mark.usefixtures("undrawn")
def test_what_is_removed_of_earlier_results_is_an_event_and_the_verdict_the_last(
    adjusted_survey: Path, photogram: Run, edit: Callable[..., None]
) -> None:
    edit(adjusted_survey / "project.yaml", lambda values: values.update(contours={"enabled": False}))
    outcome = photogram("adjust", adjusted_survey / "project.yaml", "--json")
    assert outcome.code == 0
    events = events_of(outcome.out)
    assert [e["event"] for e in events if "removed contours.gpkg" in e["text"]] == ["warning"]
    assert events[-1]["event"] == "done"


def test_errors_of_the_check_are_events_and_lines(survey: Path, photogram: Run) -> None:
    project = survey / "project.yaml"
    photograph = min(survey.rglob("*.JPG"))
    photograph.write_bytes(photograph.read_bytes()[:200])
    outcome = photogram("adjust", project, "--json")
    assert outcome.code == 1
    events = events_of(outcome.out)
    assert any(e["event"] == "error" and photograph.name in e["text"] for e in events)
    assert not any(e["event"] in ("begin", "done") for e in events)
    quiet = photogram("adjust", project, "--quiet")
    assert quiet.code == 1
    assert any(line.startswith("Error: ") and photograph.name in line for line in quiet.out.splitlines())


def test_a_project_file_that_cannot_be_read_is_an_event_as_well(tmp_path: Path, photogram: Run) -> None:
    project = tmp_path / "project.yaml"
    project.write_text("crs: [", encoding="utf-8")
    outcome = photogram("adjust", project, "--json")
    assert outcome.code == 1
    (event,) = events_of(outcome.out)
    assert event["event"] == "error"
    assert "project.yaml" in event["text"]
    assert "project.yaml" in outcome.err  # people read it there, as without --json


@pytest.mark.parametrize(
    ("raised", "words"),
    [
        (ProjectError("a.yaml:3: wrong"), "a.yaml:3: wrong"),
        (KeyboardInterrupt(), "interrupted"),
        (ZeroDivisionError("no"), "a defect of photogram (ZeroDivisionError: no)"),
    ],
)
def test_what_is_raised_is_told_and_handed_on(
    raised: BaseException, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(type(raised)), event_lines(True):
        raise raised
    (event,) = events_of(capsys.readouterr().out)
    assert (event["event"], event["text"]) == ("error", words)


def test_without_json_nothing_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    with event_lines(False) as none:
        assert none is None
    assert capsys.readouterr().out == ""


def test_the_page_explains_every_key_and_shows_lines_that_follow_the_schema() -> None:
    page = (Path(__file__).parents[2] / "docs/file-formats.md").read_text(encoding="utf-8")
    section = page.split("## Events of --json")[1].split("\n## ")[0]
    assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == list(Event.__annotations__)
    assert all(f"`{name}`" in section for name in get_args(EventName))
    assert len(events_of(blocks_in(section)[0].code.strip())) == 2


def test_json_goes_before_quiet() -> None:
    assert isinstance(voice_of(True, EventLines()), InEvents)
    assert isinstance(voice_of(True, None), Brief)
    assert isinstance(voice_of(False, None), Spoken)
