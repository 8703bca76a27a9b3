"""Oriented photographs as compiled code takes them: one array per property, over all photographs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photogram.camera import project_point
from photogram.compilation import njit
from photogram.survey import Block

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
def seen_at(
    model: int, q: FloatArray, R: FloatArray, C: FloatArray, largest_radius: float, X: FloatArray
) -> tuple[float, float, float]:
    """Return u, v and the depth of X (3,) as ``project_point``; NaN for u and v where the point lies behind the camera
    or beyond the radius at which the distortion folds back."""
    u, v, depth = project_point(model, q, R, C, X)
    if np.isfinite(largest_radius) and depth > 0.0:
        dx, dy, dz = X[0] - C[0], X[1] - C[1], X[2] - C[2]
        px = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
        py = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
        if px * px + py * py > (largest_radius * depth) ** 2:
            return np.nan, np.nan, depth
    return u, v, depth


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
