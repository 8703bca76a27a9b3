"""Constraints between points: both engines, redundancies that sum up, checks that touch nothing, blunders by name."""

import json
from dataclasses import replace

import numpy as np
import pytest
from lib.simulated.close_range import CloseRange, simulate_close_range
from makers import simulated

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.constraint_tests import _known, constraint_tests
from photogram.adjustment.ground_points import of_control
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.constraints.between_points import CommonSurface, Constraint, Distance, HeightDifference, gives_scale
from photogram.factors.constraints import Heights, rows_of, taking_part
from photogram.factors.covariance import covariances
from photogram.project.constraints import used_points
from photogram.project.schema import DistanceEntry, ProjectFile
from photogram.report.local_frame import constraint_numbers, distance_numbers
from photogram.results import ConstraintTests
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2)
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=20.0)


def bar(survey: CloseRange, ends: str, off_m: float = 0.0) -> Distance:
    a, b = ("ABCD".index(name) for name in ends)
    length_m = float(np.linalg.norm(survey.marked_m[a] - survey.marked_m[b]))
    return Distance(ends=(ends[0], ends[1]), length_m=length_m + off_m, sigma_m=0.002)


def with_constraints() -> Block:
    """A block with one constraint of each kind, off the truth where that can be."""
    block = simulated(PLAN, off=0.3).block
    points, names = block.control_points.position_world_m, block.control_points.name
    height = block.frame.map_from_world(points)[:, 2]
    constraints: tuple[Constraint, ...] = (
        Distance(
            ends=(names[0], names[1]), length_m=float(np.linalg.norm(points[0] - points[1])) + 0.01, sigma_m=0.002
        ),
        HeightDifference(ends=(names[0], names[2]), difference_m=float(height[2] - height[0]) + 0.02, sigma_m=0.001),
        CommonSurface("water", "level surface", names[1:4], (0.02,) * 3),
        CommonSurface("slab", "plane", names[:5], (0.05,) * 5),
    )
    return replace(block, constraints=constraints)


def test_both_engines_agree_and_redundancies_sum_up() -> None:
    block = with_constraints()
    problem = make_problem(block, SETTINGS)
    start = start_state(problem)
    fast, slow = (minimise(problem, start, AdjustmentSettings(engine=engine)) for engine in ("fast", "reference"))
    assert fast.cost == pytest.approx(slow.cost, rel=1e-9)
    np.testing.assert_allclose(fast.state.control, slow.state.control, rtol=0, atol=1e-6)
    assert np.isfinite(of_control(problem, fast.state)).all(axis=1).sum() == 6


def test_a_check_changes_no_bit() -> None:
    survey = simulate_close_range(1, distance_sigma_m=0.002)
    check = replace(bar(survey, "CD"), role="check")
    without = adjust(survey.block, SETTINGS)
    found = adjust(replace(survey.block, constraints=(*survey.block.constraints, check)), SETTINGS)
    assert not gives_scale([check])
    for name in ("ground_world_m", "residual_px"):
        np.testing.assert_array_equal(getattr(found.estimates, name), getattr(without.estimates, name))
    for name in ("ground_m2", "tie_point_m2"):
        np.testing.assert_array_equal(getattr(found.covariances, name), getattr(without.covariances, name))
    assert found.cost == without.cost
    assert abs(found.tests.constraints.z[1]) < 4.0


def test_a_blunder_is_rejected_by_its_name() -> None:
    survey = simulate_close_range(2)
    bars = tuple(bar(survey, ends, 0.05 * (ends == "CD")) for ends in ("AB", "CD", "AC", "BD"))
    verdict = adjust_with_snooping(replace(survey.block, constraints=bars), SETTINGS)
    assert [(b.kind, b.points) for b in verdict.blunders] == [("distance", ("C", "D"))]


def test_a_project_file_names_its_points() -> None:
    file = ProjectFile(distances=[DistanceEntry(between=["A", "B"], length_m=1.0, sigma_m=0.001)])  # type: ignore[arg-type]
    assert used_points(file) == {"A", "B"}


def test_jacobians_agree_with_differences() -> None:
    block = with_constraints()
    rng, step = np.random.default_rng(4), 1e-3
    for constraint in block.constraints:
        X = block.control_points.position_world_m[: len(constraint.points)] + rng.normal(0.0, 0.05, (1, 3))
        if constraint.kind == "plane":  # Gauss and Newton leave out what grows with the misfits
            X[:, 2] = 0.1 * X[:, 0] - 0.05 * X[:, 1] + rng.normal(0.0, 0.002, len(X))
        sigma_m, heights = np.array(constraint.sigmas_m), Heights.near(block.frame, X)
        rows = rows_of(constraint, X, sigma_m, heights)
        A = rows.common
        across = np.eye(len(A)) - (A @ np.linalg.pinv(A) if A.shape[1] else 0.0)
        for n in range(len(X)):
            for axis in range(3):
                move = np.zeros_like(X)
                move[n, axis] = step
                ahead, behind = (rows_of(constraint, X + k * move, sigma_m, heights).misfit_m for k in (1, -1))
                expected = across @ rows.jacobian[:, n, axis]
                np.testing.assert_allclose((ahead - behind) / (2 * step), expected, atol=1e-4, err_msg=constraint.kind)


def test_the_report_has_every_observation_with_what_was_stated_of_it() -> None:
    block = with_constraints()
    distance, rise, water, slab = block.constraints
    assert isinstance(distance, Distance)
    block = replace(block, constraints=(distance, replace(rise, role="check"), water, slab))
    result = adjust(block, SETTINGS)
    out = replace(result.block, constraints=(replace(distance, sigma_m=float("inf")), *result.block.constraints[1:]))
    (bar_row,) = distance_numbers(replace(result, block=out), block)
    assert (bar_row["rejected"], bar_row["sigma_m"]) == (True, 0.002)
    rows = constraint_numbers(result, block)
    assert [r["kind"] for r in rows] == ["height difference", *["level surface"] * 3, *["plane"] * 5]
    assert rows[0]["role"] == "check"
    assert rows[0]["z"] is not None
    assert rows[0]["w"] is None
    assert all(r["w"] is not None and r["mdb_m"] is not None for r in rows[1:])
    assert 0.0 < sum(r["redundancy"] or 0.0 for r in rows[1:]) < 2 + 2
    json.dumps([*rows, bar_row], allow_nan=False)


def test_what_is_said_of_an_observation_is_what_an_adjustment_without_it_says() -> None:
    """Variances of what is adjusted and of residuals add up to what was stated; a distance left out is predicted by all
    else."""
    block = with_constraints()

    def solved(block: Block) -> tuple[ConstraintTests, FloatArray]:
        problem = make_problem(block, SETTINGS)
        state = minimise(problem, start_state(problem), replace(SETTINGS, relative_tolerance=1e-15)).state
        known, ground = covariances(problem, state), of_control(problem, state)
        return constraint_tests(problem, state, known, problem, known, ground), ground

    tests, _ = solved(block)
    sigma = np.concatenate([constraint.sigmas_m for constraint in block.constraints])
    np.testing.assert_allclose((tests.adjusted_sigma_m / sigma) ** 2 + tests.redundancy, 1.0, rtol=0, atol=1e-9)
    assert ((tests.redundancy > 0.001) & (tests.redundancy < 1.0)).all()
    np.testing.assert_allclose(tests.w, tests.residual_m / (sigma * np.sqrt(tests.redundancy)), rtol=1e-9)
    distance = block.constraints[0]
    assert isinstance(distance, Distance)
    without, ground = solved(replace(block, constraints=(replace(distance, role="check"), *block.constraints[1:])))
    predicted = float(np.linalg.norm(ground[0] - ground[1]) - distance.length_m)
    assert tests.left_out_m[0] == pytest.approx(predicted, rel=1e-3)
    expected = np.hypot(without.adjusted_sigma_m[0], distance.sigma_m)
    assert tests.left_out_sigma_m[0] == pytest.approx(expected, rel=1e-3)
    assert without.z[0] == pytest.approx(predicted / expected, rel=1e-9)


def test_nothing_is_said_of_a_constraint_with_a_point_that_is_not_there() -> None:
    block = with_constraints()
    names, places = block.control_points.name, block.control_points.position_world_m
    missing = tuple(Distance(ends=(names[0], end), length_m=1.0, sigma_m=0.1) for end in ("nobody", names[1]))
    centres = np.array([pose.position_world_m for pose in block.poses if pose is not None])
    assert [known.number for known in _known(replace(block, constraints=missing), places, centres)] == [1]


def test_a_distance_takes_part_with_both_ends_and_a_finite_sigma() -> None:
    block = with_constraints()
    bar, gone, rejected = (
        Distance(ends=("A", end), length_m=1.0, sigma_m=sigma_m)
        for end, sigma_m in (("B", 0.1), ("nobody", 0.1), ("B", float("inf")))
    )
    names = ("A", "B", *block.control_points.name[2:])
    block = replace(block, control_points=replace(block.control_points, name=names))
    for constraint, numbers in ((bar, [0]), (gone, []), (rejected, [])):
        assert [placed.number for placed in taking_part(replace(block, constraints=(constraint,)))] == numbers
