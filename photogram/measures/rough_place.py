"""A block whose positions scatter by more than its photographs stand apart: what holds it upright, and its heading.

Positions that tell the vertical worse than the way in which photographs are taken does are joined by this: the tilt of
the block is observed, to VERTICAL_SIGMA_RAD about every level axis. A heading that they leave open is held where the
orientation found it, to HEADING_SIGMA_RAD, by which it is off where it may be any. Both are observations of one
photograph in the middle of the block, since its photographs hold each other.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.measures.collinearity import collinear
from photogram.measures.vertical import VERTICAL_SIGMA_RAD, turn_sigmas_rad, vertical_near
from photogram.survey import Block

HEADING_SIGMA_RAD = float(np.pi / np.sqrt(3.0))
"""Of an angle that may be any: the standard deviation of a uniform distribution from −π to π."""
OPEN_HEADING_RAD = 0.5
"""Standard deviation of the heading by the positions, from which it is held."""
_FREE_RAD = 100.0
_PLACING = 3  # control points, or positions


@dataclass(frozen=True, eq=False)
class RoughPlace:
    """What photographs that stand ``width_m`` apart do not know of the place of their block by positions of
    ``sigma_m``: ``rotation`` (3, 3) is that of ``photograph`` with the block upright, ``open_heading`` whether the
    positions leave the turn about the vertical open."""

    photograph: int
    rotation: FloatArray
    width_m: float
    sigma_m: float
    open_heading: bool

    @property
    def sigma_rad(self) -> FloatArray:
        """Return how well it is known, about the world's axes (3,)."""
        heading = HEADING_SIGMA_RAD if self.open_heading else _FREE_RAD
        return np.array([VERTICAL_SIGMA_RAD, VERTICAL_SIGMA_RAD, heading])


def rough_place(block: Block) -> RoughPlace | None:
    """Return what the positions of a block, all of whose photographs are oriented, leave open of its place; None where
    they, control points or measured attitudes tell the vertical, or nothing does."""
    points = block.control_points.fully_controlled()
    marked = np.unique(points.mark_point[np.isfinite(points.mark_sigma_px)])
    attitudes = sum(p.attitude_world_from_camera is not None for p in block.photographs)
    known = [i for i, p in enumerate(block.photographs) if p.gnss_world_m is not None]
    if len(known) < _PLACING or len(marked) >= _PLACING or attitudes >= 2:
        return None
    poses = [pose for pose in block.poses if pose is not None]
    centre = np.array([pose.position_world_m for pose in poses])
    if collinear(centre[known]):
        return None  # however good they are, a turn about their line is open, and is said to be
    sigma_m = np.array([block.photographs[i].gnss_sigma_m for i in known])
    tilt, heading = turn_sigmas_rad(centre[known], sigma_m)
    if not tilt > VERTICAL_SIGMA_RAD:
        return None
    rotation = np.array([pose.rotation_world_from_camera for pose in poses])
    up = block.frame.rotation_world_from_map(centre.mean(axis=0))[:, 2]
    turn = Rotation.align_vectors(up[None], vertical_near(rotation, up)[None])[0].as_matrix()
    middle = int(np.argmin(np.linalg.norm(centre - np.median(centre, axis=0), axis=1)))
    return RoughPlace(
        middle,
        turn @ rotation[middle],
        float(np.linalg.norm(np.ptp(centre, axis=0))),
        float(np.sqrt(np.mean(sigma_m**2))),
        heading > OPEN_HEADING_RAD,
    )
