"""Tie points transferred: measured by correlation in every oriented photograph that should show them.

A key-point detector finds the same spot again in less than half of the photographs that show it, so tie points stay
short although the block is oriented. Here a window around each tie point, from the photograph nearest to it, is warped
to every other photograph as a level piece of ground is, and searched for around the predicted place by normalised
cross-correlation, with a parabola through the peak (Förstner 1982; Kraus 2007, sec. 6.8). Places where the ground is
not level, hidden or has changed correlate badly and are left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.camera import Camera, Pose, project_points
from photogram.compilation import njit
from photogram.settings.settings import Settings, Within
from photogram.sfm.tie_points.masked import are_clear, clear_px
from photogram.survey import TRANSFERRED, TiePoints

HALF_PATCH = 16
"""Half side in pixels of the piece of a photograph that is kept for each tie point."""


@dataclass(frozen=True)
class TransferSettings(Settings):
    """How tie points are measured in further photographs."""

    correlation: Annotated[float, Within(0.1, 1), "Least normalised cross-correlation; 1 transfers nothing."] = 0.8
    half_window_px: Annotated[int, Within(2, HALF_PATCH - 4, "px"), "Half the side of the window."] = 7
    search_px: Annotated[int, Within(1, 30, "px"), "Search around the predicted place."] = 4
    least_contrast: Annotated[
        float, Within(0, 255, "grey values"), "Standard deviation of the window's grey values, at least."
    ] = 3.0


@dataclass(frozen=True, eq=False)
class Patches:
    """A window (P, S, S) around each tie point, from the photograph ``source`` (P,), −1 where there is none, with the
    place ``centre_px`` (P, 2) of the tie point in it."""

    source: IntArray
    grey: ByteArray
    centre_px: FloatArray


def _nearest_views(tie: TiePoints, position_world_m: FloatArray) -> IntArray:
    """Return the observation (P,) of each tie point from the photograph nearest to it."""
    distance = np.linalg.norm(position_world_m[tie.photograph] - tie.position_world_m[tie.point], axis=1)
    order = np.lexsort((distance, tie.point))
    return np.asarray(order[np.searchsorted(tie.point[order], np.arange(len(tie)))])


def cut_patches(
    tie: TiePoints,
    position_world_m: FloatArray,
    read_grey: Callable[[int], ByteArray],
    read_mask: Callable[[int], BoolArray | None] = lambda _: None,
) -> Patches:
    """Cut a window around each tie point out of the photograph nearest to it.

    ``position_world_m`` (N, 3) are the projection centres; ``read_grey`` gives the pixels (H, W) of a photograph, one
    after the other, and ``read_mask`` which of them are used, None for all. No window holds a pixel that is not used.
    """
    view = _nearest_views(tie, position_world_m)
    whole = np.round(tie.pixel[view]).astype(np.int64)
    source = np.full(len(tie), -1, dtype=np.int64)
    grey = np.zeros((len(tie), 2 * HALF_PATCH + 1, 2 * HALF_PATCH + 1), dtype=np.uint8)
    step = np.arange(-HALF_PATCH, HALF_PATCH + 1)
    for photograph in np.unique(tie.photograph[view]).tolist():
        picture = read_grey(photograph)
        height, width = picture.shape
        u, v = whole[:, 0], whole[:, 1]
        inside = (u >= HALF_PATCH) & (u < width - HALF_PATCH) & (v >= HALF_PATCH) & (v < height - HALF_PATCH)
        own = np.flatnonzero((tie.photograph[view] == photograph) & inside)
        used = read_mask(photograph)
        if used is not None:
            own = own[are_clear(clear_px(used), tie.pixel[view[own]], HALF_PATCH)]
        grey[own] = picture[v[own, None, None] + step[:, None], u[own, None, None] + step[None, :]]
        source[own] = photograph
    return Patches(source, grey, tie.pixel[view] - whole + HALF_PATCH)


@njit(cache=True, nogil=True)
def _template(patch: ByteArray, u0: float, v0: float, warp: FloatArray, half: int, floor: float, T: FloatArray) -> bool:
    """Sample a patch at (u0, v0) + warp · (du, dv), bilinear, to mean 0 and norm 1; False where it ends or is flat."""
    size = patch.shape[0]
    n = 2 * half + 1
    mean = 0.0
    for dv in range(-half, half + 1):
        for du in range(-half, half + 1):
            u = u0 + warp[0, 0] * du + warp[0, 1] * dv
            v = v0 + warp[1, 0] * du + warp[1, 1] * dv
            if not (u >= 0.0 and v >= 0.0 and u < size - 1 and v < size - 1):
                return False
            i, j = int(v), int(u)
            a, b = v - i, u - j
            value = (1 - a) * ((1 - b) * patch[i, j] + b * patch[i, j + 1]) + a * (
                (1 - b) * patch[i + 1, j] + b * patch[i + 1, j + 1]
            )
            T[dv + half, du + half] = value
            mean += value
    mean /= n * n
    square = 0.0
    for i in range(n):
        for j in range(n):
            T[i, j] -= mean
            square += T[i, j] * T[i, j]
    if square < floor:
        return False
    scale = 1.0 / np.sqrt(square)
    for i in range(n):
        for j in range(n):
            T[i, j] *= scale
    return True


@njit(cache=True, nogil=True)
def _correlations(
    picture: ByteArray, u: int, v: int, T: FloatArray, half: int, search: int, floor: float, score: FloatArray
) -> None:
    """Fill ``score`` with the correlations of T around pixel (u, v); −1 where the picture is flat."""
    n = 2 * half + 1
    for sv in range(-search, search + 1):
        for su in range(-search, search + 1):
            total, square, cross = 0.0, 0.0, 0.0
            for i in range(n):
                row = v + sv - half + i
                for j in range(n):
                    g = float(picture[row, u + su - half + j])
                    total += g
                    square += g * g
                    cross += g * T[i, j]
            variance = square - total * total / (n * n)
            score[sv + search, su + search] = cross / np.sqrt(variance) if variance > floor else -1.0


@njit(cache=True, nogil=True)
def _peak(before: float, here: float, after: float) -> float:
    """Place of the top of the parabola through three values, from the middle one."""
    bend = before - 2.0 * here + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0


@njit(cache=True, nogil=True)
def search_patches(
    picture: ByteArray, grey: ByteArray, centre: FloatArray, warp: FloatArray, predicted: FloatArray,
    half: int, search: int, least: float, contrast: float,
) -> FloatArray:  # fmt: skip
    """Return the pixels (K, 2) of patches (K, S, S) near those predicted (K, 2), NaN where nothing correlates."""
    pixel = np.full((len(grey), 2), np.nan)
    height, width = picture.shape
    n = 2 * half + 1
    T = np.empty((n, n))
    score = np.empty((2 * search + 1, 2 * search + 1))
    margin = half + search
    floor = contrast * contrast * n * n
    for k in range(len(grey)):
        u, v = int(np.round(predicted[k, 0])), int(np.round(predicted[k, 1]))
        if u < margin or v < margin or u >= width - margin or v >= height - margin:
            continue
        if not _template(grey[k], centre[k, 0], centre[k, 1], warp[k], half, floor, T):
            continue
        _correlations(picture, u, v, T, half, search, floor, score)
        best, at_v, at_u = -1.0, 0, 0
        for i in range(2 * search + 1):
            for j in range(2 * search + 1):
                if score[i, j] > best:
                    best, at_v, at_u = score[i, j], i, j
        if best < least or at_v in (0, 2 * search) or at_u in (0, 2 * search):
            continue
        pixel[k, 0] = u - search + at_u + _peak(score[at_v, at_u - 1], best, score[at_v, at_u + 1])
        pixel[k, 1] = v - search + at_v + _peak(score[at_v - 1, at_u], best, score[at_v + 1, at_u])
    return pixel


def ground_jacobians(camera: Camera, pose: Pose, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pixels (K, 2) of points, and their derivatives (K, 2, 2) by steps east and north on level ground."""
    step = 1e-3 * np.linalg.norm(points - pose.position_world_m, axis=1)
    pixel = project_points(camera, pose, points)
    columns = []
    for axis in (0, 1):
        moved = points.copy()
        moved[:, axis] += step
        columns.append((project_points(camera, pose, moved) - pixel) / step[:, None])
    return pixel, np.stack(columns, axis=2)


@dataclass(frozen=True, eq=False)
class TransferredPoints:
    """Tie points ``point`` (K,) measured in one more photograph, at ``pixel`` (K, 2)."""

    point: IntArray
    pixel: FloatArray


def transfer_to(
    photograph: int,
    tie: TiePoints,
    patches: Patches,
    cameras: Sequence[Camera],
    poses: Sequence[Pose | None],
    picture: ByteArray,
    settings: TransferSettings,
    used: BoolArray | None = None,
) -> TransferredPoints:
    """Find the tie points that one photograph should show and has no observation of.

    ``cameras`` and ``poses`` are those of every photograph (N), ``picture`` (H, W) its pixels, and ``used`` (H, W)
    which of them its mask leaves: none of the others lies in a window that is found. Positions of the tie points are in
    the frame of the poses.
    """
    pose, camera = poses[photograph], cameras[photograph]
    seen = np.unique(tie.point[tie.photograph == photograph])
    if pose is None or not len(seen):
        return TransferredPoints(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    near = _candidates(tie, seen, camera, pose)
    near = near[(patches.source[near] >= 0) & ~np.isin(near, seen)]
    pixel, here = ground_jacobians(camera, pose, tie.position_world_m[near])
    there = np.zeros((len(near), 2, 2))
    for source in np.unique(patches.source[near]).tolist():
        own = patches.source[near] == source
        from_pose = poses[source]
        if from_pose is not None:
            there[own] = ground_jacobians(cameras[source], from_pose, tie.position_world_m[near[own]])[1]
    usable = np.abs(np.linalg.det(here)) > 1e-9
    near, predicted = near[usable], pixel[usable]
    measured = search_patches(
        np.ascontiguousarray(picture),
        patches.grey[near],
        patches.centre_px[near],
        np.ascontiguousarray(there[usable] @ np.linalg.inv(here[usable])),
        np.ascontiguousarray(predicted),
        settings.half_window_px,
        settings.search_px,
        settings.correlation,
        settings.least_contrast,
    )
    return clear_of_masks(near, measured, used, settings.half_window_px)


def clear_of_masks(point: IntArray, pixel: FloatArray, used: BoolArray | None, reach_px: int) -> TransferredPoints:
    """Return the tie points (K,) that were measured at pixels (K, 2), not NaN, farther than ``reach_px`` from what a
    mask leaves out; ``used`` (H, W) are the pixels that it leaves, None for all."""
    good = np.isfinite(pixel[:, 0])
    if used is not None:
        good[good] = are_clear(clear_px(used), pixel[good], reach_px)
    return TransferredPoints(point[good], pixel[good])


def _candidates(tie: TiePoints, seen: IntArray, camera: Camera, pose: Pose) -> IntArray:
    """Return the tie points that lie within a photograph, as far away as those it shows, or a little farther."""
    reach = 1.2 * float(np.linalg.norm(tie.position_world_m[seen] - pose.position_world_m, axis=1).max())
    distance = np.linalg.norm(tie.position_world_m - pose.position_world_m, axis=1)
    near = np.flatnonzero(distance < reach)
    local = pose.camera_from_world(tie.position_world_m[near])
    front = local[:, 2] > 1e-3 * reach
    near, local = near[front], local[front]
    radius = np.linalg.norm(local[:, :2], axis=1) / local[:, 2]
    near = near[radius < min(camera.largest_radius, 10.0)]
    pixel = project_points(camera, pose, tie.position_world_m[near])
    return np.asarray(near[np.isfinite(pixel).all(axis=1) & camera.contains(pixel)])


def with_transferred(tie: TiePoints, transferred: Sequence[TransferredPoints], sigma_px: float) -> TiePoints:
    """Return the tie points with those ``transferred`` to each photograph (N), sorted by point, then photograph; their
    pixels have the standard deviation ``sigma_px``."""
    photograph = np.concatenate(
        [tie.photograph, *(np.full(len(t.point), i, dtype=np.int64) for i, t in enumerate(transferred))]
    )
    point = np.concatenate([tie.point, *(t.point for t in transferred)])
    pixel = np.concatenate([tie.pixel, *(t.pixel for t in transferred)])
    added = len(point) - len(tie.point)
    order = np.lexsort((photograph, point))
    return TiePoints(
        photograph[order],
        point[order],
        np.concatenate([tie.feature, np.full(added, TRANSFERRED, dtype=np.int64)])[order],
        pixel[order],
        np.concatenate([tie.sigma_px, np.full(added, sigma_px)])[order],
        tie.position_world_m,
        tie.colour,
    )
