"""Exposures of cameras on one body: Jacobians, both engines, covariances against GTSAM, and what is not determined."""

from dataclasses import replace
from typing import Literal

import gtsam
import numpy as np
import pytest
from lib.simulated.two_cameras import TRUE, TwoCameras, simulate_two_cameras
from makers import LEAST_SQUARES
from referees import whole_covariance
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.arrays import FloatArray
from photogram.constraints.rigs import Companion, RelativePose, give_scale, middle_of
from photogram.errors import AdjustmentError
from photogram.factors.covariance import covariances
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem, cost, ground_factors
from photogram.factors.linearised.rotations import inverse_right_jacobian, right_jacobian
from photogram.factors.reference.native import in_gtsam
from photogram.factors.rigs.exposures import (
    TakingPart,
    exposure_factors,
    linearised,
    misfits,
    taking_part,
)
from photogram.factors.variables import POSE, RIG, key
from photogram.geodesy.frames import LocalFrame
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2)
GIVEN = np.array([1e-3] * 3 + [0.005] * 3)


@pytest.fixture(scope="module")
def made() -> TwoCameras:
    return simulate_two_cameras(PLAN, 1, tie_points=120)


def solved(made: TwoCameras, engine: Literal["fast", "reference"] = "fast") -> tuple[Problem, State]:
    settings = AdjustmentSettings(robust_loss="none", engine=engine)
    problem = make_problem(made.block, settings)
    return problem, minimise(problem, start_state(problem), settings).state


def exposure(size: float, seed: int) -> tuple[TakingPart, FloatArray, FloatArray, FloatArray]:
    """Return one exposure that is off by ``size`` rad and m, rotations (2, 3, 3), positions (2, 3) and value (1, 6)."""
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    value, off = size * rng.normal(size=(2, 6))
    pose = TRUE.moved(value).moved(off)
    second = pose.companions(R[None], rng.normal(size=(1, 3)))
    rotation, position = np.stack([R, second[0][0]]), np.stack([np.zeros(3), second[1][0]])
    number = np.zeros(1, dtype=np.int64)
    alone = TakingPart(
        number, number, number + 1, number, np.ones((1, 6)),
        TRUE.rotation_master_from_companion[None], TRUE.offset_m[None],
    )  # fmt: skip
    return alone, rotation, position, value[None]


@pytest.mark.parametrize("size", [1e-7, 1e-4, 0.05, 0.6])
def test_jacobians_are_those_of_small_changes(size: float) -> None:
    one, R, X, value = exposure(size, 3)
    analytic, step = linearised(one, R, X, value).jacobian[0], 1e-6

    def moved(tangent: FloatArray) -> FloatArray:
        turned = R @ Rotation.from_rotvec(tangent[:12].reshape(2, 6)[:, :3]).as_matrix()
        shifted = X + np.einsum("nij,nj->ni", R, tangent[:12].reshape(2, 6)[:, 3:])
        return np.asarray(misfits(one, turned, shifted, value + tangent[12:])[0])

    numerical = np.column_stack([(moved(step * e) - moved(-step * e)) / (2.0 * step) for e in np.eye(18)])
    np.testing.assert_allclose(analytic, numerical, rtol=0, atol=3e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-5, 9.9e-5, 1.01e-4, 0.3, 3.0])
def test_jacobians_of_rotations_are_gtsams(angle: float) -> None:
    vector = angle * np.array([0.6, -0.64, 0.48])
    expected = gtsam.Rot3.ExpmapDerivative(vector)
    np.testing.assert_allclose(right_jacobian(vector[None])[0], expected, atol=1e-8 if angle < 1e-3 else 1e-12)
    product = right_jacobian(vector[None])[0] @ inverse_right_jacobian(vector[None])[0]
    np.testing.assert_allclose(product, np.eye(3), atol=1e-12)


def test_a_misfit_is_that_of_gtsams_factor_between_poses(made: TwoCameras) -> None:
    """GTSAM's residual is in the frame of the relative pose, (Log, Mᵀ d) to first order: the same length where offset
    and rotation weigh alike along all axes."""
    block = made.block
    rig = replace(block.rigs[0], given=TRUE, exposure_sigma=np.tile([1e-3] * 3 + [0.01] * 3, (6, 1)))
    given = gtsam.Pose3(gtsam.Rot3(TRUE.rotation_master_from_companion), TRUE.offset_m)
    noise = gtsam.noiseModel.Diagonal.Sigmas(rig.exposure_sigma[0])
    values = gtsam.Values()
    for i, pose in enumerate(made.poses):
        values.insert(key(POSE, i), gtsam.Pose3(gtsam.Rot3(pose.rotation_world_from_camera), pose.position_world_m))
    values.insert(key(RIG, 0), np.zeros(6))
    (exposures,) = exposure_factors(replace(block, rigs=(rig,)))
    assert len(exposures) == 6
    for n, factor in enumerate(in_gtsam(exposures)):
        between = gtsam.BetweenFactorPose3(key(POSE, n), key(POSE, n + 6), given, noise)
        assert factor.error(values) == pytest.approx(between.error(values), rel=1e-3)


def test_both_engines_reach_the_same_free_relative_pose(made: TwoCameras) -> None:
    (problem, fast), (_, referee) = solved(made), solved(made, "reference")
    np.testing.assert_allclose(fast.position, referee.position, atol=1e-7)
    np.testing.assert_allclose(fast.common, referee.common, atol=1e-8)
    assert len(fast.common) == 6 + sum(len(e.sigma) for e in problem.block.common_errors)
    factors = ground_factors(problem)
    assert cost(problem, factors, fast) == pytest.approx(cost(problem, factors, referee), rel=1e-9)


def test_covariances_are_those_of_the_whole_graph(made: TwoCameras) -> None:
    problem, state = solved(made)
    found = covariances(problem, state)
    whole, place = whole_covariance(problem, state)
    np.testing.assert_allclose(found.rig(0), whole[place[key(RIG, 0)], place[key(RIG, 0)]], rtol=1e-5, atol=1e-14)
    own = place[key(POSE, 7)]
    np.testing.assert_allclose(found.pose(7), whole[own, own], rtol=1e-5, atol=1e-13)


def test_given_and_free_relative_poses_differ_by_what_is_given() -> None:
    free, given = (
        adjust(simulate_two_cameras(PLAN, 2, tie_points=120, given_sigma=s).block, LEAST_SQUARES) for s in (None, GIVEN)
    )
    sigma = [np.sqrt(np.diag(r.tests.exposures.relative_covariance[0])) for r in (free, given)]
    assert np.all(sigma[1] < sigma[0])
    assert np.all(sigma[1] < GIVEN)


def test_a_relative_pose_that_nothing_determines_is_named() -> None:
    """Without tie points in the companion's photographs, nothing but a given relative pose says where it is."""
    made = simulate_two_cameras(PLAN, 3, tie_points=120)
    of_master = made.block.tie_points.photograph < 6
    ties = made.block.tie_points
    ties = ties.select(np.bincount(ties.point[of_master], minlength=len(ties)) >= 2, of_master)
    bare = replace(
        made.block, tie_points=ties, cameras=tuple(replace(c, sigmas=np.zeros(12)) for c in made.block.cameras)
    )
    with pytest.raises(AdjustmentError, match=r"relative pose of camera companion: .* give its relative pose"):
        adjust(bare, LEAST_SQUARES)
    rig = replace(bare.rigs[0], given=TRUE, sigma=GIVEN)
    held = adjust(replace(bare, rigs=(rig,)), LEAST_SQUARES)
    pose, master = held.block.poses[6], held.block.poses[0]
    assert pose is not None
    assert master is not None
    assert held.tests.exposures.redundancy[0] == pytest.approx(np.zeros(6), abs=1e-6)
    expected = TRUE.companions(master.rotation_world_from_camera[None], master.position_world_m[None])
    np.testing.assert_allclose(pose.position_world_m, expected[1][0], atol=1e-6)


def test_a_rejected_exposure_and_one_of_an_unknown_photograph_take_no_part(made: TwoCameras) -> None:
    rig = made.block.rigs[0]
    sigma = rig.exposure_sigma.copy()
    sigma[2] = np.inf
    lost = replace(rig, exposures=(*rig.exposures[:5], ("sim_0006_B.JPG", "nowhere.JPG")), exposure_sigma=sigma)
    every = taking_part(replace(made.block, rigs=(lost,)))
    assert every.number.tolist() == [0, 1, 3, 4]
    assert every.companion.tolist() == [6, 7, 9, 10]


def test_a_free_start_is_not_moved_by_gross_exposures() -> None:
    rng = np.random.default_rng(5)
    turns = Rotation.from_matrix(TRUE.rotation_master_from_companion) * Rotation.from_rotvec(
        1e-4 * rng.standard_normal((21, 3))
    )
    rotation, offset_m = turns.as_matrix(), TRUE.offset_m + 1e-3 * rng.standard_normal((21, 3))
    rotation[:8], offset_m[:8] = np.eye(3), 30.0
    found = middle_of(rotation, offset_m)
    off = TRUE.misfits(found.rotation_master_from_companion[None], found.offset_m[None])[0]
    assert np.all(np.abs(off) < [1e-3] * 3 + [3e-3] * 3)


def test_a_given_baseline_gives_a_scale() -> None:
    rig = Companion("b", "a", RelativePose(np.array([0.1, 0.0, 0.0]), np.eye(3)), np.full(6, 1e-3), (("2", "1"),),
                    np.ones((1, 6)))  # fmt: skip
    assert give_scale((rig,))
    assert not give_scale((replace(rig, sigma=np.full(6, np.inf)),))
    assert not give_scale((replace(rig, exposure_sigma=np.full((1, 6), np.inf)),))
    assert not give_scale((replace(rig, given=None),))


def test_a_free_network_has_the_scale_of_its_baseline() -> None:
    """Nothing but the 8 m between both cameras says how long a metre is; the block starts a tenth too small."""
    apart = RelativePose(np.array([8.0, 0.0, 0.0]), TRUE.rotation_master_from_companion)
    known = replace(PLAN, calibration_sigmas=(0.0,) * 11)
    made = simulate_two_cameras(known, 4, tie_points=150, relative=apart, given_sigma=np.array([1e-3] * 3 + [2e-3] * 3))
    block, ties = made.block, made.block.tie_points
    bare = tuple(
        replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for p in block.photographs
    )
    free = replace(
        block,
        frame=LocalFrame.local(),
        photographs=bare,
        poses=tuple(p and replace(p, position_world_m=0.9 * p.position_world_m) for p in block.poses),
        tie_points=replace(ties, position_world_m=0.9 * ties.position_world_m),
        control_points=block.control_points.select(np.zeros(len(block.control_points), dtype=bool)),
        gnss_offset_sigma_m=np.zeros(3),
    )
    assert free.has_scale
    centres = np.array([p.position_world_m for p in adjust(free, LEAST_SQUARES).block.poses if p is not None])
    true = np.array([p.position_world_m for p in made.poses])
    assert np.linalg.norm(centres[5] - centres[0]) == pytest.approx(np.linalg.norm(true[5] - true[0]), rel=0.02)
