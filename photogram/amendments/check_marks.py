"""Marks of check points that the other marks of their point contradict: the point still tests the result."""

from collections.abc import Iterator

import numpy as np

from photogram.amendments.amendment import Decisive, Proposal, Solution
from photogram.amendments.contradicted_measurements import marks_of_checks
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.results import Adjustment, Decision
from photogram.sfm.marked_points import intersected_marks


def marks_off_checks(result: Adjustment) -> list[Hypothesis]:
    """Return the marks of check points that are grossly off the intersection of most marks of their point. Surveyed
    coordinates are not used, so that the point still tests the result."""
    block, points = result.block, result.block.control_points
    agreed, usable = intersected_marks(block)[1], np.isfinite(points.mark_sigma_px)
    usable &= block.registered[points.mark_photograph]
    right, marks = (np.bincount(points.mark_point[m], minlength=len(points)) for m in (agreed, usable))
    sure = (np.array(points.role) == "check") & (right > marks - right)
    return [
        unmeasured("mark", points.name[points.mark_point[m]], block.photographs[points.mark_photograph[m]].name)
        for m in np.flatnonzero(usable & ~agreed & sure[points.mark_point]).tolist()
    ]


class CheckMarks(Decisive):
    """The marks of check points that are grossly off."""

    about = "marks of check points"

    def propose(self, solution: Solution) -> Proposal | None:
        """Return the block without such marks, None where there are none."""
        off = marks_off_checks(solution.result)
        return Proposal(solution.block, (*solution.rejected, *off), solution.result) if off else None

    def decided(self, solution: Solution) -> Iterator[Decision]:
        """Yield the marks of check points that were left out."""
        for a in marks_of_checks(solution):
            yield Decision(
                a.words, adopted=True, sentence=f"{a.words} is left out: the other marks contradict it grossly"
            )
