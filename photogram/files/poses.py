"""Exterior orientation for other programs: a table (CSV), and places and footprints for a GIS (GeoJSON)."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photogram.camera import Camera, Pose, gimbal_from_rotation, image_plane, omega_phi_kappa_deg
from photogram.errors import ImageError
from photogram.files.atomic import replacing
from photogram.frames import geodetic_from_map
from photogram.printable import table_cell
from photogram.survey import Adjustment, FloatArray, Photograph

COLUMNS = (
    "name", "camera", "flight", "registered",
    "easting_m", "northing_m", "height_m", "omega_deg", "phi_deg", "kappa_deg", "yaw_deg", "pitch_deg", "roll_deg",
    "sigma_easting_m", "sigma_northing_m", "sigma_height_m", "sigma_x_deg", "sigma_y_deg", "sigma_z_deg",
)  # fmt: skip
STEEPEST = 0.1
"""Sine of the flattest ray, below the horizon, that still makes a footprint."""


@dataclass(frozen=True, eq=False)
class _Exterior:
    """Exterior orientation of one photograph: position and angles with their sigmas, each (3,)."""

    position_map_m: FloatArray
    omega_phi_kappa_deg: FloatArray
    yaw_pitch_roll_deg: FloatArray
    sigma_position_m: FloatArray
    sigma_attitude_deg: FloatArray


def _exterior(result: Adjustment, index: int, pose: Pose) -> _Exterior:
    frame, position, R = result.block.frame, pose.position_world_m, pose.rotation_world_from_camera
    world_from_map = frame.rotation_world_from_map(position)
    covariance = world_from_map.T @ result.position_covariance_m2[index] @ world_from_map
    return _Exterior(
        frame.map_from_world(position[None])[0],
        omega_phi_kappa_deg(world_from_map.T @ R),
        np.array(gimbal_from_rotation(frame.rotation_world_from_true(position).T @ R)),
        np.sqrt(np.diag(covariance)),
        np.rad2deg(np.sqrt(np.diag(result.rotation_covariance_rad2[index]))),
    )


def _description(result: Adjustment, photograph: Photograph, registered: bool) -> dict[str, Any]:
    camera = result.block.cameras[photograph.camera].name
    return {"name": photograph.name, "camera": camera, "flight": photograph.flight, "registered": registered}


def _figures(exterior: _Exterior) -> dict[str, float | None]:
    """Return the figures of COLUMNS, rounded to 0.1 mm and 1e-8 degrees; None where one is not known."""
    values = np.concatenate(
        [
            exterior.position_map_m,
            exterior.omega_phi_kappa_deg,
            exterior.yaw_pitch_roll_deg,
            exterior.sigma_position_m,
            exterior.sigma_attitude_deg,
        ]
    )
    named = zip(COLUMNS[4:], values.tolist(), strict=True)
    return {name: round(value, _digits(name)) if np.isfinite(value) else None for name, value in named}


def _digits(column: str) -> int:
    return 4 if column.endswith("_m") else 8


def write_pose_table(path: Path, result: Adjustment, crs: str | None = None) -> None:
    """Write one line per photograph, in the order of the project; of those that are not registered the figures are
    empty.

    The first line is a comment that names the CRS (``crs`` in words, else that of the frame), units and conventions,
    the second names the COLUMNS. Omega, phi, kappa are against the map grid at the photograph, yaw, pitch, roll against
    true north; sigmas of the attitude are about the camera's axes x right, y down, z forward. Raises WorkspaceError
    where the file cannot be written.
    """
    block = result.block
    comment = (
        f"# {crs or block.frame.crs}: easting, northing, height in m; angles in degrees: omega, phi, kappa from grid "
        "north, yaw, pitch, roll from true north (DJI gimbal); sigma_x, y, z about the camera's axes right, down, "
        "forward"
    )
    with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        stream.write(comment + "\n")
        table = csv.DictWriter(stream, COLUMNS, restval="", lineterminator="\n")
        table.writeheader()
        for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
            row = {k: table_cell(v) for k, v in _description(result, photograph, True).items() if isinstance(v, str)}
            row["registered"] = "yes" if pose is not None else "no"
            if pose is not None:
                figures = _figures(_exterior(result, i, pose))
                row |= {name: f"{x:.{_digits(name)}f}" for name, x in figures.items() if x is not None}
            table.writerow(row)


def footprint_world_m(camera: Camera, pose: Pose, height_world_m: float) -> FloatArray | None:
    """Return where the corners (4, 3) of a photograph meet a level plane, counter-clockwise from above.

    None where a corner looks above the horizon or less than 6° below it, where the plane is not below the photograph,
    and where the camera's distortion cannot be undone at a corner.
    """
    u, v = camera.width_px - 0.5, camera.height_px - 0.5
    try:
        ideal = image_plane(camera, np.array([[-0.5, -0.5], [-0.5, v], [u, v], [u, -0.5]]))
    except ImageError:
        return None
    ray = np.column_stack([ideal, np.ones(4)]) @ pose.rotation_world_from_camera.T
    above_m = pose.position_world_m[2] - height_world_m
    if above_m <= 0 or np.any(-ray[:, 2] < STEEPEST * np.linalg.norm(ray, axis=1)):
        return None
    return np.asarray(pose.position_world_m + ray * (above_m / -ray[:, 2:]))


def _feature(kind: str, coordinates: object, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = None if coordinates is None else {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def write_pose_geojson(path: Path, result: Adjustment) -> None:
    """Write photographs as points and their footprints as polygons, in WGS 84 longitude and latitude (RFC 7946).

    The properties of a point are the COLUMNS of the table. A photograph that is not registered stands where GNSS says,
    without a geometry where nothing does. Footprints lie on the mean height of the tie points; ``footprint_world_m``
    says which photographs have none. Raises WorkspaceError where the file cannot be written.
    """
    block, frame = result.block, result.block.frame
    heights = block.tie_points.position_world_m[:, 2]
    places = np.full((len(block.photographs), 6, 3), np.nan)
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        if pose is not None:
            places[i, 0] = pose.position_world_m
            corners = None
            if len(heights):
                corners = footprint_world_m(block.cameras[photograph.camera], pose, float(heights.mean()))
            if corners is not None:
                places[i, 1:] = corners[[0, 1, 2, 3, 0]]
        elif photograph.gnss_world_m is not None:
            places[i, 0] = photograph.gnss_world_m
    known = np.isfinite(places).all(axis=2)
    geodetic = np.full((*known.shape, 2), np.nan)
    # all at once: setting up the transformation takes longer than a thousand points
    geodetic[known] = geodetic_from_map(frame.crs, frame.map_from_world(places[known]))[:, :2]
    features = []
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        point, *ring = np.round(geodetic[i], 9).tolist()
        properties = {"kind": "photograph", **_description(result, photograph, pose is not None)}
        if pose is not None:
            properties |= _figures(_exterior(result, i, pose))
        features.append(_feature("Point", point if known[i, 0] else None, properties))
        if known[i, 1]:
            features.append(_feature("Polygon", [ring], {"kind": "footprint", "name": photograph.name}))
    with replacing(path) as partial, partial.open("w", encoding="utf-8") as stream:
        json.dump({"type": "FeatureCollection", "features": features}, stream, ensure_ascii=False, allow_nan=False)
        stream.write("\n")
