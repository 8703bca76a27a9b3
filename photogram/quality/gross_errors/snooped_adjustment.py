"""The joint adjustment with data snooping: blunders are rejected and named, and the survey goes on.

The block is adjusted with all observations, and suspects are tested on equal terms
(photogram.quality.gross_errors.data_snooping). A blunder gross enough to deform the block contaminates its neighbours:
then the suspects of a robust adjustment, and those of a screening without control points, are tried as well, and the
explanation of least cost is taken. A focal length whose source is rejected is settled last, see
photogram.quality.gross_errors.focal_length.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

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
    oriented = np.array([pose is not None for pose in result.block.poses], dtype=bool)
    return bool(np.any(oriented & (kept < OUTVOTED * given)))


def _worst(result: Adjustment) -> float:
    return float(np.sqrt(max((a.statistic for a in hypotheses(result)), default=0.0)))


def _checks(result: Adjustment, points: ControlPoints) -> CheckAccuracy:
    """Return the accuracy at the check coordinates of ``points``."""
    frame = result.block.frame
    difference = frame.map_from_world(result.estimates.ground_world_m) - frame.map_from_world(points.position_world_m)
    return check_accuracy(np.where(points.controlled, np.nan, difference))


def _no_checks(points: ControlPoints) -> CheckAccuracy:
    return check_accuracy(np.full((len(points), 3), np.nan))


def _explained(
    block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray], common: CommonSigmas
) -> tuple[Search, Adjustment | None]:
    """Return the best explanation of the contradictions, and the adjustment with all measurements, None where gross
    blunders make it useless. Raises PhotogramError where nothing can be adjusted."""
    gross, whole, found = _looked_for(lambda: gross_suspects(block, settings, start)), None, []
    fault: PhotogramError | None = None
    if settings.estimate_sigmas and not gross:
        estimated = _looked_at(block, (), common.estimate)
        if estimated is not None and _worst(estimated) <= BENT and not _outvoted(block, estimated):
            common.sigmas = estimated.decisions.sigmas
            return search(block, estimated, common.adjust), estimated
    adjuster = common.adjust
    if not gross:
        try:
            whole = adjuster(block)
            found.append(search(block, whole, adjuster))
            if _worst(whole) <= BENT and not _outvoted(block, whole):
                return found[0], whole
        except PhotogramError as error:
            fault = error
    ways = [gross, _looked_for(lambda: gross_blunders(block, adjuster)) if not gross or len(gross) > MANY else []]
    simpler = [simplified(way) for way in ways]
    ways += [s for s, way in zip(simpler, ways, strict=True) if {a.what for a in s} != {a.what for a in way}]
    for rejected in ways:
        try:
            if rejected:
                found.append(search(block, adjuster(without(block, rejected)), adjuster, rejected))
        except PhotogramError as error:
            fault = fault or error
    if gross:
        # what is gross to the robust adjustment may be small enough for the plain one, whose tests are sharper
        whole = _with_everything(block, settings, start)
        if whole is not None and _worst(whole) <= BORNE:
            found += _searched(block, whole, adjuster)
    if not found:
        culprits = some(list(dict.fromkeys(a.words for way in ways for a in way)), MOST_NAMED)
        said = f"; most observations contradict {culprits}, and too few are left without it" if culprits else ""
        raise AdjustmentError(f"{fault or 'the observations do not determine the block'}{said}") from fault
    best = min(found, key=Search.cost)
    wider = whole_points(best.rejected)
    if {(a.what, a.axes) for a in wider} != {(a.what, a.axes) for a in best.rejected}:
        found += _searched(block, _looked_at(block, wider, adjuster), adjuster, wider)

    def cost(explanation: Search) -> float:
        # two points that were exchanged are one mistake, not two
        return explanation.cost() - PRICE * len(exchanged_points(block, explanation))

    return min(found, key=cost), whole


def _reweighted(block: Block, found: Search, common: CommonSigmas) -> Search:
    """Return the data snooping that goes on from an explanation with the sigmas that are estimated without what it
    rejects."""
    try:
        result = common.estimate(without(block, found.rejected))
        common.sigmas = result.decisions.sigmas
        return search(block, result, common.adjust, found.rejected)
    except PhotogramError as error:
        common.sigmas = found.result.decisions.sigmas
        said = f"The sigmas of tie points could not be estimated: {error}. They are used as stated"
        return replace(found, result=replace(found.result, warnings=(*found.result.warnings, said)))


def _with_everything(block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray]) -> Adjustment | None:
    """Return the adjustment with all measurements, for the effect of blunders on the check points, None where it has no
    solution."""
    quick = replace(
        settings,
        estimate_sigmas=False,
        maximum_rounds=min(ROUNDS_TO_COMPARE, settings.maximum_rounds),
        maximum_iterations=min(ITERATIONS_TO_COMPARE, settings.maximum_iterations),
    )
    try:
        return adjust(block, quick, start=start)
    except PhotogramError:
        return None


def _looked_at(block: Block, rejected: Sequence[Hypothesis], adjuster: Adjuster) -> Adjustment | None:
    """Return the adjustment without the rejected measurements, None where it has no solution."""
    try:
        return adjuster(without(block, rejected))
    except PhotogramError:
        return None


def _searched(
    block: Block, result: Adjustment | None, adjuster: Adjuster, rejected: Sequence[Hypothesis] = ()
) -> list[Search]:
    """Return the search that starts from the adjustment without the rejected measurements, none where it has no
    solution."""
    try:
        return [] if result is None else [search(block, result, adjuster, rejected)]
    except PhotogramError:
        return []


def _looked_for(look: Callable[[], list[Hypothesis]]) -> list[Hypothesis]:
    """Return the suspects of a screening, none where the block cannot be adjusted for it."""
    try:
        return look()
    except PhotogramError:
        return []


def _of_another_size(block: Block, start: Sequence[FloatArray]) -> tuple[list[Hypothesis], list[Blunder]]:
    """Return all marks and their blunder, if they were measured in pictures of another size."""
    cameras = tuple(c.with_parameters(q) for c, q in zip(block.cameras, start, strict=True)) if start else block.cameras
    factor = picture_factor(replace(block, cameras=cameras))
    if factor is None:
        return [], []
    points, names = block.control_points, [p.name for p in block.photographs]
    marks = zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True)
    sentence = f"{len(points.mark_point)} marks: {other_size(factor)}"
    blunder = Blunder("picture size", points.name, None, sentence)
    return [unmeasured("mark", points.name[g], names[i]) for g, i in marks], [blunder]


NOT_SETTLED = (
    "The focal length of {names} contradicts its source and could not be settled: the adjustment between the two "
    "failed ({fault}). The result rejects the source: calibrate the camera"
)


def _with_settled(settled: Block, found: Search, decisions: Mapping[str, FocalDecision], adjuster: Adjuster) -> Search:
    """Return the data snooping of a block with settled focal lengths, from what was ``found`` without. Raises
    AdjustmentError where the block cannot be adjusted so."""
    sure = {name for name, decision in decisions.items() if decision.says.trustworthy}
    others = [a for a in found.rejected if a.kind != "focal length" or a.name in sure]
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
        found, whole = _explained(block, settings, start, common)
        if settings.estimate_sigmas and (found.rejected or not len(common.sigmas)):
            found = _reweighted(block, found, common)
    except PhotogramError as error:
        if not size:
            raise
        raise AdjustmentError(f"{size[0].sentence}; without them {error}") from error
    settled, decisions = settle_focal_lengths(block, found, adjuster, common.restarting, progress, readings_px)
    if settled is not None:
        try:
            found = _with_settled(settled, found, decisions, adjuster)
        except PhotogramError as error:
            sentence = NOT_SETTLED.format(names=", ".join(decisions), fault=error)
            warned = replace(found.result, warnings=(*found.result.warnings, sentence))
            found, settled, decisions = replace(found, result=warned), None, {}
    off = marks_off_checks(found.result)
    if off:
        cleared = block if settled is None else settled
        found = Search((*found.rejected, *off), adjuster(without(cleared, [*found.rejected, *off])))
    points = block.control_points
    before = _checks(whole, points) if whole is not None else _no_checks(points)
    return Verdict(
        found.result,
        (*of_another_size, *found.rejected),
        (*size, *name_blunders(block, found)),
        before,
        _checks(found.result, points),
        decisions,
    )
