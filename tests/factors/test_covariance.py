from dataclasses import replace

import gtsam
import numpy as np
import pytest
from makers import FREE, SMALL, joint_control_points, problem_of, small_problem
from referees import whole_covariance

from photogram.factors.covariance import Covariances, _open, covariances, joint_marks, predicted_marks
from photogram.factors.datum import SCALE, SHIFT, TURN, datum_of
from photogram.factors.elimination.points import first_observations
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem, cost, ground_factors
from photogram.factors.reference.graph import damped_step, ground_graph, ground_values, linearise_all
from photogram.factors.variables import (
    CALIBRATION,
    COMMON_ERROR,
    CONTROL_POINT,
    DATUM,
    GNSS_OFFSET,
    POSE,
    TIE_POINT,
    key,
    kind_and_index,
)
from photogram.simulation.simulated_survey import simulate_block


def assert_equal_blocks(found: np.ndarray, expected: np.ndarray) -> None:
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=1e-6)


def blocks(problem: Problem, found: Covariances) -> dict[int, np.ndarray]:
    """All covariances by their variable; calibrations of free parameters in the units of their variable."""
    covariance = {key(POSE, i): found.pose(i) for i in range(len(problem.block.photographs))}
    covariance |= {key(CONTROL_POINT, g): found.control_point[g] for g in range(len(problem.control_world_m))}
    covariance |= {key(GNSS_OFFSET, f): found.offset(f) for f in range(len(problem.flights))}
    covariance |= {key(COMMON_ERROR, e): found.common(e) for e in range(len(problem.block.common_errors))}
    covariance |= {key(TIE_POINT, p): V for p, V in enumerate(found.tie_point)}
    for c, free in enumerate(problem.free):
        if len(free):
            unit = problem.scale[c][free]
            covariance[key(CALIBRATION, c)] = found.calibration(c)[np.ix_(free, free)] / np.outer(unit, unit)
    return covariance


@pytest.mark.parametrize("loss", ["none", "huber"])
def test_covariances_are_the_inverse_of_the_whole_normal_matrix(loss: str) -> None:
    problem, state = small_problem(mismatches=0.05)
    problem = replace(problem, robust_loss=loss)  # type: ignore[arg-type]
    inverse, place = whole_covariance(problem, state)
    found = blocks(problem, covariances(problem, state))
    assert set(found) == set(place)
    kinds = {POSE, TIE_POINT, CONTROL_POINT, GNSS_OFFSET, COMMON_ERROR, CALIBRATION}
    assert {kind_and_index(v)[0] for v in found} == kinds
    for variable, where in place.items():
        assert_equal_blocks(found[variable], inverse[where, where])


def test_control_points_have_the_joint_covariance_of_the_whole_normal_matrix() -> None:
    problem, state = small_problem()
    inverse, place = whole_covariance(problem, state)
    rows = np.concatenate([np.r_[place[key(CONTROL_POINT, g)]] for g in range(len(problem.control_world_m))])
    found = covariances(problem, state)
    joint = joint_control_points(problem, state, found)
    assert_equal_blocks(joint, inverse[np.ix_(rows, rows)])
    for g in range(len(problem.control_world_m)):
        assert_equal_blocks(found.control_point[g], joint[3 * g : 3 * g + 3, 3 * g : 3 * g + 3])


def test_gtsams_marginals_of_the_linear_graph_are_the_same() -> None:
    problem, state = small_problem()
    system = linearise_all(problem, ground_graph(problem), state, 1.0)
    marginals = gtsam.Marginals(system.graph, gtsam.VectorValues.Zero(damped_step(system, 1e-9).values))
    for variable, covariance in blocks(problem, covariances(problem, state)).items():
        assert_equal_blocks(covariance, marginals.marginalCovariance(variable))


def test_gtsams_own_factors_give_the_same_covariances() -> None:
    """With the calibration held and no k3, GTSAM's factors build the whole graph without photogram's Jacobians."""
    made = simulate_block(
        replace(SMALL, radial=(-0.08, 0.06, 0.0, 0.0), calibration_sigmas=(0.0,) * 11), 5, tie_points=40,
        start_position_sigma_m=0.02, start_attitude_sigma_deg=0.05, start_point_sigma_m=0.02,
    )  # fmt: skip
    problem, state = problem_of(made.block)
    f, cx, cy, k1, k2, _, _, p1, p2, _, _, _ = state.parameters[0]
    calibration = gtsam.Cal3DS2(f, f, 0.0, cx, cy, k1, k2, p1, p2)
    graph = ground_graph(problem)
    for marks, kind in ((problem.tie, TIE_POINT), (problem.marks, CONTROL_POINT)):
        for i in range(len(marks)):
            noise = gtsam.noiseModel.Isotropic.Sigma(2, marks.sigma_px[i])
            x, p = key(POSE, int(marks.photograph[i])), key(kind, int(marks.point[i]))
            graph.add(gtsam.GenericProjectionFactorCal3DS2(marks.pixel[i], noise, x, p, calibration))
    values = ground_values(problem, state)
    for p, X in enumerate(state.tie_point):
        values.insert(key(TIE_POINT, p), X)
    assert graph.error(values) == pytest.approx(cost(problem, ground_factors(problem), state), rel=1e-9)
    marginals = gtsam.Marginals(graph, values)
    found = blocks(problem, covariances(problem, state))
    assert len(found) == 6 + 6 + 2 + len(problem.block.common_errors) + 40
    for variable, covariance in found.items():
        assert_equal_blocks(covariance, marginals.marginalCovariance(variable))


def test_fixed_parameters_have_no_covariance() -> None:
    problem, state = small_problem()
    calibration = covariances(problem, state).calibration(0)
    assert np.flatnonzero(np.diag(calibration)).tolist() == [0, 1, 2, 3, 7, 8]
    assert not calibration[[4, 5]].any()
    assert np.all(np.sqrt(np.diag(calibration))[[0, 1, 2, 3, 7]] < np.array(FREE)[[0, 1, 2, 3, 7]])


# ---- what cannot be solved ------------------------------------------------------------------------------------------


def with_ties(problem: Problem, keep: np.ndarray) -> Problem:
    return problem.with_tie_observations(problem.tie.select(keep))


def floating(problem: Problem, photograph: int) -> Problem:
    """The problem with one photograph that nothing holds: no rays, no marks, no measured position or attitude."""
    free = replace(
        problem.block.photographs[photograph], gnss_world_m=None, gnss_sigma_m=None,
        attitude_world_from_camera=None, attitude_sigma_rad=None,
    )  # fmt: skip
    photographs = tuple(free if i == photograph else p for i, p in enumerate(problem.block.photographs))
    block = replace(problem.block, photographs=photographs)
    marks = problem.marks.select(problem.marks.photograph != photograph)
    rays = problem.tie.photograph != photograph
    enough = np.bincount(problem.tie.point[rays], minlength=40)[problem.tie.point] >= 2
    return replace(problem, block=block, marks=marks, tie=problem.tie.select(rays & enough))


def both_name(problem: Problem, state: State, expected: tuple[str, int]) -> None:
    with pytest.raises(IndeterminateError) as fault:
        damped_step(linearise_all(problem, ground_graph(problem), state, 1.0), 0.0)
    assert fault.value.variable == expected
    with pytest.raises(IndeterminateError) as fault:
        covariances(problem, state)
    assert fault.value.variable == expected


@pytest.mark.parametrize("photograph", [0, 4])
def test_a_photograph_that_nothing_holds_is_named(photograph: int) -> None:
    problem, state = small_problem()
    lonely = floating(problem, photograph)
    used = np.unique(lonely.tie.point)
    number = np.searchsorted(used, lonely.tie.point).astype(np.int64)
    lonely = lonely.with_tie_observations(replace(lonely.tie, point=number))
    both_name(lonely, replace(state, tie_point=state.tie_point[used]), (POSE, photograph))


def test_a_tie_point_with_one_ray_is_named() -> None:
    problem, state = small_problem()
    first = first_observations(problem.tie.point, 40)
    keep = np.ones(len(problem.tie), dtype=bool)
    keep[first[17] + 1 : first[18]] = False
    both_name(with_ties(problem, keep), state, (TIE_POINT, 17))


def test_a_control_point_without_marks_is_held_by_its_survey() -> None:
    problem, state = small_problem()
    unmarked = replace(problem, marks=problem.marks.select(problem.marks.point != 2))
    found = covariances(unmarked, state).control_point[2]
    np.testing.assert_allclose(found, np.diag(problem.control_sigma_m[2] ** 2), rtol=1e-9, atol=1e-13)


def test_a_parameter_that_no_photograph_can_tell_is_named() -> None:
    problem, state = small_problem()
    unused = replace(problem.block.cameras[0], name="unused", sigmas=np.array([np.inf] + [0.0] * 11))
    two = replace(problem, block=replace(problem.block, cameras=(*problem.block.cameras, unused)))
    cameras = state.cameras._replace(
        model=np.zeros(2, np.int64), parameters=np.tile(state.parameters, (2, 1)),
        largest_radius=np.tile(state.cameras.largest_radius, 2), size_px=np.tile(state.cameras.size_px, (2, 1)),
    )  # fmt: skip
    both_name(two, replace(state, cameras=cameras), (CALIBRATION, 1))


def test_a_block_without_any_datum_is_not_solved() -> None:
    problem, state = small_problem(sigmas=(0.0,) * 11)
    photographs = tuple(
        replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for p in problem.block.photographs
    )
    none = np.zeros((0, 3))
    adrift = replace(
        problem, block=replace(problem.block, photographs=photographs), flights=(),
        marks=problem.marks.select(np.zeros(len(problem.marks), bool)), control_world_m=none, control_sigma_m=none,
    )  # fmt: skip
    with pytest.raises(IndeterminateError) as fault:
        covariances(adrift, replace(state, control=none, offset=none))
    assert fault.value.variable is not None
    assert fault.value.variable[0] == DATUM


def test_what_is_open_is_a_camera_where_the_block_goes_along_by_a_tenth() -> None:
    problem, state = small_problem()
    layout = covariances(problem, state).layout
    whole, scale = datum_of(layout, state, 40.0), np.ones(layout.columns + layout.border)
    shift = whole.directions[:, 0] / np.linalg.norm(whole.directions[:, 0])
    focal = np.zeros(len(shift))
    focal[layout.columns] = 1.0
    assert _open(layout, shift, scale, whole).variable == (DATUM, SHIFT)
    assert _open(layout, shift + 0.1 * focal, scale, whole).variable == (DATUM, SHIFT)
    assert _open(layout, 0.1 * shift + focal, scale, whole).variable == (CALIBRATION, 0)


def test_turns_and_the_scale_are_about_the_middle_of_the_block() -> None:
    """Of a block that lies far from the origin."""
    problem, state = small_problem()
    layout = covariances(problem, state).layout
    position = state.position + np.array([1000.0, -2000.0, 300.0])
    far = replace(state, cameras=state.cameras._replace(position=position))
    whole, off = datum_of(layout, far, 40.0), position - position.mean(axis=0)
    for part, moved, turned in ((SCALE, off, np.zeros(3)), (TURN, np.cross([0.0, 0.0, 1.0], off), np.array([0, 0, 1]))):
        change = np.zeros(layout.columns + layout.border)
        for i, R in enumerate(state.rotation):
            at = 6 * layout.place[i]
            change[at : at + 6] = np.concatenate([R.T @ turned, R.T @ moved[i]])
        assert whole.share(change) == pytest.approx(1.0)
        assert whole.main_part(change) == part
        np.testing.assert_allclose(whole.directions[:, :3].T @ (whole.metric * change), 0.0, atol=1e-6)


def test_marks_predicted_together_have_the_covariances_of_each() -> None:
    problem, state = small_problem()
    known = covariances(problem, state)
    photograph, point = problem.marks.photograph[:9], problem.marks.point[:9]
    joint = joint_marks(problem, state, known, photograph, point)
    pixel, single = predicted_marks(problem, state, known, photograph, point)
    np.testing.assert_array_equal(joint.pixel, pixel)
    blocks = joint.covariance.reshape(9, 2, 9, 2)
    np.testing.assert_allclose(blocks[range(9), :, range(9)], single, rtol=1e-9, atol=1e-12 * single.max())
    np.testing.assert_allclose(joint.covariance, joint.covariance.T, rtol=0, atol=1e-9 * single.max())
    assert np.linalg.eigvalsh(joint.covariance)[0] > 0.0
