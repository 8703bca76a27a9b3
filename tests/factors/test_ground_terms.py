"""Factors between several variables: the fast engine against GTSAM's graph, and scale bars against the truth."""

from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from makers import joint_control_points, problem_of, simulated
from referees import of_gtsam, whole_covariance

from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.reliability import reliability
from photogram.arrays import FloatArray
from photogram.factors.covariance import covariances, mark_covariances, predicted_marks
from photogram.factors.elimination.reduced import NormalEquations
from photogram.factors.elimination.reprojection import linearise
from photogram.factors.elimination.state import State
from photogram.factors.functionals import factored, functions_of_border
from photogram.factors.graph import IndeterminateError, Problem, cost, ground_factors
from photogram.factors.ground_terms import GroundTerms, bundle_of, variable_at
from photogram.factors.joint_covariance import joint_ground_covariance
from photogram.factors.reference.graph import ground_graph, ground_values
from photogram.factors.variables import CALIBRATION, CONTROL_POINT, GNSS_OFFSET, POSE, TIE_POINT, key
from photogram.projection import PARAMETERS
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=6, check_points=2, flights=2,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, np.inf, 0.0, 0.0),
)  # fmt: skip
LONG = replace(
    PLAN, strips=1, flights=1, photographs_per_strip=14, control_points=8, check_points=0, forward_overlap=0.6
)


def noise(sigma: float, rows: int) -> gtsam.noiseModel.Base:
    return gtsam.noiseModel.Isotropic.Sigma(rows, sigma)


def difference(problem: Problem) -> gtsam.NonlinearFactor:
    """The vector between two control points, 5 cm off what their surveys say."""
    vector = problem.control_world_m[1] - problem.control_world_m[0] + 0.05
    return gtsam.BetweenFactorPoint3(key(CONTROL_POINT, 0), key(CONTROL_POINT, 1), vector, noise(0.002, 3))


def distance(
    problem: Problem, a: int = 0, b: int = 1, off_m: float = 0.05, sigma_m: float = 0.002
) -> gtsam.RangeFactor3:
    length = float(np.linalg.norm(problem.control_world_m[a] - problem.control_world_m[b])) + off_m
    return gtsam.RangeFactor3(key(CONTROL_POINT, a), key(CONTROL_POINT, b), length, noise(sigma_m, 1))


def two_poses(problem: Problem) -> gtsam.NonlinearFactor:
    """The last photograph seen from the first, as a rigid rig would have it."""
    poses = [pose for pose in problem.block.poses if pose is not None]
    count = len(poses)
    ends = poses[0], poses[-1]
    first, last = (gtsam.Pose3(gtsam.Rot3(p.rotation_world_from_camera), p.position_world_m) for p in ends)
    return gtsam.BetweenFactorPose3(key(POSE, 0), key(POSE, count - 1), first.between(last), noise(0.01, 6))


def pose_to_point(problem: Problem) -> gtsam.NonlinearFactor:
    """The distance of a photograph from a control point."""
    pose = problem.block.poses[2]
    assert pose is not None
    length = float(np.linalg.norm(pose.position_world_m - problem.control_world_m[3]))
    return gtsam.RangeFactor3D(key(POSE, 2), key(CONTROL_POINT, 3), length, noise(0.05, 1))


def point_and_offset(problem: Problem) -> gtsam.NonlinearFactor:
    """The height of a control point above that of a flight's base station."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        point, offset = (values.atPoint3(variable) for variable in factor.keys())  # noqa: SIM118
        if jacobians is not None:
            jacobians[0], jacobians[1] = np.eye(3)[2:], -np.eye(3)[2:]
        return np.asarray([point[2] - offset[2] - problem.control_world_m[4, 2] - 0.1])

    return gtsam.CustomFactor(noise(0.02, 1), [key(CONTROL_POINT, 4), key(GNSS_OFFSET, 1)], error)


def many(problem: Problem) -> tuple[gtsam.NonlinearFactor, ...]:
    return difference(problem), distance(problem, 1, 5), two_poses(problem), pose_to_point(problem)


Making = Callable[[Problem], gtsam.NonlinearFactor | tuple[gtsam.NonlinearFactor, ...]]
FACTORS = [difference, distance, two_poses, pose_to_point, point_and_offset, many]


def joined(making: Making, plan: SurveyPlan = PLAN) -> tuple[Problem, State]:
    problem, state = problem_of(simulated(plan, off=0.3).block)
    made = making(problem)
    return replace(problem, further=tuple(map(of_gtsam, made if isinstance(made, tuple) else (made,)))), state


def assert_equal(found: FloatArray, expected: FloatArray) -> None:
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=1e-6)


@pytest.mark.parametrize("solver", ["banded", "gtsam"])
@pytest.mark.parametrize("making", FACTORS)
def test_both_engines_reach_the_same_minimum_by_the_same_steps(making: Making, solver: str) -> None:
    problem, start = joined(making)
    without = minimise(replace(problem, further=()), start, AdjustmentSettings())
    fast, slow = (
        minimise(problem, start, AdjustmentSettings(engine=engine, solver=solver))  # type: ignore[arg-type]
        for engine in ("fast", "reference")
    )
    assert (fast.iterations, fast.converged) == (slow.iterations, slow.converged) == (fast.iterations, True)
    assert fast.cost == pytest.approx(slow.cost, rel=1e-9)
    assert fast.cost == pytest.approx(cost(problem, ground_factors(problem), fast.state), rel=1e-12)
    for name in ("rotation", "position", "parameters", "tie_point", "control", "offset"):
        np.testing.assert_allclose(getattr(fast.state, name), getattr(slow.state, name), rtol=1e-8, atol=1e-7)
    moved = (
        np.abs(fast.state.position - without.state.position).max(),
        np.abs(fast.state.control - without.state.control).max(),
    )
    assert max(moved) > 1e-4  # a factor that changes nothing proves nothing


@pytest.mark.parametrize("plan", [PLAN, LONG], ids=["dense", "band"])
@pytest.mark.parametrize("making", [difference, distance, two_poses, pose_to_point, many])
def test_covariances_are_the_inverse_of_the_whole_normal_matrix(making: Making, plan: SurveyPlan) -> None:
    problem, start = joined(making, plan)
    state = minimise(problem, start, AdjustmentSettings()).state
    expected, place = whole_covariance(problem, state)
    found = covariances(problem, state)
    for i in range(len(problem.block.photographs)):
        where = place[key(POSE, i)]
        assert_equal(found.pose(i), expected[where, where])
    for g in range(len(problem.control_world_m)):
        where = place[key(CONTROL_POINT, g)]
        assert_equal(found.control_point[g], expected[where, where])
    for p in range(0, len(state.tie_point), 17):
        where = place[key(TIE_POINT, p)]
        assert_equal(found.tie_point[p], expected[where, where])
    for f in range(len(problem.flights)):
        where = place[key(GNSS_OFFSET, f)]
        assert_equal(found.offset(f), expected[where, where])
    rows = np.concatenate([np.r_[place[key(CONTROL_POINT, g)]] for g in range(len(problem.control_world_m))])
    joint = joint_control_points(problem, state, found)
    assert_equal(joint, expected[np.ix_(rows, rows)])
    free, unit = problem.free[0], problem.scale[0][problem.free[0]]
    calibration, where = found.calibration(0)[np.ix_(free, free)] / np.outer(unit, unit), place[key(CALIBRATION, 0)]
    assert_equal(calibration, expected[where, where])
    everything = functions_of_border(found.layout).covariance(factored(problem, state))
    assert everything.shape == (PARAMETERS + 3 * len(problem.flights),) * 2
    np.testing.assert_allclose(everything[:PARAMETERS, :PARAMETERS], found.calibration(0), rtol=1e-6, atol=1e-18)


def test_marks_of_coupled_points_have_the_covariance_of_the_whole_normal_matrix() -> None:
    problem, start = joined(many)
    state = minimise(problem, start, AdjustmentSettings()).state
    expected, place = whole_covariance(problem, state)
    found, marks = covariances(problem, state), problem.marks
    adjusted = mark_covariances(problem, state, found)
    pixel, predicted = predicted_marks(problem, state, found, marks.photograph, marks.point)
    np.testing.assert_allclose(predicted, adjusted * marks.sigma_px[:, None, None] ** 2, rtol=1e-9)
    linear = linearise(marks, state.cameras, state.control)
    np.testing.assert_allclose(pixel - marks.pixel, linear.residual * marks.sigma_px[:, None], atol=1e-9)
    free = problem.free[0]
    for i, (photograph, point) in enumerate(zip(marks.photograph.tolist(), marks.point.tolist(), strict=True)):
        J = np.zeros((2, len(expected)))
        J[:, place[key(POSE, photograph)]] = linear.pose[i]
        J[:, place[key(CONTROL_POINT, point)]] = linear.point[i]
        J[:, place[key(CALIBRATION, 0)]] = (linear.calibration[i] * problem.scale[0])[:, free]
        assert_equal(adjusted[i], J @ expected @ J.T)
    tested = reliability(problem, state, found)
    r = tested.ground_redundancy[np.array(problem.block.control_points.role) == "control"]
    sigma, axes = problem.control_sigma_m, problem.control_axes
    for g in range(len(r)):
        where = place[key(CONTROL_POINT, g)]
        along = np.diag(axes[g].T @ expected[where, where] @ axes[g])
        np.testing.assert_allclose(r[g], 1.0 - along / sigma[g] ** 2, rtol=0, atol=1e-6)


def test_check_points_follow_what_coupled_points_tell_the_cameras() -> None:
    problem, start = joined(distance)
    state = minimise(problem, start, AdjustmentSettings()).state
    found, points = covariances(problem, state), problem.block.control_points
    ground = points.position_world_m.copy()
    controls = np.array(points.role) == "control"
    ground[controls] = state.control
    joint = joint_ground_covariance(problem, state, found, ground)
    rows = (3 * np.flatnonzero(controls)[:, None] + np.arange(3)).ravel()
    assert_equal(joint[np.ix_(rows, rows)], joint_control_points(problem, state, found))
    sigma = np.sqrt(np.diag(joint))
    assert np.all(np.linalg.eigvalsh(joint / np.outer(sigma, sigma)) > 0)


@pytest.mark.parametrize("making", FACTORS)
def test_ground_terms_are_the_linear_graph_of_gtsam(making: Making) -> None:
    problem, state = joined(making)
    problem = replace(problem, marks=problem.marks.select(np.zeros(len(problem.marks), bool)))
    bundle = bundle_of(problem, state)
    layout, normal = bundle.layout, NormalEquations.zero(bundle.layout)
    terms = bundle.ground.linearise(state)
    terms.add_to(normal)
    graph, values, ordering = ground_graph(problem), ground_values(problem, state), gtsam.Ordering()
    assert terms.cost == pytest.approx(graph.error(values), rel=1e-12)
    names = [variable_at(layout, c) for c in range(layout.columns + layout.border)]
    for kind, index in dict.fromkeys(names):
        ordering.push_back(key(kind, index))
    eliminated = [g for g in range(len(state.control)) if g not in layout.coupled]
    for g in eliminated:
        ordering.push_back(key(CONTROL_POINT, g))
    information, right = graph.linearize(values).hessian(ordering)
    m, size = layout.columns, layout.columns + layout.border
    A = normal.damped_poses(0.0)
    found = np.zeros((size, size))
    for c in range(m):
        rows = np.arange(c, m if layout.dense else min(m, c + layout.stride + 1))
        found[rows, c] = found[c, rows] = A[c * layout.stride + rows]
    found[:m, m:], found[m:, :m], found[m:, m:] = normal.B, normal.B.T, normal.E
    np.testing.assert_allclose(found, information[:size, :size], rtol=1e-10, atol=1e-6)
    np.testing.assert_allclose(np.concatenate([normal.g, normal.h]), np.ravel(right)[:size], rtol=1e-10, atol=1e-6)
    np.testing.assert_allclose(np.concatenate([normal.D, normal.F]), np.diag(found), rtol=1e-12)
    for k, g in enumerate(eliminated):
        own = slice(size + 3 * k, size + 3 * k + 3)
        np.testing.assert_allclose(terms.control[g], information[own, own], rtol=1e-12, atol=1e-9)
    assert not terms.control[layout.coupled].any()


def test_nothing_is_coupled_where_every_factor_has_one_variable() -> None:
    problem, state = problem_of(simulated(PLAN, off=0.3).block)
    layout = bundle_of(problem, state).layout
    assert len(layout.coupled) == 0
    assert layout.ground_column == layout.border
    assert len(GroundTerms(problem, layout).linearise(state).between) == 0


def test_a_factor_between_two_photographs_widens_the_band_to_both() -> None:
    problem, state = joined(two_poses, LONG)
    layout, before = bundle_of(problem, state).layout, bundle_of(replace(problem, further=()), state).layout
    assert not before.dense
    assert np.ptp(layout.place[[0, 13]]) <= layout.reach
    with pytest.raises(ValueError, match=r"joins photographs 13 places apart: beyond the band"):
        GroundTerms(problem, before)


def test_what_a_layout_has_no_place_for_is_an_error() -> None:
    problem, state = problem_of(simulated(PLAN, off=0.3).block)
    layout = bundle_of(problem, state).layout
    with pytest.raises(ValueError, match="joins control point 0 to another variable"):
        GroundTerms(replace(problem, further=(of_gtsam(difference(problem)),)), layout)
    prior = gtsam.PriorFactorPoint3(key(TIE_POINT, 7), np.zeros(3), noise(1.0, 3))
    with pytest.raises(ValueError, match="a factor on tie point 7: only rays know tie points"):
        bundle_of(replace(problem, further=(of_gtsam(prior),)), state)


def test_a_coupled_point_that_nothing_fixes_is_named() -> None:
    problem, state = joined(distance)
    sigma = problem.control_sigma_m.copy()
    sigma[1] = np.inf
    adrift = replace(problem, control_sigma_m=sigma, marks=problem.marks.select(problem.marks.point != 1))
    with pytest.raises(IndeterminateError) as fault:
        covariances(adrift, state)
    assert fault.value.variable == (CONTROL_POINT, 1)


# ---- scale bars against the truth ------------------------------------------------------------------------------------

BARS = ((0, 1), (2, 3), (1, 4))


def scaled_survey() -> tuple[SimulatedBlock, Problem, State]:
    """A block without GNSS whose control points, known to 3 m, are all too far apart by a thousandth."""
    made = simulate_block(
        replace(PLAN, calibration_sigmas=(0.0,) * 11, check_points=0), 2, tie_points=150, start_position_sigma_m=0.3,
        start_attitude_sigma_deg=0.3, start_point_sigma_m=0.3,
    )  # fmt: skip
    photographs = tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in made.block.photographs)
    problem = make_problem(
        replace(made.block, photographs=photographs, cameras=(made.truth.camera,)), AdjustmentSettings()
    )
    truth = made.truth.control_position_world_m
    wrong = truth.mean(axis=0) + 1.001 * (truth - truth.mean(axis=0))
    problem = replace(problem, control_world_m=wrong, control_sigma_m=np.full_like(wrong, 3.0))
    return made, problem, replace(start_state(problem), control=wrong)


def lengths(points: FloatArray) -> FloatArray:
    first, second = np.triu_indices(len(points), 1)
    return np.asarray(np.linalg.norm(points[first] - points[second], axis=1))


def test_scale_bars_give_a_block_its_true_scale() -> None:
    made, problem, start = scaled_survey()
    truth, rng = made.truth.control_position_world_m, np.random.default_rng(5)
    sigma_m = 0.001
    bars = tuple(
        gtsam.RangeFactor3(
            key(CONTROL_POINT, a), key(CONTROL_POINT, b),
            float(np.linalg.norm(truth[a] - truth[b]) + rng.normal(0, sigma_m)), noise(sigma_m, 1),
        )
        for a, b in BARS
    )  # fmt: skip
    true = lengths(truth)
    without = minimise(problem, start, AdjustmentSettings()).state
    scale = np.median(lengths(without.control) / true)
    assert scale == pytest.approx(1.001, abs=2e-4)
    measured = replace(problem, further=tuple(map(of_gtsam, bars)))
    state = minimise(measured, start, AdjustmentSettings()).state
    assert np.median(lengths(state.control) / true) == pytest.approx(1.0, abs=1e-4)
    joint = joint_control_points(measured, state, covariances(measured, state))
    first, second = np.triu_indices(len(truth), 1)
    J = np.zeros((len(first), joint.shape[0]))
    for i, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        along = (state.control[a] - state.control[b]) / np.linalg.norm(state.control[a] - state.control[b])
        J[i, 3 * a : 3 * a + 3], J[i, 3 * b : 3 * b + 3] = along, -along
    sigma = np.sqrt(np.diag(J @ joint @ J.T))
    error = lengths(state.control) - true
    assert np.all(np.abs(error) < 4.0 * sigma)
    of_bars = [i for i, pair in enumerate(zip(first.tolist(), second.tolist(), strict=True)) if pair in BARS]
    assert np.all(sigma[of_bars] < sigma_m)


def test_an_adjusted_point_follows_a_scale_bar_as_its_covariance_says() -> None:
    """dX = Σ Jᵀ dl / σ², the response to a change of one observation, against two adjustments."""
    _, problem, start = scaled_survey()
    at, step = [], 1e-3
    for off in (-step, step):
        bar = distance(problem, 0, 3, off, sigma_m=0.01)
        found = minimise(
            replace(problem, further=(of_gtsam(bar),), robust_loss="none"),
            start,
            AdjustmentSettings(relative_tolerance=1e-13),
        )
        at.append(found.state)
    measured = replace(problem, further=(of_gtsam(distance(problem, 0, 3, 0.0, sigma_m=0.01)),), robust_loss="none")
    state = minimise(measured, at[0], AdjustmentSettings(relative_tolerance=1e-13)).state
    joint = joint_control_points(measured, state, covariances(measured, state))
    along = (state.control[0] - state.control[3]) / np.linalg.norm(state.control[0] - state.control[3])
    J = np.zeros(joint.shape[0])
    J[0:3], J[9:12] = along, -along
    expected = (joint @ J / 0.01**2).reshape(-1, 3)
    response = (at[1].control - at[0].control) / (2 * step)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(response, expected, rtol=0, atol=1e-3 * np.abs(expected).max())


def test_both_engines_agree_on_given_relative_poses_as_stiff_as_the_body_of_a_rig() -> None:
    """0.1 mm and 1e-6 rad between each two photographs: no worse conditioned than the engines bear."""
    made = simulated(SurveyPlan(strips=2, photographs_per_strip=4, control_points=6, check_points=2))
    true = [gtsam.Pose3(gtsam.Rot3(p.rotation_world_from_camera), p.position_world_m) for p in made.truth.poses]
    stiff = gtsam.noiseModel.Diagonal.Sigmas(np.array([1e-6] * 3 + [1e-4] * 3))
    pairs = [(i, i + 1) for i in range(0, 8, 2)]
    given = tuple(
        gtsam.BetweenFactorPose3(key(POSE, i), key(POSE, j), true[i].between(true[j]), stiff) for i, j in pairs
    )
    settings = AdjustmentSettings(robust_loss="none")
    problem = replace(make_problem(made.block, settings), further=tuple(map(of_gtsam, given)))
    start = start_state(problem)
    fast, referee = (minimise(problem, start, replace(settings, engine=e)).state for e in ("fast", "reference"))
    np.testing.assert_allclose(fast.position, referee.position, atol=1e-9)
    for i, j in pairs:
        first, second = (gtsam.Pose3(gtsam.Rot3(fast.rotation[n]), fast.position[n]) for n in (i, j))
        held = true[i].between(true[j]).localCoordinates(first.between(second))
        assert np.all(np.abs(held) < 4.0 * np.array([1e-6] * 3 + [1e-4] * 3))
