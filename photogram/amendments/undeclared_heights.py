"""Whether GNSS heights and those of control points are of one system, where nobody says so.

Their difference is an unknown of the adjustment, the vertical part of the offset of each flight, with a prior as wide
as geoid heights are. Where it comes out as zero, and is known well enough that no geoid hides behind its standard
deviation, they are of one system, and the block is adjusted so; otherwise it stays an unknown: heights come from the
control points, and neither a focal length nor a control point has to take it over.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from photogram.amendments.amendment import Decisive, Proposal, Solution
from photogram.amendments.gross_errors.hypothesis import Hypothesis
from photogram.errors import PhotogramError
from photogram.results import DIFFERENT, Adjustment, Decision, HeightDecision
from photogram.survey import Block

WIDEST_M = 100.0
"""Prior standard deviation of the difference: geoid heights reach from -107 m to 86 m."""

SURE_M = 0.25
"""Standard deviation of the difference, from which a geoid height may hide behind it."""

POOR_M = 1.0
"""Standard deviation of GNSS heights, or of their offset, from which these tell nothing of height systems: a barometer,
or a single receiver."""


def with_heights_open(block: Block) -> Block:
    """Return the block with an unknown difference of GNSS heights and those of control points, where nobody declares
    that there is none, and there are both."""
    points = block.control_points
    held = points.used[:, 2] & (np.bincount(points.mark_point, minlength=len(points)) > 0)
    positioned = any(p.gnss_world_m is not None for p in block.photographs)
    if block.undeclared_heights is None or not held.any() or not positioned:
        return block
    sigma_m = np.array([*block.gnss_offset_sigma_m[:2], max(WIDEST_M, block.gnss_offset_sigma_m[2])])
    return replace(block, gnss_offset_sigma_m=sigma_m)


def height_decision(declared: Block, result: Adjustment, rejected: Sequence[Hypothesis]) -> HeightDecision | None:
    """Return what an adjustment with an unknown difference says of it, of the flight that shows it best; None where
    ``declared``, the block as stated, has none, or heights of receivers that are off by tens of metres anyway. Of one
    that was ``rejected`` as a whole no height is sure."""
    if declared.undeclared_heights is None or not result.estimates.flights:
        return None
    sigmas_m = [p.gnss_sigma_m[2] for p in declared.photographs if p.gnss_sigma_m is not None]
    if (
        result.block.gnss_offset_sigma_m[2] < WIDEST_M
        or declared.gnss_offset_sigma_m[2] > POOR_M
        or np.median(sigmas_m) > POOR_M
    ):
        return None
    up = declared.frame.rotation_world_from_map(np.zeros(3))[:, 2]
    higher_m = -result.estimates.offset_world_m @ up
    sigma_m = np.sqrt(np.einsum("i,fij,j->f", up, result.covariances.offset_m2, up))
    shown = int(np.argmax(np.abs(higher_m) / sigma_m))
    lowered_m = declared.undeclared_heights.lowered_m
    difference_m, sigma = lowered_m + float(higher_m[shown]), float(sigma_m[shown])
    p = min(1.0, len(higher_m) * 2.0 * float(norm.sf(abs(difference_m) / sigma)))
    whole = lowered_m == 0.0 and all(a.kind != "GNSS offset" for a in rejected)
    return HeightDecision(difference_m, sigma, p, whole and p >= DIFFERENT and bool(sigma_m.max() < SURE_M))


class HeightSystems(Decisive):
    """The difference of GNSS heights and those of control points of a block, as it is ``declared``."""

    about = "height systems"

    def __init__(self, declared: Block) -> None:
        self._declared = declared
        self._same: HeightDecision | None = None

    def propose(self, solution: Solution) -> Proposal | None:
        """Return the block with heights of one system, None where they are not, or are already."""
        decision = height_decision(self._declared, solution.result, solution.rejected)
        if self._same is not None or decision is None or not decision.same:
            return None
        block = replace(solution.block, gnss_offset_sigma_m=self._declared.gnss_offset_sigma_m)
        return Proposal(block, solution.rejected, solution.result)

    def judged(self, before: Solution, after: Solution | PhotogramError) -> Solution:
        """Return the solution with heights of one system, the one before with a warning where there is none."""
        if not isinstance(after, PhotogramError):
            self._same = height_decision(self._declared, before.result, before.rejected)
        return super().judged(before, after)

    def decision(self, solution: Solution) -> HeightDecision | None:
        """Return what was decided in the end, None where there was nothing to decide."""
        if self._same is not None:
            return self._same
        decision = height_decision(self._declared, solution.result, solution.rejected)
        return None if decision is None else replace(decision, same=False)

    def decided(self, solution: Solution) -> Iterator[Decision]:
        """Yield the decision on the height systems, if there was one to make."""
        decision = self.decision(solution)
        if decision is not None:
            statistic = (decision.difference_m / decision.sigma_m) ** 2
            yield Decision(self.about, not decision.same, decision.sentence, statistic, 1, decision.p)
