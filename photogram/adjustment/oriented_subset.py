"""The part of a block that could be oriented, and the way back to all its photographs and marks."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Pose
from photogram.results import Adjustment, Reliability
from photogram.survey import Block


def registered_block(block: Block) -> tuple[Block, IntArray]:
    """Return the block of the photographs that have a pose, and their indices (K,) in ``block``.

    Tie points keep only the observations in them, and need two; marks in other photographs are left out.
    """
    return part_of_block(block, block.registered)


def part_of_block(block: Block, chosen: BoolArray) -> tuple[Block, IntArray]:
    """Return the block of the photographs ``chosen`` (N,), and their indices (K,) in ``block``.

    Tie points keep only the observations in them, and need two; marks in other photographs are left out.
    """
    kept = np.flatnonzero(chosen)
    if len(kept) == len(block.poses):
        return block, kept
    number = np.full(len(block.photographs), -1, dtype=np.int64)
    number[kept] = np.arange(len(kept))
    tie = block.tie_points
    seen = chosen[tie.photograph]
    ties = tie.select(np.bincount(tie.point[seen], minlength=len(tie)) >= 2, seen)
    control = without_marks(block, chosen[block.control_points.mark_photograph]).control_points
    part = replace(
        block,
        photographs=tuple(block.photographs[i] for i in kept),
        poses=tuple(block.poses[i] for i in kept),
        tie_points=replace(ties, photograph=number[ties.photograph]),
        control_points=replace(control, mark_photograph=number[control.mark_photograph]),
        known_surface=None if block.known_surface is None else block.known_surface.in_photographs(number),
    )
    return part, kept


def _spread(values: FloatArray, kept: NDArray[np.generic], count: int) -> FloatArray:
    """Return rows (count, ...) that are NaN but for those kept."""
    whole = np.full((count, *values.shape[1:]), np.nan)
    whole[kept] = values
    return whole


def _changed(known: Reliability, kind: str, change: Callable[[FloatArray], FloatArray]) -> Reliability:
    """Return the reliability with the fields of one ``kind`` of observations changed."""
    names = [field.name for field in fields(known) if field.name.startswith(f"{kind}_")]
    return replace(known, **{name: change(getattr(known, name)) for name in names})


def with_all_photographs(adjustment: Adjustment, block: Block, kept: IntArray) -> Adjustment:
    """Return the adjustment of the photographs ``kept`` (K,) as one of the whole ``block``: NaN and None elsewhere."""
    count = len(block.photographs)
    poses: list[Pose | None] = [None] * count
    for i, pose in zip(kept.tolist(), adjustment.block.poses, strict=True):
        poses[i] = pose
    tie = adjustment.block.tie_points
    seen = np.isin(block.control_points.mark_photograph, kept)
    known = _changed(adjustment.tests.reliability, "mark", lambda values: _spread(values, seen, len(seen)))
    for kind in ("gnss", "attitude"):
        known = _changed(known, kind, lambda values: _spread(values, kept, count))
    return replace(
        adjustment,
        block=replace(
            block,
            cameras=adjustment.block.cameras,
            poses=tuple(poses),
            tie_points=replace(tie, photograph=kept[tie.photograph]),
            common_errors=adjustment.block.common_errors,
            rigs=adjustment.block.rigs,
        ),
        covariances=replace(
            adjustment.covariances,
            position_m2=_spread(adjustment.covariances.position_m2, kept, count),
            rotation_rad2=_spread(adjustment.covariances.rotation_rad2, kept, count),
        ),
        estimates=replace(
            adjustment.estimates, mark_residual_px=_spread(adjustment.estimates.mark_residual_px, seen, len(seen))
        ),
        tests=replace(adjustment.tests, reliability=known),
    )


def without_marks(block: Block, kept: BoolArray) -> Block:
    """Return the block with the marks ``kept`` (M,) alone."""
    control = block.control_points
    return replace(
        block,
        control_points=replace(
            control,
            mark_photograph=control.mark_photograph[kept],
            mark_point=control.mark_point[kept],
            mark_pixel=control.mark_pixel[kept],
            mark_covariance_px2=control.mark_covariance_px2[kept],
        ),
    )


def with_all_marks(adjustment: Adjustment, block: Block, kept: BoolArray) -> Adjustment:
    """Return the adjustment of the marks ``kept`` (M,) as one of all marks of ``block``: NaN for the others."""
    count = len(kept)
    known = _changed(adjustment.tests.reliability, "mark", lambda values: _spread(values, kept, count))
    return replace(
        adjustment,
        block=replace(adjustment.block, control_points=block.control_points),
        estimates=replace(
            adjustment.estimates, mark_residual_px=_spread(adjustment.estimates.mark_residual_px, kept, count)
        ),
        tests=replace(adjustment.tests, reliability=known),
    )


def of_surveyed_points(adjustment: Adjustment) -> Adjustment:
    """Return an adjustment with surveyed ground points alone: those that are marked and not surveyed have taken part,
    and are tested by nothing."""
    block = adjustment.block
    kept = np.asarray(np.isfinite(block.control_points.position_world_m).all(axis=1))
    if kept.all():
        return adjustment
    marks = kept[block.control_points.mark_point]
    rows = np.flatnonzero(np.repeat(kept, 3))
    known = _changed(adjustment.tests.reliability, "ground", lambda values: values[kept])
    known = _changed(known, "mark", lambda values: values[marks])
    return replace(
        adjustment,
        block=block.surveyed,
        estimates=replace(
            adjustment.estimates,
            mark_residual_px=adjustment.estimates.mark_residual_px[marks],
            ground_world_m=adjustment.estimates.ground_world_m[kept],
        ),
        covariances=replace(
            adjustment.covariances,
            ground_m2=adjustment.covariances.ground_m2[kept],
            ground_joint_m2=adjustment.covariances.ground_joint_m2[np.ix_(rows, rows)],
        ),
        tests=replace(adjustment.tests, reliability=known),
    )
