"""Pairs of photographs, rectified over a piece of ground: what one shows of it, the other shows in the same row.

Both pictures are resampled as a camera without distortion would have taken them that is turned so that the base runs
along its rows and its axis to the ground (Fusiello, Trucco & Verri 2000). Where a pixel of it lies in a photograph is
projected through the full camera model at every NODE_PX-th pixel, and linear between.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from photogram.arrays import Float32Array, FloatArray, IntArray
from photogram.surface.dense.resolution import choose_views
from photogram.surface.views import Views, places_in_view

Picture = Callable[[int, int], NDArray[np.generic]]
"""Gives the grey values (height, width) of a view, by its number, reduced by a factor: pixel (u, v) lies at (u, v) /
factor of it."""

NODE_PX = 16
"""Distance of the pixels that are projected exactly."""

PARALLAX_DEG, FULL_PARALLAX_DEG = (5.0, 28.0), (20.0, 26.0)
"""Angles between the rays of a pair: those allowed, and those that count fully. Smaller ones tell heights badly, and
with larger ones the photographs show steep ground too differently."""

FARTHER = 1.4
"""How many times farther one photograph of a pair may be than the other."""

LOOKED_AT = 12
"""Photographs of a place from which its pairs are chosen: those that see it from straightest above."""

UPRIGHT_TAN = 0.12
"""A pair whose middle stands over a place to this tangent looks from above, and not from a side."""

REPEATED = 0.95
"""What a further pair from the same side of a place is worth, of one from another side."""

LEAST_GAIN = 0.02
"""A pair must show so much that the chosen ones do not, of what a pair shows that sees all places."""

MARGIN_PX = 12
"""Pixels around what a pair shows of the ground."""

MOST_DISPARITIES = 512
"""A pair with more is not matched: its parallax is too large for ground that rises so much."""


def choose_pairs(views: Views, places_world_m: FloatArray, most: int) -> list[tuple[int, int]]:
    """Return up to ``most`` pairs of views that together show places (P, 3) best: from all sides, for a steep face is
    seen from its own alone, with good parallax."""
    chosen, _ = choose_views(views, places_world_m, LOOKED_AT)
    used = np.unique(chosen[chosen >= 0])
    sees = np.array([(chosen == v).any(axis=1) for v in used]).reshape(len(used), len(places_world_m))
    ray = views.position_world_m[used, None] - places_world_m
    distance = np.linalg.norm(ray, axis=2)
    ray = ray / distance[..., None]
    pairs = [(i, j) for i in range(len(used)) for j in range(i + 1, len(used)) if (sees[i] & sees[j]).any()]
    if not pairs:
        return []
    first, second = np.array(pairs).T
    gain = _gains(ray[first], ray[second]) * (sees[first] & sees[second])
    farther = distance[first] / distance[second]
    gain[(farther > FARTHER) | (farther < 1.0 / FARTHER)] = 0.0
    side = _sides(ray[first] + ray[second])
    worth, found = np.ones((len(places_world_m), 5)), []
    index = np.arange(len(places_world_m))
    for _ in range(most):
        total = (gain * worth[index, side]).sum(axis=1)
        best = int(np.argmax(total))
        if total[best] < LEAST_GAIN * len(places_world_m):
            break
        found.append((int(used[first[best]]), int(used[second[best]])))
        worth[index, side[best]] *= np.where(gain[best] > 0.0, REPEATED, 1.0)
        gain[best] = 0.0
    return found


def _gains(ray: FloatArray, other: FloatArray) -> FloatArray:
    """Return what the parallax (N, P) of two rays (N, P, 3) of unit length is worth, 0 to 1."""
    parallax = np.degrees(np.arccos(np.clip(np.sum(ray * other, axis=2), -1.0, 1.0)))
    (least, most), (low, high) = PARALLAX_DEG, FULL_PARALLAX_DEG
    rising, falling = (parallax - least) / (low - least), (most - parallax) / (most - high)
    return np.asarray(np.clip(np.minimum(rising, falling), 0.0, 1.0))


def _sides(ray: FloatArray) -> IntArray:
    """Return from which side (N, P) rays (N, P, 3) look: 0 to 3, or 4 from above."""
    east, north = ray[..., 0], ray[..., 1]
    quadrant = np.floor(np.arctan2(north, east) / (np.pi / 2)).astype(np.int64) % 4
    return np.where(np.hypot(east, north) < UPRIGHT_TAN * ray[..., 2], 4, quadrant)


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """Two views as a camera of focal length ``focal_px`` turned by ``rotation_world_from_rectified`` (3, 3) would have
    taken them from both places, ``position_world_m`` (2, 3).

    Pixel (u, v) of the left picture, (width, height) ``size_px``, lies at (u, v) + ``corner_px`` from the principal
    point; the right picture is moved by ``first_disparity``, so that disparities run from 0 to ``disparities``. What
    is shown is about ``depth_m`` away.
    """

    views: tuple[int, int]
    rotation_world_from_rectified: FloatArray
    position_world_m: FloatArray
    focal_px: float
    corner_px: tuple[int, int]
    size_px: tuple[int, int]
    first_disparity: int
    disparities: int
    depth_m: float

    @property
    def base_m(self) -> float:
        """Return the distance of the places."""
        return float(np.linalg.norm(self.position_world_m[1] - self.position_world_m[0]))


def rectify(
    views: Views, pair: tuple[int, int], places_world_m: FloatArray, reduction: int, margin_px: int | None = None
) -> RectifiedPair | None:
    """Return a pair rectified over places (N, 3), in pixels of pictures reduced by a factor; None where one lies in the
    direction of the other, or beside the places, or where there are too many disparities. To the west the pictures
    reach so much further that all disparities have a partner; or by ``margin_px``, where few are tried."""
    position = views.position_world_m[list(pair)]
    base = position[1] - position[0]
    x = base / np.linalg.norm(base)
    middle = places_world_m.mean(axis=0)
    axis = 2.0 * middle - position[0] - position[1]
    y = np.cross(axis, x)
    if np.linalg.norm(y) < 0.3 * np.linalg.norm(axis):
        return None
    y /= np.linalg.norm(y)
    rotation = np.column_stack([x, y, np.cross(x, y)])
    seen = [(places_world_m - p) @ rotation for p in position]
    depth = seen[0][:, 2]
    if depth.min() <= 0.1 * np.linalg.norm(axis):
        return None
    focal = float(np.mean([_scale(views, v, middle, rotation) for v in pair])) / reduction
    if not np.isfinite(focal):
        return None
    disparity = focal * np.linalg.norm(base) / depth
    first = int(np.floor(disparity.min())) - 4
    count = int(np.ceil((disparity.max() + 4 - first) / 16)) * 16
    left = focal * seen[0][:, :2] / depth[:, None]
    low, high = np.floor(left.min(axis=0)) - MARGIN_PX, np.ceil(left.max(axis=0)) + MARGIN_PX
    if margin_px is None and count > MOST_DISPARITIES:
        return None
    low[0] -= count if margin_px is None else margin_px
    size = high - low + 1
    return RectifiedPair(
        pair, rotation, position, focal, (int(low[0]), int(low[1])), (int(size[0]), int(size[1])), first, count,
        float(np.median(depth)),
    )  # fmt: skip


def _scale(views: Views, view: int, place_world_m: FloatArray, rotation: FloatArray) -> float:
    """Return how many pixels a view shows for an angle of one radian at a place."""
    distance = float(np.linalg.norm(place_world_m - views.position_world_m[view]))
    step = 1e-3 * distance
    pixel = places_in_view(views, view, place_world_m + step * np.array([np.zeros(3), rotation[:, 0], rotation[:, 1]]))
    return float(np.linalg.norm(pixel[1:] - pixel[0], axis=1).mean() * distance / step)


def rectified(views: Views, pair: RectifiedPair, side: int, picture: Picture, reduction: int) -> Float32Array:
    """Return the left (0) or right (1) picture of a pair, NaN where the photograph shows nothing."""
    width, height = pair.size_px
    columns, rows = np.arange(0, width + NODE_PX, NODE_PX), np.arange(0, height + NODE_PX, NODE_PX)
    u, v = np.meshgrid(columns + pair.corner_px[0] - side * pair.first_disparity, rows + pair.corner_px[1])
    ray = np.stack([u / pair.focal_px, v / pair.focal_px, np.ones(u.shape)], axis=-1).reshape(-1, 3)
    place = pair.position_world_m[side] + pair.depth_m * (ray @ pair.rotation_world_from_rectified.T)
    view = pair.views[side]
    node = (places_in_view(views, view, place) / reduction).reshape(*u.shape, 2)
    grey = picture(view, reduction)
    known = node[np.isfinite(node).all(axis=-1)]
    none = np.full((height, width), np.nan, np.float32)
    if not len(known):
        return none
    low = np.clip(np.floor(known.min(axis=0)).astype(int) - 3, 0, [grey.shape[1], grey.shape[0]])
    high = np.clip(np.ceil(known.max(axis=0)).astype(int) + 4, 0, [grey.shape[1], grey.shape[0]])
    if (high - low).min() < 4:
        return none
    crop = np.asarray(grey[low[1] : high[1], low[0] : high[0]], dtype=np.float32)
    at = [_between(np.asarray(node[..., k] - low[k], dtype=np.float32), height, width) for k in (0, 1)]
    return np.asarray(
        cv2.remap(crop, at[0], at[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
    )


def _between(node: Float32Array, height: int, width: int) -> Float32Array:
    """Return values (height, width) linear between those at every NODE_PX-th pixel."""
    rows, columns = (np.arange(n, dtype=np.float32) / NODE_PX for n in (height, width))
    u, v = np.meshgrid(columns, rows)
    return np.asarray(cv2.remap(node, u, v, cv2.INTER_LINEAR))
