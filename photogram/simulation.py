"""Surveys with known truth: flown, measured and photographed on a made site, from a seed and nothing else.

``simulate`` makes a small survey with a scene that can be rendered; ``simulate_block`` makes the observations of a
block of hundreds of photographs without rendering, on the bare terrain. Every error has a stated standard deviation:

    GNSS position      = projection centre − offset of the flight + noise     (projection centre = GNSS + offset)
    measured attitude  = true rotation · Exp(noise), about the camera's axes
    approximate camera = true interior orientation + noise, or the nominal one
    surveyed point     = true position + noise
    mark               = projection of the true position + noise, rounded to whole pixels where the plan says so
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, image_plane, project, project_point
from photogram.frames import LocalFrame
from photogram.rendering import render, visible
from photogram.scene import Scene, make_scene, paint_targets, surface_raster, target_reach, terrain_height
from photogram.survey import Block, ControlPoints, Photograph, Raster, Role, TiePoints

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
_START = datetime(2024, 6, 12, 10, 0, tzinfo=UTC)


@dataclass(frozen=True)
class SurveyPlan:
    """All settings of a simulated survey.

    Camera: ``principal_point_offset_px`` from the centre of the photograph, ``radial`` k1 k2 k3, ``tangential`` p1 p2;
    ``calibration_sigmas``, in the order of camera.PARAMETER_NAMES, are both the errors of the approximate camera and
    the sigmas it states (a zero: known; infinity: free, and without error).
    Flight: parallel strips to and fro, ``flying_height_m`` above terrain whose height is 0 on the average; an oblique
    strip crosses them, its cameras tilted forward by ``oblique_angle_deg``. ``attitude_noise_deg`` and
    ``position_noise_m`` are how badly the plan is flown, ``attitude_sigma_deg`` and ``gnss_sigma_m`` (east, north, up)
    how badly it is measured; ``gnss_offset_sigma_m`` is how far the offset of a flight may lie from zero. The strips
    are shared out among the ``flights`` in their order.
    Ground: ``relief_m`` from valley to hill, ``cell_m`` of the height field, numbers of ``buildings`` and ``trees``.
    Control: ``mark_sigma_px`` in a photograph, rounded where ``whole_pixel_marks``; every photograph must see
    ``control_marks_per_photograph`` of the control points.
    Blunder: ``control_height_blunder_m`` is added to the surveyed height of the point called ``blunder_point``.
    """

    width_px: int = 1200
    height_px: int = 900
    focal_px: float = 1800.0
    principal_point_offset_px: tuple[float, float] = (3.0, -2.0)
    radial: tuple[float, float, float] = (-0.08, 0.06, -0.01)
    tangential: tuple[float, float] = (0.0004, -0.0003)
    calibration_sigmas: tuple[float, ...] = (5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0002, 0.0002)
    flying_height_m: float = 80.0
    forward_overlap: float = 0.7
    side_overlap: float = 0.65
    strips: int = 3
    photographs_per_strip: int = 4
    oblique_strip: bool = False
    oblique_angle_deg: float = 25.0
    speed_m_s: float = 5.0
    attitude_noise_deg: float = 1.5
    position_noise_m: float = 0.5
    attitude_sigma_deg: float = 1.0
    flights: int = 1
    gnss_sigma_m: tuple[float, float, float] = (0.02, 0.02, 0.04)
    gnss_offset_sigma_m: tuple[float, float, float] = (0.3, 0.3, 0.5)
    relief_m: float = 8.0
    cell_m: float = 0.1
    buildings: int = 12
    trees: int = 100
    target_radius_m: float = 0.35
    control_points: int = 18
    check_points: int = 8
    control_marks_per_photograph: int = 0
    control_sigma_m: tuple[float, float, float] = (0.01, 0.01, 0.015)
    mark_sigma_px: float = 0.3
    whole_pixel_marks: bool = False
    blunder_point: str | None = None
    control_height_blunder_m: float = 0.0
    crs: str = "EPSG:25832"
    origin_map_m: tuple[float, float, float] = (602340.0, 5794120.0, 120.0)

    def __post_init__(self) -> None:
        if not (0 < self.forward_overlap < 1 and 0 < self.side_overlap < 1):
            raise ValueError("overlaps lie between 0 and 1")
        if min(self.strips, self.photographs_per_strip, self.flights) < 1 or self.flights > self.strips:
            raise ValueError("a survey has at least one photograph, one strip, and one strip per flight")
        if len(self.calibration_sigmas) != 8:
            raise ValueError(f"calibration_sigmas: eight values, not {len(self.calibration_sigmas)}")

    @property
    def gsd_m(self) -> float:
        """Return the ground sampling distance: the size of a pixel on the ground, in metres."""
        return self.flying_height_m / self.focal_px

    @property
    def frame(self) -> LocalFrame:
        """Return the world frame of the survey."""
        return LocalFrame(self.crs, self.origin_map_m)

    @property
    def stated_mark_sigma_px(self) -> float:
        """Return the standard deviation of a mark, rounding included."""
        return float(np.hypot(self.mark_sigma_px, 12**-0.5 if self.whole_pixel_marks else 0.0))


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulated survey tried to find out, in the world frame; ``gnss_offset_world_m`` by flight."""

    camera: Camera
    poses: tuple[Pose, ...]
    control_position_world_m: FloatArray
    gnss_offset_world_m: dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class SimulatedSurvey:
    """A survey and its scene: what a surveyor holds (approximate camera, photographs, control points) and the truth."""

    plan: SurveyPlan
    seed: int
    frame: LocalFrame
    scene: Scene
    approximate_camera: Camera
    photographs: tuple[Photograph, ...]
    control_points: ControlPoints
    truth: Truth


@dataclass(frozen=True, eq=False)
class SimulatedBlock:
    """A block with starting values, and the truth; ``mismatch`` (N,) are the observations that were displaced."""

    plan: SurveyPlan
    seed: int
    block: Block
    truth: Truth
    tie_point_position_world_m: FloatArray
    mismatch: BoolArray


def demonstration_plan() -> SurveyPlan:
    """Return the plan of the built-in demonstration: twelve photographs, their control marks read to whole pixels."""
    return SurveyPlan(control_marks_per_photograph=4, mark_sigma_px=0.0, whole_pixel_marks=True)


@dataclass(frozen=True, eq=False)
class _Flight:
    """A plan as it was flown: the true camera and poses, and what the surveyor has of them."""

    plan: SurveyPlan
    camera: Camera
    approximate: Camera
    poses: tuple[Pose, ...]
    photographs: tuple[Photograph, ...]
    gnss_offset: dict[str, FloatArray]

    @property
    def rotations(self) -> FloatArray:
        return np.array([pose.rotation_world_from_camera for pose in self.poses])

    @property
    def centres(self) -> FloatArray:
        return np.array([pose.position_world_m for pose in self.poses])

    @property
    def corners(self) -> FloatArray:
        """Return the ideal image-plane coordinates (4, 2) of the corners of a photograph."""
        w, h = self.plan.width_px - 1.0, self.plan.height_px - 1.0
        return image_plane(self.camera, np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]))

    def contains(self, pixel: FloatArray, ray: FloatArray, margin_px: float) -> BoolArray:
        """Return which pixels (..., 2), of rays (..., 3) in the camera frame, lie ``margin_px`` within a photograph.

        Far outside of it the distortion polynomial folds back, so that the pixel alone says nothing.
        """
        limit = np.array([self.plan.width_px, self.plan.height_px]) - 1 - margin_px
        near = np.hypot(ray[..., 0], ray[..., 1]) <= 1.02 * np.linalg.norm(self.corners, axis=1).max() * ray[..., 2]
        return np.asarray(near & np.all((pixel >= margin_px) & (pixel <= limit), axis=-1))


def _cameras(plan: SurveyPlan, rng: np.random.Generator) -> tuple[Camera, Camera]:
    """Return the true and the approximate camera."""
    w, h, radial, tangential = plan.width_px, plan.height_px, np.array(plan.radial), np.array(plan.tangential)
    centre = np.array([(w - 1) / 2, (h - 1) / 2]) + plan.principal_point_offset_px
    camera = Camera("simulated", w, h, plan.focal_px, centre, radial, tangential)
    sigmas = np.array(plan.calibration_sigmas)
    error = np.where(np.isfinite(sigmas), sigmas, 0.0) * rng.standard_normal(8)
    return camera, replace(camera.with_parameters(camera.parameters + error), sigmas=sigmas)


def _turned(rotation: FloatArray, noise_rad: FloatArray) -> FloatArray:
    return np.asarray(rotation @ Rotation.from_rotvec(noise_rad).as_matrix())


def _courses(plan: SurveyPlan, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return rotations (N, 3, 3) and projection centres (N, 3), strip after strip, and the strip (N,) of each."""
    base = (1 - plan.forward_overlap) * plan.height_px * plan.gsd_m
    apart = (1 - plan.side_overlap) * plan.width_px * plan.gsd_m
    along = (np.arange(plan.photographs_per_strip) - (plan.photographs_per_strip - 1) / 2) * base
    courses = [((s - (plan.strips - 1) / 2) * apart, 180.0 * (s % 2), 0.0) for s in range(plan.strips)]
    if plan.oblique_strip:
        courses.append((0.0, 90.0, plan.oblique_angle_deg))
    rotations, centres = [], []
    for offset, heading_deg, tilt_deg in courses:
        heading, tilt = np.radians(heading_deg), np.radians(tilt_deg)
        forward = np.array([np.sin(heading), np.cos(heading), 0.0])
        right, down = np.array([forward[1], -forward[0], 0.0]), np.array([0.0, 0.0, -1.0])
        across, setback = np.array([offset, 0.0, plan.flying_height_m]), np.tan(tilt) * plan.flying_height_m
        axis = np.cos(tilt) * down + np.sin(tilt) * forward
        rotations += [np.column_stack([right, np.cross(axis, right), axis])] * len(along)
        centres.append(across + (along[:, None] - setback) * forward)
    position = np.concatenate(centres)
    position += plan.position_noise_m * rng.standard_normal(position.shape)
    noise_rad = np.radians(plan.attitude_noise_deg) * rng.standard_normal(position.shape)
    return _turned(np.array(rotations), noise_rad), position, np.repeat(np.arange(len(courses)), len(along))


def _fly(plan: SurveyPlan, rng: np.random.Generator) -> _Flight:
    """Fly the plan and measure the positions and attitudes of its photographs."""
    camera, approximate = _cameras(plan, rng)
    rotations, centres, strip = _courses(plan, rng)
    offset = np.array(plan.gnss_offset_sigma_m) * rng.standard_normal((plan.flights, 3))
    flight = np.minimum(strip * plan.flights // plan.strips, plan.flights - 1)
    sigma, sigma_rad = np.array(plan.gnss_sigma_m), float(np.radians(plan.attitude_sigma_deg))
    gnss = centres - offset[flight] + sigma * rng.standard_normal(centres.shape)
    attitude = _turned(rotations, sigma_rad * rng.standard_normal(centres.shape))
    interval_s = (1 - plan.forward_overlap) * plan.height_px * plan.gsd_m / plan.speed_m_s
    seconds = np.arange(len(strip)) * interval_s + 20.0 * strip + 1200.0 * flight
    photographs = tuple(
        Photograph(
            name=f"sim_{i + 1:04d}.JPG", camera=0, flight=str(flight[i] + 1),
            time=_START + timedelta(seconds=float(seconds[i])), gnss_world_m=gnss[i], gnss_sigma_m=sigma,
            attitude_world_from_camera=attitude[i], attitude_sigma_rad=sigma_rad,
        )
        for i in range(len(strip))
    )  # fmt: skip
    poses = tuple(Pose(R, C) for R, C in zip(rotations, centres, strict=True))
    return _Flight(plan, camera, approximate, poses, photographs, {str(f + 1): v for f, v in enumerate(offset)})


def _footprints(flight: _Flight, height_m: float) -> FloatArray:
    """Return where the corners (N, 4, 2) of photographs meet level ground. Raises ValueError above the horizon."""
    direction = np.column_stack([flight.corners, np.ones(4)]) @ np.swapaxes(flight.rotations, 1, 2)
    if np.any(direction[..., 2] > -0.1 * np.linalg.norm(direction, axis=2)):
        raise ValueError(f"photographs look at the horizon: reduce oblique_angle_deg = {flight.plan.oblique_angle_deg}")
    centre = flight.centres[:, None]
    return np.asarray((centre + direction * ((height_m - centre[..., 2:]) / direction[..., 2:]))[..., :2])


def _seen(flight: _Flight, points: FloatArray, margin_px: float, scene: Scene | None) -> tuple[BoolArray, FloatArray]:
    """Return which photographs show which points (N, P), and where (N, P, 2); without a scene nothing is hidden."""
    shape = (len(flight.poses), len(points))
    pixel = np.array([project(flight.camera, pose, points) for pose in flight.poses]).reshape(*shape, 2)
    ray = np.array([pose.camera_from_world(points) for pose in flight.poses]).reshape(*shape, 3)
    seen = flight.contains(pixel, ray, margin_px)
    if scene is not None:
        seen &= np.array([visible(scene, pose, points) for pose in flight.poses]).reshape(shape)
    return seen, pixel


def _candidates(flight: _Flight, rng: np.random.Generator) -> FloatArray:
    """Return places (K, 2) in and around the photographed area where a ground point might go."""
    corners = _footprints(flight, 0.0).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    spacing = max(1.5, float(np.max(high - low)) / 70)
    x, y = (np.arange(low[k], high[k] + spacing, spacing) for k in (0, 1))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(grid + rng.uniform(-0.3, 0.3, grid.shape) * spacing)


def _place_control(plan: SurveyPlan, candidate: FloatArray, seen: BoolArray) -> FloatArray:
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
        raise ValueError(f"no room for {wanted} control and check points: reduce their number, or photograph more")
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


def _measure_control(
    plan: SurveyPlan, position: FloatArray, seen: BoolArray, pixel: FloatArray, rng: np.random.Generator
) -> ControlPoints:
    """Survey the points at true positions (G, 3), and mark them where they are seen (N, G) at true pixels (N, G, 2)."""
    point, photograph = np.nonzero(seen.T)
    mark = pixel[photograph, point] + plan.mark_sigma_px * rng.standard_normal((len(point), 2))
    sigma = np.array(plan.control_sigma_m)
    surveyed = position + sigma * rng.standard_normal(position.shape)
    control: list[Role] = ["control"] * plan.control_points
    check: list[Role] = ["check"] * plan.check_points
    names = (*(f"G{i + 1:02d}" for i in range(len(control))), *(f"C{i + 1:02d}" for i in range(len(check))))
    if plan.blunder_point is not None:
        if plan.blunder_point not in names:
            raise ValueError(f"blunder_point: no point is called {plan.blunder_point!r}; they are {', '.join(names)}")
        surveyed[names.index(plan.blunder_point), 2] += plan.control_height_blunder_m
    return ControlPoints(
        name=names,
        role=(*control, *check),
        position_world_m=surveyed,
        sigma_m=np.tile(sigma, (len(names), 1)),
        mark_photograph=photograph.astype(np.int64),
        mark_point=point.astype(np.int64),
        mark_pixel=np.rint(mark) if plan.whole_pixel_marks else mark,
        mark_sigma_px=np.full(len(point), plan.stated_mark_sigma_px),
    )


def _require_marks(flight: _Flight, seen: BoolArray) -> None:
    marks = seen[:, : flight.plan.control_points].sum(axis=1)
    fewest, wanted = int(np.argmin(marks)), flight.plan.control_marks_per_photograph
    if marks[fewest] < wanted:
        raise ValueError(
            f"photograph {flight.photographs[fewest].name} sees {marks[fewest]} of {flight.plan.control_points} "
            f"control points, the plan asks for {wanted}: raise control_points"
        )


def simulate(plan: SurveyPlan, seed: int) -> SimulatedSurvey:
    """Fly and measure a plan over a made site; the photographs themselves come from ``render_photographs``.

    Marks are what the photographs show: points outside of them or hidden by the scene have none. Raises ValueError when
    a photograph sees too few control points for the plan, or looks above the horizon.
    """
    rng = np.random.default_rng([seed, 0])
    flight = _fly(plan, rng)
    reach = np.abs(_footprints(flight, -plan.relief_m)).max()
    site = (float(np.ceil(2 * reach / 10 + 1) * 10), plan.cell_m, plan.relief_m, plan.buildings, plan.trees)
    bare = make_scene(seed, *site, finest_wavelength_m=2 * plan.gsd_m)
    place = _candidates(flight, rng)
    place = place[bare.open_ground(place, target_reach(bare, plan.target_radius_m))]
    candidate = np.column_stack([place, bare.height(place)])
    ground = _place_control(plan, candidate, _seen(flight, candidate, 25.0, bare)[0])
    scene = paint_targets(bare, ground[:, :2], plan.target_radius_m)
    position = scene.targets_world_m
    seen, pixel = _seen(flight, position, 1.5 * plan.target_radius_m / plan.gsd_m, scene)
    _require_marks(flight, seen)
    control = _measure_control(plan, position, seen, pixel, rng)
    truth = Truth(flight.camera, flight.poses, position, flight.gnss_offset)
    return SimulatedSurvey(plan, seed, plan.frame, scene, flight.approximate, flight.photographs, control, truth)


def render_photographs(survey: SimulatedSurvey, *, noise_dn: float = 2.0) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yield the name and the pixels (height_px, width_px, 3), red, green, blue, of each photograph of a survey."""
    for number, (photograph, pose) in enumerate(zip(survey.photographs, survey.truth.poses, strict=True)):
        noise = survey.seed * 100_003 + number
        yield photograph.name, render(survey.scene, survey.truth.camera, pose, seed=noise, noise_dn=noise_dn)


def truth_surface(survey: SimulatedSurvey, cell_m: float) -> Raster:
    """Return the surface of the whole site in the map frame, roofs and trees included; NaN off the site."""
    return surface_raster(survey.scene, survey.frame, cell_m)


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def _project_pairs(q: FloatArray, R: FloatArray, C: FloatArray, X: FloatArray, i: IntArray, p: IntArray) -> FloatArray:
    pixel = np.empty((len(p), 2))
    for n in range(len(p)):
        pixel[n, 0], pixel[n, 1], _ = project_point(q, R[i[n]], C[i[n]], X[p[n]])
    return pixel


def _observe(flight: _Flight, points: FloatArray, margin_px: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Return photograph, point and true pixel of every observation, sorted by point, then photograph."""
    corners, relief, height = _footprints(flight, 0.0), flight.plan.relief_m, flight.plan.flying_height_m
    centre = corners.mean(axis=1)
    widening = height / max(height - relief, 0.2 * height)
    reach = widening * float(np.linalg.norm(corners - centre[:, None], axis=2).max()) + relief
    near = cKDTree(points[:, :2]).sparse_distance_matrix(cKDTree(centre), reach, output_type="ndarray")
    order = np.lexsort((near["j"], near["i"]))
    point, photograph = near["i"][order].astype(np.int64), near["j"][order].astype(np.int64)
    R, C = flight.rotations, flight.centres
    pixel = _project_pairs(flight.camera.parameters, R, C, points, photograph, point)
    ray = np.einsum("nij,ni->nj", R[photograph], points[point] - C[photograph])
    keep = flight.contains(pixel, ray, margin_px)
    return photograph[keep], point[keep], pixel[keep]


def _displaced(pixel: FloatArray, camera: Camera, rng: np.random.Generator) -> FloatArray:
    """Move pixels (N, 2) by 10 to 300 px, log-uniformly, in any direction that stays within the photograph."""
    last = np.array([camera.width_px, camera.height_px]) - 1.0
    length = np.exp(rng.uniform(np.log(10.0), np.log(min(300.0, last.min() / 2.5)), len(pixel)))
    angle = rng.uniform(0.0, 2 * np.pi, len(pixel))
    step = length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(np.where((pixel + step < 0) | (pixel + step > last), pixel - step, pixel + step))


def simulate_block(
    plan: SurveyPlan,
    seed: int,
    *,
    tie_points: int = 2000,
    sigma_px: float = 0.5,
    mismatches: float = 0.0,
    detection: float = 1.0,
    start_position_sigma_m: float = 1.0,
    start_attitude_sigma_deg: float = 1.0,
    start_point_sigma_m: float = 1.0,
) -> SimulatedBlock:
    """Make the observations of a block over the bare terrain, nothing hidden, with perturbed starting values.

    Each photograph that shows a tie point observes it with the probability ``detection``, and with noise ``sigma_px``
    per coordinate; points with one ray only are left out. The fraction ``mismatches`` of all observations is displaced
    by 10 to 300 px. Poses and tie points start at the truth with the errors stated. Raises ValueError as ``simulate``
    does, and when the photographs do not overlap.
    """
    rng = np.random.default_rng([seed, 2])
    flight = _fly(plan, rng)
    place = _candidates(flight, rng)
    candidate = np.column_stack([place, terrain_height(seed, plan.relief_m, place)])
    ground = _place_control(plan, candidate, _seen(flight, candidate, 25.0, None)[0])
    seen, pixel = _seen(flight, ground, 5 * plan.stated_mark_sigma_px, None)
    _require_marks(flight, seen)
    control = _measure_control(plan, ground, seen, pixel, rng)
    ties, position, mismatch = _tie_points(flight, seed, tie_points, sigma_px, mismatches, detection, rng)
    start = replace(ties, position_world_m=position + start_point_sigma_m * rng.standard_normal(position.shape))
    moved = flight.centres + start_position_sigma_m * rng.standard_normal((len(flight.poses), 3))
    noise_rad = np.radians(start_attitude_sigma_deg) * rng.standard_normal(moved.shape)
    block = Block(
        frame=plan.frame,
        cameras=(flight.approximate,),
        photographs=flight.photographs,
        poses=tuple(Pose(R, C) for R, C in zip(_turned(flight.rotations, noise_rad), moved, strict=True)),
        tie_points=start,
        control_points=control,
        gnss_offset_sigma_m=np.array(plan.gnss_offset_sigma_m),
    )
    truth = Truth(flight.camera, flight.poses, ground, flight.gnss_offset)
    return SimulatedBlock(plan, seed, block, truth, position, mismatch)


def _tie_points(
    flight: _Flight,
    seed: int,
    wanted: int,
    sigma_px: float,
    mismatches: float,
    detection: float,
    rng: np.random.Generator,
) -> tuple[TiePoints, FloatArray, BoolArray]:
    """Return tie points of unknown position, their true positions (P, 3), and which observations are mismatches."""
    corners = _footprints(flight, 0.0).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    drawn = max(200, int(1.5 * wanted))
    for _ in range(6):
        xy = rng.uniform(low, high, (drawn, 2))
        points = np.column_stack([xy, terrain_height(seed, flight.plan.relief_m, xy)])
        photograph, point, pixel = _observe(flight, points, 5 * sigma_px)
        keep = rng.random(len(point)) < detection
        photograph, point, pixel = photograph[keep], point[keep], pixel[keep]
        enough = np.flatnonzero(np.bincount(point, minlength=drawn) >= 2)
        if len(enough) >= wanted:
            break
        drawn *= 2
    else:
        raise ValueError(f"only {len(enough)} of {wanted} tie points lie in two photographs: raise the overlap")
    number = np.full(drawn, -1, np.int64)
    number[enough[:wanted]] = np.arange(wanted)
    keep = number[point] >= 0
    photograph, point, pixel = photograph[keep], number[point[keep]], pixel[keep]
    n = len(point)
    mismatch = rng.permutation(n) < round(mismatches * n)
    observed = pixel + sigma_px * rng.standard_normal((n, 2))
    observed[mismatch] = _displaced(observed[mismatch], flight.camera, rng)
    feature = np.empty(n, np.int64)
    order = np.argsort(photograph, kind="stable")
    feature[order] = np.arange(n) - np.searchsorted(photograph[order], photograph[order])
    ties = TiePoints(
        photograph, point, feature, observed, np.full(n, float(sigma_px)), np.full((wanted, 3), np.nan),
        np.full((wanted, 3), 128, np.uint8),
    )  # fmt: skip
    return ties, points[enough[:wanted]], mismatch
