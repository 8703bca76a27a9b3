"""Velocities that photographs show themselves, against simulated truth."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.adjustment.shutters.own_velocities import _normal_equations, departures, scatter_m_s
from photogram.adjustment.shutters.rolling_shutter import moving, renewed
from photogram.arrays import BoolArray, FloatArray
from photogram.factors.elimination.loss import KINDS
from photogram.factors.elimination.reduced import SingularError
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.projection import READOUT
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

SETTINGS = AdjustmentSettings()
NEIGHBOURS = SurveyPlan(
    width_px=1600, height_px=1200, focal_px=1333.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.7,
    strips=4, photographs_per_strip=5, crossing=True, control_points=6, check_points=8, speed_m_s=8.0,
    gnss_offset_sigma_m=(0.0, 0.0, 0.0), radial=(0.0, 0.0, 0.0, 0.0), tangential=(0.0, 0.0),
    calibration_sigmas=(40.0, 16.0, 16.0, 0.1, 0.1, 0.05, 0.0, 0.003, 0.003, 0.0, 0.0), readout_s=0.033,
    readout_sigma_s=0.05,
)  # fmt: skip


@cache
def adjusted(seed: int) -> tuple[SimulatedBlock, Adjustment]:
    made = simulate_block(NEIGHBOURS, seed, tie_points=600, sigma_px=0.4)
    return made, adjust(made.block, SETTINGS)


def at_the_solution(result: Adjustment) -> tuple[Problem, State]:
    """Return the problem of the tie points that were used, and the solution with the velocities of the neighbours."""
    problem = make_problem(result.block, SETTINGS)
    state = start_state(problem)
    used: BoolArray = np.asarray(np.isfinite(state.tie_point[problem.tie.point]).all(axis=1))
    return problem.with_tie_observations(problem.tie.select(used)), state


def velocities_of(result: Adjustment) -> FloatArray:
    return np.array([pose.velocity_world_m_s for pose in result.block.poses if pose is not None])


def true_velocities(made: SimulatedBlock) -> FloatArray:
    return np.array([pose.velocity_world_m_s for pose in made.truth.poses])


def test_the_scatter_of_departures_is_found_and_none_where_there_is_none() -> None:
    rng = np.random.default_rng(1)
    for true_m_s in (0.0, 0.1, 0.5):
        found = []
        for _ in range(40):
            root = rng.standard_normal((30, 3, 5)) * 10.0
            S = root @ np.swapaxes(root, 1, 2)
            noise = (root @ rng.standard_normal((30, 5, 1)))[..., 0]
            departure = true_m_s * rng.standard_normal((30, 3))
            found.append(scatter_m_s(S, np.einsum("nij,nj->ni", S, departure) + noise))
        if true_m_s == 0.0:
            assert np.count_nonzero(found) <= 2, "one in a hundred is expected"
        else:
            assert abs(np.mean(found) / true_m_s - 1.0) < 0.03


def test_the_normal_equations_are_those_of_differences() -> None:
    made = simulate_block(replace(NEIGHBOURS, strips=2, photographs_per_strip=3), 1, tie_points=80, sigma_px=0.4)
    problem = make_problem(made.block, SETTINGS)
    tie, cameras, X, none = problem.tie, start_state(problem).cameras, made.tie_point_position_world_m, KINDS["none"]
    parameters = cameras.parameters.copy()
    parameters[:, READOUT] = 0.033
    velocity = np.random.default_rng(0).normal(0.0, 5.0, cameras.velocity.shape)
    cameras = cameras._replace(parameters=parameters, velocity=velocity)
    matrix, right = _normal_equations(
        tie.photograph, tie.point, tie.pixel, tie.pixel, tie.sigma_px, cameras, X, none, 1.0
    )

    def departed(t: FloatArray) -> FloatArray:
        """Whitened residuals, all photographs turned and shifted along their own axes, and faster by some metres."""
        R = cameras.rotation
        moved = cameras._replace(
            rotation=np.ascontiguousarray(R @ Rotation.from_rotvec(t[:3]).as_matrix()),
            position=cameras.position + R @ t[3:6],
            velocity=cameras.velocity + t[6:],
        )
        return residuals(tie, moved, X)

    steps = np.diag([1e-5] * 3 + [1e-3] * 3 + [1e-2] * 3)
    J = np.stack([(departed(t) - departed(-t)) / (2 * t.max()) for t in steps], axis=2)
    at = departed(np.zeros(9))
    for p in (0, 4):
        own = tie.photograph == p
        expected = np.einsum("nki,nkj->ij", J[own], J[own])
        size = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(matrix[p] / np.outer(size, size), expected / np.outer(size, size), rtol=0, atol=1e-6)
        pull = -np.einsum("nki,nk->i", J[own], at[own])
        np.testing.assert_allclose(right[p] / size, pull / size, rtol=0, atol=1e-5 * np.abs(pull / size).max())


def test_photographs_show_how_they_moved_better_than_their_neighbours_tell() -> None:
    shown, told, T = [], [], []
    for seed in (1, 2, 3):
        made, result = adjusted(seed)
        true = true_velocities(made)
        neighbours = moving(result.block, result.block.oriented_cameras()).velocity
        told.append((neighbours - true)[:, :2])
        shown.append((velocities_of(result) - true)[:, :2])
        T.append((result.decisions.readout_s[0] - 0.033) / result.decisions.readout_sigma_s[0])
    ratio = np.sqrt(np.mean(np.square(shown)) / np.mean(np.square(told)))
    assert ratio < 0.7
    assert np.abs(T).max() < 3.0


def test_velocities_are_as_good_beside_a_read_out_time_that_is_given() -> None:
    """Which one adjustment has to do, where one that is looked for begins again."""
    shown, told = [], []
    for seed in (1, 2, 3):
        made = simulate_block(NEIGHBOURS, seed, tie_points=600, sigma_px=0.4)
        sigmas = made.block.cameras[0].sigmas.copy()
        sigmas[READOUT] = 0.0
        camera = replace(made.block.cameras[0], readout_s=0.033, sigmas=sigmas)
        result = adjust(replace(made.block, cameras=(camera,)), SETTINGS)
        true = true_velocities(made)
        told.append((moving(result.block, result.block.oriented_cameras()).velocity - true)[:, :2])
        shown.append((velocities_of(result) - true)[:, :2])
        assert 0.15 < result.decisions.neighbours_scatter_m_s < 0.6
    assert np.sqrt(np.mean(np.square(shown)) / np.mean(np.square(told))) < 0.6


def test_speeds_in_tags_stay_as_they_are() -> None:
    made = simulate_block(replace(NEIGHBOURS, velocity_tags=True), 1, tie_points=600, sigma_px=0.4)
    result = adjust(made.block, SETTINGS)
    tags = np.array([photograph.velocity_world_m_s for photograph in made.block.photographs])
    np.testing.assert_array_equal(velocities_of(result), tags)


def test_what_is_not_free_stays_to_the_last_bit() -> None:
    problem, state = at_the_solution(adjusted(1)[1])
    told, free = state.cameras.velocity, np.arange(len(state.cameras.velocity)) < 12
    found = departures(problem, state, told, free)
    assert 0.1 < found.scatter_m_s < 1.0
    for velocity in (found.one_by_one(), found.together(problem, state).velocity_m_s):
        np.testing.assert_array_equal(velocity[12:], told[12:])
        assert (velocity[:12] != told[:12]).any(axis=1).all()
    parameters = state.parameters.copy()
    parameters[:, READOUT] = 0.0
    still = replace(state, cameras=state.cameras._replace(parameters=parameters))
    found = departures(problem, still, told, free)
    assert found.scatter_m_s == 0.0
    for velocity in (found.one_by_one(), found.together(problem, still).velocity_m_s):
        np.testing.assert_array_equal(velocity, told)


def test_velocities_are_found_one_by_one_where_something_else_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, state = at_the_solution(adjusted(1)[1])
    together, alone = renewed(problem, state, together=True), renewed(problem, state)

    def undetermined(*_: object) -> None:
        raise SingularError(3)

    monkeypatch.setattr("photogram.factors.joint_velocities.factored", undetermined)
    np.testing.assert_array_equal(renewed(problem, state, together=True).velocity, alone.velocity)
    assert (together.velocity != alone.velocity).any()
