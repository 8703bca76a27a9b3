"""The frame of a block that nothing places in the world: its vertical, its heading, its origin and its scale.

The vertical is that of measured attitudes, or follows from how photographs are taken.
"""

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Similarity
from photogram.constraints.between_points import Distance, gives_scale
from photogram.errors import OrientationError
from photogram.measures.vertical import ALIKE, Vertical, vertical_by_view
from photogram.sfm.similarity import common_rotation
from photogram.survey import Block

SPACING = "mean distance of photographs from their nearest neighbours"
"""What a length of 1 is where no distance is known."""


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


def structure_scale(block: Block, centre: FloatArray, registered: BoolArray, ground: FloatArray) -> float:
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
    scale = structure_scale(block, position, registered, ground)
    known = np.isfinite(tie_points).all(axis=1)
    middle = np.median(tie_points[known], axis=0) if known.any() else position[own].mean(axis=0)
    return Similarity(scale, turn, -scale * turn @ middle)
