"""GNSS heights brought to the level of surveyed ground points, before any mark shows how far they are off.

Barometric heights, and heights above a place of take-off that are taken for heights above the sea, are off by tens of
metres, more than some flights are high: cameras then lie below the points that they show. What photographs do know is
how high they flew above the ground, from tie points or from their tags, and ground points lie on the ground.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import FloatArray, nmad
from photogram.marking.tagged_block import RELIEF_SHARE
from photogram.survey import Block

AROUND = 8
"""Tie points around a ground point whose median height is that of the ground there."""


def levelled(block: Block) -> Block:
    """Return a block without marks with positions, poses and tie points raised to where its ground is that of its
    surveyed points, and the offset of GNSS heights as uncertain as that leaves it; any other block as it is.

    ``block`` is a ``tagged_block`` or an adjusted one. Nothing is raised where no offset is allowed for, or where its
    prior knows more.
    """
    points, allowed_m = block.control_points, float(block.gnss_offset_sigma_m[2])
    surveyed = points.position_world_m[np.isfinite(points.position_world_m).all(axis=1)]
    if len(points.mark_point) or not len(surveyed) or allowed_m <= 0.0:
        return block
    rise = _of_tie_points(block, surveyed) if len(block.tie_points) else _of_tags(block, surveyed)
    if rise is None or rise[1] >= allowed_m:
        return block
    up, measured_up = np.array([0.0, 0.0, rise[0]]), np.array([0.0, 0.0, rise[0] + _over_gnss_m(block)])
    return replace(
        block,
        photographs=tuple(
            p if p.gnss_world_m is None else replace(p, gnss_world_m=p.gnss_world_m + measured_up)
            for p in block.photographs
        ),
        poses=tuple(pose and replace(pose, position_world_m=pose.position_world_m + up) for pose in block.poses),
        tie_points=replace(block.tie_points, position_world_m=block.tie_points.position_world_m + up),
        gnss_offset_sigma_m=np.array([*block.gnss_offset_sigma_m[:2], rise[1]]),
    )


def _over_gnss_m(block: Block) -> float:
    """Return how much higher photographs lie than they were measured, which an adjustment may have estimated."""
    pairs = zip(block.photographs, block.poses, strict=True)
    above = [pose.position_world_m[2] - p.gnss_world_m[2] for p, pose in pairs if pose and p.gnss_world_m is not None]
    return float(np.median(above)) if above else 0.0


def _of_tie_points(block: Block, surveyed: FloatArray) -> tuple[float, float] | None:
    """Return how much higher the surveyed points (G, 3) lie than the tie points around them, and the standard deviation
    of that, m; None where no height above ground says what relief to expect."""
    ground = block.tie_points.position_world_m
    count = min(AROUND, len(ground))
    near = np.asarray(cKDTree(ground[:, :2]).query(surveyed[:, :2], k=count)[1]).reshape(len(surveyed), count)
    above = surveyed[:, 2] - np.median(ground[near, 2], axis=1)
    flown = [pose.position_world_m[2] for pose in block.poses if pose is not None]
    height_m = float(np.median(flown) - np.median(ground[:, 2])) if flown else 0.0
    return (float(np.median(above)), _spread_m(above, height_m)) if height_m > 0.0 else None


def _of_tags(block: Block, surveyed: FloatArray) -> tuple[float, float] | None:
    """Return how much higher the surveyed points (G, 3) lie than the ground by the flying heights that most photographs
    have, and the standard deviation of that, m; None without."""
    known = [
        (float(p.gnss_world_m[2]), p.height_above_ground_m)
        for p in block.photographs
        if p.gnss_world_m is not None and p.height_above_ground_m is not None and p.height_above_ground_m > 0.0
    ]
    if 2 * len(known) <= len(block.photographs):
        return None
    height_m = float(np.median([above for _, above in known]))
    level_m = float(np.median([z - above for z, above in known]))
    return float(np.median(surveyed[:, 2])) - level_m, _spread_m(surveyed[:, 2] - level_m, height_m)


def _spread_m(above: FloatArray, height_m: float) -> float:
    return float(np.hypot(nmad(above), RELIEF_SHARE * height_m))
