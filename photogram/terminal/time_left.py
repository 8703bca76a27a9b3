"""How long a whole command will still take, by what was predicted and by the pieces of work that are done.

Before the work there is a prediction in seconds for each stage. Within a stage that says how far it is, the rest takes
as long as its pieces took so far; the more pieces, the less the prediction counts, and pieces that are over in a
fraction of the time predicted for the stage (pictures made smaller before heights are matched) tell nothing of it. How
much slower this run is than predicted, the finished stages tell: the geometric mean of their ratios, weighted by their
seconds, with the prediction itself as one more observation, so that a short stage unlike its prediction does not rule.
The announced end moves slowly towards each new estimate, so that the time left runs down and does not jump.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

PRIOR_SHARE = 0.05
"""Weight of the prediction beside the finished stages, as a share of all predicted seconds."""

FEW_PIECES = 2
"""Pieces after which the pieces count as much as the prediction of their stage."""

FOREIGN_SHARE, OWN_SHARE = 0.1, 0.3
"""Pieces that take less than the first share of the predicted stage together are none of its main work, from the second
one on they are; between the two in part."""

OVERTIME = 0.05
"""Share of the time that a stage has taken which it is thought to take still, when it takes longer than predicted."""

KEPT_PACE = 50.0
"""Pieces that come so many times as fast as predicted were made by an earlier run."""

LEAST_SECONDS = 3.0
"""Nothing is said before, where nothing was predicted."""

SETTLING_SHARE, SETTLING_SECONDS = 0.05, (2.0, 20.0)
RISE, OTHER_TOTAL = 1.3, 0.15
"""Words that stay: more time left is said only when it is more by this factor, and another time of the whole command
only when it differs by that share."""


@dataclass(frozen=True)
class Left:
    """How far a command is: the share of its time that is over, and the seconds left and of the whole."""

    share: float
    seconds: float
    total_seconds: float


class TimeLeft:
    """Estimates the time left of a command.

    ``predicted`` are the seconds that each stage is expected to take, in the order of the stages; empty where nothing
    is known. ``clock`` returns seconds.
    """

    def __init__(
        self,
        predicted: Mapping[str, float],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._predicted = dict(predicted)
        self._clock = clock
        self._start = self._looked = clock()
        self._stage: str | None = None
        self._began = self._phase_began = self._noted = 0.0
        self._done = self._of = self._first = 0
        self._kept = 0.0  # share of the stage that an earlier run has made
        self._preparing = False
        self._finished: list[tuple[float, float]] = []  # predicted and measured seconds
        whole = sum(self._predicted.values())
        self._end = self._start + whole if whole else None  # announced, on the clock
        self._share = 0.0
        self._said_s, self._said_total_s = math.inf, 0.0

    def begin(self, stage: str, *, is_uneven: bool = False) -> None:
        """Start a stage; the first pieces of one that is uneven tell nothing of the rest."""
        self._stage, self._done, self._of, self._first, self._kept = stage, 0, 0, 0, 0.0
        self._preparing = is_uneven
        self._began = self._phase_began = self._noted = self._clock()

    def advance(self, done: int, of: int) -> None:
        """Note that ``done`` of ``of`` pieces of the stage are finished; ``of`` is 0 while it is not known."""
        if of != self._of or done < self._done:  # another part of the stage, with pieces of its own
            self._preparing = self._preparing and self._of == 0
            # the first note of a part often comes with its first pieces, which were worked on since the note before
            self._phase_began, self._first = (self._began, 0) if self._of == 0 and done else (self._clock(), done)
        made, now = done - self._first, self._clock()
        self._noted = now if (done, of) != (self._done, self._of) else self._noted
        self._done, self._of = done, of
        usual = self._predicted.get(self._stage or "", 0.0) * made / of if of else 0.0
        if made > 0 and KEPT_PACE * (now - self._phase_began) < usual and not self._preparing:
            self._phase_began, self._first, self._kept = now, done, self._kept + made / of
            self._spare(usual)

    def end(self, stage: str, seconds: float | None) -> None:
        """End a stage that took so many seconds, None where nothing had to be done."""
        predicted = self._predicted.pop(stage, 0.0) * (1.0 - self._kept)
        if seconds is None:
            self._spare(predicted)
        elif predicted:
            self._finished.append((predicted, seconds))
        self._stage = None

    def _spare(self, predicted: float) -> None:
        """Bring the announced end forward by work of so many predicted seconds that need not be done."""
        if self._end is not None:
            self._end -= self._pace() * predicted

    def _pieces(self, now: float) -> tuple[float, float] | None:
        """Return the seconds left of the present part of a stage by its pieces, and those of the whole part; None
        before the first."""
        made = self._done - self._first
        if made <= 0 or not self._of or self._preparing:
            return None
        each, since = (self._noted - self._phase_began) / made, now - self._noted
        left = max(each * (self._of - self._done) - since, OVERTIME * since)
        return left, now - self._phase_began + left

    def _pace(self) -> float:
        """Return how much longer than predicted the finished stages took."""
        done = [(predicted, math.log(max(seconds, 1e-3) / predicted)) for predicted, seconds in self._finished]
        weight = sum(predicted for predicted, _ in done)
        prior = PRIOR_SHARE * (weight + sum(self._predicted.values()))
        return math.exp(sum(w * ratio for w, ratio in done) / (weight + prior)) if done else 1.0

    def _present_s(self, now: float, predicted: float) -> float | None:
        """Return the seconds left of the stage at work, which is ``predicted`` to take so many, None where nothing
        tells."""
        elapsed, pieces = now - self._began, self._pieces(now)
        if not predicted:
            return None if pieces is None or elapsed < LEAST_SECONDS else pieces[0]
        rest = max(predicted - elapsed, OVERTIME * elapsed)
        if pieces is None:
            return rest
        left, whole = pieces
        own = min(max((whole / predicted - FOREIGN_SHARE) / (OWN_SHARE - FOREIGN_SHARE), 0.0), 1.0)
        made = self._done - self._first
        trust = own * max(made / (made + FEW_PIECES), self._done / self._of)
        return (1.0 - trust) * rest + trust * left

    def _estimate_s(self, now: float) -> float | None:
        """Return the seconds left by all that is known, None while nothing is."""
        pace = self._pace()
        later = [seconds for stage, seconds in self._predicted.items() if stage != self._stage]
        if self._stage is None:
            return pace * sum(later) if self._predicted or self._finished else None
        present = self._present_s(now, pace * self._predicted.get(self._stage, 0.0) * (1.0 - self._kept))
        if present is None:
            return pace * sum(later) if any(later) else None
        return present + pace * sum(later)

    def left(self) -> Left | None:
        """Return how far the command is, None while that is not known. The share never falls."""
        now = self._clock()
        estimate = self._estimate_s(now)
        if estimate is not None and self._end is None:
            self._end = now + estimate
        elif estimate is not None and self._end is not None:
            least, most = SETTLING_SECONDS
            settling = min(max(SETTLING_SHARE * (self._end - self._start), least), most)
            part = 1.0 - math.exp(-(now - self._looked) / settling)
            self._end = max(self._end + part * (now + estimate - self._end), now + 0.5 * estimate)
        self._looked = now
        if self._end is None:
            return None
        seconds, elapsed = max(self._end - now, 0.0), now - self._start
        total = elapsed + seconds
        self._share = max(self._share, elapsed / total if total else 0.0)
        return Left(self._share, seconds, total)

    def words(self) -> str:
        """Return how far the command is in words, "" while that is not known."""
        left = self.left()
        if left is None:
            return ""
        seconds, total = left.seconds, left.total_seconds
        if self._said_s < seconds < RISE * self._said_s:
            seconds = self._said_s
        if abs(total - self._said_total_s) > OTHER_TOTAL * self._said_total_s:
            self._said_total_s = total
        self._said_s, total = seconds, max(self._said_total_s, seconds)
        return f"{math.floor(100 * left.share)} %, {duration(seconds)} left of {duration(total)}"


def duration(seconds: float) -> str:
    """Return a duration as coarsely as it is known."""
    if seconds < 5:
        return "a few seconds"
    if seconds < 57.5:
        return f"{5 * round(seconds / 5)} s"
    if seconds < 595:
        minutes, rest = divmod(10 * round(seconds / 10), 60)
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"{minutes} min"
    hours, rest = divmod(10 * round(seconds / 600), 60)
    return f"{hours} h {rest} min" if rest else f"{hours} h"
