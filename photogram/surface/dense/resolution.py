"""What photographs resolve of level ground, and which of them see a place well enough to be matched there."""

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.projection import OrientedCameras, seen_called
from photogram.surface.views import Views

STEEP_TANGENT = 1.2
"""What photographs see by no more than 50° off the vertical is mapped, however high they were flown."""

COARSEST_GSD = 1.5
"""What they see flatter is mapped where they resolve it by so many ground sampling distances of the site or better."""

_STEP = 1e-3  # of the height over a place: the step over which pixels on the ground are counted


@njit(cache=True, nogil=True)
def _is_inside(cameras: OrientedCameras, view: int, x: float, y: float) -> bool:
    c = cameras.camera[view]
    width, height = cameras.size_px[c, 0], cameras.size_px[c, 1]
    return bool(0.0 <= x <= width - 1.0 and 0.0 <= y <= height - 1.0)


@njit(cache=True, nogil=True)
def _pixel_m(cameras: OrientedCameras, view: int, X: FloatArray, x: float, y: float, beside: FloatArray) -> float:
    """Return the side of the square of level ground that a pixel shows at X (3,), in m, infinite where that is not
    known; the place falls on ``x`` and ``y``, ``beside`` (3,) is room for places beside it."""
    step = _STEP * (cameras.position[view, 2] - X[2])
    beside[:] = X
    beside[0] += step
    east_x, east_y, _ = seen_called(cameras, view, beside[0], beside[1], beside[2])
    beside[0], beside[1] = X[0], X[1] + step
    north_x, north_y, _ = seen_called(cameras, view, beside[0], beside[1], beside[2])
    pixels = abs((east_x - x) * (north_y - y) - (east_y - y) * (north_x - x))
    return step / np.sqrt(pixels) if pixels > 0.0 else np.inf


@njit(cache=True, nogil=True)
def _fill_nearest(
    cameras: OrientedCameras, coarsest_m: float, place: FloatArray, out: IntArray, tangent: FloatArray
) -> None:
    most, C, beside = out.shape[1], cameras.position, np.empty(3)
    for n in range(len(place)):
        X = place[n]
        out[n], tangent[n] = -1, np.inf
        for v in range(len(cameras.camera)):
            dx, dy, dz = C[v, 0] - X[0], C[v, 1] - X[1], C[v, 2] - X[2]
            lean = np.hypot(dx, dy) / dz if dz > 0.0 else np.inf
            if not lean < tangent[n, most - 1]:
                continue
            x, y, _ = seen_called(cameras, v, X[0], X[1], X[2])
            if not _is_inside(cameras, v, x, y):
                continue
            if lean > STEEP_TANGENT and coarsest_m < np.inf and _pixel_m(cameras, v, X, x, y, beside) > coarsest_m:
                continue
            k = most - 1
            while k > 0 and tangent[n, k - 1] > lean:
                out[n, k], tangent[n, k] = out[n, k - 1], tangent[n, k - 1]
                k -= 1
            out[n, k], tangent[n, k] = v, lean


@njit(cache=True, nogil=True)
def _fill_resolved(cameras: OrientedCameras, place: FloatArray, finest: FloatArray) -> None:
    beside = np.empty(3)
    for n in range(len(place)):
        X = place[n]
        finest[n] = np.inf
        for v in range(len(cameras.camera)):
            if not cameras.position[v, 2] > X[2]:
                continue
            x, y, _ = seen_called(cameras, v, X[0], X[1], X[2])
            if not _is_inside(cameras, v, x, y):
                continue
            pixel_m, k = _pixel_m(cameras, v, X, x, y, beside), finest.shape[1] - 1
            while k >= 0 and finest[n, k] > pixel_m:
                if k + 1 < finest.shape[1]:
                    finest[n, k + 1] = finest[n, k]
                finest[n, k] = pixel_m
                k -= 1


def choose_views(views: Views, places_world_m: FloatArray, most: int) -> tuple[IntArray, FloatArray]:
    """Return the views (P, most) that see places (P, 3) from straightest above, −1 where there are no more, and the
    tangents (P, most) of their angles off the vertical. What sees a place flatter than STEEP_TANGENT and resolves
    level ground there worse than ``views.coarsest_m`` does not count."""
    chosen = np.empty((len(places_world_m), most), np.int64)
    tangent = np.empty((len(places_world_m), most))
    _fill_nearest(views.cameras, views.coarsest_m, np.ascontiguousarray(places_world_m), chosen, tangent)
    return chosen, tangent


def resolved_m(views: Views, places_world_m: FloatArray, most: int) -> FloatArray:
    """Return what the up to ``most`` views that resolve level ground best at places (P, 3) resolve of it: the side (P,
    most) of the square that a pixel shows, in m, in ascending order, infinite where no more see it.

    Along an optical axis that is distance over focal length and over the root of the cosine of incidence; straight
    down it is flying height over focal length all over the photograph.
    """
    finest = np.empty((len(places_world_m), most))
    _fill_resolved(views.cameras, np.ascontiguousarray(places_world_m), finest)
    return finest
