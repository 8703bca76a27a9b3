"""view.html: cloud, photographs and ground points in 3-D, in one file that needs no network.

Positions stand in it relative to a local origin, as packed by `packing`; a hand-written WebGL program draws them.
"""

import base64
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import numpy as np
from jinja2 import Environment, StrictUndefined

from photogram.arrays import FloatArray
from photogram.camera import Camera, image_plane_or_nan
from photogram.errors import ReportError
from photogram.files.clouds.described_points import DescribedCloud
from photogram.measures.round_lengths import round_down
from photogram.projection import RADIAL_TERMS
from photogram.report.identity import grouped
from photogram.report.numbers.wording import fixed
from photogram.report.page import templates
from photogram.report.record.block import CameraRecord
from photogram.report.record.report import Report, oriented
from photogram.report.view.cloud_scene import cloud_scene, spacing_m
from photogram.report.view.distances import error_grid
from photogram.report.view.drawn_surface import DrawnSurface
from photogram.report.view.surface_scene import surface_scene
from photogram.report.view.thinning import even_choice
from photogram.wording import printable, shortened

Json = dict[str, Any]

COLOUR_MAPS = {"height": "viridis", "sigma": "cividis_r", "confidence": "magma"}

_METRES = {"plan": "metre", "plan_m": 1.0, "height": "metre", "height_m": 1.0}  # of a local frame
_FARTHEST_M = 20_000.0  # of a cloud from the photographs that it is said to come from
_WIDEST_TANGENT = 1.5  # of the angle off the axis that a frustum is drawn to


def view_page(
    cloud: DescribedCloud,
    report: Report,
    cloud_name: str,
    maximum_points: int,
    pictures: Mapping[str, bytes] = MappingProxyType({}),
    surface: DrawnSurface | None = None,
) -> str:
    """Return the page of a cloud, of the surface where there is one, and of what report.json says of photographs and
    ground points.

    Shows at most ``maximum_points`` of the cloud, evenly thinned. ``cloud_name`` is the file that the cloud came from,
    ``pictures`` small JPEGs of photographs by name. Raises ReportError where cloud and report are far apart.
    """
    _check_together(cloud.position_map_m, report, cloud_name)
    total = len(cloud)
    thinned = cloud.chosen(even_choice(cloud.position_map_m, maximum_points))
    scene, arrays = cloud_scene(thinned)
    origin = np.array(scene["origin_map_m"])
    mesh, mesh_arrays = surface_scene(surface)
    photographs = _photographs(report, origin)
    in_plan = scene["sigma_plan_step_m"] is not None
    scene |= {
        "file": cloud_name,
        "surface": mesh,
        "total": total,
        "units": report["world"].get("units", _METRES),
        "photographs": photographs,
        "frustum_m": _frustum_m(photographs, scene["extent_m"]),
        "points": _ground_points(report),
        "exaggeration": _exaggeration(report, scene["extent_m"]),
        "maps": {name: _colour_map(title) for name, title in COLOUR_MAPS.items()},
        "errors": error_grid(report, origin, np.array(scene["low_m"]), np.array(scene["high_m"]), in_plan),
    }
    encoded = {name: base64.b64encode(picture).decode() for name, picture in pictures.items()}
    template = _environment().get_template("view.html.jinja")
    return template.render(
        title=report["survey"]["name"] or "Photogrammetric survey",
        version=report["photogram"],
        system=_system(report),
        scene=scene,
        arrays=arrays | mesh_arrays,
        pictures=encoded,
        identity=f"report {grouped(report['report_id'])}, processed {report['processed']}",
    )


@cache
def _environment() -> Environment:
    environment = templates(StrictUndefined)
    environment.filters.update(fixed=fixed, whole=lambda n: fixed(n, 0))
    return environment


def _check_together(position_map_m: FloatArray, report: Report, cloud_name: str) -> None:
    """Raise ReportError where photographs and ground points lie nowhere near the cloud."""
    places = [photograph["position_map_m"] for photograph in oriented(report["photographs"]).values()]
    places += [point["surveyed_map_m"] for point in report["control_points"]]
    if not places:
        return
    known = np.array(places)
    low, high = position_map_m.min(axis=0), position_map_m.max(axis=0)
    apart = np.linalg.norm(np.maximum(np.maximum(low - known, known - high), 0.0), axis=1)
    if apart.min() > _FARTHEST_M:
        raise ReportError(
            f"{cloud_name}: the cloud lies {apart.min() / 1000:.0f} km from every photograph and ground point of "
            f"report.json: give a cloud of this survey in its map grid, {printable(shortened(report['crs'], 60))}"
        )


def _system(report: Report) -> str:
    """Return the reference system of all coordinates in words."""
    name, crs = report["survey"]["crs_name"], report["crs"]
    grid = f"{name} ({crs})" if name and name != crs else crs
    kind = {"ellipsoidal": "heights above the ellipsoid", "orthometric": "heights above the geoid"}
    output = report["heights"]["output"]
    return f"{grid}, {kind.get(str(output), 'heights in the undeclared system of the project')}"


def _colour_map(name: str) -> list[list[int]]:
    """Return 64 colours of a colour map, red, green, blue from 0 to 255."""
    colours = mpl.colormaps[name](np.linspace(0, 1, 64))[:, :3]
    return [[round(255 * float(v)) for v in colour] for colour in colours]


# ---- photographs and ground points ---------------------------------------------------------------------------------


def reported_camera(camera: CameraRecord) -> Camera:
    """Return a camera of report.json as a camera model, without its name and sigmas."""
    return Camera(
        "",
        camera["width_px"],
        camera["height_px"],
        camera["focal_px"],
        np.array(camera["principal_point_px"]),
        radial=np.pad(camera["radial"], (0, RADIAL_TERMS - len(camera["radial"]))),
        tangential=np.array(camera["tangential"]),
        affinity=np.array(camera["affinity"]),
        readout_s=camera.get("readout_s", 0.0),
        model=camera["model"],
    )


def _corner_rays(camera: CameraRecord) -> FloatArray:
    """Return rays (4, 3) to the corners of the format in the camera frame, from the top left clockwise, depth 1.

    A field of view wider than a frustum can show, and corners at which the distortion cannot be undone, are drawn
    narrower: the frustum is a symbol.
    """
    model = reported_camera(camera)
    u, v = model.width_px - 0.5, model.height_px - 0.5
    pixel = np.array([[-0.5, -0.5], [u, -0.5], [u, v], [-0.5, v]])
    ideal = image_plane_or_nan(model, pixel)
    plain = (pixel - model.principal_point_px) / model.focal_px
    ideal = np.where(np.isfinite(ideal), ideal, plain)
    wide = np.maximum(np.linalg.norm(ideal, axis=1, keepdims=True) / _WIDEST_TANGENT, 1.0)
    return np.column_stack([ideal / wide, np.ones(4)])


def _photographs(report: Report, origin_map_m: FloatArray) -> list[Json]:
    """Return the registered photographs: centre relative to the origin, rays to the corners in the map, and sigmas."""
    rays = {name: _corner_rays(camera) for name, camera in report["cameras"].items()}
    return [
        {
            "name": name,
            "camera": photograph["camera"],
            "centre_m": (np.array(photograph["position_map_m"]) - origin_map_m).tolist(),
            "rays": (rays[photograph["camera"]] @ np.array(photograph["rotation_camera_from_map"])).tolist(),
            "sigma_m": photograph["sigma_m"],
            "angles_deg": photograph["omega_phi_kappa_deg"],
            "tie_points": photograph["tie_points"],
        }
        for name, photograph in oriented(report["photographs"]).items()
    ]


def _frustum_m(photographs: list[Json], extent_m: float) -> float:
    """Return how deep frusta are drawn: a part of the way to the next photograph."""
    centres = np.array([photograph["centre_m"] for photograph in photographs]).reshape(-1, 3)
    apart = spacing_m(centres) if len(centres) > 1 else extent_m / 8
    return float(np.clip(0.4 * apart, 0.008 * extent_m, 0.05 * extent_m))


def _ground_points(report: Report) -> list[Json]:
    """Return control and check points with their surveyed positions in the map, residuals and sigmas."""
    return [
        {
            "name": point["name"],
            "role": point["role"],
            "axis_roles": point["axis_roles"],
            "surveyed_map_m": point["surveyed_map_m"],
            "residual_m": point["residual_m"],
            "sigma_m": _all_known(point["sigma_m"]),
            "surveyed_sigma_m": _all_known(point["surveyed_sigma_m"]),
        }
        for point in report["control_points"]
    ]


def _all_known(values: list[float | None] | None) -> list[float] | None:
    """Return three figures, None where one of them is missing."""
    known = [v for v in values or () if v is not None]
    return known if len(known) == 3 else None


def _exaggeration(report: Report, extent_m: float) -> float:
    """Return the round enlargement that draws a large but usual residual or sigma as a fortieth of the survey."""
    points = report["control_points"]
    vectors = [v for p in points for v in (p["residual_m"], _all_known(p["sigma_m"])) if v]
    size = np.linalg.norm(np.array(vectors).reshape(-1, 3), axis=1)
    if not len(size) or not size.max() > 0:
        return 1.0
    return max(round_down(0.025 * extent_m / max(float(np.percentile(size, 90)), 1e-9)), 1.0)
