"""OPF: round trip, the project in Pix4D's own library, its projection as referee, hostile folders."""

import importlib
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_same_cameras, rms_px, small_solution
from makers import Json, SharedData

from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import tie_points_of
from photogram.exchange.formats.metashape.metashape_cameras import read_metashape_cameras, write_metashape_cameras
from photogram.exchange.formats.pix4d.opf import read_opf, write_opf
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution

MAP_ORIGIN = np.array([500_123.0, 5_400_456.0, 210.0])


def perspective(frame: str = "map") -> ForeignSolution:
    """Return the small solution as OPF can hold it, in a map with measured positions."""
    solution = small_solution(k4=0.0, b=(0.0, 0.0))
    if frame != "map":
        return solution
    photographs = tuple(
        replace(
            p,
            pose=None
            if p.pose is None
            else Pose(p.pose.rotation_world_from_camera, p.pose.position_world_m + MAP_ORIGIN),
            measured=MAP_ORIGIN + i,
            measured_sigma_m=np.array([0.1, 0.2, 0.3]),
        )
        for i, p in enumerate(solution.photographs)
    )
    tie, ground = solution.tie_points, solution.ground_points
    assert ground is not None
    return replace(
        solution,
        photographs=photographs,
        tie_points=replace(tie, position_world_m=tie.position_world_m + MAP_ORIGIN),
        ground_points=replace(ground, position_world_m=ground.position_world_m + MAP_ORIGIN),
        frame="map",
        crs="EPSG:32632",
    )


@pytest.mark.parametrize("frame", ["map", "local"])
def test_what_is_written_is_read_again(tmp_path: Path, frame: str) -> None:
    solution = perspective(frame)
    write_opf(tmp_path / "project", solution)
    found = read_opf(tmp_path / "project")
    assert_same_cameras(found, solution, 1e-9 if frame == "map" else 1e-12)
    assert (found.frame, found.crs) == (frame, solution.crs)
    tie, true = found.tie_points, solution.tie_points
    for name in ("photograph", "point", "feature", "colour"):
        np.testing.assert_array_equal(getattr(tie, name), getattr(true, name))
    np.testing.assert_allclose(tie.pixel, true.pixel, rtol=0, atol=1e-4)
    np.testing.assert_allclose(tie.position_world_m, true.position_world_m, rtol=0, atol=2e-6)
    assert rms_px(found) == pytest.approx(rms_px(solution), rel=1e-4)
    ground, known = found.ground_points, solution.ground_points
    assert ground is not None
    assert known is not None
    assert (ground.name, ground.role) == (known.name, known.role)
    np.testing.assert_allclose(ground.position_world_m, known.position_world_m, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(ground.sigma_m, known.sigma_m)
    np.testing.assert_array_equal(ground.mark_pixel, known.mark_pixel)
    for one, other in zip(found.photographs, solution.photographs, strict=True):
        assert (one.measured is None) == (other.measured is None)
        if one.measured is not None and other.measured is not None:
            np.testing.assert_allclose(one.measured, other.measured, rtol=0, atol=1e-9)


def opened_by_pyopf() -> Callable[[Path], Any]:
    """Return how Pix4D's own library opens a project, or skip the test without it."""
    reason = "pyopf, Pix4D's library of OPF, is not installed"
    load = pytest.importorskip("pyopf.io", reason=reason).load
    resolve = pytest.importorskip("pyopf.resolve", reason=reason).resolve
    return lambda folder: resolve(load(str(folder / "project.opf")))


def test_the_project_opens_in_pix4ds_library(tmp_path: Path) -> None:
    pyopf = opened_by_pyopf()

    solution = perspective()
    write_opf(tmp_path / "project", solution)
    project = pyopf(tmp_path / "project")
    assert [c.uri for c in project.camera_list.cameras] == [f"flight%201/{p.name}" for p in solution.photographs]
    assert len(project.calibration.calibrated_cameras.cameras) == 4
    assert len(project.input_control_points.gcps) == 2
    assert len(project.input_control_points.mtps) == 1
    tracks = project.calibration.tracks.nodes[0]
    tie = solution.tie_points
    ranges = [tracks.matches.point_index_ranges[p] for p in range(len(tracks))]
    assert ranges == list(zip(tie.first_observation[:-1].tolist(), tie.rays.tolist(), strict=True))
    z_up = importlib.import_module("pyopf.pointcloud.pcl").opf_axis_rotation_matrix_inverse
    world = (z_up @ tracks.matrix)[:3, :3] @ tracks.position.T
    shift = project.scene_reference_frame.base_to_canonical.shift
    np.testing.assert_allclose(world.T - shift, tie.position_world_m, rtol=0, atol=2e-6)


def test_pix4ds_own_conversion_projects_with_the_same_residuals(tmp_path: Path) -> None:
    """The referee is opf2colmap: its rotations and OpenCV's projection of its parameters."""
    pyopf = opened_by_pyopf()

    solution = perspective()
    write_opf(tmp_path / "project", solution)
    project = pyopf(tmp_path / "project")
    tie = solution.tie_points
    residual = []
    sensors = {int(s.id): s.internals for s in project.calibration.calibrated_cameras.sensors}
    shift = project.scene_reference_frame.base_to_canonical.shift
    for camera in project.calibration.calibrated_cameras.cameras:
        mine = tie.photograph == int(camera.id) - 1
        q = sensors[int(camera.sensor_id)]
        f, (cx, cy), (k1, k2, k3) = q.focal_length_px, q.principal_point_px, q.radial_distortion
        so, co, sp, cp, sk, ck = [g(a) for a in np.radians(camera.orientation_deg) for g in (np.sin, np.cos)]
        R = np.array([  # opf2colmap's rotation, camera from world
            [cp * ck, co * sk + so * sp * ck, so * sk - co * sp * ck],
            [cp * sk, -co * ck + so * sp * sk, -so * ck - co * sp * sk],
            [-sp, so * cp, -co * cp],
        ])  # fmt: skip
        points = tie.position_world_m[tie.point[mine]] + shift
        at, _ = cv2.projectPoints(
            points, cv2.Rodrigues(R)[0], -R @ camera.position, np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]]),
            np.array([k1, k2, *q.tangential_distortion, k3]),
        )  # fmt: skip
        residual.append(at[:, 0] - (tie.pixel[mine] + 0.5))
    rms = float(np.sqrt((np.concatenate(residual) ** 2).sum(axis=1).mean()))
    assert rms == pytest.approx(rms_px(solution), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "fisheye"}, "fisheye"),
        ({"radial": np.array([0.0, 0.0, 0.0, 0.01])}, "k4"),
        ({"affinity": np.array([0.0, 0.5])}, "b2"),
    ],
)
def test_what_opf_cannot_hold_is_not_written(tmp_path: Path, change: Json, message: str) -> None:
    solution = perspective()
    camera = replace(solution.cameras[0], **change)
    with pytest.raises(ExchangeError, match=message):
        write_opf(tmp_path / "project", replace(solution, cameras=(camera, solution.cameras[1])))
    assert not (tmp_path / "project").exists()


def test_geocentric_coordinates_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match="geocentric"):
        write_opf(tmp_path / "project", replace(perspective(), frame="geocentric", crs=None))


def changed(folder: Path, name: str, change: Callable[[Json], object]) -> None:
    value = json.loads((folder / name).read_text(encoding="utf-8"))
    change(value)
    (folder / name).write_text(json.dumps(value), encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("calibrated-cameras.json", lambda v: v["sensors"][0]["internals"].update(type="fisheye"), "fisheye"),
        ("calibrated-cameras.json", lambda v: v["cameras"][0].update(position=[0, 0]), "3 finite numbers"),
        ("calibrated-cameras.json", lambda v: v["cameras"][0].update(id=-1), "whole number"),
        ("camera-list.json", lambda v: v["cameras"][0].update(uri="a/.."), "no name"),
        ("camera-list.json", lambda v: v["cameras"][0].update(uri="b/IMG_001.JPG"), "same file name"),
        ("project.opf", lambda v: v["items"][0]["resources"][0].update(uri="../x.json"), "leads out"),
        ("project.opf", lambda v: v["items"][0]["resources"][0].update(uri="%2e%2e/x.json"), "leads out"),
        ("project.opf", lambda v: v["items"].pop(0), "names no"),
        ("scene-reference-frame.json", lambda v: v["base_to_canonical"].update(scale=[1, 1, 0.3048]), "scales"),
        ("tracks/tracks.gltf", lambda v: v["accessors"][0].update(count=2**63), "has place for 30"),
        ("tracks/tracks.gltf", lambda v: v["bufferViews"][0].update(byteOffset=2**63), "has place for 0"),
        ("tracks/tracks.gltf", lambda v: v["buffers"][0].update(uri="/etc/passwd"), "leads out"),
        ("tracks/tracks.gltf", lambda v: v["accessors"][0].update(componentType=5121), "expected VEC3"),
    ],
)
def test_what_is_wrong_is_refused(tmp_path: Path, name: str, change: Callable[[Json], object], message: str) -> None:
    folder = tmp_path / "project"
    write_opf(folder, perspective())
    changed(folder, name, change)
    with pytest.raises(ExchangeError, match=message):
        read_opf(folder)


def test_nan_and_deep_nesting_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "project"
    write_opf(folder, perspective())
    for text in ('{"format": NaN}', "[" * 100_000, "1" * 10_000, '{"format": "' + "x" * 100):
        (folder / "project.opf").write_text(text, encoding="utf-8")
        with pytest.raises(ExchangeError):
            read_opf(folder)


FILES = ("project.opf", "camera-list.json", "input-cameras.json", "scene-reference-frame.json",
         "calibrated-cameras.json", "input-control-points.json", "projected-control-points.json",
         "projected-input-cameras.json",
         "tracks/tracks.gltf", "tracks/positions.bin", "tracks/matchPointIndexRanges.bin", "tracks/matchCameraIds.bin",
         "tracks/matchPixelCoordinates.bin", "tracks/matchFeatureIds.bin", "tracks/colors.bin")  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_damaged_files_are_refused_or_read(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "project"
    write_opf(folder, perspective())
    assert_refused_or_read(folder / name, lambda: read_opf(folder), 7, least=40)


def test_a_real_scene_keeps_its_poses_and_residuals(tmp_path: Path, shared_data: SharedData) -> None:
    """The scene is COLMAP's, as pycolmap reads and projects it; it goes through OPF and through Metashape's XML."""
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap, COLMAP's library, is not installed")
    model = pycolmap.Reconstruction(str(shared_data("exchange/colmap_example_model_bin")))
    numbers = sorted(model.images)
    (camera,) = model.cameras.values()
    f, cx, cy, k = camera.params
    mine = Camera("c", camera.width, camera.height, f, np.array([cx, cy]) - 0.5, np.array([k, 0.0, 0.0, 0.0]))
    poses, rows, squared = [], [], []
    points = {number: i for i, number in enumerate(sorted(model.points3D))}
    for i, number in enumerate(numbers):
        image = model.images[number]
        R = image.cam_from_world().rotation.matrix()
        poses.append(Pose(R.T, -R.T @ image.cam_from_world().translation))
        for p in image.points2D:
            if p.has_point3D():
                rows.append((points[p.point3D_id], i, *p.xy))
                at = camera.img_from_cam(image.cam_from_world() * model.points3D[p.point3D_id].xyz)
                squared.append(((at - p.xy) ** 2).sum())
    table = np.array(rows)
    position = np.array([model.points3D[number].xyz for number in sorted(model.points3D)])
    photograph, point = table[:, :2].astype(np.int64).T[::-1]
    tie = tie_points_of("here", photograph, point, table[:, 2:] - 0.5, position)
    photographs = tuple(
        ForeignPhotograph(PurePosixPath(model.images[number].name).name, 0, pose, PurePosixPath("a.jpg"))
        for number, pose in zip(numbers, poses, strict=True)
    )
    solution = ForeignSolution("COLMAP", (mine,), photographs, tie)
    rms = float(np.sqrt(np.mean(squared)))
    assert rms_px(solution) == pytest.approx(rms, rel=1e-9)
    named = replace(solution, photographs=tuple(replace(p, file=PurePosixPath(p.name)) for p in photographs))
    write_opf(tmp_path / "project", named)
    write_metashape_cameras(tmp_path / "cameras.xml", named)
    found, other = read_opf(tmp_path / "project"), read_metashape_cameras(tmp_path / "cameras.xml")
    assert rms_px(found) == pytest.approx(rms, rel=1e-4)
    assert_same_cameras(found, named, 1e-9)
    assert_same_cameras(other, named, 1e-12)


def test_a_link_in_the_folder_is_not_followed(tmp_path: Path) -> None:
    folder = tmp_path / "project"
    write_opf(folder, perspective())
    shutil.move(folder / "camera-list.json", tmp_path / "elsewhere.json")
    (folder / "camera-list.json").symlink_to(tmp_path / "elsewhere.json")
    with pytest.raises(ExchangeError, match="is a link"):
        read_opf(folder)
