"""Another program's result beside photogram's adjustment of the same measurements.

Twice adjusted: with the weights that the program used, which shows what the figures would be, and with blunders
rejected and sigmas estimated, which shows what they should be. Differences of poses and calibrations are judged by the
covariances of the second; two adjustments of the same measurements with the same model would differ by nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.errors import AdjustmentError
from photogram.exchange.audit.differences import PoseDifference, brought, calibration_differences, pose_differences
from photogram.exchange.audit.fits import Fit, fit_of_adjustment, fit_of_solution, known_rows
from photogram.exchange.audit.foreign_block import ForeignBlock, with_their_model
from photogram.exchange.audit.further_solutions import FurtherSolution, check_shared, further_solution
from photogram.files.solutions.solution import ForeignSolution
from photogram.measures.mark_covariances import scaled
from photogram.quality.deformation import DOME, height_modes
from photogram.quality.improvements import block_deformation
from photogram.quality.model_error import with_model_error
from photogram.results import Adjustment
from photogram.survey import Block, TiePoints
from photogram.wording import Progress, silent

FEWEST_POINTS = 20
"""Tie points in both results from which a bend is looked for."""
FEWEST_MARKED = 20
"""Coordinates of marks from which their scatter is estimated."""
HALF_BELOW = 0.6745
"""What half of standard normal variables stay below, in absolute value."""
STEADY, MOST_REWEIGHTED = 1.1, 5
"""Factor below which the sigmas of marks are left as they are, and adjustments in which they are estimated."""
AWAY = 10.0
"""Median distances from the median height difference beyond which a tie point is another one."""

LEAST_SQUARES = AdjustmentSettings(
    robust_loss="none", outlier_threshold=1e3, first_outlier_threshold_px=1e4, estimate_sigmas=False
)
"""Of programs that reject nothing."""


@dataclass(frozen=True, eq=False)
class Bend:
    """The heights of tie points, theirs minus ours, as the shape of a dome."""

    dome_m: float
    """At the radius of the block over its middle."""
    sigma_m: float
    """Predicted standard deviation of ours."""


@dataclass(frozen=True, eq=False)
class Audit:
    """Their result and photogram's."""

    solution: ForeignSolution
    start: ForeignBlock
    theirs: Fit
    same: Adjustment | None
    """With the weights of theirs and what it held, nothing rejected but mismatches; None where that has no solution."""
    same_fit: Fit | None
    ours: Verdict
    """With blunders rejected and sigmas estimated."""
    ours_fit: Fit
    poses: tuple[PoseDifference, ...]
    parameters: FloatArray
    """Interior orientations (cameras, 12), theirs minus ours."""
    parameter_sigmas: FloatArray
    """The same over the standard deviations (cameras, 12) of ours, NaN where it has none."""
    bend: Bend | None
    """None with too few tie points to tell."""
    mark_factor: float
    """By what the stated sigmas of marks were multiplied for ours."""
    further: tuple[FurtherSolution, ...] = ()
    """Further solutions of the photographs, by other programs."""

    @property
    def solutions(self) -> list[ForeignSolution]:
        """Return the audited solution and the further ones."""
        return [self.solution, *(each.solution for each in self.further)]

    @property
    def blocks(self) -> list[Block]:
        """Return the measurements of each of them."""
        return [self.start.block, *(each.start.block for each in self.further)]


def audited(
    solution: ForeignSolution,
    start: ForeignBlock,
    progress: Progress = silent,
    others: Sequence[tuple[ForeignSolution, ForeignBlock]] = (),
) -> Audit:
    """Adjust the measurements of a foreign solution anew and compare, with ``others`` of its photographs too.

    Raises AdjustmentError where the measurements do not determine the block even without what contradicts the rest,
    ExchangeError where a further solution shares no photograph with it.
    """
    for other, _ in others:
        check_shared(solution, other)
    block = start.block
    progress(0, 0, "their result")
    theirs = fit_of_solution(solution, start.theirs)
    same, same_fit = _with_their_weights(solution, start, progress)
    progress(0, 0, "blunders and sigmas")
    block, mark_factor = _with_scatter_of_marks(start, progress)
    settings = AdjustmentSettings(lens_field="none")  # theirs has none either
    ours = adjust_with_snooping(block, settings, start.parameters, progress)
    progress(0, 0, "deformation of the block")
    known_before = [camera.parameters for camera in block.cameras]
    bent = block_deformation(ours.result, AdjustmentSettings(), known_before)
    ours = replace(
        ours,
        result=with_model_error(replace(ours.result, covariances=replace(ours.result.covariances, deformation=bent))),
    )
    result = ours.result
    every = np.arange(len(solution.photographs))
    moved = brought(start, every, result) or start.theirs
    off, sigmas = calibration_differences(solution.cameras, result)
    progress(0, 0, "differences")
    return Audit(
        solution=solution,
        start=start,
        theirs=theirs,
        same=same,
        same_fit=same_fit,
        ours=ours,
        ours_fit=fit_of_adjustment(result),
        poses=tuple(pose_differences(moved.poses, result)),
        parameters=off,
        parameter_sigmas=sigmas,
        bend=_bend(moved, result),
        mark_factor=mark_factor,
        further=tuple(further_solution(other, placed, solution, result) for other, placed in others),
    )


def _with_scatter_of_marks(start: ForeignBlock, progress: Progress) -> tuple[Block, float]:
    """Return the block with the sigmas of its marks multiplied by what they scatter, and that factor; as it is with few
    of them, or where it has no solution.

    Programs take a nominal figure, 0.1 px for example, that nobody has measured. Half of the normalised residuals are
    below 0.674 (Hampel 1974), whatever some wrong marks do.
    """
    block, factor = start.block, 1.0
    for _ in range(MOST_REWEIGHTED):
        try:
            result = adjust(block, AdjustmentSettings(), progress, start=start.parameters)
        except AdjustmentError:
            return start.block, 1.0
        w = np.abs(result.tests.reliability.mark_w)
        w = w[np.isfinite(w)]
        if len(w) < FEWEST_MARKED:
            return start.block, 1.0
        more = float(np.median(w)) / HALF_BELOW
        if 1.0 / STEADY < more < STEADY:
            break
        factor *= more
        points = start.block.control_points
        covariance = scaled(points.mark_covariance_px2, np.full(len(points.mark_point), factor))
        scattered = replace(points, mark_covariance_px2=covariance)
        block = replace(start.block, control_points=scattered)
    return block, factor


def _with_their_weights(
    solution: ForeignSolution, start: ForeignBlock, progress: Progress
) -> tuple[Adjustment | None, Fit | None]:
    """Return the adjustment as the program made it, as far as its files say how, and how it fits."""
    progress(0, 0, "their weights")
    settings = LEAST_SQUARES if solution.stated.is_least_squares else AdjustmentSettings(estimate_sigmas=False)
    try:
        same = adjust(with_their_model(start, solution), settings, progress, start=start.parameters)
    except AdjustmentError:
        return None, None
    return same, fit_of_adjustment(same)


def _observed(ties: TiePoints) -> NDArray[np.void]:
    """Return each observation (N,), its photograph and pixel, as one value that can be compared."""
    rows = np.column_stack([ties.photograph.astype(np.float64), ties.pixel])
    return np.ascontiguousarray(rows).view([("", np.float64)] * 3).ravel()


def _bend(theirs: Block, result: Adjustment) -> Bend | None:
    """Return the dome of their heights over ours, from the tie points in both."""
    deformation = result.covariances.deformation
    if not deformation.known or result.block.is_free:
        return None
    own, other = result.block.tie_points, theirs.tie_points
    numbers = np.full(len(own), -1, dtype=np.int64)
    _, mine, its = np.intersect1d(_observed(own), _observed(other), return_indices=True)
    numbers[own.point[mine]] = other.point[its]
    known = (numbers >= 0) & known_rows(other.position_world_m)[numbers]
    if np.count_nonzero(known) < FEWEST_POINTS:
        return None
    places = own.position_world_m[known]
    off = other.position_world_m[numbers[known], 2] - places[:, 2]
    away = np.abs(off - np.median(off))
    robust = away <= AWAY * np.median(away)
    modes = height_modes(places[robust, :2], deformation.centre_world_m, deformation.radius_m)
    return Bend(float((modes @ off[robust])[3]), float(np.sqrt(deformation.covariance[DOME, DOME])))
