"""The engine with points eliminated against the graph with every point a variable, and blocks in a free gauge."""

from dataclasses import replace
from typing import TypedDict

import gtsam
import numpy as np
import pytest
from makers import problem_of, simulated
from scipy.spatial.transform import Rotation

from photogram.adjustment.problem import AdjustmentSettings, minimise
from photogram.arrays import BoolArray, FloatArray
from photogram.camera import oriented_by
from photogram.factors.covariance import covariances
from photogram.factors.elimination.bundle import BundleState, adjust_bundle, minimise_bundle
from photogram.factors.elimination.reduced import NormalEquations
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.graph import cost, ground_factors
from photogram.factors.ground_terms import GroundTerms, bundle_of, variable_at
from photogram.factors.reference.graph import ground_graph, ground_values
from photogram.factors.variables import CALIBRATION, COMMON_ERROR, CONTROL_POINT, GNSS_OFFSET, POSE, key
from photogram.projection import PARAMETERS
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block, CommonError

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=6, check_points=2, flights=2,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, np.inf, 0.0, 0.0),
)  # fmt: skip


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy"])
def test_both_engines_take_the_same_steps_without_mismatches(loss: str) -> None:
    problem, start = problem_of(simulated(PLAN, off=0.3).block, "huber")
    problem = replace(problem, robust_loss=loss, robust_threshold=200.0)  # type: ignore[arg-type]
    fast, slow = (minimise(problem, start, AdjustmentSettings(engine=engine)) for engine in ("fast", "reference"))
    assert (fast.iterations, fast.converged) == (slow.iterations, slow.converged)
    assert fast.cost == pytest.approx(slow.cost, rel=1e-9)
    assert fast.cost == pytest.approx(cost(problem, ground_factors(problem), fast.state), rel=1e-12)
    for name in ("rotation", "position", "parameters", "tie_point", "control", "offset", "common"):
        np.testing.assert_allclose(getattr(fast.state, name), getattr(slow.state, name), rtol=1e-8, atol=1e-7)


def with_common_errors(block: Block) -> Block:
    """The block with errors of every kind that positions may have in common, their values off zero."""
    basis = np.linalg.qr(np.array([[1.0, 0.2], [0.1, 1.0], [0.3, 0.0]]))[0]
    return replace(
        block,
        common_errors=(
            CommonError("lever_arm", None, 0, np.full(2, 0.5), np.array([0.1, -0.2]), basis),
            CommonError("time_offset", None, 0, np.full(1, 0.1), np.array([0.02])),
            CommonError("drift", "2", None, np.full(3, 0.3), np.array([0.1, 0.0, -0.1])),
        ),
    )


def test_both_engines_find_the_same_common_errors() -> None:
    problem, start = problem_of(with_common_errors(simulated(PLAN, off=0.3).block), "none")
    assert [e.kind for e in problem.block.common_errors] == [
        "lever_arm",
        "time_offset",
        "drift",
        "attitude",
        "attitude",
    ]
    fast, slow = (minimise(problem, start, AdjustmentSettings(engine=engine)) for engine in ("fast", "reference"))
    assert fast.cost == pytest.approx(slow.cost, rel=1e-9)
    assert np.all(np.abs(fast.state.common) > 0.0)
    np.testing.assert_allclose(fast.state.common, slow.state.common, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("errors", ["attitudes alone", "all kinds"])
def test_ground_terms_are_the_linear_graph_of_gtsam(errors: str) -> None:
    block = simulated(PLAN, off=0.3).block
    problem, state = problem_of(with_common_errors(block) if errors == "all kinds" else block, "huber")
    state = replace(state, offset=np.random.default_rng(1).normal(0, 0.2, state.offset.shape))
    layout = bundle_of(problem, state).layout
    ground = GroundTerms(problem, layout)
    terms = ground.linearise(state)
    normal = NormalEquations.zero(layout)
    terms.add_to(normal)
    graph = ground_graph(problem)
    values = ground_values(problem, state)
    linear = graph.linearize(values)
    assert terms.cost == pytest.approx(graph.error(values), rel=1e-12)
    assert ground.cost(state) == pytest.approx(graph.error(values), rel=1e-12)
    ordering = gtsam.Ordering()
    for i in layout.photograph_at.tolist():
        ordering.push_back(key(POSE, i))
    common = [key(COMMON_ERROR, k) for k in range(len(problem.block.common_errors))]
    for variable in (key(CALIBRATION, 0), key(GNSS_OFFSET, 0), key(GNSS_OFFSET, 1), *common):
        ordering.push_back(variable)
    for g in range(len(state.control)):
        ordering.push_back(key(CONTROL_POINT, g))
    information, right = linear.hessian(ordering)
    m, k = layout.columns, layout.border
    found = np.zeros((m + k, m + k))
    for n, block in enumerate(normal.U):
        found[6 * n : 6 * n + 6, 6 * n : 6 * n + 6] = block
    found[:m, m:], found[m:, :m], found[m:, m:] = normal.B, normal.B.T, normal.E
    size = m + k
    assert np.abs(found[:m, m + layout.offset_column :]).max() > 100
    np.testing.assert_allclose(found, information[:size, :size], rtol=1e-12, atol=1e-9)
    gradient = np.concatenate([normal.g, normal.h])
    np.testing.assert_allclose(gradient, np.ravel(right)[:size], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(np.concatenate([normal.D, normal.F]), np.diag(found), rtol=1e-12)
    for g in range(len(state.control)):
        rows = slice(size + 3 * g, size + 3 * g + 3)
        np.testing.assert_allclose(terms.control[g], information[rows, rows], rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(terms.control_gradient[g], np.ravel(right)[rows], rtol=1e-12)


def test_every_column_belongs_to_its_variable() -> None:
    problem, state = problem_of(simulated(PLAN, off=0.3).block, "huber")
    layout = bundle_of(problem, state).layout
    names = [variable_at(layout, c) for c in range(layout.columns + layout.border)]
    assert names[6 * layout.place[4]] == names[6 * layout.place[4] + 5] == (POSE, 4)
    assert names[layout.columns : layout.columns + 6] == [(CALIBRATION, 0)] * 6
    offsets, attitudes = (
        [(GNSS_OFFSET, 0)] * 3 + [(GNSS_OFFSET, 1)] * 3,
        [(COMMON_ERROR, 0)] * 4 + [(COMMON_ERROR, 1)] * 4,
    )
    assert names[layout.columns + 6 :] == offsets + attitudes


def test_a_joint_covariance_is_the_same_within_the_band_and_beyond() -> None:
    plan = SurveyPlan(strips=1, photographs_per_strip=14, control_points=8, check_points=0, forward_overlap=0.6)
    problem, state = problem_of(simulated(plan, off=0.3).block, "huber")
    found = covariances(problem, state)
    layout = found.layout
    assert not layout.dense
    everything = found.joint(np.arange(14))
    near = np.array([2, 3])
    assert np.ptp(layout.place[near]) <= layout.reach
    assert np.ptp(layout.place) > layout.reach
    rows = (6 * near[:, None] + np.arange(6)).ravel()
    rows = np.concatenate([rows, 84 + np.arange(layout.border)])
    expected = everything[np.ix_(rows, rows)]
    sigma = np.sqrt(np.maximum(np.diag(expected), 1e-30))
    np.testing.assert_allclose(found.joint(near) / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-7)
    np.testing.assert_array_equal(found.pose(5), found.joint(np.array([5]))[:6, :6])
    np.testing.assert_allclose(found.poses[5], found.pose(5), rtol=1e-12)
    moving = np.diag(everything) > 0
    assert (
        np.linalg.eigvalsh(
            everything[np.ix_(moving, moving)] / np.outer(*[np.sqrt(np.diag(everything))[moving]] * 2)
        ).min()
        > 0
    )


# ---- free gauge -----------------------------------------------------------------------------------------------------


def growing(sigma_px: float = 0.0, tie_points: int = 200) -> tuple[SimulatedBlock, Observations, BundleState]:
    """A block that starts off its solution by decimetres, without any ground."""
    made = simulate_block(
        PLAN, 3, tie_points=tie_points, sigma_px=max(sigma_px, 1e-9), start_position_sigma_m=0.3,
        start_attitude_sigma_deg=0.3, start_point_sigma_m=0.3,
    )  # fmt: skip
    tie = made.block.tie_points
    observations = Observations(tie.photograph, tie.point, tie.pixel, np.full(len(tie.point), 0.5))
    camera_of = np.zeros(len(made.block.poses), np.int64)
    state = BundleState(oriented_by([made.truth.camera], camera_of, made.block.poses), tie.position_world_m)
    return made, observations, state


class Freedom(TypedDict):
    """Which calibration parameters move, and their priors."""

    free: BoolArray
    prior_sigma: FloatArray


NOTHING_FREE: Freedom = {"free": np.zeros((1, PARAMETERS), bool), "prior_sigma": np.full((1, PARAMETERS), np.inf)}


def after_similarity(found: FloatArray, truth: FloatArray) -> FloatArray:
    """Differences (N, 3) that a similarity of the found points does not take away (Umeyama 1991)."""
    a, b = found - found.mean(axis=0), truth - truth.mean(axis=0)
    U, s, Vt = np.linalg.svd(b.T @ a)
    D = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    return np.asarray(np.trace(np.diag(s) @ D) / np.sum(a**2) * a @ (U @ D @ Vt).T - b)


def test_a_block_without_noise_finds_its_shape_in_a_free_gauge() -> None:
    made, observations, state = growing()
    found = adjust_bundle(
        observations, state, fixed_poses=np.zeros(6, bool), prior_parameters=state.parameters,
        maximum_iterations=50, relative_tolerance=1e-9, **NOTHING_FREE,
    )  # fmt: skip
    assert found.cost < 1e-6
    assert np.abs(after_similarity(found.point, made.tie_point_position_world_m)).max() < 1e-4
    # Whoever does not hold the gauge must not drift: the damping keeps it near the start.
    assert np.linalg.norm(found.position.mean(axis=0) - state.position.mean(axis=0)) < 1.0
    np.testing.assert_array_equal(found.parameters, state.parameters)


def test_fixed_poses_stay_and_points_without_rays_stay() -> None:
    _, observations, state = growing(0.5)
    keep = observations.point != 7
    held = np.array([True, False, True, False, False, False])
    found = adjust_bundle(
        observations.select(keep), state, fixed_poses=held, prior_parameters=state.parameters, maximum_iterations=60,
        **NOTHING_FREE,
    )  # fmt: skip
    assert found.converged
    np.testing.assert_array_equal(found.rotation[held], state.rotation[held])
    np.testing.assert_array_equal(found.position[held], state.position[held])
    assert np.all(np.linalg.norm(found.position[~held] - state.position[~held], axis=1) > 1e-3)
    np.testing.assert_array_equal(found.point[7], state.point[7])
    everything = adjust_bundle(
        observations, state, fixed_poses=np.ones(6, bool), prior_parameters=state.parameters, **NOTHING_FREE
    )
    assert everything.cost > found.cost
    np.testing.assert_array_equal(everything.position, state.position)


def test_a_free_focal_length_moves_as_far_as_its_prior_lets_it() -> None:
    made, observations, state = growing(0.5, tie_points=400)
    truth = made.truth.camera.parameters[None]
    wrong = truth + 20.0 * (np.arange(PARAMETERS) == 0)
    free = np.zeros((1, PARAMETERS), bool)
    free[0, [0, 3]] = True
    held = np.zeros(6, bool)
    errors = []
    for sigma in (np.inf, 1e-3):
        found = adjust_bundle(
            observations, replace(state, cameras=state.cameras._replace(parameters=wrong)), fixed_poses=held, free=free,
            prior_sigma=np.where(free, sigma, np.inf), prior_parameters=wrong, maximum_iterations=50,
        )  # fmt: skip
        np.testing.assert_array_equal(found.parameters[~free], wrong[~free])
        errors.append(abs(found.parameters[0, 0] - wrong[0, 0]))
    assert errors[1] < 0.1 < errors[0]


def test_expected_positions_fix_what_image_points_leave_open() -> None:
    """Without noise the least cost is 0: similarity and all are those of the expected positions."""
    made, observations, state = growing()
    truth = np.array([p.position_world_m for p in made.truth.poses])
    for sigma_m in (0.1, 30.0):
        found = adjust_bundle(
            observations, state, fixed_poses=np.zeros(6, bool), prior_parameters=state.parameters,
            prior_position=truth, prior_position_sigma=sigma_m, maximum_iterations=100, relative_tolerance=1e-12,
            **NOTHING_FREE,
        )  # fmt: skip
        assert found.cost < 1e-6
        np.testing.assert_allclose(found.position, truth, atol=1e-3)
        np.testing.assert_allclose(found.point, made.tie_point_position_world_m, atol=1e-3)


def test_expected_positions_weigh_as_their_standard_deviation() -> None:
    """Against image points without noise nothing but what a similarity takes is gained from wrong positions."""
    made, observations, state = growing()
    truth = np.array([p.position_world_m for p in made.truth.poses])
    wrong = truth + np.array([0.0, 0.0, 3.0]) * np.array([1, -1, -1, 1, -1, 1])[:, None]
    costs = [
        adjust_bundle(
            observations, state, fixed_poses=np.zeros(6, bool), prior_parameters=state.parameters,
            prior_position=wrong, prior_position_sigma=sigma_m, maximum_iterations=100, relative_tolerance=1e-12,
            **NOTHING_FREE,
        ).cost
        for sigma_m in (300.0, 600.0)
    ]  # fmt: skip
    assert costs[0] == pytest.approx(4.0 * costs[1], rel=0.05)
    assert 0.3 * 27.0 / 300.0**2 < costs[0] <= 27.0 / 300.0**2


def test_the_loss_keeps_mismatches_from_the_block() -> None:
    made, observations, state = growing(0.5)
    pixel = observations.pixel.copy()
    pixel[::29] += 60.0
    spoilt = replace(observations, pixel=pixel)
    error = {}
    for loss in ("none", "cauchy"):
        found = adjust_bundle(
            spoilt, state, fixed_poses=np.zeros(6, bool), prior_parameters=state.parameters,
            loss=loss, maximum_iterations=50, **NOTHING_FREE,
        )  # fmt: skip
        truth = np.array([p.position_world_m for p in made.truth.poses])
        error[loss] = np.abs(after_similarity(found.position, truth)).max()
    assert error["cauchy"] < 0.2 * error["none"]


def test_points_behind_photographs_are_a_flag() -> None:
    _, observations, state = growing(0.5)
    turned = state.rotation.copy()
    turned[1] = turned[1] @ Rotation.from_euler("x", 180, degrees=True).as_matrix()
    found = adjust_bundle(
        observations, replace(state, cameras=state.cameras._replace(rotation=turned)), fixed_poses=np.zeros(6, bool),
        prior_parameters=state.parameters, **NOTHING_FREE,
    )  # fmt: skip
    assert not found.converged
    assert found.cost == np.inf
    np.testing.assert_array_equal(found.position, state.position)


def test_photographs_without_observations_do_not_matter() -> None:
    _, observations, state = growing(0.5)
    more = replace(
        state, cameras=state.cameras._replace(
            camera=np.append(state.cameras.camera, 0),
            rotation=np.concatenate([state.rotation, np.eye(3)[None]]),
            position=np.concatenate([state.position, np.zeros((1, 3))]),
        ),
    )  # fmt: skip
    found, alone = (
        adjust_bundle(
            observations, start, fixed_poses=np.zeros(len(start.position), bool), prior_parameters=state.parameters,
            **NOTHING_FREE,
        )
        for start in (more, state)
    )  # fmt: skip
    assert found.cost == alone.cost
    np.testing.assert_array_equal(found.position[:6], alone.position)
    np.testing.assert_array_equal(found.position[6], more.position[6])


def test_large_blocks_are_minimised_alike_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, start = problem_of(simulated(PLAN, off=0.3).block, "huber")
    monkeypatch.setattr("photogram.factors.elimination.points.MANY_OBSERVATIONS", 100)
    monkeypatch.setattr("photogram.factors.elimination.bundle.MANY_OBSERVATIONS", 100)
    results = []
    for cores in (1, 3):
        monkeypatch.setattr("os.sched_getaffinity", lambda _, cores=cores: set(range(cores)))
        results.append(minimise_bundle(bundle_of(problem, start), start, 20, 1e-9))
    assert results[0].cost == results[1].cost
    np.testing.assert_array_equal(results[0].state.tie_point, results[1].state.tie_point)
