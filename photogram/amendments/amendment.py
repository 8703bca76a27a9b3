"""Amendments to the model of a block, and the loop in which they are proposed, adjusted and judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from photogram.adjustment.effort import during
from photogram.amendments.gross_errors.data_snooping import Search, without
from photogram.amendments.gross_errors.hypothesis import Hypothesis
from photogram.amendments.solutions import Solutions
from photogram.errors import PhotogramError
from photogram.results import Adjustment, Decision
from photogram.survey import Block

MOST_CHANGES = 20
"""Changes of the model after which it stands as it is: each amendment ends by itself long before."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A ``block`` with what is in its model, the measurements that were ``rejected``, and its adjustment without
    them."""

    block: Block
    rejected: tuple[Hypothesis, ...]
    result: Adjustment

    @property
    def explanation(self) -> Search:
        """Return what was rejected, and the adjustment."""
        return Search(self.rejected, self.result)

    def warned(self, warning: str, *, first: bool = False) -> Solution:
        """Return the solution with one more warning."""
        warnings = (warning, *self.result.warnings) if first else (*self.result.warnings, warning)
        return replace(self, result=replace(self.result, warnings=warnings))


@dataclass(frozen=True, eq=False)
class Proposal:
    """Another model: its ``block``, what is ``rejected`` of it, and the adjustment ``near`` which it is solved."""

    block: Block
    rejected: tuple[Hypothesis, ...]
    near: Adjustment


class Amendment(Protocol):
    """Something that may enter the model or leave it."""

    about: str
    """What it decides, in a word or two."""

    def propose(self, solution: Solution) -> Proposal | None:
        """Return the change that a solution asks for, None where it asks for none, or for none any more."""
        ...

    def judged(self, before: Solution, after: Solution | PhotogramError) -> Solution:
        """Return which solution stands, with the change or ``before`` it; the error where the block could not be
        adjusted with it."""
        ...

    def decided(self, solution: Solution) -> Iterator[Decision]:
        """Yield what was decided in the end, at the ``solution`` that stands."""
        ...


class Decisive:
    """An amendment whose proposals are decided when they are made: they stand wherever the block can be adjusted."""

    about: str

    def judged(self, before: Solution, after: Solution | PhotogramError) -> Solution:
        """Return the solution with the change, the one before with a warning where there is none."""
        if not isinstance(after, PhotogramError):
            return after
        return before.warned(
            f"A change ({self.about}) was not made, since the block cannot be adjusted with it: {after}"
        )


def amended(solution: Solution, amendments: Sequence[Amendment], solutions: Solutions) -> Solution:
    """Return a solution to which no amendment proposes anything more.

    The first of the ``amendments`` that proposes a change is followed, and the others see the solution with it; each
    change is adjusted with all rays, near the solution before it. One whose change cannot be adjusted is asked no more.
    """
    asked = list(amendments)
    for _ in range(MOST_CHANGES):
        for amendment in asked:
            with during(amendment.about, everything=True):
                proposal = amendment.propose(solution)
                if proposal is None:
                    continue
                after = _solved(proposal, solutions)
                stands = amendment.judged(solution, after)
                if stands.result is solution.result:
                    solutions.stand_on(stands.result)
            if isinstance(after, PhotogramError):
                asked.remove(amendment)
            solution = stands
            break
        else:
            return solution
    return solution


def _solved(proposal: Proposal, solutions: Solutions) -> Solution | PhotogramError:
    try:
        result = solutions.solve(without(proposal.block, proposal.rejected), proposal.near)
    except PhotogramError as error:
        return error
    return Solution(proposal.block, proposal.rejected, result)
