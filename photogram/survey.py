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

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray, check_shape
from photogram.camera import Camera, Pose, oriented_by
from photogram.frames import LocalFrame
from photogram.projection import OrientedCameras
from photogram.wording import html_table, things

Role = Literal["control", "check"]
Roles = tuple[Role, Role]
"""The role of a ground point in plan and in height."""


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

    def __repr__(self) -> str:
        measured = [
            word
            for word, value in (("GNSS", self.gnss_world_m), ("attitude", self.attitude_world_from_camera))
            if value is not None
        ]
        known = f"{' and '.join(measured) or 'nothing'} measured"
        return f"<Photograph {self.name}: camera {self.camera}, flight {self.flight}, {known}>"

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

    def __repr__(self) -> str:
        return f"<Features: {things(len(self), 'key point')}>"


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

    def __repr__(self) -> str:
        return f"<Matches of photographs {self.first} and {self.second}: {things(len(self), 'match', 'matches')}>"


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

    def __repr__(self) -> str:
        control = self.role.count("control")
        counts = f"{things(control, 'control point')}, {things(len(self) - control, 'check point')}"
        return f"<ControlPoints: {counts}, {things(len(self.mark_point), 'mark')}>"

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

    def oriented_cameras(self, chosen: Sequence[int] | None = None) -> OrientedCameras:
        """Return the photographs, all or those of the numbers ``chosen``, in their order, as compiled code takes them;
        NaN for those that have no pose."""
        index = range(len(self.photographs)) if chosen is None else chosen
        camera_of = np.array([self.photographs[i].camera for i in index], dtype=np.int64)
        return oriented_by(self.cameras, camera_of, [self.poses[i] for i in index])

    def _facts(self) -> list[tuple[str, str]]:
        oriented = sum(pose is not None for pose in self.poses)
        tie, ground = self.tie_points, self.control_points
        control = ground.role.count("control")
        return [
            ("photographs", f"{len(self.photographs)}, {oriented} oriented"),
            ("cameras", ", ".join(camera.name for camera in self.cameras)),
            ("tie points", f"{len(tie)}, {things(len(tie.point), 'observation')}"),
            ("control points", str(control)),
            ("check points", str(len(ground) - control)),
            ("marks", str(len(ground.mark_point))),
            ("frame", f"{self.frame.kind} in {self.frame.crs}"),
        ]

    def __repr__(self) -> str:
        oriented = sum(pose is not None for pose in self.poses)
        parts = (
            f"{things(len(self.photographs), 'photograph')} ({oriented} oriented)",
            things(len(self.cameras), "camera"),
            things(len(self.tie_points), "tie point"),
            things(len(self.control_points), "ground point"),
        )
        return f"<Block: {', '.join(parts)}>"

    def _repr_html_(self) -> str:
        return html_table("Block", (), self._facts())


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

    def __repr__(self) -> str:
        more = [word for word, value in (("colour", self.colour), ("sigma", self.sigma_m)) if value is not None]
        return f"<PointCloud: {things(len(self), 'point')}{', with ' if more else ''}{' and '.join(more)}>"

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

    def __repr__(self) -> str:
        rows, columns = self.values.shape
        known = np.isfinite(self.values).mean() if self.values.size else 0.0
        return f"<Raster: {rows} × {columns} cells of {self.cell_m:g} m, {known:.0%} with data>"


INDEX_EVERY = 5
"""Every fifth line is an index contour: those through multiples of five intervals."""


@dataclass(frozen=True, eq=False)
class Contours:
    """Lines of one height each: ``height_m`` (L,), and of all lines the vertices ``vertex_map_m`` (V, 2).

    Line n has the vertices ``first[n]`` to ``first[n + 1]`` (L + 1,); it is closed where the last is the first again,
    and higher ground lies to its right. ``interval_m`` is the difference of two neighbours, ``cell_m`` the side of the
    cells that were contoured.
    """

    height_m: FloatArray
    vertex_map_m: FloatArray
    first: IntArray
    interval_m: float
    cell_m: float

    def __post_init__(self) -> None:
        check_shape("vertex_map_m", self.vertex_map_m, (None, 2))
        check_shape("first", self.first, (len(self.height_m) + 1,))

    def __len__(self) -> int:
        return len(self.height_m)

    def __repr__(self) -> str:
        return f"<Contours: {things(len(self), 'line')}, every {self.interval_m:g} m>"

    @property
    def is_index(self) -> NDArray[np.bool_]:
        """Return which lines (L,) are index contours."""
        return np.asarray(np.rint(self.height_m / self.interval_m).astype(np.int64) % INDEX_EVERY == 0)
