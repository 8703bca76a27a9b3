"""The table of camera parameters, and the one form of oriented cameras; the formulas are tested in test_camera.py."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.camera import Camera, Pose, oriented_by, project_points
from photogram.project.schema import CameraEntry, CameraSigmas
from photogram.projection import (
    AFFINITY,
    B1,
    CAMERA_PARAMETERS,
    CENTRE,
    CX,
    FOCAL,
    K1,
    K4,
    P1,
    PARAMETER_NAMES,
    RADIAL,
    SIGMA_KEYS,
    TANGENTIAL,
    centre_at_row,
    project_at_row,
    project_point,
    seen_at,
)

CAMERA = Camera(
    "c", 4000, 3000, 3500.0, np.array([2001.0, 1502.0]), np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.5, 0.6]),
    affinity=np.array([7.0, 8.0]),
)  # fmt: skip


def test_the_table_is_in_the_order_of_the_vector() -> None:
    for p, value in zip(CAMERA_PARAMETERS, CAMERA.parameters, strict=True):
        stated = getattr(CAMERA, p.key)
        assert (stated if p.place is None else stated[p.place]) == value, p.name
    assert (PARAMETER_NAMES[FOCAL], PARAMETER_NAMES[K4], PARAMETER_NAMES[B1]) == ("focal_px", "k4", "b1")
    for part, key in (
        (CENTRE, "principal_point_px"),
        (RADIAL, "radial"),
        (TANGENTIAL, "tangential"),
        (AFFINITY, "affinity"),
    ):
        assert [p.key for p in CAMERA_PARAMETERS].count(key) == part.stop - part.start
        assert {p.key for p in CAMERA_PARAMETERS[part]} == {key}


def test_a_project_file_knows_every_parameter_and_its_sigma() -> None:
    assert tuple(CameraSigmas.model_fields) == SIGMA_KEYS
    assert {p.key for p in CAMERA_PARAMETERS} <= set(CameraEntry.model_fields)
    stated = CameraSigmas(principal_point_px=3.0, k4=0.1)
    expected = {"cx_px": 3.0, "cy_px": 3.0, "k4": 0.1}
    assert (
        dict(zip(PARAMETER_NAMES, stated.of_parameters, strict=True)) == dict.fromkeys(PARAMETER_NAMES, 0.0) | expected
    )


@pytest.mark.parametrize(("k", "sigma"), [(FOCAL, 350.0), (CX, 400.0), (K1, 0.1), (P1, 0.1), (B1, 350.0)])
def test_a_share_is_one_of_the_focal_length_the_width_or_the_parameter(k: int, sigma: float) -> None:
    assert CAMERA_PARAMETERS[k].in_its_unit(0.1, CAMERA.focal_px, CAMERA.width_px) == pytest.approx(sigma)


def test_each_photograph_is_projected_by_its_own_camera_and_pose() -> None:
    wide = Camera("wide", 1000, 800, 500.0, np.array([499.5, 399.5]), np.array([-0.25, 0.0, 0.0, 0.0]))
    down = np.diag([1.0, -1.0, -1.0])
    poses = [Pose(down, np.array([0.0, 0.0, 80.0])), None, Pose(down, np.array([10.0, 5.0, 60.0]))]
    cameras = oriented_by([CAMERA, wide], np.array([0, 0, 1]), poses)
    X = np.array([4.0, -3.0, 1.0])
    for p, camera in ((0, CAMERA), (2, wide)):
        pose = poses[p]
        assert pose is not None
        expected = project_points(camera, pose, X[None])[0]
        np.testing.assert_array_equal(project_point(cameras, p, X)[:2], expected)
        np.testing.assert_array_equal(seen_at(cameras, p, X)[:2], expected)
    assert np.isnan(project_point(cameras, 1, X)).all()
    beyond = np.array([10.0 + 2.0 * 60.0, 5.0, 0.0])  # the distortion folds back at r = 1.15
    assert np.isfinite(project_point(cameras, 2, beyond)).all()
    assert np.isnan(seen_at(cameras, 2, beyond)[:2]).all()


ROLLING = Camera(
    "r", 4000, 3000, 3500.0, np.array([2001.0, 1502.0]), np.array([-0.03, 0.02, 0.0, 0.0]), np.array([5e-4, -3e-4]),
    readout_s=0.05,
)  # fmt: skip
FAST = Pose(np.diag([1.0, -1.0, -1.0]), np.array([5.0, -3.0, 40.0]), np.array([9.0, 12.0, 1.5]))


def test_a_rolling_shutter_shows_a_point_from_where_the_camera_is_when_it_reads_the_row() -> None:
    cameras = oriented_by([ROLLING], np.zeros(1, np.int64), [FAST])
    plain = replace(ROLLING, readout_s=0.0)
    rng = np.random.default_rng(4)
    points = FAST.position_world_m + np.column_stack([rng.uniform(-18, 18, (200, 2)), rng.uniform(-45, -30, 200)])
    pixel = project_points(ROLLING, FAST, points)
    inside = ROLLING.contains(pixel)
    assert inside.sum() > 50
    moved = np.linalg.norm(pixel - project_points(plain, FAST, points), axis=1)
    assert moved[inside].max() > 30.0, "half of 0.05 s at 15 m/s, in pixels of 1 cm"
    for X, (u, v) in zip(points[inside], pixel[inside], strict=True):
        share = v / (ROLLING.height_px - 1.0) - 0.5
        there = replace(FAST, position_world_m=FAST.position_world_m + 0.05 * share * FAST.velocity_world_m_s)
        np.testing.assert_allclose(project_points(plain, there, X[None])[0], [u, v], atol=1e-3)
        np.testing.assert_allclose(project_at_row(cameras, 0, X, v)[:2], [u, v], atol=1e-3)
        np.testing.assert_allclose(centre_at_row(cameras, 0, v), there.position_world_m, rtol=1e-12)
        np.testing.assert_array_equal(seen_at(cameras, 0, X)[:2], [u, v])


def test_without_motion_or_read_out_time_nothing_changes_a_bit() -> None:
    rng = np.random.default_rng(5)
    points = FAST.position_world_m + np.column_stack([rng.uniform(-18, 18, (50, 2)), rng.uniform(-45, -30, 50)])
    still = replace(FAST, velocity_world_m_s=np.zeros(3))
    expected = project_points(replace(ROLLING, readout_s=0.0), still, points)
    np.testing.assert_array_equal(project_points(ROLLING, still, points), expected)
    np.testing.assert_array_equal(project_points(replace(ROLLING, readout_s=0.0), FAST, points), expected)


@pytest.mark.parametrize("axis", range(3))
def test_a_metre_a_second_along_one_axis_of_the_camera_is_a_motion(axis: int) -> None:
    along = FAST.rotation_world_from_camera[:, axis]
    pose = replace(FAST, velocity_world_m_s=along)
    assert pose.rotation_world_from_camera.T @ along == pytest.approx(np.eye(3)[axis], abs=0), "exactly one"
    X = FAST.position_world_m + np.array([7.0, 9.0, -35.0])
    [pixel] = project_points(ROLLING, pose, X[None])
    share = pixel[1] / (ROLLING.height_px - 1.0) - 0.5
    there = replace(pose, position_world_m=pose.position_world_m + 0.05 * share * along)
    [expected] = project_points(replace(ROLLING, readout_s=0.0), there, X[None])
    np.testing.assert_allclose(pixel, expected, rtol=0, atol=1e-6)
    assert np.linalg.norm(pixel - project_points(replace(ROLLING, readout_s=0.0), pose, X[None])[0]) > 0.1
