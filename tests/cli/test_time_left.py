"""The time left of a run: unknown at first, then running down without jumps, whatever the weights of the stages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photogram.cli.screen.time_left import TimeLeft, in_words
from photogram.cli.screen.watching import stage_weights
from photogram.pipeline.pipeline import STAGES, load_project

WEIGHTS = {"features": 20.0, "matches": 10.0, "adjustment": 10.0, "dense": 50.0, "results": 10.0}
SILENT = {"adjustment"}  # stages that do not say how far they are


def run(seconds: Mapping[str, float], weights: Mapping[str, float] = WEIGHTS) -> Iterator[tuple[float, str, str]]:
    """Go through a run of stages in steps of half a second; give the true time left, the stage and what is said."""
    now, end = 0.0, sum(seconds.values())
    left = TimeLeft(weights, lambda: now)
    for stage, duration in seconds.items():
        left.begin(stage)
        began = now
        while now < began + duration:
            now += 0.5
            if stage not in SILENT:
                left.advance(int(50 * min((now - began) / duration, 1.0)), 50)
            yield end - now, stage, left.words()
        left.end(stage, duration)


def figure(words: str) -> float:
    """Return the seconds that words say."""
    if words.startswith("a few"):
        return 10.0
    _, number, unit, _ = words.split()
    return float(number) * {"s": 1.0, "min": 60.0, "h": 3600.0}[unit]


@pytest.mark.parametrize("pace", [0.5, 3.0, 20.0])
def test_a_run_as_weighted_is_predicted_from_a_twentieth_on(pace: float) -> None:
    said = [(true, words) for true, _, words in run({name: pace * weight for name, weight in WEIGHTS.items()})]
    total = pace * sum(WEIGHTS.values())
    assert all(words == "" for true, words in said if true > 0.955 * total)
    assert all(words != "" for true, words in said if true < 0.94 * total - 3.0)
    for true, words in said:
        if words and true > 15:
            assert figure(words) == pytest.approx(true, rel=0.25, abs=45), (true, words)
    times = [figure(words) for _, words in said if words]
    assert times == sorted(times, reverse=True)


def test_a_run_unlike_the_weights_does_not_jump() -> None:
    """Four stages as heavy as thought, and one ten times as heavy: the words change by steps, and settle."""
    seconds = {**WEIGHTS, "dense": 500.0}
    said = [(true, stage, words) for true, stage, words in run(seconds) if words]
    times = np.array([figure(words) for *_, words in said])
    step = times[1:] / times[:-1]
    assert step.max() <= 2.0
    assert step.min() >= 0.5
    turns = np.flatnonzero(np.diff(np.sign(np.diff(times)[np.diff(times) != 0])))
    assert len(turns) <= 2  # down, up once, down
    settled = [(true, words) for true, stage, words in said if stage == "dense" and 100 < true < 400]
    assert all(figure(words) == pytest.approx(true, rel=0.3, abs=60) for true, words in settled)


def test_what_is_up_to_date_takes_no_time_and_tells_nothing() -> None:
    now = 100.0
    left = TimeLeft(WEIGHTS, lambda: now)
    for stage in ("features", "matches", "adjustment"):
        left.begin(stage)
        left.end(stage, None)
    assert left.seconds() is None
    left.begin("dense")
    now += 10.0
    left.advance(1, 4)
    assert left.seconds() == pytest.approx(30.0 + 10.0 * 40.0 / 50.0)


def test_a_second_part_of_a_stage_is_measured_by_itself() -> None:
    now = 0.0
    left = TimeLeft({"dense": 1.0}, lambda: now)
    left.begin("dense")
    now = 4.0
    left.advance(3, 3)  # pictures made smaller, then blocks of cells
    left.advance(0, 100)
    now = 14.0
    left.advance(10, 100)
    assert left.seconds() == pytest.approx(90.0)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (4.0, "a few seconds left"),
        (42.0, "about 40 s left"),
        (200.0, "about 3 min left"),
        (1640.0, "about 25 min left"),
        (9000.0, "about 2.5 h left"),
    ],
)
def test_words_are_as_coarse_as_the_estimate(seconds: float, words: str) -> None:
    assert in_words(seconds) == words


def test_weights_are_those_of_what_the_survey_asks_for(pristine_survey: Path) -> None:
    survey = load_project(pristine_survey / "project.yaml")
    weights = stage_weights(survey)
    assert list(weights) == [stage.name for stage in STAGES]
    assert weights["comparison"] > 0
    assert stage_weights(replace(survey, reference=None))["comparison"] == 0.0
    assert weights["features"] > 0
    assert list(stage_weights(survey, "matches")) == ["photographs", "features", "pairs", "matches"]
