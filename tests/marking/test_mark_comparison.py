"""Marks that contradict the others, in simulated surveys that have nothing but tags."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.marking.mark_comparison import MarkComparison, compared_marks
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan
from photogram.survey import Block, ControlPoints

PLAN = replace(whole_survey_plan(), control_points=8, check_points=2, heading_error_deg=4.0)


@cache
def survey(seed: int) -> Block:
    """A survey of tags and marks."""
    return tagged_block(simulate_block(PLAN, seed).block)


def told(seed: int, points: ControlPoints) -> MarkComparison:
    """What is said of these marks."""
    return compared_marks(replace(survey(seed), control_points=points))


def test_nobody_is_accused_where_all_marks_are_right() -> None:
    points = survey(1).control_points
    found = told(1, points)
    assert not found.blunders
    assert not any(compared.rejected for compared in found.marks)
    assert len(found.marks) > 0.8 * len(points.mark_point)
    assert 0.7 < np.sqrt(np.mean([compared.w**2 for compared in found.marks]) / 2.0) < 1.3
    assert np.isfinite(found.sigma_m).all()


def test_a_mark_on_the_neighbouring_target_is_named_with_the_point_that_it_fits() -> None:
    points = survey(2).control_points
    both = next(
        (a, b)
        for a in range(len(points.mark_point))
        for b in range(len(points.mark_point))
        if points.mark_photograph[a] == points.mark_photograph[b] and points.mark_point[a] < points.mark_point[b]
    )
    pixel = points.mark_pixel.copy()
    pixel[both[0]] = pixel[both[1]] + 0.2
    found = told(2, replace(points, mark_pixel=pixel))
    (wrong,) = [compared for compared in found.marks if compared.rejected]
    assert wrong.mark == both[0]
    assert wrong.fits == (points.name[points.mark_point[both[1]]],)
    right_px = points.mark_pixel[both[0]] - pixel[both[0]]
    assert wrong.distance_px == pytest.approx(float(np.hypot(*right_px)), rel=0.2)


@pytest.mark.parametrize(
    ("seed", "pair"),
    [(3, (0, 1)), (2, (0, 9)), (18, (4, 5)), (24, (1, 6)), (44, (0, 1)), (47, (0, 9)), (73, (2, 3)), (84, (0, 1))],
)
def test_of_exchanged_points_both_are_named_and_no_mark(seed: int, pair: tuple[int, int]) -> None:
    """Far off their places they bend the linearisation: marks of their own and coordinates of a neighbour of few marks
    seem to contradict it too. Of three marks two are rejected as easily as the coordinates. From where it was surveyed
    a point that has the marks of another slides along a ray into a projection centre (24), and a photograph may be
    drawn to a point by a wrong mark that is believed again (84)."""
    points = survey(seed).control_points
    number = np.arange(len(points))
    number[list(pair)] = pair[::-1]
    swapped = number[points.mark_point]
    order = np.argsort(swapped, kind="stable")
    found = told(
        seed,
        replace(
            points,
            mark_point=swapped[order],
            mark_photograph=points.mark_photograph[order],
            mark_pixel=points.mark_pixel[order],
            mark_covariance_px2=points.mark_covariance_px2[order],
        ),
    )
    assert {name for blunder in found.blunders for name in blunder.points} == {points.name[g] for g in pair}
    assert not [compared.mark for compared in found.marks if compared.rejected]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_mark_on_any_neighbouring_target_accuses_its_own_point_alone(seed: int) -> None:
    """Of every point one mark, in turn, on the nearest other target of its photograph."""
    points = survey(seed).control_points
    counts, made = np.bincount(points.mark_point), 0
    for g in np.flatnonzero(counts >= 4).tolist():
        own = np.flatnonzero(points.mark_point == g)
        m = int(own[len(own) // 2])
        there = np.flatnonzero((points.mark_photograph == points.mark_photograph[m]) & (points.mark_point != g))
        if not len(there):
            continue
        off = np.linalg.norm(points.mark_pixel[there] - points.mark_pixel[m], axis=1)
        pixel = points.mark_pixel.copy()
        pixel[m] = pixel[there[np.argmin(off)]]
        found = told(seed, replace(points, mark_pixel=pixel))
        assert [compared.mark for compared in found.marks if compared.rejected] == [m]
        assert {blunder.points[0] for blunder in found.blunders} == {points.name[g]}
        made += 1
    assert made >= 4
