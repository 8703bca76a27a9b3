"""Errors of the ground at places over a block, jointly: against the covariances of single tie points."""

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.factors.covariance import Covariances, covariances
from photogram.factors.elimination.state import State
from photogram.factors.functionals import functions_of_tie_points
from photogram.factors.graph import Problem
from photogram.quality.deformation import Places, places_of
from photogram.quality.ground_errors import factor_of_differences, ground_errors
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

Known = tuple[Problem, State, Covariances, Places]
"""An adjusted block: its problem, its solution, the covariances there, and places over its ground."""


@pytest.fixture(scope="module", params=[6, 0], ids=["control", "GNSS only"])
def block(request: pytest.FixtureRequest) -> Known:
    plan = SurveyPlan(
        strips=3, photographs_per_strip=4, control_points=request.param, check_points=0,
        gnss_sigma_m=(2.0, 2.0, 3.0), gnss_offset_sigma_m=(5.0, 5.0, 10.0),
    )  # fmt: skip
    made = simulate_block(
        plan, 3, tie_points=500, start_position_sigma_m=0.0, start_attitude_sigma_deg=0.0, start_point_sigma_m=0.0
    )
    problem = make_problem(made.block, AdjustmentSettings(robust_loss="none"))
    state = start_state(problem)
    places = places_of(problem, state)
    assert places is not None
    return problem, state, covariances(problem, state), places


def test_differences_of_places_are_those_of_their_tie_points(block: Known) -> None:
    problem, state, found, places = block
    position, covariance = ground_errors(problem, state, found, places)
    assert 20 < len(position) <= 49
    factor = factor_of_differences(covariance)
    expected, modelled = [], []
    rng = np.random.default_rng(1)
    for i, j in rng.choice(len(position), (40, 2)):
        if i == j:
            continue
        ends = [np.argmin(np.linalg.norm(state.tie_point[places.points] - position[k], axis=1)) for k in (i, j)]
        points = np.sort(places.points[ends])
        if points[0] == points[1]:
            continue
        a = np.stack([np.eye(3), -np.eye(3)])
        expected.append(np.diag(functions_of_tie_points(problem, state, found.layout, points, a).shared(found)))
        modelled.append(np.sum((factor[i] - factor[j]) ** 2, axis=1))
    ratio = np.sqrt(np.sum(modelled, axis=0) / np.sum(expected, axis=0))
    # the mean of a cell lies beside the tie point, and shares less with a single pair of rays
    assert np.all(ratio > 0.6), ratio
    assert np.all(ratio < 1.2), ratio


def test_a_datum_of_metres_drops_out_of_differences(block: Known) -> None:
    problem, state, found, places = block
    _, covariance = ground_errors(problem, state, found, places)
    count = len(covariance) // 3
    shift = np.tile(np.eye(3) * 1000.0, (count, 1))
    shifted = factor_of_differences(covariance + shift @ shift.T)
    plain = factor_of_differences(covariance)

    def differences(factor: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(np.sum((factor - factor[:1]) ** 2, axis=2)))

    np.testing.assert_allclose(differences(shifted), differences(plain), rtol=0.05, atol=2e-3)


def test_factor_gives_the_covariance_of_differences() -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(15, 15))
    covariance = root @ root.T
    factor = factor_of_differences(covariance, negligible_m=0.0)
    for i, j in ((0, 1), (2, 4)):
        difference = np.zeros((3, 15))
        difference[:, 3 * i : 3 * i + 3], difference[:, 3 * j : 3 * j + 3] = np.eye(3), -np.eye(3)
        exact = difference @ covariance @ difference.T
        step = factor[i] - factor[j]
        # what is left out is at most a hundredth of each place's variance
        assert np.abs(step @ step.T - exact).max() <= 0.04 * np.diag(covariance).max()
    assert factor_of_differences(np.zeros((0, 0))).shape == (0, 3, 0)
