"""Lever arms from the antenna to the camera: the factor, the turn from the aircraft to the world, and what residuals
show when an arm is ignored. Surveys are simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from photogram.adjustment.adjustment import AdjustmentSettings, adjust
from photogram.adjustment.gnss_offsets import implied_offset_test
from photogram.arrays import FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.factors.priors import gnss_position, position_jacobian
from photogram.factors.variables import GNSS_OFFSET, POSE, key
from photogram.report.numbers.gnss import gnss_numbers
from photogram.report.numbers.numbers import gnss_residual_m
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block, Photograph

ARM = np.array([0.02, 0.3, -0.05])  # camera axes: 2 cm right, 30 cm to the rear, 5 cm up
SETTINGS = AdjustmentSettings(robust_loss="none")
PLAN = SurveyPlan(
    focal_px=900.0, strips=4, photographs_per_strip=5, control_points=8, check_points=4, forward_overlap=0.75,
    gnss_offset_sigma_m=(0.0, 0.0, 0.0), calibration_sigmas=(0.0,) * 11,
)  # fmt: skip


# ---- the factor ------------------------------------------------------------------------------------------------------


def gnss_of(adjusted: Adjustment) -> Any:
    """The GNSS part of the report, as one reads it from the file."""
    return gnss_numbers(adjusted)


@pytest.mark.parametrize("seed", range(4))
def test_the_factor_puts_the_antenna_where_the_arm_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, C = Rotation.random(rng=rng).as_matrix(), rng.normal(0, 30, 3)
    measured, offset, arm = rng.normal(0, 30, 3), rng.normal(0, 0.3, 3), rng.normal(0, 0.4, 3)
    sigma = np.array([0.02, 0.03, 0.05])
    values = gtsam.Values()
    values.insert(key(POSE, 2), gtsam.Pose3(gtsam.Rot3(R), C))
    values.insert(key(GNSS_OFFSET, 0), offset)
    for flight, o in ((None, np.zeros(3)), (0, offset)):
        factor = gnss_position(2, measured, sigma, flight, None, arm)
        error = (C - R @ arm - o - measured) / sigma
        assert factor.error(values) == pytest.approx(0.5 * error @ error)
        jacobian, right = factor.linearize(values).jacobian()
        np.testing.assert_allclose(right, -error, rtol=1e-12)
        # GTSAM's own factor without a flight is the referee of the analytic Jacobian with one
        np.testing.assert_allclose(jacobian[:, :6] * sigma[:, None], position_jacobian(R, arm), atol=1e-12)
        if flight == 0:
            np.testing.assert_allclose(jacobian[:, 6:] * sigma[:, None], -np.eye(3), atol=1e-12)


@given(seed=st.integers(0, 10_000))
def test_the_jacobian_agrees_with_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, C, arm = Rotation.random(rng=rng).as_matrix(), rng.normal(0, 30, 3), rng.normal(0, 0.4, 3)

    def antenna(tangent: FloatArray) -> FloatArray:
        turned = R @ Rotation.from_rotvec(tangent[:3]).as_matrix()
        return np.asarray(C + R @ tangent[3:] - turned @ arm)

    steps = 1e-6 * np.eye(6)
    numerical = np.column_stack([(antenna(s) - antenna(-s)) / 2e-6 for s in steps])
    np.testing.assert_allclose(position_jacobian(R, arm), numerical, atol=1e-8)


def test_a_photograph_says_where_its_centre_was_measured() -> None:
    R = rotation_from_gimbal(90.0, -90.0, 0.0)  # straight down, the picture's top to the east
    photograph = Photograph("a", 0, gnss_world_m=np.zeros(3), gnss_sigma_m=np.ones(3), lever_arm_camera_m=ARM)
    # 30 cm to the rear is 30 cm to the west, 2 cm right 2 cm to the south, 5 cm up 5 cm up
    centre = photograph.measured_centre_world_m(R)
    assert centre is not None
    np.testing.assert_allclose(centre, [-0.3, -0.02, 0.05], atol=1e-12)
    assert Photograph("b", 0).measured_centre_world_m(R) is None


# ---- simulated surveys -----------------------------------------------------------------------------------------------


def of_antennas(made: SimulatedBlock) -> Block:
    photographs = []
    for photograph, pose in zip(made.block.photographs, made.truth.poses, strict=True):
        assert photograph.gnss_world_m is not None
        antenna = photograph.gnss_world_m - pose.rotation_world_from_camera @ ARM
        photographs.append(replace(photograph, gnss_world_m=antenna))
    return replace(made.block, photographs=tuple(photographs))


@pytest.fixture(scope="module")
def made() -> SimulatedBlock:
    """A block whose positions are those of an antenna, ARM away from the camera."""
    made = simulate_block(PLAN, 3, tie_points=1500)
    antennas = tuple(
        replace(
            p, gnss_world_m=None if p.gnss_world_m is None else p.gnss_world_m - pose.rotation_world_from_camera @ ARM
        )
        for p, pose in zip(made.block.photographs, made.truth.poses, strict=True)
    )
    return replace(made, block=replace(made.block, photographs=antennas))


def with_arm(made: SimulatedBlock, arm: FloatArray, engine: str = "fast") -> Adjustment:
    photographs = tuple(replace(p, lever_arm_camera_m=arm) for p in made.block.photographs)
    return adjust(replace(made.block, photographs=photographs), replace(SETTINGS, engine=engine))  # type: ignore[arg-type]


def test_an_arm_ignored_shows_in_the_residuals_and_given_is_gone(made: SimulatedBlock) -> None:
    ignored = gnss_of(adjust(made.block, SETTINGS))
    left = ignored["lever_arm_left"]
    assert left["significant"]
    forward, right, down = left["forward_right_down_m"]
    sigma = left["sigma_m"]
    # strips to and fro tell the plan part from an offset of the flight; the height they do not
    assert forward == pytest.approx(-0.3, abs=4 * sigma[0])
    assert right == pytest.approx(0.02, abs=4 * sigma[1])
    assert max(sigma[:2]) < 0.03
    assert down is None
    assert any("rotate with the camera" in sentence for sentence in ignored["warnings"])

    given = gnss_of(with_arm(made, ARM))
    assert not given["lever_arm_left"]["significant"]
    assert np.abs(given["lever_arm_left"]["forward_right_down_m"][:2]).max() < 4 * max(sigma[:2])
    assert given["warnings"] == []
    # the residuals show a part of it only: the block bends
    before, after = (g["flights"]["1"]["rms_residual_m"] for g in (ignored, given))
    assert before[1] > 5 * PLAN.gnss_sigma_m[1]
    assert max(after[:2]) < 1.5 * PLAN.gnss_sigma_m[0]


def test_the_arm_that_is_left_is_the_one_that_is_missing(made: SimulatedBlock) -> None:
    part = np.array([0.02, 0.1, -0.05])
    left = gnss_of(with_arm(made, part))["lever_arm_left"]
    assert left["forward_right_down_m"][0] == pytest.approx(-0.2, abs=4 * left["sigma_m"][0])


def test_a_free_principal_point_takes_the_arm_and_the_sigma_says_so() -> None:
    """Over level ground an arm in plan is a principal point off by f a / H: neither can then be told."""
    plan = replace(PLAN, calibration_sigmas=(0.0, np.inf, np.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), relief_m=0.0)
    made = simulate_block(plan, 3, tie_points=800)
    result = adjust(of_antennas(made), SETTINGS)
    moved = result.block.cameras[0].principal_point_px - made.truth.camera.principal_point_px
    assert moved[1] == pytest.approx(-plan.focal_px * ARM[1] / plan.flying_height_m, abs=1.0)
    left = gnss_of(result)["lever_arm_left"]
    assert left is None or left["sigma_m"][0] is None or left["sigma_m"][0] > 0.03


def test_an_offset_that_is_estimated_is_not_taken_for_an_arm(made: SimulatedBlock) -> None:
    moved = tuple(
        replace(p, lever_arm_camera_m=ARM, gnss_world_m=None if p.gnss_world_m is None else p.gnss_world_m + 0.2)
        for p in made.block.photographs
    )
    for sigma in (0.0, 0.5):
        block = replace(made.block, photographs=moved, gnss_offset_sigma_m=np.full(3, sigma))
        assert not gnss_of(adjust(block, SETTINGS))["lever_arm_left"]["significant"]


def test_p_is_uniform_without_an_arm_and_without_an_offset() -> None:
    """Twenty-five small surveys without either, and none is counted."""
    plan = replace(PLAN, strips=2, photographs_per_strip=4, control_points=5, check_points=1)
    results = [adjust(simulate_block(plan, seed, tie_points=150).block, SETTINGS) for seed in range(25)]
    assert kstest([result.left_arm_p for result in results], "uniform").pvalue > 0.01
    offsets = [implied_offset_test(r.implied_offset_world_m[0], r.implied_offset_covariance_m2[0]).p for r in results]
    assert kstest(offsets, "uniform").pvalue > 0.01


def test_both_engines_count_the_arm_alike(made: SimulatedBlock) -> None:
    fast, reference = with_arm(made, ARM), with_arm(made, ARM, "reference")
    for a, b in zip(fast.block.poses, reference.block.poses, strict=True):
        assert a is not None
        assert b is not None
        np.testing.assert_allclose(a.position_world_m, b.position_world_m, atol=1e-7)
    np.testing.assert_allclose(fast.reliability.gnss_w, reference.reliability.gnss_w, atol=1e-4)


def test_an_arm_along_the_cameras_axes_equals_the_same_arm_in_the_world(made: SimulatedBlock) -> None:
    """With the adjusted rotations the arm in the world gives the same residuals."""
    given = with_arm(made, ARM)
    moved = []
    for photograph, pose in zip(given.block.photographs, given.block.poses, strict=True):
        assert pose is not None
        centre = photograph.measured_centre_world_m(pose.rotation_world_from_camera)
        moved.append(replace(photograph, gnss_world_m=centre, lever_arm_camera_m=None))
    same = replace(given, block=replace(given.block, photographs=tuple(moved)))
    np.testing.assert_allclose(gnss_residual_m(given), gnss_residual_m(same), atol=1e-9)


def test_w_tests_of_positions_with_an_arm_are_standard(made: SimulatedBlock) -> None:
    w = with_arm(made, ARM).reliability.gnss_w
    assert np.abs(w).max() < 4.0
    assert 0.6 < w.std() < 1.4
