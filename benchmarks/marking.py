"""A simulated hand on the page of photogram mark, in a browser without a window: how quickly it marks, how well, and
which of its mistakes are named.

    python benchmarks/marking.py [--seed 1] [--keep FOLDER]          needs Chromium and its driver; some 5 minutes

A rendered survey of 24 photographs with 24 targets, GNSS of 2 m, attitudes of 2.5°. Ten of its points, with at least
seven photographs each, are marked in seven: clicks are off by a normal error of 2 px in column and row, and lie on
whole pixels of the screen. Nothing was processed before. Time is that of the program: the hand does not think.

Then the same once more with 40 mistakes, each made while marking and taken back after: a mark on the neighbouring
target and one 5 px beside (Alt-click, taken as it is) in nine points after four and after seven marks, and four pairs
of points exchanged. A mistake is named where the page says of that mark, or of both points, that it is wrong; whatever
else it says is wrong is an innocent.
"""

import argparse
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from lib.marking_hand import Hand, browser, marking
from lib.marking_surveys import UnmarkedSurvey, unmarked_survey

from photogram.files.marks.mark_table import MARKS, read_marks

POINTS, PHOTOGRAPHS, NOISE_PX, OFF_TARGET_PX = 10, 7, 2.0, 5.0
EARLY = 4
"""Marks of a point after which the first mistakes are made."""


@dataclass
class Mistakes:
    """Mistakes that were made, and what the page said."""

    made: dict[str, int] = field(default_factory=dict)
    named: dict[str, int] = field(default_factory=dict)
    innocent: list[str] = field(default_factory=list)

    def note(self, kind: str, is_named: bool, others: list[str]) -> None:
        """Count one."""
        self.made[kind] = self.made.get(kind, 0) + 1
        self.named[kind] = self.named.get(kind, 0) + is_named
        self.innocent += others


@contextmanager
def scratch(kept: Path | None) -> Iterator[Path]:
    """Give a folder, one that stays if it is named."""
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        yield kept
        return
    with TemporaryDirectory() as folder:
        yield Path(folder)


def marked_point(hand: Hand) -> list[str]:
    """Mark the point that is shown in PHOTOGRAPHS photographs, and return these."""
    own = [name for name in hand.photographs() if name in hand.truth[hand.point]][:PHOTOGRAPHS]
    for photograph in own:
        hand.mark(photograph)
    return own


def timed(hand: Hand, survey: UnmarkedSurvey) -> None:
    """Mark all points, and print how long it took and how good the marks are."""
    start, after_two = time.monotonic(), 0
    for n in range(POINTS):
        own = [name for name in hand.photographs() if name in hand.truth[hand.point]][:PHOTOGRAPHS]
        for k, photograph in enumerate(own):
            before = hand.done
            hand.mark(photograph)
            after_two += hand.done - before if k >= 2 else 0
        if n < POINTS - 1:
            after_two += 1
            hand.next()
    seconds = time.monotonic() - start
    marks = read_marks(survey.project.parent / MARKS)
    off = np.array([np.subtract(m.pixel, survey.truth_px[m.point][m.photograph]) for m in marks])
    raw = np.array([np.subtract(m.raw_pixel or m.pixel, survey.truth_px[m.point][m.photograph]) for m in marks])
    sigma = np.array([m.sigma_px or (np.nan, np.nan) for m in marks])
    each = after_two / (POINTS * (PHOTOGRAPHS - 2))
    print(
        f"{len(marks)} marks of {POINTS} points: {seconds:.0f} s, {each:.2f} keys and clicks a mark after the first two"
    )
    print(
        f"RMS of a coordinate: clicks {rms(raw):.2f} px, marks {rms(off):.3f} px; over its sigma {rms(off / sigma):.2f}"
    )
    kinds = {kind: sum(m.kind == kind for m in marks) for kind in sorted({m.kind for m in marks})}
    print("kinds: " + ", ".join(f"{kind} {count}" for kind, count in kinds.items()))


def rms(values: np.ndarray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def wrong_now(hand: Hand) -> tuple[set[str], set[tuple[str, str]], list[str]]:
    """Return the points that the page says are wrong, the marks of the point that is shown, and its sentences."""
    state = hand.settled()
    wrong = {p["name"] for p in state["points"] if p["wrong"]}
    script = """return [...document.querySelectorAll('figure')].filter((f) => f.querySelector('figcaption .wrong'))
        .map((f) => f.dataset.photograph)"""
    marks = {(hand.point, str(name)) for name in hand.js(script)}
    sentences = hand.js("return [...document.querySelectorAll('#warnings .wrong')].map((e) => e.textContent)")
    return wrong, marks, [str(s) for s in sentences]


def in_words(innocent: list[str], mistake: str, sentences: list[str]) -> list[str]:
    """Return innocents with the mistake at which they were said to be wrong, and what the page said then."""
    return [f"{one} (at {mistake}: {'; '.join(sentences) or 'no sentence'})" for one in innocent]


def mistaken(hand: Hand, photograph: str, kind: str, found: Mistakes) -> None:
    """Make a mistake in a photograph, see whether it is named, and take it back."""
    point, place = hand.point, hand.truth[hand.point][photograph]
    if kind == "5 px beside":
        angle = hand.rng.uniform(0.0, 2.0 * np.pi)
        hand.click(photograph, place + OFF_TARGET_PX * np.array([np.cos(angle), np.sin(angle)]), alt=True)
        hand.until(lambda: hand.ask(f"point/{point}")["photographs"] and kind_of(hand, point, photograph) == "raw")
    else:
        others = [(float(np.hypot(*(there[photograph] - place))), there[photograph])
                  for name, there in hand.truth.items() if name != point and photograph in there]  # fmt: skip
        if not others:
            return
        u, v = min(others, key=lambda one: one[0])[1] + hand.rng.normal(0.0, NOISE_PX, 2)
        hand.act(do="mark", point=point, photograph=photograph, u=u, v=v)
    wrong, marks, sentences = wrong_now(hand)
    others_wrong = in_words(
        [*(f"{p} in {i}" for p, i in marks - {(point, photograph)}), *sorted(wrong - {point})],
        f"{kind}, {point} in {photograph}",
        sentences,
    )
    found.note(kind, (point, photograph) in marks and point in wrong, others_wrong)
    hand.undo()
    hand.settled()


def kind_of(hand: Hand, point: str, photograph: str) -> str:
    """Return the kind of a mark."""
    records = hand.ask(f"point/{point}")["photographs"]
    return next((r["mark"]["kind"] for r in records if r["name"] == photograph and r["mark"]), "")


def exchanged(hand: Hand, first: str, second: str, found: Mistakes) -> None:
    """Give each of two points the marks of the other, and take it back."""
    marks = {p: [r for r in hand.ask(f"point/{p}")["photographs"] if r["mark"]] for p in (first, second)}
    for point in (first, second):
        for record in marks[point]:
            hand.act(do="remove", point=point, photograph=record["name"])
    for point, other in ((first, second), (second, first)):
        for record in marks[other]:
            mark = record["mark"]
            hand.act(do="mark", point=point, photograph=record["name"], u=mark["u"], v=mark["v"])
    wrong, _, sentences = wrong_now(hand)
    named = any(first in s and second in s and "swapped" in s for s in sentences)
    others_wrong = in_words(sorted(wrong - {first, second}), f"{first} and {second} exchanged", sentences)
    found.note("exchanged points", named, others_wrong)
    for _ in range(2 * sum(len(own) for own in marks.values())):
        hand.act(do="undo")
    hand.settled()


def with_mistakes(hand: Hand) -> Mistakes:
    """Mark all points with mistakes between."""
    found, names = Mistakes(), sorted(hand.truth)
    for n, point in enumerate(names):
        if hand.point != point:
            hand.choose(point)
        own = [name for name in hand.photographs() if name in hand.truth[point]][:PHOTOGRAPHS]
        for k, photograph in enumerate(own, 1):
            hand.mark(photograph)
            if n and k in (EARLY, PHOTOGRAPHS):
                hand.settled()
                for kind in ("5 px beside", "neighbouring target"):
                    mistaken(hand, own[1 if k == EARLY else 4], kind, found)
    for first, second in [*pairwise(names)][::2][:4]:
        exchanged(hand, first, second, found)
    return found


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="folder that the survey is left in")
    options = parser.parse_args()
    with scratch(options.keep) as folder, browser() as chrome:
        survey = unmarked_survey(folder, options.seed, POINTS, PHOTOGRAPHS)
        for part in ("timed", "mistakes"):
            (folder / MARKS).unlink(missing_ok=True)
            shutil.rmtree(folder / "work" / "marking", ignore_errors=True)
            with marking(survey.project) as address:
                hand = Hand(chrome, address, survey.truth_px, NOISE_PX, options.seed)
                if part == "timed":
                    timed(hand, survey)
                    hand.leave()
                    continue
                found = with_mistakes(hand)
                hand.leave()
                for kind, count in found.made.items():
                    print(f"{kind}: {found.named[kind]} of {count} named")
                print(f"innocents said to be wrong: {', '.join(found.innocent) or 'none'}")
        complaints = [entry["message"] for entry in chrome.get_log("browser")]
        print(f"complaints of the browser: {'; '.join(complaints) or 'none'}")


if __name__ == "__main__":
    main()
