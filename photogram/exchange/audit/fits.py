"""How a result fits its measurements: residuals of tie points and marks, and ground points against their survey."""

from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.ground_points import intersect_weighted
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.factors.elimination.reprojection import Observations, observed_marks, residuals
from photogram.files.solutions.solution import ForeignSolution
from photogram.quality.accuracy import CheckAccuracy, check_accuracy
from photogram.results import Adjustment
from photogram.sfm.marked_points import intersected_marks
from photogram.survey import Block
from photogram.triangulation import intersect


@dataclass(frozen=True, eq=False)
class Fit:
    """How a result fits its measurements."""

    tie_rms_px: float
    """Root mean square of a tie point's residual, its length."""
    mark_rms_px: float
    """The same of marks; NaN without."""
    off_m: FloatArray
    """Ground points, adjusted minus surveyed, along the map's axes (G, 3); NaN where they were not intersected."""
    control: CheckAccuracy
    """Adjusted minus surveyed, of control: how well they were fitted, no accuracy."""
    check: CheckAccuracy
    """The same of check points: accuracy."""


def fit_of_solution(solution: ForeignSolution, theirs: Block) -> Fit:
    """Return how a program's own cameras, poses and tie points fit.

    Its ground points are those that it states, where its files have them, else intersected from the marks by least
    squares; tie points whose positions the files leave out are intersected too.
    """
    block = replace(theirs, cameras=solution.cameras)
    given = block.tie_points.position_world_m
    tie_world_m = np.where(np.isfinite(given), given, intersect(block))
    ground_world_m = _intersected(block)
    points, stated = solution.ground_points, solution.stated.ground_m
    if points is not None and stated is not None:
        stated = stated[np.isfinite(points.position_world_m).all(axis=1)]
        is_stated = known_rows(stated)
        ground_world_m[is_stated] = theirs.frame.world_from_map(stated[is_stated])
    return _fit(block, tie_world_m, ground_world_m)


def _intersected(block: Block) -> FloatArray:
    """Return ground points (G, 3) in the world from the marks that agree, NaN with fewer than two."""
    points = block.control_points
    _, agreed = intersected_marks(block)
    order = np.lexsort((points.mark_photograph, points.mark_point))
    order = order[agreed[order]]
    return intersect_weighted(observed_marks(points, order), block.cameras, block.oriented_cameras(), len(points))


def fit_of_adjustment(result: Adjustment) -> Fit:
    """Return how an adjustment fits."""
    off = _differences(result.block, result.estimates.ground_world_m)
    return Fit(
        _rms(result.estimates.residual_px),
        _rms(result.estimates.mark_residual_px),
        off,
        *_accuracies(result.block, off),
    )


def known_rows(rows: FloatArray) -> BoolArray:
    """Return which rows (N,) of an array (N, k) have no NaN."""
    return ~np.asarray(np.isnan(rows).any(axis=1), dtype=bool)


def _rms(residual_px: FloatArray) -> float:
    squares = np.sum(residual_px[known_rows(residual_px)] ** 2, axis=1)
    return float(np.sqrt(squares.mean())) if len(squares) else float("nan")


def _differences(block: Block, ground_world_m: FloatArray) -> FloatArray:
    to_map = block.frame.map_from_world
    return to_map(ground_world_m) - to_map(block.control_points.position_world_m)


def _accuracies(block: Block, off_m: FloatArray) -> tuple[CheckAccuracy, CheckAccuracy]:
    """Return the differences of control and of check coordinates."""
    controlled = block.control_points.controlled
    return check_accuracy(np.where(controlled, off_m, np.nan)), check_accuracy(np.where(controlled, np.nan, off_m))


def _fit(block: Block, tie_world_m: FloatArray, ground_world_m: FloatArray) -> Fit:
    ties, points = block.tie_points, block.control_points
    cameras = block.oriented_cameras()
    oriented = known_rows(cameras.position)

    def rms_px(photograph: IntArray, point: IntArray, pixel: FloatArray, world_m: FloatArray) -> float:
        observed = Observations(photograph, point, pixel, np.ones(len(point)))
        residual_px = residuals(observed, cameras, np.nan_to_num(world_m))
        return _rms(residual_px[oriented[photograph] & known_rows(world_m)[point]])

    tie_rms_px = rms_px(ties.photograph, ties.point, ties.pixel, tie_world_m)
    mark_rms_px = rms_px(points.mark_photograph, points.mark_point, points.mark_pixel, ground_world_m)
    off = _differences(block, ground_world_m)
    return Fit(tie_rms_px, mark_rms_px, off, *_accuracies(block, off))
