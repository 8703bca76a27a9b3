"""Exterior orientation as CSV and GeoJSON: what is written leads back to the poses, by other people's formulas."""

import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyproj
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from makers import bare_adjustment
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, gimbal_from_rotation, project_points, rotation_from_gimbal
from photogram.errors import WorkspaceError
from photogram.files.poses import (
    COLUMNS,
    footprint_world_m,
    heading_and_nadir_angle_deg,
    write_pose_geojson,
    write_pose_table,
)
from photogram.geodesy.frames import LocalFrame, map_from_geodetic
from photogram.results import Adjustment
from photogram.survey import Block, ControlPoints, Photograph, TiePoints

Json = dict[str, Any]
# 3° east of the central meridian of zone 32: meridian convergence of 2.5°
FRAME = LocalFrame("EPSG:25832", (805_000.0, 6_200_000.0, 60.0))
CAMERA = Camera("left, wide", 800, 600, 700.0, np.array([402.0, 297.0]), np.array([-0.06, 0.02, 0.0, 0.0]))
NADIR = np.diag([1.0, -1.0, -1.0])
ROTATIONS = st.tuples(*[st.floats(-np.pi, np.pi)] * 3).map(lambda v: Rotation.from_rotvec(v).as_matrix())
POSITIONS = st.tuples(st.floats(-900, 900), st.floats(-900, 900), st.floats(20, 300)).map(np.array)


def adjusted(
    poses: Sequence[Pose | None], gnss: Sequence[FloatArray | None] | None = None, frame: LocalFrame = FRAME
) -> Adjustment:
    """An adjustment of these poses over level ground at height 0 of the world; names that tables have to quote."""
    n = len(poses)
    photographs = tuple(
        Photograph(
            f'DJI "{i}", ä.JPG', 0, flight=str(i % 2), gnss_world_m=g, gnss_sigma_m=None if g is None else np.ones(3)
        )
        for i, g in enumerate(gnss or [None] * n)
    )
    zero = np.zeros(4, dtype=np.int64)
    ties = TiePoints(
        zero, np.array([0, 0, 1, 1]), zero, np.zeros((4, 2)), np.ones(4), np.zeros((2, 3)), np.zeros((2, 3), np.uint8)
    )
    none = np.zeros(0, dtype=np.int64)
    ground = ControlPoints(
        (), (), np.zeros((0, 3)), np.zeros((0, 3)), none, none, np.zeros((0, 2)), np.zeros((0, 2, 2))
    )
    block = Block(frame, (CAMERA,), photographs, tuple(poses), ties, ground)
    position = np.array([np.full((3, 3), np.nan) if p is None else np.diag([1e-4, 4e-4, 9e-4]) for p in poses])
    return bare_adjustment(block, position, 1e-4 * position)


def table(folder: Path, result: Adjustment) -> list[dict[str, str]]:
    path = folder / "photographs.csv"
    write_pose_table(path, result)
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def features(folder: Path, result: Adjustment) -> tuple[list[Json], list[Json]]:
    """The points and the polygons of the two files."""
    paths = folder / "photographs.geojson", folder / "footprints.geojson"
    write_pose_geojson(*paths, result)
    layers = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    for collection, kind in zip(layers, ("Point", "Polygon"), strict=True):
        assert set(collection) == {"type", "features"}
        assert collection["type"] == "FeatureCollection"
        for f in collection["features"]:
            assert set(f) == {"type", "geometry", "properties"}
            assert f["type"] == "Feature"
            assert f["geometry"] is None or f["geometry"]["type"] == kind
    return layers[0]["features"], layers[1]["features"]


def vector(row: dict[str, Any], *names: str) -> FloatArray:
    return np.array([float(row[name]) for name in names])


@given(rotation=ROTATIONS)
def test_gimbal_angles_are_undone_by_the_camera_module(rotation: FloatArray) -> None:
    yaw, pitch, roll = gimbal_from_rotation(rotation)
    assert np.allclose(rotation_from_gimbal(yaw, pitch, roll), rotation, atol=2e-7)


@given(yaw=st.floats(-180, 180), up=st.booleans(), tilt=st.sampled_from([0.0, 1e-12, 1e-9, 1e-5]))
def test_straight_down_the_heading_is_all_in_the_yaw(yaw: float, up: bool, tilt: float) -> None:
    rotation = rotation_from_gimbal(yaw, (90.0 - tilt) if up else (tilt - 90.0), 0.0)
    angles = gimbal_from_rotation(rotation)
    assert np.allclose(rotation_from_gimbal(*angles), rotation, atol=2e-7)
    if tilt < 1e-6:
        assert angles[2] == 0.0
        assert abs((angles[0] - yaw + 180) % 360 - 180) < 1e-6


@pytest.mark.parametrize("heading", [(0.0, 1.0), (1.0, 0.0), (0.6, -0.8), (-0.8, -0.6)])
@pytest.mark.parametrize("up", [-1.0, 1.0])
def test_exactly_vertical_photographs_keep_their_heading(heading: tuple[float, float], up: float) -> None:
    """Matrices with exact zeros, which no angles in floating point give: yaw and roll from them alone are 0."""
    towards = np.array([*heading, 0.0])
    down = towards * up  # the bottom of the picture of a photograph that looks up is where its yaw points to
    axis = np.array([0.0, 0.0, up])
    rotation = np.column_stack([np.cross(down, axis), down, axis])
    yaw, pitch, roll = gimbal_from_rotation(rotation)
    assert yaw == pytest.approx(np.rad2deg(np.arctan2(*heading)))
    assert (pitch, roll) == (90.0 * up, 0.0)
    assert np.allclose(rotation_from_gimbal(yaw, pitch, roll), rotation, atol=1e-12)


@given(rotation=ROTATIONS, position=POSITIONS)
def test_the_table_leads_back_to_the_pose(
    tmp_path_factory: pytest.TempPathFactory, rotation: FloatArray, position: FloatArray
) -> None:
    folder = tmp_path_factory.getbasetemp()
    (row,) = table(folder, adjusted([Pose(rotation, position)]))
    place = FRAME.world_from_map(vector(row, "easting_m", "northing_m", "height_m")[None])[0]
    assert np.abs(place - position).max() < 1e-4
    # Kraus 2007: map from image = Rx(ω) Ry(φ) Rz(κ), the image's axes x right, y up, z backward
    omega_phi_kappa = vector(row, "omega_deg", "phi_deg", "kappa_deg")
    map_from_camera = Rotation.from_euler("XYZ", omega_phi_kappa, degrees=True).as_matrix() @ NADIR
    assert np.abs(FRAME.rotation_world_from_map(position) @ map_from_camera - rotation).max() < 1e-6
    true_from_camera = rotation_from_gimbal(*vector(row, "yaw_deg", "pitch_deg", "roll_deg"))
    assert np.abs(FRAME.rotation_world_from_true(position) @ true_from_camera - rotation).max() < 1e-6


def test_yaw_is_from_true_north_and_kappa_from_grid_north(tmp_path: Path) -> None:
    """A photograph whose top points to true north, where grid north lies some degrees beside it."""
    (row,) = table(tmp_path, adjusted([Pose(NADIR, np.array([0.0, 0.0, 100.0]))]))
    east, north = FRAME.rotation_world_from_map(np.zeros(3))[:2, 1]
    convergence = np.rad2deg(np.arctan2(-east, north))
    assert abs(convergence) > 2.0
    assert float(row["yaw_deg"]) == pytest.approx(0.0, abs=1e-6)
    assert float(row["kappa_deg"]) == pytest.approx(-convergence, abs=1e-3)


def test_lines_units_and_photographs_that_are_left_out(tmp_path: Path) -> None:
    poses = [Pose(NADIR, np.array([0.0, 0.0, 80.0])), None, Pose(NADIR, np.array([30.0, 0.0, 80.0]))]
    rows = table(tmp_path, adjusted(poses))
    assert {row["crs"] for row in rows} == {"EPSG:25832"}
    assert tuple(rows[0]) == COLUMNS
    assert [row["name"] for row in rows] == [f'DJI "{i}", ä.JPG' for i in range(3)]
    assert [row["registered"] for row in rows] == ["yes", "no", "yes"]
    assert [row["flight"] for row in rows] == ["0", "1", "0"]
    assert {row["camera"] for row in rows} == {"left, wide"}
    assert all(rows[1][name] == "" for name in COLUMNS[4:-1])
    attitude = vector(rows[0], "sigma_x_deg", "sigma_y_deg", "sigma_z_deg")
    assert attitude == pytest.approx(np.rad2deg([1e-4, 2e-4, 3e-4]), abs=1e-8)


@given(yaw=st.floats(-180, 180), pitch=st.floats(-90, 20), roll=st.floats(-5, 5))
def test_heading_and_nadir_angle_are_those_of_the_gimbal(yaw: float, pitch: float, roll: float) -> None:
    heading, off = heading_and_nadir_angle_deg(rotation_from_gimbal(yaw, pitch, 0.0))
    assert abs((heading - yaw + 180) % 360 - 180) < 1e-6
    assert 0.0 <= heading <= 360.0
    assert off == pytest.approx(90.0 + pitch, abs=1e-6)
    leaning, _ = heading_and_nadir_angle_deg(rotation_from_gimbal(yaw, pitch, roll))
    assert abs((leaning - yaw + 180) % 360 - 180) < 8.0


@pytest.mark.parametrize("azimuth", [0.0, 90.0, 132.0, 270.0])
def test_a_heading_is_steady_where_yaw_and_roll_are_not(azimuth: float) -> None:
    """Turned a little about the picture's own axes yaw and roll may be anything; the top points where it did."""
    down = rotation_from_gimbal(azimuth, -90.0, 0.0)
    for tilt in ([0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.1, -0.2, 0.0]):
        tilted = down @ Rotation.from_rotvec(np.deg2rad(tilt)).as_matrix()
        heading, off = heading_and_nadir_angle_deg(tilted)
        assert abs((heading - azimuth + 180) % 360 - 180) < 0.001
        assert off == pytest.approx(np.linalg.norm(tilt), abs=1e-6)


def test_gdal_opens_the_table_as_points_of_the_map(tmp_path: Path) -> None:
    table(tmp_path, adjusted([Pose(NADIR, np.array([5.0, 7.0, 80.0])), None]))
    info = pyogrio.read_info(tmp_path / "photographs.csv")
    assert tuple(info["fields"]) == COLUMNS
    kinds = dict(zip(info["fields"], info["dtypes"], strict=True))
    assert {str(kinds[name]) for name in COLUMNS[4:-1]} == {"float64"}
    assert info["geometry_type"] == "Point"
    to_geodetic = [
        pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(805_000.0, 6_200_000.0)
        for crs in (info["crs"], FRAME.crs)
    ]
    assert to_geodetic[0] == pytest.approx(to_geodetic[1], abs=1e-9)
    _, _, geometry, fields = pyogrio.raw.read(tmp_path / "photographs.csv")
    point = shapely.from_wkb(geometry)
    easting = fields[COLUMNS.index("easting_m")]
    assert (point[0].x, point[1]) == (easting[0], None)


def test_sigmas_are_along_easting_northing_and_height(tmp_path: Path) -> None:
    """A photograph known to 1 m along the world's east and up and to 30 m along its north, 2.5° beside the map's."""
    pose = Pose(NADIR, np.array([0.0, 0.0, 80.0]))
    covariance = np.diag([1.0, 900.0, 1.0])
    result = adjusted([pose])
    (row,) = table(tmp_path, replace(result, covariances=replace(result.covariances, position_m2=covariance[None])))
    sigma = vector(row, "sigma_easting_m", "sigma_northing_m", "sigma_height_m")
    R = FRAME.rotation_world_from_map(pose.position_world_m)
    assert sigma == pytest.approx(np.sqrt(np.diag(R.T @ covariance @ R)), abs=1e-4)
    assert sigma[0] > 1.3


def test_a_sigma_that_is_not_known_is_empty(tmp_path: Path) -> None:
    result = adjusted([Pose(NADIR, np.array([0.0, 0.0, 80.0]))])
    result = replace(result, covariances=replace(result.covariances, position_m2=np.full((1, 3, 3), np.nan)))
    (row,) = table(tmp_path, result)
    assert row["sigma_easting_m"] == ""
    assert features(tmp_path, result)[0][0]["properties"]["sigma_easting_m"] is None


@given(rotation=ROTATIONS, position=POSITIONS)
def test_the_point_lies_where_the_photograph_was_taken(
    tmp_path_factory: pytest.TempPathFactory, rotation: FloatArray, position: FloatArray
) -> None:
    folder = tmp_path_factory.getbasetemp()
    result = adjusted([Pose(rotation, position)])
    point = features(folder, result)[0][0]
    assert point["geometry"]["type"] == "Point"
    properties = point["properties"]
    geodetic = np.array([[*point["geometry"]["coordinates"], properties["height_m"]]])
    assert np.abs(FRAME.world_from_map(map_from_geodetic(FRAME.crs, geodetic))[0] - position).max() < 5e-4
    (row,) = table(folder, result)
    for name in COLUMNS[4:-1]:
        assert (float(row[name]) if row[name] else None) == properties[name]


def test_footprints_project_to_the_corners_of_the_photograph(tmp_path: Path) -> None:
    tilted = NADIR @ Rotation.from_euler("xyz", [25.0, -8.0, 140.0], degrees=True).as_matrix()
    pose = Pose(tilted, np.array([12.0, -40.0, 90.0]))
    (photograph,), (footprint,) = features(tmp_path, adjusted([pose]))
    assert footprint["properties"] == {"name": photograph["properties"]["name"]}
    (ring,) = footprint["geometry"]["coordinates"]
    assert footprint["geometry"]["type"] == "Polygon"
    assert len(ring) == 5
    assert ring[0] == ring[-1]
    x, y = np.array(ring).T
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0, "an outer ring runs counter-clockwise"
    height_map_m = FRAME.map_from_world(np.zeros((1, 3)))[0, 2]
    corners = map_from_geodetic(FRAME.crs, np.column_stack([x[:4], y[:4], np.full(4, height_map_m)]))
    pixel = project_points(CAMERA, pose, FRAME.world_from_map(corners))
    expected = [[-0.5, -0.5], [-0.5, 599.5], [799.5, 599.5], [799.5, -0.5]]
    # 0.2 mm of longitude, and the curvature of the Earth
    assert pixel == pytest.approx(np.array(expected), abs=0.01)


@pytest.mark.parametrize(
    ("pitch_deg", "height_m", "radial"),
    [(-20.0, 80.0, 0.0), (30.0, 80.0, 0.0), (-90.0, -5.0, 0.0), (-90.0, 80.0, -0.9)],
    ids=["horizon", "sky", "below the ground", "distortion that folds"],
)
def test_photographs_without_a_footprint(tmp_path: Path, pitch_deg: float, height_m: float, radial: float) -> None:
    pose = Pose(rotation_from_gimbal(10.0, pitch_deg, 0.0), np.array([0.0, 0.0, height_m]))
    camera = replace(CAMERA, radial=np.array([radial, 0.0, 0.0, 0.0]))
    assert footprint_world_m(camera, pose, 0.0) is None
    result = adjusted([pose])
    result = replace(result, block=replace(result.block, cameras=(camera,)))
    assert [len(layer) for layer in features(tmp_path, result)] == [1, 0]


@pytest.mark.parametrize("frame", [FRAME, replace(FRAME, kind="grid")], ids=["tangent", "grid"])
def test_photographs_that_are_not_registered_stand_where_gnss_says(tmp_path: Path, frame: LocalFrame) -> None:
    gnss = [np.array([50.0, 60.0, 90.0]), None, None]
    (first, second, third), _ = features(
        tmp_path, adjusted([None, None, Pose(NADIR, np.array([0.0, 0.0, 80.0]))], gnss, frame)
    )
    assert second["geometry"] is None
    assert [f["properties"]["registered"] for f in (first, second, third)] == [False, False, True]
    assert "omega_deg" not in first["properties"]
    place = map_from_geodetic(frame.crs, np.array([[*first["geometry"]["coordinates"], 150.0]]))
    assert place[0, :2] == pytest.approx(frame.map_from_world(gnss[0][None])[0, :2], abs=5e-4)  # type: ignore[index]


def test_files_are_whole_or_not_at_all(tmp_path: Path) -> None:
    result = adjusted([Pose(NADIR, np.array([0.0, 0.0, 80.0]))])
    missing = tmp_path / "missing"
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_pose_table(missing / "file", result)
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_pose_geojson(missing / "file", missing / "other", result)
    assert not list(tmp_path.iterdir())
