"""Surveyed positions of control points, each axis with its own sigma."""

from __future__ import annotations

import gtsam

from photogram.arrays import FloatArray
from photogram.factors.noise import along_axes
from photogram.factors.variables import CONTROL_POINT, key


def surveyed_position(
    point: int, position_world_m: FloatArray, sigma_m: FloatArray, axes: FloatArray | None = None
) -> gtsam.NonlinearFactor:
    """Return the factor of control point ``point`` surveyed at a world position (3,), m.

    Its sigmas (3,) in m lie along the columns of ``axes`` (3, 3), the map's axes in the world.
    """
    return gtsam.PriorFactorPoint3(key(CONTROL_POINT, point), position_world_m, along_axes(sigma_m, axes))
