"""Redundancy numbers, tests of measurements, points left out, and blunders that must be found and named."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from makers import LEAST_SQUARES, simulated
from scipy.spatial.transform import Rotation
from scipy.stats import kstest
from seeds import seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.adjustment.reliability import NONCENTRALITY, left_out, minimal_detectable_blunder, reliability, w_tests
from photogram.arrays import FloatArray
from photogram.factors.covariance import covariances
from photogram.factors.reference.graph import ground_graph, linearise_all
from photogram.factors.variables import CONTROL_POINT, GNSS_OFFSET, POSE, kind_and_index
from photogram.quality.accuracy import suspects
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=6, check_points=3, gnss_offset_sigma_m=(0.3, 0.3, 0.5),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip


def adjusted(seed: int) -> Adjustment:
    return adjust(simulated(PLAN, seed).block, LEAST_SQUARES)


def test_redundancy_numbers_are_those_of_the_whole_linear_system_and_sum_to_the_redundancy() -> None:
    survey = simulated(replace(PLAN, flights=2), 1).block
    problem = make_problem(survey, AdjustmentSettings(robust_loss="none"))
    state = start_state(problem)
    graph = ground_graph(problem)
    system = linearise_all(problem, graph, state)
    ordering = gtsam.Ordering()
    for variable in system.variables:
        ordering.push_back(variable)
    J = np.array(system.graph.jacobian(ordering)[0])
    own = np.einsum("ij,ji->i", J, np.linalg.pinv(J))
    unknowns = J.shape[1]
    assert np.sum(1.0 - own) == pytest.approx(len(J) - unknowns, abs=1e-6)
    found = reliability(problem, state, covariances(problem, state))
    row, expected = 0, {"ground": [], "gnss": [], "marks": []}  # type: ignore[var-annotated]
    ties = 2 * len(problem.tie)
    for i in range(graph.size()):
        kinds = {kind_and_index(v)[0] for v in graph.at(i).keys()}  # noqa: SIM118
        rows = 1.0 - own[row : row + graph.at(i).dim()]
        row += graph.at(i).dim()
        if kinds == {CONTROL_POINT}:
            expected["ground"].append(rows)
        elif kinds == {POSE, GNSS_OFFSET}:
            expected["gnss"].append(rows)
    marks = 1.0 - own[row : row + 2 * len(problem.marks)].reshape(-1, 2)
    assert row + 2 * len(problem.marks) + ties == len(J)
    role = np.array(problem.block.control_points.role)
    of_control = role[problem.block.control_points.mark_point] == "control"
    # rows of the graph may be turned against the map's axes, which leaves the sum of three
    for mine, theirs in (
        (found.ground_redundancy[role == "control"], expected["ground"]),
        (found.gnss_redundancy, expected["gnss"]),
    ):
        np.testing.assert_allclose(mine.sum(axis=1), np.array(theirs).sum(axis=1), rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.mark_redundancy[of_control], marks, rtol=0, atol=1e-7)
    assert np.isnan(found.ground_redundancy[role == "check"]).all()
    assert np.isnan(found.mark_w[~of_control]).all()


def test_a_point_left_out_is_predicted_as_by_an_adjustment_without_it() -> None:
    settings = replace(LEAST_SQUARES, relative_tolerance=1e-12)
    survey = simulated(PLAN, 3).block
    whole = adjust(survey, settings)
    points, axes = survey.control_points, survey.frame.rotation_world_from_map(np.zeros(3))
    controls = [g for g, role in enumerate(points.role) if role == "control"]
    for g in controls:
        sigma = points.sigma_m.copy()
        sigma[g] = 1e4
        without = adjust(replace(survey, control_points=replace(points, sigma_m=sigma)), settings)
        expected = axes.T @ (without.estimates.ground_world_m[g] - points.position_world_m[g])
        spread = np.sqrt(np.diag(whole.tests.reliability.ground_left_out_covariance_m2[g]))
        np.testing.assert_array_less(np.abs(whole.tests.reliability.ground_left_out_m[g] - expected), 0.01 * spread)
        predicted = axes.T @ without.covariances.ground_m2[g] @ axes + np.diag(points.sigma_m[g] ** 2)
        np.testing.assert_allclose(np.diag(predicted), spread**2, rtol=0.01)


def test_without_blunders_w_is_standard_normal() -> None:
    groups: dict[str, list[FloatArray]] = {"ground": [], "mark": [], "gnss": []}
    for seed in seeds(30):
        r = adjusted(seed).tests.reliability
        for name, values in groups.items():
            w = getattr(r, f"{name}_w")
            values.append(w[np.isfinite(w)])
    for name, values in groups.items():
        assert kstest(np.concatenate(values), "norm").pvalue > 0.01, name


def spoilt(survey: Block, kind: str, times: float, rng: np.random.Generator) -> tuple[Block, str]:
    """The survey with a blunder of so many minimal detectable ones, and the name of what it is in."""
    points, clean = survey.control_points, adjust(survey, AdjustmentSettings())
    r, controls = clean.tests.reliability, [g for g, role in enumerate(points.role) if role == "control"]
    if kind == "mark":
        m = int(rng.choice(np.flatnonzero(np.isin(points.mark_point, controls))))
        mdb = minimal_detectable_blunder(np.full(2, points.mark_sigma_px[m]), r.mark_redundancy[m])
        axis, pixel = int(rng.integers(2)), points.mark_pixel.copy()
        pixel[m, axis] += times * mdb[axis] * rng.choice([-1, 1])
        photograph = survey.photographs[points.mark_photograph[m]].name
        return replace(
            survey, control_points=replace(points, mark_pixel=pixel)
        ), f"of {points.name[points.mark_point[m]]} in {photograph}"
    g, axis = int(rng.choice(controls)), 2 if kind == "height" else int(rng.integers(2))
    mdb = minimal_detectable_blunder(points.sigma_m[g], r.ground_redundancy[g])
    axes, position = survey.frame.rotation_world_from_map(np.zeros(3)), points.position_world_m.copy()
    position[g] += times * mdb[axis] * rng.choice([-1, 1]) * axes[:, axis]
    return replace(survey, control_points=replace(points, position_world_m=position)), points.name[g]


@pytest.mark.parametrize("kind", ["height", "plan", "mark"])
def test_blunders_are_found_and_the_right_measurement_is_named(kind: str) -> None:
    found = 0
    for seed in seeds(20):
        survey, name = spoilt(simulated(PLAN, 100 + seed).block, kind, 2.0, np.random.default_rng(seed))
        named = suspects(adjust(survey, AdjustmentSettings()))
        found += bool(named) and named[0].name == name
        if named and named[0].name == name:
            assert named[0].sentence.startswith(f"{named[0].kind} {name}, ")
    assert found >= len(seeds(20)) - 1


def test_a_survey_without_blunders_is_not_suspected() -> None:
    assert sum(bool(suspects(adjusted(seed))) for seed in seeds(40)) <= 0.05 * len(seeds(40))


def test_what_nothing_else_determines_is_not_judged() -> None:
    adjusted_share = np.array([np.diag([1.0, 0.75, 0.0])])
    redundancy, w = w_tests(np.array([[0.0, 1.0, 2.0]]), adjusted_share)
    np.testing.assert_allclose(redundancy, [[0.0, 0.25, 1.0]])
    assert np.isnan(w[0, 0])
    np.testing.assert_allclose(w[0, 1:], [2.0, 2.0])
    residual, covariance = left_out(np.array([[0.0, 1.0, 2.0]]), adjusted_share)
    assert np.isnan(residual).all()
    assert np.isnan(covariance).all()
    mdb = minimal_detectable_blunder(np.array([0.1, 0.1, 0.1]), redundancy[0])
    np.testing.assert_allclose(mdb, [np.inf, 0.2 * NONCENTRALITY, 0.1 * NONCENTRALITY])


def test_an_attitude_left_out_is_predicted_as_by_an_adjustment_without_it() -> None:
    settings = replace(LEAST_SQUARES, relative_tolerance=1e-12, common_errors="none")
    survey = simulated(replace(PLAN, photographs_per_strip=3), 3).block
    whole = adjust(survey, settings).tests.reliability
    for i in (0, 4):
        photograph = survey.photographs[i]
        assert photograph.attitude_world_from_camera is not None
        unmeasured = replace(photograph, attitude_sigma_rad=1e3)
        without = adjust(
            replace(survey, photographs=(*survey.photographs[:i], unmeasured, *survey.photographs[i + 1 :])), settings
        )
        pose = without.block.poses[i]
        assert pose is not None
        turn = photograph.attitude_world_from_camera.T @ pose.rotation_world_from_camera
        spread = np.sqrt(np.diag(whole.attitude_left_out_covariance_rad2[i]))
        expected = Rotation.from_matrix(turn).as_rotvec()
        np.testing.assert_allclose(whole.attitude_left_out_rad[i], expected, rtol=0, atol=0.02 * spread.max())
        assert photograph.attitude_sigma_rad is not None
        predicted = np.diag(without.covariances.rotation_rad2[i]) + photograph.attitude_sigma_rad**2
        np.testing.assert_allclose(spread**2, predicted, rtol=0.01)
