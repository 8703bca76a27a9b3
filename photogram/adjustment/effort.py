"""The work that a decision took: how often a block was solved for it, in how many iterations, and how long.

Levenberg–Marquardt runs in `problem.minimise`, under many decisions, which say ``during`` what they are made. Nothing
is counted but within ``tallied``, and nothing depends on what is counted.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from photogram.wording import things

REST = "covariances and tests"
"""What is not done for one of the decisions."""


@dataclass(frozen=True)
class Effort:
    """The work for one decision."""

    decision: str
    """What was decided, in a word or two."""
    solutions: int = 0
    """How often Levenberg–Marquardt ran, to an end or not."""
    iterations: int = 0
    """Its iterations."""
    iterations_over_all_rays: float = 0.0
    """The same, each counted by the share of the block's observations of tie points that took part: none where a
    summary stands for these."""
    seconds: float = 0.0
    """Time, s, without that of other decisions on the way."""

    @property
    def sentence(self) -> str:
        """Return it in words."""
        solutions, iterations = things(self.solutions, "solution"), things(self.iterations, "iteration")
        over = f"{self.iterations_over_all_rays:.1f} over all rays"
        return f"{self.decision}: {solutions}, {iterations}, {over}, {self.seconds:.2f} s"


def _sum(one: Effort, other: Effort) -> Effort:
    """Return the work of both for the decision of the first."""
    return Effort(
        one.decision,
        one.solutions + other.solutions,
        one.iterations + other.iterations,
        one.iterations_over_all_rays + other.iterations_over_all_rays,
        one.seconds + other.seconds,
    )


class Tally:
    """Counts the work for decisions on a block of so many ``observations`` of tie points; threads may share one."""

    def __init__(self, observations: int) -> None:
        self.observations = observations
        self._efforts: dict[str, Effort] = {}
        self._lock = threading.Lock()

    @property
    def efforts(self) -> tuple[Effort, ...]:
        """Return the work for each decision, in the order in which they were begun."""
        with self._lock:
            return tuple(self._efforts.values())

    @property
    def iterations_over_all_rays(self) -> float:
        """Return the iterations over all rays for all decisions together."""
        return sum(effort.iterations_over_all_rays for effort in self.efforts)

    def add(self, effort: Effort) -> None:
        """Count more work."""
        with self._lock:
            self._efforts[effort.decision] = _sum(self._efforts.get(effort.decision, Effort(effort.decision)), effort)


@dataclass(eq=False)
class _Span:
    """A decision on its way: where its work counts, whether what others decide meanwhile counts as its own, where and
    when it ``began``, s, and the seconds that passed in spans ``within`` it."""

    tally: Tally
    decision: str
    everything: bool
    thread: int
    began: float
    within: float = 0.0


_SPAN: ContextVar[_Span | None] = ContextVar("photogram_effort", default=None)


@contextmanager
def _span(tally: Tally, decision: str, *, everything: bool) -> Iterator[None]:
    """Count for a decision while the block runs."""
    outer, span = _SPAN.get(), _Span(tally, decision, everything, threading.get_ident(), time.perf_counter())
    tally.add(Effort(decision))
    token = _SPAN.set(span)
    try:
        yield
    finally:
        _SPAN.reset(token)
        seconds = time.perf_counter() - span.began
        tally.add(Effort(decision, seconds=seconds - span.within))
        if outer is not None and outer.thread == span.thread:
            outer.within += seconds


@contextmanager
def tallied(observations: int) -> Iterator[Tally]:
    """Count the work for the decisions that are made while the block runs, on a block of so many observations of tie
    points. An outer tally counts it as well."""
    outer, tally = _SPAN.get(), Tally(observations)
    try:
        with _span(tally, REST, everything=False):
            yield tally
    finally:
        if outer is not None:
            for effort in tally.efforts:
                outer.tally.add(_sum(Effort(outer.decision), effort) if outer.everything else effort)


@contextmanager
def during(decision: str, *, everything: bool = False) -> Iterator[None]:
    """Count what is done while the block runs for a decision, but for what is done for another one within it; with
    ``everything`` that, too. Does nothing where nothing is tallied."""
    outer = _SPAN.get()
    if outer is None or outer.everything:
        yield
        return
    with _span(outer.tally, decision, everything=everything):
        yield


def count_solution(iterations: int, rays: int) -> None:
    """Count a solution for the present decision, in so many iterations over so many observations of tie points."""
    span = _SPAN.get()
    if span is None:
        return
    share = min(1.0, rays / span.tally.observations) if span.tally.observations else 0.0
    span.tally.add(Effort(span.decision, 1, iterations, iterations * share))
