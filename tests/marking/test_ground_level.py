"""GNSS heights on a datum of their own, before anything is marked."""

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated

from photogram.arrays import FloatArray
from photogram.camera import Pose
from photogram.marking.ground_level import levelled
from photogram.marking.predictions import SURE, predicted_places
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=6, check_points=0)
OFFSET_SIGMA_M = np.array([3.0, 3.0, 30.0])


def without_marks(block: Block) -> Block:
    p = block.control_points
    none = np.zeros(0, dtype=np.int64)
    bare = replace(
        p, mark_point=none, mark_photograph=none, mark_pixel=np.zeros((0, 2)), mark_covariance_px2=np.zeros((0, 2, 2))
    )
    return replace(block, control_points=bare)


def lowered(block: Block, by_m: float, heights: bool = True) -> Block:
    """Positions, poses and tie points lower than they are; flying heights above ground are told, or not."""
    down = np.array([0.0, 0.0, -by_m])
    photographs = tuple(
        replace(
            p,
            gnss_world_m=None if p.gnss_world_m is None else p.gnss_world_m + down,
            height_above_ground_m=80.0 if heights else None,
        )
        for p in block.photographs
    )
    poses = tuple(p and Pose(p.rotation_world_from_camera, p.position_world_m + down) for p in block.poses)
    ties = replace(block.tie_points, position_world_m=block.tie_points.position_world_m + down)
    return replace(block, photographs=photographs, poses=poses, tie_points=ties, gnss_offset_sigma_m=OFFSET_SIGMA_M)


def block_of(by_m: float, ties: bool, heights: bool = True) -> Block:
    made = simulated(PLAN)
    block = replace(made.block, poses=made.truth.poses)
    known = replace(block.tie_points, position_world_m=made.tie_point_position_world_m)
    whole = without_marks(replace(block, tie_points=known))
    return lowered(whole if ties else tagged_block(whole), by_m, heights)


def heights_m(block: Block) -> FloatArray:
    return np.array([pose.position_world_m[2] for pose in block.poses if pose is not None])


@pytest.mark.parametrize("ties", [True, False])
def test_photographs_below_their_ground_points_show_them_all_the_same(ties: bool) -> None:
    """85 m off at a flying height of 80 m: marks lie in their ellipses, which tell the relief and no longer 30 m."""
    points, block = simulated(PLAN).block.control_points, block_of(85.0, ties)
    assert heights_m(block).max() < points.position_world_m[:, 2].max()
    places = predicted_places(levelled(block))
    at = {pair: k for k, pair in enumerate(zip(places.point.tolist(), places.photograph.tolist(), strict=True))}
    ellipses = []
    for g, i, pixel in zip(points.mark_point.tolist(), points.mark_photograph.tolist(), points.mark_pixel, strict=True):
        k = at[g, i]
        off = pixel - places.pixel[k]
        ellipses.append(off @ np.linalg.solve(places.covariance_px2[k], off) < SURE)
    assert np.mean(ellipses) > 0.9


def test_heights_that_were_right_stay_within_the_relief() -> None:
    for ties in (True, False):
        block = block_of(0.0, ties)
        found = levelled(block)
        relief_m = found.gnss_offset_sigma_m[2]
        assert 8.0 <= relief_m < 12.0, "a tenth of the flying height, and the scatter of the ground"
        assert np.all(np.abs(heights_m(found) - heights_m(block)) < relief_m)
        np.testing.assert_array_equal(found.gnss_offset_sigma_m[:2], OFFSET_SIGMA_M[:2])


def test_measured_heights_follow_where_the_adjustment_has_raised_the_photographs() -> None:
    block = block_of(0.0, ties=True)
    below = tuple(
        replace(p, gnss_world_m=None if p.gnss_world_m is None else p.gnss_world_m - [0.0, 0.0, 69.0])
        for p in block.photographs
    )
    found = levelled(replace(block, photographs=below))
    off = [
        pose.position_world_m[2] - p.gnss_world_m[2]
        for p, pose in zip(found.photographs, found.poses, strict=True)
        if pose is not None and p.gnss_world_m is not None
    ]
    assert np.abs(np.median(off)) < 0.1


@pytest.mark.parametrize("ties", [True, False])
def test_what_is_known_better_stays_as_it_is(ties: bool) -> None:
    block = block_of(85.0, ties)
    without_offset = replace(block, gnss_offset_sigma_m=np.zeros(3))
    rtk = replace(block, gnss_offset_sigma_m=np.array([0.05, 0.05, 0.1]))
    marked = replace(block, control_points=simulated(PLAN).block.control_points)
    unsurveyed = replace(block, control_points=replace(block.control_points, position_world_m=np.full((6, 3), np.nan)))
    for known in (without_offset, rtk, marked, unsurveyed):
        assert levelled(known) is known


def test_without_flying_heights_nothing_is_raised() -> None:
    block = block_of(85.0, ties=False, heights=False)
    assert levelled(block) is block
