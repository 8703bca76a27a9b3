"""Which way is up, by how photographs are taken and by what their positions say.

Looking down, their optical axes point to the ground. Held level by a person or on a tripod, their horizontal image axes
are level, whatever way they look (Szeliski 2006): the direction that is least along all of them is up, and where all
look the same way, up in the pictures is up.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from photogram.arrays import FloatArray

Vertical = Literal["auto", "down", "level"]
VerticalBy = Literal["attitudes", "down", "level"]

ALIKE = 0.7
"""Length of the mean of unit vectors, from which they point the same way."""
TURNED = 0.05
"""Mean square of image axes across their main direction, from which photographs were turned."""
VERTICAL_SIGMA_RAD = 0.15
"""Standard deviation of a vertical that follows from how photographs are taken, about every level axis."""


@dataclass(frozen=True)
class EstimatedVertical:
    """``up_world`` (3,) of photographs and ``by`` what it was found: measured attitudes, photographs that look down, or
    photographs held level; not ``sure`` where they could as well look down."""

    up_world: FloatArray
    by: VerticalBy
    sure: bool = True


def vertical_by_view(rotation_world_from_camera: FloatArray, wanted: Vertical = "auto") -> EstimatedVertical:
    """Return which way is up for photographs with rotations (N, 3, 3), looking down or held level as ``wanted``, or
    whichever they show.

    Those of a flight look the same way, with another side of the picture up in every strip; those held level have the
    same side up.
    """
    x, y, z = (rotation_world_from_camera[:, :, k] for k in range(3))
    view, picture_up = z.mean(axis=0), -y.mean(axis=0)
    value, vector = np.linalg.eigh(x.T @ x / len(x))
    turned, upright = bool(value[1] > TURNED), float(np.linalg.norm(picture_up))
    down = wanted == "down"
    if wanted == "auto":
        down = float(np.linalg.norm(view)) > ALIKE and upright < ALIKE
    if down:
        return EstimatedVertical(-view / max(float(np.linalg.norm(view)), 1e-12), "down")
    up = vector[:, 0] if turned else picture_up - x.mean(axis=0) * (picture_up @ x.mean(axis=0))
    up = up / max(float(np.linalg.norm(up)), 1e-12)
    sure = wanted == "level" or (turned and abs(float(up @ picture_up)) > 0.5 * upright > 0.0)
    return EstimatedVertical(up if up @ picture_up >= 0.0 else -up, "level", bool(sure))


def vertical_near(rotation_world_from_camera: FloatArray, up_world: FloatArray) -> FloatArray:
    """Return up (3,) of photographs with rotations (N, 3, 3), looking down or held level, whichever is nearer to
    ``up_world`` (3,)."""
    ways: tuple[Vertical, ...] = ("down", "level")
    found = [vertical_by_view(rotation_world_from_camera, way).up_world for way in ways]
    return max(found, key=lambda up: float(up @ up_world))


def structure_up(rotation: FloatArray, wanted: Vertical, by_positions: FloatArray) -> FloatArray:
    """Return up (3,) of a structure with rotations (N, 3, 3): as its photographs show it, or nearest to that
    ``by_positions`` (3,) where they do not prove it."""
    found = vertical_by_view(rotation, wanted)
    return found.up_world if found.sure else vertical_near(rotation, by_positions)


def turn_sigmas_rad(position_m: FloatArray, sigma_m: FloatArray) -> tuple[float, float]:
    """Return how well positions (N, 3) that are measured to ``sigma_m`` (N, 3) hold a block against a tilt about its
    weakest level axis, and against a turn about the vertical: standard deviations, infinite where not at all."""
    inverse = 1.0 / sigma_m**2
    x = position_m - np.sum(inverse * position_m, axis=0) / inverse.sum(axis=0)
    turned = np.cross(np.eye(3)[:, None], x[None])  # axis of the turn, position, direction
    information = np.einsum("ank,nk,bnk->ab", turned, inverse, turned)
    held = np.array([np.linalg.eigvalsh(information[:2, :2])[0], information[2, 2]])
    tilt, heading = (1.0 / np.sqrt(np.maximum(held, 1e-24))).tolist()
    return tilt, heading
