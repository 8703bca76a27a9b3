"""Tie points of a master found in a band beside it: pictures of one plane, the band's with other grey values."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.arrays import ByteArray, FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.sfm.tie_points.band_matching import gradients, transfer_to_band
from photogram.sfm.tie_points.guided_matching import TransferSettings, cut_patches, transfer_to
from photogram.survey import TiePoints

CAMERA = Camera("c", 360, 300, 400.0, np.array([179.5, 149.5]))
BAND = Camera("b", 360, 300, 392.0, np.array([180.5, 148.0]))
DOWN = np.diag([1.0, -1.0, -1.0])
ABOVE = Pose(DOWN, np.array([0.0, 0.0, 40.0]))
BESIDE = Pose(DOWN @ Rotation.from_rotvec([0.012, -0.009, 0.006]).as_matrix(), np.array([0.04, -0.03, 40.0]))
GROUND_PX_M = 0.05
SETTINGS = TransferSettings()


def texture(seed: int) -> FloatArray:
    """Ground of 50 × 50 m with fields that have edges, from 0 to 1."""
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(rng.random((125, 125)), (1000, 1000), interpolation=cv2.INTER_CUBIC)
    return np.asarray(cv2.GaussianBlur(np.digitize(coarse, [0.3, 0.45, 0.55, 0.7]) / 4.0, (0, 0), 1.2))


def seen(camera: Camera, pose: Pose, ground: FloatArray, seed: int) -> ByteArray:
    """The picture that a camera without distortion takes of the plane at height 0."""
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px].astype(float)
    centre = camera.principal_point_px
    ray = np.stack([(u - centre[0]) / camera.focal_px, (v - centre[1]) / camera.focal_px, np.ones_like(u)], axis=-1)
    ray = ray @ pose.rotation_world_from_camera.T
    C = pose.position_world_m
    X = C[:2] - ray[..., :2] * (C[2] / ray[..., 2:])
    at = (X / GROUND_PX_M + 499.5).astype(np.float32)
    picture = cv2.remap(ground.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    noise = np.random.default_rng(seed).normal(0.0, 1.5, picture.shape)
    return np.asarray(np.clip(40.0 + 160.0 * picture + noise, 0, 255), dtype=np.uint8)


def other_band(grey: ByteArray) -> ByteArray:
    """Grey values of another band: bright and dark turned round, bent, and of another contrast."""
    share = 1.0 - grey / 255.0
    return np.asarray(30.0 + 120.0 * share**1.7, dtype=np.uint8)


def tie_points(count: int = 200) -> TiePoints:
    """Points of the plane that the master's photograph, number 0, shows."""
    pixel = np.random.default_rng(3).uniform([25.0, 25.0], [334.0, 274.0], (count, 2))
    x = (pixel - CAMERA.principal_point_px) / CAMERA.focal_px
    X = np.column_stack([40.0 * x[:, 0], -40.0 * x[:, 1], np.zeros(count)])
    number = np.arange(count, dtype=np.int64)
    return TiePoints(
        np.zeros(count, dtype=np.int64), number, number, pixel, np.full(count, 0.5), X,
        np.zeros((count, 3), dtype=np.uint8),
    )  # fmt: skip


@pytest.fixture(scope="module")
def pictures() -> tuple[ByteArray, ByteArray]:
    ground = texture(1)
    return seen(CAMERA, ABOVE, ground, 4), other_band(seen(BAND, BESIDE, ground, 5))


NONE = np.zeros(0, dtype=np.int64)


def test_edges_are_found_where_the_band_shows_them_although_its_relative_pose_is_off(
    pictures: tuple[ByteArray, ByteArray],
) -> None:
    tie = tie_points()
    drawn = replace(BESIDE, rotation_world_from_camera=ABOVE.rotation_world_from_camera)  # off by 5 to 8 px
    found = transfer_to_band((0, 1), tie, NONE, [CAMERA, BAND], [ABOVE, drawn], pictures, SETTINGS)
    true = project_points(BAND, BESIDE, tie.position_world_m)
    off = found.pixel - true[found.point]
    assert len(found.point) > 0.6 * len(tie)
    assert np.all(np.diff(found.point) > 0)
    assert np.sqrt(np.mean(off**2)) < 0.3
    assert np.abs(off.mean(axis=0)).max() < 0.05
    predicted = project_points(BAND, drawn, tie.position_world_m)
    assert np.linalg.norm(predicted - true, axis=1).min() > 4.0


def test_a_band_that_is_far_off_is_found_where_all_of_it_is_off_alike(pictures: tuple[ByteArray, ByteArray]) -> None:
    tie = tie_points(600)
    turn = Rotation.from_rotvec([0.05, 0.03, 0.0]).as_matrix()  # 20 px down and 12 px across
    drawn = replace(BESIDE, rotation_world_from_camera=BESIDE.rotation_world_from_camera @ turn)
    cameras, poses = [CAMERA, BAND], [ABOVE, drawn]
    near = transfer_to_band((0, 1), tie, NONE, cameras, poses, pictures, SETTINGS)
    assert len(near.point) < 0.05 * len(tie)
    far = transfer_to_band((0, 1), tie, NONE, cameras, poses, pictures, SETTINGS, reach_px=35.0)
    off = far.pixel - project_points(BAND, BESIDE, tie.position_world_m)[far.point]
    assert len(far.point) > 0.4 * len(tie)
    assert np.median(np.abs(off)) < 0.15
    assert np.mean(np.linalg.norm(off, axis=1) > 2.0) < 0.02


def test_grey_values_say_nothing_of_such_a_band(pictures: tuple[ByteArray, ByteArray]) -> None:
    tie, poses = tie_points(), [ABOVE, BESIDE]
    shown = replace(
        tie, photograph=np.append(tie.photograph, 1), point=np.append(tie.point, len(tie) - 1),
        feature=np.append(tie.feature, 0), pixel=np.vstack([tie.pixel, [[0.0, 0.0]]]),
        sigma_px=np.append(tie.sigma_px, 0.5),
    )  # fmt: skip
    patches = cut_patches(tie, np.zeros((2, 3)), lambda _: pictures[0])
    found = transfer_to(1, shown, patches, [CAMERA, BAND], poses, pictures[1], SETTINGS)
    assert len(found.point) < 0.05 * len(tie)


def test_known_and_masked_tie_points_are_not_searched_for(pictures: tuple[ByteArray, ByteArray]) -> None:
    tie, poses = tie_points(), [ABOVE, BESIDE]
    every = transfer_to_band((0, 1), tie, NONE, [CAMERA, BAND], poses, pictures, SETTINGS)
    rest = transfer_to_band((0, 1), tie, every.point[:50], [CAMERA, BAND], poses, pictures, SETTINGS)
    np.testing.assert_array_equal(rest.point, every.point[50:])
    np.testing.assert_array_equal(rest.pixel, every.pixel[50:])
    left = np.zeros((300, 360), dtype=bool)
    left[:, :180] = True
    clear = transfer_to_band((0, 1), tie, NONE, [CAMERA, BAND], poses, pictures, SETTINGS, (None, left))
    assert len(clear.point)
    assert clear.pixel[:, 0].max() < 170.0
    clear = transfer_to_band((0, 1), tie, NONE, [CAMERA, BAND], poses, pictures, SETTINGS, (left, None))
    assert tie.pixel[clear.point, 0].max() < 164.0


def test_other_ground_and_photographs_without_a_pose_or_contrast_have_none(
    pictures: tuple[ByteArray, ByteArray],
) -> None:
    tie, poses = tie_points(), [ABOVE, BESIDE]
    other = other_band(seen(BAND, BESIDE, texture(9), 6))
    found = transfer_to_band((0, 1), tie, NONE, [CAMERA, BAND], poses, (pictures[0], other), SETTINGS)
    assert len(found.point) < 0.05 * len(tie)
    for lost in ([None, BESIDE], [ABOVE, None]):
        assert not len(transfer_to_band((0, 1), tie, NONE, [CAMERA, BAND], lost, pictures, SETTINGS).point)
    flat = np.full((300, 360), 90, dtype=np.uint8)
    assert not gradients(flat).any()
    assert not len(transfer_to_band((0, 1), tie, NONE, [CAMERA, BAND], poses, (pictures[0], flat), SETTINGS).point)


def test_gradients_are_the_same_whatever_the_contrast(pictures: tuple[ByteArray, ByteArray]) -> None:
    grey = pictures[0]
    half = gradients((grey // 2).astype(np.uint8))
    assert np.corrcoef(gradients(grey).ravel(), half.ravel())[0, 1] > 0.97
    assert np.percentile(half, 99.0) == pytest.approx(180.0, abs=3.0)
