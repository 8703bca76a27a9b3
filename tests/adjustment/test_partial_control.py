"""Ground points that are control in plan or in height alone: nothing of what is a check touches the adjustment."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.partial_control import control_positions
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import BoolArray
from photogram.errors import AdjustmentError
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=4, control_points=7, check_points=3,
    gnss_sigma_m=(2.0, 2.0, 4.0), gnss_offset_sigma_m=(1.0, 1.0, 2.0),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip
SETTINGS = AdjustmentSettings()


def controlled(block: Block, plan_only: tuple[int, ...], height_only: tuple[int, ...]) -> Block:
    axes: BoolArray = block.control_points.controlled.copy()
    axes[list(plan_only), 2] = False
    axes[list(height_only), :2] = False
    return replace(block, control_points=replace(block.control_points, controlled=axes))


@cache
def survey(seed: int = 1) -> Block:
    made = simulate_block(PLAN, seed, tie_points=250, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3)
    return controlled(made.block, (0, 1), (2, 3))


@cache
def adjusted(seed: int = 1) -> Adjustment:
    return adjust(survey(seed), SETTINGS)


def moved(block: Block, by_m: float) -> Block:
    """The block with every checked coordinate elsewhere, along the map's axes."""
    points, frame = block.control_points, block.frame
    surveyed = frame.map_from_world(points.position_world_m) + np.where(points.controlled, 0.0, by_m)
    some = (~points.controlled).any(axis=1, keepdims=True)
    position = np.where(some, frame.world_from_map(surveyed), points.position_world_m)
    return replace(block, control_points=replace(points, position_world_m=position))


@pytest.mark.parametrize("by_m", [0.05, -3.7, 120.0])
def test_no_bit_of_the_result_depends_on_a_checked_coordinate(by_m: float) -> None:
    other, block = adjust(moved(survey(), by_m), SETTINGS), adjusted().block
    for mine, theirs in zip(other.block.poses, block.poses, strict=True):
        assert mine is not None
        assert theirs is not None
        np.testing.assert_array_equal(mine.position_world_m, theirs.position_world_m)
        np.testing.assert_array_equal(mine.rotation_world_from_camera, theirs.rotation_world_from_camera)
    np.testing.assert_array_equal(other.block.tie_points.position_world_m, block.tie_points.position_world_m)
    np.testing.assert_array_equal(other.estimates.ground_world_m, adjusted().estimates.ground_world_m)
    np.testing.assert_array_equal(other.block.cameras[0].parameters, block.cameras[0].parameters)
    assert other.sigma0 == adjusted().sigma0


def test_a_controlled_coordinate_does_touch_it() -> None:
    points = survey().control_points
    position = points.position_world_m.copy()
    position[0, 0] += 0.05
    other = adjust(replace(survey(), control_points=replace(points, position_world_m=position)), SETTINGS)
    assert np.abs(other.estimates.ground_world_m - adjusted().estimates.ground_world_m).max() > 1e-3


def test_checked_coordinates_are_predicted_as_well_as_said() -> None:
    z = []
    for seed in range(1, 13):
        result, points = adjusted(seed), survey(seed).control_points
        axes = result.block.frame.rotation_world_from_map(np.zeros(3))
        off = (result.estimates.ground_world_m - points.position_world_m) @ axes
        variance = np.einsum("ji,gjk,ki->gi", axes, result.covariances.ground_m2, axes) + points.sigma_m**2
        partly = (~points.controlled) & (np.array(points.role) == "control")[:, None]
        z.append((off / np.sqrt(variance))[partly])
    rms = float(np.sqrt(np.mean(np.concatenate(z) ** 2)))
    assert 0.75 < rms < 1.25


def test_only_controlled_coordinates_are_tested_and_counted() -> None:
    points, r = survey().control_points, adjusted().tests.reliability
    for tested in (r.ground_w, r.ground_left_out_m):
        np.testing.assert_array_equal(np.isfinite(tested), points.controlled)
    whole = adjust(replace(survey(), control_points=replace(points, controlled=np.zeros((0, 3), bool))), SETTINGS)
    assert adjusted().redundancy - 2 * (len(adjusted().block.tie_points.photograph) - 1) < whole.redundancy
    fewer = (~points.controlled[np.array(points.role) == "control"]).sum()
    ties = [2 * len(a.block.tie_points.photograph) - 3 * len(a.block.tie_points) for a in (whole, adjusted())]
    assert whole.redundancy - ties[0] == adjusted().redundancy - ties[1] + fewer


def test_a_point_starts_where_its_marks_and_its_coordinates_say() -> None:
    made = simulate_block(PLAN, 3, tie_points=50, start_position_sigma_m=0.0, start_attitude_sigma_deg=0.0)
    block = controlled(made.block, (0, 1), (2, 3))
    position, axes = control_positions(moved(block, 40.0))
    truth = block.control_points.position_world_m[np.array(block.control_points.role) == "control"]
    np.testing.assert_allclose(position, truth, rtol=0, atol=0.6)  # the camera is known to 5 px
    np.testing.assert_array_equal(position[4:], truth[4:])
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-12)


def test_a_point_that_nothing_places_is_named() -> None:
    points = survey().control_points
    kept = points.mark_point != 2
    bare = replace(
        points,
        mark_photograph=points.mark_photograph[kept],
        mark_point=points.mark_point[kept],
        mark_pixel=points.mark_pixel[kept],
        mark_covariance_px2=points.mark_covariance_px2[kept],
    )
    with pytest.raises(AdjustmentError, match=f"control point {points.name[2]} is control in height only"):
        adjust(replace(survey(), control_points=bare), SETTINGS)
