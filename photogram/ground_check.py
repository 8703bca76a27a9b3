"""The joint adjustment with its verdict on the ground points: blunders found, named, and what they cost.

A blunder that the adjustment can bear is reported beside the result. One so gross that it bends the block is looked for
without control and ends in an error that names it: a result that holds it would be worth nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.accuracy import CheckAccuracy, check_accuracy
from photogram.blunder_names import Blunder, name_blunders
from photogram.blunders import Adjuster, accusations, search, without
from photogram.errors import ControlPointError, PhotogramError
from photogram.first_look import gross_blunders
from photogram.survey import Adjustment, Block, ControlPoints

BENT = 20.0  # sigmas by which the rest contradicts a measurement, from which a blunder in it is blamed on others too
OUTVOTED = 0.5  # of the tie points of a photograph
GROSS = 100.0  # sigmas from which the result is worth nothing


class GrossBlunderError(ControlPointError):
    """Blunders that bend the whole block, by name; ``blunders`` holds them."""

    def __init__(self, blunders: Sequence[Blunder]) -> None:
        sentences = "; ".join(blunder.sentence for blunder in blunders)
        in_marks = all(blunder.photograph is not None for blunder in blunders)
        remedy = "remove the mark" if in_marks else "give the point the role check"
        super().__init__(f"{sentences}: correct this, or {remedy}; what was matched and oriented is kept")
        self.blunders = tuple(blunders)


@dataclass(frozen=True, eq=False)
class Verdict:
    """The adjustment with everything in it, the blunders that it holds by name, the worst first, and the accuracy of
    its check points with them and without."""

    result: Adjustment
    blunders: tuple[Blunder, ...]
    check_before: CheckAccuracy
    check_after: CheckAccuracy


def _outvoted(block: Block, result: Adjustment) -> bool:
    """Return whether a photograph with marks has lost most of its tie points: a wrong mark may have outvoted them."""
    count = len(block.photographs)
    given, kept = (np.bincount(b.tie_points.photograph, minlength=count) for b in (block, result.block))
    marked = np.unique(block.control_points.mark_photograph)
    oriented = np.array([pose is not None for pose in result.block.poses], dtype=bool)[marked]
    return bool(np.any(oriented & (kept[marked] < OUTVOTED * given[marked])))


def _worst(result: Adjustment) -> float:
    return float(np.sqrt(max((a.statistic for a in accusations(result)), default=0.0)))


def _checks(result: Adjustment, points: ControlPoints) -> CheckAccuracy:
    """Return the accuracy at what is a check in ``points``."""
    frame = result.block.frame
    difference = frame.map_from_world(result.ground_world_m) - frame.map_from_world(points.position_world_m)
    return check_accuracy(np.where(points.controlled, np.nan, difference))


def adjust_and_judge(block: Block, adjust: Adjuster) -> Verdict:
    """Adjust a block with ``adjust``, and judge its control points and their marks.

    Raises GrossBlunderError naming gross blunders; whatever ``adjust`` raises where none explains it.
    """
    try:
        result = adjust(block)
    except PhotogramError as fault:
        gross = gross_blunders(block, adjust)
        found = search(block, adjust(without(block, gross)), adjust, gross) if gross else None
        if found is None or not found.accused:
            raise
        raise GrossBlunderError(name_blunders(block, found)) from fault
    worst = _worst(result)
    gross = gross_blunders(block, adjust) if worst > BENT or _outvoted(block, result) else []
    found = search(block, adjust(without(block, gross)) if gross else result, adjust, gross)
    blunders = name_blunders(block, found)
    if blunders and worst > GROSS:
        raise GrossBlunderError(blunders)
    points = block.control_points
    return Verdict(result, tuple(blunders), _checks(result, points), _checks(found.result, points))
