"""report.json: its keys, and whether its numbers agree with each other, with the products and with the truth."""

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import laspy
import numpy as np
import pytest
import rasterio
from pyproj import CRS
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.oriented_subset import registered_block, with_all_photographs
from photogram.adjustment.problem import AdjustmentSettings
from photogram.files.npz_json import write_json
from photogram.files.photographs.images import read_tags
from photogram.geodesy.frames import LocalFrame, map_from_geodetic
from photogram.quality.asprs import ReportSettings
from photogram.report.identity import VOLATILE
from photogram.report.numbers.completion import asprs_numbers
from photogram.report.numbers.numbers import (
    NOT_ADJUSTED,
    camera_numbers,
    gnss_residual_m,
    ground_numbers,
    report_numbers,
)
from photogram.report.numbers.overlap import ground_overlap
from photogram.report.numbers.traffic_lights import number
from photogram.result_files import result_path
from photogram.results import Adjustment, LensFieldDecision
from photogram.sfm.orientation import Orientation
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

Json = dict[str, Any]


@pytest.fixture(scope="module")
def report(finished_survey: Path) -> Json:
    return dict(json.loads((finished_survey / "results/quality/report.json").read_text()))


@pytest.fixture(scope="module")
def frame(report: Json) -> LocalFrame:
    return LocalFrame(report["crs"], tuple(report["world"]["origin_map_m"]), report["world"]["kind"])


@pytest.fixture(scope="module")
def cloud(finished_survey: Path) -> np.ndarray[Any, Any]:
    return np.loadtxt(finished_survey / "results/technical/points_adjusted.txt", delimiter=",")


def numbers(value: object, *shape: int) -> bool:
    """Whether a value of a report is a list of finite numbers of this shape."""
    array = np.array(value, dtype=object)
    return array.shape == shape and all(type(x) is float and np.isfinite(x) for x in array.ravel())


def test_keys_of_photographs(report: Json) -> None:
    assert list(report["photographs"]) == [f"sim_000{i}.JPG" for i in range(1, 5)]
    for photograph in report["photographs"].values():
        assert photograph["camera"] == "simulated"
        for key in ("position_map_m", "sigma_m", "omega_phi_kappa_deg"):
            assert numbers(photograph[key], 3), key
        assert min(photograph["sigma_m"]) > 0
        assert numbers(photograph["rotation_camera_from_map"], 3, 3)
        assert numbers(photograph["resection"]["position_map_m"], 3)
        assert numbers(photograph["resection"]["gnss_difference_m"])


def test_every_photograph_says_whether_it_is_registered(report: Json) -> None:
    for photograph in report["photographs"].values():
        assert photograph["registered"] is True
        assert photograph["reason"] is None
        assert photograph["tie_points"] > 0
        assert numbers(photograph["gnss_residual_m"], 3)
        assert numbers(photograph["gsd_m"])


def test_keys_of_lens_fields() -> None:
    made = simulate_block(SurveyPlan(), 1, tie_points=60)
    result = adjust(made.block, AdjustmentSettings())
    name = made.block.cameras[0].name
    assert camera_numbers(result, {}, [])[name]["lens_field"] is None
    there = LensFieldDecision(name, estimated=True, photographs=24, pattern_px=0.1, covered=1.0, gain=0.05,
                              gain_errors=7.0, rms_px=0.2, sigma_px=0.02, largest_px=0.6, left_px=0.01)  # fmt: skip
    found = camera_numbers(replace(result, decisions=replace(result.decisions, lens_fields=(there,))), {}, [])[name][
        "lens_field"
    ]
    assert found is not None
    assert found["estimated"]
    assert found["why"] is None
    assert [found[key] for key in ("rms_px", "sigma_px", "largest_px", "left_px")] == [0.2, 0.02, 0.6, 0.01]
    off = camera_numbers(
        replace(result, decisions=replace(result.decisions, lens_fields=(LensFieldDecision(name, why="too few"),))),
        {},
        [],
    )[name]
    assert off["lens_field"] is not None
    assert off["lens_field"]["why"] == "too few"
    assert off["lens_field"]["rms_px"] is None


def test_keys_of_rolling_shutters() -> None:
    plan = SurveyPlan(
        readout_s=0.033, readout_sigma_s=0.03, speed_m_s=8.0, position_noise_m=1.0, gnss_offset_sigma_m=(0.0, 0.0, 0.0)
    )
    result = adjust(simulate_block(plan, 1, tie_points=400, sigma_px=0.4).block, AdjustmentSettings())
    name = result.block.cameras[0].name
    camera = camera_numbers(result, {}, [])[name]
    found = camera["rolling_shutter"]
    assert found is not None
    assert found["estimate_s"] == camera["readout_s"] == result.decisions.readout_s[0]
    assert found["sigma_s"] == pytest.approx(camera["sigma"]["readout_s"])
    for key in ("focal_correlation", "time_offset_correlation"):
        assert 0.0 < abs(number(found[key])) < 1.0, key
    assert found["neighbours_scatter_m_s"] == result.decisions.neighbours_scatter_m_s > 0.05
    unknown = np.full(1, np.nan)
    decisions = replace(
        result.decisions,
        readout_s=unknown,
        readout_sigma_s=unknown,
        readout_focal_correlation=unknown,
        neighbours_scatter_m_s=float("nan"),
    )
    given = replace(result, decisions=decisions)
    fixed = camera_numbers(given, {}, [])[name]["rolling_shutter"]
    assert fixed is not None
    assert fixed["estimate_s"] is fixed["focal_correlation"] is fixed["neighbours_scatter_m_s"] is None
    still = adjust(simulate_block(SurveyPlan(), 1, tie_points=60).block, AdjustmentSettings())
    assert camera_numbers(still, {}, [])[name]["rolling_shutter"] is None


def test_keys_of_block(report: Json, finished_survey: Path) -> None:
    block, adjustment = report["block"], report["adjustment"]
    assert block["registered"] == block["photographs"] == 4
    assert block["components"] == [list(report["photographs"])]
    assert block["component_sizes"] == [4]
    assert block["method"] in {"control", "attitude", "growth"}
    for key in ("tie_points", "observations"):
        assert block[key] == adjustment[key], key
    assert block["mean_track_length"] == pytest.approx(adjustment["observations"] / adjustment["tie_points"])
    truth = json.loads((finished_survey / "truth.json").read_text())
    assert block["gsd_m"] == pytest.approx(truth["gsd_m"], rel=0.05)
    overlap = block["overlap"]
    assert all(numbers(overlap[key]) for key in overlap)
    assert 2 <= overlap["median"] <= 4
    assert overlap["share_3_or_more"] <= overlap["share_2_or_more"] <= 1
    residual = np.array([p["gnss_residual_m"] for p in report["photographs"].values()])
    rms = block["gnss_residual_rms_m"]
    assert rms["plan"] == pytest.approx(np.sqrt((residual[:, :2] ** 2).sum(axis=1).mean()))
    assert rms["height"] == pytest.approx(np.sqrt((residual[:, 2] ** 2).mean()))
    assert rms["three_d"] == pytest.approx(np.hypot(rms["plan"], rms["height"]))


def test_keys_of_cameras(report: Json) -> None:
    assert list(report["cameras"]) == ["simulated"]
    camera = report["cameras"]["simulated"]
    assert numbers(camera["focal_px"])
    assert numbers(camera["principal_point_px"], 2)
    assert numbers(camera["radial"], 4)
    assert numbers(camera["affinity"], 2)
    assert camera["model"] == "brown"
    assert numbers(camera["tangential"], 2)
    free = {name for name, sigma in camera["sigma"].items() if sigma is not None}
    assert free == {"focal_px", "cx_px", "cy_px", "k1"}
    assert all(camera["sigma"][name] > 0 for name in free)
    assert {name for name, sigma in camera["prior_sigma"].items() if sigma != 0} == free
    assert set(camera["held"]) >= set(camera["sigma"]) - free - {
        "k4",
        "b1",
        "b2",
        "readout_s",
    }  # no classic camera has them
    assert all(type(reason) is str and reason for reason in camera["held"].values())
    assert camera["source"] is None


def test_keys_of_reliability(report: Json) -> None:
    assert report["suspects"] == []
    for point in report["control_points"]:
        control = point["role"] == "control"
        for key in ("redundancy", "w", "mdb_m", "effect_m", "left_out_m", "left_out_sigma_m"):
            assert numbers(point[key], 3) if control else point[key] is None, key
        assert point["suspect"] is False
        for mark in point["marks"]:
            for key in ("redundancy", "w", "mdb_px"):
                assert numbers(mark[key], 2) if control else mark[key] is None, key
    for photograph in report["photographs"].values():
        for key in ("gnss_redundancy", "gnss_w", "gnss_mdb_m"):
            assert numbers(photograph[key], 3), key
        assert photograph["gnss_suspect"] is False


def test_a_blunder_in_a_mark_is_detected_by_the_sigma_that_was_used() -> None:
    """0.3 px are assumed of marks that scatter by 0.6 px: what is used is estimated, what is stated stays in the
    report."""
    block = simulate_block(SurveyPlan(control_points=12, check_points=2, mark_sigma_px=0.6), 1, tie_points=200).block
    points = block.control_points
    every, stated = np.ones(len(points), dtype=bool), points.mark_covariance_px2 / 4.0
    given = replace(points, mark_covariance_px2=stated, mark_sigma_assumed=every)
    result = adjust(replace(block, control_points=given), AdjustmentSettings())
    used_px = result.block.control_points.mark_sigma_px
    assert np.median(used_px) > 0.45
    marks = [mark for point in ground_numbers(result, [], given, {}) for mark in point["marks"]]
    np.testing.assert_allclose([mark["sigma_px"] for mark in marks], 0.3)
    tested = [mark for mark in marks if mark["mdb_px"] is not None]
    assert len(tested) > 20
    for mark in tested:
        r, mdb_px = np.array([mark["redundancy"], mark["mdb_px"]], dtype=np.float64)
        np.testing.assert_allclose(mdb_px, 4.132 * np.median(used_px) / np.sqrt(r))


def test_keys_of_the_diagnosis(report: Json) -> None:
    diagnosis = report["diagnosis"]
    camera = diagnosis["cameras"]["simulated"]
    assert camera["parameters"] == ["focal_px", "cx_px", "cy_px", "k1"]
    assert camera["sigma"] == [report["cameras"]["simulated"]["sigma"][name] for name in camera["parameters"]]
    assert all(numbers(row, 4) for row in camera["correlation"])
    focal = diagnosis["focal_height_correlation"]["simulated"]
    assert all(-1 <= focal[key] <= 1 for key in ("projection_centres", "ground"))
    assert set(focal["gnss_offset"]) == set(report["adjustment"]["gnss_offsets"])
    assert diagnosis["dome"]["predicted_sigma_m"] > 0
    assert diagnosis["dome"]["points"] == diagnosis["dome"]["control_points"] + report["check_points"]["n"]
    assert [r["what"] for r in diagnosis["remedies"]]
    # the dome of design options is a part of the block's, and called so
    pattern = diagnosis["pattern_effect"]["dome_m"] if diagnosis["pattern_effect"] else 0.0
    for remedy in diagnosis["remedies"]:
        assert np.hypot(remedy["sigma_dome_before_m"], pattern) <= 1.001 * diagnosis["dome"]["predicted_sigma_m"]
        assert "of the dome, by the stated sigmas alone" in remedy["sentence"]
    assert all(type(sentence) is str for sentence in diagnosis["warnings"] + diagnosis["undetermined"])
    assert numbers(diagnosis["intersection_sigma_m"], 3)
    for resections in diagnosis["resections"]:
        assert numbers(resections["offset_m"], 3)
        assert f"{resections['focal_m']:+.2f} m of it" in resections["sentence"]


def test_keys_of_adjustment(report: Json) -> None:
    adjustment = report["adjustment"]
    for key in ("sigma0", "reprojection_rms_px", "seconds"):
        assert type(adjustment[key]) is float, key
        assert adjustment[key] > 0, key
    for key in ("tie_points", "observations", "iterations"):
        assert type(adjustment[key]) is int, key
        assert adjustment[key] > 0, key
    assert adjustment["converged"] is True
    effort = {row["decision"]: row for row in adjustment["effort"]}
    assert {"gross errors", "outlier rounds", "common errors", "lens field"} <= effort.keys()
    for row in effort.values():
        assert type(row["solutions"]) is type(row["iterations"]) is int
        assert row["iterations"] >= row["iterations_over_all_rays"] >= 0.0
        assert row["seconds"] >= 0.0
    assert effort["outlier rounds"]["iterations_over_all_rays"] > 0.5 * effort["outlier rounds"]["iterations"] > 0.0
    assert sum(row["seconds"] for row in effort.values()) < adjustment["seconds"]


def test_keys_of_ground_points(report: Json) -> None:
    points = report["control_points"]
    assert [p["name"] for p in points] == [f"G0{i}" for i in range(1, 9)] + [f"C0{i}" for i in range(1, 5)]
    assert [p["role"] for p in points] == ["control"] * 8 + ["check"] * 4
    for point in points:
        for key in ("surveyed_map_m", "adjusted_map_m", "residual_m", "sigma_m"):
            assert numbers(point[key], 3), key
        assert point["marks"]
        assert all(m["photograph"] in report["photographs"] and numbers(m["pixel"], 2) for m in point["marks"])
    check = report["check_points"]
    assert type(check["n"]) is int
    assert numbers(check["rmse_m"], 3)
    assert numbers(check["mean_m"], 3)
    assert numbers(check["rmse_h_m"])
    assert numbers(check["rmse_v_m"])


def test_keys_of_consistency(report: Json) -> None:
    achieved = report["predicted_against_achieved"]
    assert (achieved["n"], achieved["chi2"]["dof"]) == (4, 12)
    assert 0.0 <= achieved["chi2"]["p"] <= 1.0
    assert achieved["sentence"].startswith("4 check points: ")
    for axis in ("easting", "northing", "height"):
        part = achieved["axes"][axis]
        assert part["n"] == 4
        assert 0.0 <= part["within_1"] <= part["within_2"] <= part["within_3"] <= 1.0
        assert numbers(part["rms_z"])
    for point in report["control_points"]:
        check = point["role"] == "check"
        assert numbers(point["z"], 3) if check else point["z"] is None
        assert numbers(point["mahalanobis"]) if check else point["mahalanobis"] is None
    left_out = report["leave_one_out"]
    rows = np.array([p["left_out_m"] for p in report["control_points"] if p["role"] == "control"])
    assert left_out["n"] == 8
    assert left_out["rmse_v_m"] == pytest.approx(np.sqrt(np.mean(rows[:, 2] ** 2)))
    assert left_out["max"]["name"] in {p["name"] for p in report["control_points"]}
    components, adjustment = report["variance_components"], report["adjustment"]
    assert list(components) == [
        "tie_points", "marks", "control_plan", "control_height", "gnss_plan", "gnss_height", "attitude", "gnss_offset",
        "common_errors", "calibration",
    ]  # fmt: skip
    assert sum(c["redundancy"] for c in components.values()) == pytest.approx(adjustment["redundancy"])
    assert components["tie_points"]["observations"] == 2 * adjustment["observations"]
    assert components["marks"]["unit"] == "px"


def test_keys_of_clouds(report: Json) -> None:
    assert list(report["clouds"]) == ["linear_2view", "linear_3view", "adjusted"]
    for statistics in report["clouds"].values():
        assert type(statistics["points"]) is int
        assert all(numbers(statistics[key]) for key in ("mean_m", "std_m", "nmad_m"))


def test_report_is_strict_json(finished_survey: Path) -> None:
    def refuse(name: str) -> None:
        pytest.fail(f"{name} is no JSON number")

    json.loads((finished_survey / "results/quality/report.json").read_text(), parse_constant=refuse)


def test_rotation_is_orthonormal_and_that_of_the_angles(report: Json) -> None:
    for photograph in report["photographs"].values():
        R = np.array(photograph["rotation_camera_from_map"])
        assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        # Kraus 2007: map from image = Rx(ω) Ry(φ) Rz(κ); the image's axes are x right, y up, z backward
        image = Rotation.from_euler("XYZ", photograph["omega_phi_kappa_deg"], degrees=True).as_matrix()
        assert np.allclose(image @ np.diag([1.0, -1.0, -1.0]), R.T, atol=1e-12)


def cv2_projection(report: Json, photograph: Json, differences_m: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Project differences (N, 3) to the projection centre along easting, northing and up, by OpenCV."""
    camera = report["cameras"][photograph["camera"]]
    (cx, cy), f, (k1, k2, k3, _) = camera["principal_point_px"], camera["focal_px"], camera["radial"]
    K = np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])
    lens = np.array([k1, k2, *camera["tangential"], k3])
    turn = cv2.Rodrigues(np.array(photograph["rotation_camera_from_map"]))[0]
    pixel, _ = cv2.projectPoints(np.ascontiguousarray(differences_m), turn, np.zeros(3), K, lens)
    return np.asarray(pixel.reshape(-1, 2))


def test_rotation_position_and_camera_project_the_ground_points_to_their_marks(report: Json, frame: LocalFrame) -> None:
    """The rotation counts the meridian convergence, 1.2 degrees here: without it a mark at the edge is 4 px off."""
    compared = 0
    for point in report["control_points"]:
        for mark in point["marks"]:
            photograph = report["photographs"][mark["photograph"]]
            difference = np.array(point["adjusted_map_m"]) - photograph["position_map_m"]
            difference[:2] /= frame.grid_scale(np.array(point["adjusted_map_m"]))
            projected = cv2_projection(report, photograph, difference[None])[0]
            assert projected - mark["pixel"] == pytest.approx(np.array(mark["residual_px"]), abs=0.01)
            assert np.abs(mark["residual_px"]).max() < 1.5
            compared += 1
    assert compared > 30


def test_resection_lies_where_the_tags_say_it_does(report: Json, finished_survey: Path) -> None:
    for name, photograph in report["photographs"].items():
        tags = read_tags(finished_survey / "photographs" / name)
        geodetic = np.array([[tags.longitude_deg, tags.latitude_deg, tags.height_m]], dtype=float)
        difference = np.array(photograph["resection"]["position_map_m"]) - map_from_geodetic(report["crs"], geodetic)[0]
        assert photograph["resection"]["gnss_difference_m"] == pytest.approx(np.linalg.norm(difference), abs=1e-6)


def test_result_agrees_with_the_truth(report: Json, finished_survey: Path) -> None:
    truth = json.loads((finished_survey / "truth.json").read_text())
    for name, photograph in report["photographs"].items():
        error = np.array(photograph["position_map_m"]) - truth["positions_map_m"][name]
        assert np.all(np.abs(error) < 4 * np.array(photograph["sigma_m"])), name
    camera = report["cameras"]["simulated"]
    assert abs(camera["focal_px"] - truth["camera"]["parameters"][0]) < 4 * camera["sigma"]["focal_px"]
    assert report["check_points"]["rmse_h_m"] < 1.0 * truth["gsd_m"]
    assert report["check_points"]["rmse_v_m"] < 1.5 * truth["gsd_m"]
    assert report["clouds"]["adjusted"]["nmad_m"] < report["clouds"]["linear_3view"]["nmad_m"]


def test_check_summary_is_that_of_the_check_points_alone(report: Json) -> None:
    residual = np.array([p["residual_m"] for p in report["control_points"] if p["role"] == "check"])
    check = report["check_points"]
    assert check["n"] == len(residual) == 4
    assert check["rmse_m"] == pytest.approx(np.sqrt((residual**2).mean(axis=0)).tolist())
    assert check["mean_m"] == pytest.approx(residual.mean(axis=0).tolist())
    assert check["rmse_h_m"] == pytest.approx(float(np.sqrt((residual[:, :2] ** 2).sum(axis=1).mean())))
    assert check["rmse_v_m"] == pytest.approx(float(np.sqrt((residual[:, 2] ** 2).mean())))
    for point in report["control_points"]:
        difference = np.array(point["adjusted_map_m"]) - point["surveyed_map_m"]
        assert point["residual_m"] == pytest.approx(difference.tolist(), abs=1e-9)


@pytest.mark.parametrize("name", ["linear_2view", "linear_3view", "adjusted"])
def test_text_and_laz_hold_the_same_points(report: Json, finished_survey: Path, name: str) -> None:
    results = finished_survey / "results"
    text = np.loadtxt(results / f"technical/points_{name}.txt", delimiter=",")
    laz = laspy.read(results / f"technical/points_{name}.laz")
    assert text.shape == (report["clouds"][name]["points"], 3)
    assert laz.xyz == pytest.approx(text, abs=6e-4)
    crs = laz.header.parse_crs()
    assert crs is not None
    assert crs.to_2d().to_epsg() == 25832
    assert np.ptp(np.asarray(laz.red, dtype=float)) > 0


def test_tie_points_agree_with_the_report_and_the_cloud(
    report: Json, finished_survey: Path, frame: LocalFrame, cloud: np.ndarray[Any, Any]
) -> None:
    with np.load(finished_survey / "results/technical/tie_points.npz") as archive:
        tie = {name: archive[name] for name in archive.files}
    assert report["adjustment"]["tie_points"] == len(tie["position_world_m"])
    assert report["adjustment"]["observations"] == len(tie["pixel"])
    position_map_m = frame.map_from_world(tie["position_world_m"])
    assert position_map_m == pytest.approx(cloud, abs=6e-4)
    squares = []
    for index, photograph in enumerate(report["photographs"].values()):
        seen = tie["photograph"] == index
        assert photograph["tie_points"] == np.count_nonzero(seen)
        difference = position_map_m[tie["point"][seen]] - photograph["position_map_m"]
        difference[:, :2] /= frame.grid_scale(np.array(photograph["position_map_m"]))
        squares.append(((cv2_projection(report, photograph, difference) - tie["pixel"][seen]) ** 2).sum(axis=1))
    rms_px = np.sqrt(np.concatenate(squares).mean())
    assert report["adjustment"]["reprojection_rms_px"] == pytest.approx(rms_px, rel=0.02)


def test_matlab_file_holds_the_same_observations(finished_survey: Path) -> None:
    results = finished_survey / "results"
    matlab = loadmat(results / "technical/tie_points.mat")
    with np.load(results / "technical/tie_points.npz") as archive:
        assert np.array_equal(matlab["observation_pixel"], archive["pixel"])
        assert np.array_equal(matlab["observation_point"].ravel() - 1, archive["point"])
        assert np.array_equal(matlab["position_world_m"], archive["position_world_m"])


def test_table_and_map_hold_the_poses_of_the_report(report: Json, finished_survey: Path) -> None:
    lines = (finished_survey / "results/technical/photographs.csv").read_text(encoding="utf-8").splitlines()
    rows = {row["name"]: row for row in csv.DictReader(lines)}
    assert all(report["crs"] in row["crs"] for row in rows.values())
    features = json.loads((finished_survey / "results/deliverables/photographs.geojson").read_text(encoding="utf-8"))[
        "features"
    ]
    points = {f["properties"]["name"]: f for f in features}
    assert list(rows) == list(points) == list(report["photographs"])
    columns = {
        "position_map_m": ("easting_m", "northing_m", "height_m"),
        "sigma_m": ("sigma_easting_m", "sigma_northing_m", "sigma_height_m"),
        "omega_phi_kappa_deg": ("omega_deg", "phi_deg", "kappa_deg"),
        "sigma_attitude_deg": ("sigma_x_deg", "sigma_y_deg", "sigma_z_deg"),
    }
    for name, photograph in report["photographs"].items():
        for key, names in columns.items():
            for values in (rows[name], points[name]["properties"]):
                assert [float(values[n]) for n in names] == pytest.approx(photograph[key], abs=6e-5), (name, key)


def test_clouds_bear_the_day_of_the_flight_and_no_black_points(finished_survey: Path) -> None:
    days = {
        note["time"][:10]
        for note in json.loads((finished_survey / "work/photographs.stage/tags.json").read_text(encoding="utf-8"))
    }
    for name in ("points_adjusted.laz", "dense.laz"):
        header = laspy.open(result_path(finished_survey / "results", name)).header
        assert str(header.creation_date) == max(days)
    dense = laspy.read(finished_survey / "results/deliverables/dense.laz")
    assert np.all((dense.red > 0) | (dense.green > 0) | (dense.blue > 0))
    with rasterio.open(finished_survey / "results/quality/dtm_source.tif") as file:
        kind = np.array([code[0] for code in file.sample(np.column_stack([dense.x, dense.y]))])
    np.testing.assert_array_equal(dense.classification == 2, kind == 1)
    assert set(np.unique(dense.classification)) == {1, 2}


def test_surface_passes_through_the_cloud(finished_survey: Path, cloud: np.ndarray[Any, Any]) -> None:
    with rasterio.open(finished_survey / "results/deliverables/dsm.tif") as raster:
        crs = CRS.from_wkt(raster.crs.to_wkt(version="WKT2_2019"))
        assert crs.to_2d().to_epsg() == 25832
        assert [axis.direction for axis in crs.axis_info] == ["east", "north", "up"]
        assert raster.nodata is not None
        height = np.array([h for (h,) in raster.sample(cloud[:, :2], masked=True)], dtype=object)
        bounds = raster.bounds
    known = np.array([h is not np.ma.masked for h in height])
    assert known.mean() > 0.6
    error = height[known].astype(float) - cloud[known, 2]
    # a cell of 1 m holds the height of its centre, the point lies up to 0.7 m beside it on slopes and walls
    assert abs(np.median(error)) < 0.03
    assert np.median(np.abs(error)) < 0.15
    # all ground that two photographs see, to a cell: tie points on its edge have their own errors
    assert bounds.left <= cloud[:, 0].min() + raster.res[0]
    assert bounds.top >= cloud[:, 1].max() - raster.res[1]


def test_standard_deviations_of_the_surface(report: Json, finished_survey: Path, cloud: np.ndarray[Any, Any]) -> None:
    """On the grid of the surface; smaller than those of single tie points, whose stated sigma of 0.5 px is generous."""
    results = finished_survey / "results"
    with (
        rasterio.open(results / "deliverables/dsm.tif") as surface,
        rasterio.open(results / "quality/dsm_sigma.tif") as raster,
    ):
        assert (raster.transform, raster.shape) == (surface.transform, surface.shape)
        assert raster.crs.to_epsg() == 25832  # a standard deviation counts from nothing
        assert (raster.nodata, raster.profile["tiled"]) == (surface.nodata, True)
        sigma = raster.read(1, masked=True)
        np.testing.assert_array_equal(sigma.mask, surface.read(1, masked=True).mask)
        beside = np.array([s for (s,) in raster.sample(cloud[:, :2], masked=True)], dtype=object)
    own = laspy.read(results / "technical/points_adjusted.laz")["sigma z"]
    known = np.array([s is not np.ma.masked for s in beside])
    assert 0.1 * np.median(own[known]) < np.median(beside[known].astype(float)) < np.median(own[known])
    dsm = report["dsm"]
    assert (dsm["rows"], dsm["columns"]) == sigma.shape
    assert dsm["cells"] == sigma.count()
    assert dsm["sigma_m"]["median"] == pytest.approx(np.median(sigma.compressed()), rel=1e-6)
    assert dsm["held_out"]["n"] == 0  # nothing is interpolated between points
    assert 0 < dsm["sigma_m"]["median"] < dsm["sigma_m"]["percentile_95"] < dsm["sigma_m"]["maximum"]
    with rasterio.open(results / "quality/dsm_sigma_relative.tif") as raster:
        relative = raster.read(1, masked=True)
        assert raster.descriptions == ("standard deviation of the height relative to the survey's mean height, without "
                                       "the datum",)  # fmt: skip
    np.testing.assert_array_equal(relative.mask, sigma.mask)
    with rasterio.open(results / "quality/dsm_sigma_own.tif") as raster:
        scatter = raster.read(1, masked=True)
        assert "without what neighbours share" in raster.descriptions[0]
    np.testing.assert_array_equal(scatter.mask, sigma.mask)
    assert np.all(scatter.compressed() <= sigma.compressed())
    assert np.all(scatter.compressed() <= relative.compressed())
    assert dsm["relative_sigma_m"]["median"] == pytest.approx(np.median(relative.compressed()), rel=1e-6)
    datum = dsm["datum_sigma_m"]
    assert all(0 < datum[axis] < 1 for axis in ("easting", "northing", "height"))
    assert 0 < dsm["relative_sigma_m"]["median"] < dsm["sigma_m"]["median"]
    # the two parts, over all cells: they correlate little, and not at all on average over the places
    both = np.hypot(dsm["relative_sigma_m"]["median"], datum["height"])
    assert both == pytest.approx(dsm["sigma_m"]["median"], rel=0.3)


def without_seconds(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_seconds(v) for k, v in value.items() if k not in VOLATILE - {"report_id"}}
    return [without_seconds(v) for v in value] if isinstance(value, list) else value


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict | list):
        for name, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(item, f"{key}/{name}")
    else:
        yield key, value


@pytest.mark.usefixtures("undrawn")
def test_check_points_never_enter_the_adjustment(
    report: Json, finished_survey: Path, adjusted_survey: Path, photogram: Callable[..., Any], edit: Callable[..., None]
) -> None:
    """Moving a check point far away changes its own residual and nothing else, bit for bit."""

    def move(values: Json) -> None:
        point = next(p for p in values["control_points"]["list"] if p["name"] == "C02")
        easting, northing, height = point["position_m"]
        point["position_m"] = [easting + 400.0, northing - 300.0, height + 50.0]

    edit(adjusted_survey / "project.yaml", move)
    outcome = photogram("adjust", adjusted_survey / "project.yaml")
    assert outcome.code == 0, outcome.err
    moved = json.loads((adjusted_survey / "results/quality/report.json").read_text())
    before, after = dict(leaves(without_seconds(report))), dict(leaves(without_seconds(moved)))
    changed = {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
    index = next(i for i, p in enumerate(report["control_points"]) if p["name"] == "C02")
    own = {f"/control_points/{index}/{key}/{axis}" for key in ("surveyed_map_m", "residual_m") for axis in range(3)}
    own |= {f"/control_points/{index}/z/{axis}" for axis in range(3)} | {f"/control_points/{index}/mahalanobis"}
    assert own <= changed
    assert moved["control_points"][index]["suspect"] is True
    assert "check point C02 fits neither" in moved["control_points"][index]["verdict"]
    # conclusions from the check points
    drawn: tuple[str, ...]
    drawn = (
        "/check_points/",
        "/predicted_against_achieved/",
        "/diagnosis/dome/",
        "/diagnosis/warnings/",
        "/asprs/",
        "/summary/",
        "/warnings/",
    )
    drawn += ("/dense/check_points/", "/dense/warnings/", "/verdict/", "/report_id", "/deliverables/")
    # PROJ writes the ensemble of a datum, or the datum, by what its process has read before
    drawn += ("/heights/crs/wkt",)
    drawn += ("/orthophoto/check_points/", *(f"/control_points/{index}/{key}" for key in ("suspect", "verdict")))
    assert {key for key in changed - own if not key.startswith(drawn)} == set()
    assert report["predicted_against_achieved"]["consistent"]
    assert not moved["predicted_against_achieved"]["consistent"]
    shift = np.array(moved["control_points"][index]["residual_m"]) - report["control_points"][index]["residual_m"]
    assert shift == pytest.approx([-400.0, 300.0, -50.0], abs=1e-6)
    for product in sorted((finished_survey / "results").iterdir()):
        if product.suffix in {".txt", ".laz", ".tif", ".npz", ".mat", ".csv", ".geojson"}:
            assert (adjusted_survey / "results" / product.name).read_bytes() == product.read_bytes(), product.name


# ---- a block that is not whole -------------------------------------------------------------------------------------

LOST = {1: "3 tie points with other photographs, 12 are needed", 6: ""}


@pytest.fixture(scope="module")
def broken() -> tuple[Adjustment, Orientation, Block]:
    """Eight photographs of two flights: the second and the seventh are not registered, the fifth has no GNSS."""
    plan = SurveyPlan(
        width_px=400, height_px=300, focal_px=600.0, flying_height_m=40.0, strips=2, photographs_per_strip=4,
        flights=2, relief_m=4.0, control_points=6, check_points=3, gnss_offset_sigma_m=(3.0, 3.0, 5.0),
    )  # fmt: skip
    block = simulate_block(plan, 3, tie_points=400).block
    photographs = list(block.photographs)
    photographs[4] = replace(photographs[4], gnss_world_m=None, gnss_sigma_m=None)
    block = replace(block, photographs=tuple(photographs))
    poses = tuple(None if i in LOST else pose for i, pose in enumerate(block.poses))
    component = np.array([{1: -1, 6: 1}.get(i, 0) for i in range(8)], dtype=np.int64)
    reasons = tuple(LOST.get(i, "") for i in range(8))
    orientation = Orientation(poses, (None,) * 8, component, "attitude", reasons)
    part, kept = registered_block(replace(block, poses=poses))
    return with_all_photographs(adjust(part, AdjustmentSettings()), block, kept), orientation, block


@pytest.fixture(scope="module")
def numbers_of_broken(broken: tuple[Adjustment, Orientation, Block], tmp_path_factory: pytest.TempPathFactory) -> Json:
    result, orientation, _ = broken
    overlap = ground_overlap(result, result.block.frame.map_from_world(result.block.tie_points.position_world_m))
    value = report_numbers(
        result, orientation, {}, {}, overlap, version="1", seconds={"adjustment": 1.0},
        fixed={"simulated": {"k3": "fixed at its given value"}}, sources=("the laboratory",),
    )  # fmt: skip
    path = tmp_path_factory.mktemp("broken") / "report.json"
    write_json(path, value)
    return dict(json.loads(path.read_text()))


def test_photographs_that_are_left_out_say_why(numbers_of_broken: Json) -> None:
    photographs = numbers_of_broken["photographs"]
    assert list(photographs) == [f"sim_{i + 1:04d}.JPG" for i in range(8)]
    left_out = {name: p for name, p in photographs.items() if not p["registered"]}
    assert left_out == {
        "sim_0002.JPG": {"camera": "simulated", "registered": False, "reason": LOST[1], "tie_points": 0,
                         "gnss_residual_m": None},
        "sim_0007.JPG": {"camera": "simulated", "registered": False, "reason": NOT_ADJUSTED, "tie_points": 0,
                         "gnss_residual_m": None},
    }  # fmt: skip
    assert photographs["sim_0005.JPG"]["gnss_residual_m"] is None
    assert photographs["sim_0005.JPG"]["registered"] is True


def test_block_counts_parts_and_photographs(numbers_of_broken: Json) -> None:
    block = numbers_of_broken["block"]
    names = [f"sim_000{i}.JPG" for i in range(1, 9)]
    assert (block["registered"], block["photographs"]) == (6, 8)
    assert block["components"] == [[names[i] for i in (0, 2, 3, 4, 5, 7)], ["sim_0007.JPG"]]
    assert block["component_sizes"] == [6, 1]
    assert block["method"] == "attitude"
    assert block["overlap"]["median"] <= 6


def test_gnss_residuals_are_without_the_offset_of_the_flight(
    broken: tuple[Adjustment, Orientation, Block], numbers_of_broken: Json
) -> None:
    """The offsets are of metres, the receiver's noise of centimetres: a residual that keeps an offset shows it."""
    result, _, block = broken
    assert np.linalg.norm(result.estimates.offset_world_m, axis=1).min() > 1.0
    residual = gnss_residual_m(result)
    assert np.isnan(residual).all(axis=1).tolist() == [i in (1, 4, 6) for i in range(8)]
    known = residual[np.isfinite(residual).all(axis=1)]
    assert np.abs(known).max() < 0.15
    # each flight's residuals cancel: its offset is what they had in common
    for flight in ("1", "2"):
        rows = residual[[p.flight == flight for p in block.photographs]]
        assert np.abs(np.nanmean(rows, axis=0)).max() < 0.02
    rms = numbers_of_broken["block"]["gnss_residual_rms_m"]
    assert rms["three_d"] == pytest.approx(np.sqrt(np.mean(np.sum(known**2, axis=1))))


def test_marks_in_photographs_that_are_left_out_have_no_residual(numbers_of_broken: Json) -> None:
    marks = [m for p in numbers_of_broken["control_points"] if p["adjusted_map_m"] for m in p["marks"]]
    assert {m["photograph"] for m in marks} >= {"sim_0002.JPG", "sim_0007.JPG"}
    for mark in marks:
        left_out = mark["photograph"] in {"sim_0002.JPG", "sim_0007.JPG"}
        assert mark["residual_px"] is None if left_out else numbers(mark["residual_px"], 2)


def test_cameras_say_what_was_held_and_where_they_come_from(numbers_of_broken: Json) -> None:
    camera = numbers_of_broken["cameras"]["simulated"]
    assert camera["held"] == {"k3": "fixed at its given value"}
    assert camera["source"] == "the laboratory"
    assert camera["prior_sigma"]["focal_px"] == 5.0
    assert camera["prior_sigma"]["k3"] == 0.0


@pytest.mark.parametrize("assumed", [(), ("C01", "C02", "C03"), ("C02",), ("G01",)])
def test_accuracy_of_a_simulated_block_is_measured_and_summed_with_stated_sigmas_alone(
    broken: tuple[Adjustment, Orientation, Block], assumed: tuple[str, ...]
) -> None:
    """Against the surveyed places of the block itself: RMSE_H1 and RMSE_V1 whoever stated what, the sum of the standard
    where every check point in use is stated."""
    result, _, _ = broken
    points = result.block.control_points
    assert {"C01", "C02", "C03", "G01"} <= set(points.name)
    mask = np.array([name in assumed for name in points.name], dtype=bool)
    rows = ground_numbers(result, [], replace(points, sigma_assumed=mask), {})
    assert {row["name"] for row in rows if row["surveyed_sigma_assumed"]} == set(assumed)
    check = np.array([role == "check" for role in points.role]) & np.isfinite(result.estimates.ground_world_m[:, 0])
    frame = result.block.frame
    off_m = frame.map_from_world(result.estimates.ground_world_m[check])
    off_m = off_m - frame.map_from_world(points.position_world_m[check])
    measured = [np.sqrt(np.mean(np.sum(off_m[:, :2] ** 2, axis=1))), np.sqrt(np.mean(off_m[:, 2] ** 2))]
    survey = [np.sqrt(np.mean(np.sum(points.sigma_m[check, :2] ** 2, axis=1))), points.sigma_m[check, 2].max()]
    accuracy = asprs_numbers(rows, ReportSettings(target_rmse_h_m=9.0, target_rmse_v_m=9.0))
    assert [accuracy["fit_rmse_h_m"], accuracy["fit_rmse_v_m"]] == pytest.approx(measured, rel=1e-6)
    if set(assumed) & set(np.array(points.name)[check].tolist()):
        assert accuracy["rmse_h_m"] is accuracy["rmse_v_m"] is accuracy["survey_rmse_h_m"] is None
        assert accuracy["statements"] == []
    else:
        assert [accuracy["rmse_h_m"], accuracy["rmse_v_m"]] == pytest.approx(np.hypot(measured, survey), rel=1e-6)
        assert len(accuracy["statements"]) == 2


def test_a_block_without_gnss_and_without_area(broken: tuple[Adjustment, Orientation, Block]) -> None:
    result, orientation, _ = broken
    photographs = tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in result.block.photographs)
    bare = replace(result, block=replace(result.block, photographs=photographs))
    block = report_numbers(bare, orientation, {}, {}, None, version="1", seconds={"adjustment": 1.0})["block"]
    assert block["gnss_residual_rms_m"] == {"plan": None, "height": None, "three_d": None}
    assert block["overlap"] is None
