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

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray, check_shapes
from photogram.camera import Camera, Pose, oriented_by
from photogram.constraints.between_points import Constraint, gives_scale
from photogram.constraints.known_surface import SurfaceControl
from photogram.constraints.rigs import Companion, give_scale
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.frames import LocalFrame
from photogram.projection import OrientedCameras
from photogram.verbs import call
from photogram.wording import html_table, percent, text_table, things

Role = Literal["control", "check"]
Roles = tuple[Role, Role]
"""The role of a ground point in plan and in height."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """One photograph, with its measured exterior orientation as far as tags or project give it."""

    name: str
    """File name, unique in the block."""
    camera: int
    """Index of its camera in the block."""
    path: Path | None = None
    """The file, None for a photograph without one."""
    flight: str = "1"
    """Name of its flight; the photographs of a flight share one unknown GNSS offset."""
    time: datetime | None = None
    """Time of exposure, where the tags give it."""
    gnss_world_m: FloatArray | None = None
    """Measured position (3,), None without one: of the projection centre, or of the antenna where there is a lever
    arm."""
    gnss_sigma_m: FloatArray | None = None
    """Its standard deviations (3,) along easting, northing and height of the map."""
    attitude_world_from_camera: FloatArray | None = None
    """Measured rotation (3, 3), None without one."""
    attitude_sigma_rad: float | None = None
    """Its standard deviation about each of the camera's axes."""
    height_above_ground_m: float | None = None
    """Approximate flying height, where tags or project give it."""
    heading_known: bool = True
    """False where the measured attitude gives the tilt alone."""
    lever_arm_camera_m: FloatArray | None = None
    """Lever arm (3,) from antenna to projection centre along the camera's axes, None where it is zero or already
    applied."""
    gnss_sigma_assumed: bool = False
    """Whether nobody has stated the standard deviations of the position: they are then estimated."""
    velocity_world_m_s: FloatArray | None = None
    """Measured velocity (3,) at the exposure, None without one."""
    capture: str | None = None
    """Identifier of the exposure that cameras on one body share, None where the tags give none."""

    def __repr__(self) -> str:
        measured = [
            word
            for word, value in (("GNSS", self.gnss_world_m), ("attitude", self.attitude_world_from_camera))
            if value is not None
        ]
        known = f"{' and '.join(measured) or 'nothing'} measured"
        return f"<Photograph {self.name}: camera {self.camera}, flight {self.flight}, {known}>"

    @property
    def time_s(self) -> float | None:
        """Return the time of exposure, s from an epoch that all photographs share, None without one."""
        return None if self.time is None else self.time.timestamp()

    def measured_centre_world_m(self, rotation_world_from_camera: FloatArray) -> FloatArray | None:
        """Return where the GNSS position puts the projection centre (3,), of a camera of this rotation (3, 3); None
        without a position."""
        if self.gnss_world_m is None or self.lever_arm_camera_m is None:
            return self.gnss_world_m
        return np.asarray(self.gnss_world_m + rotation_world_from_camera @ self.lever_arm_camera_m)

    def __post_init__(self) -> None:
        if (self.gnss_world_m is None) != (self.gnss_sigma_m is None):
            raise ValueError(f"{self.name}: a GNSS position needs sigmas, and sigmas need a position")
        check_shapes(self, gnss_world_m=(3,), gnss_sigma_m=(3,), lever_arm_camera_m=(3,), velocity_world_m_s=(3,))
        check_shapes(self, attitude_world_from_camera=(3, 3))


CommonErrorKind = Literal["attitude", "lever_arm", "time_offset", "drift", "known_surface"]


@dataclass(frozen=True, eq=False)
class CommonError:
    """An error that the measurements of many photographs have in common, and that is estimated with them: d unknowns
    with a prior of zero. The model is in photogram.factors.common_errors."""

    kind: CommonErrorKind
    """Attitude: boresight about the camera's axes and, behind it, heading about the vertical, rad. Lever arm: what is
    added to the one that is counted, along the columns of ``basis``, m. Time offset: of the exposure after the epoch of
    the position, s. Drift: of the positions over the flight, easting, northing, up of the world, m. Known surface: how
    far it lies above the ground, in height and by its slopes east and north at the edge of its points, and how far
    east and north of where it belongs, m."""
    flight: str | None
    """Name of the flight, None for all flights."""
    camera: int | None
    """Index of the camera, None for all."""
    sigma: FloatArray
    """Standard deviations (d,) of the prior."""
    value: FloatArray
    """Values (d,), zero before an adjustment."""
    basis: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """Directions (3, d) of a lever arm along the camera's axes: those that nothing else can take over."""

    def __post_init__(self) -> None:
        check_shapes(self, value=self.sigma.shape)
        if self.kind == "lever_arm":
            check_shapes(self, basis=(3, len(self.sigma)))

    def of(self, photograph: Photograph) -> bool:
        """Return whether a photograph's measurements have it."""
        return self.flight in (None, photograph.flight) and self.camera in (None, photograph.camera)


Metric = Literal["euclidean", "hamming"]
"""Of descriptors: bytes that are coordinates, or bits."""


@dataclass(frozen=True, eq=False)
class Features:
    """Key points of one photograph."""

    pixel: FloatArray
    """Positions (N, 2), u right and v down."""
    size_px: FloatArray
    """Diameters (N,)."""
    angle_rad: FloatArray
    """Orientations (N,)."""
    descriptor: ByteArray
    """Descriptors (N, D), uint8."""
    colour: ByteArray
    """Red, green, blue (N, 3), uint8."""
    metric: Metric = "euclidean"
    """In which descriptors are compared."""

    def __post_init__(self) -> None:
        n = len(self.pixel)
        check_shapes(self, pixel=(n, 2), size_px=(n,), angle_rad=(n,), descriptor=(n, None), colour=(n, 3))

    def __len__(self) -> int:
        return len(self.pixel)

    def __repr__(self) -> str:
        return f"<Features: {things(len(self), 'key point')}>"


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched key points of two photographs, by their indices: their pixels are those of the features."""

    first: int
    """Index of the first photograph."""
    second: int
    """Index of the second photograph."""
    index: IntArray
    """Indices (M, 2) into the features of both."""

    def __post_init__(self) -> None:
        check_shapes(self, index=(None, 2))

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        return f"<Matches of photographs {self.first} and {self.second}: {things(len(self), 'match', 'matches')}>"


TRANSFERRED = -1
"""Number of the key point of an observation that has none: it was measured by correlation."""


@dataclass(frozen=True, eq=False)
class TiePoints:
    """Image observations of tie points (N), sorted by point, then photograph, and the points themselves (P)."""

    photograph: IntArray
    """Index of the photograph of each observation (N,)."""
    point: IntArray
    """Index of the point of each observation (N,)."""
    feature: IntArray
    """Index of the key point in its photograph (N,), TRANSFERRED where there is none."""
    pixel: FloatArray
    """Observed image coordinates (N, 2)."""
    sigma_px: FloatArray
    """Standard deviations (N,) of each coordinate."""
    position_world_m: FloatArray
    """Positions (P, 3), NaN while unknown."""
    colour: ByteArray
    """Red, green, blue of the points (P, 3), uint8."""

    def __post_init__(self) -> None:
        n, p = len(self.photograph), len(self.position_world_m)
        check_shapes(self, photograph=(n,), point=(n,), feature=(n,), pixel=(n, 2), sigma_px=(n,))
        check_shapes(self, position_world_m=(p, 3), colour=(p, 3))
        if n and (np.any(np.diff(self.point) < 0) or self.point[0] < 0 or self.point[-1] >= p):
            raise ValueError("observations of tie points must be sorted by point, with points numbered from 0")

    def __len__(self) -> int:
        return len(self.position_world_m)

    def __repr__(self) -> str:
        return f"<TiePoints: {things(len(self), 'point')}, {things(len(self.point), 'observation')}>"

    @property
    def first_observation(self) -> IntArray:
        """Index (P + 1,) of each point's first observation; the observations of point p are ``[i[p], i[p + 1])``."""
        return np.searchsorted(self.point, np.arange(len(self) + 1)).astype(np.int64)

    @property
    def rays(self) -> IntArray:
        """Number (P,) of observations of each point."""
        return np.bincount(self.point, minlength=len(self)).astype(np.int64)

    def select(self, points: BoolArray, observations: BoolArray | None = None) -> TiePoints:
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


def rms_sigma_px(covariance_px2: FloatArray) -> FloatArray:
    """Return the root mean square (M,) of the standard deviations of u and v of covariances (M, 2, 2), which is that of
    any two directions at right angles; infinite for rejected marks."""
    return np.asarray(np.sqrt((covariance_px2[:, 0, 0] + covariance_px2[:, 1, 1]) / 2.0))


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Surveyed ground points (G), control and check, and their marks in photographs (M)."""

    name: tuple[str, ...]
    """Names of the points."""
    role: tuple[Role, ...]
    """Role of each point: control if at least one coordinate is, else check."""
    position_world_m: FloatArray
    """Surveyed positions (G, 3), NaN for a point that is marked and not surveyed."""
    sigma_m: FloatArray
    """Standard deviations (G, 3) along easting, northing and height of the map; infinite for a rejected coordinate."""
    mark_photograph: IntArray
    """Index of the photograph of each mark (M,)."""
    mark_point: IntArray
    """Index of the point of each mark (M,)."""
    mark_pixel: FloatArray
    """Measured image coordinates (M, 2)."""
    mark_covariance_px2: FloatArray
    """Covariances (M, 2, 2) of u and v; infinite variances for a rejected mark."""
    controlled: BoolArray = field(default_factory=lambda: np.zeros((0, 3), dtype=bool))
    """Which of easting, northing and height (G, 3) are control; all those of a control point and none of a check point
    if not given."""
    sigma_assumed: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Whether the ``sigma_m`` of a point (G,) is only assumed, nobody having stated one; none if not given."""
    mark_sigma_assumed: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """The same of the covariances of the marks of a point (G,)."""

    def __post_init__(self) -> None:
        g, m = len(self.name), len(self.mark_photograph)
        if len(self.role) != g:
            raise ValueError("every ground point needs a role")
        is_control = np.array([role == "control" for role in self.role], dtype=bool)
        if g and not len(self.controlled):
            object.__setattr__(self, "controlled", np.repeat(is_control[:, None], 3, axis=1))
        for name in ("sigma_assumed", "mark_sigma_assumed"):
            if g and not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(g, dtype=bool))
        check_shapes(self, controlled=(g, 3), sigma_assumed=(g,), mark_sigma_assumed=(g,))
        if np.any(self.controlled.any(axis=1) != is_control):
            raise ValueError("a control point has at least one controlled coordinate, a check point none")
        check_shapes(self, position_world_m=(g, 3), sigma_m=(g, 3))
        check_shapes(self, mark_point=(m,), mark_pixel=(m, 2), mark_covariance_px2=(m, 2, 2))

    def __len__(self) -> int:
        return len(self.name)

    def __repr__(self) -> str:
        control = self.role.count("control")
        counts = f"{things(control, 'control point')}, {things(len(self) - control, 'check point')}"
        return f"<ControlPoints: {counts}, {things(len(self.mark_point), 'mark')}>"

    @property
    def mark_sigma_px(self) -> FloatArray:
        """Root mean squares (M,) of both standard deviations of each mark, where one number is asked for; infinite for
        a rejected mark."""
        return rms_sigma_px(self.mark_covariance_px2)

    @property
    def used(self) -> BoolArray:
        """Which coordinates (G, 3) take part: those that are control, with a finite sigma."""
        return np.asarray(self.controlled & np.isfinite(self.sigma_m))

    def with_role(self, role: Role) -> ControlPoints:
        """Return the points of one role and their marks."""
        return self.select(np.array([r == role for r in self.role], dtype=bool))

    def select(self, keep: BoolArray) -> ControlPoints:
        """Return the points of the mask (G,) and their marks."""
        marks = keep[self.mark_point] if len(self.mark_point) else np.zeros(0, dtype=bool)
        renumbered = np.cumsum(keep) - 1
        return ControlPoints(
            tuple(n for n, k in zip(self.name, keep, strict=True) if k),
            tuple(r for r, k in zip(self.role, keep, strict=True) if k),
            self.position_world_m[keep],
            self.sigma_m[keep],
            self.mark_photograph[marks],
            renumbered[self.mark_point[marks]].astype(np.int64) if len(keep) else self.mark_point[marks],
            self.mark_pixel[marks],
            self.mark_covariance_px2[marks],
            self.controlled[keep],
            self.sigma_assumed[keep],
            self.mark_sigma_assumed[keep],
        )

    def with_roles(self, roles: Sequence[Role]) -> ControlPoints:
        """Return the same points with other roles, one for all coordinates of each."""
        return replace(self, role=tuple(roles), controlled=np.zeros((0, 3), dtype=bool))

    def fully_controlled(self) -> ControlPoints:
        """Return the points whose three coordinates are control: those that can say where something is."""
        whole: BoolArray = np.asarray(self.controlled.all(axis=1) & np.isfinite(self.position_world_m).all(axis=1))
        return self.with_roles(["control" if w else "check" for w in whole]).with_role("control")


@dataclass(frozen=True)
class UndeclaredHeights:
    """GNSS heights and heights of ground points of which nobody says that they are of one system."""

    lowered_m: float = 0.0
    """By how much the GNSS positions were lowered for the marks of control points to agree with them, roughly."""


@dataclass(frozen=True, eq=False)
class Block:
    """Photographs that are adjusted together."""

    frame: LocalFrame
    """World frame and its relation to the map."""
    cameras: tuple[Camera, ...]
    """Cameras with their prior calibrations."""
    photographs: tuple[Photograph, ...]
    """The photographs."""
    poses: tuple[Pose | None, ...]
    """Exterior orientation of each photograph, None while it is not oriented."""
    tie_points: TiePoints
    """Tie points and their observations."""
    control_points: ControlPoints
    """Surveyed points and their marks."""
    gnss_offset_sigma_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Prior sigmas (3,) of the offset between GNSS and ground control along the map's axes, one offset per flight;
    zero: no offset."""
    datum_sigma_m: float = 0.0
    """The part of it, along easting and northing, that the offsets of all flights have in common: the error of the way
    from the datum of GNSS to that of the map."""
    common_errors: tuple[CommonError, ...] = ()
    """Further errors that measurements have in common."""
    constraints: tuple[Constraint, ...] = ()
    """What is measured between points; an observation of which a point takes no part is passed over."""
    rigs: tuple[Companion, ...] = ()
    """Cameras that are fixed to another on one body; an exposure of which a photograph takes no part is passed over."""
    undeclared_heights: UndeclaredHeights | None = None
    """How GNSS heights are used that nobody says to be of the system of the control points; None where they are."""
    known_surface: SurfaceControl | None = None
    """Tie points that lie on a surface whose heights are known; None where none takes part."""

    def __post_init__(self) -> None:
        if len(self.poses) != len(self.photographs):
            raise ValueError("one pose, or None, per photograph")
        check_shapes(self, gnss_offset_sigma_m=(3,))

    @property
    def camera_of(self) -> IntArray:
        """Return the number of the camera of every photograph (F,)."""
        return np.array([p.camera for p in self.photographs], dtype=np.int64)

    @property
    def registered(self) -> BoolArray:
        """Return which photographs (F,) have a pose."""
        return np.array([pose is not None for pose in self.poses], dtype=bool)

    @property
    def photograph_names(self) -> tuple[str, ...]:
        """Return the names of the photographs."""
        return tuple(photograph.name for photograph in self.photographs)

    @property
    def is_free(self) -> bool:
        """Return whether nothing says where the block is: a frame without a CRS, no GNSS position, and of no ground
        point a surveyed position."""
        surveyed = np.isfinite(self.control_points.position_world_m).any()
        return self.frame.is_local and not surveyed and all(p.gnss_world_m is None for p in self.photographs)

    @property
    def has_scale(self) -> bool:
        """Return whether lengths are in metres: a free network has as many as its distances, or the baselines
        of its rigs, give it."""
        return not self.is_free or gives_scale(self.constraints) or give_scale(self.rigs)

    @property
    def surveyed(self) -> Block:
        """The block without the ground points that are marked and not surveyed."""
        points = self.control_points
        known: BoolArray = np.asarray(np.isfinite(points.position_world_m).all(axis=1))
        return self if known.all() else replace(self, control_points=points.select(known))

    def oriented_cameras(self, chosen: Sequence[int] | None = None) -> OrientedCameras:
        """Return the photographs, all or those of the numbers ``chosen``, in their order, as compiled code takes them;
        NaN for those that have no pose."""
        index = range(len(self.photographs)) if chosen is None else chosen
        return oriented_by(self.cameras, self.camera_of[list(index)], [self.poses[i] for i in index])

    def _facts(self) -> list[tuple[str, str]]:
        tie, ground = self.tie_points, self.control_points
        control = ground.role.count("control")
        return [
            ("photographs", f"{len(self.photographs)}, {self.registered.sum()} oriented"),
            ("cameras", ", ".join(camera.name for camera in self.cameras)),
            ("tie points", f"{len(tie)}, {things(len(tie.point), 'observation')}"),
            ("control points", str(control)),
            ("check points", str(len(ground) - control)),
            ("marks", str(len(ground.mark_point))),
            ("frame", f"{self.frame.kind} in {self.frame.crs}"),
        ]

    def __repr__(self) -> str:
        parts = (
            f"{things(len(self.photographs), 'photograph')} ({self.registered.sum()} oriented)",
            things(len(self.cameras), "camera"),
            things(len(self.tie_points), "tie point"),
            things(len(self.control_points), "ground point"),
        )
        return f"<Block: {', '.join(parts)}>"

    def _repr_html_(self) -> str:
        return html_table("Block", (), self._facts())


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in the project's CRS."""

    position_map_m: FloatArray
    """Easting, northing, height (N, 3)."""
    colour: ByteArray | None = None
    """Red, green, blue (N, 3), uint8, or None."""
    sigma_m: FloatArray | None = None
    """Standard deviations (N, 3), or None."""

    def __post_init__(self) -> None:
        n = len(self.position_map_m)
        check_shapes(self, position_map_m=(n, 3), colour=(n, 3), sigma_m=(n, 3))

    def __len__(self) -> int:
        return len(self.position_map_m)

    def __repr__(self) -> str:
        more = [word for word, value in (("colour", self.colour), ("sigma", self.sigma_m)) if value is not None]
        return f"<PointCloud: {things(len(self), 'point')}{', with ' if more else ''}{' and '.join(more)}>"

    def select(self, keep: BoolArray) -> PointCloud:
        """Return the points of a mask (N,)."""
        colour = None if self.colour is None else self.colour[keep]
        return PointCloud(self.position_map_m[keep], colour, None if self.sigma_m is None else self.sigma_m[keep])

    def summary(self) -> str:
        """Return count, extent and median standard deviations as a table of text."""
        rows = [("points", str(len(self)))]
        if len(self):
            low, high = self.position_map_m.min(axis=0), self.position_map_m.max(axis=0)
            axes = zip(("easting", "northing", "height"), low, high, strict=True)
            rows += [(name, f"{first:.3f} to {last:.3f} m") for name, first, last in axes]
        if len(self) and self.sigma_m is not None:
            east, north, up = np.median(self.sigma_m, axis=0)
            rows.append(("sigma, median east, north, up", f"{east:.4f}, {north:.4f}, {up:.4f} m"))
        return text_table(rows)

    def plot(self) -> None:
        """Draw it from above in the current axes of matplotlib, in its colours or by height."""
        call("plot_cloud", self)

    def write(self, path: Path | str, crs: str = NO_CRS) -> None:
        """Write it in ``crs`` as .laz, or as .xyz, .txt or .csv with a line for a point.

        Raises ProjectError for another suffix, FrameError where ``crs`` is no map grid, WorkspaceError where the file
        cannot be written.
        """
        call("write_cloud", Path(path), self, crs)

    @classmethod
    def from_world(
        cls, frame: LocalFrame, position_world_m: FloatArray, colour: ByteArray, sigma_m: FloatArray | None = None
    ) -> PointCloud:
        """Return points (N, 3) of the world as a cloud in the map, without those where the geoid has no height."""
        position = frame.map_from_world(position_world_m)
        known = np.isfinite(position).all(axis=1)
        return cls(position[known], colour[known], None if sigma_m is None else sigma_m[known])


@dataclass(frozen=True, eq=False)
class Raster:
    """A grid of square cells in the project's CRS."""

    values: Float32Array
    """Values (rows, columns), rows going south; NaN for no data."""
    west_map_m: float
    """Easting of the outer corner of cell (0, 0)."""
    north_map_m: float
    """Northing of the outer corner of cell (0, 0)."""
    cell_m: float
    """Side of a cell."""

    def __post_init__(self) -> None:
        check_shapes(self, values=(None, None))
        if not self.cell_m > 0:
            raise ValueError("the cell size of a raster must be positive")

    def __repr__(self) -> str:
        rows, columns = self.values.shape
        known = np.isfinite(self.values).mean() if self.values.size else 0.0
        return f"<Raster: {rows} × {columns} cells of {self.cell_m:g} m, {percent(known)} with data>"

    def summary(self) -> str:
        """Return size, place and values as a table of text."""
        rows, columns = self.values.shape
        known = self.values[np.isfinite(self.values)]
        facts = [
            ("cells", f"{rows} × {columns} of {self.cell_m:g} m"),
            ("easting", f"{self.west_map_m:.3f} to {self.west_map_m + columns * self.cell_m:.3f} m"),
            ("northing", f"{self.north_map_m - rows * self.cell_m:.3f} to {self.north_map_m:.3f} m"),
            ("with data", percent(known.size / max(self.values.size, 1), 1)),
        ]
        if known.size:
            facts.append(
                ("values: least, median, largest", f"{known.min():.3f}, {np.median(known):.3f}, {known.max():.3f}")
            )
        return text_table(facts)

    def plot(self) -> None:
        """Draw it in the current axes of matplotlib, as a picture in the map with a bar of its values."""
        call("plot_raster", self)

    def write(self, path: Path | str, crs: str) -> None:
        """Write it in ``crs`` as a Cloud Optimized GeoTIFF.

        Raises FrameError where ``crs`` is no map grid, WorkspaceError where the file cannot be written.
        """
        call("write_raster", Path(path), self, crs)


INDEX_EVERY = 5
"""Every fifth line is an index contour: those through multiples of five intervals."""


@dataclass(frozen=True, eq=False)
class Contours:
    """Contour lines (L) and their vertices (V)."""

    height_m: FloatArray
    """Height of each line (L,)."""
    vertex_map_m: FloatArray
    """Easting, northing (V, 2) of the vertices of all lines."""
    first: IntArray
    """Index (L + 1,) of the first vertex of each line; a line is closed if its last vertex repeats the first; higher
    ground is on its right."""
    interval_m: float
    """Contour interval."""
    cell_m: float
    """Side of the contoured cells."""

    def __post_init__(self) -> None:
        check_shapes(self, vertex_map_m=(None, 2), first=(len(self.height_m) + 1,))

    def __len__(self) -> int:
        return len(self.height_m)

    def __repr__(self) -> str:
        return f"<Contours: {things(len(self), 'line')}, every {self.interval_m:g} m>"

    @property
    def is_index(self) -> BoolArray:
        """Return which lines (L,) are index contours."""
        return np.asarray(np.rint(self.height_m / self.interval_m).astype(np.int64) % INDEX_EVERY == 0)
