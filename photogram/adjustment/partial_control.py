"""Control points of which only some coordinates are control: where they lie before anything is adjusted.

A surveyed coordinate that is a check must not touch the adjustment, not even as a starting value. Such a point starts
where the rays of its marks come closest to each other and to the coordinates that are control.
"""

from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import unproject
from photogram.errors import AdjustmentError
from photogram.survey import Block

_SURVEYED = 1e3  # weight of a controlled coordinate beside the distance to a ray
_LEAST_EIGENVALUE = 1e-4


def _nearest_to_rays(block: Block, g: int, surveyed_world_m: FloatArray, axes: FloatArray) -> FloatArray:
    """Return where control point ``g`` lies (3,) in the world by its marks and its controlled coordinates.

    Least squares of the distances to the rays, and of the controlled coordinates along ``axes`` (3, 3) to those of
    ``surveyed_world_m`` (3,). Raises AdjustmentError where both leave the point open.
    """
    points = block.control_points
    controlled = axes[:, points.used[g]].T * _SURVEYED
    N = controlled.T @ controlled
    right = N @ surveyed_world_m
    for m in np.flatnonzero(points.mark_point == g).tolist():
        pose = block.poses[points.mark_photograph[m]]
        if pose is None or not np.isfinite(points.mark_sigma_px[m]):
            continue
        camera = block.cameras[block.photographs[points.mark_photograph[m]].camera]
        ray = pose.rotation_world_from_camera @ unproject(camera, points.mark_pixel[m][None])[0]
        across = np.eye(3) - np.outer(ray, ray)
        N += across
        right += across @ pose.position_world_m
    if np.linalg.eigvalsh(N)[0] < _LEAST_EIGENVALUE:
        coordinates = "plan" if points.used[g, 0] else "height"
        raise AdjustmentError(
            f"control point {points.name[g]} is control in {coordinates} only and its marks do not determine the "
            "rest: mark it in more photographs, or give it the role check"
        )
    return np.asarray(np.linalg.solve(N, right))


def control_positions(block: Block) -> tuple[FloatArray, FloatArray]:
    """Return positions (G, 3) in the world that control points are held to, and the axes (G, 3, 3) of their sigmas.

    Those that are control in every coordinate are as surveyed, with the map's axes at the origin of the world. Of the
    others the coordinates that are checks come from their marks, and the axes are the map's where they lie: moved up
    and down, a point keeps easting and northing. Raises AdjustmentError where marks and coordinates leave one open.
    """
    points, frame = block.control_points.with_role("control"), block.frame
    of_control = replace(block, control_points=points)
    origin_axes = frame.rotation_world_from_map(np.zeros(3))
    position, axes = points.position_world_m.copy(), np.repeat(origin_axes[None], len(points), axis=0)
    used = points.used
    for g in np.flatnonzero(~used.all(axis=1)).tolist():
        # rounded, so that a coordinate that is a check leaves no trace in the last bits of the others
        surveyed = np.round(frame.map_from_world(points.position_world_m[g][None])[0], 6)
        known = frame.world_from_map(np.where(used[g], surveyed, frame.origin_map_m)[None])[0]
        by_marks = frame.map_from_world(_nearest_to_rays(of_control, g, known, origin_axes)[None])[0]
        position[g] = frame.world_from_map(np.where(used[g], surveyed, by_marks)[None])[0]
        axes[g] = frame.rotation_world_from_map(position[g])
    return position, axes
