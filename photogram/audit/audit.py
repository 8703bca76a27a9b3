"""Another program's result beside photogram's adjustment of the same measurements.

Twice adjusted: with the weights that the program used, which shows what the figures would be, and with blunders
rejected and sigmas estimated, which shows what they should be. Differences of poses and calibrations are judged by the
covariances of the second; two adjustments of the same measurements with the same model would differ by nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import BoolArray, FloatArray
from photogram.audit.foreign_block import ForeignBlock, similarity_of_poses
from photogram.errors import AdjustmentError, OrientationError
from photogram.factors.elimination.reprojection import Observations, residuals
from photogram.files.exchange.solution import ForeignSolution
from photogram.quality.accuracy import CheckAccuracy, check_accuracy
from photogram.quality.deformation import DOME, height_modes
from photogram.quality.gross_errors.snooped_adjustment import Verdict, adjust_and_judge
from photogram.quality.improvements import block_deformation
from photogram.quality.model_error import with_model_error
from photogram.results import Adjustment
from photogram.sfm.marked_points import intersected_marks
from photogram.survey import Block, TiePoints
from photogram.triangulation import intersect

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

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Fit:
    """How a result fits its measurements."""

    tie_rms_px: float
    """Root mean square of a tie point's residual, its length."""
    mark_rms_px: float
    """The same of marks; NaN without."""
    control: CheckAccuracy
    """Adjusted minus surveyed, of control: how well they were fitted, no accuracy."""
    check: CheckAccuracy
    """The same of check points: accuracy."""


@dataclass(frozen=True, eq=False)
class PoseDifference:
    """A photograph's exterior orientation, theirs minus ours."""

    photograph: str
    position_m: FloatArray
    """Of the projection centre (3,) in the world."""
    rotation_rad: FloatArray
    """About the camera's axes (3,)."""
    sigmas: float
    """Root of the mean square of the six over their predicted covariance: 1 where they differ by chance alone."""


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
    """With the weights of theirs, nothing rejected but mismatches; None where that has no solution."""
    same_fit: Fit | None
    ours: Verdict
    """With blunders rejected and sigmas estimated."""
    ours_fit: Fit
    poses: tuple[PoseDifference, ...]
    parameters: FloatArray
    """Interior orientations (cameras, 11), theirs minus ours."""
    parameter_sigmas: FloatArray
    """The same over the standard deviations (cameras, 11) of ours, NaN where it has none."""
    bend: Bend | None
    """None with too few tie points to tell."""
    mark_factor: float
    """By what the stated sigmas of marks were multiplied for ours."""


def audited(solution: ForeignSolution, start: ForeignBlock, progress: Progress = lambda _: None) -> Audit:
    """Adjust the measurements of a foreign solution anew and compare.

    Raises AdjustmentError where they do not determine the block even without what contradicts the rest.
    """
    block = start.block
    held = replace(start.theirs, cameras=solution.cameras)
    progress("their result")
    theirs = _fit(held, _their_points(held), intersected_marks(held)[0])
    same, same_fit = _with_their_weights(start, progress)
    progress("blunders and sigmas")
    block, mark_factor = _with_scatter_of_marks(start, progress)
    ours = adjust_and_judge(block, AdjustmentSettings(), start.parameters, progress)
    progress("deformation of the block")
    known_before = [camera.parameters for camera in block.cameras]
    bent = block_deformation(ours.result, AdjustmentSettings(), known_before)
    ours = replace(ours, result=with_model_error(replace(ours.result, deformation=bent)))
    result, moved = ours.result, _brought(start, ours.result)
    off = np.array([c.parameters for c in solution.cameras]) - np.array([c.parameters for c in result.block.cameras])
    sigma = np.sqrt(np.einsum("ckk->ck", result.calibration_covariance))
    return Audit(
        solution, start, theirs, same, same_fit, ours, _fit_of(result), tuple(_pose_differences(moved, result)), off,
        np.divide(off, sigma, out=np.full(off.shape, np.nan), where=sigma > 0.0), _bend(moved, result),
        mark_factor,
    )  # fmt: skip


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
        w = np.abs(result.reliability.mark_w)
        w = w[np.isfinite(w)]
        if len(w) < FEWEST_MARKED:
            return start.block, 1.0
        more = float(np.median(w)) / HALF_BELOW
        if 1.0 / STEADY < more < STEADY:
            break
        factor *= more
        points = start.block.control_points
        scattered = replace(points, mark_sigma_px=points.mark_sigma_px * factor)
        block = replace(start.block, control_points=scattered)
    return block, factor


def _their_points(held: Block) -> FloatArray:
    """Return their tie points (P, 3); what the files leave out is intersected from their cameras."""
    given = held.tie_points.position_world_m
    return np.where(np.isfinite(given), given, intersect(held))


def _with_their_weights(start: ForeignBlock, progress: Progress) -> tuple[Adjustment | None, Fit | None]:
    progress("their weights")
    try:
        same = adjust(start.block, AdjustmentSettings(estimate_sigmas=False), progress, start=start.parameters)
    except AdjustmentError:
        return None, None
    return same, _fit_of(same)


def _known(rows: FloatArray) -> BoolArray:
    return ~np.asarray(np.isnan(rows).any(axis=1), dtype=bool)


def _rms(residual_px: FloatArray) -> float:
    squares = np.sum(residual_px[_known(residual_px)] ** 2, axis=1)
    return float(np.sqrt(squares.mean())) if len(squares) else float("nan")


def _differences(block: Block, ground_world_m: FloatArray) -> tuple[CheckAccuracy, CheckAccuracy]:
    """Return ground points minus their survey along the map's axes, of control and of check coordinates."""
    points, frame = block.control_points, block.frame
    off = np.full((len(points), 3), np.nan)
    known = _known(ground_world_m)
    off[known] = frame.map_from_world(ground_world_m[known]) - frame.map_from_world(points.position_world_m[known])
    control = np.where(points.controlled, off, np.nan)
    return check_accuracy(control), check_accuracy(np.where(points.controlled, np.nan, off))


def _fit(block: Block, tie_world_m: FloatArray, ground_world_m: FloatArray) -> Fit:
    ties, points, cameras = block.tie_points, block.control_points, block.oriented_cameras()
    unit = np.ones(len(ties.photograph)), np.ones(len(points.mark_point))
    seen = _known(cameras.position)
    of_ties, of_marks = seen[ties.photograph], seen[points.mark_photograph]
    tie = residuals(Observations(ties.photograph, ties.point, ties.pixel, unit[0]), cameras, np.nan_to_num(tie_world_m))
    mark = residuals(
        Observations(points.mark_photograph, points.mark_point, points.mark_pixel, unit[1]),
        cameras, np.nan_to_num(ground_world_m),
    )  # fmt: skip
    of_ties &= _known(tie_world_m)[ties.point]
    of_marks &= _known(ground_world_m)[points.mark_point]
    return Fit(_rms(tie[of_ties]), _rms(mark[of_marks]), *_differences(block, ground_world_m))


def _fit_of(result: Adjustment) -> Fit:
    return Fit(
        _rms(result.residual_px), _rms(result.mark_residual_px), *_differences(result.block, result.ground_world_m)
    )


def _brought(start: ForeignBlock, result: Adjustment) -> Block:
    """Return their block as its files place it, else brought to ours by the similarity of the projection centres."""
    if start.is_placed:
        return start.theirs
    try:
        fit = similarity_of_poses(start.theirs.poses, result.block.poses)
    except OrientationError:
        return start.theirs  # in one line, where a turn about it is open
    ties = start.theirs.tie_points
    return replace(
        start.theirs,
        poses=tuple(None if pose is None else fit.pose(pose) for pose in start.theirs.poses),
        tie_points=replace(ties, position_world_m=fit.points(ties.position_world_m)),
    )


def _pose_differences(theirs: Block, result: Adjustment) -> list[PoseDifference]:
    found = []
    for i, (a, b) in enumerate(zip(theirs.poses, result.block.poses, strict=True)):
        if a is None or b is None:
            continue
        position = a.position_world_m - b.position_world_m
        turn = b.rotation_world_from_camera.T @ a.rotation_world_from_camera
        rotation = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        squares = position @ np.linalg.pinv(result.position_covariance_m2[i]) @ position
        squares += rotation @ np.linalg.pinv(result.rotation_covariance_rad2[i]) @ rotation
        sigmas = float(np.sqrt(squares / 6.0))
        found.append(PoseDifference(theirs.photographs[i].name, position, rotation, sigmas))
    return found


def _observed(ties: TiePoints) -> NDArray[np.void]:
    """Return each observation (N,), its photograph and pixel, as one value that can be compared."""
    rows = np.column_stack([ties.photograph.astype(np.float64), ties.pixel])
    return np.ascontiguousarray(rows).view([("", np.float64)] * 3).ravel()


def _bend(theirs: Block, result: Adjustment) -> Bend | None:
    """Return the dome of their heights over ours, from the tie points in both."""
    deformation = result.deformation
    if not deformation.known or result.block.is_free:
        return None
    own, other = result.block.tie_points, theirs.tie_points
    numbers = np.full(len(own), -1, dtype=np.int64)
    _, mine, its = np.intersect1d(_observed(own), _observed(other), return_indices=True)
    numbers[own.point[mine]] = other.point[its]
    known = (numbers >= 0) & _known(other.position_world_m)[numbers]
    if np.count_nonzero(known) < FEWEST_POINTS:
        return None
    places = own.position_world_m[known]
    off = other.position_world_m[numbers[known], 2] - places[:, 2]
    away = np.abs(off - np.median(off))
    robust = away <= AWAY * np.median(away)
    modes = height_modes(places[robust, :2], deformation.centre_world_m, deformation.radius_m)
    return Bend(float((modes @ off[robust])[3]), float(np.sqrt(deformation.covariance[DOME, DOME])))
