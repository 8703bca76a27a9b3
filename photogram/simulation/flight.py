"""A plan as it was flown and measured: true poses, GNSS positions, attitudes, ground points and their marks.

Errors:
    GNSS position      = projection centre − offset of the flight − R · arm − velocity · time offset − drift + noise
    measured attitude  = heading error · true rotation · boresight · Exp(noise), about the camera's axes
    approximate camera = true interior orientation + noise, or what the EXIF focal length says
    surveyed point     = true position + noise
    mark               = projection of the true position + noise, rounded to whole pixels where the plan says so
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np
from scipy.spatial import Delaunay, cKDTree
from scipy.spatial.transform import Rotation

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, Pose, image_plane, oriented_by
from photogram.compilation import njit
from photogram.measures.mark_covariances import isotropic_px2
from photogram.projection import PARAMETERS, READOUT, USUAL, OrientedCameras, project_point
from photogram.quality.flight_lines import Course, flown
from photogram.simulation.rendering import visible
from photogram.simulation.scene import Scene, terrain_height
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import ControlPoints, Photograph, Role

_START = datetime(2024, 6, 12, 10, 0, tzinfo=UTC)
_POINTS_AT_ONCE = 20_000


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulated survey tried to find out, in the world frame; ``gnss_offset_world_m`` by flight."""

    camera: Camera
    poses: tuple[Pose, ...]
    control_position_world_m: FloatArray
    gnss_offset_world_m: dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Flight:
    """A plan as it was flown: the true camera and poses, and what the surveyor has of them."""

    plan: SurveyPlan
    camera: Camera
    approximate: Camera
    poses: tuple[Pose, ...]
    photographs: tuple[Photograph, ...]
    gnss_offset: dict[str, FloatArray]

    @property
    def rotations(self) -> FloatArray:
        """Return the true rotations world from camera (N, 3, 3)."""
        return np.array([pose.rotation_world_from_camera for pose in self.poses])

    @property
    def centres(self) -> FloatArray:
        """Return the true projection centres (N, 3) in the world frame."""
        return np.array([pose.position_world_m for pose in self.poses])

    @property
    def corners(self) -> FloatArray:
        """Return the ideal image-plane coordinates (4, 2) of the corners of a photograph."""
        w, h = self.plan.width_px - 1.0, self.plan.height_px - 1.0
        return image_plane(self.camera, np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]))

    def truth(self, control_position_world_m: FloatArray) -> Truth:
        """Return the truth, with ground points (G, 3)."""
        return Truth(self.camera, self.poses, control_position_world_m, self.gnss_offset)


@dataclass(frozen=True, eq=False)
class Sightings:
    """Which points photographs show, sorted by point, then photograph: ``photograph`` (N,), ``point`` (N,), and the
    true ``pixel`` (N, 2)."""

    photograph: IntArray
    point: IntArray
    pixel: FloatArray

    def select(self, keep: BoolArray) -> Sightings:
        """Keep the sightings of the mask (N,)."""
        return Sightings(self.photograph[keep], self.point[keep], self.pixel[keep])

    def table(self, photographs: int, points: int) -> BoolArray:
        """Return which photographs show which points (photographs, points)."""
        seen = np.zeros((photographs, points), dtype=bool)
        seen[self.photograph, self.point] = True
        return seen


def _cameras(plan: SurveyPlan, rng: np.random.Generator) -> tuple[Camera, Camera]:
    """Return the true and the approximate camera."""
    w, h = plan.width_px, plan.height_px
    middle = np.array([(w - 1) / 2, (h - 1) / 2])
    camera = Camera(
        "simulated", w, h, plan.focal_px, middle + plan.principal_point_offset_px, np.array(plan.radial),
        np.array(plan.tangential), affinity=np.array(plan.affinity_px), model=plan.camera_model,
        readout_s=plan.readout_s,
    )  # fmt: skip
    sigmas = np.array([*plan.calibration_sigmas, plan.readout_sigma_s])
    drawn, unusual = np.zeros(PARAMETERS), np.flatnonzero(~USUAL & (np.arange(PARAMETERS) != READOUT))
    drawn[USUAL] = rng.standard_normal(np.count_nonzero(USUAL))
    if np.any(sigmas[unusual] > 0):
        drawn[unusual] = rng.standard_normal(len(unusual))
    error = np.where(np.isfinite(sigmas), sigmas, 0.0) * drawn
    error[READOUT] = -plan.readout_s
    if plan.calibration_source == "exif":
        focal_px = plan.focal_px * plan.focal_35mm_mm / plan.exact_focal_35mm_mm
        undistorted = np.zeros(PARAMETERS)
        undistorted[:3] = focal_px, *middle
        return camera, replace(camera.with_parameters(undistorted), sigmas=sigmas)
    return camera, replace(camera.with_parameters(camera.parameters + error), sigmas=sigmas)


def turned(rotation: FloatArray, noise_rad: FloatArray) -> FloatArray:
    """Return rotations (N, 3, 3) turned about the camera's axes by rotation vectors (N, 3)."""
    return np.asarray(rotation @ Rotation.from_rotvec(noise_rad).as_matrix())


def _strips(plan: SurveyPlan) -> list[Course]:
    """Return the strips of a plan, the oblique one last."""
    apart, length = (1 - plan.side_overlap) * plan.width_px * plan.gsd_m, plan.photographs_per_strip
    height_m, strips = plan.flying_height_m, list[Course]()
    for first, step in ((0, 2), (1, 2)) if plan.crossing else ((0, 1),):
        count = len(range(first, plan.strips, step))
        for k in range(count):
            heading_deg, offset = 90.0 * first + 180.0 * (k % 2), (k - (count - 1) / 2) * apart
            heading = np.radians(heading_deg) if plan.crossing else 0.0
            middle = float(offset * abs(np.cos(heading))), float(offset * abs(np.sin(heading)))
            strips.append(Course(middle, heading_deg, length, plan.base_m, height_m))
    if plan.oblique_strip:
        count, tilt_deg = plan.oblique_photographs or length, plan.oblique_angle_deg
        setback_m = float(np.tan(np.radians(tilt_deg))) * height_m
        strips.append(Course((0.0, 0.0), 90.0, count, plan.base_m, height_m, tilt_deg, setback_m))
    return strips


def _courses(
    plan: SurveyPlan, courses: list[Course], rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Return rotations (N, 3, 3), projection centres (N, 3) and velocities (N, 3), m/s, strip after strip, and the
    strip (N,) of each."""
    rotation, position = flown(courses)
    if not plan.turns:
        rotation[:] = np.diag([1.0, -1.0, -1.0])
    velocity = np.array([(plan.speed_m_s - plan.headwind_m_s * c.forward[1]) * c.forward for c in courses])
    position += plan.position_noise_m * rng.standard_normal(position.shape)
    noise_rad = np.radians(plan.attitude_noise_deg) * rng.standard_normal(position.shape)
    strip = np.repeat(np.arange(len(courses)), [course.photographs for course in courses])
    return turned(rotation, noise_rad), position, velocity[strip], strip


def _share_of_flight(seconds: FloatArray, flight: IntArray) -> FloatArray:
    """Return times (N,) in the duration of their flight (N,), −1/2 to 1/2."""
    share = np.zeros(len(seconds))
    for f in np.unique(flight):
        own = flight == f
        share[own] = (seconds[own] - seconds[own].min()) / max(float(np.ptp(seconds[own])), 1e-9) - 0.5
    return share


def fly(plan: SurveyPlan, rng: np.random.Generator, courses: list[Course] | None = None) -> Flight:
    """Fly the plan, or other ``courses`` than its strips, and measure positions and attitudes of its photographs."""
    camera, approximate = _cameras(plan, rng)
    rotations, centres, velocities, strip = _courses(plan, courses or _strips(plan), rng)
    offset = np.array(plan.gnss_offset_sigma_m) * rng.standard_normal((plan.flights, 3))
    flight = np.minimum(strip * plan.flights // plan.strips, plan.flights - 1)
    sigma, sigma_rad = np.array(plan.gnss_sigma_m), float(np.radians(plan.attitude_sigma_deg))
    step_s = plan.base_m / np.linalg.norm(velocities, axis=1)
    seconds = np.cumsum(step_s) - step_s[0] + 20.0 * strip + 1200.0 * flight
    gnss = centres - offset[flight] + sigma * rng.standard_normal(centres.shape)
    gnss -= rotations @ np.array(plan.lever_arm_m) + velocities * plan.time_offset_s
    gnss -= _share_of_flight(seconds, flight)[:, None] * np.array(plan.drift_m)
    off = Rotation.from_rotvec([0.0, 0.0, -np.radians(plan.heading_error_deg)]).as_matrix()
    boresight = Rotation.from_rotvec(np.radians(plan.boresight_deg)).as_matrix()
    attitude = turned(off @ rotations @ boresight, sigma_rad * rng.standard_normal(centres.shape))
    bare = [Photograph(f"sim_{i + 1:04d}.JPG", 0, flight=str(flight[i] + 1)) for i in range(len(strip))]
    photographs = tuple(
        replace(
            photograph, time=_START + timedelta(seconds=float(seconds[i])), gnss_world_m=gnss[i], gnss_sigma_m=sigma,
            attitude_world_from_camera=attitude[i], attitude_sigma_rad=sigma_rad,
            # a barometer above the place of take-off, whose height is that of the terrain on average
            height_above_ground_m=round(float(centres[i, 2]), 1),
            velocity_world_m_s=np.round(velocities[i], 1) if plan.velocity_tags else None,
        )
        for i, photograph in enumerate(bare)
    )  # fmt: skip
    poses = tuple(Pose(R, C, v) for R, C, v in zip(rotations, centres, velocities, strict=True))
    offsets = {str(f + 1): v for f, v in enumerate(offset)}
    return Flight(plan, camera, approximate, poses, photographs if plan.gnss_tags else tuple(bare), offsets)


def footprints(flight: Flight, height_m: float) -> FloatArray:
    """Return where the corners (N, 4, 2) of photographs meet level ground. Raises ValueError above the horizon."""
    direction = np.column_stack([flight.corners, np.ones(4)]) @ np.swapaxes(flight.rotations, 1, 2)
    if np.any(direction[..., 2] > -0.1 * np.linalg.norm(direction, axis=2)):
        raise ValueError(f"photographs look at the horizon: reduce oblique_angle_deg = {flight.plan.oblique_angle_deg}")
    centre = flight.centres[:, None]
    return np.asarray((centre + direction * ((height_m - centre[..., 2:]) / direction[..., 2:]))[..., :2])


@njit(cache=True)
def _sight(
    cameras: OrientedCameras, X: FloatArray, i: IntArray, p: IntArray, reach: float, limits: FloatArray
) -> tuple[FloatArray, BoolArray]:  # fmt: skip
    """Project points p by photographs i; points are seen within ``limits`` (left, top, right, bottom) in px.

    ``reach`` bounds the ideal radius: far outside of a photograph the distortion polynomial folds back, so that the
    pixel alone says nothing.
    """
    C = cameras.position
    pixel = np.empty((len(p), 2))
    seen = np.zeros(len(p), dtype=np.bool_)
    for n in range(len(p)):
        u, v, depth = project_point(cameras, i[n], X[p[n]])
        pixel[n, 0], pixel[n, 1] = u, v
        if depth > 0.0:
            distance2 = np.sum((X[p[n]] - C[i[n]]) ** 2)
            near = distance2 - depth * depth <= (reach * depth) ** 2
            seen[n] = near and limits[0] <= u <= limits[2] and limits[1] <= v <= limits[3]
    return pixel, seen


def observe(flight: Flight, points: FloatArray, margin_px: float, scene: Scene | None = None) -> Sightings:
    """Return which photographs show which points (P, 3), ``margin_px`` within; without a scene nothing is hidden.

    Points are taken by the thousand, each with the photographs near it, so that memory grows with the sightings alone.
    """
    corners = footprints(flight, 0.0)
    relief = flight.plan.relief_m
    height = flight.plan.flying_height_m
    centre = corners.mean(axis=1)
    widening = height / max(height - relief, 0.2 * height)
    near_m = widening * float(np.linalg.norm(corners - centre[:, None], axis=2).max()) + relief
    tree = cKDTree(centre)
    cameras = oriented_by([flight.camera], np.zeros(len(flight.poses), dtype=np.int64), flight.poses)
    last = np.array([flight.plan.width_px, flight.plan.height_px]) - 1 - margin_px
    limits = np.array([margin_px, margin_px, *last])
    reach = 1.02 * float(np.linalg.norm(flight.corners, axis=1).max())
    parts = [Sightings(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))]
    for start in range(0, len(points), _POINTS_AT_ONCE):
        chunk = points[start : start + _POINTS_AT_ONCE]
        pairs = cKDTree(chunk[:, :2]).sparse_distance_matrix(tree, near_m, output_type="ndarray")
        order = np.lexsort((pairs["j"], pairs["i"]))
        point, photograph = pairs["i"][order].astype(np.int64), pairs["j"][order].astype(np.int64)
        pixel, seen = _sight(cameras, chunk, photograph, point, reach, limits)
        parts.append(Sightings(photograph, point + start, pixel).select(seen))
    photograph, point, pixel = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("photograph", "point", "pixel")
    )
    sightings = Sightings(photograph, point, pixel)
    return sightings if scene is None else sightings.select(_not_hidden(flight, points, sightings, scene))


def _not_hidden(flight: Flight, points: FloatArray, sightings: Sightings, scene: Scene) -> BoolArray:
    keep = np.zeros(len(sightings.point), dtype=bool)
    for number, pose in enumerate(flight.poses):
        mine = np.flatnonzero(sightings.photograph == number)
        keep[mine] = visible(scene, pose, points[sightings.point[mine]])
    return keep


def sight_ground(
    flight: Flight, seed: int, xy: FloatArray, margin_px: float, detection: float, rng: np.random.Generator
) -> tuple[FloatArray, Sightings]:
    """Return points (P, 3) of the bare terrain at places ``xy`` (P, 2), and which photographs show them: each sighting
    with the probability ``detection``."""
    points = np.column_stack([xy, terrain_height(seed, flight.plan.relief_m, xy)])
    seen = observe(flight, points, margin_px)
    return points, seen.select(rng.random(len(seen.point)) < detection)


def candidates(flight: Flight, rng: np.random.Generator) -> FloatArray:
    """Return places (K, 2) in and around the photographed area where a ground point might go."""
    corners = footprints(flight, 0.0).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    spacing = max(1.5, float(np.max(high - low)) / 70)
    x, y = (np.arange(low[k], high[k] + spacing, spacing) for k in (0, 1))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(grid + rng.uniform(-0.3, 0.3, grid.shape) * spacing)


def place_control(plan: SurveyPlan, candidate: FloatArray, seen: BoolArray) -> FloatArray:
    """Choose control, then check points (G, 3) among candidates (K, 3), seen (N, K) by the photographs.

    Each point in turn goes where it is farthest from those that stand, corners and edges first; places that help
    photographs which still lack control marks count for more, and check points keep within the hull of the control.
    Raises ValueError when there is no room.
    """
    wanted = plan.control_points + plan.check_points
    rays = seen.sum(axis=0)
    usable = rays >= min(3, max(1, rays.max(initial=0)))
    candidate, seen = candidate[usable], seen[:, usable]
    if len(candidate) < wanted:
        raise ValueError(f"no room for {wanted} control and check points: reduce their number, or enlarge the site")
    distance = 1 / (1 + np.linalg.norm(candidate - candidate.min(axis=0, initial=np.inf), axis=1))
    chosen: list[int] = []
    lacking = np.full(len(seen), plan.control_marks_per_photograph)
    for number in range(wanted):
        if number == plan.control_points >= 3:
            within = Delaunay(candidate[chosen, :2]).find_simplex(candidate[:, :2]) >= 0
            distance = np.where(within, 1.0, 1e-3) * distance
        gain = 1 + 0.5 * seen[lacking > 0].sum(axis=0) * (0 < number < plan.control_points)
        chosen.append(int(np.argmax(distance * gain)))
        lacking -= seen[:, chosen[-1]]
        step = np.linalg.norm(candidate[:, :2] - candidate[chosen[-1], :2], axis=1)
        distance = step if number == 0 else np.minimum(distance, step)
    return np.asarray(candidate[chosen])


def measure_control(flight: Flight, position: FloatArray, seen: Sightings, rng: np.random.Generator) -> ControlPoints:
    """Survey the points at true positions (G, 3), and mark them where they are seen.

    Raises ValueError when a photograph sees too few control points for the plan.
    """
    plan = flight.plan
    _require_marks(flight, seen)
    mark = seen.pixel + plan.mark_sigma_px * rng.standard_normal((len(seen.point), 2))
    sigma = np.array(plan.control_sigma_m)
    surveyed = position + sigma * rng.standard_normal(position.shape)
    control: list[Role] = ["control"] * plan.control_points
    check: list[Role] = ["check"] * plan.check_points
    names = (*(f"G{i + 1:02d}" for i in range(len(control))), *(f"C{i + 1:02d}" for i in range(len(check))))
    if plan.blunder_point is not None:
        if plan.blunder_point not in names:
            raise ValueError(
                f"blunder_point: no point has the name {plan.blunder_point!r}; they are {', '.join(names)}"
            )
        surveyed[names.index(plan.blunder_point), 2] += plan.control_height_blunder_m
    return ControlPoints(
        name=names,
        role=(*control, *check),
        position_world_m=surveyed,
        sigma_m=np.tile(sigma, (len(names), 1)),
        mark_photograph=seen.photograph,
        mark_point=seen.point,
        mark_pixel=np.rint(mark) if plan.whole_pixel_marks else mark,
        mark_covariance_px2=isotropic_px2(np.full(len(seen.point), plan.stated_mark_sigma_px)),
    )


def _require_marks(flight: Flight, seen: Sightings) -> None:
    control = seen.photograph[seen.point < flight.plan.control_points]
    marks = np.bincount(control, minlength=len(flight.poses))
    fewest, wanted = int(np.argmin(marks)), flight.plan.control_marks_per_photograph
    if marks[fewest] < wanted:
        raise ValueError(
            f"photograph {flight.photographs[fewest].name} sees {marks[fewest]} of {flight.plan.control_points} "
            f"control points, the plan asks for {wanted}: raise control_points"
        )
