"""The solution of a survey as ODM hands it back: places and attitudes of the photographs, cameras, a few figures.

Angles and axes are OpenSfM's, which are photogram's: a camera looks along z, x right and y down. An attitude is the
rotation from the map to the camera as a vector: its axis, times the angle in radians. Focal lengths, principal points
and distortion are counted in the longer side of the picture, and principal points from its middle.
"""

from collections.abc import Iterator, Mapping

import cv2
import numpy as np

from photogram.geodesy.frames import geodetic_from_map
from photogram.report.record.block import CameraRecord
from photogram.report.record.report import Report

Json = Mapping[str, object]


def shots(report: Report, crs: str) -> Json:
    """Return the photographs that were oriented as GeoJSON, in longitude and latitude; ``translation`` is the place in
    ``crs``. Raises FrameError where that is no map grid."""
    features, cameras = list[Json](), report["cameras"]
    for name, photograph in report["photographs"].items():
        if photograph["registered"] is not True:
            continue
        camera = cameras[photograph["camera"]]
        place = photograph["position_map_m"]
        geodetic = geodetic_from_map(crs, np.array([place]))[0]
        rotation, _ = cv2.Rodrigues(np.array(photograph["rotation_camera_from_map"], dtype=np.float64))
        features.append(
            {
                "type": "Feature",
                "properties": {
                    "filename": name,
                    "camera": photograph["camera"],
                    "focal": camera["focal_px"] / _size_px(camera),
                    "width": int(camera["width_px"]),
                    "height": int(camera["height_px"]),
                    "translation": list(place),
                    "rotation": rotation.ravel().tolist(),
                },
                "geometry": {"type": "Point", "coordinates": geodetic.tolist()},
            }
        )
    return {"type": "FeatureCollection", "features": features}


def cameras(report: Report) -> Json:
    """Return the cameras as OpenSfM writes them."""
    return {name: _camera(camera) for name, camera in report["cameras"].items()}


def left_out_of_cameras(report: Report) -> Iterator[str]:
    """Yield what OpenSfM's camera models have no place for, a sentence for each."""
    for name, camera in report["cameras"].items():
        is_brown, radial, b2 = camera["model"] != "fisheye", camera["radial"], camera["affinity"][1]
        if b2:
            yield f"cameras.json has no place for b2 of {name}, {b2:.3g} px: report.json has it"
        if is_brown and len(radial) > 3 and radial[3]:
            yield f"cameras.json has no place for k4 of {name}, {radial[3]:.3g}: report.json has it"
        if not is_brown and any(camera["tangential"]):
            yield f"cameras.json has no place for p1 and p2 of {name}: report.json has them"
        if (field := camera.get("lens_field")) and field["estimated"]:
            yield f"cameras.json has no place for the lens field of {name}: report.json tells of it"


def _size_px(camera: CameraRecord) -> float:
    return float(max(camera["width_px"], camera["height_px"]))


def _camera(camera: CameraRecord) -> Json:
    size, (u, v) = _size_px(camera), camera["principal_point_px"]
    radial = [*camera["radial"], 0.0][:4]
    is_fisheye = camera["model"] == "fisheye"
    distortion = dict(zip(("k1", "k2", "k3", "k4") if is_fisheye else ("k1", "k2", "k3"), radial, strict=False))
    p1, p2 = camera["tangential"]
    return {
        "projection_type": "fisheye_opencv" if is_fisheye else "brown",
        "width": int(camera["width_px"]),
        "height": int(camera["height_px"]),
        "focal_x": (camera["focal_px"] + camera["affinity"][0]) / size,
        "focal_y": camera["focal_px"] / size,
        "c_x": (u - (camera["width_px"] - 1) / 2) / size,
        "c_y": (v - (camera["height_px"] - 1) / 2) / size,
        **distortion,
        **({} if is_fisheye else {"p1": p1, "p2": p2}),
    }


def odm_statistics(report: Report, dense_points: int | None) -> Json:
    """Return figures of a survey where WebODM looks for them in ODM's `stats.json`: the ground sampling distance in cm,
    the area in m², the number of points; what is not known is left out."""
    block = report["block"]
    gsd_m, overlap = block["gsd_m"], block["overlap"]
    figures: dict[str, object] = {
        "odm_processing_statistics": {} if gsd_m is None else {"average_gsd": 100.0 * gsd_m},
        "processing_statistics": {} if overlap is None else {"area": overlap["area_m2"]},
        "reconstruction_statistics": {
            "reconstructed_points_count": block["tie_points"],
            "reconstructed_shots_count": block["registered"],
            "initial_shots_count": block["photographs"],
            "has_gps": block["gnss_residual_rms_m"]["plan"] is not None,
            "has_gcp": any(point["role"] == "control" for point in report["control_points"]),
        },
        "point_cloud_statistics": {"dense": dense_points is not None},
    }
    if dense_points is not None:
        figures["point_cloud_statistics"] = {"dense": True, "stats": {"statistic": [{"count": dense_points}]}}
    return figures
