"""The joint adjustment with everything that may change the model: what is wrong is rejected and named, what is in
common is estimated, and the survey goes on.

What shows before anything is adjusted is left out first, a robust adjustment and data snooping give the first
explanation of the contradictions (photogram.amendments.first_explanation), and the amendments go on from there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.effort import Effort, tallied
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.stochastic_model.estimated_sigmas import with_assumed_sigmas, with_control_assumed
from photogram.amendments.amendment import amended
from photogram.amendments.check_marks import CheckMarks
from photogram.amendments.constant_heights import constant_heights
from photogram.amendments.contradicted_measurements import ContradictedMeasurements
from photogram.amendments.estimated_unknowns import decided_by_adjustment
from photogram.amendments.first_explanation import first_solution
from photogram.amendments.focal_evidence import FocalLengths
from photogram.amendments.gross_errors.blunder_naming import Blunder, name_blunders
from photogram.amendments.gross_errors.data_snooping import without
from photogram.amendments.gross_errors.hypothesis import Hypothesis
from photogram.amendments.gross_errors.robust_start import Gross, gross_suspects
from photogram.amendments.lens_fields import LensFields
from photogram.amendments.picture_size import marks_of_another_size
from photogram.amendments.repeated_positions import repeated_positions
from photogram.amendments.solutions import Solutions, attempted
from photogram.amendments.surfaces.known_heights import KnownSurface
from photogram.amendments.surfaces.known_surfaces import KnownSurfaces
from photogram.amendments.undeclared_heights import HeightSystems, with_heights_open
from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.errors import AdjustmentError, PhotogramError
from photogram.quality.accuracy import CheckAccuracy, check_accuracy
from photogram.quality.prediction_test import checked_axes
from photogram.results import Adjustment, FocalDecision
from photogram.survey import Block, ControlPoints
from photogram.wording import Progress, silent, things


@dataclass(frozen=True, eq=False)
class Verdict:
    """The adjustment without its blunders, and what was rejected."""

    block: Block
    """The block as it was given, with the lens fields that were found."""
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
    priors: tuple[Camera, ...] = ()
    """The cameras with what was known of them before the last adjustment, a focal length that was decided included."""
    effort: tuple[Effort, ...] = ()
    """The work that it took, by what was decided."""

    def __repr__(self) -> str:
        return f"<Verdict: {things(len(self.blunders), 'blunder')} rejected, {self.result!r}>"


def _checks(result: Adjustment, points: ControlPoints) -> CheckAccuracy:
    """Return the accuracy at the check coordinates of ``points``."""
    frame = result.block.frame
    difference = frame.map_from_world(result.estimates.ground_world_m) - frame.map_from_world(points.position_world_m)
    return check_accuracy(np.where(checked_axes(points), difference, np.nan))


CONTRADICTED = (
    "The stated standard deviations of the control points are contradicted by a factor of {factor:.0f}: most of the "
    "points do not agree with the block's shape and with each other to what is stated. What they scatter by is used "
    "instead: enter the accuracy of their survey, or check that the points belong to these photographs"
)


def adjust_with_snooping(
    block: Block,
    settings: AdjustmentSettings,
    start: Sequence[FloatArray] = (),
    progress: Progress = silent,
    readings_px: Sequence[Sequence[float]] = (),
    known_surface: KnownSurface | None = None,
) -> Verdict:
    """Adjust a block and decide what is in its model: reject blunders by data snooping (Baarda 1968) and name them,
    settle height systems and focal lengths, estimate lens fields.

    ``start`` holds the interior orientations (12,) of the cameras to start from, where they are not the given ones;
    ``readings_px`` other readings of the source of each focal length, px; ``known_surface`` is control where it agrees
    with the rest. Raises AdjustmentError as adjust does where
    too little is left, with what contradicts the rest by name.
    """
    with tallied(len(block.tie_points.photograph)) as tally:
        verdict = _verdict(block, settings, start, progress, readings_px, known_surface)
    return replace(verdict, effort=tally.efforts)


def _verdict(
    given: Block,
    settings: AdjustmentSettings,
    start: Sequence[FloatArray],
    progress: Progress,
    readings_px: Sequence[Sequence[float]],
    known_surface: KnownSurface | None,
) -> Verdict:
    solutions = Solutions(settings, progress, start)
    of_another_size, size = marks_of_another_size(given, start)
    repeated, repeating = repeated_positions(given)
    constant, constants = constant_heights(given)
    beforehand = [*of_another_size, *repeated, *constant]
    declared = without(given, beforehand)
    block = with_heights_open(declared)
    robust = attempted(lambda: gross_suspects(block, settings, start)) or Gross((), solutions.begun)
    solutions.begun = robust.sigmas
    if robust.contradicted > 1.0:
        declared, block = with_control_assumed(declared), with_control_assumed(block)
    try:
        first, whole = first_solution(block, robust.suspects, solutions)
    except PhotogramError as error:
        if not size:
            raise
        raise AdjustmentError(f"{size[0].sentence}; without them {error}") from error
    heights, fields = HeightSystems(declared), LensFields(settings, progress)
    focal = FocalLengths(solutions, readings_px)
    surfaces = KnownSurfaces(known_surface, settings)
    amendments = (ContradictedMeasurements(solutions), heights, fields, focal, surfaces, CheckMarks())
    solution = amended(first, amendments, solutions)
    if robust.contradicted > 1.0:
        solution = solution.warned(CONTRADICTED.format(factor=robust.contradicted), first=True)
    made = [decision for amendment in amendments for decision in amendment.decided(solution)]
    decisions = replace(
        solution.result.decisions,
        made=(*made, *decided_by_adjustment(solution.result)),
        heights=heights.decision(solution),
        lens_fields=fields.decisions,
        known_surface=surfaces.decision(solution),
    )
    result = replace(solution.result, decisions=decisions)
    named = replace(with_assumed_sigmas(solution.block, decisions.sigmas), cameras=block.cameras)
    before = check_accuracy(np.full((len(block.control_points), 3), np.nan))
    return Verdict(
        _with_fields(given, solution.block),
        result,
        (*beforehand, *solution.rejected),
        (*size, *repeating, *constants, *name_blunders(named, replace(solution, result=result).explanation)),
        before if whole is None else _checks(whole, block.control_points),
        _checks(result, block.control_points),
        focal.decisions,
        robust.contradicted,
        solution.block.cameras,
    )


def _with_fields(given: Block, amended: Block) -> Block:
    """Return the block as it was given, its cameras with the lens fields of the one that was amended."""
    cameras = zip(given.cameras, amended.cameras, strict=True)
    return replace(given, cameras=tuple(replace(camera, field=other.field) for camera, other in cameras))
