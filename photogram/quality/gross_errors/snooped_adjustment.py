"""The joint adjustment with data snooping: blunders are rejected and named, and the survey goes on.

The block is adjusted with all observations, and suspects are tested on equal terms
(photogram.quality.gross_errors.data_snooping). A blunder gross enough to deform the block contaminates its neighbours:
then the suspects of a robust adjustment, and those of a screening without control points, are tried as well, and the
explanation of least cost is taken. A focal length whose source is rejected is settled last, see
photogram.quality.gross_errors.focal_length.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from photogram.adjustment.effort import Effort, tallied
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.stochastic_model.estimated_sigmas import with_assumed_sigmas, with_control_assumed
from photogram.arrays import FloatArray
from photogram.errors import AdjustmentError, PhotogramError
from photogram.quality.accuracy import CheckAccuracy, check_accuracy
from photogram.quality.gross_errors.blunder_naming import Blunder, exchanged_points, name_blunders
from photogram.quality.gross_errors.data_snooping import (
    PRICE,
    Adjuster,
    Hypothesis,
    Search,
    hypotheses,
    marks_off_checks,
    search,
    simplified,
    unmeasured,
    whole_points,
    without,
)
from photogram.quality.gross_errors.focal_evidence import settle_focal_lengths
from photogram.quality.gross_errors.repeated_positions import repeated_positions
from photogram.quality.gross_errors.robust_start import Gross, gross_suspects
from photogram.quality.gross_errors.screening import gross_blunders
from photogram.quality.gross_errors.solutions import Solutions
from photogram.quality.gross_errors.undeclared_heights import (
    height_decision,
    with_height_decision,
    with_heights_open,
)
from photogram.quality.prediction_test import checked_axes
from photogram.results import Adjustment, FocalDecision
from photogram.sfm.mark_scale import other_size, picture_factor
from photogram.survey import Block, ControlPoints
from photogram.wording import Progress, silent, some, things

T = TypeVar("T")

BENT = 12.0
"""Sigmas of the largest contradiction from which a blunder may contaminate other tests."""

BORNE = 40.0
"""The same, up to which an adjustment with the blunder may still identify it."""

OUTVOTED = 0.5
"""Share of the tie points of a photograph with marks, below which a wrong mark may have had them rejected."""

MOST_SOLVED = 3
"""Adjustments with all rays, each of which may contradict what was decided without them, before the last one stands."""

MOST_NAMED = 10
"""Most suspects named in an error message."""

MANY = 4
"""Gross blunders from which a second screening, without control points, is made."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """The adjustment without its blunders, and what was rejected."""

    result: Adjustment
    """Adjustment without the rejected measurements."""
    rejected: tuple[Hypothesis, ...]
    """Rejected measurements."""
    blunders: tuple[Blunder, ...]
    """What went wrong with them, in words."""
    check_before: CheckAccuracy
    """Accuracy at the check points with all measurements; NaN where the block cannot be adjusted with them."""
    check_after: CheckAccuracy
    """Accuracy at the check points of ``result``."""
    focal_lengths: dict[str, FocalDecision]
    """Decisions on focal lengths, by camera name."""
    contradicted: float = 1.0
    """Factor by which most control points deny their stated standard deviations, 1 where they do not."""
    effort: tuple[Effort, ...] = ()
    """The work that it took, by what was decided, but for lens fields."""

    def __repr__(self) -> str:
        return f"<Verdict: {things(len(self.blunders), 'blunder')} rejected, {self.result!r}>"


def _outvoted(block: Block, result: Adjustment) -> bool:
    """Return whether most tie points of a photograph were rejected, possibly because of a wrong mark in it."""
    count = len(block.photographs)
    given, kept = (np.bincount(b.tie_points.photograph, minlength=count) for b in (block, result.block))
    return bool(np.any(result.block.registered & (kept < OUTVOTED * given)))


def _worst(result: Adjustment) -> float:
    return float(np.sqrt(max((a.statistic for a in hypotheses(result)), default=0.0)))


def _checks(result: Adjustment, points: ControlPoints) -> CheckAccuracy:
    """Return the accuracy at the check coordinates of ``points``."""
    frame = result.block.frame
    difference = frame.map_from_world(result.estimates.ground_world_m) - frame.map_from_world(points.position_world_m)
    return check_accuracy(np.where(checked_axes(points), difference, np.nan))


def _explained(block: Block, gross: Sequence[Hypothesis], solutions: Solutions) -> tuple[Search, Adjustment | None]:
    """Return the best explanation of the contradictions, which may be ``gross``, and the adjustment with all
    measurements, None where gross blunders make it useless. Raises PhotogramError where nothing can be adjusted."""
    if not gross:
        solved = _attempted(lambda: solutions.solve(without(block, ())))
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
        solved = _attempted(lambda: solutions.solve(without(block, gross)))
        if solved is not None and not _outvoted(block, solved):
            adjuster = solutions.alternative
        whole = _attempted(lambda: adjuster(block))
    ways = [gross]
    if not gross or len(gross) > MANY:
        ways.append(_attempted(lambda: gross_blunders(block, adjuster)) or [])
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


def _settled(block: Block, rejected: Sequence[Hypothesis], near: Adjustment, solutions: Solutions) -> Search:
    """Return the data snooping of a block without what is ``rejected``, adjusted with all rays, its sigmas estimated,
    until its observations have nothing more to say; it begins ``near`` another adjustment."""
    for _ in range(MOST_SOLVED):
        solved = solutions.solve(without(block, rejected), near)
        explanation = search(block, solved, solutions.alternative, rejected)
        if explanation.result is solved:
            return explanation
        rejected, near = explanation.rejected, explanation.result
    return Search(tuple(rejected), solutions.solve(without(block, rejected), near))


def _decided(block: Block, gross: Sequence[Hypothesis], solutions: Solutions) -> tuple[Search, Adjustment | None]:
    """Return what ``_explained`` does, adjusted with all rays."""
    explanation, whole = _explained(block, gross, solutions)
    if solutions.base is not None and explanation.result is solutions.base.result:
        return explanation, whole
    try:
        return _settled(block, explanation.rejected, explanation.result, solutions), whole
    except PhotogramError as error:
        stated = Search(explanation.rejected, solutions.solve_as_stated(without(block, explanation.rejected)))
        warning = f"The sigmas of tie points could not be estimated: {error}. They are used as stated"
        return _warned(stated, warning), whole


def _warned(explanation: Search, warning: str, *, first: bool = False) -> Search:
    result = explanation.result
    warnings = (warning, *result.warnings) if first else (*result.warnings, warning)
    return replace(explanation, result=replace(result, warnings=warnings))


def _attempted(compute: Callable[[], T]) -> T | None:
    """Return what ``compute`` returns, None where the block cannot be adjusted for it."""
    try:
        return compute()
    except PhotogramError:
        return None


def _of_another_size(block: Block, start: Sequence[FloatArray]) -> tuple[list[Hypothesis], list[Blunder]]:
    """Return all marks and their blunder, if they were measured in pictures of another size."""
    cameras = tuple(c.with_parameters(q) for c, q in zip(block.cameras, start, strict=True)) if start else block.cameras
    factor = picture_factor(replace(block, cameras=cameras))
    if factor is None:
        return [], []
    points, names = block.control_points, block.photograph_names
    marks = zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True)
    sentence = f"{len(points.mark_point)} marks: {other_size(factor)}"
    blunder = Blunder("picture size", points.name, None, sentence)
    return [unmeasured("mark", points.name[g], names[i]) for g, i in marks], [blunder]


CONTRADICTED = (
    "The stated standard deviations of the control points are contradicted by a factor of {factor:.0f}: most of the "
    "points do not agree with the block's shape and with each other to what is stated. What they scatter by is used "
    "instead: enter the accuracy of their survey, or check that the points belong to these photographs"
)

NOT_SETTLED = (
    "The focal length of {names} contradicts its source and could not be settled: the adjustment between the two "
    "failed ({error}). The result rejects the source: calibrate the camera"
)


def adjust_with_snooping(
    block: Block,
    settings: AdjustmentSettings,
    start: Sequence[FloatArray] = (),
    progress: Progress = silent,
    readings_px: Sequence[Sequence[float]] = (),
) -> Verdict:
    """Adjust a block by data snooping (Baarda 1968): reject blunders, and name them.

    ``start`` holds the interior orientations (12,) of the cameras to start from, where they are not the given ones;
    ``readings_px`` other readings of the source of each focal length, px. Raises AdjustmentError as adjust does where
    too little is left, with what contradicts the rest by name.
    """
    with tallied(len(block.tie_points.photograph)) as tally:
        verdict = _verdict(block, settings, start, progress, readings_px)
    return replace(verdict, effort=tally.efforts)


def _verdict(
    block: Block,
    settings: AdjustmentSettings,
    start: Sequence[FloatArray],
    progress: Progress,
    readings_px: Sequence[Sequence[float]],
) -> Verdict:
    solutions = Solutions(settings, progress, start)
    of_another_size, size = _of_another_size(block, start)
    repeated, repeating = repeated_positions(block)
    beforehand, kinds = [*of_another_size, *repeated], [*size, *repeating]
    block = without(block, beforehand)
    declared, block = block, with_heights_open(block)
    robust = _attempted(lambda: gross_suspects(block, settings, start)) or Gross((), solutions.begun)
    solutions.begun = robust.sigmas
    if robust.contradicted > 1.0:
        declared, block = with_control_assumed(declared), with_control_assumed(block)
    try:
        explanation, whole = _decided(block, robust.suspects, solutions)
    except PhotogramError as error:
        if not size:
            raise
        raise AdjustmentError(f"{size[0].sentence}; without them {error}") from error
    heights = height_decision(declared, explanation.result, explanation.rejected)
    if heights is not None and heights.same:
        block, explanation = declared, _settled(declared, explanation.rejected, explanation.result, solutions)
    settled, decisions = settle_focal_lengths(block, explanation, solutions, progress, readings_px)
    if settled is not None:
        sure = {name for name, decision in decisions.items() if decision.says.trustworthy}
        others = [a for a in explanation.rejected if a.kind != "focal length" or a.name in sure]
        try:
            explanation = _settled(settled, others, explanation.result, solutions)
        except PhotogramError as error:
            explanation = _warned(explanation, NOT_SETTLED.format(names=", ".join(decisions), error=error))
            settled, decisions = None, {}
    off = marks_off_checks(explanation.result)
    if off:
        cleared = block if settled is None else settled
        rejected = (*explanation.rejected, *off)
        explanation = Search(rejected, solutions.solve(without(cleared, rejected), explanation.result))
    if heights is not None:
        explanation = with_height_decision(explanation, heights)
    if robust.contradicted > 1.0:
        explanation = _warned(explanation, CONTRADICTED.format(factor=robust.contradicted), first=True)
    points, sigmas = block.control_points, explanation.result.decisions.sigmas
    before = check_accuracy(np.full((len(points), 3), np.nan)) if whole is None else _checks(whole, points)
    return Verdict(
        explanation.result,
        (*beforehand, *explanation.rejected),
        (*kinds, *name_blunders(with_assumed_sigmas(block, sigmas), explanation)),
        before,
        _checks(explanation.result, points),
        decisions,
        robust.contradicted,
    )
