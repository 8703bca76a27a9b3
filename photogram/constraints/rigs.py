"""Cameras fixed to one body: the pose of a companion relative to its master, and which photographs are one exposure.

With master R, X and companion R', X' (world from camera, projection centres), offset o and rotation M (master from
companion): R' = R M and X' = X + R o.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Where a companion sits on the body of its master."""

    offset_m: FloatArray
    """Projection centre (3,) of the companion in the master's camera frame: x right, y down, z forward."""
    rotation_master_from_companion: FloatArray
    """Rotation (3, 3) from the companion's camera frame to the master's."""

    def __post_init__(self) -> None:
        if self.offset_m.shape != (3,) or self.rotation_master_from_companion.shape != (3, 3):
            raise ValueError("a relative pose is an offset (3,) and a rotation (3, 3)")

    def companions(self, rotation: FloatArray, position_world_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (n, 3, 3), world from camera, and positions (n, 3) of the companion from the master's."""
        return rotation @ self.rotation_master_from_companion, position_world_m + rotation @ self.offset_m

    def misfits(self, rotation: FloatArray, offset_m: FloatArray) -> FloatArray:
        """Return by how much relative poses (n, 3, 3), (n, 3) differ from this one, (n, 6).

        A rotation vector (rad) in the companion's camera frame, and an offset (m) in the master's.
        """
        turn = Rotation.from_matrix(self.rotation_master_from_companion.T @ rotation).as_rotvec()
        return np.hstack([turn, offset_m - self.offset_m])


def relative_poses(
    master: tuple[FloatArray, FloatArray], companion: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return rotations (n, 3, 3), master from companion, and offsets (n, 3) in the master's camera frame, in metres.

    Each camera is given by rotations (n, 3, 3), world from camera, and positions (n, 3) in the world.
    """
    turned = np.swapaxes(master[0], -1, -2)
    return turned @ companion[0], np.einsum("nij,nj->ni", turned, companion[1] - master[1])


@dataclass(frozen=True)
class Exposures:
    """Photographs by number, grouped to exposures of one rig."""

    companion_master: tuple[tuple[int, int], ...]
    """Each companion that has a master, and that master, in the order of the companions."""
    without_master: tuple[int, ...]
    """Companions of whose exposure there is no photograph of the master."""


def exposures(cameras: Sequence[str], keys: Sequence[Hashable | None], master: str) -> Exposures:
    """Group the photographs of one rig by the key of their exposure, None where it is not known: a capture id, say.

    Raises ValueError where one camera has two photographs with the same key.
    """
    places: dict[tuple[str, Hashable], int] = {}
    for photograph, (camera, key) in enumerate(zip(cameras, keys, strict=True)):
        if key is not None and places.setdefault((camera, key), photograph) != photograph:
            raise ValueError(f"two photographs of camera {camera} have the exposure {key}")
    pairs: list[tuple[int, int]] = []
    alone: list[int] = []
    for photograph, (camera, key) in enumerate(zip(cameras, keys, strict=True)):
        if camera != master:
            found = places.get((master, key)) if key is not None else None
            if found is None:
                alone.append(photograph)
            else:
                pairs.append((photograph, found))
    return Exposures(tuple(pairs), tuple(alone))
