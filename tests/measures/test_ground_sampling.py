"""Ground sampling distance: against geometry."""

from collections.abc import Sequence

import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, rotation_from_gimbal
from photogram.geodesy.frames import LocalFrame
from photogram.measures.ground_sampling import ground_sampling_m, photographs_ground_sampling_m
from photogram.survey import Block, ControlPoints, Photograph, TiePoints

FRAME = LocalFrame("EPSG:25832", (602340.0, 5794120.0, 100.0), "grid")
NADIR = np.diag([1.0, -1.0, -1.0])
FOCAL_PX = 800.0
CAMERA = Camera("square", 1000, 600, FOCAL_PX, np.array([499.5, 299.5]))


def block_of(points: FloatArray, poses: Sequence[Pose | None]) -> Block:
    """Photographs over tie points (P, 3), each observed in every registered photograph."""
    registered = [i for i, pose in enumerate(poses) if pose is not None]
    photograph, n = np.tile(np.array(registered, dtype=np.int64), len(points)), len(points) * len(registered)
    point, colour = np.repeat(np.arange(len(points)), len(registered)), np.zeros((len(points), 3), np.uint8)
    ties = TiePoints(photograph, point, np.zeros(n, np.int64), np.zeros((n, 2)), np.ones(n), points, colour)
    none, nowhere = np.zeros(0, np.int64), np.zeros((0, 3))
    ground = ControlPoints((), (), nowhere, nowhere, none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)))
    photographs = tuple(Photograph(f"{i}.JPG", 0) for i in range(len(poses)))
    return Block(FRAME, (CAMERA,), photographs, tuple(poses), ties, ground)


def ground() -> FloatArray:
    return np.column_stack([*np.random.default_rng(0).uniform(-30.0, 30.0, (2, 400)), np.zeros(400)])


def test_it_is_height_over_focal_length() -> None:
    poses = [Pose(NADIR, np.array([0.0, 0.0, 80.0])), None, Pose(NADIR, np.array([10.0, 0.0, 120.0]))]
    gsd = photographs_ground_sampling_m(block_of(ground(), poses))
    assert gsd[[0, 2]] == pytest.approx([0.1, 0.15])
    assert np.isnan(gsd[1])
    assert np.isnan(photographs_ground_sampling_m(block_of(np.zeros((0, 3)), poses))).all()


def test_it_counts_along_the_axis() -> None:
    points = ground()
    pose = Pose(rotation_from_gimbal(70.0, -40.0, 5.0), np.array([-60.0, -10.0, 80.0]))
    expected = np.median(pose.camera_from_world(points)[:, 2]) / FOCAL_PX
    assert photographs_ground_sampling_m(block_of(points, [pose])) == pytest.approx([expected])
    assert expected < 0.97 * np.median(np.linalg.norm(points - pose.position_world_m, axis=1)) / FOCAL_PX


def test_that_of_a_survey_is_the_median_of_its_photographs() -> None:
    assert ground_sampling_m(np.array([80.0, 120.0, 30.0]), np.array([800.0, 1200.0, 100.0])) == pytest.approx(0.1)
