"""The part of a block that could be oriented, and the way back to all its photographs and marks."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Pose
from photogram.results import Adjustment
from photogram.survey import Block


def registered_block(block: Block) -> tuple[Block, IntArray]:
    """Return the block of the photographs that have a pose, and their indices (K,) in ``block``.

    Tie points keep only the observations in them, and need two; marks in other photographs are left out.
    """
    return part_of_block(block, np.array([pose is not None for pose in block.poses], dtype=bool))


def part_of_block(block: Block, chosen: BoolArray) -> tuple[Block, IntArray]:
    """Return the block of the photographs ``chosen`` (N,), and their indices (K,) in ``block``.

    Tie points keep only the observations in them, and need two; marks in other photographs are left out.
    """
    kept = np.flatnonzero(chosen)
    if len(kept) == len(block.poses):
        return block, kept
    number = np.full(len(block.photographs), -1, dtype=np.int64)
    number[kept] = np.arange(len(kept))
    tie, control = block.tie_points, block.control_points
    seen = chosen[tie.photograph]
    ties = tie.select(np.bincount(tie.point[seen], minlength=len(tie)) >= 2, seen)
    marks = chosen[control.mark_photograph]
    return (
        replace(
            block,
            photographs=tuple(block.photographs[i] for i in kept),
            poses=tuple(block.poses[i] for i in kept),
            tie_points=replace(ties, photograph=number[ties.photograph]),
            control_points=replace(
                control,
                mark_photograph=number[control.mark_photograph[marks]],
                mark_point=control.mark_point[marks],
                mark_pixel=control.mark_pixel[marks],
                mark_covariance_px2=control.mark_covariance_px2[marks],
            ),
        ),
        kept,
    )


def _spread(values: FloatArray, kept: NDArray[np.generic], count: int) -> FloatArray:
    """Return rows (count, ...) that are NaN but for those kept."""
    whole = np.full((count, *values.shape[1:]), np.nan)
    whole[kept] = values
    return whole


def with_all_photographs(adjustment: Adjustment, block: Block, kept: IntArray) -> Adjustment:
    """Return the adjustment of the photographs ``kept`` (K,) as one of the whole ``block``: NaN and None elsewhere."""
    count = len(block.photographs)
    poses: list[Pose | None] = [None] * count
    for i, pose in zip(kept.tolist(), adjustment.block.poses, strict=True):
        poses[i] = pose
    tie, known = adjustment.block.tie_points, adjustment.tests.reliability
    seen = np.isin(block.control_points.mark_photograph, kept)
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
        tests=replace(
            adjustment.tests,
            reliability=replace(
                known,
                mark_redundancy=_spread(known.mark_redundancy, seen, len(seen)),
                mark_w=_spread(known.mark_w, seen, len(seen)),
                mark_left_out_px=_spread(known.mark_left_out_px, seen, len(seen)),
                mark_left_out_covariance_px2=_spread(known.mark_left_out_covariance_px2, seen, len(seen)),
                gnss_redundancy=_spread(known.gnss_redundancy, kept, count),
                gnss_w=_spread(known.gnss_w, kept, count),
                gnss_left_out_m=_spread(known.gnss_left_out_m, kept, count),
                gnss_left_out_covariance_m2=_spread(known.gnss_left_out_covariance_m2, kept, count),
                attitude_left_out_rad=_spread(known.attitude_left_out_rad, kept, count),
                attitude_left_out_covariance_rad2=_spread(known.attitude_left_out_covariance_rad2, kept, count),
            ),
        ),
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
    known, count = adjustment.tests.reliability, len(kept)
    return replace(
        adjustment,
        block=replace(adjustment.block, control_points=block.control_points),
        estimates=replace(
            adjustment.estimates, mark_residual_px=_spread(adjustment.estimates.mark_residual_px, kept, count)
        ),
        tests=replace(
            adjustment.tests,
            reliability=replace(
                known,
                mark_redundancy=_spread(known.mark_redundancy, kept, count),
                mark_w=_spread(known.mark_w, kept, count),
                mark_left_out_px=_spread(known.mark_left_out_px, kept, count),
                mark_left_out_covariance_px2=_spread(known.mark_left_out_covariance_px2, kept, count),
            ),
        ),
    )


def of_surveyed_points(adjustment: Adjustment) -> Adjustment:
    """Return an adjustment with surveyed ground points alone: those that are marked and not surveyed have taken part,
    and are tested by nothing."""
    block = adjustment.block
    kept = np.asarray(np.isfinite(block.control_points.position_world_m).all(axis=1))
    if kept.all():
        return adjustment
    marks = kept[block.control_points.mark_point]
    known, rows = adjustment.tests.reliability, np.flatnonzero(np.repeat(kept, 3))
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
        tests=replace(
            adjustment.tests,
            reliability=replace(
                known,
                ground_redundancy=known.ground_redundancy[kept],
                ground_w=known.ground_w[kept],
                ground_left_out_m=known.ground_left_out_m[kept],
                ground_left_out_covariance_m2=known.ground_left_out_covariance_m2[kept],
                mark_redundancy=known.mark_redundancy[marks],
                mark_w=known.mark_w[marks],
                mark_left_out_px=known.mark_left_out_px[marks],
                mark_left_out_covariance_px2=known.mark_left_out_covariance_px2[marks],
            ),
        ),
    )
