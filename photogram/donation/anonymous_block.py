"""A block without what tells where and when it was measured, and by whom; what is measured stays.

Places are brought to Cartesian axes along the map's easting, northing and height at the middle of the site, so that
standard deviations along the axes of the map stay what they are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Pose
from photogram.constraints.between_points import CommonSurface, Constraint
from photogram.constraints.rigs import Companion
from photogram.errors import PhotogramError
from photogram.geodesy.frames import LocalFrame
from photogram.survey import TRANSFERRED, Block, ControlPoints, Photograph, TiePoints

FIRST_EXPOSURE = datetime(2000, 1, 1, tzinfo=UTC)
STEPS_PX = 1024.0
"""Image coordinates of tie points are kept to a 1024th of a pixel."""
STEPS = 1e7
"""Starting positions are kept to a ten-millionth of the site's extent."""
ABSENT = "a point that is not in the block"


@dataclass(frozen=True, eq=False)
class SiteAxes:
    """Axes of a site: ``site_from_world`` (3, 3) turns to them from the world, whose point ``middle_world_m`` (3,) is
    their origin."""

    site_from_world: FloatArray
    middle_world_m: FloatArray

    @staticmethod
    def of(block: Block) -> "SiteAxes":
        """Return those of a block that is oriented: along the map, at the median of its projection centres."""
        centres = np.array([pose.position_world_m for pose in block.poses if pose is not None]).reshape(-1, 3)
        if not len(centres):
            raise PhotogramError("no photograph is oriented, so there is nothing to donate")
        return SiteAxes(block.frame.rotation_world_from_map(np.zeros(3)).T, np.median(centres, axis=0))

    def places(self, world_m: FloatArray) -> FloatArray:
        """Return places (..., 3) of the world in the axes of the site, NaN where they are."""
        return np.asarray((world_m - self.middle_world_m) @ self.site_from_world.T)

    def place(self, world_m: FloatArray | None) -> FloatArray | None:
        """Return a place (3,), None where there is none."""
        return None if world_m is None else self.places(world_m)

    def turned(self, value: FloatArray | None) -> FloatArray | None:
        """Return a vector (3,) or a rotation (3, 3), world from camera, in the axes of the site, None where there is
        none."""
        return None if value is None else np.asarray(self.site_from_world @ value)

    def pose(self, pose: Pose | None) -> Pose | None:
        """Return a pose, None where there is none."""
        if pose is None:
            return None
        return Pose(self.site_from_world @ pose.rotation_world_from_camera, self.places(pose.position_world_m))


def numbered(names: Sequence[str], word: str) -> dict[str, str]:
    """Return for each name one that says nothing, in the order in which they first stand."""
    return {name: f"{word} {number}" for number, name in enumerate(dict.fromkeys(names), start=1)}


def _photographs(block: Block, axes: SiteAxes, names: Mapping[str, str]) -> tuple[Photograph, ...]:
    flights = numbered([p.flight for p in block.photographs], "flight")
    captures = numbered([p.capture for p in block.photographs if p.capture is not None], "exposure")
    times = [p.time_s for p in block.photographs if p.time_s is not None]
    first = min(times, default=0.0)
    return tuple(
        replace(
            p,
            name=names[p.name],
            path=None,
            flight=flights[p.flight],
            capture=None if p.capture is None else captures[p.capture],
            time=None if p.time_s is None else FIRST_EXPOSURE + timedelta(seconds=p.time_s - first),
            gnss_world_m=axes.place(p.gnss_world_m),
            attitude_world_from_camera=axes.turned(p.attitude_world_from_camera),
            velocity_world_m_s=axes.turned(p.velocity_world_m_s),
        )
        for p in block.photographs
    )


def _tie_points(ties: TiePoints, axes: SiteAxes) -> TiePoints:
    """Return tie points without colours and numbers of key points, coordinates rounded."""
    places = axes.places(ties.position_world_m)
    known = places[np.isfinite(places).all(axis=1)]
    step = float(np.ptp(known, axis=0).max()) / STEPS if len(known) else 0.0
    return replace(
        ties,
        feature=np.where(ties.feature == TRANSFERRED, TRANSFERRED, 0),
        pixel=np.round(ties.pixel * STEPS_PX) / STEPS_PX,
        position_world_m=np.round(places / step) * step if step else places,
        colour=np.zeros_like(ties.colour),
    )


def _control_points(points: ControlPoints, axes: SiteAxes, names: Mapping[str, str]) -> ControlPoints:
    return replace(
        points, name=tuple(names[name] for name in points.name), position_world_m=axes.places(points.position_world_m)
    )


def _constraint(constraint: Constraint, number: int, names: Mapping[str, str]) -> Constraint:
    """Return a constraint between points of other names, with a number for its own."""
    points, name = tuple(names.get(point, ABSENT) for point in constraint.points), f"constraint {number}"
    if isinstance(constraint, CommonSurface):
        return replace(constraint, points=points, name=name)
    return replace(constraint, ends=(points[0], points[1]), name=name)


def _rig(rig: Companion, cameras: Mapping[str, str], photographs: Mapping[str, str]) -> Companion:
    exposures = tuple((photographs[own], photographs[other]) for own, other in rig.exposures)
    return replace(rig, name=cameras[rig.name], master=cameras[rig.master], exposures=exposures)


def anonymous(block: Block, axes: SiteAxes) -> Block:
    """Return a measured block with numbers for names, without paths, dates, colours and a CRS, in the axes of the site.

    Times of exposure are counted from the first. Image coordinates of tie points are rounded to a 1024th of a pixel, so
    that the file is small; marks and all that was surveyed stay as they are.
    """
    photographs = numbered(block.photograph_names, "photograph")
    cameras = numbered([camera.name for camera in block.cameras], "camera")
    points = numbered(block.control_points.name, "point")
    constraints = enumerate(block.constraints, start=1)
    return replace(
        block,
        frame=LocalFrame.local(),
        cameras=tuple(replace(camera, name=cameras[camera.name]) for camera in block.cameras),
        photographs=_photographs(block, axes, photographs),
        poses=tuple(axes.pose(pose) for pose in block.poses),
        tie_points=_tie_points(block.tie_points, axes),
        control_points=_control_points(block.control_points, axes, points),
        constraints=tuple(_constraint(c, n, photographs if c.of_photographs else points) for n, c in constraints),
        rigs=tuple(_rig(rig, cameras, photographs) for rig in block.rigs),
    )
