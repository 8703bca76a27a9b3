"""Resection of photographs from control points.

P3P gives up to four poses from three points (Grunert 1841; solver: Ding et al. 2023, in OpenCV); the fourth point
chooses among them. With more than four points every triple, or a seeded sample of triples, is tried (RANSAC; Fischler
& Bolles 1981) and the pose with the most agreeing marks wins. It is then refined on all agreeing marks by least
squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, image_plane, models_of, project
from photogram.errors import OrientationError
from photogram.factors.reprojection import Observations, linearise
from photogram.survey import FloatArray

TRIPLES = 400
REFINEMENTS = 200  # where centre and points are near the dangerous cylinder, steps shrink by a fifth only
COLLINEAR = 0.02  # height of a triangle over its longest side
CONTRADICTION = 0.02  # misfit of the fourth point over the width of the photograph


@dataclass(frozen=True, eq=False)
class Resection:
    """Exterior orientation of one photograph from its control points.

    ``p3p`` is the minimal solution, ``points`` the three marks it uses, ``solutions`` how many poses they allow, and
    ``check_px`` the misfit of the mark, or of the worst agreeing mark, that chose it; NaN when the GNSS position
    chose it. ``refined`` is the least-squares pose of all ``inliers`` (M,) and ``residual_px`` (M, 2) its projected
    minus measured.
    """

    p3p: Pose
    points: tuple[int, int, int]
    solutions: int
    check_px: float
    refined: Pose
    inliers: NDArray[np.bool_]
    residual_px: FloatArray


def p3p_poses(camera: Camera, points_world_m: FloatArray, pixel: FloatArray) -> list[Pose]:
    """Return all poses (at most four) that see three world points (3, 3) at three pixels (3, 2)."""
    origin = points_world_m.mean(axis=0)
    ideal = image_plane(camera, pixel)
    _, rotations, translations = cv2.solveP3P(
        points_world_m - origin, ideal, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_P3P
    )
    poses = []
    for rotation, translation in zip(rotations, translations, strict=True):
        R = cv2.Rodrigues(rotation)[0]
        pose = Pose(np.ascontiguousarray(R.T), origin - R.T @ translation.ravel())
        if np.all(pose.camera_from_world(points_world_m)[:, 2] > 0):
            poses.append(pose)
    return poses


def refine_pose(
    camera: Camera, pose: Pose, points_world_m: FloatArray, pixel: FloatArray, sigma_px: FloatArray
) -> Pose:
    """Refine a pose on points (N, 3) seen at pixels (N, 2) with sigmas (N,): Gauss–Newton with analytic Jacobians.

    Raises OrientationError when the iteration leaves the points behind or does not settle.
    """
    zero = np.zeros(len(pixel), dtype=np.int64)
    marks = Observations(zero, np.arange(len(pixel)), pixel, sigma_px, zero, models_of([camera]))
    for _ in range(REFINEMENTS):
        R, C = pose.rotation_world_from_camera, pose.position_world_m
        linear = linearise(marks, camera.parameters[None], R[None], C[None], points_world_m)
        if np.any(pose.camera_from_world(points_world_m)[:, 2] <= 0):
            break
        step = np.linalg.lstsq(linear.pose.reshape(-1, 6), -linear.residual.ravel(), rcond=None)[0]
        pose = Pose(R @ Rotation.from_rotvec(step[:3]).as_matrix(), C + R @ step[3:])
        if np.abs(step[3:]).max() < 1e-8 and np.abs(step[:3]).max() < 1e-10:
            return pose
    raise OrientationError("the least-squares resection does not settle: the marks contradict each other")


def _triples(count: int, seed: int) -> list[tuple[int, int, int]]:
    """All triples of ``count`` points, or a seeded sample of them when there are many; the first three points come
    first."""
    triples = list(combinations(range(count), 3)) if count <= 14 else []
    if not triples:
        rng = np.random.default_rng(seed)
        sample = {tuple(sorted(rng.choice(count, 3, replace=False).tolist())) for _ in range(TRIPLES)}
        triples = sorted((a, b, c) for a, b, c in sample)
    return triples


def _flatness(points: FloatArray) -> float:
    """Height over the longest side of a triangle (3, 3); 0 when its corners are in one line."""
    a, b = points[1] - points[0], points[2] - points[0]
    longest = max(np.linalg.norm(a), np.linalg.norm(b), np.linalg.norm(a - b))
    return float(np.linalg.norm(np.cross(a, b)) / longest**2) if longest > 0 else 0.0


def collinear(points_world_m: FloatArray) -> bool:
    """Return whether points (N, 3) lie so nearly in one line that no three of them fix a pose."""
    centred = points_world_m - points_world_m.mean(axis=0)
    singular = np.linalg.svd(centred, compute_uv=False)
    return len(points_world_m) < 3 or bool(singular[1] < COLLINEAR * singular[0])


def _misfit_px(camera: Camera, pose: Pose, points_world_m: FloatArray, pixel: FloatArray) -> FloatArray:
    """Distance (N,) between projected points and their marks, infinite where a point is not seen."""
    distance = np.linalg.norm(project(camera, pose, points_world_m) - pixel, axis=1)
    return np.where(np.isfinite(distance), distance, np.inf)


def resect(
    camera: Camera,
    points_world_m: FloatArray,
    pixel: FloatArray,
    sigma_px: FloatArray,
    *,
    expected_world_m: FloatArray | None = None,
    tolerance_px: float = 10.0,
    seed: int = 0,
) -> Resection:
    """Resect one photograph from at least three control points (N, 3) and their marks (N, 2) with sigmas (N,) in px.

    Four points: P3P on the first three, chosen by the fourth, or on another three where those contradict it. More:
    the triple with the most marks within ``tolerance_px``. Three: the pose nearest to ``expected_world_m`` (3,), the
    GNSS position. Raises OrientationError when the points are too few, collinear, leave several poses, or contradict
    each other.
    """
    count = len(pixel)
    if count < 3:
        raise OrientationError(f"{count} control points are marked, resection needs 4, or 3 and a GNSS position")
    if collinear(points_world_m):
        raise OrientationError(
            "its control points lie in one line, which leaves the photograph free to turn: mark a point beside it"
        )
    if count == 3 and expected_world_m is None:
        raise OrientationError(
            "3 control points leave up to four poses: mark a fourth point, or give the GNSS position"
        )
    first = [(0, 1, 2)] if count <= 4 and _flatness(points_world_m[:3]) > COLLINEAR else _triples(count, seed)
    best = _chosen(camera, points_world_m, pixel, first, expected_world_m, tolerance_px)
    if count == 4 and (best is None or best.rank[1] > CONTRADICTION * camera.width_px):
        # three points of a small or nearly flat triangle magnify the noise of their marks
        best = _chosen(camera, points_world_m, pixel, _triples(count, seed), expected_world_m, tolerance_px)
    if best is None:
        raise OrientationError(
            "no pose sees three of its control points where they are marked: check their coordinates and marks"
        )
    return _resection(camera, points_world_m, pixel, sigma_px, best)


@dataclass(frozen=True, eq=False)
class _Choice:
    """A minimal solution; the smallest ``rank`` wins."""

    rank: tuple[float, float]
    triple: tuple[int, int, int]
    solutions: int
    pose: Pose
    agrees: NDArray[np.bool_]


def _chosen(
    camera: Camera,
    points: FloatArray,
    pixel: FloatArray,
    triples: list[tuple[int, int, int]],
    expected_world_m: FloatArray | None,
    tolerance_px: float,
) -> _Choice | None:
    """Return the pose of one of the triples that most marks agree with; None when no three points can be seen so."""
    count = len(pixel)
    best: _Choice | None = None
    for triple in triples:
        if _flatness(points[list(triple)]) < COLLINEAR:
            continue
        poses = p3p_poses(camera, points[list(triple)], pixel[list(triple)])
        for pose in poses:
            error = _misfit_px(camera, pose, points, pixel)
            agrees = error < tolerance_px if count > 4 else np.ones(count, dtype=bool)
            misfit = float(error.max()) if count == 4 else float(np.sum(np.minimum(error, tolerance_px)))
            if count == 3 and expected_world_m is not None:
                misfit = float(np.linalg.norm(pose.position_world_m - expected_world_m))
            rank = (-float(agrees.sum()), misfit)
            if best is None or rank < best.rank:
                best = _Choice(rank, triple, len(poses), pose, agrees)
    return best


def _resection(
    camera: Camera, points: FloatArray, pixel: FloatArray, sigma_px: FloatArray, choice: _Choice
) -> Resection:
    triple, p3p, inliers = choice.triple, choice.pose, choice.agrees
    if len(pixel) > 4 and inliers.sum() < 4:
        raise OrientationError(
            f"only {inliers.sum()} of its {len(pixel)} control points agree with any pose: "
            "check their coordinates and marks"
        )
    others = [i for i in np.flatnonzero(inliers) if i not in triple]
    error = _misfit_px(camera, p3p, points, pixel)
    check_px = float(error[others].max()) if others else float("nan")
    if check_px > CONTRADICTION * camera.width_px:
        misses = f"misses the fourth by {check_px:.0f} px" if np.isfinite(check_px) else "does not see the fourth"
        raise OrientationError(
            f"its four control points contradict each other: the pose of three of them {misses}; check their "
            "coordinates and marks, and that no two are swapped"
        )
    refined = refine_pose(camera, p3p, points[inliers], pixel[inliers], sigma_px[inliers]) if others else p3p
    return Resection(
        p3p, triple, choice.solutions, check_px, refined, inliers, project(camera, refined, points) - pixel
    )
