"""The data of a survey: frozen, shapes checked on construction, arrays for everything counted in thousands.

Frames and units are in the names: ``_px`` pixel (centre of the top-left pixel is (0, 0)), ``_world_m`` local
east-north-up frame of the survey, ``_map_m`` the project's CRS. Photographs, points and cameras are referred to by
their index in the block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photogram.camera import Camera, Pose
from photogram.frames import LocalFrame

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]
Role = Literal["control", "check"]
Roles = tuple[Role, Role]
"""The role of a ground point in plan and in height."""


def check_shape(name: str, array: NDArray[np.generic], shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless ``array`` has ``shape``, where None stands for any length."""
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name}: shape {array.shape}, expected {shape}")


def check_range(name: str, value: float, low: float, high: float = float("inf")) -> None:
    """Raise ValueError unless ``low`` ≤ ``value`` ≤ ``high``."""
    if not low <= value <= high:
        limits = f"at least {low:g}" if high == float("inf") else f"from {low:g} to {high:g}"
        raise ValueError(f"{name} is {value:g}; it must be {limits}")


@dataclass(frozen=True, eq=False)
class Photograph:
    """One photograph and what its tags or the project say of its exterior orientation.

    ``gnss_world_m`` (3,) is the measured position with ``gnss_sigma_m`` (3,) along the axes of the map, both
    None when there is none;
    ``attitude_world_from_camera`` (3, 3) is the measured attitude, with ``attitude_sigma_rad`` about the camera's axes;
    where ``heading_known`` is False it tells the tilt against the vertical alone.
    Photographs of one ``flight`` share one unknown GNSS offset. ``time`` is the exposure, where the tags give it;
    ``height_above_ground_m`` the flying height, as well as tags or the project say it. The position is that of the
    projection centre, or, with a ``lever_arm_camera_m`` (3,), that of the antenna, from which the arm points to the
    projection centre along the camera's axes.
    """

    name: str
    camera: int
    path: Path | None = None
    flight: str = "1"
    time: datetime | None = None
    gnss_world_m: FloatArray | None = None
    gnss_sigma_m: FloatArray | None = None
    attitude_world_from_camera: FloatArray | None = None
    attitude_sigma_rad: float | None = None
    height_above_ground_m: float | None = None
    heading_known: bool = True
    lever_arm_camera_m: FloatArray | None = None

    def measured_centre_world_m(self, rotation_world_from_camera: FloatArray) -> FloatArray | None:
        """Return where the GNSS position puts the projection centre (3,), of a camera of this rotation (3, 3); None
        without a position."""
        if self.gnss_world_m is None or self.lever_arm_camera_m is None:
            return self.gnss_world_m
        return np.asarray(self.gnss_world_m + rotation_world_from_camera @ self.lever_arm_camera_m)

    def __post_init__(self) -> None:
        if (self.gnss_world_m is None) != (self.gnss_sigma_m is None):
            raise ValueError(f"{self.name}: a GNSS position needs its sigmas, and the reverse")
        if self.gnss_world_m is not None and self.gnss_sigma_m is not None:
            check_shape("gnss_world_m", self.gnss_world_m, (3,))
            check_shape("gnss_sigma_m", self.gnss_sigma_m, (3,))
        if self.lever_arm_camera_m is not None:
            check_shape("lever_arm_camera_m", self.lever_arm_camera_m, (3,))
        if self.attitude_world_from_camera is not None:
            check_shape("attitude_world_from_camera", self.attitude_world_from_camera, (3, 3))


@dataclass(frozen=True, eq=False)
class Features:
    """Key points of one photograph: ``pixel`` (N, 2), ``size_px`` (N,), ``angle_rad`` (N,), ``descriptor`` (N, D)
    uint8, ``colour`` (N, 3) uint8 red, green, blue."""

    pixel: FloatArray
    size_px: FloatArray
    angle_rad: FloatArray
    descriptor: ByteArray
    colour: ByteArray

    def __post_init__(self) -> None:
        n = len(self.pixel)
        check_shape("pixel", self.pixel, (n, 2))
        check_shape("size_px", self.size_px, (n,))
        check_shape("angle_rad", self.angle_rad, (n,))
        check_shape("descriptor", self.descriptor, (n, None))
        check_shape("colour", self.colour, (n, 3))

    def __len__(self) -> int:
        return len(self.pixel)


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched key points of photographs ``first`` and ``second``: ``index`` (M, 2) into their features."""

    first: int
    second: int
    index: IntArray

    def __post_init__(self) -> None:
        check_shape("index", self.index, (None, 2))

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True, eq=False)
class TiePoints:
    """Image observations of tie points, sorted by point, then photograph.

    ``photograph`` (N,), ``point`` (N,), ``feature`` (N,) index of the key point in its photograph, ``pixel`` (N, 2),
    ``sigma_px`` (N,); ``position_world_m`` (P, 3), NaN while unknown; ``colour`` (P, 3) uint8.
    """

    photograph: IntArray
    point: IntArray
    feature: IntArray
    pixel: FloatArray
    sigma_px: FloatArray
    position_world_m: FloatArray
    colour: ByteArray

    def __post_init__(self) -> None:
        n, p = len(self.photograph), len(self.position_world_m)
        check_shape("photograph", self.photograph, (n,))
        check_shape("point", self.point, (n,))
        check_shape("feature", self.feature, (n,))
        check_shape("pixel", self.pixel, (n, 2))
        check_shape("sigma_px", self.sigma_px, (n,))
        check_shape("position_world_m", self.position_world_m, (p, 3))
        check_shape("colour", self.colour, (p, 3))
        if n and (np.any(np.diff(self.point) < 0) or self.point[0] < 0 or self.point[-1] >= p):
            raise ValueError("observations of tie points must be sorted by point, with points numbered from 0")

    def __len__(self) -> int:
        return len(self.position_world_m)

    @property
    def first_observation(self) -> IntArray:
        """Index (P + 1,) of each point's first observation; the observations of point p are ``[i[p], i[p + 1])``."""
        return np.searchsorted(self.point, np.arange(len(self) + 1)).astype(np.int64)

    @property
    def rays(self) -> IntArray:
        """Number (P,) of observations of each point."""
        return np.bincount(self.point, minlength=len(self)).astype(np.int64)

    def select(self, points: NDArray[np.bool_], observations: NDArray[np.bool_] | None = None) -> TiePoints:
        """Keep the points of the mask (P,), and of their observations those of the mask (N,); points are renumbered."""
        keep = points[self.point] if observations is None else points[self.point] & observations
        renumbered = np.cumsum(points) - 1
        return TiePoints(
            self.photograph[keep],
            renumbered[self.point[keep]].astype(np.int64),
            self.feature[keep],
            self.pixel[keep],
            self.sigma_px[keep],
            self.position_world_m[points],
            self.colour[points],
        )


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Surveyed ground points and their marks in photographs.

    ``name`` and ``role`` of length G, ``position_world_m`` (G, 3) with ``sigma_m`` (G, 3) along the axes of the map;
    marks: ``mark_photograph`` (M,), ``mark_point`` (M,), ``mark_pixel`` (M, 2), ``mark_sigma_px`` (M,), infinite for a
    mark that takes no part.
    ``controlled`` (G, 3) says which of easting, northing and height are control: all those of a control point and none
    of a check point where it is not given; one with an infinite sigma takes no part all the same. A point with the role
    control has one at least; its other coordinates are checks.
    """

    name: tuple[str, ...]
    role: tuple[Role, ...]
    position_world_m: FloatArray
    sigma_m: FloatArray
    mark_photograph: IntArray
    mark_point: IntArray
    mark_pixel: FloatArray
    mark_sigma_px: FloatArray
    controlled: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 3), dtype=bool))

    def __post_init__(self) -> None:
        g, m = len(self.name), len(self.mark_photograph)
        if len(self.role) != g:
            raise ValueError("every ground point needs a role")
        is_control = np.array([role == "control" for role in self.role], dtype=bool)
        if g and not len(self.controlled):
            object.__setattr__(self, "controlled", np.repeat(is_control[:, None], 3, axis=1))
        check_shape("controlled", self.controlled, (g, 3))
        if np.any(self.controlled.any(axis=1) != is_control):
            raise ValueError("a control point has one controlled coordinate at least, a check point none")
        check_shape("position_world_m", self.position_world_m, (g, 3))
        check_shape("sigma_m", self.sigma_m, (g, 3))
        check_shape("mark_point", self.mark_point, (m,))
        check_shape("mark_pixel", self.mark_pixel, (m, 2))
        check_shape("mark_sigma_px", self.mark_sigma_px, (m,))

    def __len__(self) -> int:
        return len(self.name)

    @property
    def used(self) -> BoolArray:
        """Which coordinates (G, 3) take part: those that are control, with a finite sigma."""
        return np.asarray(self.controlled & np.isfinite(self.sigma_m))

    def with_role(self, role: Role) -> ControlPoints:
        """Return the points of one role and their marks."""
        keep = np.array([r == role for r in self.role], dtype=bool)
        marks = keep[self.mark_point] if len(self.mark_point) else np.zeros(0, dtype=bool)
        renumbered = np.cumsum(keep) - 1
        return ControlPoints(
            tuple(n for n, r in zip(self.name, self.role, strict=True) if r == role),
            tuple(r for r in self.role if r == role),
            self.position_world_m[keep],
            self.sigma_m[keep],
            self.mark_photograph[marks],
            renumbered[self.mark_point[marks]].astype(np.int64) if len(keep) else self.mark_point[marks],
            self.mark_pixel[marks],
            self.mark_sigma_px[marks],
            self.controlled[keep],
        )

    def with_roles(self, roles: Sequence[Role]) -> ControlPoints:
        """Return the same points with other roles, one for all coordinates of each."""
        return replace(self, role=tuple(roles), controlled=np.zeros((0, 3), dtype=bool))

    def fully_controlled(self) -> ControlPoints:
        """Return the points whose three coordinates are control: those that can say where something is."""
        whole: NDArray[np.bool_] = np.asarray(self.controlled.all(axis=1))
        return self.with_roles(["control" if w else "check" for w in whole]).with_role("control")


@dataclass(frozen=True, eq=False)
class Block:
    """Photographs that are adjusted together; ``poses[i]`` belongs to ``photographs[i]``, None while it is not
    oriented.

    ``gnss_offset_sigma_m`` (3,) is the prior of the unknown offset between GNSS and ground control, one per flight;
    zero where the offset is known to be none.
    """

    frame: LocalFrame
    cameras: tuple[Camera, ...]
    photographs: tuple[Photograph, ...]
    poses: tuple[Pose | None, ...]
    tie_points: TiePoints
    control_points: ControlPoints
    gnss_offset_sigma_m: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        if len(self.poses) != len(self.photographs):
            raise ValueError("one pose, or None, per photograph")
        check_shape("gnss_offset_sigma_m", self.gnss_offset_sigma_m, (3,))


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in the project's CRS: ``position_map_m`` (N, 3), ``colour`` (N, 3) uint8 or None, ``sigma_m`` (N, 3) or
    None."""

    position_map_m: FloatArray
    colour: ByteArray | None = None
    sigma_m: FloatArray | None = None

    def __post_init__(self) -> None:
        n = len(self.position_map_m)
        check_shape("position_map_m", self.position_map_m, (n, 3))
        if self.colour is not None:
            check_shape("colour", self.colour, (n, 3))
        if self.sigma_m is not None:
            check_shape("sigma_m", self.sigma_m, (n, 3))

    def __len__(self) -> int:
        return len(self.position_map_m)


@dataclass(frozen=True, eq=False)
class Raster:
    """A grid in the project's CRS: ``values`` (rows, columns), NaN where there is no data.

    Square cells of ``cell_m``; ``west_map_m`` and ``north_map_m`` are the outer corner of cell (0, 0), rows go south.
    """

    values: NDArray[np.float32]
    west_map_m: float
    north_map_m: float
    cell_m: float

    def __post_init__(self) -> None:
        check_shape("values", self.values, (None, None))
        if not self.cell_m > 0:
            raise ValueError("the cell size of a raster must be positive")


@dataclass(frozen=True, eq=False)
class Reliability:
    """How well blunders would show in what was surveyed, along the map's axes, and what the rest says of it.

    Redundancy numbers and w-tests (Baarda 1968): ``ground_redundancy``, ``ground_w`` (G, 3) of the surveyed coordinates
    of control points, ``mark_redundancy``, ``mark_w`` (marks, 2) of their marks, ``gnss_redundancy``, ``gnss_w`` (N, 3)
    of GNSS positions. ``ground_left_out_m`` (G, 3) is predicted minus surveyed for a control point whose survey took no
    part, ``ground_left_out_covariance_m2`` (G, 3, 3) what it would scatter by; ``mark_left_out_px`` (marks, 2) and
    ``mark_left_out_covariance_px2`` (marks, 2, 2) the same for a mark, ``gnss_left_out_m`` (N, 3) with its covariances
    (N, 3, 3) for a GNSS position, ``attitude_left_out_rad`` (N, 3) with its covariances for a measured attitude, as a
    turn about the camera's axes, ``focal_left_out_px`` (cameras,) with its sigmas for a given focal length. NaN for
    check points, for what is not there, and where nothing else determines an observation.
    """

    ground_redundancy: FloatArray
    ground_w: FloatArray
    ground_left_out_m: FloatArray
    ground_left_out_covariance_m2: FloatArray
    mark_redundancy: FloatArray
    mark_w: FloatArray
    mark_left_out_px: FloatArray
    mark_left_out_covariance_px2: FloatArray
    gnss_redundancy: FloatArray
    gnss_w: FloatArray
    gnss_left_out_m: FloatArray
    gnss_left_out_covariance_m2: FloatArray
    attitude_left_out_rad: FloatArray
    attitude_left_out_covariance_rad2: FloatArray
    focal_left_out_px: FloatArray
    focal_left_out_sigma_px: FloatArray

    @staticmethod
    def unknown(ground: int, marks: int, photographs: int, cameras: int = 0) -> Reliability:
        """Return what is known of so many ground points, marks, photographs and cameras when nothing is."""
        points, pixels, positions = (np.full((n, d), np.nan) for n, d in ((ground, 3), (marks, 2), (photographs, 3)))
        return Reliability(
            points,
            points,
            points,
            np.full((ground, 3, 3), np.nan),
            pixels,
            pixels,
            pixels,
            np.full((marks, 2, 2), np.nan),
            positions,
            positions,
            positions,
            np.full((photographs, 3, 3), np.nan),
            positions,
            np.full((photographs, 3, 3), np.nan),
            np.full(cameras, np.nan),
            np.full(cameras, np.nan),
        )


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """What the groups of an adjustment's observations scatter by, against what was stated; nothing is rescaled by it.

    By group (K,): ``group`` its name, ``observations`` how many, ``redundancy`` the sum of their redundancy numbers,
    ``squares`` vᵀPv of their residuals, ``stated_sigma`` the median of their stated sigmas, in px, m or rad. All
    groups together make the redundancy and vᵀPv of the adjustment.
    """

    group: NDArray[np.str_]
    observations: IntArray
    redundancy: FloatArray
    squares: FloatArray
    stated_sigma: FloatArray

    @staticmethod
    def unknown() -> VarianceComponents:
        """Return those of no observations."""
        none = np.zeros(0)
        return VarianceComponents(np.zeros(0, dtype=np.str_), none.astype(np.int64), none, none, none)


@dataclass(frozen=True, eq=False)
class Deformation:
    """How a block may be bent, shifted or scaled as a whole without its measurements showing it, a priori.

    Errors in height of the tie points are a + b x/R + c y/R + d ((x² + y²)/R² − mean), x and y from ``centre_world_m``
    (2,), R = ``radius_m``: d is the dome. ``covariance`` (K, K) is joint of: mean error of the ground (east, north,
    up), b, c, d; mean error of the projection centres (east, north, up), all in m; per camera the mean rotations of its
    photographs about its x and y axes, rad; per camera its 11 parameters, zero where held; per flight the GNSS offset
    (east, north, up), m. ``intersection_sigma_m`` (3,) is the median sigma of tie points with the cameras taken as
    known, ``height_sigma_m`` (Q,) what the cameras add to it in height at places over the block. ``given_parameters``
    (cameras, 11) are the interior orientations before the adjustment. ``remedy`` (R,) names what was tried by
    covariance, ``remedy_sigma_m`` (R, 2, 3) holds before and after: sigma in height in the middle, root mean square
    over the block, sigma of d. ``freed_prior`` and ``freed_sigma`` (cameras, 11) are the sigmas to which held
    parameters were freed and those that they would have after the adjustment, 0 for the others;
    ``freed_height_sigma_m`` (3,) the sigmas of the heights then, as in ``remedy_sigma_m``. ``pattern_sigma_m`` (3,) is
    what an error of the camera model as large as the pattern of the residuals does to b, c and d, NaN where nothing is
    known of it. ``absolute_sigma_m`` and ``relative_sigma_m`` (3,) east, north, up are root mean squares, over places
    of the block, of what the cameras do to a point there: as such, and after the mean shift of all points is taken off,
    which leaves the shape of the block without its datum. ``ground_place_world_m`` (Q, 3) are places over the block,
    ``ground_covariance_m2`` (3 Q, 3 Q) the joint covariance of what the cameras do to the ground there.
    ``place_world_m`` (S, 3) are places spread over the ground, ``shape_covariance_m2`` (S, 3, 3) what the cameras add
    to their errors relative to the mean error of all of them: without the datum's common part.
    """

    centre_world_m: FloatArray
    radius_m: float
    covariance: FloatArray
    intersection_sigma_m: FloatArray
    height_sigma_m: FloatArray
    given_parameters: FloatArray
    remedy: NDArray[np.str_]
    remedy_sigma_m: FloatArray
    freed_prior: FloatArray
    freed_sigma: FloatArray
    freed_height_sigma_m: FloatArray
    pattern_sigma_m: FloatArray
    absolute_sigma_m: FloatArray
    relative_sigma_m: FloatArray
    ground_place_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    ground_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    place_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    shape_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))

    @staticmethod
    def unknown(given_parameters: FloatArray | None = None) -> Deformation:
        """Return what is known of a block without tie points enough to say anything."""
        nothing = np.full(3, np.nan)
        given = np.zeros((0, 0)) if given_parameters is None else given_parameters
        return Deformation(
            nothing[:2], float("nan"), np.zeros((0, 0)), nothing, np.zeros(0), given, np.zeros(0, np.str_),
            np.zeros((0, 2, 3)), np.zeros_like(given), np.zeros_like(given), nothing, nothing, nothing,
            nothing,
        )  # fmt: skip

    @property
    def known(self) -> bool:
        """Return whether there are tie points enough to say anything."""
        return bool(len(self.covariance))


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The result of the joint adjustment.

    ``block`` holds adjusted cameras, poses and tie points: only points and observations that took part. Covariances are
    a-priori, in the world frame: ``position_covariance_m2`` (N, 3, 3) of the projection centres,
    ``rotation_covariance_rad2`` (N, 3, 3) about the camera's axes, ``calibration_covariance`` (cameras, 11, 11),
    ``tie_point_covariance_m2`` (P, 3, 3). Ground points, control and check, in the order of ``block.control_points``:
    ``ground_world_m`` (G, 3), NaN where a check point has fewer than two marks, with ``ground_covariance_m2`` (G, 3,
    3). ``residual_px`` (observations, 2) and ``mark_residual_px`` (marks, 2) are projected minus measured.
    ``offset_world_m`` (flights, 3) with its covariance. ``reliability`` of control points, marks and GNSS positions;
    ``deformation`` of the block as a whole, unknown until it is asked for.
    ``ground_joint_covariance_m2`` (3 G, 3 G) is that of all ground points together: they share the errors of the
    photographs. ``tie_point_ray_covariance_m2`` (P, 3, 3) is the part of the tie points' covariances that is their own;
    neighbours share the rest, which comes from the photographs. ``components``: what groups of observations scatter by.
    Where no offset is estimated, ``held_flights`` are those with GNSS positions, ``implied_offset_world_m`` (F, 3) with
    its covariance the offsets that would be, NaN where nothing but the positions tells. ``left_arm_camera_m`` (3,) with
    its sigmas is the lever arm that the positions show beside the one that is counted, ``left_arm_p`` the p of none.
    ``warnings`` say what is weak, or was left out by the adjustment; ``reason`` (N,) why it left a photograph out,
    empty where it did not, or () where it left out none.
    """

    block: Block
    sigma0: float
    redundancy: int
    residual_px: FloatArray
    mark_residual_px: FloatArray
    position_covariance_m2: FloatArray
    rotation_covariance_rad2: FloatArray
    calibration_covariance: FloatArray
    tie_point_covariance_m2: FloatArray
    ground_world_m: FloatArray
    ground_covariance_m2: FloatArray
    flights: tuple[str, ...]
    offset_world_m: FloatArray
    offset_covariance_m2: FloatArray
    iterations: int
    rounds: int
    converged: bool
    cost: float
    discarded_observations: int
    discarded_points: int
    reliability: Reliability
    ground_joint_covariance_m2: FloatArray
    tie_point_ray_covariance_m2: FloatArray
    components: VarianceComponents
    held_flights: tuple[str, ...] = ()
    implied_offset_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    implied_offset_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    left_arm_camera_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    left_arm_sigma_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    left_arm_p: float = float("nan")
    deformation: Deformation = field(default_factory=Deformation.unknown)
    warnings: tuple[str, ...] = ()
    reason: tuple[str, ...] = ()
