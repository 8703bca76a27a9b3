"""Ground points intersected from their marks alone, in an oriented block, and which marks agree on each."""

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import image_plane_or_nan
from photogram.survey import Block
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
