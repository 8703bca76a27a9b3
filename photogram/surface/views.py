"""The oriented photographs of a block, and what they show of places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.projection import FOCAL, OrientedCameras, seen_called
from photogram.survey import Block


@dataclass(frozen=True, eq=False)
class Views:
    """The oriented photographs of a block: ``photograph`` (V,) are their numbers in the block, ``cameras`` the
    photographs, numbered 0 to V − 1, as compiled code takes them; where one looks flat at ground that it resolves worse
    than ``coarsest_m`` it is not chosen for matching."""

    photograph: IntArray
    cameras: OrientedCameras
    coarsest_m: float = np.inf

    def __len__(self) -> int:
        return len(self.photograph)

    @property
    def position_world_m(self) -> FloatArray:
        """Return the projection centres (V, 3)."""
        return self.cameras.position

    @property
    def focal_px(self) -> FloatArray:
        """Return the focal length (V,) of each view."""
        return np.asarray(self.cameras.parameters[self.cameras.camera, FOCAL])

    @property
    def size_px(self) -> IntArray:
        """Return width and height (V, 2) of each view."""
        return np.asarray(self.cameras.size_px[self.cameras.camera])

    @staticmethod
    def of(block: Block) -> Views:
        """Return the photographs of a block that have a pose."""
        index = [i for i, pose in enumerate(block.poses) if pose is not None]
        return Views(np.array(index, dtype=np.int64), block.oriented_cameras(index))


@njit(cache=True, nogil=True)
def _see_all(cameras: OrientedCameras, view: int, X: FloatArray, out: FloatArray) -> None:
    for n in range(len(X)):
        out[n, 0], out[n, 1], _ = seen_called(cameras, view, X[n, 0], X[n, 1], X[n, 2])


def places_in_view(views: Views, view: int, places_world_m: FloatArray) -> FloatArray:
    """Return the pixels (N, 2) of places (N, 3) in a view, inside the photograph or not; NaN for what is behind it."""
    pixel = np.empty((len(places_world_m), 2))
    _see_all(views.cameras, view, np.ascontiguousarray(places_world_m), pixel)
    return pixel
