"""Resection of photographs from control points.

P3P gives up to four poses from three points (Grunert 1841; solver: Ding et al. 2023, in OpenCV); the fourth point
chooses among them. With more than four points every triple, or a seeded sample of triples, is tried (RANSAC; Fischler
& Bolles 1981); the best poses are refined by least squares on the marks that agree with them, which are chosen anew
until they stay the same (Chum et al. 2003), and the pose with the most agreeing marks wins. A mark is expected to be
off by its own sigma and by that of its surveyed point, seen from the photograph. Where few marks agree so, their
scatter is taken from the marks themselves (least median of squares, Rousseeuw 1984): stated sigmas are often too small.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, Pose, image_plane, oriented_cameras, project_points
from photogram.errors import OrientationError
from photogram.factors.elimination.reprojection import Observations, linearise
from photogram.measures.collinearity import collinear

TRIPLES = 400
REFINEMENTS = 200  # where centre and points are near the dangerous cylinder, steps shrink by a fifth only
FLAT = 0.02  # height of a triangle over its longest side, below which its corners are in one line
CONTRADICTION = 0.02  # misfit of the fourth point over the width of the photograph
AGREEING = 3.0  # sigmas, that a mark may be off
CANDIDATES = 5  # minimal solutions that are refined on the marks that agree with them
MAJORITY = 0.6  # of the marks, that must agree where they scatter more than stated
SCATTER = 0.005  # of the width of the photograph, the most that they may scatter


@dataclass(frozen=True, eq=False)
class Resection:
    """Exterior orientation of one photograph from its control points (marks M)."""

    p3p: Pose
    """Minimal solution (P3P)."""
    points: tuple[int, int, int]
    """The three marks it uses."""
    solutions: int
    """Number of poses they allow."""
    check_px: float
    """Misfit of the mark that selected the solution, NaN when the GNSS position did."""
    refined: Pose
    """Least-squares pose of all inliers."""
    inliers: BoolArray
    """Marks that agree (M,)."""
    residual_px: FloatArray
    """Residuals (M, 2), projected minus measured."""

    def __repr__(self) -> str:
        return f"<Resection from {int(self.inliers.sum())} of {len(self.inliers)} marks: {self.refined!r}>"


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
    marks = Observations(zero, np.arange(len(pixel)), pixel, sigma_px)
    for _ in range(REFINEMENTS):
        R, C = pose.rotation_world_from_camera, pose.position_world_m
        linear = linearise(marks, oriented_cameras([camera], zero[:1], R[None], C[None]), points_world_m)
        if np.any(pose.camera_from_world(points_world_m)[:, 2] <= 0):
            break
        step = np.linalg.lstsq(linear.pose.reshape(-1, 6), -linear.residual.ravel(), rcond=None)[0]
        pose = Pose(R @ Rotation.from_rotvec(step[:3]).as_matrix(), C + R @ step[3:])
        if np.abs(step[3:]).max() < 1e-8 and np.abs(step[:3]).max() < 1e-10:
            return pose
    raise OrientationError("the least-squares resection does not converge: the marks contradict each other")


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


@dataclass(frozen=True, eq=False)
class _Marks:
    """The marks (N, 2) of a photograph with their sigmas (N,) in px, and their points in the world with the sigmas of
    their survey (N, 3) in m; a mark agrees within ``tolerance_px`` or AGREEING sigmas, whichever is more."""

    camera: Camera
    points: FloatArray
    pixel: FloatArray
    sigma_px: FloatArray
    sigma_m: FloatArray
    tolerance_px: float

    def __len__(self) -> int:
        return len(self.pixel)

    def misfit_px(self, pose: Pose) -> FloatArray:
        """Distance (N,) between projected points and their marks, infinite where a point is not seen."""
        distance = np.linalg.norm(project_points(self.camera, pose, self.points) - self.pixel, axis=1)
        return np.where(np.isfinite(distance), distance, np.inf)

    def expected_px(self, pose: Pose) -> FloatArray:
        """Sigmas (N,) of the marks, those of the surveyed points across their rays included."""
        ray = self.points - pose.position_world_m
        square = np.maximum(np.einsum("ni,ni->n", ray, ray), 1e-12)
        variance = self.sigma_m**2
        across = 0.5 * (variance.sum(axis=1) - np.einsum("ni,ni->n", ray**2, variance) / square)
        return np.asarray(np.sqrt(self.sigma_px**2 + self.camera.focal_px**2 * across / square))

    def agrees(self, pose: Pose, scale: float | None = None) -> BoolArray:
        """Return which marks (N,) agree with a pose, or do where they scatter ``scale`` times as much as expected."""
        if scale is not None:
            return np.asarray(self.misfit_px(pose) < AGREEING * scale * self.expected_px(pose))
        return np.asarray(self.misfit_px(pose) < np.maximum(self.tolerance_px, AGREEING * self.expected_px(pose)))

    def refined(self, pose: Pose, chosen: BoolArray) -> Pose:
        """Return the least-squares pose of the marks ``chosen`` (N,). Raises OrientationError as refine_pose."""
        sigma_px = self.expected_px(pose)[chosen]
        return refine_pose(self.camera, pose, self.points[chosen], self.pixel[chosen], sigma_px)


def resect(
    camera: Camera,
    points_world_m: FloatArray,
    pixel: FloatArray,
    sigma_px: FloatArray,
    *,
    sigma_m: FloatArray | None = None,
    expected_world_m: FloatArray | None = None,
    tolerance_px: float = 10.0,
    seed: int = 0,
) -> Resection:
    """Resect one photograph from at least three control points (N, 3) in the world frame, m, and their marks (N, 2)
    with sigmas (N,) in px.

    ``sigma_m`` (N, 3) are the standard deviations of the points, none where it is not given. Four points: P3P on the
    first three, chosen by the fourth, or on another three where those contradict it. More: the pose with the most marks
    within ``tolerance_px``, or three sigmas of mark and point together; where these are fewer than MAJORITY, the pose
    with the least median of squares, if a majority scatters by no more than SCATTER of the photograph's width. Three:
    the pose nearest to ``expected_world_m`` (3,), the GNSS position. Raises OrientationError when the points are too
    few, collinear, leave several poses, or contradict each other.
    """
    count = len(pixel)
    if count < 3:
        raise OrientationError(f"{count} control points are marked, resection needs 4, or 3 and a GNSS position")
    if collinear(points_world_m):
        raise OrientationError(
            "its control points are collinear, so a rotation is not determined: mark a point off the line"
        )
    if count == 3 and expected_world_m is None:
        raise OrientationError(
            "3 control points allow up to four poses: mark a fourth point, or give the GNSS position"
        )
    sigma_m = np.zeros((count, 3)) if sigma_m is None else sigma_m
    marks = _Marks(camera, points_world_m, pixel, sigma_px, sigma_m, tolerance_px)
    first = [(0, 1, 2)] if count <= 4 and _flatness(points_world_m[:3]) > FLAT else _triples(count, seed)
    choices = _solutions(marks, first, expected_world_m)
    if count == 4 and (not choices or min(c.misfit for c in choices) > _contradiction_px(marks, choices[0].pose)):
        # three points of a small or nearly flat triangle magnify the noise of their marks
        choices = _solutions(marks, _triples(count, seed), expected_world_m)
    if not choices:
        raise OrientationError(
            "no pose agrees with the marks of three of its control points: check their coordinates and marks"
        )
    if count > 4:
        return _of_most(marks, choices)
    return _of_few(marks, min(choices, key=lambda choice: choice.misfit))


@dataclass(frozen=True, eq=False)
class _Choice:
    """A minimal solution: its triple of marks, how many ``solutions`` they allow, its pose, the misfit that chooses
    among those of three or four points, and the errors (N,) of all marks in px."""

    triple: tuple[int, int, int]
    solutions: int
    pose: Pose
    misfit: float
    error_px: FloatArray


def _solutions(
    marks: _Marks, triples: list[tuple[int, int, int]], expected_world_m: FloatArray | None
) -> list[_Choice]:
    """Return the poses of all triples that do not lie in one line."""
    choices = []
    for triple in triples:
        if _flatness(marks.points[list(triple)]) < FLAT:
            continue
        poses = p3p_poses(marks.camera, marks.points[list(triple)], marks.pixel[list(triple)])
        for pose in poses:
            error = marks.misfit_px(pose)
            misfit = float(error.max())
            if len(marks) == 3 and expected_world_m is not None:
                misfit = float(np.linalg.norm(pose.position_world_m - expected_world_m))
            choices.append(_Choice(triple, len(poses), pose, misfit, error))
    return choices


def _contradiction_px(marks: _Marks, pose: Pose) -> float:
    """Return the largest misfit of a fourth point that three others do not contradict."""
    return CONTRADICTION * marks.camera.width_px + AGREEING * float(marks.expected_px(pose).max())


def _of_few(marks: _Marks, choice: _Choice) -> Resection:
    """Return the resection from three or four marks."""
    others = [i for i in range(len(marks)) if i not in choice.triple]
    check_px = float(choice.error_px[others].max()) if others else float("nan")
    if check_px > _contradiction_px(marks, choice.pose):
        misses = f"misses the fourth by {check_px:.0f} px" if np.isfinite(check_px) else "does not see the fourth"
        raise OrientationError(
            f"its four control points contradict each other: the pose of three of them {misses}; check their "
            "coordinates and marks, and that no points are swapped"
        )
    inliers = np.ones(len(marks), dtype=bool)
    return _resection(marks, choice, marks.refined(choice.pose, inliers) if others else choice.pose, inliers)


def _of_most(marks: _Marks, choices: list[_Choice]) -> Resection:
    """Return the resection that most marks agree with, of five or more.

    Raises OrientationError where fewer than four agree with any pose.
    """
    agreeing = _settled(marks, choices)
    if agreeing is None or agreeing[2].sum() < MAJORITY * len(marks):
        scattered = _scattered(marks, choices)
        agreeing = agreeing if scattered is None else scattered
    if agreeing is None:
        most = max(int(marks.agrees(choice.pose).sum()) for choice in choices)
        raise OrientationError(
            f"only {most} of its {len(marks)} control points agree with any pose: check their coordinates and marks"
        )
    return _resection(marks, *agreeing)


_Agreeing = tuple[_Choice, Pose, BoolArray]


def _settled(marks: _Marks, choices: list[_Choice]) -> _Agreeing | None:
    """Return the minimal solution, refined on the marks that agree with it, that most agree with; None where four never
    do."""

    def rank(pose: Pose, error_px: FloatArray, agrees: BoolArray) -> tuple[int, float]:
        limit = np.maximum(marks.tolerance_px, AGREEING * marks.expected_px(pose))
        return -int(agrees.sum()), float(np.sum(np.minimum(error_px / limit, 1.0) ** 2))

    ranked = sorted(
        ((rank(c.pose, c.error_px, marks.agrees(c.pose)), i) for i, c in enumerate(choices)), key=lambda pair: pair
    )
    best: tuple[tuple[int, float], _Agreeing] | None = None
    for _, i in ranked[:CANDIDATES]:
        settled = _refined_on(marks, choices[i].pose, marks.agrees(choices[i].pose), marks.agrees)
        if settled is not None:
            of_all = rank(settled[0], marks.misfit_px(settled[0]), settled[1])
            if best is None or of_all < best[0]:
                best = of_all, (choices[i], *settled)
    return None if best is None else best[1]


def _refined_on(
    marks: _Marks, pose: Pose, chosen: BoolArray, choose: Callable[[Pose], BoolArray]
) -> tuple[Pose, BoolArray] | None:
    """Refine a pose on the marks ``chosen`` (N,), choose them anew, and so on until they stay the same; None where
    fewer than four are left, or they contradict each other."""
    for _ in range(10):
        if chosen.sum() < 4:
            return None
        try:
            pose = marks.refined(pose, chosen)
        except OrientationError:
            return None
        again = choose(pose)
        if np.array_equal(again, chosen):
            break
        chosen = again
    return pose, chosen


def _scattered(marks: _Marks, choices: list[_Choice]) -> _Agreeing | None:
    """Return the pose with the least median of squares, refined on the marks within AGREEING times the scatter of that
    majority; None where the scatter is beyond what marks may have."""
    least = max(5, int(np.ceil(MAJORITY * len(marks))))

    def nearest(pose: Pose) -> BoolArray:
        order = np.argsort(marks.misfit_px(pose) / marks.expected_px(pose), kind="stable")
        return np.isin(np.arange(len(marks)), order[:least])

    def largest(choice: _Choice) -> float:
        return float(np.sort(choice.error_px / marks.expected_px(choice.pose))[least - 1])

    best: tuple[float, _Agreeing] | None = None
    for choice in sorted(choices, key=largest)[:CANDIDATES]:
        core = _refined_on(marks, choice.pose, nearest(choice.pose), nearest)
        if core is None:
            continue
        pose, chosen = core
        share = marks.misfit_px(pose)[chosen] / marks.expected_px(pose)[chosen]
        scale = float(np.sqrt(np.sum(share**2) / (2 * least - 6)))
        if not scale * np.median(marks.expected_px(pose)) < SCATTER * marks.camera.width_px:
            continue
        within = partial(marks.agrees, scale=scale)
        settled = _refined_on(marks, pose, within(pose) | chosen, within)
        if settled is not None and settled[1].sum() >= least and (best is None or scale < best[0]):
            best = scale, (choice, *settled)
    return None if best is None else best[1]


def _resection(marks: _Marks, choice: _Choice, refined: Pose, inliers: BoolArray) -> Resection:
    others = [i for i in np.flatnonzero(inliers) if i not in choice.triple]
    check_px = float(choice.error_px[others].max()) if others else float("nan")
    residual_px = project_points(marks.camera, refined, marks.points) - marks.pixel
    return Resection(choice.pose, choice.triple, choice.solutions, check_px, refined, inliers, residual_px)
