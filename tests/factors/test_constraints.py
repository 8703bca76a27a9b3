"""Constraints between points: both engines, redundancies that sum up, checks that touch nothing, blunders by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.constraint_tests import of_control
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.constraints.between_points import CommonSurface, Constraint, Distance, HeightDifference, gives_scale
from photogram.project.constraints import used_points
from photogram.project.schema import DistanceEntry, ProjectFile
from photogram.quality.gross_errors.snooped_adjustment import adjust_and_judge
from photogram.simulation.close_range import CloseRange, simulate_close_range
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2)
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=20.0)


def bar(survey: CloseRange, ends: str, off_m: float = 0.0) -> Distance:
    a, b = ("ABCD".index(name) for name in ends)
    length_m = float(np.linalg.norm(survey.marked_m[a] - survey.marked_m[b]))
    return Distance((ends[0], ends[1]), False, length_m + off_m, 0.002)


def with_constraints() -> Block:
    """A block with one constraint of each kind, off the truth where that can be."""
    block = simulated(PLAN, off=0.3).block
    points, names = block.control_points.position_world_m, block.control_points.name
    height = block.frame.map_from_world(points)[:, 2]
    constraints: tuple[Constraint, ...] = (
        Distance((names[0], names[1]), False, float(np.linalg.norm(points[0] - points[1])) + 0.01, 0.002),
        HeightDifference((names[0], names[2]), float(height[2] - height[0]) + 0.02, 0.001),
        CommonSurface("water", "level surface", names[1:4], (0.02,) * 3),
        CommonSurface("slab", "plane", names[:5], (0.05,) * 5),
    )
    return replace(block, constraints=constraints)


def test_both_engines_agree_and_redundancies_sum_up() -> None:
    block = with_constraints()
    problem = make_problem(block, SETTINGS)
    start = start_state(problem.block, problem.flights)
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
    for name in ("ground_world_m", "ground_covariance_m2", "tie_point_covariance_m2", "residual_px"):
        np.testing.assert_array_equal(getattr(found, name), getattr(without, name))
    assert found.cost == without.cost
    assert abs(found.constraints.z[1]) < 4.0


def test_a_blunder_is_rejected_by_its_name() -> None:
    survey = simulate_close_range(2)
    bars = tuple(bar(survey, ends, 0.05 * (ends == "CD")) for ends in ("AB", "CD", "AC", "BD"))
    verdict = adjust_and_judge(replace(survey.block, constraints=bars), SETTINGS)
    assert [(b.kind, b.points) for b in verdict.blunders] == [("distance", ("C", "D"))]


def test_a_project_file_names_its_points() -> None:
    file = ProjectFile(distances=[DistanceEntry(between=["A", "B"], length_m=1.0, sigma_m=0.001)])  # type: ignore[arg-type]
    assert used_points(file) == {"A", "B"}
