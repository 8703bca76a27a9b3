"""Oriented photographs as compiled code takes them: one array per property, over all photographs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.projection import seen_at
from photogram.survey import Block


@dataclass(frozen=True, eq=False)
class Views:
    """The oriented photographs of a block.

    ``photograph`` (V,) are their numbers in the block; ``model`` (V,), ``parameters`` (V, 11),
    ``rotation_world_from_camera`` (V, 3, 3), ``position_world_m`` (V, 3), ``size_px`` (V, 2) width and height, and
    ``largest_radius`` (V,): the ideal radius beyond which the distortion folds back.
    """

    photograph: IntArray
    model: IntArray
    parameters: FloatArray
    rotation_world_from_camera: FloatArray
    position_world_m: FloatArray
    size_px: IntArray
    largest_radius: FloatArray

    def __len__(self) -> int:
        return len(self.photograph)

    @staticmethod
    def of(block: Block) -> Views:
        """Return the photographs of a block that have a pose."""
        index = [i for i, pose in enumerate(block.poses) if pose is not None]
        poses = [pose for pose in block.poses if pose is not None]
        cameras = [block.cameras[block.photographs[i].camera] for i in index]
        return Views(
            np.array(index, dtype=np.int64),
            np.array([camera.kind for camera in cameras], dtype=np.int64),
            np.array([camera.parameters for camera in cameras]).reshape(-1, 11),
            np.array([pose.rotation_world_from_camera for pose in poses]).reshape(-1, 3, 3),
            np.array([pose.position_world_m for pose in poses]).reshape(-1, 3),
            np.array([(camera.width_px, camera.height_px) for camera in cameras], dtype=np.int64).reshape(-1, 2),
            np.array([camera.largest_radius for camera in cameras]),
        )


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _see_all(
    model: int, q: FloatArray, R: FloatArray, C: FloatArray, largest_radius: float, X: FloatArray, out: FloatArray
) -> None:
    for n in range(len(X)):
        out[n, 0], out[n, 1], _ = seen_at(model, q, R, C, largest_radius, X[n])


def places_in_view(views: Views, view: int, places_world_m: FloatArray) -> FloatArray:
    """Return the pixels (N, 2) of places (N, 3) in a view, inside the photograph or not; NaN for what is behind it."""
    pixel = np.empty((len(places_world_m), 2))
    _see_all(
        views.model[view], views.parameters[view], views.rotation_world_from_camera[view], views.position_world_m[view],
        views.largest_radius[view], np.ascontiguousarray(places_world_m), pixel,
    )  # fmt: skip
    return pixel
