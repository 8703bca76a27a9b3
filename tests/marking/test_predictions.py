"""Predicted places of marks, against the true ones of simulated surveys."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.marking.predictions import SURE, predicted_places
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan
from photogram.survey import Block, ControlPoints

PLAN = replace(whole_survey_plan(), control_points=8, check_points=4)


def first_marks(points: ControlPoints, of_points: int, each: int) -> ControlPoints:
    """The first marks of the first points."""
    nothing = np.zeros(0, dtype=np.int64)
    keep = np.concatenate([nothing, *(np.flatnonzero(points.mark_point == g)[:each] for g in range(of_points))])
    return replace(
        points,
        mark_photograph=points.mark_photograph[keep],
        mark_point=points.mark_point[keep],
        mark_pixel=points.mark_pixel[keep],
        mark_covariance_px2=points.mark_covariance_px2[keep],
    )


def judged(block: Block, made: ControlPoints) -> tuple[FloatArray, FloatArray]:
    """The test statistics (χ², two degrees of freedom) of the places of marks that were not made, and the radii."""
    truth = block.control_points
    of = {pair: m for m, pair in enumerate(zip(truth.mark_point.tolist(), truth.mark_photograph.tolist(), strict=True))}
    done = set(zip(made.mark_point.tolist(), made.mark_photograph.tolist(), strict=True))
    places = predicted_places(tagged_block(replace(block, control_points=made)))
    statistic, radius = [], []
    for k, pair in enumerate(zip(places.point.tolist(), places.photograph.tolist(), strict=True)):
        if pair in of and pair not in done:
            off = places.pixel[k] - truth.mark_pixel[of[pair]]
            spread = places.covariance_px2[k] + truth.mark_covariance_px2[of[pair]]
            statistic.append(float(off @ np.linalg.solve(spread, off)))
            radius.append(float(places.radius_px[k]))
    return np.array(statistic), np.array(radius)


@pytest.mark.parametrize(("points", "each"), [(0, 0), (3, 2), (8, 4)])
def test_places_are_where_their_ellipses_say(points: int, each: int) -> None:
    """Simulated: GNSS of 2 m, attitudes of 1°, every second compass 4° off."""
    found = []
    for seed in range(1, 7):
        plan = replace(PLAN, heading_error_deg=4.0 * (seed % 2))
        block = simulate_block(plan, seed).block
        found.append(judged(block, first_marks(block.control_points, points, each))[0])
    statistic = np.concatenate(found)
    assert len(statistic) > 200
    assert 0.35 < statistic.mean() / 2.0 < 1.3
    assert np.mean(statistic < SURE) > 0.92


def test_marks_of_some_points_shrink_the_ellipses_of_all() -> None:
    block = simulate_block(replace(PLAN, heading_error_deg=4.0), 1).block
    radii = [
        float(np.median(judged(block, first_marks(block.control_points, points, each))[1]))
        for points, each in ((0, 0), (2, 2), (3, 4), (6, 4))
    ]
    assert all(after < before for before, after in pairwise(radii))
    assert radii[-1] < 0.6 * radii[0]


def test_an_adjusted_block_knows_the_places_far_better_than_tags() -> None:
    block = simulate_block(PLAN, 2).block
    nothing = first_marks(block.control_points, 0, 0)
    of_tags = predicted_places(tagged_block(replace(block, control_points=nothing)))
    marked = predicted_places(replace(block, control_points=first_marks(block.control_points, 4, 4)))
    assert np.median(marked.radius_px) < 0.1 * np.median(of_tags.radius_px)


def test_places_beside_a_picture_are_marked_as_such_and_far_ones_are_left_out() -> None:
    block = simulate_block(PLAN, 3).block
    places = predicted_places(tagged_block(block))
    camera = block.cameras[0]
    outside = places.pixel[~places.inside]
    assert len(outside)
    assert not camera.contains(outside).any()
    assert camera.contains(places.pixel[places.inside]).all()
    assert outside.min() > -0.3 * camera.width_px
    order = np.lexsort((places.photograph, places.point))
    np.testing.assert_array_equal(order, np.arange(len(order)))
    assert set(places.point[places.of_point(3)]) == {3}
