"""The joint adjustment with data snooping: blunders are rejected and named, and the survey goes on.

The block is adjusted with all observations, and suspects are tested on equal terms
(photogram.quality.gross_errors.data_snooping). A blunder gross enough to deform the block contaminates its neighbours:
then the suspects of a robust adjustment, and those of a screening without control points, are tried as well, and the
explanation of least cost is taken. A focal length whose source is rejected is settled last, see
photogram.quality.gross_errors.focal_length.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
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
from photogram.quality.gross_errors.robust_start import gross_suspects
from photogram.quality.gross_errors.screening import gross_blunders
from photogram.results import Adjustment, EstimatedSigmas, FocalDecision
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

ROUNDS_TO_COMPARE, ITERATIONS_TO_COMPARE = 3, 30
"""Limits of the adjustment with all blunders, which only shows their effect."""

NEAR_TOLERANCE = 1e-7
"""Relative tolerance of the adjustments of parts: at a cost of 10 000, 0.05 sigmas of a focal length."""

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

    def __repr__(self) -> str:
        return f"<Verdict: {things(len(self.blunders), 'blunder')} rejected, {self.result!r}>"


@dataclass(eq=False)
class CommonSigmas:
    """How blocks are adjusted while explanations are compared: all with the same ``sigmas``, since one that bends the
    block would otherwise raise those of the tie points and hide behind them."""

    settings: AdjustmentSettings
    progress: Progress
    start: Sequence[FloatArray]
    sigmas: EstimatedSigmas

    def adjust(self, block: Block) -> Adjustment:
        """Adjust a block with ``sigmas``."""
        return adjust(block, self.settings, self.progress, start=self.start, sigmas=self.sigmas)

    def restarting(self, result: Adjustment) -> Adjuster:
        """Return what adjusts parts of the block of an adjustment, from where that ended, with ``sigmas``: it has
        rejected what is wrong, so that one round is enough."""
        settings = replace(self.settings, maximum_rounds=1, relative_tolerance=NEAR_TOLERANCE)
        start = [camera.parameters for camera in result.block.cameras]
        return lambda block: adjust(block, settings, self.progress, start=start, sigmas=self.sigmas)

    def estimate(self, block: Block) -> Adjustment:
        """Adjust a block and estimate its sigmas."""
        return adjust(block, self.settings, self.progress, start=self.start)


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
    return check_accuracy(np.where(points.controlled, np.nan, difference))


def _explained(
    block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray], common: CommonSigmas
) -> tuple[Search, Adjustment | None]:
    """Return the best explanation of the contradictions, and the adjustment with all measurements, None where gross
    blunders make it useless. Raises PhotogramError where nothing can be adjusted."""
    gross = _attempted(lambda: gross_suspects(block, settings, start)) or []
    whole: Adjustment | None = None
    explanations = list[Search]()
    first_error: PhotogramError | None = None
    if settings.estimate_sigmas and not gross:
        estimated = _attempted(lambda: common.estimate(without(block, ())))
        if estimated is not None and _worst(estimated) <= BENT and not _outvoted(block, estimated):
            common.sigmas = estimated.decisions.sigmas
            return search(block, estimated, common.adjust), estimated
    adjuster = common.adjust
    if not gross:
        try:
            whole = adjuster(block)
            explanations.append(search(block, whole, adjuster))
            if _worst(whole) <= BENT and not _outvoted(block, whole):
                return explanations[0], whole
        except PhotogramError as error:
            first_error = error
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
    if gross:
        # what is gross to the robust adjustment may be small enough for the plain one, whose tests are sharper
        whole = _with_everything(block, settings, start)
        if whole is not None and _worst(whole) <= BORNE:
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


def _reweighted(block: Block, explanation: Search, common: CommonSigmas) -> Search:
    """Return the data snooping that goes on from an explanation with the sigmas that are estimated without what it
    rejects."""
    try:
        result = common.estimate(without(block, explanation.rejected))
        common.sigmas = result.decisions.sigmas
        return search(block, result, common.adjust, explanation.rejected)
    except PhotogramError as error:
        common.sigmas = explanation.result.decisions.sigmas
        return _warned(
            explanation, f"The sigmas of tie points could not be estimated: {error}. They are used as stated"
        )


def _warned(explanation: Search, warning: str) -> Search:
    result = explanation.result
    return replace(explanation, result=replace(result, warnings=(*result.warnings, warning)))


def _with_everything(block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray]) -> Adjustment | None:
    """Return the adjustment with all measurements, for the effect of blunders on the check points, None where it has no
    solution."""
    quick = replace(
        settings,
        estimate_sigmas=False,
        maximum_rounds=min(ROUNDS_TO_COMPARE, settings.maximum_rounds),
        maximum_iterations=min(ITERATIONS_TO_COMPARE, settings.maximum_iterations),
    )
    return _attempted(lambda: adjust(block, quick, start=start))


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


NOT_SETTLED = (
    "The focal length of {names} contradicts its source and could not be settled: the adjustment between the two "
    "failed ({error}). The result rejects the source: calibrate the camera"
)


def _with_settled(
    settled: Block, explanation: Search, decisions: Mapping[str, FocalDecision], adjuster: Adjuster
) -> Search:
    """Return the data snooping of a block with settled focal lengths, from the one without them. Raises
    AdjustmentError where the block cannot be adjusted so."""
    sure = {name for name, decision in decisions.items() if decision.says.trustworthy}
    others = [a for a in explanation.rejected if a.kind != "focal length" or a.name in sure]
    return search(settled, adjuster(without(settled, others)), adjuster, others)


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

    common = CommonSigmas(settings, progress, start, EstimatedSigmas.none())
    adjuster = common.adjust
    of_another_size, size = _of_another_size(block, start)
    block = without(block, of_another_size)
    try:
        explanation, whole = _explained(block, settings, start, common)
        if settings.estimate_sigmas and (explanation.rejected or not len(common.sigmas)):
            explanation = _reweighted(block, explanation, common)
    except PhotogramError as error:
        if not size:
            raise
        raise AdjustmentError(f"{size[0].sentence}; without them {error}") from error
    settled, decisions = settle_focal_lengths(block, explanation, adjuster, common.restarting, progress, readings_px)
    if settled is not None:
        try:
            explanation = _with_settled(settled, explanation, decisions, adjuster)
        except PhotogramError as error:
            explanation = _warned(explanation, NOT_SETTLED.format(names=", ".join(decisions), error=error))
            settled, decisions = None, {}
    off = marks_off_checks(explanation.result)
    if off:
        cleared = block if settled is None else settled
        explanation = Search((*explanation.rejected, *off), adjuster(without(cleared, [*explanation.rejected, *off])))
    points = block.control_points
    before = check_accuracy(np.full((len(points), 3), np.nan)) if whole is None else _checks(whole, points)
    return Verdict(
        explanation.result,
        (*of_another_size, *explanation.rejected),
        (*size, *name_blunders(block, explanation)),
        before,
        _checks(explanation.result, points),
        decisions,
    )
