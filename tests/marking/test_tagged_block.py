"""Blocks of tags and marks alone."""

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated

from photogram.camera import project_points
from photogram.marking.tagged_block import OPEN_M, tagged_block, with_all_points
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=5, check_points=2)


def marked(block: Block, marks: list[int]) -> Block:
    """The block with the marks of these numbers alone."""
    p = block.control_points
    few = replace(
        p,
        mark_photograph=p.mark_photograph[marks],
        mark_point=p.mark_point[marks],
        mark_pixel=p.mark_pixel[marks],
        mark_covariance_px2=p.mark_covariance_px2[marks],
    )
    return replace(block, control_points=few)


def unsurveyed(block: Block, point: int) -> Block:
    """The block without the coordinates of a point."""
    position = block.control_points.position_world_m.copy()
    position[point] = np.nan
    return replace(block, control_points=replace(block.control_points, position_world_m=position))


def test_tags_give_the_poses_and_nothing_else() -> None:
    block = simulated(PLAN).block
    bare = replace(block.photographs[2], attitude_world_from_camera=None)
    tagged = tagged_block(replace(block, photographs=(*block.photographs[:2], bare, *block.photographs[3:])))
    assert len(tagged.tie_points) == 0 < len(block.tie_points)
    assert [pose is None for pose in tagged.poses] == [i == 2 for i in range(8)]
    np.testing.assert_array_equal(tagged.poses[0].position_world_m, block.photographs[0].gnss_world_m)  # type: ignore[union-attr]


def test_check_points_are_looked_for_where_they_were_surveyed() -> None:
    block = simulated(PLAN).block
    known = with_all_points(tagged_block(block)).control_points
    assert known.name == block.control_points.name
    assert set(known.role) == {"control"}
    np.testing.assert_array_equal(known.position_world_m, block.control_points.position_world_m)


def test_a_point_without_coordinates_lies_where_its_ray_meets_the_ground_and_is_open_along_it() -> None:
    block = unsurveyed(simulated(PLAN).block, 0)
    m = int(np.flatnonzero(block.control_points.mark_point == 0)[0])
    known = with_all_points(tagged_block(marked(block, [m]))).control_points
    own = known.name.index(block.control_points.name[0])
    level = np.median(block.control_points.position_world_m[1:, 2])
    assert known.position_world_m[own, 2] == pytest.approx(level)
    i = block.control_points.mark_photograph[m]
    pose = tagged_block(block).poses[i]
    assert pose is not None
    np.testing.assert_allclose(
        project_points(block.cameras[0], pose, known.position_world_m[own][None])[0],
        block.control_points.mark_pixel[m],
        atol=1e-6,
    )
    assert known.sigma_m[own, 0] == OPEN_M > known.sigma_m[own, 2] > 1.0


def test_a_point_without_coordinates_and_marks_is_left_out() -> None:
    block = unsurveyed(simulated(PLAN).block, 0)
    known = with_all_points(tagged_block(marked(block, []))).control_points
    assert known.name == block.control_points.name[1:]
