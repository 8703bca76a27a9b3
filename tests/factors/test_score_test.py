"""What a held parameter would become: one step against the engine's own with the parameter free."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.factors.covariance import covariances
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.score_test import least_statistic, one_step
from photogram.projection import B1, K2, READOUT
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=4, control_points=5, check_points=0, gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0), velocity_tags=True,
)  # fmt: skip
SETTINGS = AdjustmentSettings(robust_loss="none")


@pytest.mark.parametrize(("parameter", "size"), [(K2, 0.004), (B1, 3.0), (READOUT, 0.01)])
def test_one_step_is_that_of_the_whole_system_with_the_parameter_free(parameter: int, size: float) -> None:
    made = simulate_block(replace(PLAN, readout_s=0.004), 4, tie_points=300, sigma_px=0.3)
    moved = replace(made.block, poses=tuple(
        replace(pose, velocity_world_m_s=true.velocity_world_m_s)
        for pose, true in zip(made.block.poses, made.truth.poses, strict=True) if pose is not None
    ))  # fmt: skip
    held = make_problem(moved, SETTINGS)
    state = minimise(held, start_state(held), SETTINGS).state
    found = one_step(held, state, covariances(held, state), 0, parameter)
    camera = moved.cameras[0]
    sigmas = camera.sigmas.copy()
    sigmas[parameter] = 1e3 * size
    free = make_problem(replace(moved, cameras=(replace(camera, sigmas=sigmas),)), SETTINGS)
    solved = minimise(free, replace(state, cameras=state.cameras), SETTINGS).state
    change = solved.parameters[0, parameter] - state.parameters[0, parameter]
    sigma = np.sqrt(covariances(free, solved).calibration(0)[parameter, parameter])
    assert found.sigma == pytest.approx(sigma, rel=0.01)
    assert found.value == pytest.approx(change, abs=0.05 * sigma + 0.01 * abs(change))
    assert 0.0 < least_statistic(held, state, 0, parameter) < (found.value / found.sigma) ** 2


def test_what_nothing_tells_has_no_step() -> None:
    made = simulate_block(PLAN, 4, tie_points=100, sigma_px=0.3)
    problem = make_problem(made.block, SETTINGS)
    state = start_state(problem)
    step = one_step(problem, state, covariances(problem, state), 0, READOUT)
    assert np.isnan([step.value, step.sigma]).all(), "nothing moved"
    assert least_statistic(problem, state, 0, READOUT) == 0.0


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("parameter", [K2, B1])
def test_its_parts_are_those_of_the_whole_system_to_many_digits(parameter: int, mixed: bool) -> None:
    """Few tie points, and control points surveyed to decimetres, which follow as tie points do; ``mixed``: marks of
    correlated coordinates."""
    plan = replace(PLAN, control_sigma_m=(0.3, 0.4, 1.0), control_points=8, photographs_per_strip=3)
    block, rng = simulate_block(plan, 4, tie_points=40, sigma_px=0.3).block, np.random.default_rng(0)
    held = make_problem(block, SETTINGS)
    tie, marks = held.tie, held.marks
    if mixed:
        marks = replace(marks, mixing=rng.uniform([0.5, -1.0], [2.0, 1.0], (len(marks), 2)))
    held = replace(held, marks=marks)
    state = minimise(held, start_state(held), SETTINGS).state
    found = one_step(held, state, covariances(held, state), 0, parameter)
    sigmas = block.cameras[0].sigmas.copy()
    sigmas[parameter] = 30 * found.sigma
    free = replace(
        make_problem(replace(block, cameras=(replace(block.cameras[0], sigmas=sigmas),)), SETTINGS),
        tie=tie,
        marks=marks,
    )
    whole = covariances(free, state).calibration(0)[parameter, parameter]
    assert found.sigma**-2 + sigmas[parameter] ** -2 == pytest.approx(1 / whole, rel=1e-9)

    def cost(change: float) -> float:
        parameters = state.parameters.copy()
        parameters[0, parameter] += change
        cameras = state.cameras._replace(parameters=parameters)
        rays = (residuals(tie, cameras, state.tie_point), residuals(marks, cameras, state.control))
        return sum(0.5 * float(np.sum(part**2)) for part in rays)

    h = 0.1 * found.sigma
    assert found.value / found.sigma**2 == pytest.approx((cost(-h) - cost(h)) / (2 * h), rel=1e-5)
