"""Surveys with known truth: flown, measured and photographed on a made site, from a seed and nothing else.

``simulate`` makes a small survey with a scene that can be rendered; ``simulate_block`` makes the observations of a block
of hundreds of photographs without rendering, on the bare terrain. Every error added has a stated standard deviation:

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
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, image_plane, project, project_point
from photogram.frames import LocalFrame
from photogram.rendering import render, visible
from photogram.scene import Scene, make_scene, paint_targets, terrain_height
from photogram.survey import Block, ControlPoints, Photograph, Raster, Role, TiePoints

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_START = datetime(2024, 6, 12, 10, 0, tzinfo=UTC)
_WHOLE_PIXEL_SIGMA_PX = 12**-0.5


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
    def stated_mark_sigma_px(self) -> float:
        """Return the standard deviation of a mark, rounding included."""
        return float(np.hypot(self.mark_sigma_px, _WHOLE_PIXEL_SIGMA_PX if self.whole_pixel_marks else 0.0))


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulated survey tried to find out, in the world frame; ``gnss_offset_world_m`` by flight."""

    camera: Camera
    poses: tuple[Pose, ...]
    control_position_world_m: FloatArray
    gnss_offset_world_m: dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class SimulatedSurvey:
    """A survey with its scene: what a surveyor holds (approximate camera, photographs, control points), and the truth."""

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
    """A block of observations with starting values, and the truth.

    ``tie_point_position_world_m`` (P, 3) and ``mismatch`` (N,), the observations that were displaced, belong to the tie
    points of the block.
    """

    plan: SurveyPlan
    seed: int
    block: Block
    truth: Truth
    tie_point_position_world_m: FloatArray
    mismatch: BoolArray


def demonstration_plan() -> SurveyPlan:
    """Return the plan of the built-in demonstration: twelve photographs, their control marks read to whole pixels."""
    return SurveyPlan(control_marks_per_photograph=4, mark_sigma_px=0.0, whole_pixel_marks=True)


def _cameras(plan: SurveyPlan, rng: np.random.Generator) -> tuple[Camera, Camera]:
    """Return the true and the approximate camera."""
    centre = (np.array([plan.width_px, plan.height_px]) - 1) / 2
    camera = Camera(
        "simulated", plan.width_px, plan.height_px, plan.focal_px, centre + plan.principal_point_offset_px,
        np.array(plan.radial), np.array(plan.tangential),
    )  # fmt: skip
    sigmas = np.array(plan.calibration_sigmas)
    error = np.where(np.isfinite(sigmas), sigmas, 0.0) * rng.standard_normal(8)
    return camera, replace(camera.with_parameters(camera.parameters + error), sigmas=sigmas)


def _turned(rotation: FloatArray, noise_rad: FloatArray) -> FloatArray:
    return np.asarray(rotation @ Rotation.from_rotvec(noise_rad).as_matrix())


def _fly(plan: SurveyPlan, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, IntArray]:
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
        across = np.array([offset, 0.0, plan.flying_height_m])
        setback = np.tan(tilt) * plan.flying_height_m
        axis = np.cos(tilt) * down + np.sin(tilt) * forward
        rotations += [np.column_stack([right, np.cross(axis, right), axis])] * len(along)
        centres.append(across + (along[:, None] - setback) * forward)
    position = np.concatenate(centres)
    position += plan.position_noise_m * rng.standard_normal(position.shape)
    noise = np.radians(plan.attitude_noise_deg) * rng.standard_normal(position.shape)
    return _turned(np.array(rotations), noise), position, np.repeat(np.arange(len(courses)), len(along))


def _photographs(
    plan: SurveyPlan, poses: tuple[Pose, ...], strip: IntArray, rng: np.random.Generator
) -> tuple[tuple[Photograph, ...], dict[str, FloatArray]]:
    """Return the photographs as their tags describe them, and the true GNSS offset of each flight."""
    offset = np.array(plan.gnss_offset_sigma_m) * rng.standard_normal((plan.flights, 3))
    flight = np.minimum(strip * plan.flights // plan.strips, plan.flights - 1)
    position = np.array([pose.position_world_m for pose in poses])
    sigma = np.array(plan.gnss_sigma_m)
    gnss = position - offset[flight] + sigma * rng.standard_normal(position.shape)
    rotations = np.array([pose.rotation_world_from_camera for pose in poses])
    attitude_sigma_rad = float(np.radians(plan.attitude_sigma_deg))
    attitude = _turned(rotations, attitude_sigma_rad * rng.standard_normal(position.shape))
    interval = timedelta(seconds=(1 - plan.forward_overlap) * plan.height_px * plan.gsd_m / plan.speed_m_s)
    photographs = tuple(
        Photograph(
            name=f"sim_{i + 1:04d}",
            camera=0,
            flight=str(flight[i] + 1),
            time=_START + i * interval + 20 * strip[i] * timedelta(seconds=1) + flight[i] * timedelta(minutes=20),
            gnss_world_m=gnss[i],
            gnss_sigma_m=sigma,
            attitude_world_from_camera=attitude[i],
            attitude_sigma_rad=attitude_sigma_rad,
        )
        for i in range(len(poses))
    )
    return photographs, {str(f + 1): offset[f] for f in range(plan.flights)}


def _footprints(plan: SurveyPlan, camera: Camera, poses: tuple[Pose, ...], height_m: float) -> FloatArray:
    """Return where the corners (N, 4, 2) of photographs meet level ground. Raises ValueError above the horizon."""
    w, h = camera.width_px - 1.0, camera.height_px - 1.0
    ideal = image_plane(camera, np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]))
    ray = np.column_stack([ideal, np.ones(4)])
    direction = np.array([ray @ pose.rotation_world_from_camera.T for pose in poses])
    centre = np.array([pose.position_world_m for pose in poses])[:, None]
    if np.any(direction[..., 2] > -0.1 * np.linalg.norm(direction, axis=2)):
        raise ValueError(f"photographs look above the horizon: reduce oblique_angle_deg = {plan.oblique_angle_deg}")
    return np.asarray((centre + direction * ((height_m - centre[..., 2:]) / direction[..., 2:]))[..., :2])


def _seen(
    camera: Camera, poses: tuple[Pose, ...], points: FloatArray, margin_px: float
) -> tuple[BoolArray, FloatArray]:
    """Return which photographs hold which points (N, P) ``margin_px`` or more off their edge, and where (N, P, 2)."""
    pixel = np.array([project(camera, pose, points) for pose in poses]).reshape(len(poses), len(points), 2)
    limit = np.array([camera.width_px, camera.height_px]) - 1 - margin_px
    return np.all((pixel >= margin_px) & (pixel <= limit), axis=2), pixel


def _shown(
    scene: Scene, camera: Camera, poses: tuple[Pose, ...], points: FloatArray, margin_px: float
) -> tuple[BoolArray, FloatArray]:
    """Return the same as _seen, for points that the scene does not hide."""
    seen, pixel = _seen(camera, poses, points, margin_px)
    return seen & np.array([visible(scene, pose, points) for pose in poses]).reshape(seen.shape), pixel


def _candidates(
    plan: SurveyPlan, camera: Camera, poses: tuple[Pose, ...], rng: np.random.Generator
) -> FloatArray:
    """Return places (K, 2) in and around the photographed area where a ground point might go."""
    corners = _footprints(plan, camera, poses, 0.0).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    spacing = max(1.5, float(np.max(high - low)) / 70)
    x, y = (np.arange(low[k], high[k] + spacing, spacing) for k in (0, 1))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(grid + rng.uniform(-0.3, 0.3, grid.shape) * spacing)


def _place_control(plan: SurveyPlan, candidate: FloatArray, seen: BoolArray) -> FloatArray:
    """Choose control, then check points (G, 3) among candidates (K, 3), seen (N, K) by the photographs.

    Each point in turn goes where it is farthest from those that stand, corners and edges first; places that help
    photographs which still lack control marks count for more. Raises ValueError when there is no room.
    """
    wanted = plan.control_points + plan.check_points
    rays = seen.sum(axis=0)
    usable = rays >= min(3, max(1, rays.max(initial=0)))
    candidate, seen = candidate[usable], seen[:, usable]
    if len(candidate) < wanted:
        raise ValueError(f"no room for {wanted} control and check points: reduce their number, or photograph more")
    low = candidate.min(axis=0, initial=np.inf)
    distance = -np.linalg.norm(candidate[:, :2] - low[:2], axis=1)
    distance -= distance.min(initial=0.0)
    chosen: list[int] = []
    lacking = np.full(len(seen), plan.control_marks_per_photograph)
    for number in range(wanted):
        gain = 1 + 0.5 * seen[lacking > 0].sum(axis=0) if number < plan.control_points else np.ones(len(candidate))
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
    control, check = range(plan.control_points), range(plan.check_points)
    names = tuple([f"G{i + 1:02d}" for i in control] + [f"C{i + 1:02d}" for i in check])
    roles: list[Role] = ["control"] * plan.control_points + ["check"] * plan.check_points
    if plan.blunder_point is not None:
        if plan.blunder_point not in names:
            raise ValueError(f"blunder_point: no point is called {plan.blunder_point!r}; they are {', '.join(names)}")
        surveyed[names.index(plan.blunder_point), 2] += plan.control_height_blunder_m
    return ControlPoints(
        name=names,
        role=tuple(roles),
        position_world_m=surveyed,
        sigma_m=np.tile(sigma, (len(names), 1)),
        mark_photograph=photograph.astype(np.int64),
        mark_point=point.astype(np.int64),
        mark_pixel=np.rint(mark) if plan.whole_pixel_marks else mark,
        mark_sigma_px=np.full(len(point), plan.stated_mark_sigma_px),
    )


def _require_marks(plan: SurveyPlan, photographs: tuple[Photograph, ...], seen: BoolArray) -> None:
    marks = seen[:, : plan.control_points].sum(axis=1)
    fewest = int(np.argmin(marks))
    if marks[fewest] < plan.control_marks_per_photograph:
        raise ValueError(
            f"photograph {photographs[fewest].name} sees {marks[fewest]} of {plan.control_points} control points, "
            f"the plan asks for {plan.control_marks_per_photograph}: raise control_points"
        )


def simulate(plan: SurveyPlan, seed: int) -> SimulatedSurvey:
    """Fly and measure a plan over a made site; the photographs themselves come from ``render_photographs``.

    Marks are what the photographs show: points outside of them or hidden by the scene have none. Raises ValueError when
    a photograph sees too few control points for the plan, or looks above the horizon.
    """
    rng = np.random.default_rng([seed, 0])
    camera, approximate = _cameras(plan, rng)
    rotations, centres, strip = _fly(plan, rng)
    poses = tuple(Pose(R, C) for R, C in zip(rotations, centres, strict=True))
    photographs, offset = _photographs(plan, poses, strip, rng)
    reach = np.abs(_footprints(plan, camera, poses, -plan.relief_m)).max()
    bare = make_scene(
        seed,
        float(np.ceil(2 * reach / 10 + 1) * 10),
        plan.cell_m,
        plan.relief_m,
        plan.buildings,
        plan.trees,
        finest_wavelength_m=2 * plan.gsd_m,
    )
    place = _candidates(plan, camera, poses, rng)
    place = place[bare.open_ground(place, 4 * plan.target_radius_m)]
    candidate = np.column_stack([place, bare.height(place)])
    seen, _ = _shown(bare, camera, poses, candidate, 25.0)
    ground = _place_control(plan, candidate, seen)
    scene = paint_targets(bare, ground[:, :2], plan.target_radius_m)
    position = scene.targets_world_m
    seen, pixel = _shown(scene, camera, poses, position, 1.5 * plan.target_radius_m / plan.gsd_m)
    _require_marks(plan, photographs, seen)
    control = _measure_control(plan, position, seen, pixel, rng)
    frame = LocalFrame(plan.crs, plan.origin_map_m)
    truth = Truth(camera, poses, position, offset)
    return SimulatedSurvey(plan, seed, frame, scene, approximate, photographs, control, truth)


def render_photographs(survey: SimulatedSurvey, *, noise_dn: float = 2.0) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yield the name and the pixels (height_px, width_px, 3), red, green, blue, of each photograph of a survey."""
    for number, (photograph, pose) in enumerate(zip(survey.photographs, survey.truth.poses, strict=True)):
        seed = survey.seed * 100_003 + number
        yield photograph.name, render(survey.scene, survey.truth.camera, pose, seed=seed, noise_dn=noise_dn)


def truth_surface(survey: SimulatedSurvey, cell_m: float) -> Raster:
    """Return the surface of the whole site, roofs and trees included, at the centres of map cells; NaN off the site.

    The vertical of the map is a straight line, slightly tilted, in the world frame: the height on it is found by
    fixed-point iteration, each step of which shrinks the error by the tilt times the slope of the surface.
    """
    west, south, east, north = survey.scene.extent_m
    outline = np.array([[x, y, 0.0] for x in (west, east) for y in (south, north)])
    low, high = (f(survey.frame.map_from_world(outline)[:, :2], axis=0) for f in (np.min, np.max))
    first, last = np.ceil(low / cell_m), np.floor(high / cell_m)
    columns, rows = (last - first).astype(int)
    easting = (first[0] + np.arange(columns) + 0.5) * cell_m
    northing = (last[1] - np.arange(rows) - 0.5) * cell_m
    level = np.full(rows * columns, survey.frame.origin_map_m[2])
    foot = np.column_stack([np.tile(easting, rows), np.repeat(northing, columns), level])
    world = survey.frame.world_from_map(foot)
    up = (survey.frame.world_from_map(foot + [0.0, 0.0, 100.0]) - world) / 100.0
    above = np.zeros(len(level))
    for _ in range(3):
        place = world + above[:, None] * up
        above = (survey.scene.height(place[:, :2]) - world[:, 2]) / up[:, 2]
    off = (world[:, 0] < west) | (world[:, 0] > east) | (world[:, 1] < south) | (world[:, 1] > north)
    height = np.where(off, np.nan, level + above).reshape(rows, columns).astype(np.float32)
    return Raster(height, float(first[0] * cell_m), float(last[1] * cell_m), cell_m)


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def _project_pairs(
    q: FloatArray, R: FloatArray, C: FloatArray, X: FloatArray, photograph: IntArray, point: IntArray
) -> FloatArray:
    pixel = np.empty((len(point), 2))
    for n in range(len(point)):
        pixel[n, 0], pixel[n, 1], _ = project_point(q, R[photograph[n]], C[photograph[n]], X[point[n]])
    return pixel


def _observe(
    plan: SurveyPlan, camera: Camera, poses: tuple[Pose, ...], points: FloatArray, margin_px: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return photograph, point and true pixel of every observation, sorted by point, then photograph."""
    corners = _footprints(plan, camera, poses, 0.0)
    centre = corners.mean(axis=1)
    climb = plan.flying_height_m / max(plan.flying_height_m - plan.relief_m, 0.2 * plan.flying_height_m)
    reach = climb * float(np.linalg.norm(corners - centre[:, None], axis=2).max())
    near = cKDTree(points[:, :2]).sparse_distance_matrix(cKDTree(centre), reach, output_type="ndarray")
    order = np.lexsort((near["j"], near["i"]))
    point, photograph = near["i"][order].astype(np.int64), near["j"][order].astype(np.int64)
    R = np.array([pose.rotation_world_from_camera for pose in poses])
    C = np.array([pose.position_world_m for pose in poses])
    pixel = _project_pairs(camera.parameters, R, C, points, photograph, point)
    limit = np.array([camera.width_px, camera.height_px]) - 1 - margin_px
    keep = np.all((pixel >= margin_px) & (pixel <= limit), axis=1)
    return photograph[keep], point[keep], pixel[keep]


def _displaced(pixel: FloatArray, camera: Camera, mismatch: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Move the mismatches by 10 to 300 px, log-uniformly, in any direction that stays within the photograph."""
    count = int(mismatch.sum())
    size = np.array([camera.width_px, camera.height_px])
    length = np.exp(rng.uniform(np.log(10.0), np.log(min(300.0, size.min() / 2.5)), count))
    angle = rng.uniform(0.0, 2 * np.pi, count)
    step = length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    moved = pixel[mismatch] + step
    result = pixel.copy()
    result[mismatch] = np.where((moved < 0) | (moved > size - 1), moved - 2 * step, moved)
    return result


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
    camera, approximate = _cameras(plan, rng)
    rotations, centres, strip = _fly(plan, rng)
    poses = tuple(Pose(R, C) for R, C in zip(rotations, centres, strict=True))
    photographs, offset = _photographs(plan, poses, strip, rng)
    place = _candidates(plan, camera, poses, rng)
    candidate = np.column_stack([place, terrain_height(seed, plan.relief_m, place)])
    ground = _place_control(plan, candidate, _seen(camera, poses, candidate, 25.0)[0])
    seen, pixel = _seen(camera, poses, ground, 5 * plan.stated_mark_sigma_px)
    _require_marks(plan, photographs, seen)
    control = _measure_control(plan, ground, seen, pixel, rng)
    ties, position, mismatch = _tie_points(plan, seed, camera, poses, tie_points, sigma_px, mismatches, detection, rng)
    start = replace(ties, position_world_m=position + start_point_sigma_m * rng.standard_normal(position.shape))
    turned = _turned(rotations, np.radians(start_attitude_sigma_deg) * rng.standard_normal(centres.shape))
    moved = centres + start_position_sigma_m * rng.standard_normal(centres.shape)
    block = Block(
        frame=LocalFrame(plan.crs, plan.origin_map_m),
        cameras=(approximate,),
        photographs=photographs,
        poses=tuple(Pose(R, C) for R, C in zip(turned, moved, strict=True)),
        tie_points=start,
        control_points=control,
        gnss_offset_sigma_m=np.array(plan.gnss_offset_sigma_m),
    )
    return SimulatedBlock(plan, seed, block, Truth(camera, poses, ground, offset), position, mismatch)


def _tie_points(
    plan: SurveyPlan,
    seed: int,
    camera: Camera,
    poses: tuple[Pose, ...],
    wanted: int,
    sigma_px: float,
    mismatches: float,
    detection: float,
    rng: np.random.Generator,
) -> tuple[TiePoints, FloatArray, BoolArray]:
    """Return tie points of unknown position, their true positions (P, 3), and which observations are mismatches."""
    corners = _footprints(plan, camera, poses, 0.0).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    drawn = max(200, int(1.5 * wanted))
    for _ in range(6):
        xy = rng.uniform(low, high, (drawn, 2))
        points = np.column_stack([xy, terrain_height(seed, plan.relief_m, xy)])
        photograph, point, pixel = _observe(plan, camera, poses, points, 5 * sigma_px)
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
    mismatch = np.zeros(n, dtype=bool)
    mismatch[rng.choice(n, round(mismatches * n), replace=False)] = True
    observed = _displaced(pixel + sigma_px * rng.standard_normal((n, 2)), camera, mismatch, rng)
    feature = np.empty(n, np.int64)
    order = np.argsort(photograph, kind="stable")
    first = np.searchsorted(photograph[order], np.arange(len(poses)))
    feature[order] = np.arange(n) - first[photograph[order]]
    ties = TiePoints(
        photograph, point, feature, observed, np.full(n, float(sigma_px)), np.full((wanted, 3), np.nan),
        np.full((wanted, 3), 128, np.uint8),
    )  # fmt: skip
    return ties, points[enough[:wanted]], mismatch
