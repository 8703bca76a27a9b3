"""Ground sampling distance: the side of a pixel on the ground, distance along the axis over focal length."""

import numpy as np
from scipy.ndimage import median

from photogram.arrays import FloatArray
from photogram.survey import Block


def ground_sampling_m(distance_m: FloatArray, focal_px: FloatArray) -> float:
    """Return the median over photographs of the ground sampling distance, in m: ``distance_m`` (N,) to the ground,
    ``focal_px`` (N,)."""
    return float(np.median(distance_m / focal_px))


def photographs_ground_sampling_m(block: Block) -> FloatArray:
    """Return the ground sampling distance (N,) of each photograph, in m: of the median depth of its tie points; NaN
    where it has none or is not registered."""
    tie = block.tie_points
    axis, position = (np.full((len(block.photographs), 3), np.nan) for _ in range(2))
    for i, pose in enumerate(block.poses):
        if pose is not None:
            axis[i], position[i] = pose.rotation_world_from_camera[:, 2], pose.position_world_m
    depth = np.zeros(len(tie.photograph))
    for k in range(3):  # coordinate by coordinate: millions of observations need no (N, 3, 3) array
        depth += axis[tie.photograph, k] * (tie.position_world_m[tie.point, k] - position[tie.photograph, k])
    gsd = np.full(len(block.photographs), np.nan)
    used = np.unique(tie.photograph)
    if len(used):
        focal = np.array([block.cameras[photograph.camera].focal_px for photograph in block.photographs])
        gsd[used] = np.asarray(median(depth, tie.photograph, used)) / focal[used]
    return gsd
