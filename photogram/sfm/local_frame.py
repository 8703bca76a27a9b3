"""The frame of a block that nothing places in the world: its vertical, its heading, its origin and its scale.

The vertical is that of measured attitudes, or follows from how photographs are taken. Looking down, their optical axes
point to the ground. Held level by a person or on a tripod, their horizontal image axes are level, whatever way they
look (Szeliski 2006): the direction that is least along all of them is up, and where all look the same way, up in the
pictures is up.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Similarity
from photogram.constraints.between_points import Distance, gives_scale
from photogram.errors import OrientationError
from photogram.sfm.similarity import common_rotation
from photogram.survey import Block

Vertical = Literal["auto", "down", "level"]
VerticalBy = Literal["attitudes", "down", "level"]

ALIKE = 0.7
"""Length of the mean of unit vectors, from which they point the same way."""
TURNED = 0.05
"""Mean square of image axes across their main direction, from which photographs were turned."""
SPACING = "mean distance of photographs from their nearest neighbours"
"""What a length of 1 is where no distance is known."""


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


def _level_axes(up: FloatArray, rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) to the local frame: up, and ahead of it where the photographs look on the whole, or
    where up is in the pictures, or along the block."""
    ahead = rotation[:, :, 2].mean(axis=0), -rotation[:, :, 1].mean(axis=0)
    level = [a - up * (a @ up) for a in ahead]
    longest = np.linalg.svd(position - position.mean(axis=0))[2][0]
    chosen = next((a for a in level if np.linalg.norm(a) > 1.0 - ALIKE), longest - up * (longest @ up))
    if not np.linalg.norm(chosen) > 1e-6:
        chosen = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    north = chosen / np.linalg.norm(chosen)
    return np.array([np.cross(north, up), north, up])


def _scale(block: Block, centre: FloatArray, registered: BoolArray, ground: FloatArray) -> float:
    """Return the factor from the lengths of a structure to those of the local frame. Raises OrientationError where none
    of the measured distances can be found in it."""
    if not gives_scale(block.constraints):
        nearest = np.asarray(cKDTree(centre[registered]).query(centre[registered], k=2)[0])[:, 1]
        return 1.0 / float(np.mean(nearest))
    photographs = {p.name: i for i, p in enumerate(block.photographs) if registered[i]}
    points = {name: g for g, name in enumerate(block.control_points.name)}

    def length(distance: Distance) -> float:
        known, places = (photographs, centre) if distance.of_photographs else (points, ground)
        a, b = (known.get(name) for name in distance.ends)
        return float("nan") if a is None or b is None else float(np.linalg.norm(places[a] - places[b]))

    measured = [c for c in block.constraints if isinstance(c, Distance) and gives_scale([c])]
    lengths = np.array([length(d) for d in measured])
    known = np.isfinite(lengths) & (lengths > 0.0)
    if not known.any():
        raise OrientationError(
            f"the scale is not known: no end of the {len(measured)} distances is where the photographs show it; "
            "mark each end in two oriented photographs or more"
        )
    return float(np.median(np.array([d.length_m for d in measured])[known] / lengths[known]))


def local_similarity(
    block: Block,
    rotation: FloatArray,
    position: FloatArray,
    registered: BoolArray,
    tie_points: FloatArray,
    ground: FloatArray,
    vertical: Vertical = "auto",
) -> Similarity:
    """Return the similarity from a structure to the local frame of a free block.

    ``rotation`` (N, 3, 3) and ``position`` (N, 3) are those of the ``registered`` (N,) photographs, ``tie_points`` (P,
    3) and ``ground`` (G, 3) points of the structure, NaN where unknown. The median of the tie points becomes the
    origin. Raises OrientationError where the measured distances give no scale.
    """
    own = np.flatnonzero(registered)
    given = [i for i in own.tolist() if block.photographs[i].attitude_world_from_camera is not None]
    if given and vertical == "auto":
        measured = np.array([block.photographs[i].attitude_world_from_camera for i in given])
        turn = common_rotation(measured @ rotation[given].transpose(0, 2, 1))
    else:
        turn = _level_axes(vertical_by_view(rotation[own], vertical).up_world, rotation[own], position[own])
    scale = _scale(block, position, registered, ground)
    known = np.isfinite(tie_points).all(axis=1)
    middle = np.median(tie_points[known], axis=0) if known.any() else position[own].mean(axis=0)
    return Similarity(scale, turn, -scale * turn @ middle)
