from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from makers import SMALL, problem_of, small_problem
from referees import native, whole_normal_equations
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import oriented_by
from photogram.factors.elimination.loss import robust_terms, steer
from photogram.factors.elimination.reprojection import (
    Observations,
    calibration_scale,
    linearise,
    residuals,
)
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem, cost, ground_factors
from photogram.factors.priors import (
    gnss_position,
    measured_attitude,
    offset_prior,
    surveyed_position,
    vector_prior,
)
from photogram.factors.reference.graph import (
    Step,
    damped_step,
    ground_graph,
    ground_values,
    linearise_all,
    reprojection_factors,
    retract,
    variable_size,
)
from photogram.factors.variables import (
    CALIBRATION,
    CONTROL_POINT,
    GNSS_OFFSET,
    POSE,
    TIE_POINT,
    indeterminate_variable,
    key,
    kind_and_index,
)
from photogram.projection import PARAMETERS
from photogram.simulation.simulated_survey import simulate_block
from photogram.survey import Photograph


def pose_of(state: State, photograph: int) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3(state.rotation[photograph]), state.position[photograph])


def values_of(problem: Problem, state: State) -> gtsam.Values:
    values = ground_values(problem, state)
    for p, X in enumerate(state.tie_point):
        values.insert(key(TIE_POINT, p), X)
    return values


def moved(values: gtsam.Values, variable: int, step: np.ndarray) -> gtsam.Values:
    tangent = gtsam.VectorValues()
    tangent.insert(variable, step)
    return values.retract(tangent)


def assert_jacobians(factor: gtsam.NonlinearFactor, values: gtsam.Values, sizes: dict[int, int]) -> None:
    """Every block of the linearised factor equals central differences of its whitened error, to 1e-6."""
    for variable, size in sizes.items():
        linear = factor.linearize(values)
        jacobian, _ = linear.jacobian()
        start = 0
        for other in linear.keys():  # noqa: SIM118 - a factor is no dictionary
            if other == variable:
                break
            start += sizes[other]
        columns = []
        for k in range(size):
            ends = []
            for sign in (1.0, -1.0):
                step = np.zeros(size)
                step[k] = sign * 1e-4
                ends.append(-factor.linearize(moved(values, variable, step)).jacobian()[1])
            columns.append((ends[0] - ends[1]) / 2e-4)
        numerical = np.array(columns).T
        atol = 1e-6 * np.abs(numerical).max()
        np.testing.assert_allclose(jacobian[:, start : start + size], numerical, rtol=0, atol=atol)


def turned_pose(seed: int) -> gtsam.Pose3:
    rng = np.random.default_rng(seed)
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(0, 1, 3)), rng.normal(0, 30, 3))


# ---- single factors -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_gnss_factor_with_an_offset(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, offset, measured, sigma = (
        turned_pose(seed),
        rng.normal(0, 0.3, 3),
        rng.normal(0, 30, 3),
        np.array([0.02, 0.03, 0.05]),
    )
    factor = native(gnss_position(4, measured, sigma, 1))
    values = gtsam.Values()
    values.insert(key(POSE, 4), pose)
    values.insert(key(GNSS_OFFSET, 1), offset)
    error = (pose.translation() - offset - measured) / sigma
    assert factor.error(values) == pytest.approx(0.5 * error @ error)
    np.testing.assert_allclose(factor.linearize(values).jacobian()[1], -error, rtol=1e-12)
    assert_jacobians(factor, values, {key(POSE, 4): 6, key(GNSS_OFFSET, 1): 3})


@pytest.mark.parametrize("seed", range(3))
def test_gnss_factor_without_an_offset(seed: int) -> None:
    pose, measured, sigma = turned_pose(seed), np.array([1.0, 2.0, 3.0]), np.array([0.02, 0.03, 0.05])
    factor = native(gnss_position(0, measured, sigma, None))
    values = gtsam.Values()
    values.insert(key(POSE, 0), pose)
    error = (pose.translation() - measured) / sigma
    assert factor.error(values) == pytest.approx(0.5 * error @ error)
    assert_jacobians(factor, values, {key(POSE, 0): 6})


@pytest.mark.parametrize("turn_deg", [0.1, 5.0, 40.0])
def test_attitude_factor(turn_deg: float) -> None:
    rng = np.random.default_rng(int(turn_deg))
    pose = turned_pose(7)
    turn = rng.normal(0, 1, 3)
    turn *= np.deg2rad(turn_deg) / np.linalg.norm(turn)
    measured = pose.rotation().matrix() @ Rotation.from_rotvec(turn).as_matrix().T
    factor = native(measured_attitude(2, measured, 0.02))
    values = gtsam.Values()
    values.insert(key(POSE, 2), pose)
    assert factor.error(values) == pytest.approx(0.5 * (np.deg2rad(turn_deg) / 0.02) ** 2)
    assert_jacobians(factor, values, {key(POSE, 2): 6})


def test_control_point_and_offset_priors() -> None:
    surveyed, sigma = np.array([5.0, -3.0, 80.0]), np.array([0.01, 0.02, 0.03])
    values = gtsam.Values()
    values.insert(key(CONTROL_POINT, 3), surveyed + np.array([0.01, 0.04, -0.09]))
    values.insert(key(GNSS_OFFSET, 0), np.array([0.2, 0.0, -0.5]))
    point = native(surveyed_position(3, surveyed, sigma))
    assert point.error(values) == pytest.approx(0.5 * (1 + 4 + 9))
    assert_jacobians(point, values, {key(CONTROL_POINT, 3): 3})
    offset = native(offset_prior(0, np.array([0.2, 0.3, 0.25])))
    assert offset.error(values) == pytest.approx(0.5 * (1 + 4))
    assert_jacobians(offset, values, {key(GNSS_OFFSET, 0): 3})


def test_calibration_prior_holds_the_bounded_parameters_only() -> None:
    expected, sigmas = np.array([3000.0, 1500.0, -250.0, 3.0]), np.array([5.0, np.inf, 2.0, 0.5])
    (prior,) = vector_prior(key(CALIBRATION, 1), expected, sigmas)
    factor = native(prior)
    values = gtsam.Values()
    values.insert(key(CALIBRATION, 1), expected + np.array([10.0, 77.0, -2.0, 0.25]))
    assert factor.dim() == 3
    assert factor.error(values) == pytest.approx(0.5 * (4 + 1 + 0.25))
    assert_jacobians(factor, values, {key(CALIBRATION, 1): 4})
    assert not list(vector_prior(key(CALIBRATION, 0), expected, np.full(4, np.inf)))


def test_variables_keep_kind_and_index() -> None:
    for kind in (POSE, TIE_POINT, CONTROL_POINT, GNSS_OFFSET, CALIBRATION):
        assert kind_and_index(key(kind, 123_456)) == (kind, 123_456)
    assert indeterminate_variable(f"... near variable {key(POSE, 17)} (Symbol: x17)") == (POSE, 17)
    assert indeterminate_variable("Symbol: k2") == (CALIBRATION, 2)
    assert indeterminate_variable("out of memory") is None


# ---- image observations ---------------------------------------------------------------------------------------------


def test_residuals_are_projected_minus_measured_over_sigma() -> None:
    made = simulate_block(SMALL, 3, tie_points=60, sigma_px=0.0)
    ties, truth = made.block.tie_points, made.truth
    n = len(ties.point)
    shift = np.array([0.6, -0.8])
    sigma = np.linspace(0.2, 2.0, n)
    marks = Observations(ties.photograph, ties.point, ties.pixel - shift, sigma)
    cameras = oriented_by([truth.camera], np.zeros(len(truth.poses), np.int64), truth.poses)
    found = residuals(marks, cameras, made.tie_point_position_world_m)
    np.testing.assert_allclose(found, shift / sigma[:, None], rtol=0, atol=1e-8)
    linear = linearise(marks, cameras, made.tie_point_position_world_m)
    np.testing.assert_array_equal(linear.residual, found)
    below = cameras.position.copy()
    below[0] -= [0.0, 0.0, 500.0]
    behind = cameras._replace(position=below)
    lost = residuals(marks, behind, made.tie_point_position_world_m)
    np.testing.assert_array_equal(np.isinf(lost).all(axis=1), ties.photograph == 0)
    nothing = linearise(marks, behind, made.tie_point_position_world_m)
    for rows in (nothing.residual, nothing.pose, nothing.calibration, nothing.point):
        np.testing.assert_array_equal(rows[ties.photograph == 0], 0.0)
        assert np.all(np.any(rows[ties.photograph != 0] != 0.0, axis=tuple(range(1, rows.ndim))))


def test_observations_use_the_camera_they_are_of() -> None:
    problem, state = small_problem()
    two = np.vstack([state.parameters, state.parameters + np.array([100.0, 5.0, -3.0, 0.01, *[0.0] * 8])])
    camera_of = np.arange(len(state.position)) % 2
    mixed = state.cameras._replace(
        camera=camera_of, model=np.zeros(2, np.int64), parameters=two,
        largest_radius=np.tile(state.cameras.largest_radius, 2), size_px=np.tile(state.cameras.size_px, (2, 1)),
    )  # fmt: skip
    found = residuals(problem.tie, mixed, state.tie_point)
    for c in (0, 1):
        one = residuals(problem.tie, state.cameras._replace(parameters=two[c : c + 1]), state.tie_point)
        own = camera_of[problem.tie.photograph] == c
        assert own.any()
        np.testing.assert_array_equal(found[own], one[own])


def test_linearised_observations_agree_with_differences() -> None:
    problem, state = small_problem()
    tie = problem.tie
    linear = linearise(tie, state.cameras, state.tie_point)

    def of(change: Callable[[np.ndarray], State], size: int, step: np.ndarray) -> np.ndarray:
        columns = []
        for k in range(size):
            t = np.zeros(size)
            t[k] = step[k]
            ends = [
                residuals(tie, s.cameras, s.tie_point) for s in (change(2 * t), change(t), change(-t), change(-2 * t))
            ]
            columns.append((8 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12 * step[k]))
        return np.stack(columns, axis=2)

    def pose(t: np.ndarray) -> State:
        turn = Rotation.from_rotvec(t[:3]).as_matrix()
        position = state.position + state.rotation @ t[3:]
        return replace(state, cameras=state.cameras._replace(rotation=state.rotation @ turn, position=position))

    expected = {
        "pose": of(pose, 6, np.array([1e-4] * 3 + [1e-2] * 3)),
        "point": of(lambda t: replace(state, tie_point=state.tie_point + t), 3, np.full(3, 1e-2)),
        "calibration": of(
            lambda t: replace(state, cameras=state.cameras._replace(parameters=state.parameters + t)),
            PARAMETERS,
            np.array([1.0] * 3 + [1e-2] * 9),
        ),
    }
    for name, numerical in expected.items():
        analytic = getattr(linear, name)
        size = np.abs(numerical).max(axis=(0, 1))
        assert np.all(np.abs(analytic - numerical) <= 1e-6 * size), name


def test_gtsams_own_camera_gives_the_same_errors_and_jacobians() -> None:
    # GTSAM's Cal3DS2 has no k3 and its own order: fx fy s u0 v0 k1 k2 p1 p2.
    made = simulate_block(replace(SMALL, radial=(-0.08, 0.06, 0.0, 0.0)), 2, tie_points=40)
    problem, state = problem_of(made.block)
    f, cx, cy, k1, k2, k3, k4, p1, p2, b1, b2, _ = state.parameters[0]
    assert k3 == k4 == b1 == b2 == 0.0
    tie = replace(problem.tie, sigma_px=np.linspace(0.3, 1.2, len(problem.tie)))
    linear = linearise(tie, state.cameras, state.tie_point)
    values = values_of(problem, state)
    calibration = key("c", 0)
    values.insert(calibration, gtsam.Cal3DS2(f, f, 0.0, cx, cy, k1, k2, p1, p2))
    for i in range(0, len(tie), 3):
        x, p = key(POSE, int(tie.photograph[i])), key(TIE_POINT, int(tie.point[i]))
        noise = gtsam.noiseModel.Isotropic.Sigma(2, tie.sigma_px[i])
        factor = gtsam.GeneralSFMFactor2Cal3DS2(tie.pixel[i], noise, x, p, calibration)
        assert factor.error(values) == pytest.approx(0.5 * float(linear.residual[i] @ linear.residual[i]), rel=1e-9)
        jacobian, b = factor.linearize(values).jacobian()
        np.testing.assert_allclose(b, -linear.residual[i], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(jacobian[:, :6], linear.pose[i], rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(jacobian[:, 6:9], linear.point[i], rtol=1e-8, atol=1e-6)
        of_camera = jacobian[:, 9:]
        own = np.column_stack([of_camera[:, 0] + of_camera[:, 1], of_camera[:, 3:7], of_camera[:, 7:9]])
        np.testing.assert_allclose(own, linear.calibration[i][:, [0, 1, 2, 3, 4, 7, 8]], rtol=1e-7, atol=1e-7)


def test_linear_factors_carry_weights_units_and_free_parameters() -> None:
    problem, state = small_problem()
    tie = problem.tie
    linear = linearise(tie, state.cameras, state.tie_point)
    weight = np.random.default_rng(0).uniform(0.1, 1.0, len(tie))
    scale = calibration_scale(float(state.parameters[0, 0]))
    free = np.array([0, 3, 7])
    factors = reprojection_factors(tie, linear, weight, TIE_POINT, (free,), scale[None])
    fixed = reprojection_factors(tie, linear, weight, CONTROL_POINT, (np.zeros(0, np.int64),), scale[None])
    assert len(factors) == len(fixed) == len(tie)
    for i in range(0, len(tie), 7):
        keys = [key(TIE_POINT, int(tie.point[i])), key(POSE, int(tie.photograph[i]))]
        assert list(factors[i].keys()) == [*keys, key(CALIBRATION, 0)]
        assert list(fixed[i].keys()) == [key(CONTROL_POINT, int(tie.point[i])), keys[1]]
        jacobian, b = factors[i].jacobian()
        root = np.sqrt(weight[i])
        expected = np.hstack([linear.point[i], linear.pose[i], (linear.calibration[i] * scale)[:, free]])
        np.testing.assert_allclose(jacobian, root * expected, rtol=1e-12)
        np.testing.assert_allclose(b, -root * linear.residual[i], rtol=1e-12)
        np.testing.assert_allclose(fixed[i].jacobian()[0], root * expected[:, :9], rtol=1e-12)


def test_a_unit_of_calibration_moves_a_pixel_by_about_a_pixel() -> None:
    problem, state = small_problem()
    tie = replace(problem.tie, sigma_px=np.ones(len(problem.tie)))
    linear = linearise(tie, state.cameras, state.tie_point)
    moves = np.abs(linear.calibration * problem.scale[0]).max(axis=(0, 1))
    assert moves.max() < 2.0
    assert moves[[0, 1, 2, 3, 7, 8, 9, 10]].min() > 0.03


# ---- robust loss ----------------------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(
    s=st.floats(0.0, 60.0), angle=st.floats(0.0, 6.28), k=st.floats(0.5, 8.0),
    loss=st.sampled_from(["none", "huber", "cauchy"]),
)  # fmt: skip
def test_the_weight_is_the_slope_of_the_cost(s: float, angle: float, k: float, loss: str) -> None:
    def of(square: float) -> tuple[float, float]:
        whitened = np.sqrt(square) * np.array([[np.cos(angle), np.sin(angle)]])
        found, weight, _ = robust_terms(whitened, loss, k)  # type: ignore[arg-type]
        return float(found[0]), float(weight[0])

    square, h = s * s, 1e-5 * max(1.0, s * s)
    value, weight = of(square)
    assert 0.0 < weight <= 1.0
    assert value <= square + 1e-9
    if square > 2 * h and abs(s - k) > 1e-3:
        slope = (of(square + h)[0] - of(square - h)[0]) / (2 * h)
        assert weight == pytest.approx(slope, rel=1e-5, abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(
    x=st.floats(-20.0, 20.0), y=st.floats(-20.0, 20.0), k=st.floats(0.5, 8.0),
    loss=st.sampled_from(["none", "huber", "cauchy"]),
)  # fmt: skip
def test_steering_has_the_gradient_and_the_curvature_of_the_cost(x: float, y: float, k: float, loss: str) -> None:
    r = np.array([x, y])
    if np.linalg.norm(r) < 1e-3 or abs(np.linalg.norm(r) - k) < 1e-2:
        return

    def half_cost(at: FloatArray) -> float:
        return 0.5 * float(robust_terms(at[None], loss, k)[0][0])  # type: ignore[arg-type]

    turn, steered = (found[0] for found in steer(r[None], loss, k, 1e-9))  # type: ignore[arg-type]
    h = 1e-4
    axes = h * np.eye(2)
    gradient = np.array([half_cost(r + e) - half_cost(r - e) for e in axes]) / (2 * h)
    np.testing.assert_allclose(turn.T @ steered, gradient, rtol=1e-5, atol=1e-7)
    hessian = np.array(
        [[half_cost(r + a + b) - half_cost(r + a - b) - half_cost(r - a + b) + half_cost(r - a - b) for b in axes]
         for a in axes]
    ) / (4 * h * h)  # fmt: skip
    if robust_terms(r[None], loss, k)[2][0] >= 0:  # type: ignore[arg-type]
        np.testing.assert_allclose(turn.T @ turn, hessian, rtol=1e-4, atol=1e-5)
    else:  # bent downwards along the residual, held flat there
        across = np.array([-y, x]) / np.hypot(x, y)
        np.testing.assert_allclose(across @ turn.T @ turn @ across, across @ hessian @ across, rtol=1e-4, atol=1e-5)


def test_losses_have_the_values_of_their_formulas() -> None:
    whitened = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 2.0]])
    squared, one, _ = robust_terms(whitened, "none", 1.0)
    assert (squared.tolist(), one.tolist()) == ([0.0, 25.0, 4.0], [1.0, 1.0, 1.0])
    huber, weight, _ = robust_terms(whitened, "huber", 3.0)
    np.testing.assert_allclose(huber, [0.0, 2 * 3 * 5 - 9, 4.0])
    np.testing.assert_allclose(weight, [1.0, 0.6, 1.0])
    cauchy, weight, _ = robust_terms(whitened, "cauchy", 2.0)
    np.testing.assert_allclose(cauchy, 4 * np.log([1.0, 1 + 25 / 4, 2.0]))
    np.testing.assert_allclose(weight, [1.0, 4 / 29, 0.5])


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy"])
def test_the_gradient_of_the_graph_is_the_gradient_of_the_cost(loss: str) -> None:
    problem, state = small_problem(mismatches=0.1)
    problem = replace(problem, robust_loss=loss, robust_threshold=2.0)  # type: ignore[arg-type]
    factors = ground_factors(problem)
    system = linearise_all(problem, ground_graph(problem), state)
    gradient = system.graph.gradientAtZero()
    rng = np.random.default_rng(2)
    for variable in rng.permutation(np.array(system.variables, dtype=np.uint64))[:12].tolist():
        size = variable_size(problem, variable)
        direction = rng.standard_normal(size)
        direction *= 1e-6 / np.linalg.norm(direction)
        ends = []
        for sign in (1.0, -1.0):
            step = gtsam.VectorValues()
            for other in system.variables:
                step.insert(other, sign * direction if other == variable else np.zeros(variable_size(problem, other)))
            ends.append(cost(problem, factors, retract(problem, state, Step(step, 0.0))))
        assert (ends[0] - ends[1]) / 2 == pytest.approx(float(gradient.at(variable) @ direction), rel=1e-4, abs=1e-8)


# ---- the system -----------------------------------------------------------------------------------------------------


def test_a_damped_step_solves_marquardts_equations() -> None:
    problem, state = small_problem()
    information, right, place = whole_normal_equations(problem, state)
    system = linearise_all(problem, ground_graph(problem), state)
    assert system.variables == tuple(place)
    for damping in (1e-9, 1e-3, 10.0):
        step = damped_step(system, damping)
        expected = np.linalg.solve(information + damping * np.diag(np.diag(information)), right)
        found = np.concatenate([step.values.at(variable) for variable in place])
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())
        saved = right @ found - 0.5 * found @ information @ found
        assert step.predicted_decrease == pytest.approx(saved, rel=1e-6)


def test_a_step_of_the_whole_graph_reaches_the_minimum() -> None:
    problem, state = small_problem()
    graph, factors = ground_graph(problem), ground_factors(problem)
    costs = [cost(problem, factors, state)]
    for _ in range(6):
        state = retract(problem, state, damped_step(linearise_all(problem, graph, state), 1e-9))
        costs.append(cost(problem, factors, state))
    assert costs[-1] < 0.05 * costs[0]
    assert costs[-1] == pytest.approx(costs[-2], rel=1e-9)
    _, right, _ = whole_normal_equations(problem, state)
    assert np.abs(right).max() < 1e-2
    np.testing.assert_allclose(
        state.rotation @ np.swapaxes(state.rotation, 1, 2), np.eye(3)[None].repeat(6, 0), atol=1e-12
    )


def test_sigmas_lie_along_the_axes_of_the_map() -> None:
    # A metre along the second axis, of sigma 4, weighs a sixteenth of a metre along the first.
    axes = Rotation.from_euler("z", 30.0, degrees=True).as_matrix()
    factor = native(surveyed_position(0, np.zeros(3), np.array([1.0, 4.0, 2.0]), axes))
    for column, sigma in zip(axes.T, (1.0, 4.0, 2.0), strict=True):
        values = gtsam.Values()
        values.insert(key(CONTROL_POINT, 0), column)
        assert factor.error(values) == pytest.approx(0.5 / sigma**2)


def test_an_attitude_without_a_sigma_is_no_observation() -> None:
    problem, _ = small_problem()
    photographs = problem.block.photographs
    assert photographs[0].attitude_world_from_camera is not None

    def observations(first: Photograph) -> int:
        block = replace(problem.block, photographs=(first, *photographs[1:]))
        return sum(len(factors.variables) for factors in ground_factors(replace(problem, block=block)))

    unmeasured = replace(photographs[0], attitude_world_from_camera=None, attitude_sigma_rad=None)
    assert observations(replace(photographs[0], attitude_sigma_rad=None)) == observations(unmeasured)
    assert observations(photographs[0]) == observations(unmeasured) + 1
