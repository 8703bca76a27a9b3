"""Errors that all photographs of a flight share: the base of RTK, the antenna's lever arm, the compass.

Sigmas of single positions and attitudes do not hold them, and none of them is stated here.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Pose
from photogram.survey import Photograph

BASE_SIGMA_M = (0.02, 0.02, 0.03)
"""Standard deviations of the RTK base's coordinates: east, north, up."""
ARM_M = 0.05
"""Distance of the antenna from the projection centre, ahead of it."""
COMPASS_DEG = 3.0
"""Common error of all headings, to either side."""

Photographs = tuple[Photograph, ...]
Poses = tuple[Pose, ...]
CommonError = Callable[[Photographs, Poses, np.random.Generator], Photographs]


def _moved(photographs: Photographs, by_m: FloatArray) -> Photographs:
    """Return the photographs with their GNSS positions moved (N, 3)."""
    return tuple(
        p if p.gnss_world_m is None else replace(p, gnss_world_m=p.gnss_world_m + step)
        for p, step in zip(photographs, by_m, strict=True)
    )


def base_off(photographs: Photographs, _poses: Poses, rng: np.random.Generator) -> Photographs:
    """Return the photographs with their positions from a base whose coordinates are wrong."""
    return _moved(photographs, np.tile(np.array(BASE_SIGMA_M) * rng.standard_normal(3), (len(photographs), 1)))


def antenna_ahead(photographs: Photographs, poses: Poses, _rng: np.random.Generator) -> Photographs:
    """Return the photographs with the positions of an antenna ahead of the projection centre, against the rows."""
    return _moved(photographs, np.array([pose.rotation_world_from_camera @ [0.0, -ARM_M, 0.0] for pose in poses]))


def compass_off(photographs: Photographs, _poses: Poses, rng: np.random.Generator) -> Photographs:
    """Return the photographs with all headings wrong by the same angle."""
    turn = Rotation.from_euler("z", COMPASS_DEG * float(rng.choice([-1.0, 1.0])), degrees=True).as_matrix()
    return tuple(
        p
        if p.attitude_world_from_camera is None
        else replace(p, attitude_world_from_camera=turn @ p.attitude_world_from_camera)
        for p in photographs
    )


def nothing(photographs: Photographs, _poses: Poses, _rng: np.random.Generator) -> Photographs:
    """Return the photographs as they are."""
    return photographs


COMMON_ERRORS: dict[str, CommonError] = {
    "nothing": nothing,
    "base": base_off,
    "antenna": antenna_ahead,
    "compass": compass_off,
}
