"""Intersection of rays: linear from two, three or n views, robust against mismatches, with ray angles and depths.

Linear intersection (DLT; Hartley & Zisserman 2004, sec. 12.2): each ray with ideal image-plane coordinates (x, y) and
P = [Rᵀ | −Rᵀ C] gives the rows x p₃ − p₁ and y p₃ − p₂; the point is the right singular vector of the smallest
singular value.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, Pose, image_plane, image_plane_or_nan
from photogram.compilation import njit
from photogram.machine import cores
from photogram.projection import OrientedCameras, centre_at_row, project_at_row, without_fields
from photogram.survey import Block, TiePoints

MANY_PAIRS = 66  # all pairs of twelve rays
POINTS_AT_ONCE = 5000  # that one thread intersects


def projection_matrices(poses: Sequence[Pose]) -> FloatArray:
    """Return the matrices (V, 3, 4) that take homogeneous world points to the camera frames of ``poses``."""
    R = np.array([pose.rotation_world_from_camera.T for pose in poses])
    C = np.array([pose.position_world_m for pose in poses])
    return np.concatenate([R, -(R @ C[:, :, None])], axis=2)


def intersect_linear(projection: FloatArray, ideal: FloatArray) -> FloatArray:
    """Intersect rays linearly: ``projection`` (P, V, 3, 4), ideal image-plane coordinates (P, V, 2) -> points (P, 3)
    in the world, m."""
    count, views = ideal.shape[:2]
    rows = ideal[..., :, None] * projection[:, :, 2, None, :] - projection[:, :, :2, :]
    _, _, Vt = np.linalg.svd(rows.reshape(count, 2 * views, 4), full_matrices=False)
    solution = Vt[:, -1, :]
    return np.asarray(solution[:, :3] / solution[:, 3:])


def ideal_pixels(cameras: Sequence[Camera], camera: IntArray, pixel: FloatArray, *, draft: bool = False) -> FloatArray:
    """Return the ideal image-plane coordinates (N, 2) of pixels (N, 2), each of the ``camera`` (N,) it is named for.

    Where the distortion of a ``draft`` of the cameras cannot be undone they are those of a pinhole: reprojection will
    judge. Raises ImageError where that of other cameras cannot.
    """
    ideal = np.empty_like(pixel)
    for index in np.flatnonzero(np.bincount(camera, minlength=len(cameras))).tolist():
        mask = camera == index
        ideal[mask] = (image_plane_or_nan if draft else image_plane)(cameras[index], pixel[mask])
        lost = mask & np.isnan(ideal).any(axis=1)
        ideal[lost] = (pixel[lost] - cameras[index].principal_point_px) / cameras[index].focal_px
    return ideal


def ideal_observations(
    cameras: Sequence[Camera], camera_of: IntArray, tie_points: TiePoints, *, draft: bool = False
) -> FloatArray:
    """Return the ideal image-plane coordinates (N, 2) of all observations as ``ideal_pixels`` does; ``camera_of``
    (photographs,) names their cameras."""
    return ideal_pixels(cameras, camera_of[tie_points.photograph], tie_points.pixel, draft=draft)


def intersect_tie_points(
    tie_points: TiePoints, ideal: FloatArray, poses: Sequence[Pose | None], rays: int | None = None
) -> FloatArray:
    """Intersect tie points linearly from their oriented photographs: (P, 3) in the world, NaN with fewer than two rays.

    With ``rays`` given, only points with at least that many rays are intersected, each from its first ``rays``
    photographs.
    """
    oriented = np.array([pose is not None for pose in poses], dtype=bool)
    matrices = np.full((len(poses), 3, 4), np.nan)
    if oriented.any():
        matrices[oriented] = projection_matrices([pose for pose in poses if pose is not None])
    usable = np.flatnonzero(oriented[tie_points.photograph])
    point = tie_points.point[usable]
    count = np.bincount(point, minlength=len(tie_points))
    start = np.searchsorted(point, np.arange(len(tie_points)))
    result = np.full((len(tie_points), 3), np.nan)
    for views in np.unique(count[count >= 2]):
        used = int(views) if rays is None else rays
        if views < used:
            continue
        members = np.flatnonzero(count == views)
        observation = usable[start[members][:, None] + np.arange(used)]
        result[members] = intersect_linear(matrices[tie_points.photograph[observation]], ideal[observation])
    return result


def intersect(block: Block, rays: int | None = None) -> FloatArray:
    """Intersect the tie points of a block linearly from its oriented photographs, without covariances.

    Returns positions (P, 3) in the world frame, m, in the order of ``block.tie_points``, NaN with fewer than two rays;
    with ``rays`` given, only of points with at least that many, each from its first ``rays`` photographs. Raises
    ImageError where the distortion of a camera cannot be undone.
    """
    ideal = ideal_observations(block.cameras, block.camera_of, block.tie_points)
    return intersect_tie_points(block.tie_points, ideal, block.poses, rays)


@njit(cache=True, nogil=True, error_model="numpy")
def _largest_ray_angles(
    first: IntArray, photograph: IntArray, used: BoolArray, centre: FloatArray, point: FloatArray
) -> FloatArray:
    angle, most = np.zeros(len(point)), 0
    for p in range(len(point)):
        most = max(most, first[p + 1] - first[p])
    ray = np.empty((most, 3))
    for p in range(len(point)):
        count, smallest = 0, 1.0
        for i in range(first[p], first[p + 1]):
            if not used[i]:
                continue
            k = photograph[i]
            x, y, z = point[p, 0] - centre[k, 0], point[p, 1] - centre[k, 1], point[p, 2] - centre[k, 2]
            length = np.sqrt(x * x + y * y + z * z)
            x, y, z = x / length, y / length, z / length
            for j in range(count):
                smallest = min(smallest, x * ray[j, 0] + y * ray[j, 1] + z * ray[j, 2])
            ray[count, 0], ray[count, 1], ray[count, 2] = x, y, z
            count += 1
        angle[p] = np.arccos(max(-1.0, smallest))
    return angle


def ray_angles(
    tie_points: TiePoints, used: BoolArray, centre_world_m: FloatArray, position_world_m: FloatArray
) -> FloatArray:
    """Return the largest angle (P,) in rad between any two used rays of each point; 0 with fewer than two rays."""
    return _largest_ray_angles(
        tie_points.first_observation,
        tie_points.photograph,
        used,
        np.ascontiguousarray(centre_world_m),
        np.ascontiguousarray(position_world_m),
    )


@njit(cache=True, nogil=True)
def _intersect_two(
    Ra: FloatArray, Ca: FloatArray, a: FloatArray, Rb: FloatArray, Cb: FloatArray, b: FloatArray, X: FloatArray
) -> bool:
    """Midpoint of two rays with ideal coordinates a and b into X; False when they are parallel."""
    da = np.empty(3)
    db = np.empty(3)
    for k in range(3):
        da[k] = Ra[k, 0] * a[0] + Ra[k, 1] * a[1] + Ra[k, 2]
        db[k] = Rb[k, 0] * b[0] + Rb[k, 1] * b[1] + Rb[k, 2]
    base = Cb - Ca
    aa, ab, bb = np.dot(da, da), np.dot(da, db), np.dot(db, db)
    determinant = aa * bb - ab * ab
    if determinant < 1e-12 * aa * bb:
        return False
    ta = (bb * np.dot(da, base) - ab * np.dot(db, base)) / determinant
    tb = (ab * np.dot(da, base) - aa * np.dot(db, base)) / determinant
    for k in range(3):
        X[k] = 0.5 * (Ca[k] + ta * da[k] + Cb[k] + tb * db[k])
    return bool(ta > 0.0 and tb > 0.0)


@njit(cache=True, nogil=True)
def _consensus(
    begin: int,
    end: int,
    photograph: IntArray,
    pixel: FloatArray,
    bare: FloatArray,
    ideal: FloatArray,
    limit: FloatArray,
    cameras: OrientedCameras,
    best_point: FloatArray,
    best_inlier: BoolArray,
) -> int:
    """The best two-ray intersection of one point by number of supporting rays, then by their residuals."""
    X, R, Cp, Cs = np.empty(3), cameras.rotation, np.empty(3), np.empty(3)
    inlier = np.zeros(end - begin, dtype=np.bool_)
    best, best_cost, pair = 0, np.inf, -1
    stride = 1 + (end - begin) * (end - begin - 1) // 2 // MANY_PAIRS
    for i in range(begin, end):
        for j in range(i + 1, end):
            pair += 1
            if pair % stride:
                continue
            p, s = photograph[i], photograph[j]
            Cp[0], Cp[1], Cp[2] = centre_at_row(cameras, p, pixel[i, 1])
            Cs[0], Cs[1], Cs[2] = centre_at_row(cameras, s, pixel[j, 1])
            if not _intersect_two(R[p], Cp, ideal[i], R[s], Cs, ideal[j], X):
                continue
            support, cost = 0, 0.0
            for k in range(begin, end):
                u, v, depth = project_at_row(cameras, photograph[k], X, pixel[k, 1])
                error = ((u - bare[k, 0]) ** 2 + (v - bare[k, 1]) ** 2) / limit[k] ** 2 if depth > 0.0 else np.inf
                inlier[k - begin] = error < 1.0
                if error < 1.0:
                    support += 1
                    cost += error
            if support > best or (support == best and cost < best_cost):
                best, best_cost = support, cost
                best_point[:] = X
                best_inlier[begin:end] = inlier
    return best


@njit(cache=True, nogil=True)
def _consensus_of_all(
    begin: int,
    end: int,
    first: IntArray,
    photograph: IntArray,
    pixel: FloatArray,
    bare: FloatArray,
    ideal: FloatArray,
    limit_px: FloatArray,
    cameras: OrientedCameras,
    points: FloatArray,
    inlier: BoolArray,
) -> None:
    for p in range(begin, end):
        support = _consensus(
            first[p],
            first[p + 1],
            photograph,
            pixel,
            bare,
            ideal,
            limit_px,
            cameras,
            points[p],
            inlier,
        )
        if support < 2:
            points[p] = np.nan
            inlier[first[p] : first[p + 1]] = False


def consensus_intersections(
    first: IntArray,
    photograph: IntArray,
    pixel: FloatArray,
    ideal: FloatArray,
    limit_px: FloatArray,
    cameras: OrientedCameras,
) -> tuple[FloatArray, BoolArray]:
    """Intersect every tie point from the largest set of rays that agree within ``limit_px`` (N,).

    ``first`` (P + 1,) first observation of each point, ``photograph`` (N,), ``pixel`` and ``ideal`` (N, 2). Returns
    points (P, 3), NaN where no two rays agree, and the agreeing observations (N,). Pairs of rays are tried in turn, all
    of them up to MANY_PAIRS, evenly spread ones of a longer track (RANSAC without the randomness; Fischler & Bolles
    1981).
    """
    bare = without_fields(cameras, photograph, pixel)
    count = len(first) - 1
    points, inlier = np.full((count, 3), np.nan), np.zeros(len(photograph), dtype=np.bool_)

    def work(part: tuple[int, int]) -> None:
        _consensus_of_all(*part, first, photograph, pixel, bare, ideal, limit_px, cameras, points, inlier)

    parts = [(begin, min(begin + POINTS_AT_ONCE, count)) for begin in range(0, count, POINTS_AT_ONCE)]
    if len(parts) < 2 or cores() == 1:
        for part in parts:
            work(part)
    else:
        with ThreadPoolExecutor(cores()) as pool:
            list(pool.map(work, parts))
    return points, inlier
