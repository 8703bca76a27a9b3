"""Relative poses of cameras on one body, and the tests of their exposures, against simulated truth."""

import re
from dataclasses import replace

import numpy as np
import pytest
from lib.simulated.two_cameras import EXPOSURE_SIGMA, TwoCameras, simulate_two_cameras
from makers import LEAST_SQUARES
from scipy.stats import chi2

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.rigs.exposure_tests import rig_reliabilities
from photogram.adjustment.rigs.rig_starts import with_rig_starts, without_companion_positions
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.constraints.rigs import exposure_names, rejecting_exposures, relative_poses
from photogram.quality.improvements import final_linearisation
from photogram.results import Adjustment
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2)
WIDER = replace(PLAN, photographs_per_strip=4, control_points=8, control_marks_per_photograph=0)
GIVEN = np.array([1e-3] * 3 + [0.01] * 3)
SEEDS = range(10)


def squared_error(made: TwoCameras, result: Adjustment) -> float:
    """Return the squared error of the relative pose in its covariance, χ² with six degrees of freedom."""
    pose = result.block.rigs[0].pose
    assert pose is not None
    error = made.error(pose)
    return float(error @ np.linalg.solve(result.tests.exposures.relative_covariance[0], error))


@pytest.mark.parametrize("given", [None, GIVEN], ids=["free", "given"])
def test_relative_poses_are_found_within_their_sigmas(given: FloatArray | None) -> None:
    """A first-order variance-covariance check over seeds, from both sides."""
    every = [simulate_two_cameras(PLAN, seed, tie_points=120, given_sigma=given) for seed in SEEDS]
    results = [adjust(made.block, LEAST_SQUARES) for made in every]
    total = sum(squared_error(made, result) for made, result in zip(every, results, strict=True))
    assert chi2.ppf(0.001, 60) < total < chi2.ppf(0.999, 60)
    w = np.concatenate([result.tests.exposures.w for result in results])
    assert abs(float(np.std(w)) - 1.0) < 0.15
    components = results[0].tests.components
    assert {"exposure_rotation", "exposure_offset"} <= set(components.group.tolist())
    assert ("relative_poses" in components.group.tolist()) == (given is not None)


def test_what_predicts_an_exposure_is_the_adjustment_without_it() -> None:
    made = simulate_two_cameras(PLAN, 4, tie_points=120)
    whole = adjust(made.block, LEAST_SQUARES)
    name = exposure_names(made.block.rigs)[2][0]
    without = adjust(replace(made.block, rigs=rejecting_exposures(made.block.rigs, {name})), LEAST_SQUARES)
    rig, poses = without.block.rigs[0], [pose for pose in without.block.poses if pose is not None]
    both = [(poses[i].rotation_world_from_camera[None], poses[i].position_world_m[None]) for i in (2, 8)]
    assert rig.pose is not None
    actual = rig.pose.misfits(*relative_poses(*both))[0]
    np.testing.assert_allclose(whole.tests.exposures.left_out[2], actual, atol=0.02 * np.abs(actual).max())
    assert np.isnan(without.tests.exposures.w[2]).all()
    assert whole.redundancy - without.redundancy == 6


def assert_redundancies(result: Adjustment) -> None:
    """Hold that tie points, which have what the other groups leave of the redundancy, have theirs by another way."""
    pytest.importorskip("gtsam")
    from referees import dense_redundancy

    groups = result.tests.components
    problem, state, _ = final_linearisation(result, LEAST_SQUARES)
    of_ties = dense_redundancy(problem, state)[0][-2 * len(problem.tie) :]
    assert groups.redundancy[groups.group == "tie_points"] == pytest.approx(of_ties.sum(), abs=1e-3)


def test_redundancy_numbers_sum_to_what_an_exposure_adds() -> None:
    """Without relative poses and exposures the block loses 6 per exposure, and six unknowns."""
    made = simulate_two_cameras(PLAN, 5, tie_points=120)
    whole, bare = (adjust(replace(made.block, rigs=rigs), LEAST_SQUARES) for rigs in (made.block.rigs, ()))
    # positions of companions take no part in a rig: three coordinates and three angles each
    assert whole.redundancy == bare.redundancy + 6 * 6 - 6 - 6 * 6
    assert_redundancies(whole)


def test_redundancy_numbers_sum_up_where_the_relative_pose_is_given() -> None:
    result = adjust(simulate_two_cameras(PLAN, 5, tie_points=120, given_sigma=GIVEN).block, LEAST_SQUARES)
    groups = result.tests.components
    assert_redundancies(result)
    assert groups.squares.sum() == pytest.approx(result.sigma0**2 * result.redundancy, rel=1e-9)


@pytest.mark.parametrize("seed", [1, 3])
def test_an_exposure_not_taken_together_is_named_and_no_other(seed: int) -> None:
    made = simulate_two_cameras(WIDER, seed, tie_points=300, late_m={5: 0.3})
    verdict = adjust_with_snooping(made.block, AdjustmentSettings())
    assert [(a.kind, a.name) for a in verdict.rejected] == [("exposure", "sim_0006_B.JPG")]
    assert re.match(r"exposure sim_0006_B.JPG: all other observations put it 0\.[23]", verdict.blunders[0].sentence)
    assert verdict.blunders[0].sentence.endswith("beside sim_0006.JPG: the two were not taken at the same moment")
    assert squared_error(made, verdict.result) < chi2.ppf(0.9999, 6)
    found = rig_reliabilities(verdict.result)[0]
    assert (found.exposures, found.rejected) == (7, 1)
    assert np.all(found.detectable > 4.0 * EXPOSURE_SIGMA)
    assert np.all((found.redundancy > 0.0) & (found.redundancy < 1.0))


def test_nothing_is_accused_where_all_were_taken_together() -> None:
    made = simulate_two_cameras(WIDER, 2, tie_points=300)
    assert adjust_with_snooping(made.block, AdjustmentSettings()).rejected == ()


def test_gross_exposures_are_found_by_the_robust_start() -> None:
    """Three of eight, by metres: they would bend the block, and hide each other."""
    late = {1: 4.0, 4: 6.0, 6: 5.0}
    made = simulate_two_cameras(WIDER, 7, tie_points=300, late_m=late)
    verdict = adjust_with_snooping(made.block, AdjustmentSettings())
    assert {a.name for a in verdict.rejected} == {f"sim_{i + 1:04d}_B.JPG" for i in late}


def test_companions_give_their_positions_to_the_master() -> None:
    block = simulate_two_cameras(PLAN, 1, tie_points=60).block
    kept = without_companion_positions(block).photographs
    assert [p.gnss_world_m is None for p in kept] == [False] * 6 + [True] * 6
    assert [p.attitude_sigma_rad is None for p in kept] == [False] * 6 + [True] * 6
    bare = replace(block.photographs[0], gnss_world_m=None, gnss_sigma_m=None)
    mixed = without_companion_positions(replace(block, photographs=(bare, *block.photographs[1:]))).photographs[6]
    assert mixed.gnss_world_m is not None
    assert mixed.attitude_sigma_rad is None


def test_a_free_relative_pose_starts_from_the_poses() -> None:
    made = simulate_two_cameras(PLAN, 1, tie_points=60, start_sigma=0.01)
    start = with_rig_starts(made.block).rigs[0].pose
    assert start is not None
    assert np.all(np.abs(made.error(start)) < [2e-3] * 3 + [0.05] * 3)
    again = with_rig_starts(with_rig_starts(made.block)).rigs[0].given
    assert again is not None
    np.testing.assert_array_equal(again.offset_m, start.offset_m)


def test_photographs_without_a_pose_take_their_exposures_with_them() -> None:
    made = simulate_two_cameras(PLAN, 6, tie_points=200)
    poses = (*made.block.poses[:6], None, *made.block.poses[7:])
    result = adjust(replace(made.block, poses=poses), LEAST_SQUARES)
    assert np.isnan(result.tests.exposures.w[0]).all()
    assert np.isfinite(result.tests.exposures.w[1:]).all()
    assert result.block.rigs[0].value.any()
