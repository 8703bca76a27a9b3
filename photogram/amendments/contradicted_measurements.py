"""Measurements that the others contradict: rejected one by one, and reinstated where nothing contradicts them again."""

from collections.abc import Iterator

import numpy as np

from photogram.amendments.amendment import Decisive, Proposal, Solution
from photogram.amendments.gross_errors.data_snooping import search
from photogram.amendments.gross_errors.hypothesis import Hypothesis
from photogram.amendments.solutions import Solutions
from photogram.results import Decision
from photogram.survey import Block

MOST_FOLLOWED = 3
"""Explanations of a block that are adjusted with all rays, each of which may contradict what was decided without them,
before the last one stands."""


def marks_of_checks(solution: Solution) -> tuple[Hypothesis, ...]:
    """Return what was rejected of the marks of check points, which no adjustment uses."""
    points = solution.block.control_points
    checks = {name for name, role in zip(points.name, points.role, strict=True) if role == "check"}
    return tuple(a for a in solution.rejected if a.kind == "mark" and a.name in checks)


class ContradictedMeasurements(Decisive):
    """Data snooping (Baarda 1968) at a solution, among its alternatives without rays."""

    about = "gross errors"

    def __init__(self, solutions: Solutions) -> None:
        self._solutions = solutions
        self._block: Block | None = None
        self._followed = 0

    def propose(self, solution: Solution) -> Proposal | None:
        """Return the block without what its observations contradict, None where they have nothing more to say."""
        if solution.block is not self._block:
            self._block, self._followed = solution.block, 0
        if self._followed == MOST_FOLLOWED:
            return None
        of_checks = marks_of_checks(solution)
        tested = [a for a in solution.rejected if a not in of_checks]
        explanation = search(solution.block, solution.result, self._solutions.alternative, tested)
        if explanation.result is solution.result:
            return None
        self._followed += 1
        return Proposal(solution.block, (*explanation.rejected, *of_checks), explanation.result)

    def decided(self, solution: Solution) -> Iterator[Decision]:
        """Yield the measurements that were rejected."""
        of_checks = marks_of_checks(solution)
        for a in solution.rejected:
            if a not in of_checks:
                sentence = f"{a.words} is rejected: all other observations contradict it"
                if not np.isfinite(a.statistic):
                    yield Decision(a.words, adopted=True, sentence=f"{sentence} grossly", rivals=a.rivals)
                    continue
                p, degrees = float(np.exp(a.log_chance)), len(a.axes)
                yield Decision(a.words, True, sentence, a.statistic, degrees, p, a.rivals)
