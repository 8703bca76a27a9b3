"""A flight before it is flown: strips, photographs, control points and what they would observe.

The plan is a surveyor's: a site, a ground sampling distance, overlaps. From it follow the courses, and with a seed the
poses as flown, the terrain, tie points and marks: without errors for a prediction, with them for a survey that puts the
prediction to the test.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.errors import check_range
from photogram.geodesy.frames import LocalFrame
from photogram.gnss import RTK_OFFSET_SIGMA_M
from photogram.measures.mark_covariances import isotropic_px2
from photogram.projection import CAMERA_PARAMETERS, K1, K2, K3, P1, P2, READOUT
from photogram.quality.flight_lines import Course, flown
from photogram.settings.settings import Default, Settings, Within, settings_of
from photogram.simulation.flight import Flight, Truth, footprints, observe, sight_ground, turned
from photogram.simulation.scene import terrain_height
from photogram.simulation.survey_plan import CONSUMER_GNSS_SIGMA_M, RTK_GNSS_SIGMA_M, SurveyPlan
from photogram.survey import Block, ControlPoints, Photograph, Role, TiePoints

Vector = tuple[float, float, float]
Gnss = Literal["rtk", "consumer", "none"]
Layout = Literal["corners", "edges", "grid", "centre"]

GNSS_SIGMA_M: dict[Gnss, Vector] = {"rtk": RTK_GNSS_SIGMA_M, "consumer": CONSUMER_GNSS_SIGMA_M}
GNSS_OFFSET_SIGMA_M: dict[Gnss, Vector] = {"rtk": RTK_OFFSET_SIGMA_M, "consumer": (1.0, 1.0, 2.0)}
INSET = 0.04  # of the site's sides, by which control points keep off its edges
MOST_OBSERVATIONS = 120_000  # of tie points, that a prediction can handle
MOST_PHOTOGRAPHS = 2000
ATTITUDE_NOISE_DEG, POSITION_NOISE_M = 1.5, 0.5  # how exactly a drone keeps to its plan
MOST_CONTROL = 500  # control points

FRAME = LocalFrame("EPSG:25832", (500_000.0, 5_800_000.0, 0.0), "grid")


@dataclass(frozen=True)
class Calibration:
    """The prior sigmas of a camera's parameters; 0 holds one fixed, infinity leaves it free."""

    focal_px: float = 15.0
    principal_point_px: float = 10.0
    k1: float = CAMERA_PARAMETERS[K1].ordinary
    k2: float = CAMERA_PARAMETERS[K2].ordinary
    k3: float = CAMERA_PARAMETERS[K3].ordinary
    p1: float = CAMERA_PARAMETERS[P1].ordinary
    p2: float = CAMERA_PARAMETERS[P2].ordinary

    @property
    def sigmas(self) -> FloatArray:
        """Return the sigmas (12,) in the order of PARAMETER_NAMES."""
        return np.array([getattr(self, p.sigma_key, 0.0) for p in CAMERA_PARAMETERS])


@dataclass(frozen=True)
class FlightPlan(Settings):
    """A flight over a rectangle centred at (0, 0), with sides to east and north.

    Strips run along the longer side, from edge to edge; the image width is across the direction of flight. Give
    ``gsd_m`` or ``flying_height_m``, one follows from the other; without both the ground sampling distance is 2 cm.
    """

    width_m: Annotated[float, Within(1, 100_000, "m"), "Extent of the site to the east."] = 200.0
    length_m: Annotated[float, Within(1, 100_000, "m"), "Extent of the site to the north."] = 300.0
    relief_m: Annotated[float, Within(0, 9000, "m"), "Relief from valley to hill."] = 10.0
    width_px: Annotated[int, Within(100, 200_000, "px"), "Width of the photographs."] = 5472
    height_px: Annotated[int, Within(100, 200_000, "px"), "Height of the photographs."] = 3648
    focal_px: Annotated[float, Within(10, 1_000_000, "px"), "Focal length."] = 3660.0
    calibration: Annotated[Calibration, "Prior sigmas of the calibration."] = Calibration()
    gsd_m: Annotated[
        float | None, Within(0.0001, 100, "m"), "Ground sampling distance.", Default("2 cm, or by the flying height")
    ] = None
    flying_height_m: Annotated[
        float | None,
        Within(1, 50_000, "m"),
        "Flying height above mean ground.",
        Default("by the ground sampling distance"),
    ] = None
    forward_overlap: Annotated[float, Within(0, 0.97), "Forward overlap, 0 to 1."] = 0.8
    side_overlap: Annotated[float, Within(0, 0.97), "Side overlap, 0 to 1."] = 0.7
    cross_strips: Annotated[int, Within(0, 200), "Number of strips across the others."] = 0
    cross_height: Annotated[float, Within(0.3, 3), "Their flying height over that of the others."] = 1.2
    oblique_strips: Annotated[int, Within(0, 200), "Number of oblique strips along the longer side."] = 0
    oblique_angle_deg: Annotated[float, Within(1, 45, "°"), "Their forward tilt."] = 25.0
    gnss: Annotated[Gnss, "Kind of GNSS positions."] = "rtk"
    gnss_sigma_m: Annotated[Vector | None, "Their sigmas.", Default("those of the kind")] = None
    gnss_offset_sigma_m: Annotated[Vector | None, "Sigmas of the GNSS offset.", Default("those of the kind")] = None
    control_points: Annotated[
        int, Within(0, MOST_CONTROL), "Number of control points laid out by `control_layout`."
    ] = 5
    control_layout: Annotated[Layout, "Their layout."] = "corners"
    control_world_m: Annotated[
        tuple[tuple[float, float], ...], "Further control points: east, north from the centre of the site."
    ] = ()
    control_sigma_m: Annotated[Vector, "Sigmas of the control points."] = (0.01, 0.01, 0.015)
    mark_sigma_px: Annotated[float, Within(0.001, 1000, "px"), "Standard deviation of the marks."] = 0.5
    tie_points_per_photograph: Annotated[int, Within(20, 10_000), "Tie points per photograph."] = 300
    tie_point_sigma_px: Annotated[float, Within(0.001, 100, "px"), "Standard deviation of their pixels."] = 0.5
    tie_point_detection: Annotated[
        float, Within(0.05, 1), "Share of the photographs showing a tie point in which it is found."
    ] = 0.5

    def __post_init__(self) -> None:
        if self.gsd_m is not None and self.flying_height_m is not None:
            raise ValueError("give gsd_m or flying_height_m, not both: one follows from the other")
        super().__post_init__()
        check_range("the number of control points", self.control, 0, MOST_CONTROL)
        if not self.height_m > 2 * self.relief_m:
            raise ValueError(
                f"a flying height of {self.height_m:.0f} m is too low for a relief of {self.relief_m:g} m: "
                "give a larger gsd_m or flying_height_m"
            )
        # counted roughly first: a slip of the pen would make millions of strips
        photographs = math.ceil(self.width_m / self.strip_distance_m) * math.ceil(self.length_m / self.base_m)
        if photographs <= MOST_PHOTOGRAPHS:
            photographs = self.photographs
        if photographs > MOST_PHOTOGRAPHS:
            raise ValueError(
                f"{photographs} photographs are more than the {MOST_PHOTOGRAPHS} that a prediction can handle: "
                "predict a part of the site, or give a larger gsd_m"
            )
        if self.gnss == "none" and self.control < 3:
            raise ValueError(
                f"without GNSS, control points alone define the datum: give 3 at least, not {self.control}"
            )

    @property
    def height_m(self) -> float:
        """Return the flying height above the mean ground."""
        if self.flying_height_m is not None:
            return self.flying_height_m
        return (0.02 if self.gsd_m is None else self.gsd_m) * self.focal_px

    @property
    def ground_sampling_m(self) -> float:
        """Return the size of a pixel on the ground."""
        return self.height_m / self.focal_px

    @property
    def base_m(self) -> float:
        """Return the distance between neighbouring photographs of a strip."""
        return (1 - self.forward_overlap) * self.height_px * self.ground_sampling_m

    @property
    def strip_distance_m(self) -> float:
        """Return the distance between neighbouring strips."""
        return (1 - self.side_overlap) * self.width_px * self.ground_sampling_m

    @property
    def control(self) -> int:
        """Return the number of control points."""
        return self.control_points + len(self.control_world_m)

    @property
    def photographs(self) -> int:
        """Return the number of photographs."""
        return sum(course.photographs for course in courses(self))

    @property
    def gnss_sigmas_m(self) -> Vector | None:
        """Return the sigmas of GNSS positions, None without GNSS."""
        return self.gnss_sigma_m or GNSS_SIGMA_M.get(self.gnss)

    @property
    def offset_sigmas_m(self) -> Vector:
        """Return the sigmas of the offset between GNSS and ground control."""
        return self.gnss_offset_sigma_m or GNSS_OFFSET_SIGMA_M.get(self.gnss, (0.0, 0.0, 0.0))

    @property
    def camera(self) -> Camera:
        """Return the camera as it is known before the flight."""
        middle = np.array([(self.width_px - 1) / 2, (self.height_px - 1) / 2])
        return Camera("planned", self.width_px, self.height_px, self.focal_px, middle, sigmas=self.calibration.sigmas)


RANGES = {setting.name: setting.within for setting in settings_of(FlightPlan) if setting.within}
"""What the figures of a FlightPlan may be."""


def courses(plan: FlightPlan) -> list[Course]:
    """Return the courses of a flight: the strips to and fro, cross strips, oblique strips."""
    north = plan.length_m >= plan.width_m
    long_m, short_m = (plan.length_m, plan.width_m) if north else (plan.width_m, plan.length_m)
    heading, height = 0.0 if north else 90.0, plan.height_m
    strips = int(np.ceil(short_m / plan.strip_distance_m - 1e-9)) + 1
    n, high = int(np.ceil(long_m / plan.base_m - 1e-9)) + 1, plan.cross_height
    m = int(np.ceil(short_m / (high * plan.base_m) - 1e-9)) + 1
    setback = float(np.tan(np.radians(plan.oblique_angle_deg))) * height

    def place(across: float, along: float) -> tuple[float, float]:
        return (across, along) if north else (along, across)

    def evenly(count: int, extent: float) -> list[float]:
        return [extent * ((i + 0.5) / count - 0.5) for i in range(count)]

    made = [
        Course(
            place((s - (strips - 1) / 2) * plan.strip_distance_m, 0.0),
            heading + 180.0 * (s % 2),
            n,
            plan.base_m,
            height,
        )
        for s in range(strips)
    ]
    made += [
        Course(place(0.0, along), heading + 90.0 + 180.0 * (s % 2), m, high * plan.base_m, high * height)
        for s, along in enumerate(evenly(plan.cross_strips, long_m))
    ]
    made += [
        Course(place(across, 0.0), heading + 180.0 * (s % 2), n, plan.base_m, height, plan.oblique_angle_deg, setback)
        for s, across in enumerate(evenly(plan.oblique_strips, short_m))
    ]
    return made


def control_places(plan: FlightPlan) -> FloatArray:
    """Return the places (G, 2) of the control points: as laid out, then those given."""
    half = np.array([plan.width_m, plan.length_m]) * (0.5 - INSET)
    n = plan.control_points
    if plan.control_layout == "corners":
        unit = _corners_first(n)
    elif plan.control_layout == "edges":
        at = np.arange(n) / max(n, 1) * 4.0
        side, rest = at.astype(np.int64), 2.0 * (at % 1.0) - 1.0
        around = [
            np.column_stack(c)
            for c in ((rest, -1 + 0 * rest), (1 + 0 * rest, rest), (-rest, 1 + 0 * rest), (-1 + 0 * rest, -rest))
        ]
        unit = np.array([around[s][i] for i, s in enumerate(side)]).reshape(-1, 2)
    elif plan.control_layout == "grid":
        columns = max(1, round(float(np.sqrt(n * plan.width_m / plan.length_m))))
        rows = int(np.ceil(n / columns))
        column, row = np.arange(n) % columns, np.arange(n) // columns
        in_row = np.where(row == rows - 1, n - columns * (rows - 1), columns)
        unit = np.column_stack([2 * (column + 0.5) / np.maximum(in_row, 1) - 1, 2 * (row + 0.5) / max(rows, 1) - 1])
    else:
        angle = 2 * np.pi * np.arange(n) / max(n, 1)
        unit = 0.15 * np.column_stack([np.cos(angle), np.sin(angle)]) * (n > 1)
    given = np.array(plan.control_world_m, dtype=np.float64).reshape(-1, 2)
    return np.concatenate([unit * half, given])


def _corners_first(count: int) -> FloatArray:
    """Return corners, middle, middles of the edges, then what is farthest from all that stand (count, 2), −1 to 1."""
    first = [(-1, -1), (1, 1), (1, -1), (-1, 1), (0, 0), (0, -1), (0, 1), (-1, 0), (1, 0)]
    unit = np.array(first, dtype=np.float64)
    x = np.linspace(-1, 1, 21)
    lattice = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    while len(unit) < count:
        far = np.linalg.norm(lattice[:, None] - unit[None], axis=2).min(axis=1)
        unit = np.concatenate([unit, lattice[np.argmax(far)][None]])
    return unit[:count]


@dataclass(frozen=True, eq=False)
class PlannedSurvey:
    """A plan as it is flown over some terrain: the block as measured, and the truth. Ground points are control points
    first, then those that ``extra`` asked for, as check points."""

    plan: FlightPlan
    flight: Flight
    block: Block
    truth: Truth


def survey_of(plan: FlightPlan, seed: int, *, errors: bool, extra: FloatArray | None = None) -> PlannedSurvey:
    """Fly a plan over a terrain that follows from the seed, and measure it, with all its errors or without any.

    ``extra`` (E, 2) are places of check points. Raises ValueError where the photographs do not overlap.
    """
    rng = np.random.default_rng([seed, 11])
    R, C = flown(courses(plan))
    C = C + POSITION_NOISE_M * rng.standard_normal(C.shape)
    R = turned(R, np.radians(ATTITUDE_NOISE_DEG) * rng.standard_normal(C.shape))
    flight = _flight(plan, R, C, rng, errors)
    xy = np.concatenate([control_places(plan), np.zeros((0, 2)) if extra is None else extra])
    ground = np.column_stack([xy, terrain_height(seed, plan.relief_m, xy)])
    control = _control(plan, flight, ground, rng, errors)
    # of their own, so that plans that differ elsewhere can be compared
    ties = _ties(plan, flight, seed, np.random.default_rng([seed, 12]), errors)
    camera = flight.approximate if errors else flight.camera
    block = Block(FRAME, (camera,), flight.photographs, flight.poses, ties, control, np.array(plan.offset_sigmas_m))
    return PlannedSurvey(plan, flight, block, flight.truth(ground))


def _flight(plan: FlightPlan, R: FloatArray, C: FloatArray, rng: np.random.Generator, errors: bool) -> Flight:
    """Return the flight with what is measured of it."""
    camera, sigma = plan.camera, plan.gnss_sigmas_m
    wrong = np.where(np.isfinite(camera.sigmas), camera.sigmas, 0.0) * np.append(rng.standard_normal(READOUT), 0.0)
    approximate = camera.with_parameters(camera.parameters + wrong)
    offset = errors * np.array(plan.offset_sigmas_m) * rng.standard_normal(3)
    noise = errors * rng.standard_normal(C.shape)
    photographs = tuple(Photograph(f"planned_{i + 1:04d}", 0) for i in range(len(C)))
    if sigma is not None:
        gnss = C - offset + np.array(sigma) * noise
        photographs = tuple(
            replace(p, gnss_world_m=gnss[i], gnss_sigma_m=np.array(sigma)) for i, p in enumerate(photographs)
        )
    drawn = SurveyPlan(
        width_px=plan.width_px, height_px=plan.height_px, focal_px=plan.focal_px, flying_height_m=plan.height_m,
        relief_m=plan.relief_m, oblique_angle_deg=plan.oblique_angle_deg,
    )  # fmt: skip
    poses = tuple(Pose(r, c) for r, c in zip(R, C, strict=True))
    return Flight(drawn, camera, approximate, poses, photographs, {"1": offset})


def _control(
    plan: FlightPlan, flight: Flight, ground: FloatArray, rng: np.random.Generator, errors: bool
) -> ControlPoints:
    seen = observe(flight, ground, 5 * plan.mark_sigma_px)
    sigma = np.tile(plan.control_sigma_m, (len(ground), 1))
    count, checks = plan.control, len(ground) - plan.control
    role: list[Role] = ["control"] * count
    role += ["check"] * checks
    return ControlPoints(
        (*(f"G{i + 1}" for i in range(count)), *(f"C{i + 1}" for i in range(checks))),
        tuple(role),
        ground + errors * sigma * rng.standard_normal(ground.shape),
        sigma,
        seen.photograph,
        seen.point,
        seen.pixel + errors * plan.mark_sigma_px * rng.standard_normal(seen.pixel.shape),
        isotropic_px2(np.full(len(seen.point), float(plan.mark_sigma_px))),
    )


def _ties(plan: FlightPlan, flight: Flight, seed: int, rng: np.random.Generator, errors: bool) -> TiePoints:
    """Return tie points, so many that photographs see the wanted number on average; of unknown position with
    ``errors``, else of the true one."""
    corners = footprints(flight, 0.0).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    wanted = min(plan.tie_points_per_photograph * len(flight.poses), MOST_OBSERVATIONS)
    margin_px, detection = 5 * plan.tie_point_sigma_px, plan.tie_point_detection
    _, pilot = sight_ground(flight, seed, rng.uniform(low, high, (500, 2)), margin_px, detection, rng)
    rays = np.bincount(pilot.point, minlength=500)
    usable = int(rays[rays >= 2].sum())
    if not usable:
        raise ValueError("the photographs do not overlap: raise forward_overlap and side_overlap")
    count = int(np.ceil(500 * wanted / usable))
    points, seen = sight_ground(flight, seed, rng.uniform(low, high, (count, 2)), margin_px, detection, rng)
    enough = np.bincount(seen.point, minlength=count) >= 2
    number = np.cumsum(enough) - 1
    seen = seen.select(enough[seen.point])
    point, kept = number[seen.point].astype(np.int64), points[enough]
    n = len(point)
    pixel = seen.pixel + errors * plan.tie_point_sigma_px * rng.standard_normal((n, 2))
    unknown = np.full(kept.shape, np.nan) if errors else kept
    sigma = np.full(n, float(plan.tie_point_sigma_px))
    return TiePoints(
        seen.photograph, point, np.arange(n, dtype=np.int64), pixel, sigma, unknown,
        np.full((len(kept), 3), 128, np.uint8),
    )  # fmt: skip
