"""Ground points intersected from their marks alone, in an oriented block, which marks agree on each, and marks as tie
points."""

from dataclasses import replace

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import image_plane_or_nan
from photogram.survey import TRANSFERRED, Block, TiePoints
from photogram.triangulation import consensus_intersections

AGREE_PX, AGREE_SHARE = 5.0, 1e-3
"""What marks may miss each other by beside their own sigma, px and share of the longer side of the picture, the larger
of the two: cameras are not calibrated yet, and what a lens bends grows with the picture."""

_LIMIT = 4.0


def intersected_marks(block: Block) -> tuple[FloatArray, BoolArray]:
    """Return the ground points (G, 3) of an oriented block from the marks that agree, in the world, NaN with fewer than
    two, and which marks do."""
    points = block.control_points
    order = np.lexsort((points.mark_photograph, points.mark_point))
    oriented = block.registered
    order = order[oriented[points.mark_photograph[order]] & np.isfinite(points.mark_sigma_px[order])]
    photograph, pixel = points.mark_photograph[order], points.mark_pixel[order]
    camera_of = block.camera_of
    side_px = np.array([max(camera.width_px, camera.height_px) for camera in block.cameras])
    agree_px = np.maximum(AGREE_PX, AGREE_SHARE * side_px[camera_of[photograph]])
    ideal = np.empty_like(pixel)
    for c, camera in enumerate(block.cameras):
        own = camera_of[photograph] == c
        ideal[own] = image_plane_or_nan(camera, pixel[own])
    position, agreed = consensus_intersections(
        np.searchsorted(points.mark_point[order], np.arange(len(points) + 1)).astype(np.int64),
        photograph, pixel, ideal, agree_px + _LIMIT * points.mark_sigma_px[order],
        block.oriented_cameras(),
    )  # fmt: skip
    inlier = np.zeros(len(points.mark_point), dtype=bool)
    inlier[order] = agreed
    return position, inlier


def with_marks_as_tie_points(block: Block, chosen: BoolArray) -> Block:
    """Return the block with the marks of ground points ``chosen`` (G,) as tie points too, behind the others and with
    the marks' sigmas; points that are marked once add nothing."""
    points, ties = block.control_points, block.tie_points
    added = chosen & (np.bincount(points.mark_point, minlength=len(points)) >= 2)
    number = len(ties) + np.cumsum(added) - 1
    order = np.lexsort((points.mark_photograph, points.mark_point))
    order = order[added[points.mark_point[order]]]
    further = int(added.sum())
    return replace(
        block,
        tie_points=TiePoints(
            np.concatenate([ties.photograph, points.mark_photograph[order]]),
            np.concatenate([ties.point, number[points.mark_point[order]]]).astype(np.int64),
            np.concatenate([ties.feature, np.full(len(order), TRANSFERRED)]).astype(np.int64),
            np.concatenate([ties.pixel, points.mark_pixel[order]]),
            np.concatenate([ties.sigma_px, points.mark_sigma_px[order]]),
            np.concatenate([ties.position_world_m, np.full((further, 3), np.nan)]),
            np.concatenate([ties.colour, np.zeros((further, 3), dtype=np.uint8)]),
        ),
    )


def tied_by_marks(block: Block, component: IntArray) -> BoolArray:
    """Return which check points (G,) are marked in oriented photographs of several components, by the number of that of
    each photograph (N,): their marks tie these together, their coordinates stay unused."""
    points = block.control_points
    of_mark = component[points.mark_photograph]
    usable = block.registered[points.mark_photograph] & (of_mark >= 0) & np.isfinite(points.mark_sigma_px)
    pairs = np.unique(np.column_stack([points.mark_point[usable], of_mark[usable]]), axis=0)
    several = np.bincount(pairs[:, 0], minlength=len(points)) >= 2
    return np.asarray(several & (np.array(points.role, dtype=object) == "check"))
