"""By how much the heights of ground points and of GNSS contradict each other, from marks alone, before any matching.

The angle between the rays to two ground points, or between a ray and the vertical, depends on how high the camera is
above them. If all ground points are raised by s, their directions from the GNSS positions change, and one s makes them
agree best with the rays of their marks. For every s the best rotation of each photograph is found in closed form
(Wahba's problem: Markley 1988), with the gimbal's attitude as a weak observation, so only s is searched for, over its
whole range: no starting value can lead astray. Wrong marks and single wrong heights are damped (Cauchy's loss).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, unproject
from photogram.survey import ControlPoints

FARTHEST_M = 150.0
"""Geoid heights reach from -107 m to 86 m, and GNSS heights are metres off by themselves."""

RAY_SIGMA_RAD = 0.003
"""Of a ray beside its mark's own: distortion and principal point that are not calibrated yet."""

TILT_SIGMA_RAD, HEADING_SIGMA_RAD = np.deg2rad(3.0), np.deg2rad(15.0)
"""Of a gimbal at least: levels err by a degree or two, compasses by ten."""

MODEL_SHARE = 0.02
"""Of the flying height: what the focal length may be off by where its sigma says less."""

_LARGEST_FOCAL_SHARE = 0.1
_COARSE_M, _FINE_M = 2.0, 0.05
_LOSS = 2.0
_MOST_PHOTOGRAPHS = 400
_FEWEST_MARKS, _FEWEST_POINTS = 4, 2


@dataclass(frozen=True, eq=False)
class HeightEvidence:
    """What there is to compare: photographs with GNSS positions and the marks of ground points in them.

    ``gnss_world_m``, ``gnss_sigma_m`` (F, 3), ``rotation_world_from_camera`` (F, 3, 3) and its ``attitude_sigma_rad``
    (F,), NaN where there is none; ``camera_of`` (F,) indices of ``cameras``; ``points`` with positions in the world.
    """

    cameras: Sequence[Camera]
    camera_of: IntArray
    gnss_world_m: FloatArray
    gnss_sigma_m: FloatArray
    rotation_world_from_camera: FloatArray
    attitude_sigma_rad: FloatArray
    points: ControlPoints


@dataclass(frozen=True)
class HeightShift:
    """How much higher ground points would have to lie for their marks to agree with the GNSS heights.

    ``shift_m`` with ``sigma_m``, in which the camera's focal length and the scatter of the marks are counted, but no
    common error of the GNSS heights; ``flying_height_m`` above them; from so many ``marks`` of so many ``points``.
    ``cost`` is the robust cost that the shift leaves.
    """

    shift_m: float
    sigma_m: float
    flying_height_m: float
    marks: int
    points: int
    cost: float


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays (M, 3) in the camera frame to points (M, 3) from centres (M, 3), of photographs 0 … F−1 in order.

    A direction is off by ``angle_rad`` (M,), and by ``place_m`` (M,) over its length. ``prior`` (F, 3, 3) is the sum of
    w · (world) (camera)ᵀ over directions that the gimbal knows in both frames, ``prior_weight`` (F,) that of w.
    ``ground`` (M,) are the points' indices, ``mark`` (M,) those of the marks.
    """

    photograph: IntArray
    ray: FloatArray
    centre: FloatArray
    point: FloatArray
    angle_rad: FloatArray
    place_m: FloatArray
    prior: FloatArray
    prior_weight: FloatArray
    ground: IntArray
    mark: IntArray


def rays_of(evidence: HeightEvidence) -> Rays | None:
    """Return the rays of all marks that say something of heights, None where there are too few of them. Raises
    ImageError as unproject does."""
    points = evidence.points
    known = np.asarray(np.isfinite(np.hstack([evidence.gnss_world_m, evidence.gnss_sigma_m])).all(axis=1))
    levelled = np.asarray(np.isfinite(evidence.rotation_world_from_camera).all(axis=(1, 2)))
    count = np.bincount(points.mark_photograph, minlength=len(known))
    # without an attitude a single ray says nothing
    used = np.flatnonzero(known & (count >= np.where(levelled, 1, 2)))
    if used.size > _MOST_PHOTOGRAPHS:
        used = used[np.linspace(0, used.size - 1, _MOST_PHOTOGRAPHS).astype(np.int64)]
    marks = np.flatnonzero(np.isin(points.mark_photograph, used))
    marks = marks[np.argsort(points.mark_photograph[marks], kind="stable")]
    if len(marks) < _FEWEST_MARKS or len(np.unique(points.mark_point[marks])) < _FEWEST_POINTS:
        return None
    photograph, ground = points.mark_photograph[marks], points.mark_point[marks]
    ray, focal_px = np.empty((len(marks), 3)), np.empty(len(marks))
    for c, camera in enumerate(evidence.cameras):
        own = evidence.camera_of[photograph] == c
        ray[own] = unproject(camera, points.mark_pixel[marks[own]])
        focal_px[own] = camera.focal_px
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    sigma_m = np.hypot(evidence.gnss_sigma_m[photograph].max(axis=1), points.sigma_m[ground].max(axis=1))
    R, levelled = evidence.rotation_world_from_camera[used], levelled[used]
    tilt = np.maximum(TILT_SIGMA_RAD, evidence.attitude_sigma_rad[used])
    up = np.array([0.0, 0.0, 1.0])
    # three axes, each weighted 1/2, and the vertical once more: what turns about it is told by the heading alone
    axes, vertical = 0.5 / HEADING_SIGMA_RAD**2, 1.0 / tilt**2 - 1.0 / HEADING_SIGMA_RAD**2
    upright = up[None, :, None] * R[:, 2:, :]
    prior = np.where(levelled[:, None, None], axes * R + vertical[:, None, None] * upright, 0.0)
    return Rays(
        np.searchsorted(used, photograph),
        ray,
        evidence.gnss_world_m[photograph],
        points.position_world_m[ground],
        np.hypot(RAY_SIGMA_RAD, points.mark_sigma_px[marks] / focal_px),
        sigma_m,
        prior,
        np.where(levelled, 3.0 * axes + vertical, 0.0),
        ground,
        marks,
    )


def ray_squares(rays: Rays, shifts_m: FloatArray) -> FloatArray:
    """Return the squared residuals over their variances (S, M) of every ray at each shift (S,), and those of attitudes
    (S, F) after them, each with the photograph's best rotation."""
    count = len(rays.prior)
    squares = np.empty((len(shifts_m), len(rays.ray) + count))
    first = np.searchsorted(rays.photograph, np.arange(count))
    for k, shift in enumerate(shifts_m):
        way = rays.point + np.array([0.0, 0.0, shift]) - rays.centre
        distance = np.maximum(np.linalg.norm(way, axis=1), 1e-3)
        way /= distance[:, None]
        weight = 1.0 / (rays.angle_rad**2 + (rays.place_m / distance) ** 2)
        B = np.add.reduceat(weight[:, None, None] * way[:, :, None] * rays.ray[:, None, :], first) + rays.prior
        U, _, Vt = np.linalg.svd(B)
        turn = np.ones((count, 3))
        turn[:, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
        R = (U * turn[:, None, :]) @ Vt
        misfit = way - np.einsum("mij,mj->mi", R[rays.photograph], rays.ray)
        squares[k, : len(weight)] = weight * np.sum(misfit**2, axis=1)
        squares[k, len(weight) :] = 2.0 * (rays.prior_weight - np.einsum("fij,fij->f", R, rays.prior))
    return squares


def robust_cost(squares: FloatArray) -> FloatArray:
    """Return the robust cost (S,), half the sum of Cauchy's loss."""
    return np.asarray(0.5 * _LOSS**2 * np.sum(np.log1p(np.maximum(squares, 0.0) / _LOSS**2), axis=1))


def height_shift(evidence: HeightEvidence) -> HeightShift | None:
    """Return by how much the ground points lie too low, None where too few of them are marked to tell, or where no
    shift within FARTHEST_M makes rays and directions agree.

    Raises ImageError as unproject does.
    """
    rays = rays_of(evidence)
    if rays is None:
        return None
    coarse = np.arange(-FARTHEST_M, FARTHEST_M + _COARSE_M, _COARSE_M)
    cost = robust_cost(ray_squares(rays, coarse))
    if not rays.prior_weight.any():
        # rays alone cannot tell a camera above the ground from its mirror image below
        cost[float(np.median(rays.centre[:, 2] - rays.point[:, 2])) - coarse <= _COARSE_M] = np.inf
    best = int(np.argmin(cost))
    if best in (0, len(coarse) - 1):
        return None
    fine = coarse[best] + np.arange(-_COARSE_M, _COARSE_M + _FINE_M, _FINE_M)
    squares = ray_squares(rays, fine)
    cost = robust_cost(squares)
    best = int(np.argmin(cost))
    step = 1.0
    low, middle, high = robust_cost(ray_squares(rays, fine[best] + np.array([-step, 0.0, step])))
    curvature = (low - 2.0 * middle + high) / step**2
    if curvature <= 0.0:
        return None
    # the median of a squared residual of two free coordinates is 2 ln 2 of its variance
    scatter = float(np.median(squares[best, : len(rays.ray)])) / (2.0 * np.log(2.0))
    flying_m = float(np.median(rays.centre[:, 2] - rays.point[:, 2])) - float(fine[best])
    own = [evidence.cameras[int(c)] for c in np.unique(evidence.camera_of[evidence.points.mark_photograph])]
    share = min(max(MODEL_SHARE, *(c.sigmas[0] / c.focal_px for c in own)), _LARGEST_FOCAL_SHARE)
    return HeightShift(
        float(fine[best]),
        float(np.hypot(np.sqrt(max(scatter, 1.0) / curvature), share * abs(flying_m))),
        flying_m,
        len(rays.ray),
        len(np.unique(rays.ground)),
        float(cost[best]),
    )
