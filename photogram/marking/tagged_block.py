"""A block that has no tie points yet: poses from tags, ground points from their survey, marks as far as there are any.

Points that were not surveyed lie where their marks meet, and with a single mark where its ray meets the ground.
"""

from dataclasses import replace

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Pose, unproject
from photogram.sfm.marked_points import intersected_marks
from photogram.survey import Block, Role

RELIEF_SHARE = 0.1
"""Standard deviation of the height of ground that nobody has measured, in flying heights."""

OPEN_M = 1e3
"""Standard deviation of what is open."""

_LEAST_DOWN = 0.1  # of a ray, by which it must point to the ground to meet it


def tagged_block(block: Block) -> Block:
    """Return the block with the poses that positions and attitudes of its photographs give, None where one of them is
    missing, without tie points."""
    poses = tuple(
        None
        if p.gnss_world_m is None or p.attitude_world_from_camera is None
        else Pose(p.attitude_world_from_camera, p.gnss_world_m)
        for p in block.photographs
    )
    return replace(block, poses=poses, tie_points=block.tie_points.select(np.zeros(len(block.tie_points), dtype=bool)))


def with_all_points(block: Block) -> Block:
    """Return the block with everything that is known of its ground points as control: check points too, since marks
    are looked for where they were surveyed, and points of no survey where their marks say that they are."""
    points = block.control_points
    surveyed = np.isfinite(points.position_world_m)
    position, sigma = points.position_world_m.copy(), np.where(surveyed, points.sigma_m, OPEN_M)
    # far from where its marks meet, a point whose coordinates were rejected is no place to start from
    placed: BoolArray = np.all(surveyed, axis=1) & np.any(np.isfinite(sigma), axis=1)
    sigma = np.where(np.isfinite(sigma), sigma, OPEN_M)
    level_m, relief_m = _ground(block, position[placed])
    met = intersected_marks(block)[0]
    for g in np.flatnonzero(~placed).tolist():
        foot = met[g] if np.isfinite(met[g]).all() else _foot(block, g, level_m)
        if foot is None:
            continue
        one = np.isfinite(met[g]).all()
        position[g], sigma[g] = foot, (OPEN_M, OPEN_M, OPEN_M if one else relief_m)
        placed[g] = True
    role: tuple[Role, ...] = tuple("control" for _ in points.name)
    all_axes = np.zeros((0, 3), dtype=bool)
    known = replace(points, role=role, position_world_m=position, sigma_m=sigma, controlled=all_axes)
    return replace(block, control_points=known.select(placed))


def ground_level_m(block: Block, position_world_m: FloatArray) -> float | None:
    """Return the height of the ground in the world: that of places (N, 3) on it, else what flying heights of posed
    photographs say; None where there are none."""
    if len(position_world_m):
        return float(np.median(position_world_m[:, 2]))
    below = [
        float(pose.position_world_m[2] - p.height_above_ground_m)
        for p, pose in zip(block.photographs, block.poses, strict=True)
        if pose is not None and p.height_above_ground_m is not None and p.height_above_ground_m > 0.0
    ]
    return float(np.median(below)) if below else None


def _ground(block: Block, position_world_m: FloatArray) -> tuple[float, float]:
    """Return the height of the ground in the world and the standard deviation of a place on it, m."""
    heights = [pose.position_world_m[2] for pose in block.poses if pose is not None]
    flown, level = float(np.median(heights)) if heights else 0.0, ground_level_m(block, position_world_m)
    level = flown - 100.0 if level is None else level
    spread = float(np.std(position_world_m[:, 2])) if len(position_world_m) > 1 else 0.0
    return level, max(spread, RELIEF_SHARE * abs(flown - level))


def _foot(block: Block, point: int, level_m: float) -> FloatArray | None:
    """Return where the ray of the first mark of a point meets the ground, None without such a ray."""
    points = block.control_points
    for m in np.flatnonzero(points.mark_point == point).tolist():
        pose = block.poses[points.mark_photograph[m]]
        if pose is None:
            continue
        camera = block.cameras[block.photographs[points.mark_photograph[m]].camera]
        ray = pose.rotation_world_from_camera @ unproject(camera, points.mark_pixel[m][None])[0]
        if ray[2] < -_LEAST_DOWN * np.linalg.norm(ray):
            return np.asarray(pose.position_world_m + ray * (level_m - pose.position_world_m[2]) / ray[2])
    return None
