"""Orientation from known poses: theirs in any frame, what is missing joined, what does not fit refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from makers import simulated
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, Similarity
from photogram.errors import OrientationError
from photogram.sfm.known_poses import KnownPoses
from photogram.sfm.orientation import OrientationSettings, orient
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan

PLAN = SurveyPlan(strips=2, photographs_per_strip=5, control_points=6, check_points=2)
ELSEWHERE = Similarity(0.01, Rotation.from_rotvec([0.4, -2.0, 1.1]).as_matrix(), np.array([5.0, -3.0, 2.0]))


@cache
def made() -> SimulatedBlock:
    return simulated(PLAN, tie_points=300)


def known(poses: tuple[Pose | None, ...], camera: Camera | None = None) -> KnownPoses:
    moved = tuple(None if pose is None else ELSEWHERE.pose(pose) for pose in poses)
    return KnownPoses(moved, (camera or made().truth.camera,))


def largest_error_m(poses: tuple[Pose | None, ...]) -> float:
    return max(
        float(np.linalg.norm(found.position_world_m - true.position_world_m)) if found is not None else np.inf
        for found, true in zip(poses, made().truth.poses, strict=True)
    )


def test_true_poses_of_another_frame_are_brought_into_the_world() -> None:
    block = made().block
    found = orient(block, OrientationSettings(), known=known(made().truth.poses))
    assert found.method == "start"
    assert found.registered.all()
    assert largest_error_m(found.poses) < 0.2  # marks and control points have errors of their own
    np.testing.assert_array_equal(found.parameters[0], made().truth.camera.parameters)


def test_control_points_in_every_photograph_do_not_replace_known_poses() -> None:
    found = orient(made().block, OrientationSettings(method="control"), known=known(made().truth.poses))
    assert found.method == "start"


def test_a_photograph_without_a_pose_is_joined_by_its_tie_points() -> None:
    poses = tuple(None if i in (3, 7) else pose for i, pose in enumerate(made().truth.poses))
    found = orient(made().block, OrientationSettings(), known=known(poses))
    assert found.registered.all()
    assert largest_error_m(found.poses) < 0.3


def test_poses_of_other_photographs_are_refused() -> None:
    turned = made().truth.poses[1:] + made().truth.poses[:1]
    with pytest.raises(OrientationError, match=r"do not fit the tie points: .* set start: \{poses: own\}"):
        orient(made().block, OrientationSettings(), known=known(turned))


def test_one_pose_that_is_wrong_is_found_anew() -> None:
    wrong = made().truth.poses[4]
    poses = tuple(
        Pose(wrong.rotation_world_from_camera, wrong.position_world_m + np.array([0.0, 40.0, 0.0])) if i == 4 else pose
        for i, pose in enumerate(made().truth.poses)
    )
    found = orient(made().block, OrientationSettings(), known=known(poses))
    assert found.registered.all()
    assert largest_error_m(found.poses) < 0.3


def test_nothing_known_of_the_tie_points_is_refused() -> None:
    block = replace(made().block, tie_points=made().block.tie_points.select(np.zeros(300, dtype=bool)))
    with pytest.raises(OrientationError, match="0\u202f% of the image points"):
        orient(block, OrientationSettings(), known=known(made().truth.poses))
