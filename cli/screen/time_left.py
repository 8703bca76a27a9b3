"""How long a run of several stages will still take, from the work that was measured so far.

Within a stage that says how far it is, the rest of it takes as long as its pieces took so far. Later stages are known
by their weights alone, the seconds that each is expected to take; how much slower this run is than that, the stages so
far tell, each by its own ratio (their weighted geometric mean, so that one stage unlike its weight does not rule). The
announced end moves slowly towards each new estimate, so that the time left runs down and does not jump.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

LEAST_SHARE = 0.05
"""Share of the weighted work that must be done before anything is said."""

LEAST_SECONDS = 3.0
SETTLING_SECONDS = 20.0
RISE = 1.4
"""The words say more than before only when the time left is longer by this factor."""


class TimeLeft:
    """Estimates the time left of a run.

    ``weights`` are the seconds that each stage is expected to take, in the order of the stages; ``clock`` returns
    seconds.
    """

    def __init__(self, weights: Mapping[str, float], clock: Callable[[], float] = time.monotonic) -> None:
        self._weights = dict(weights)
        self._clock = clock
        self._stage: str | None = None
        self._began = self._phase_began = 0.0
        self._done = self._of = 0
        self._first = 0
        self._finished: list[tuple[float, float]] = []  # weight and seconds of each
        self._end: float | None = None  # announced, on the clock
        self._looked = 0.0
        self._said_s = math.inf

    def begin(self, stage: str) -> None:
        """Start a stage."""
        self._stage, self._done, self._of, self._first = stage, 0, 0, 0
        self._began = self._phase_began = self._clock()

    def advance(self, done: int, of: int) -> None:
        """Note that ``done`` of ``of`` pieces of the stage are finished; ``of`` is 0 while it is not known."""
        if of != self._of or done < self._done:  # another part of the stage, with pieces of its own
            self._phase_began, self._first = self._clock(), done
        self._done, self._of = done, of

    def end(self, stage: str, seconds: float | None) -> None:
        """End a stage that took so many seconds, None where nothing had to be done."""
        weight = self._weights.pop(stage, 0.0)
        if seconds is not None and weight:
            self._finished.append((weight, seconds))
        self._stage = None

    def _estimate_s(self) -> float | None:
        """Return the seconds left by what is measured so far, None while too little is."""
        now = self._clock()
        weight = self._weights.get(self._stage or "", 0.0)
        share = self._done / self._of if self._of else 0.0
        elapsed = now - self._began if self._stage else 0.0
        done = [*self._finished, *([(weight * share, elapsed)] if weight * share else [])]
        done_weight = sum(part for part, _ in done)
        total = sum(part for part, _ in self._finished) + sum(self._weights.values())
        if sum(seconds for _, seconds in done) < LEAST_SECONDS or done_weight < LEAST_SHARE * total:
            return None
        ratios = sum(part * math.log(max(seconds, 1e-3) / part) for part, seconds in done)
        pace = math.exp(ratios / done_weight)
        later = sum(part for stage, part in self._weights.items() if stage != self._stage)
        made = self._done - self._first
        if made and self._of:
            present = (now - self._phase_began) * (self._of - self._done) / made
        else:
            present = max(weight * pace - elapsed, 0.0)
        return present + later * pace

    def seconds(self) -> float | None:
        """Return the seconds left, None while they are not known."""
        now, estimate = self._clock(), self._estimate_s()
        if estimate is not None and self._end is None:
            self._end = now + estimate
        elif estimate is not None and self._end is not None:
            part = 1.0 - math.exp(-(now - self._looked) / SETTLING_SECONDS)
            self._end += part * (now + estimate - self._end)
        self._looked = now
        return None if self._end is None else max(self._end - now, 0.0)

    def words(self) -> str:
        """Return the time left in words, "" while it is not known."""
        seconds = self.seconds()
        if seconds is None:
            return ""
        if seconds > self._said_s and seconds < RISE * self._said_s:
            seconds = self._said_s
        self._said_s = seconds
        return in_words(seconds)


def in_words(seconds: float) -> str:
    """Return a time left as coarsely as it is known."""
    if seconds < 10:
        return "a few seconds left"
    if seconds < 90:
        return f"about {10 * round(seconds / 10)} s left"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"about {minutes if minutes < 20 else 5 * round(minutes / 5)} min left"
    return f"about {seconds / 3600:.1f} h left"
