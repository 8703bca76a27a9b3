"""Joint covariances of all ground points, check points included, and the own part of those of tie points."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from photogram.adjustment.ground_points import ground_points
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.factors import joint_covariance
from photogram.factors.covariance import covariances
from photogram.factors.elimination.reprojection import Observations, linearise
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.joint_covariance import joint_ground_covariance, ray_covariances
from photogram.factors.reference.graph import Step, ground_graph, linearise_all, retract, variable_size
from photogram.factors.variables import CONTROL_POINT, key
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=5, check_points=3, flights=2,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, 0.0, 0.0, 0.0),
    mark_sigma_px=0.002, gnss_sigma_m=(0.002, 0.002, 0.004), control_sigma_m=(0.001, 0.001, 0.001),
)  # fmt: skip


def _true(made: SimulatedBlock) -> Camera:
    """The true camera with the sigmas that are stated: residuals are so small that everything is linear."""
    return replace(made.truth.camera, sigmas=made.block.cameras[0].sigmas)


def small(seed: int = 1, mismatches: float = 0.0, loss: str = "none") -> tuple[Problem, State]:
    made = simulate_block(
        PLAN, seed, tie_points=40, mismatches=mismatches, start_position_sigma_m=1e-5,
        start_attitude_sigma_deg=1e-5, start_point_sigma_m=0.02,
    )  # fmt: skip
    made = replace(made, block=replace(made.block, cameras=(_true(made),)))
    problem = make_problem(made.block, AdjustmentSettings(robust_loss=loss))  # type: ignore[arg-type]
    return problem, start_state(problem)


def by_differences(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """The joint covariance of all ground points, from GTSAM's information of the whole graph and the derivatives of
    the positions by every unknown, taken as differences; and the positions."""
    found = covariances(problem, state)
    system = linearise_all(problem, ground_graph(problem), state, 1.0)
    ordering, start, sizes = gtsam.Ordering(), 0, {}
    for variable in system.variables:
        ordering.push_back(variable)
        sizes[variable] = slice(start, start + variable_size(problem, variable))
        start = sizes[variable].stop
    information = system.graph.hessian(ordering)[0]
    scale = np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    ground = ground_points(problem, state, found)[0]
    checks = [g for g, role in enumerate(problem.block.control_points.role) if role == "check"]
    D = np.zeros((3 * len(ground), start))
    for g in range(len(state.control)):
        D[3 * g : 3 * g + 3, sizes[key(CONTROL_POINT, g)]] = np.eye(3)
    cameras = [v for v in system.variables if sizes[v].start >= sizes[key(CONTROL_POINT, 0)].start]
    for variable in cameras:
        for column in range(sizes[variable].start, sizes[variable].stop):
            moved = []
            for sign in (-1.0, 1.0):
                values = gtsam.VectorValues()
                for v in system.variables:
                    values.insert(v, np.zeros(sizes[v].stop - sizes[v].start))
                step = np.zeros(sizes[variable].stop - sizes[variable].start)
                step[column - sizes[variable].start] = sign * 1e-3
                values.update(_single(variable, step))
                moved.append(ground_points(problem, retract(problem, state, Step(values, 0.0)), found)[0])
            for g in checks:
                D[3 * g : 3 * g + 3, column] = (moved[1][g] - moved[0][g]) / 2e-3
    joint = D @ covariance @ D.T
    points = problem.block.control_points
    for g in checks:
        mine = points.mark_point == g
        marks = Observations(
            points.mark_photograph[mine], np.zeros(mine.sum(), np.int64), points.mark_pixel[mine],
            points.mark_sigma_px[mine],
        )  # fmt: skip
        J = linearise(marks, state.cameras, ground[g][None]).point.reshape(-1, 3)
        joint[3 * g : 3 * g + 3, 3 * g : 3 * g + 3] += np.linalg.inv(J.T @ J)
    return joint, ground


def _single(variable: int, step: FloatArray) -> gtsam.VectorValues:
    values = gtsam.VectorValues()
    values.insert(variable, step)
    return values


def test_all_ground_points_have_the_joint_covariance_of_their_definition() -> None:
    problem, state = small()
    expected, ground = by_differences(problem, state)
    found = covariances(problem, state)
    joint = joint_ground_covariance(problem, state, found, ground)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(joint / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=1e-3)
    blocks = joint.reshape(8, 3, 8, 3)[np.arange(8), :, np.arange(8)]
    np.testing.assert_allclose(blocks, ground_points(problem, state, found)[1], rtol=1e-6, atol=1e-12)
    shared = joint[15:18, 18:21] / np.outer(sigma[15:18], sigma[18:21])
    assert np.abs(shared).max() > 0.1


def test_a_point_without_a_position_has_no_covariance() -> None:
    problem, state = small()
    found = covariances(problem, state)
    ground = ground_points(problem, state, found)[0]
    whole = joint_ground_covariance(problem, state, found, ground)
    ground[6] = np.nan
    joint = joint_ground_covariance(problem, state, found, ground)
    assert np.isnan(joint[18:21]).all()
    assert np.isnan(joint[:, 18:21]).all()
    rest = np.r_[0:18, 21:24]
    np.testing.assert_allclose(joint[np.ix_(rest, rest)], whole[np.ix_(rest, rest)], rtol=1e-9, atol=1e-15)
    assert np.isnan(joint_ground_covariance(problem, state, found, np.full((8, 3), np.nan))).all()


@pytest.mark.parametrize("loss", ["none", "huber"])
@pytest.mark.parametrize("at_once", [7, 100_000])
def test_the_own_part_of_tie_points_is_theirs_with_the_cameras_held(
    monkeypatch: pytest.MonkeyPatch, loss: str, at_once: int
) -> None:
    problem, state = small(mismatches=0.05, loss=loss)
    monkeypatch.setattr(joint_covariance, "OBSERVATIONS_AT_ONCE", at_once)
    own, whole = ray_covariances(problem, state), covariances(problem, state).tie_point
    o, threshold = problem.tie, problem.robust_threshold
    linear = linearise(o, state.cameras, state.tie_point)
    for p in range(len(state.tie_point)):
        V = np.zeros((3, 3))
        for i in np.flatnonzero(o.point == p):
            norm = np.linalg.norm(linear.residual[i])
            weight = min(1.0, threshold / norm) if loss == "huber" else 1.0
            V += weight * linear.point[i].T @ linear.point[i]
        np.testing.assert_allclose(own[p] @ V, np.eye(3), rtol=0, atol=1e-7)
    assert np.linalg.eigvalsh(whole - own).min() > -1e-12
