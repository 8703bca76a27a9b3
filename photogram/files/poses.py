"""Exterior orientation for other programs: a table (CSV), and for a GIS places and footprints (GeoJSON each)."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, gimbal_from_rotation, image_plane, omega_phi_kappa_deg
from photogram.errors import ImageError
from photogram.files.atomic import replacing
from photogram.geodesy.crs import MapUnits, esri_wkt
from photogram.geodesy.frames import geodetic_from_map
from photogram.results import Adjustment
from photogram.survey import Photograph
from photogram.wording import table_cell

COLUMNS = (
    "name", "camera", "flight", "registered",
    "easting_m", "northing_m", "height_m", "heading_deg", "nadir_angle_deg",
    "omega_deg", "phi_deg", "kappa_deg", "yaw_deg", "pitch_deg", "roll_deg",
    "sigma_easting_m", "sigma_northing_m", "sigma_height_m", "sigma_x_deg", "sigma_y_deg", "sigma_z_deg",
    "crs",
)  # fmt: skip
"""Of the table; all but the last are properties of the points. Of a map in feet the names of lengths end in ft or ftUS;
see ``columns_in``."""

_FIGURES = COLUMNS[4:-1]
STEEPEST = 0.1
"""Sine of the flattest ray, below the horizon, that still makes a footprint."""

STEADY_DEG = 45.0
"""Angle off the nadir up to which the top of a photograph says where it is headed, and the optical axis beyond."""

_NO_HEADING = 1e-6


def columns_in(units: MapUnits) -> dict[str, str]:
    """Return what COLUMNS are called in a map of such units, each by its name in metres."""
    return {name: _in_units(name, units) for name in COLUMNS}


def _in_units(name: str, units: MapUnits) -> str:
    stem, ending = name.removesuffix("_m"), units.height_symbol if "height" in name else units.plan_symbol
    return f"{stem}_{ending}" if name.endswith("_m") else name


def heading_and_nadir_angle_deg(rotation_true_from_camera: FloatArray) -> FloatArray:
    """Return where the top of a photograph points, clockwise from north, 0 to 360, and by how much it looks off the
    nadir, 0 straight down (2,), from its rotation (3, 3) to true east, north and up.

    Beyond STEADY_DEG off the nadir the heading is that of the optical axis; NaN straight up, where there is none.
    """
    R = rotation_true_from_camera
    nadir_angle_deg = float(np.rad2deg(np.arctan2(np.hypot(R[0, 2], R[1, 2]), -R[2, 2])))
    east, north, _ = -R[:, 1] if nadir_angle_deg <= STEADY_DEG else R[:, 2]
    known = np.hypot(east, north) > _NO_HEADING
    return np.array([np.rad2deg(np.arctan2(east, north)) % 360.0 if known else np.nan, nadir_angle_deg])


def _description(result: Adjustment, photograph: Photograph, registered: bool) -> dict[str, Any]:
    camera = result.block.cameras[photograph.camera].name
    return {"name": photograph.name, "camera": camera, "flight": photograph.flight, "registered": registered}


def _figures(result: Adjustment, index: int, pose: Pose, finer: int = 0) -> dict[str, float | None]:
    """Return the figures of _FIGURES of a photograph, lengths in the units of the map and rounded to four decimals or
    so many ``finer``, angles to 1e-8 degrees; None where one is not known."""
    frame, position, R = result.block.frame, pose.position_world_m, pose.rotation_world_from_camera
    world_from_map = frame.rotation_world_from_map(position)
    covariance = world_from_map.T @ result.covariances.position_m2[index] @ world_from_map
    true_from_camera = frame.rotation_world_from_true(position).T @ R
    values = np.concatenate(
        [
            frame.map_from_world(position[None])[0] / frame.units.factors,
            heading_and_nadir_angle_deg(true_from_camera),
            omega_phi_kappa_deg(world_from_map.T @ R),
            np.array(gimbal_from_rotation(true_from_camera)),
            np.sqrt(np.diag(covariance)) / frame.units.factors,
            np.rad2deg(np.sqrt(np.diag(result.covariances.rotation_rad2[index]))),
        ]
    )
    named = zip(_FIGURES, values.tolist(), strict=True)
    return {name: round(value, _digits(name, finer)) if np.isfinite(value) else None for name, value in named}


def _digits(column: str, finer: int) -> int:
    return 4 + finer if column.endswith("_m") else 8


def write_pose_table(path: Path, result: Adjustment, crs: str | None = None) -> None:
    """Write one line per photograph, in the order of the project; of those that are not registered the figures are
    empty. Beside it stand a ``.csvt`` with the types of the columns and a ``.prj`` with the CRS of easting and
    northing: with them GDAL and QGIS open the table as points. A local frame has no ``.prj``, and two more decimals.

    The first line names the COLUMNS, with the units of the map. ``crs`` in words, else that of the frame, is the last
    of them. Omega, phi, kappa are against the map grid at the photograph, heading, yaw, pitch, roll against true north;
    sigmas of the attitude are about the camera's axes x right, y down, z forward. Raises WorkspaceError where a file
    cannot be written.
    """
    block = result.block
    finer = 2 if block.frame.is_local else 0
    with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS, restval="", lineterminator="\n")
        called = (
            columns_in(block.frame.units) if block.has_scale else {name: name.removesuffix("_m") for name in COLUMNS}
        )
        table.writerow(called)
        for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
            row = {k: table_cell(v) for k, v in _description(result, photograph, True).items() if isinstance(v, str)}
            row["crs"] = crs or block.frame.crs
            row["registered"] = "yes" if pose is not None else "no"
            if pose is not None:
                figures = _figures(result, i, pose, finer)
                row |= {name: f"{x:.{_digits(name, finer)}f}" for name, x in figures.items() if x is not None}
            table.writerow(row)
    places = {"easting_m": "CoordX", "northing_m": "CoordY"}
    kinds = [places.get(name, "Real" if name in _FIGURES else "String") for name in COLUMNS]
    with replacing(path.with_suffix(".csvt")) as partial:
        partial.write_text(",".join(f'"{kind}"' for kind in kinds) + "\n", encoding="ascii")
    if block.frame.is_local:
        return
    with replacing(path.with_suffix(".prj")) as partial:
        partial.write_text(esri_wkt(block.frame.crs) + "\n", encoding="utf-8")


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


def write_pose_geojson(path: Path, footprints: Path, result: Adjustment, datum_grid: str | None = None) -> None:
    """Write photographs as points and their ``footprints`` as polygons, a file for each, in WGS 84 longitude and
    latitude (RFC 7946).

    The properties of a point are the COLUMNS of the table without the CRS, that of a polygon is the ``name`` of its
    photograph. A photograph that is not registered stands where GNSS says, without a geometry where nothing does.
    ``datum_grid`` is the file with the shifts between WGS 84 and the map, where one is used. Footprints lie on the mean
    height of the tie points; ``footprint_world_m`` says which photographs have none. Raises WorkspaceError where a file
    cannot be written.
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
    geodetic[known] = geodetic_from_map(frame.crs, frame.map_from_world(places[known]), datum_grid)[:, :2]
    points, polygons, called = [], [], columns_in(frame.units)
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        point, *ring = np.round(geodetic[i], 9).tolist()
        properties = _description(result, photograph, pose is not None)
        if pose is not None:
            figures = _figures(result, i, pose)
            properties |= {called[name]: figure for name, figure in figures.items()}
        points.append(_feature("Point", point if known[i, 0] else None, properties))
        if known[i, 1]:
            polygons.append(_feature("Polygon", [ring], {"name": photograph.name}))
    for file, features in ((path, points), (footprints, polygons)):
        with replacing(file) as partial, partial.open("w", encoding="utf-8") as stream:
            json.dump({"type": "FeatureCollection", "features": features}, stream, ensure_ascii=False, allow_nan=False)
            stream.write("\n")
