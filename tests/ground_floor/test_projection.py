"""The table of camera parameters, and the one form of oriented cameras; the formulas are tested in test_camera.py."""

from __future__ import annotations

import numpy as np
import pytest

from photogram.camera import Camera, Pose, oriented_by, project
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
        expected = project(camera, pose, X[None])[0]
        np.testing.assert_array_equal(project_point(cameras, p, X)[:2], expected)
        np.testing.assert_array_equal(seen_at(cameras, p, X)[:2], expected)
    assert np.isnan(project_point(cameras, 1, X)).all()
    beyond = np.array([10.0 + 2.0 * 60.0, 5.0, 0.0])  # the distortion folds back at r = 1.15
    assert np.isfinite(project_point(cameras, 2, beyond)).all()
    assert np.isnan(seen_at(cameras, 2, beyond)[:2]).all()
