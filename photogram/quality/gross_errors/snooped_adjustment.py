"""The joint adjustment with its verdict: what contradicts the rest is named, left out, and the survey goes on.

The block is adjusted with everything in it, and suspects are tested on equal terms
(photogram.quality.gross_errors.data_snooping). A blunder so gross that it bends the block is laid to its neighbours
too: then what a robust adjustment leaves out, and what a look without any control point finds, are tried beside it, and
that is taken which explains most with least. A focal length whose source is rejected is settled at last, see
photogram.quality.gross_errors.focal_length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.adjustment import AdjustmentSettings, adjust
from photogram.arrays import FloatArray
from photogram.errors import AdjustmentError, PhotogramError
from photogram.quality.accuracy import CheckAccuracy, check_accuracy
from photogram.quality.gross_errors.blunder_naming import Blunder, exchanged_points, name_blunders
from photogram.quality.gross_errors.data_snooping import (
    PRICE,
    Accusation,
    Adjuster,
    Search,
    accusations,
    marks_off_checks,
    search,
    simplified,
    unmeasured,
    whole_points,
    without,
)
from photogram.quality.gross_errors.focal_evidence import settle_focal_lengths
from photogram.quality.gross_errors.robust_start import grossly_off
from photogram.quality.gross_errors.screening import gross_blunders
from photogram.results import Adjustment, FocalDecision
from photogram.sfm.mark_scale import other_size, picture_factor
from photogram.survey import Block, ControlPoints
from photogram.wording import some, things

BENT = 12.0
"""Sigmas by which the rest contradicts a measurement, from which a blunder in it may be laid to others too."""

BORNE = 40.0
"""The same, up to which it may yet be named right from an adjustment that holds it."""

OUTVOTED = 0.5
"""Of the tie points of a photograph with marks: a wrong mark may have outvoted them."""

ROUNDS_TO_COMPARE, ITERATIONS_TO_COMPARE = 3, 30
"""Of an adjustment with blunders in it, which is made to say what they do."""

MOST_NAMED = 10
"""Culprits that are named where too little is left without them."""

MANY = 4
"""Gross blunders from which a second look, without any control point, is worth its time."""

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Verdict:
    """The adjustment without what contradicts it: ``accused``, by name the ``blunders``; the accuracy of the check
    points with everything in it, not a number where that cannot be adjusted, and without; and what was decided on
    focal lengths, by the names of cameras."""

    result: Adjustment
    accused: tuple[Accusation, ...]
    blunders: tuple[Blunder, ...]
    check_before: CheckAccuracy
    check_after: CheckAccuracy
    focal_lengths: dict[str, FocalDecision]

    def __repr__(self) -> str:
        return f"<Verdict: {things(len(self.blunders), 'blunder')} left out, {self.result!r}>"


def _outvoted(block: Block, result: Adjustment) -> bool:
    """Return whether a photograph has lost most of its tie points to something else that was measured in it."""
    count = len(block.photographs)
    given, kept = (np.bincount(b.tie_points.photograph, minlength=count) for b in (block, result.block))
    oriented = np.array([pose is not None for pose in result.block.poses], dtype=bool)
    return bool(np.any(oriented & (kept < OUTVOTED * given)))


def _worst(result: Adjustment) -> float:
    return float(np.sqrt(max((a.statistic for a in accusations(result)), default=0.0)))


def _checks(result: Adjustment, points: ControlPoints) -> CheckAccuracy:
    """Return the accuracy at what is a check in ``points``."""
    frame = result.block.frame
    difference = frame.map_from_world(result.ground_world_m) - frame.map_from_world(points.position_world_m)
    return check_accuracy(np.where(points.controlled, np.nan, difference))


def _no_checks(points: ControlPoints) -> CheckAccuracy:
    return check_accuracy(np.full((len(points), 3), np.nan))


def _explained(
    block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray], adjuster: Adjuster
) -> tuple[Search, Adjustment | None]:
    """Return the best explanation of what contradicts the rest, and the adjustment with everything in it, None where it
    was not made: gross blunders bend it beyond use. Raises PhotogramError where nothing can be adjusted."""
    gross, whole, found = _looked_for(lambda: grossly_off(block, settings, start)), None, []
    fault: PhotogramError | None = None
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
    for accused in ways:
        try:
            if accused:
                found.append(search(block, adjuster(without(block, accused)), adjuster, accused))
        except PhotogramError as error:
            fault = fault or error
    if gross:
        # what is gross to the robust adjustment may be small enough for the plain one, whose tests are sharper
        whole = _with_everything(block, settings, start)
        if whole is not None and _worst(whole) <= BORNE:
            found += _searched(block, whole, adjuster)
    if not found:
        culprits = some(list(dict.fromkeys(a.words for way in ways for a in way)), MOST_NAMED)
        said = f"; most of the rest contradicts {culprits}, and without that too little is left" if culprits else ""
        raise AdjustmentError(f"{fault or 'nothing that was measured determines the block'}{said}") from fault
    best = min(found, key=Search.cost)
    wider = whole_points(best.accused)
    if {(a.what, a.axes) for a in wider} != {(a.what, a.axes) for a in best.accused}:
        found += _searched(block, _looked_at(block, wider, adjuster), adjuster, wider)

    def cost(explanation: Search) -> float:
        # two points that were exchanged are one mistake, not two
        return explanation.cost() - PRICE * len(exchanged_points(block, explanation))

    return min(found, key=cost), whole


def _with_everything(block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray]) -> Adjustment | None:
    """Return the adjustment with everything in it, for what blunders do to the check points, None where there is
    none."""
    quick = replace(
        settings,
        maximum_rounds=min(ROUNDS_TO_COMPARE, settings.maximum_rounds),
        maximum_iterations=min(ITERATIONS_TO_COMPARE, settings.maximum_iterations),
    )
    try:
        return adjust(block, quick, start=start)
    except PhotogramError:
        return None


def _looked_at(block: Block, accused: Sequence[Accusation], adjuster: Adjuster) -> Adjustment | None:
    """Return the adjustment without what is accused, None where that does not determine the block."""
    try:
        return adjuster(without(block, accused))
    except PhotogramError:
        return None


def _searched(
    block: Block, result: Adjustment | None, adjuster: Adjuster, accused: Sequence[Accusation] = ()
) -> list[Search]:
    """Return what a search finds from the adjustment without what is accused, nothing where there is none, or the rest
    has no solution."""
    try:
        return [] if result is None else [search(block, result, adjuster, accused)]
    except PhotogramError:
        return []


def _looked_for(look: Callable[[], list[Accusation]]) -> list[Accusation]:
    """Return what a look at the block finds, nothing where it cannot be adjusted that way."""
    try:
        return look()
    except PhotogramError:
        return []


def _of_another_size(block: Block, start: Sequence[FloatArray]) -> tuple[list[Accusation], list[Blunder]]:
    """Return all marks, and what is wrong with them, where they were measured in pictures of another size."""
    cameras = tuple(c.with_parameters(q) for c, q in zip(block.cameras, start, strict=True)) if start else block.cameras
    factor = picture_factor(replace(block, cameras=cameras))
    if factor is None:
        return [], []
    points, names = block.control_points, [p.name for p in block.photographs]
    marks = zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True)
    sentence = f"{len(points.mark_point)} marks: {other_size(factor)}"
    blunder = Blunder("picture size", points.name, None, sentence)
    return [unmeasured("mark", points.name[g], names[i]) for g, i in marks], [blunder]


def adjust_and_judge(
    block: Block,
    settings: AdjustmentSettings,
    start: Sequence[FloatArray] = (),
    progress: Progress = lambda _: None,
    readings_px: Sequence[Sequence[float]] = (),
) -> Verdict:
    """Adjust a block without what contradicts the rest (data snooping; Baarda 1968), and name that.

    ``start`` holds the interior orientations (11,) of the cameras to start from, where they are not the given ones;
    ``readings_px`` other readings of the source of each focal length, px. Raises AdjustmentError as adjust does where
    too little is left, with what contradicts the rest by name.
    """

    def adjuster(given: Block) -> Adjustment:
        return adjust(given, settings, progress, start=start)

    of_another_size, size = _of_another_size(block, start)
    block = without(block, of_another_size)
    try:
        found, whole = _explained(block, settings, start, adjuster)
    except PhotogramError as fault:
        if not size:
            raise
        raise AdjustmentError(f"{size[0].sentence}; without them {fault}") from fault
    settled, decisions = settle_focal_lengths(block, found, adjuster, progress, readings_px)
    if settled is not None:
        sure = {d for d, decision in decisions.items() if decision.says.trustworthy}
        others = [a for a in found.accused if a.kind != "focal length" or a.name in sure]
        found = search(settled, adjuster(without(settled, others)), adjuster, others)
    off = marks_off_checks(found.result)
    if off:
        cleared = block if settled is None else settled
        found = Search((*found.accused, *off), adjuster(without(cleared, [*found.accused, *off])))
    points = block.control_points
    before = _checks(whole, points) if whole is not None else _no_checks(points)
    return Verdict(
        found.result,
        (*of_another_size, *found.accused),
        (*size, *name_blunders(block, found)),
        before,
        _checks(found.result, points),
        decisions,
    )
