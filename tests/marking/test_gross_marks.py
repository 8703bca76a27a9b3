"""Gross contradictions of marks and coordinates, among simulated marks that are right but for what is made wrong."""

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated
from scipy.stats import chi2

from photogram.adjustment.problem import AdjustmentSettings
from photogram.marking.gross_marks import LARGE, gross_marks, log_chance
from photogram.marking.tagged_block import tagged_block, with_all_points
from photogram.simulation.simulated_survey import whole_survey_plan
from photogram.survey import Block, ControlPoints

PLAN = replace(whole_survey_plan(), strips=3, photographs_per_strip=5, control_points=6, check_points=2)
SETTINGS = AdjustmentSettings(estimate_sigmas=False)


@pytest.fixture(scope="module", params=["adjusted", "tags"])
def block(request: pytest.FixtureRequest) -> Block:
    """A block with all its marks: with tie points, or with the poses of its tags alone."""
    made = simulated(PLAN, seed=2, tie_points=300).block
    return with_all_points(made if request.param == "adjusted" else tagged_block(made))


def with_points(block: Block, points: ControlPoints) -> Block:
    return replace(block, control_points=points)


def found(block: Block) -> set[tuple[str, str, str | None]]:
    gross = gross_marks(block, SETTINGS)
    assert gross is not None
    return {a.what for a in gross}


def test_marks_that_are_right_are_let_be(block: Block) -> None:
    assert found(block) == set()


def test_marks_far_off_are_found_and_no_other(block: Block) -> None:
    points = block.control_points
    pixel = points.mark_pixel.copy()
    wrong = [3, len(pixel) // 2, len(pixel) - 2]
    pixel[wrong] += [[310.0, -120.0], [-200.0, 240.0], [15.0, 400.0]]
    expected = {
        ("mark", points.name[points.mark_point[m]], block.photographs[points.mark_photograph[m]].name) for m in wrong
    }
    assert found(with_points(block, replace(points, mark_pixel=pixel))) == expected


def test_points_that_were_exchanged_are_found_as_points(block: Block) -> None:
    points = block.control_points
    counts = np.bincount(points.mark_point)
    first, second = np.argsort(-counts, kind="stable")[:2].tolist()
    swap = np.arange(len(points))
    swap[[first, second]] = second, first
    order = np.lexsort((points.mark_photograph, swap[points.mark_point]))
    exchanged = replace(
        points,
        mark_point=swap[points.mark_point][order],
        mark_photograph=points.mark_photograph[order],
        mark_pixel=points.mark_pixel[order],
        mark_covariance_px2=points.mark_covariance_px2[order],
    )
    of_points = {name for kind, name, _ in found(with_points(block, exchanged)) if kind == "control point"}
    assert of_points == {points.name[first], points.name[second]}


def test_a_coordinate_that_was_mistyped_is_its_point_s(block: Block) -> None:
    points = block.control_points
    g = int(np.argmax(np.bincount(points.mark_point)))
    position = points.position_world_m.copy()
    position[g, 0] += 30.0
    assert ("control point", points.name[g], None) in found(
        with_points(block, replace(points, position_world_m=position))
    )


def test_without_marks_nothing_is_wrong(block: Block) -> None:
    nothing = np.zeros(0, dtype=np.int64)
    bare = replace(
        block.control_points,
        mark_photograph=nothing,
        mark_point=nothing,
        mark_pixel=np.zeros((0, 2)),
        mark_covariance_px2=np.zeros((0, 2, 2)),
    )
    assert gross_marks(with_points(block, bare), SETTINGS) == []


def test_a_block_that_hangs_on_its_marks_cannot_be_tested(block: Block) -> None:
    """Without positions nothing says where the photographs are, but the marks."""
    photographs = tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in block.photographs)
    assert gross_marks(replace(block, photographs=photographs), SETTINGS) is None


@pytest.mark.parametrize("degrees", [2, 3])
def test_the_asymptotic_chance_continues_the_exact_one(degrees: int) -> None:
    assert log_chance(LARGE, degrees) == pytest.approx(chi2.logsf(LARGE, degrees), abs=0.01)
    assert log_chance(1e7, degrees) == pytest.approx(-5e6, rel=1e-4)
