"""The time left of a command: said from the start where it was predicted, running down without jumps, never negative,
whatever the stages take."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np
import pytest

from photogram.terminal.time_left import Left, TimeLeft, duration

PREDICTED = {"features": 20.0, "matches": 10.0, "adjustment": 10.0, "dense": 50.0, "results": 10.0}
SILENT = {"adjustment"}  # stages that do not say how far they are
STEP_S = 0.5


def run(seconds: Mapping[str, float], predicted: Mapping[str, float] = PREDICTED) -> Iterator[tuple[float, Left, str]]:
    """Go through a run of stages in steps of half a second; give the true time left, how far it is thought to be, and
    what is said."""
    now, end = 0.0, sum(seconds.values())
    left = TimeLeft(predicted, lambda: now)
    for stage, took in seconds.items():
        left.begin(stage)
        began = now
        while now < began + took - 1e-9:
            now += STEP_S
            if stage not in SILENT:
                left.advance(int(50 * min((now - began) / took, 1.0)), 50)
            known = left.left()
            assert known is not None
            yield end - now, known, left.words()
        left.end(stage, took)


def test_a_run_as_predicted_runs_down_second_by_second() -> None:
    before = sum(PREDICTED.values())
    for true, left, _ in run(PREDICTED):
        assert left.seconds == pytest.approx(true, abs=3.0)
        assert left.seconds <= before + 1e-6
        assert left.share == pytest.approx(1.0 - true / 100.0, abs=0.03)
        before = left.seconds


@pytest.mark.parametrize("pace", [0.4, 0.7, 1.5, 2.5])
def test_a_run_slower_or_faster_throughout_is_learnt(pace: float) -> None:
    """From two fifths of the work on what is said is right to two fifths of the rest, in the end to a fifth."""
    seconds = {name: pace * took for name, took in PREDICTED.items()}
    total = sum(seconds.values())
    for true, left, _ in run(seconds):
        if true < 0.6 * total:
            assert left.seconds == pytest.approx(true, rel=0.4, abs=0.05 * total)
        if true < 0.09 * total:
            assert left.seconds == pytest.approx(true, rel=0.2, abs=0.03 * total)


@pytest.mark.parametrize("factor", [0.1, 4.0, 10.0])
def test_one_stage_unlike_its_prediction_makes_nothing_jump(factor: float) -> None:
    seconds = {**PREDICTED, "dense": factor * PREDICTED["dense"]}
    known = [left for _, left, _ in run(seconds)]
    left_s, share = np.array([k.seconds for k in known]), np.array([k.share for k in known])
    assert np.all(left_s >= 0)
    assert np.all(np.diff(share) >= 0)
    assert share[-1] <= 1.0
    total = sum(seconds.values())
    assert np.abs(np.diff(left_s)).max() < 0.12 * max(total, 100.0)  # in half a second


def test_within_a_stage_the_pieces_rule_in_the_end() -> None:
    """Predicted at a quarter of what it takes: by the middle of the stage the time left is right to a sixth."""
    seconds = {"dense": 200.0}
    for true, left, _ in run(seconds, {"dense": 50.0}):
        if true < 100.0:
            assert left.seconds == pytest.approx(true, rel=0.17, abs=12.0)


def test_words_never_flicker_between_more_and_less() -> None:
    rng = np.random.default_rng(3)
    now, said = 0.0, []
    left = TimeLeft({"features": 300.0}, lambda: now)
    left.begin("features")
    for piece in range(1, 301):
        now += float(rng.lognormal(-0.5, 1.0))  # on average as predicted, single pieces five times as long
        left.advance(piece, 300)
        said.append(left.words())
    shown = [float(words.split(" %")[0]) for words in said]
    assert shown == sorted(shown)
    times = [seconds(words) for words in said]
    assert sum(after > before for before, after in pairwise(times)) <= 3
    assert len({words.split(" of ")[1] for words in said}) <= 6


def seconds(words: str) -> float:
    """Return the seconds left that words say."""
    text = words.split(", ")[1].split(" left")[0]
    if text == "a few seconds":
        return 3.0
    parts = text.split()
    unit = {"h": 3600.0, "min": 60.0, "s": 1.0}
    return sum(float(n) * unit[u] for n, u in zip(parts[::2], parts[1::2], strict=True))


def test_stages_that_are_up_to_date_are_no_work() -> None:
    now = 100.0
    left = TimeLeft(PREDICTED, lambda: now)
    for stage in ("features", "matches", "adjustment"):
        left.begin(stage)
        left.end(stage, None)
    known = left.left()
    assert known is not None
    assert known.share == 0.0
    assert known.seconds == known.total_seconds == pytest.approx(60.0)


def test_pieces_of_an_interrupted_run_are_no_measure() -> None:
    """Of a hundred photographs sixty are there: they pass in a twentieth of a second, and forty are left."""
    now = 0.0
    left = TimeLeft({"features": 100.0}, lambda: now)
    left.begin("features")
    for piece in range(1, 61):
        now += 0.001
        left.advance(piece, 100)
    for piece in range(61, 71):
        now += 2.0
        left.advance(piece, 100)
        known = left.left()
        assert known is not None
        assert 25.0 <= known.seconds <= 70.0
        seconds_left = known.seconds
    assert seconds_left == pytest.approx(60.0, abs=12.0)
    now += 60.0
    left.end("features", 80.06)


def test_preparations_do_not_count_as_the_stage() -> None:
    """Pictures are made smaller in two seconds, then heights are matched for a hundred."""
    now = 0.0
    left = TimeLeft({"dense": 100.0}, lambda: now)
    left.begin("dense", is_uneven=True)
    for piece in range(1, 21):
        now += 0.1
        left.advance(piece, 20)
        known = left.left()
        assert known is not None
        assert known.seconds == pytest.approx(100.0 - now, abs=1.0)
    for piece in range(101):
        left.advance(piece, 100)
        now += 0.98
        known = left.left()
        assert known is not None
        assert known.seconds == pytest.approx(max(100.0 - now, 0.0), abs=4.0)


def test_longer_than_predicted_and_silent_there_is_always_something_left() -> None:
    now = 0.0
    left = TimeLeft({"adjustment": 10.0}, lambda: now)
    left.begin("adjustment")
    for _ in range(200):
        now += 0.5
        known = left.left()
        assert known is not None
        assert 0.0 < known.seconds < 15.0


def test_without_a_prediction_the_pieces_speak_after_some_seconds() -> None:
    now = 0.0
    left = TimeLeft({}, lambda: now)
    left.begin("photographs")
    now = 2.0
    left.advance(1, 10)
    assert left.words() == ""
    now = 4.0
    left.advance(2, 10)
    assert left.words() == "20 %, 15 s left of 20 s"


def test_a_stage_that_is_made_again_begins_anew() -> None:
    now = 0.0
    left = TimeLeft({"features": 10.0, "matches": 10.0}, lambda: now)
    left.begin("features")
    left.end("features", None)
    left.begin("matches")
    left.begin("features")  # found damaged
    now = 12.0
    left.advance(6, 12)
    left.end("features", 12.0)
    left.begin("matches")
    known = left.left()
    assert known is not None
    assert 0.0 < known.seconds < 25.0


@pytest.mark.parametrize(
    ("length_s", "words"),
    [
        (4.0, "a few seconds"),
        (42.0, "40 s"),
        (58.0, "1 min"),
        (80.0, "1 min 20 s"),
        (200.0, "3 min 20 s"),
        (1640.0, "27 min"),
        (7300.0, "2 h"),
        (9000.0, "2 h 30 min"),
    ],
)
def test_durations_are_as_coarse_as_the_estimate(length_s: float, words: str) -> None:
    assert duration(length_s) == words
