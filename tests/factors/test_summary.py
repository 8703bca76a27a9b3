"""The summary of the tie points: exact at its place, blind to the datum, and a good guide to what is near."""

from dataclasses import replace

import numpy as np
import pytest
from makers import problem_of, simulated
from scipy.spatial.transform import Rotation

from photogram.adjustment.problem import AdjustmentSettings, minimise
from photogram.arrays import FloatArray
from photogram.factors.covariance import covariances
from photogram.factors.elimination.loss import steering
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.elimination.summary import TiePointSummary, _similarity, _steps, followed, summarise
from photogram.factors.graph import Problem
from photogram.factors.ground_terms import bundle_of
from photogram.projection import OrientedCameras, recalibrated
from photogram.simulation.simulated_survey import SurveyPlan

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=4, control_points=6, check_points=2,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip
SETTINGS = AdjustmentSettings(relative_tolerance=1e-13)
LOSS = steering("huber", 3.0)


def solved(*, mismatches: float = 0.0, relief_m: float = 8.0) -> tuple[Problem, State]:
    problem, start = problem_of(
        simulated(replace(PLAN, relief_m=relief_m), off=0.1, mismatches=mismatches).block, "huber"
    )
    return problem, minimise(problem, start, SETTINGS).state


def summary_of(problem: Problem, state: State) -> TiePointSummary:
    return summarise(problem.tie, state.cameras, state.tie_point, LOSS)


def without_rays(problem: Problem, state: State) -> tuple[Problem, State]:
    """The same problem whose tie points are a summary."""
    none = problem.tie.select(np.zeros(len(problem.tie), dtype=bool))
    summarised = replace(problem, tie=none, summary=summary_of(problem, state))
    return summarised, replace(state, tie_point=np.zeros((0, 3)))


def placed(cameras: OrientedCameras, seed: int) -> OrientedCameras:
    """The photographs shifted, turned and scaled as a whole, by far."""
    rng = np.random.default_rng(seed)
    turn, scale = Rotation.random(random_state=rng.integers(1 << 31)).as_matrix(), float(rng.uniform(0.2, 5.0))
    return cameras._replace(
        rotation=turn @ cameras.rotation, position=scale * cameras.position @ turn.T + rng.uniform(-1e3, 1e3, 3)
    )


def stepped(cameras: OrientedCameras, step: FloatArray) -> OrientedCameras:
    tangent = step[: 6 * len(cameras.position)].reshape(-1, 6)
    return recalibrated(
        cameras._replace(
            rotation=cameras.rotation @ Rotation.from_rotvec(tangent[:, :3]).as_matrix(),
            position=cameras.position + np.einsum("nij,nj->ni", cameras.rotation, tangent[:, 3:]),
        ),
        cameras.parameters + step[6 * len(cameras.position) :].reshape(cameras.parameters.shape),
    )


@pytest.mark.parametrize("mismatches", [0.0, 0.02])
def test_at_its_place_it_is_the_tie_points(mismatches: float) -> None:
    problem, state = solved(mismatches=mismatches)
    summarised, bare = without_rays(problem, state)
    again = minimise(summarised, bare, SETTINGS)
    np.testing.assert_allclose(again.cost, minimise(problem, state, SETTINGS).cost, rtol=1e-9)
    np.testing.assert_allclose(again.state.position, state.position, atol=1e-6)
    np.testing.assert_allclose(again.state.parameters[:, 0], state.parameters[:, 0], atol=1e-4)
    with_rays, without = covariances(problem, state), covariances(summarised, bare)
    np.testing.assert_allclose(without.poses, with_rays.poses, rtol=1e-6, atol=1e-12 * float(with_rays.poses.max()))
    np.testing.assert_allclose(without.control_point, with_rays.control_point, rtol=1e-6, atol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_it_knows_no_datum(seed: int) -> None:
    problem, state = solved()
    summary, far = summary_of(problem, state), placed(state.cameras, seed)
    assert summary.cost_at(state.cameras) == pytest.approx(summary.cost, rel=1e-12)
    assert summary.cost_at(far) == pytest.approx(summary.cost, rel=1e-9)
    bent = stepped(state.cameras, 1e-4 * np.random.default_rng(seed).standard_normal(6 * len(far.position) + 12))
    assert summary.cost_at(placed(bent, seed)) == pytest.approx(summary.cost_at(bent), rel=1e-7)


def test_centres_in_one_line_leave_nothing_open() -> None:
    problem, start = problem_of(simulated(replace(PLAN, strips=1, position_noise_m=0.0), off=0.0).block, "huber")
    line = start.cameras._replace(position=np.outer(np.arange(4.0), [20.0, 1.0, 0.0]) + start.position[0])
    summary = summarise(problem.tie, line, start.tie_point, LOSS)
    assert summary.cost_at(placed(line, 3)) == pytest.approx(summary.cost, rel=1e-9)


def test_its_gradient_is_that_of_its_cost() -> None:
    """Exactly where δ is zero, and to the order of δ elsewhere."""
    problem, state = solved()
    summarised, bare = without_rays(problem, state)
    assert summarised.summary is not None
    rng, size = np.random.default_rng(0), 6 * len(state.position)
    scale = np.concatenate([np.tile([1e-5] * 3 + [1e-3] * 3, len(state.position)), 1e-6 * np.ones(12)])
    for off, tolerance in ((0.0, 1e-5), (1.0, 2e-3)):
        cameras = stepped(bare.cameras, off * scale * rng.standard_normal(size + 12))
        left = _gradient(summarised.summary, cameras)
        direction = 0.1 * scale * rng.standard_normal(size + 12)
        ahead, behind = (summarised.summary.cost_at(stepped(cameras, sign * direction)) for sign in (1.0, -1.0))
        assert -left @ direction == pytest.approx(0.5 * (ahead - behind), rel=tolerance, abs=1e-7)


def _gradient(summary: TiePointSummary, cameras: OrientedCameras) -> FloatArray:
    """The right-hand side of the summary's normal equations, photographs and all parameters in their own order."""
    off = summary.departure(cameras)
    poses = summary.right - summary.poses @ off.poses - summary.mixed @ off.calibration
    right = np.einsum("nji,nj->ni", off.steps, poses.reshape(-1, 6)).ravel()
    return np.concatenate(
        [right, summary.right_calibration - summary.mixed.T @ off.poses - summary.calibration @ off.calibration]
    )


def test_what_else_is_measured_may_change_without_the_rays() -> None:
    """Control off by a few sigmas bends the block as it does with all rays."""
    problem, state = solved()
    summarised, bare = without_rays(problem, state)
    moved_m = problem.control_world_m.copy()
    moved_m[0, 2] += 0.02
    with_rays = minimise(replace(problem, control_world_m=moved_m), state, SETTINGS)
    without = minimise(replace(summarised, control_world_m=moved_m), bare, SETTINGS)
    bend = with_rays.state.position - state.position
    assert np.abs(bend).max() > 0.002
    np.testing.assert_allclose(without.state.position - state.position, bend, atol=0.08 * float(np.abs(bend).max()))
    assert without.cost == pytest.approx(with_rays.cost, rel=1e-4)


def test_tie_points_follow_their_photographs() -> None:
    """Taken to a block that is bent and placed elsewhere, they are where their rays have the least cost."""
    problem, state = solved()
    summary = summary_of(problem, state)
    rng = np.random.default_rng(1)
    tangent = np.tile([2e-3] * 3 + [0.1] * 3, len(state.position)) * rng.standard_normal(6 * len(state.position))
    after = placed(stepped(state.cameras, np.concatenate([tangent, [40.0, *np.zeros(11)]])), 2)
    points = followed(summary, problem.tie, state.tie_point, after, LOSS)
    cost = float(np.sum(residuals(problem.tie, after, points) ** 2))
    further = summarise(problem.tie, after, points, LOSS)
    settled = followed(further, problem.tie, points, after, LOSS)
    assert cost == pytest.approx(float(np.sum(residuals(problem.tie, after, settled) ** 2)), rel=5e-3)


def test_cameras_whose_calibration_is_held_leave_nothing_in_common() -> None:
    held = replace(PLAN, calibration_sigmas=(0.0,) * 11, attitude_sigma_deg=0.0, gnss_offset_sigma_m=(0.0,) * 3)
    block = simulated(held, off=0.1).block
    bare = tuple(replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None) for p in block.photographs)
    problem, start = problem_of(replace(block, photographs=bare), "huber")
    state = minimise(problem, start, SETTINGS).state
    summarised, without = without_rays(problem, state)
    assert bundle_of(summarised, without).layout.border == 0
    np.testing.assert_allclose(minimise(summarised, without, SETTINGS).state.position, state.position, atol=1e-6)


def test_a_layout_without_a_place_for_it_is_refused() -> None:
    problem, state = solved()
    summary = summary_of(problem, state)
    parameters = summary.cameras.parameters
    layout = bundle_of(*without_rays(problem, state)).layout
    with pytest.raises(ValueError, match="lens fields"):
        summary.terms(state.cameras, replace(layout, unit=np.ones((1, parameters.shape[1] + 2))), 0)
    with pytest.raises(ValueError, match="farther apart"):
        summary.terms(state.cameras, replace(layout, reach=1), 0)


def test_centres_in_one_place_have_the_turn_of_the_attitudes_and_no_scale() -> None:
    _, start = problem_of(simulated(PLAN, off=0.1).block, "huber")
    here = start.cameras._replace(position=np.tile([5.0, -3.0, 40.0], (len(start.position), 1)))
    there = placed(here, 2)
    scale, turn, shift = _similarity(here, there)
    assert scale == 1.0
    np.testing.assert_allclose(turn @ here.rotation, there.rotation, rtol=0, atol=1e-12)
    np.testing.assert_allclose(here.position @ turn.T + shift, there.position, rtol=0, atol=1e-9)


@pytest.mark.parametrize("omega", [(0.0, 0.0, 0.0), (1e-5, -2e-5, 3e-5), (0.02, 0.01, -0.03), (0.9, -0.6, 1.1)])
def test_a_departure_moves_with_a_step_as_differences_say(omega: tuple[float, float, float]) -> None:
    turn, rotation = Rotation.from_rotvec(omega), Rotation.random(random_state=3).as_matrix()
    found, h = _steps(np.array([omega]), rotation[None], 4.0)[0], 1e-5
    turned = [(turn * Rotation.from_rotvec(sign * h * axis)).as_rotvec() for axis in np.eye(3) for sign in (1, -1)]
    expected = np.array([(turned[2 * k] - turned[2 * k + 1]) / (2 * h) for k in range(3)]).T
    np.testing.assert_allclose(found[:3, :3], expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found[3:, 3:], rotation / 4.0, rtol=1e-15)
    assert not found[:3, 3:].any()
    assert not found[3:, :3].any()


def test_the_reach_is_the_median_distance_of_the_tie_points() -> None:
    problem, start = problem_of(simulated(PLAN, off=0.1).block, "huber")
    state = replace(start, cameras=start.cameras._replace(position=start.position + np.array([500.0, 300.0, 0.0])),
                    tie_point=start.tie_point + np.array([500.0, 300.0, 0.0]))  # fmt: skip
    far = np.linalg.norm(state.tie_point[problem.tie.point] - state.position[problem.tie.photograph], axis=1)
    assert summary_of(problem, state).reach_m == pytest.approx(float(np.median(far)), rel=0.02)
