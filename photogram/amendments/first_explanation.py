"""The first explanation of the contradictions in a block, from which amendments go on.

The block is adjusted with all observations, and suspects are tested on equal terms
(photogram.amendments.gross_errors.data_snooping). A blunder gross enough to deform the block contaminates its
neighbours: then the suspects of a robust adjustment, and those of a screening without control points, are tried as
well, and the explanation of least cost is taken.
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from photogram.amendments.amendment import Solution
from photogram.amendments.gross_errors.blunder_naming import exchanged_points
from photogram.amendments.gross_errors.data_snooping import (
    PRICE,
    Adjuster,
    Search,
    hypotheses,
    search,
    simplified,
    whole_points,
    without,
)
from photogram.amendments.gross_errors.hypothesis import Hypothesis
from photogram.amendments.gross_errors.screening import gross_blunders
from photogram.amendments.solutions import Solutions, attempted
from photogram.errors import AdjustmentError, PhotogramError
from photogram.results import Adjustment
from photogram.survey import Block
from photogram.wording import some

BENT = 12.0
"""Sigmas of the largest contradiction from which a blunder may contaminate other tests."""

BORNE = 40.0
"""The same, up to which an adjustment with the blunder may still identify it."""

OUTVOTED = 0.5
"""Share of the tie points of a photograph with marks, below which a wrong mark may have had them rejected."""

MOST_NAMED = 10
"""Most suspects named in an error message."""

MANY = 4
"""Gross blunders from which a second screening, without control points, is made."""


def _outvoted(block: Block, result: Adjustment) -> bool:
    """Return whether most tie points of a photograph were rejected, possibly because of a wrong mark in it."""
    count = len(block.photographs)
    given, kept = (np.bincount(b.tie_points.photograph, minlength=count) for b in (block, result.block))
    return bool(np.any(result.block.registered & (kept < OUTVOTED * given)))


def _worst(result: Adjustment) -> float:
    return float(np.sqrt(max((a.statistic for a in hypotheses(result)), default=0.0)))


def _explained(block: Block, gross: Sequence[Hypothesis], solutions: Solutions) -> tuple[Search, Adjustment | None]:
    """Return the best explanation of the contradictions, which may be ``gross``, and the adjustment with all
    measurements, None where gross blunders make it useless. Raises PhotogramError where nothing can be adjusted."""
    if not gross:
        solved = attempted(lambda: solutions.solve(without(block, ())))
        if solved is not None and _worst(solved) <= BENT and not _outvoted(block, solved):
            return search(block, solved, solutions.alternative), solved
    whole: Adjustment | None = None
    explanations, first_error = list[Search](), None
    adjuster: Adjuster = solutions.as_stated
    if not gross:
        try:
            whole = solutions.solve_as_stated(block)
            if _worst(whole) <= BENT and not _outvoted(block, whole):
                return search(block, whole, solutions.alternative), whole
            explanations.append(search(block, whole, adjuster))
        except PhotogramError as error:
            first_error = error
    else:
        solved = attempted(lambda: solutions.solve(without(block, gross)))
        if solved is not None and not _outvoted(block, solved):
            adjuster = solutions.alternative
        whole = attempted(lambda: adjuster(block))
    ways = [gross]
    if not gross or len(gross) > MANY:
        ways.append(attempted(lambda: gross_blunders(block, adjuster)) or [])
    simpler = [simplified(way) for way in ways]
    ways += [s for s, way in zip(simpler, ways, strict=True) if {a.what for a in s} != {a.what for a in way}]
    for rejected in ways:
        try:
            if rejected:
                explanations.append(search(block, adjuster(without(block, rejected)), adjuster, rejected))
        except PhotogramError as error:
            first_error = first_error or error
    if gross and whole is not None and _worst(whole) <= BORNE and not len(solutions.begun):
        # what is gross to the robust adjustment may be small enough for the plain one, whose tests are sharper; but
        # not where the scale of the points was looked for without them
        with suppress(PhotogramError):
            explanations.append(search(block, whole, adjuster))
    if not explanations:
        culprits = some(list(dict.fromkeys(a.words for way in ways for a in way)), MOST_NAMED)
        why = f"; most observations contradict {culprits}, and too few are left without it" if culprits else ""
        raise AdjustmentError(f"{first_error or 'the observations do not determine the block'}{why}") from first_error
    best = min(explanations, key=Search.cost)
    wider = whole_points(best.rejected)
    if {(a.what, a.axes) for a in wider} != {(a.what, a.axes) for a in best.rejected}:
        with suppress(PhotogramError):
            explanations.append(search(block, adjuster(without(block, wider)), adjuster, wider))

    def cost(explanation: Search) -> float:
        # two points that were exchanged are one mistake, not two
        return explanation.cost() - PRICE * len(exchanged_points(block, explanation))

    return min(explanations, key=cost), whole


def first_solution(
    block: Block, gross: Sequence[Hypothesis], solutions: Solutions
) -> tuple[Solution, Adjustment | None]:
    """Return the solution by the best explanation of the contradictions, adjusted with all rays, and the adjustment
    with all measurements, None where gross blunders make it useless; ``gross`` is what may be wrong. Raises
    PhotogramError where nothing can be adjusted, with what contradicts the rest by name."""
    explanation, whole = _explained(block, gross, solutions)
    rejected, result = explanation.rejected, explanation.result
    if solutions.base is None or result is not solutions.base.result:
        try:
            result = solutions.solve(without(block, rejected), result)
        except PhotogramError as error:
            stated = solutions.solve_as_stated(without(block, rejected))
            warning = f"The sigmas of tie points could not be estimated: {error}. They are used as stated"
            return Solution(block, rejected, stated).warned(warning), whole
    return Solution(block, rejected, result), whole
