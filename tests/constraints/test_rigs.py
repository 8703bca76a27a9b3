"""Relative poses of cameras on one body against GTSAM's composition, and photographs grouped to exposures."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.constraints.rigs import RelativePose, exposures, relative_poses


def poses(seed: int, count: int = 5) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    rotations = Rotation.from_rotvec(rng.normal(size=(count, 3))).as_matrix()
    return rotations, rng.normal(size=(count, 3)) * 100.0


def test_composition_is_that_of_gtsam_and_its_own_inverse() -> None:
    master, companion = poses(1), poses(2)
    rotation, offset_m = relative_poses(master, companion)
    for i in range(5):
        first, second = (gtsam.Pose3(gtsam.Rot3(of[0][i]), of[1][i]) for of in (master, companion))
        expected = first.between(second)
        np.testing.assert_allclose(offset_m[i], expected.translation(), atol=1e-11)
        np.testing.assert_allclose(rotation[i], expected.rotation().matrix(), atol=1e-13)
        again = RelativePose(offset_m[i], rotation[i]).companions(*master)
        np.testing.assert_allclose(again[0][i], companion[0][i], atol=1e-13)
        np.testing.assert_allclose(again[1][i], companion[1][i], atol=1e-11)


def test_a_misfit_is_the_turn_and_the_shift_that_were_put_in() -> None:
    master, given = poses(3), RelativePose(np.array([0.05, -0.02, 0.01]), poses(4)[0][0])
    turn_rad, shift_m = np.array([1e-3, -2e-3, 5e-4]), np.array([0.003, 0.001, -0.002])
    turned = given.rotation_master_from_companion @ Rotation.from_rotvec(turn_rad).as_matrix()
    moved = RelativePose(given.offset_m + shift_m, turned).companions(*master)
    misfits = given.misfits(*relative_poses(master, moved))
    np.testing.assert_allclose(misfits, np.tile([*turn_rad, *shift_m], (5, 1)), atol=1e-11)
    np.testing.assert_allclose(given.misfits(*relative_poses(master, given.companions(*master))), 0.0, atol=1e-11)


def test_companions_find_their_master_whatever_the_order() -> None:
    cameras = ["red", "rgb", "rgb", "red", "nir", "red"]
    found = exposures(cameras, ["b", "a", "b", "a", "c", None], "rgb")
    assert found.companion_master == ((0, 2), (3, 1))
    assert found.without_master == (4, 5)


def test_two_photographs_of_one_camera_are_no_exposure() -> None:
    with pytest.raises(ValueError, match="two photographs of camera red have the exposure 7"):
        exposures(["red", "rgb", "red"], [7, 7, 7], "rgb")


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match="offset"):
        RelativePose(np.zeros(2), np.eye(3))
