"""Surveyed positions of control points, each axis with its own sigma."""

from __future__ import annotations

import gtsam

from photogram.factors.variables import CONTROL_POINT, key
from photogram.survey import FloatArray


def surveyed_position(point: int, position_world_m: FloatArray, sigma_m: FloatArray) -> gtsam.NonlinearFactor:
    """Return the factor of control point ``point`` surveyed at a world position (3,) with sigmas (3,), both in m."""
    return gtsam.PriorFactorPoint3(
        key(CONTROL_POINT, point), position_world_m, gtsam.noiseModel.Diagonal.Sigmas(sigma_m)
    )
