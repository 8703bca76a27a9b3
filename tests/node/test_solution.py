"""Cameras and photographs as ODM hands them back: the same pixels by OpenSfM's own formulas."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from photogram.node.solution import cameras, left_out_of_cameras, odm_statistics, shots
from photogram.report.reading import read_report
from photogram.report.record.report import Report


@pytest.fixture(scope="module")
def report(finished_survey: Path) -> Report:
    return read_report(finished_survey / "results/quality/report.json")


def opensfm_pixel(camera: dict[str, Any], point_camera: Any) -> Any:
    """Return a pixel, its centre of the top-left one at (0, 0), by OpenSfM's model `brown` (its page on geometry)."""
    x, y = point_camera[0] / point_camera[2], point_camera[1] / point_camera[2]
    r2 = x * x + y * y
    radial = 1 + camera["k1"] * r2 + camera["k2"] * r2**2 + camera["k3"] * r2**3
    p1, p2 = camera["p1"], camera["p2"]
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    size = max(camera["width"], camera["height"])
    normalised = np.array([camera["focal_x"] * u + camera["c_x"], camera["focal_y"] * v + camera["c_y"]])
    return normalised * size + np.array([camera["width"] - 1, camera["height"] - 1]) / 2


def test_ground_points_fall_on_their_marks(report: Report) -> None:
    """Surveyed points through pose and camera of the files that are handed back, in pixels of the photographs."""
    listed = cameras(report)
    features = shots(report, "EPSG:25832")["features"]
    assert isinstance(features, list)
    of_name = {feature["properties"]["filename"]: feature["properties"] for feature in features}
    errors = []
    for point in report["control_points"]:
        for mark in point["marks"]:
            shot = of_name[mark["photograph"]]
            rotation = Rotation.from_rotvec(shot["rotation"]).as_matrix()
            in_camera = rotation @ (np.array(point["surveyed_map_m"]) - np.array(shot["translation"]))
            camera = listed[shot["camera"]]
            assert isinstance(camera, dict)
            errors.append(opensfm_pixel(camera, in_camera) - np.array(mark["pixel"]))
    rms = float(np.sqrt(np.mean(np.square(errors))))
    assert len(errors) > 30
    assert rms < 1.0  # marks are whole pixels, and the map's scale is not that of the tangent plane


def test_photographs_lie_where_they_were_taken(report: Report) -> None:
    collection = json.loads(json.dumps(shots(report, "EPSG:25832")))
    assert collection["type"] == "FeatureCollection"
    to_map = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    for feature in collection["features"]:
        longitude, latitude, height = feature["geometry"]["coordinates"]
        place = feature["properties"]["translation"]
        assert np.allclose(to_map.transform(longitude, latitude), place[:2], atol=1e-3)
        assert height == place[2]
        assert (feature["properties"]["width"], feature["properties"]["height"]) == (400, 300)
    assert len(collection["features"]) == 4


def test_what_a_camera_of_opensfm_has_no_place_for_is_said(report: Report) -> None:
    changed = json.loads(json.dumps(report))
    (name,) = changed["cameras"]
    changed["cameras"][name] |= {"affinity": [0.0, 0.0], "radial": [0.0, 0.0, 0.0, 0.0]}
    assert list(left_out_of_cameras(changed)) == []
    changed["cameras"][name] |= {"affinity": [0.3, -0.25], "radial": [0.0, 0.0, 0.0, 1e-3]}
    assert list(left_out_of_cameras(changed)) == [
        f"cameras.json has no place for b2 of {name}, -0.25 px: report.json has it",
        f"cameras.json has no place for k4 of {name}, 0.001: report.json has it",
    ]
    changed["cameras"][name] |= {"model": "fisheye", "tangential": [0.1, 0.0], "affinity": [0.0, 0.0]}
    assert list(left_out_of_cameras(changed)) == [
        f"cameras.json has no place for p1 and p2 of {name}: report.json has them"
    ]
    assert cameras(changed)[name]["projection_type"] == "fisheye_opencv"  # type: ignore[index]


def test_figures_stand_where_webodm_reads_them(report: Report) -> None:
    """By the keys that WebODM follows."""
    read: Any = odm_statistics(report, 1234)
    assert read["point_cloud_statistics"]["dense"]
    assert read["point_cloud_statistics"]["stats"]["statistic"][0]["count"] == 1234
    assert read["odm_processing_statistics"]["average_gsd"] == pytest.approx(100 * 40.0 / 600.0, rel=0.05)  # cm
    assert 300.0 < read["processing_statistics"]["area"] < 1000.0
    sparse: Any = odm_statistics(report, None)
    assert not sparse["point_cloud_statistics"]["dense"]
    assert sparse["reconstruction_statistics"]["reconstructed_points_count"] == report["block"]["tie_points"]
