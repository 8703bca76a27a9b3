"""Common errors: lever arms from the antenna to the camera (the factor, the turn from the aircraft to the world, what
residuals show when an arm is ignored), time offsets, drifts, and compasses. Surveys are simulated."""

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from referees import native
from scipy.spatial.transform import Rotation
from scipy.stats import kstest
from seeds import seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.common_errors import Score, _Candidate, _chosen, with_attitude_errors
from photogram.adjustment.gnss_offsets import implied_offset_test, measured_positions
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.factors.covariance import covariances
from photogram.factors.priors import gnss_position, position_jacobian
from photogram.factors.variables import GNSS_OFFSET, POSE, key
from photogram.report.numbers.gnss import gnss_numbers
from photogram.report.numbers.numbers import gnss_residual_m
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block, CommonError, CommonErrorKind, Photograph

ARM = np.array([0.02, 0.3, -0.05])  # camera axes: 2 cm right, 30 cm to the rear, 5 cm up
SETTINGS = AdjustmentSettings(robust_loss="none", common_errors="none")
AUTO = replace(SETTINGS, common_errors="auto")
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
        factor = native(gnss_position(2, measured, sigma, flight, None, arm))
        error = (C - R @ arm - o - measured) / sigma
        assert factor.error(values) == pytest.approx(0.5 * error @ error)
        jacobian, right = factor.linearize(values).jacobian()
        np.testing.assert_allclose(right, -error, rtol=1e-12)
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


def test_an_arm_ignored_is_estimated_and_removed(made: SimulatedBlock) -> None:
    found = adjust(made.block, AUTO)
    attitude, arm = found.decisions.common_errors
    assert (attitude.error.kind, attitude.significant) == ("attitude", False)
    assert (arm.error.kind, arm.significant, arm.photographs) == ("lever_arm", True, len(made.block.photographs))
    sigma = np.sqrt(np.diag(arm.covariance))
    assert np.isnan(arm.estimate[2])  # the height of it is that of the flight
    assert np.all(np.abs(arm.estimate - ARM)[:2] < 4 * sigma[:2])
    assert sigma[:2].max() < 0.03
    report = gnss_of(found)
    assert report["lever_arm_left"] is None
    assert report["warnings"] == []
    left = replace(
        found.tests,
        residual_lever_arm_m=np.array([0.1, 0.2, np.nan]),
        residual_lever_arm_sigma_m=np.array([0.01, 0.01, np.nan]),
        residual_lever_arm_p=1e-9,
    )
    beside = gnss_of(replace(found, tests=left))["warnings"]
    assert len(beside) == 1
    assert beside[0].startswith("Beside the lever arm that is estimated and removed")
    assert "not applied" not in beside[0]
    common = report["common_errors"][1]
    assert common["estimate"][2] is None
    assert "m forward, +0.0" in common["sentence"]
    assert ": estimated and removed" in common["sentence"]
    assert common["significant"]
    # as accurate as with the arm given, and residuals as stated
    given = with_arm(made, ARM)
    np.testing.assert_allclose(np.std(gnss_residual_m(found), axis=0), np.std(gnss_residual_m(given), axis=0), rtol=0.2)
    # as many unknowns more as priors more
    both = [r.redundancy - 2 * len(r.estimates.residual_px) + 3 * len(r.block.tie_points) for r in (found, given)]
    assert both[0] == both[1]


def test_redundancies_and_squares_of_all_groups_are_those_of_the_whole(made: SimulatedBlock) -> None:
    for settings in (AUTO, replace(AUTO, engine="reference", maximum_rounds=2)):
        found = adjust(made.block, settings)
        c = found.tests.components
        assert "common_errors" in c.group
        assert c.squares.sum() == pytest.approx(found.sigma0**2 * found.redundancy, rel=1e-6)
        assert 0.0 < c.redundancy[c.group.tolist().index("common_errors")] < 6.0


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
    """Small surveys without either, and none is counted."""
    plan = replace(PLAN, strips=2, photographs_per_strip=4, control_points=5, check_points=1)
    results = [adjust(simulate_block(plan, seed, tie_points=150).block, SETTINGS) for seed in seeds(25)]
    assert kstest([result.tests.residual_lever_arm_p for result in results], "uniform").pvalue > 0.01
    offsets = [
        implied_offset_test(r.tests.implied_offset_world_m[0], r.tests.implied_offset_covariance_m2[0]).p
        for r in results
    ]
    assert kstest(offsets, "uniform").pvalue > 0.01


def test_both_engines_count_the_arm_alike(made: SimulatedBlock) -> None:
    fast, reference = with_arm(made, ARM), with_arm(made, ARM, "reference")
    for a, b in zip(fast.block.poses, reference.block.poses, strict=True):
        assert a is not None
        assert b is not None
        np.testing.assert_allclose(a.position_world_m, b.position_world_m, atol=1e-7)
    np.testing.assert_allclose(fast.tests.reliability.gnss_w, reference.tests.reliability.gnss_w, atol=1e-4)


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
    w = with_arm(made, ARM).tests.reliability.gnss_w
    assert np.abs(w).max() < 4.0
    assert 0.6 < w.std() < 1.4


# ---- what else positions and attitudes have in common ----------------------------------------------------------------

FLOWN = SurveyPlan(
    focal_px=1200.0, strips=6, photographs_per_strip=5, control_points=0, check_points=4, forward_overlap=0.75,
    gnss_sigma_m=(0.02, 0.02, 0.03), gnss_offset_sigma_m=(0.02, 0.02, 0.03), attitude_sigma_deg=2.0, crossing=True,
    speed_m_s=8.0, calibration_sigmas=(0.0,) * 11,
)  # fmt: skip


def kinds(found: Adjustment) -> list[str]:
    return [e.error.kind for e in found.decisions.common_errors]


def block_of(seed: int = 1, **changes: Any) -> SimulatedBlock:
    return simulate_block(replace(FLOWN, **changes), seed, tie_points=400)


def turn_deg(found: Adjustment, made: SimulatedBlock) -> float:
    pairs = zip(found.block.poses, made.truth.poses, strict=True)
    turns = [p.rotation_world_from_camera @ t.rotation_world_from_camera.T for p, t in pairs if p is not None]
    return float(np.degrees(Rotation.from_matrix(turns).as_rotvec()[:, 2].mean()))


def test_a_time_offset_is_one_where_the_heading_does_not_follow_the_flight() -> None:
    made = block_of(turns=False, time_offset_s=0.02)
    found = adjust(made.block, AUTO)
    assert kinds(found) == ["attitude", "time_offset"]
    delay = found.decisions.common_errors[1]
    sigma_s = float(np.sqrt(delay.covariance[0, 0]))
    assert sigma_s < 0.002
    assert abs(delay.estimate[0] - 0.02) < 4 * sigma_s
    assert delay.as_well == ""
    sentence = gnss_of(found)["common_errors"][1]["sentence"]
    assert sentence.startswith("The photographs are exposed ")
    assert " ms after the epochs of their GNSS positions (p < 0.001): estimated" in sentence


def test_an_arm_along_the_flight_and_a_time_offset_are_one_at_one_speed_and_the_report_says_so() -> None:
    found = adjust(block_of(time_offset_s=0.02).block, AUTO)
    assert kinds(found) == ["attitude", "lever_arm"]  # 16 cm fit a drone
    arm = found.decisions.common_errors[1]
    assert arm.estimate[1] == pytest.approx(-0.16, abs=0.04)
    assert "a time offset of +" in arm.as_well
    assert "held together as one" in gnss_of(found)["common_errors"][1]["sentence"]


def test_a_drift_is_found() -> None:
    found = adjust(block_of(drift_m=(0.0, 0.3, 0.0)).block, AUTO)
    assert "drift" in kinds(found)
    drift = found.decisions.common_errors[kinds(found).index("drift")]
    assert (drift.error.flight, drift.error.camera) == ("1", None)
    off = drift.estimate - np.array([0.0, 0.3, 0.0])
    assert np.all(np.abs(off) < 4 * np.sqrt(np.diag(drift.covariance)))
    assert "drift by" in gnss_of(found)["common_errors"][-1]["sentence"]


@pytest.mark.parametrize("oblique_deg", [0.0, 25.0])
def test_a_compass_does_not_turn_the_block(oblique_deg: float) -> None:
    oblique: dict[str, Any] = {"oblique_strip": True, "oblique_angle_deg": oblique_deg} if oblique_deg else {}
    made = block_of(heading_error_deg=6.0, gnss_sigma_m=(0.5, 0.5, 1.0), crossing=False, **oblique)
    found, before = adjust(made.block, AUTO), adjust(made.block, SETTINGS)
    assert kinds(found)[0] == "attitude"
    assert abs(turn_deg(before, made)) > 0.5
    assert abs(turn_deg(found, made)) < 0.3
    error = found.decisions.common_errors[0]
    assert error.significant
    # 6° clockwise seen from above are 6° about the axis of a camera that looks down
    assert np.degrees(error.estimate[2]) == pytest.approx(6.0, abs=1.0)
    assert "compass or boresight; it is estimated and removed" in gnss_of(found)["common_errors"][0]["sentence"]
    # attitudes are no longer contradicted
    left = found.tests.reliability.attitude_left_out_rad
    sigma = np.sqrt(np.einsum("nii->ni", found.tests.reliability.attitude_left_out_covariance_rad2))
    assert 0.7 < np.std(left / sigma) < 1.3
    assert np.abs(np.mean(left / sigma, axis=0)).max() < 0.6


def test_a_boresight_is_found_about_its_axes() -> None:
    found = adjust(block_of(boresight_deg=(1.5, -1.0, 0.0)).block, AUTO)
    error = found.decisions.common_errors[0]
    off = np.degrees(error.estimate) - np.array([1.5, -1.0, 0.0])
    assert np.all(np.abs(off) < 4 * np.degrees(np.sqrt(np.diag(error.covariance))))
    assert error.significant


def test_positions_whose_time_is_not_known_have_no_time_offset_and_no_drift() -> None:
    made = block_of(turns=False, time_offset_s=0.05)
    timeless = tuple(replace(p, time=None) for p in made.block.photographs)
    found = adjust(replace(made.block, photographs=timeless), AUTO)
    assert not {"time_offset", "drift"} & set(kinds(found))


def test_a_gross_position_passes_for_nothing_common() -> None:
    made = block_of(seed=3)
    photographs = list(made.block.photographs)
    for i in (4, 17):
        wrong = photographs[i].gnss_world_m
        assert wrong is not None
        photographs[i] = replace(photographs[i], gnss_world_m=wrong + np.array([3.0, -2.0, 1.0]))
    found = adjust(replace(made.block, photographs=tuple(photographs)), AUTO)
    assert kinds(found) == ["attitude"]


def test_positions_that_scatter_more_than_stated_pass_for_nothing_common() -> None:
    """Eight surveys whose positions are three times worse than stated: a plain test would find an error in most."""
    for seed in range(8):
        made = block_of(seed=seed, gnss_sigma_m=(0.06, 0.06, 0.09))
        stated = tuple(replace(p, gnss_sigma_m=np.array([0.02, 0.02, 0.03])) for p in made.block.photographs)
        assert kinds(adjust(replace(made.block, photographs=stated), AUTO)) == ["attitude"], seed


def test_few_attitudes_and_settings_without_have_none() -> None:
    made = block_of()
    assert adjust(made.block, SETTINGS).decisions.common_errors == ()
    few = tuple(
        p if i < 2 else replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for i, p in enumerate(made.block.photographs)
    )
    assert with_attitude_errors(replace(made.block, photographs=few)).common_errors == ()
    three = with_attitude_errors(made.block)
    assert [len(e.sigma) for e in three.common_errors] == [4]
    assert with_attitude_errors(three) is three
    headless = tuple(replace(p, heading_known=False) for p in made.block.photographs)
    assert [len(e.sigma) for e in with_attitude_errors(replace(made.block, photographs=headless)).common_errors] == [3]


def candidate(kind: CommonErrorKind, statistic: float, size: float) -> _Candidate:
    k = 2 if kind == "lever_arm" else 1
    basis = np.eye(3)[:, :2] if kind == "lever_arm" else np.eye(1)
    value = np.concatenate([[size], np.zeros(k - 1)])
    told = Score(basis, value, np.full(k, 1e-4), statistic)
    return _Candidate(CommonError(kind, None, 0, np.ones(k), np.zeros(k), basis), told, statistic)


@pytest.mark.parametrize(
    ("arm", "delay", "arm_m", "taken", "said"),
    [
        (102.0, 100.0, 0.1, "lever_arm", True),  # alike: a drone may have such an arm
        (102.0, 100.0, 2.0, "time_offset", True),  # alike: no drone has
        (100.0, 150.0, 0.1, "time_offset", False),
        (1000.0, 980.0, 2.0, "lever_arm", True),  # better, and the other nearly as well
        (150.0, 100.0, 2.0, "lever_arm", False),
    ],
)
def test_of_two_that_explain_the_positions_alike_the_likelier_is_taken(
    arm: float, delay: float, arm_m: float, taken: str, said: bool
) -> None:
    new, rival = _chosen([candidate("lever_arm", arm, arm_m), candidate("time_offset", delay, 0.02)])
    assert new.error.kind == taken
    assert (rival is not None) == said
    if rival is not None:
        assert ("time offset of +20 ms" if taken == "lever_arm" else "an arm of 2.000 m") in rival.words


def test_a_common_arm_is_added_to_the_one_that_is_counted() -> None:
    arm, more = np.array([0.10, 0.20, -0.30]), np.array([0.05, -0.02, 0.03])
    block = block_of().block
    photographs = tuple(replace(p, lever_arm_camera_m=arm) for p in block.photographs)
    error = CommonError("lever_arm", None, 0, np.full(3, 0.1), np.zeros(3), np.eye(3))
    problem = make_problem(replace(block, photographs=photographs, common_errors=(error,)), SETTINGS)
    state = replace(start_state(problem), common=more, offset=np.zeros((len(problem.flights), 3)))
    positions = list(measured_positions(problem, state, covariances(problem, state).layout))
    assert len(positions) == len(photographs)
    for position in positions:
        i = position.photograph
        measured = block.photographs[i].gnss_world_m
        assert measured is not None
        expected = state.position[i] - measured - state.rotation[i] @ (arm + more)
        np.testing.assert_allclose(position.misfit, expected, rtol=0, atol=1e-12)
