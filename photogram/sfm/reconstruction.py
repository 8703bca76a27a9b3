"""What is oriented so far: poses, tie points and calibration of a growing block, in a frame of its own.

A structure starts from two photographs or from measured poses and is changed step by step: tie points are intersected,
photographs added, everything adjusted, observations that disagree set aside and taken back when they agree again.
Tests are on residuals in pixels, on the angle between rays, and on the side of the photograph a point lies on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import cv2
import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray, grouped
from photogram.camera import Camera, Pose, image_plane, oriented_cameras, project_points
from photogram.factors.elimination.bundle import BundleState, adjust_bundle
from photogram.factors.elimination.loss import RobustLoss
from photogram.factors.elimination.reprojection import Observations, residuals
from photogram.projection import PARAMETER_NAMES, PARAMETERS, OrientedCameras
from photogram.settings.settings import Settings, Within
from photogram.survey import TiePoints
from photogram.triangulation import consensus_intersections, ideal_pixels, ray_angles

HUBER = 2.0  # sigmas of an image point, of one pixel where the block has settled
LARGEST_FOCAL_CHANGE = 2.0  # a factor
LARGEST_CHANGE = 4.0  # sigmas of what was known of a calibration
FIRST_FREE = np.isin(PARAMETER_NAMES, ("focal_px", "k1", "k2"))  # what even a weak block can tell
PHOTOGRAPHS_FOR_CALIBRATION = 5
NEIGHBOURS = 5


@dataclass(frozen=True)
class StructureSettings(Settings):
    """Which image points agree with a structure; the final adjustment judges anew, and more strictly."""

    threshold_px: Annotated[float, Within(0.1, 1000, "px"), "Residual of an image point that agrees, at most."] = 4.0
    minimum_ray_angle_deg: Annotated[float, Within(0.1, 90, "°"), "Angle between rays of a tie point, at least."] = 1.5
    minimum_points: Annotated[
        int, Within(6, 10_000), "Agreeing tie points in a photograph that is oriented, at least."
    ] = 20
    minimum_share: Annotated[
        float, Within(0.01, 1), "Share of a photograph's visible tie points that agree with its pose, at least."
    ] = 0.25


@dataclass(eq=False)
class Structure:
    """Poses and tie points of an incremental reconstruction, in the frame of its start."""

    tie_points: TiePoints
    """Observations of all tie points."""
    cameras: tuple[Camera, ...]
    """Cameras as given."""
    camera_of: IntArray
    """Camera of each photograph (N,)."""
    settings: StructureSettings
    """Thresholds."""
    rotation: FloatArray
    """Rotations (N, 3, 3) world from camera of registered photographs."""
    position: FloatArray
    """Projection centres (N, 3)."""
    registered: BoolArray
    """Photographs with a pose (N,)."""
    parameters: FloatArray
    """Interior orientations (cameras, 12)."""
    point: FloatArray
    """Tie points (P, 3), NaN while unknown."""
    good: BoolArray
    """Observations (O,) that agree."""

    @staticmethod
    def empty(
        tie_points: TiePoints, cameras: Sequence[Camera], camera_of: IntArray, settings: StructureSettings
    ) -> Structure:
        """Return a structure without any photograph."""
        n = len(camera_of)
        return Structure(
            tie_points,
            tuple(cameras),
            camera_of,
            settings,
            np.broadcast_to(np.eye(3), (n, 3, 3)).copy(),
            np.zeros((n, 3)),
            np.zeros(n, dtype=bool),
            np.array([camera.parameters for camera in cameras]).reshape(-1, PARAMETERS),
            np.full((len(tie_points), 3), np.nan),
            np.zeros(len(tie_points.photograph), dtype=bool),
        )

    @staticmethod
    def oriented(
        tie_points: TiePoints,
        cameras: Sequence[Camera],
        camera_of: IntArray,
        settings: StructureSettings,
        poses: Sequence[Pose | None],
    ) -> Structure:
        """Return the structure of photographs with poses, None for those without, and of the tie points that they
        intersect."""
        structure = Structure.empty(tie_points, cameras, camera_of, settings)
        for index, pose in enumerate(poses):
            if pose is not None:
                structure.register(index, pose)
        structure.intersect()
        return structure

    def copy(self) -> Structure:
        """Return the same structure, to be changed by itself."""
        return replace(
            self,
            rotation=self.rotation.copy(),
            position=self.position.copy(),
            registered=self.registered.copy(),
            parameters=self.parameters.copy(),
            point=self.point.copy(),
            good=self.good.copy(),
        )

    @property
    def as_oriented(self) -> OrientedCameras:
        """Return the photographs and their cameras as they stand, for compiled code."""
        given = oriented_cameras(self.cameras, self.camera_of, self.rotation, self.position)
        return given._replace(parameters=self.parameters)

    @property
    def known(self) -> BoolArray:
        """Return which tie points (P,) have a position."""
        return np.asarray(np.isfinite(self.point[:, 0]))

    @property
    def visible(self) -> IntArray:
        """Return how many known tie points each photograph (N,) has an image point of."""
        seen = self.known[self.tie_points.point]
        return np.bincount(self.tie_points.photograph[seen], minlength=len(self.camera_of)).astype(np.int64)

    @property
    def agreeing(self) -> IntArray:
        """Return how many image points of each photograph (N,) agree."""
        return np.bincount(self.tie_points.photograph[self.good], minlength=len(self.camera_of)).astype(np.int64)

    @property
    def intersectable(self) -> BoolArray:
        """Return which observations (O,) are of registered photographs and of points that two of these show."""
        tie = self.tie_points
        seen = self.registered[tie.photograph]
        return np.asarray(seen & (np.bincount(tie.point[seen], minlength=len(tie)) >= 2)[tie.point])

    @cached_property
    def _by_photograph(self) -> tuple[IntArray, IntArray]:
        """Return the observations (O,) in the order of their photographs, and the first of each (N + 1,)."""
        return grouped(self.tie_points.photograph, len(self.camera_of))

    def observations_of(self, photograph: int) -> IntArray:
        """Return the observations of one photograph, ascending."""
        order, first = self._by_photograph
        return order[first[photograph] : first[photograph + 1]]

    def ideal(self, observations: BoolArray | IntArray) -> FloatArray:
        """Return ideal image-plane coordinates (M, 2) of chosen observations by the calibrations as they stand."""
        tie = self.tie_points
        camera, pixel = self.camera_of[tie.photograph[observations]], tie.pixel[observations]
        return ideal_pixels(self.calibrated(), camera, pixel)

    def poses(self) -> tuple[Pose | None, ...]:
        """Return the poses, None for photographs that are not registered."""
        return tuple(
            Pose(R.copy(), C.copy()) if known else None
            for R, C, known in zip(self.rotation, self.position, self.registered, strict=True)
        )

    def calibrated(self) -> tuple[Camera, ...]:
        """Return the cameras as they stand."""
        return tuple(c.with_parameters(q) for c, q in zip(self.cameras, self.parameters, strict=True))

    def register(self, photograph: int, pose: Pose) -> None:
        """Give a photograph its pose."""
        self.rotation[photograph], self.position[photograph] = pose.rotation_world_from_camera, pose.position_world_m
        self.registered[photograph] = True

    def withdraw(self, photographs: BoolArray) -> None:
        """Take photographs (N,) out again."""
        self.registered &= ~photographs
        self.good &= self.registered[self.tie_points.photograph]
        self._forget(np.bincount(self.tie_points.point[self.good], minlength=len(self.point)) < 2)

    def _forget(self, points: BoolArray) -> None:
        self.point[points] = np.nan
        self.good &= ~points[self.tie_points.point]

    def _points_of(self, chosen: BoolArray) -> BoolArray:
        """Return the tie points (P,) of chosen observations (O,)."""
        points = np.zeros(len(self.tie_points), dtype=bool)
        points[self.tie_points.point[chosen]] = True
        return points

    def _observations(self, chosen: BoolArray) -> Observations:
        tie = self.tie_points
        photograph = tie.photograph[chosen]
        return Observations(photograph, tie.point[chosen], tie.pixel[chosen], np.ones(len(photograph)))

    def residual_px(self, chosen: BoolArray) -> FloatArray:
        """Return the lengths (M,) of the residuals of chosen observations (O,) of known points; infinite behind."""
        o = self._observations(chosen)
        return np.asarray(np.linalg.norm(residuals(o, self.as_oriented, self.point), axis=1))

    def intersect(self, photographs: BoolArray | None = None) -> None:
        """Intersect unknown tie points from their registered photographs; only those seen by ``photographs`` (N,)."""
        tie = self.tie_points
        seen = self.registered[tie.photograph]
        wanted = ~self.known & self._points_of(self.intersectable)
        if photographs is not None:
            wanted &= self._points_of(photographs[tie.photograph])
        if not wanted.any():
            return
        chosen = seen & wanted[tie.point]
        part = tie.select(wanted, seen)
        limit = np.full(len(part.photograph), self.settings.threshold_px)
        points, agree = consensus_intersections(
            part.first_observation, part.photograph, part.pixel, self.ideal(chosen), limit, self.as_oriented,
        )  # fmt: skip
        wide = ray_angles(part, agree, self.position, points) > np.deg2rad(self.settings.minimum_ray_angle_deg)
        points[~wide] = np.nan
        self.point[wanted] = points
        self.good[chosen] = agree & wide[part.point]

    def judge(self, limit_px: float | None = None, photographs: BoolArray | None = None) -> None:
        """Choose anew which observations of known points agree, and forget points that too few rays, or too nearly
        parallel ones, are left of; only those of ``photographs`` (N,) where they are given."""
        tie = self.tie_points
        chosen = self.registered[tie.photograph] & self.known[tie.point]
        if photographs is not None:
            chosen &= photographs[tie.photograph]
        self.good[chosen] = self.residual_px(chosen) < (limit_px or self.settings.threshold_px)
        if photographs is not None:
            return
        rays = np.bincount(tie.point[self.good], minlength=len(tie))
        self._forget(self.known & (rays < 2))
        angle = ray_angles(tie, self.good, self.position, np.nan_to_num(self.point))
        self._forget(self.known & (angle < np.deg2rad(self.settings.minimum_ray_angle_deg)))

    def neighbours(self, photographs: BoolArray) -> BoolArray:
        """Return ``photographs`` (N,) and the registered ones that share most points with any of them."""
        tie = self.tie_points
        touched = self._points_of(self.good & photographs[tie.photograph])
        shared = np.bincount(tie.photograph[self.good & touched[tie.point]], minlength=len(self.camera_of))
        shared[photographs | ~self.registered] = 0
        wanted = NEIGHBOURS * max(1, int(photographs.sum()))
        best = np.argsort(-shared, kind="stable")[:wanted]
        active = photographs.copy()
        active[best[shared[best] > 0]] = True
        return active

    def adjust(
        self,
        active: BoolArray | None = None,
        *,
        iterations: int = 15,
        tolerance: float = 1e-3,
        huber_px: float = HUBER,
        calibrate: bool = True,
        loss: RobustLoss = "huber",
        position: FloatArray | None = None,
        position_sigma: float = np.inf,
    ) -> None:
        """Adjust the photographs ``active`` (N,), or all, with their tie points; the others stay where they are.

        The calibration takes part, unless ``calibrate`` is False, when all are adjusted and there are enough of them;
        one that leaves what a camera can be is not taken. Projection centres are held to ``position`` (N, 3), where
        it is given, by one standard deviation.
        """
        tie, chosen = self.tie_points, self.good.copy()
        if active is not None:
            chosen &= self._points_of(chosen & active[tie.photograph])[tie.point]
        photographs, photograph = _numbered(tie.photograph[chosen], len(self.camera_of))
        points, point = _numbered(tie.point[chosen], len(tie))
        if not len(points):
            return
        sigma = np.array([camera.sigmas for camera in self.cameras])
        enough = calibrate and active is None and len(photographs) >= PHOTOGRAPHS_FOR_CALIBRATION
        free = (sigma > 0) & FIRST_FREE & enough
        moving = self.as_oriented._replace(
            camera=self.camera_of[photographs],
            rotation=self.rotation[photographs],
            position=self.position[photographs],
            velocity=np.zeros((len(photographs), 3)),
        )
        start = BundleState(moving, self.point[points], 0.0, 0)
        # residuals that are large yet must not outweigh what is known of the calibration
        noise_px = huber_px / HUBER
        result = adjust_bundle(
            Observations(photograph, point, tie.pixel[chosen], np.full(len(point), noise_px)),
            start,
            fixed_poses=np.zeros(len(photographs), dtype=bool) if active is None else ~active[photographs],
            free=free,
            prior_sigma=np.where(sigma > 0, sigma, np.inf),
            prior_parameters=np.array([camera.parameters for camera in self.cameras]),
            prior_position=None if position is None else position[photographs],
            prior_position_sigma=position_sigma,
            loss=loss,
            threshold=HUBER,
            maximum_iterations=iterations,
            relative_tolerance=tolerance,
        )  # fmt: skip
        if free.any() and not all(
            _believable(c, q) for c, q in zip(self.cameras, result.cameras.parameters, strict=True)
        ):
            self.adjust(
                iterations=iterations, tolerance=tolerance, huber_px=huber_px, calibrate=False, loss=loss,
                position=position, position_sigma=position_sigma,
            )  # fmt: skip
            return
        self.rotation[photographs], self.position[photographs] = result.cameras.rotation, result.cameras.position
        self.point[points] = result.point
        if free.any():
            self.parameters = result.cameras.parameters

    def resect(self, photograph: int) -> bool:
        """Find the pose of a photograph from the tie points that are known, and register it when enough agree.

        P3P in RANSAC (Grunert 1841; Fischler & Bolles 1981) as OpenCV implements it, refined on all that agree.
        """
        tie, s = self.tie_points, self.settings
        seen = self.observations_of(photograph)
        seen = seen[np.isfinite(self.point[tie.point[seen], 0])]
        if len(seen) < s.minimum_points:
            return False
        camera = self.cameras[self.camera_of[photograph]].with_parameters(self.parameters[self.camera_of[photograph]])
        points, ideal = self.point[tie.point[seen]], image_plane(camera, tie.pixel[seen])
        pose = resected(points, ideal, s.threshold_px / camera.focal_px)
        if pose is None:
            return False
        local = pose.camera_from_world(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            error_px = np.linalg.norm(local[:, :2] / local[:, 2:] - ideal, axis=1) * camera.focal_px
        if camera.model == "fisheye":  # a pixel far off its axis is much more of ideal coordinates
            error_px = np.linalg.norm(project_points(camera, pose, points) - tie.pixel[seen], axis=1)
        agree = (local[:, 2] > 0) & (error_px < s.threshold_px)
        if agree.sum() < max(s.minimum_points, s.minimum_share * len(seen)):
            return False
        self.register(photograph, pose)
        self.good[seen] = agree
        return True


def _numbered(values: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return which of 0 to ``count`` - 1 occur among ``values`` (M,), and the place (M,) of each value among these."""
    occurs = np.bincount(values, minlength=count) > 0
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[values]


def _believable(given: Camera, parameters: FloatArray) -> bool:
    """Return whether a calibration (12,) is near the given one, and its distortion can be undone up to the corners."""
    if not 1.0 / LARGEST_FOCAL_CHANGE < parameters[0] / given.focal_px < LARGEST_FOCAL_CHANGE:
        return False
    if np.any(np.abs(parameters - given.parameters)[FIRST_FREE] > LARGEST_CHANGE * given.sigmas[FIRST_FREE]):
        return False
    camera = given.with_parameters(parameters)
    width, height = given.width_px - 0.5, given.height_px - 0.5
    corners = np.array([[-0.5, -0.5], [width, -0.5], [-0.5, height], [width, height]])
    reach = float(np.linalg.norm((corners - camera.principal_point_px) / camera.focal_px, axis=1).max())
    # the corners of a fisheye may lie beyond what it sees
    return camera.largest_image_radius > min(reach, 0.9 * given.largest_image_radius)


def resected(points: FloatArray, ideal: FloatArray, threshold: float) -> Pose | None:
    """Return the pose that most points (N, 3), seen at ideal coordinates (N, 2), agree with; None when there is none.

    ``threshold`` is the largest disagreement at unit focal length.
    """
    origin = points.mean(axis=0)
    is_solved, rotation, translation, inliers = cv2.solvePnPRansac(
        points - origin, ideal, np.eye(3), np.zeros(4), None, None, False, 2000, threshold, 0.9999, None,
        cv2.SOLVEPNP_P3P,
    )  # fmt: skip
    if not is_solved or inliers is None or len(inliers) < 4:
        return None
    chosen = inliers.ravel()
    rotation, translation = cv2.solvePnPRefineLM(
        (points - origin)[chosen], ideal[chosen], np.eye(3), np.zeros(4), rotation, translation
    )
    R = cv2.Rodrigues(rotation)[0]
    return Pose(np.ascontiguousarray(R.T), origin - (R.T @ translation).ravel())
