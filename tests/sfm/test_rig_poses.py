"""Bands that match nothing: oriented by their master, adjusted by themselves, and where they then lie on the ground."""

from dataclasses import replace

import numpy as np
import pytest
from lib.simulated.bands import NOMINAL_SIGMA, Bands, simulate_bands
from scipy.stats import chi2

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.sfm.orientation import Orientation
from photogram.sfm.rig_poses import carried_by_masters
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block

LABORATORY = (0.5, 0.5, 0.5, 5e-4, 5e-4, 0.0, 0.0, 5e-5, 5e-5, 0.0, 0.0)
PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=8, check_points=3, control_marks_per_photograph=0,
    calibration_sigmas=LABORATORY,
)  # fmt: skip


@pytest.fixture(scope="module")
def made() -> Bands:
    return simulate_bands(PLAN, 1)


def masters_alone(block: Block) -> Orientation:
    """Return the orientation of a block of which the photographs without a pose match nothing."""
    placed = [pose is not None for pose in block.poses]
    reason = tuple("" if p else "too few common tie points" for p in placed)
    component = np.array([0 if p else -1 for p in placed], dtype=np.int64)
    return Orientation(block.poses, (None,) * len(placed), component, "attitude", reason)


def test_companions_have_the_pose_that_their_master_carries_them_in(made: Bands) -> None:
    block, before = made.block, masters_alone(made.block)
    found = carried_by_masters(block, before)
    assert found.registered.all()
    assert (found.component == 0).all()
    assert set(found.reason) == {""}
    assert found.poses[:8] == before.poses[:8]
    master, band = found.poses[3], found.poses[8 + 3]
    given = block.rigs[0].given
    assert master is not None
    assert band is not None
    assert given is not None
    R, X = given.companions(master.rotation_world_from_camera[None], master.position_world_m[None])
    np.testing.assert_array_equal(band.rotation_world_from_camera, R[0])
    np.testing.assert_array_equal(band.position_world_m, X[0])


def test_nothing_is_carried_without_a_master_or_a_relative_pose(made: Bands) -> None:
    block = made.block
    lost = replace(block, poses=(None, *block.poses[1:]))
    found = carried_by_masters(lost, masters_alone(lost))
    assert [i for i, pose in enumerate(found.poses) if pose is None] == [0, 8, 16, 24, 32]
    assert found.reason[8] == "too few common tie points"
    free = replace(block, rigs=(replace(block.rigs[0], given=None), *block.rigs[1:]))
    assert [pose is None for pose in carried_by_masters(free, masters_alone(free)).poses].count(True) == 8


def test_bands_that_match_nothing_are_adjusted_to_their_relative_poses(made: Bands) -> None:
    """Five cameras in one block, without one tie point in common: the rigs alone hold them together."""
    block = made.block
    ties = block.tie_points
    cameras_of_points = np.unique(np.column_stack([ties.point, block.camera_of[ties.photograph]]), axis=0)
    assert len(cameras_of_points) == len(ties)
    result = adjust(replace(block, poses=carried_by_masters(block, masters_alone(block)).poses), AdjustmentSettings())
    assert 0.95 < result.sigma0 < 1.05
    total = 0.0
    for k, (rig, true) in enumerate(zip(result.block.rigs, made.relative, strict=True)):
        assert rig.pose is not None
        error = true.misfits(rig.pose.rotation_master_from_companion[None], rig.pose.offset_m[None])[0]
        covariance = result.tests.exposures.relative_covariance[k]
        total += float(error @ np.linalg.solve(covariance, error))
        assert np.all(np.sqrt(np.diag(covariance))[:3] < 0.2 * NOMINAL_SIGMA[:3])
        assert np.abs(made.registration_px(result, k + 1)).max() < 2.0
    assert chi2.ppf(0.001, 24) < total < chi2.ppf(0.999, 24)


def test_registration_is_zero_where_cameras_and_poses_are_true(made: Bands) -> None:
    result = adjust(
        replace(made.block, poses=carried_by_masters(made.block, masters_alone(made.block)).poses), AdjustmentSettings()
    )
    true = replace(result, block=replace(result.block, cameras=made.cameras, poses=made.poses))
    off = made.registration_px(true, 2)
    assert len(off) > 500
    assert np.abs(off).max() < 1e-6
