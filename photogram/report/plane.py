"""What report.json and plane.json say of the plane that a surface was made on, and ground points in its frame."""

from collections.abc import Sequence

import numpy as np

from photogram.arrays import FloatArray
from photogram.geodesy.frames import LocalFrame
from photogram.report.record.ground import AxisRole, GroundPointRecord
from photogram.report.record.surfaces import AxesRecord, PlaneFileRecord, PlaneFrameRecord, PlaneRecord
from photogram.report.values import record_of
from photogram.surface.reference_plane import PlaneFit, ReferencePlane
from photogram.wording import percent

PLANE_NOTE = (
    "Coordinates on a plane, m: x to the right, y up the plane, heights in front of it; plane.json turns them into the "
    "survey's"
)
"""What a raster on a plane says of its coordinates."""

_STEP_M = 10.0


def plane_numbers(
    fit: PlaneFit,
    frame: LocalFrame,
    corner_plane_m: FloatArray,
    beyond: int,
    left_out: Sequence[str],
) -> PlaneRecord:
    """Return the key `plane` of report.json; ``corner_plane_m`` (2, 2) are the least and the greatest x and y of the
    surface, ``beyond`` the points that are no part of it, ``left_out`` products that are not made on a plane."""
    plane = fit.plane
    facing_deg = None
    if plane is not None and not frame.is_local:
        east, north, _ = plane.rotation_world_from_plane[:, 2]
        facing_deg = float(np.rad2deg(np.arctan2(east, north)) % 360.0)
    return record_of(
        PlaneRecord,
        fit,
        used=plane is not None,
        facing_deg=facing_deg,
        share_on_plane=fit.on_plane,
        within_m=fit.band_m,
        points_beyond=beyond,
        frame=None if plane is None else _frame_numbers(plane, frame, corner_plane_m, fit.relief_m),
        left_out=list(left_out),
        sentence=_sentence(fit, facing_deg, left_out),
    )


def _frame_numbers(
    plane: ReferencePlane, frame: LocalFrame, corner_plane_m: FloatArray, relief_m: float
) -> PlaneFrameRecord:
    origin = plane.world_from_plane(np.zeros((1, 3)))
    steps = _STEP_M * np.vstack([np.eye(3), -np.eye(3)])
    ends = frame.map_from_world(plane.world_from_plane(steps))
    along, origin_map_m = (ends[:3] - ends[3:]) / (2.0 * _STEP_M), frame.map_from_world(origin)[0]
    (west, south), (east, north) = corner_plane_m
    box = np.array([(x, y, z) for x in (west, east) for y in (south, north) for z in (-relief_m, relief_m)])
    error_m = frame.map_from_world(plane.world_from_plane(box)) - (origin_map_m + box @ along)
    worst_m = float(np.linalg.norm(error_m, axis=1).max())
    return {
        "origin_world_m": plane.origin_world_m.tolist(),
        "axes_world": _axes(plane.rotation_world_from_plane.T),
        "origin_map_m": origin_map_m.tolist(),
        "axes_map": _axes(along),
        "map_error_m": worst_m if np.isfinite(worst_m) else None,
    }


def _axes(axes: FloatArray) -> AxesRecord:
    x, y, z = axes.tolist()
    return {"x": x, "y": y, "z": z}


def _sentence(fit: PlaneFit, facing_deg: float | None, left_out: Sequence[str]) -> str:
    fitted = (
        f"a plane fitted to {fit.points} tie points, {percent(fit.on_plane)} of which lie within "
        f"{fit.band_m:.2g} m of it (NMAD {fit.nmad_m:.2g} m)"
    )
    if fit.plane is None:
        leans = f"leans {fit.tilt_deg:.1f}° from level, and a level plane is the map’s"
        return f"The surface lies on the map: {fitted} {leans}"
    faces = "" if facing_deg is None else f" and faces {facing_deg:.0f}° from north"
    without = f". {' and '.join(left_out).capitalize()}: not made, they belong on a map" if left_out else ""
    return (
        f"The surface lies on {fitted}. It leans {fit.tilt_deg:.1f}° from level{faces}. Coordinates are "
        "x to the right, y up the plane, and heights the distance in front of it; plane.json turns them into the "
        f"survey’s{without}"
    )


def plane_file(record: PlaneFrameRecord, frame: LocalFrame) -> PlaneFileRecord:
    """Return what plane.json holds."""
    return {
        "about": (
            "Rasters on a plane: x to the right, y up the plane, z in front of it, m; x and y are the coordinates of a "
            "cell, z its height. World: origin_world_m + x · axes_world.x + y · axes_world.y + z · axes_world.z, "
            "exactly. Easting, northing, height: the same with origin_map_m and axes_map, within map_error_m "
            "everywhere on the surface. The world's own origin in the map is world.origin_map_m."
        ),
        "crs": frame.crs,
        "world": {"kind": frame.kind, "origin_map_m": list(frame.origin_map_m)},
        **record,
    }


def points_on_plane(
    points: Sequence[GroundPointRecord], plane: ReferencePlane, frame: LocalFrame
) -> list[GroundPointRecord]:
    """Return ground points with their surveyed and adjusted places, and the sigmas of the survey, along the axes of a
    plane. Those axes mix the map's: a point tests a surface there where none of its coordinates took part."""
    R = plane.rotation_world_from_plane.T @ frame.rotation_world_from_map(plane.origin_world_m)

    def placed(map_m: Sequence[float]) -> list[float]:
        world = frame.world_from_map(np.array(map_m, dtype=np.float64)[None])
        return [float(x) for x in plane.plane_from_world(world)[0]]

    turned = list[GroundPointRecord]()
    for point in points:
        sigma = np.array([np.nan if s is None else s for s in point["surveyed_sigma_m"]])
        along = np.sqrt(R**2 @ sigma**2)
        adjusted = point["adjusted_map_m"]
        role: AxisRole = "check" if all(role == "check" for role in point["axis_roles"]) else "control"
        turned.append(
            {
                **point,
                "axis_roles": [role, role, role],
                "surveyed_map_m": placed(point["surveyed_map_m"]),
                "surveyed_sigma_m": [float(s) if np.isfinite(s) else None for s in along],
                "adjusted_map_m": None if adjusted is None else placed(adjusted),
            }
        )
    return turned
