"""Velocities that are estimated with everything else: at the joint minimum, as differences of residuals have it."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.arrays import FloatArray
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem, cost, ground_factors
from photogram.factors.joint_velocities import _determined, _system, joint_velocities, readout_sigmas
from photogram.projection import READOUT
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

PLAN = SurveyPlan(
    width_px=1600, height_px=1200, focal_px=1333.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.7,
    strips=2, photographs_per_strip=4, crossing=True, control_points=0, check_points=0, speed_m_s=8.0,
    gnss_offset_sigma_m=(0.0, 0.0, 0.0), radial=(0.0, 0.0, 0.0, 0.0), tangential=(0.0, 0.0),
    calibration_sigmas=(40.0, 16.0, 16.0, 0.1, 0.1, 0.05, 0.0, 0.003, 0.003, 0.0, 0.0), readout_s=0.033,
)  # fmt: skip
SETTINGS = AdjustmentSettings(robust_loss="none")
SIGMA_M_S = 0.3


def solved(readout_s: float = 0.033, sigma_s: float = 0.01) -> tuple[Problem, State, FloatArray]:
    """Return a problem, its minimum with velocities that are wrong by 0.3 m/s, and these."""
    made = simulate_block(PLAN, 1, tie_points=150, sigma_px=0.4)
    sigmas = made.block.cameras[0].sigmas.copy()
    sigmas[READOUT] = sigma_s
    camera = replace(made.block.cameras[0], readout_s=readout_s, sigmas=sigmas)
    problem = make_problem(replace(made.block, cameras=(camera,), poses=made.truth.poses), SETTINGS)
    start = start_state(problem)
    true = np.array([pose.velocity_world_m_s for pose in made.truth.poses])
    told = true + SIGMA_M_S * np.random.default_rng(1).standard_normal(true.shape)
    start = replace(start, cameras=start.cameras._replace(velocity=told))
    return problem, minimise(problem, start, SETTINGS).state, told


def joint_cost(problem: Problem, state: State, told: FloatArray) -> float:
    """Return the cost with the prior of the velocities."""
    tie = residuals(problem.tie, state.cameras, state.tie_point)
    observed = cost(problem, ground_factors(problem), state)
    assert observed > 0.5 * float(np.sum(tie**2)) * 0.99
    return observed + 0.5 * float(np.sum((state.velocity - told) ** 2)) / SIGMA_M_S**2


def with_velocity(state: State, velocity: FloatArray) -> State:
    return replace(state, cameras=state.cameras._replace(velocity=velocity))


def test_one_step_reaches_the_joint_minimum() -> None:
    """There the cost, everything else adjusted, has no slope along the velocity of any photograph."""
    problem, state, told = solved()
    own = np.zeros((len(told), 3, 3))  # a preconditioner decides nothing; no component counts as told by the images
    free = np.ones(len(told), dtype=bool)
    costs = [joint_cost(problem, state, told)]
    for _ in range(2):
        found, readout_s = joint_velocities(problem, state, told, free, SIGMA_M_S, own)
        state = minimise(problem, with_velocity(state, found), SETTINGS).state
        np.testing.assert_allclose(readout_s, state.parameters[:, READOUT], rtol=2e-3)
        costs.append(joint_cost(problem, state, told))
    assert costs[1] < costs[0] - 2.0, "in units of log likelihood"
    assert costs[1] - costs[2] < 1e-2 * (costs[0] - costs[1]), "the first step does nearly all"
    for photograph, axis in ((0, 0), (3, 1), (6, 2)):
        step = np.zeros_like(told)
        step[photograph, axis] = 0.1
        beside = [
            joint_cost(
                problem, minimise(problem, with_velocity(state, state.velocity + way * step), SETTINGS).state, told
            )
            for way in (-1.0, 1.0)
        ]
        assert min(beside) > costs[2]
        assert abs(beside[1] - beside[0]) < 0.02 * (sum(beside) - 2.0 * costs[2]), "half of it: the step to the minimum"


def with_readout_held(readout_s: float) -> float:
    """Return the least joint cost at a read-out time."""
    problem, state, told = solved(readout_s, 0.0)
    for _ in range(3):
        found, _ = joint_velocities(
            problem, state, told, np.ones(len(told), dtype=bool), SIGMA_M_S, np.zeros((len(told), 3, 3))
        )
        state = minimise(problem, with_velocity(state, found), SETTINGS).state
    return joint_cost(problem, state, told)


def test_the_read_out_time_is_that_of_the_marginal_likelihood() -> None:
    """There the joint cost falls by ν / T, ν components of velocities told by the images, and its curvature is that of
    the standard deviation and ν / T²."""
    problem, state, told = solved()
    free, own = np.ones(len(told), dtype=bool), np.tile(np.diag([400.0, 400.0, 0.0]), (len(told), 1, 1))
    for _ in range(3):
        found, (readout_s,) = joint_velocities(problem, state, told, free, SIGMA_M_S, own)
        state = minimise(problem, with_velocity(state, found), SETTINGS).state
    (sigma_s,) = readout_sigmas(problem, state, free, SIGMA_M_S, own)
    step = 2e-3
    at = readout_s + step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    costs = np.array([with_readout_held(float(time_s)) for time_s in at]) + 0.5 * ((at - 0.033) / 0.01) ** 2
    slope = float(np.array([1.0, -8.0, 0.0, 8.0, -1.0]) @ costs) / (12.0 * step)
    determined = 2 * len(told) * 400.0 / (400.0 + SIGMA_M_S**-2)
    assert slope * readout_s == pytest.approx(-determined, rel=0.05)
    curvature = (costs[1] - 2.0 * costs[2] + costs[3]) / step**2
    assert sigma_s == pytest.approx((curvature - determined / readout_s**2) ** -0.5, rel=0.02)


def test_a_known_read_out_time_stays_and_an_unknown_one_is_looked_for_from_the_least_on() -> None:
    for sigma_s, factor in ((0.0, 1.0), (0.01, 2.0)):
        problem, state, told = solved(0.01, sigma_s)
        before = state.parameters[:, READOUT]
        free, own = np.ones(len(told), dtype=bool), np.zeros((len(told), 3, 3))
        _, after = joint_velocities(problem, state, told, free, SIGMA_M_S, own, least_s=0.08)
        if sigma_s == 0.0:
            np.testing.assert_array_equal(after, before)
        else:
            assert before[0] < 0.034
            np.testing.assert_allclose(after, 0.08 / factor)  # the truth is 33 ms: half of where it began


def test_the_normal_matrix_is_symmetric_and_smaller_than_with_all_else_at_rest() -> None:
    problem, state, told = solved()
    system, n = _system(problem, state), 3 * len(told)
    N = np.column_stack([system.product(unit.reshape(-1, 3)).ravel() for unit in np.eye(n)])
    np.testing.assert_allclose(N, N.T, atol=1e-7 * np.abs(N).max())
    at_rest = np.zeros((n, n))
    for p in range(len(told)):
        own = system.of_photograph == p
        J = (system.way[own, None, None] * system.point[own]).reshape(-1, 3)
        at_rest[3 * p : 3 * p + 3, 3 * p : 3 * p + 3] = J.T @ J
    values = np.linalg.eigvalsh(N)
    assert values.min() > -1e-7 * values.max()
    assert np.linalg.eigvalsh(at_rest - N).min() > -1e-7 * values.max()
    assert np.trace(N) < 0.9 * np.trace(at_rest)


def test_those_that_are_not_free_are_as_told() -> None:
    problem, state, told = solved()
    free = np.arange(len(told)) < 5
    found, _ = joint_velocities(problem, state, told, free, SIGMA_M_S, np.tile(np.eye(3), (5, 1, 1)))
    np.testing.assert_array_equal(found[5:], told[5:])
    assert (found[:5] != told[:5]).all()


def test_a_photograph_tells_as_many_components_of_its_velocity_as_its_prior_does_not() -> None:
    own = np.array([np.diag([400.0, 25.0, 0.0]), 1e9 * np.eye(3), np.zeros((3, 3))])
    np.testing.assert_allclose(_determined(own, 0.2), [400 / 425 + 25 / 50, 3.0, 0.0], rtol=1e-6)
