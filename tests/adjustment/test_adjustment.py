"""The joint adjustment against simulated truth, from both sides, and against GTSAM's own factors."""

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from seeds import limit, seeds

from photogram.adjustment.adjustment import _judged, adjust
from photogram.adjustment.assessment import _median_sigmas, sigma0_and_redundancy
from photogram.adjustment.outliers import noise_scale, outlier_limit_px, settled, within_depths
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.solutions.ended import Ended
from photogram.adjustment.solvability import UndeterminedPartError, _axis, check_determined
from photogram.adjustment.stochastic_model.estimated_sigmas import TieGroups
from photogram.arrays import FloatArray
from photogram.camera import Camera, oriented_by, oriented_cameras, project_points
from photogram.errors import AdjustmentError
from photogram.factors.common_errors import values_of
from photogram.factors.covariance import covariances
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError
from photogram.factors.variables import POSE
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block, Role, TiePoints
from photogram.triangulation import MANY_PAIRS, consensus_intersections

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=6, check_points=3, buildings=0, trees=0, cell_m=1.0,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip
SEEDS = seeds(50)
SETTINGS = AdjustmentSettings()


@cache
def simulated(seed: int, mismatches: float = 0.0) -> SimulatedBlock:
    return simulate_block(
        PLAN, seed, tie_points=150, mismatches=mismatches, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5
    )


@cache
def adjusted(seed: int, mismatches: float = 0.0) -> Adjustment:
    return adjust(simulated(seed, mismatches).block, SETTINGS)


def position_error(block: SimulatedBlock, result: Adjustment) -> FloatArray:
    pairs = zip(result.block.poses, block.truth.poses, strict=True)
    return np.array([p.position_world_m - q.position_world_m for p, q in pairs if p is not None])


def state_of(result: Adjustment) -> State:
    control = [g for g, role in enumerate(result.block.control_points.role) if role == "control"]
    camera_of = result.block.camera_of
    return State(
        oriented_by(result.block.cameras, camera_of, result.block.poses),
        result.block.tie_points.position_world_m,
        result.estimates.ground_world_m[control],
        result.estimates.offset_world_m,
    )


@dataclass(frozen=True)
class Joint:
    """Errors of poses, calibration and offset, in the tangent of the solution, and their joint covariance."""

    error: FloatArray
    covariance: FloatArray

    @property
    def squared(self) -> float:
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


def joint(seed: int) -> Joint:
    block, result = simulated(seed), adjusted(seed)
    adjusted_parts = {name: getattr(result.block, name) for name in ("poses", "tie_points", "common_errors")}
    problem = make_problem(replace(block.block, **adjusted_parts), SETTINGS)
    state = replace(state_of(result), common=values_of(problem.block.common_errors))
    found = covariances(problem, state)
    layout, camera = found.layout, block.block.cameras[0]
    error = np.zeros(layout.columns + layout.border)
    for i, truth in enumerate(block.truth.poses):
        R = state.rotation[i]
        error[6 * i : 6 * i + 3] = Rotation.from_matrix(R.T @ truth.rotation_world_from_camera).as_rotvec()
        error[6 * i + 3 : 6 * i + 6] = R.T @ (truth.position_world_m - state.position[i])
    border = error[layout.columns :]
    border[layout.common_column : layout.ground_column] = -state.common  # the simulated attitudes have none
    offset = slice(layout.offset_column, layout.offset_column + 3)
    border[offset] = block.truth.gnss_offset_world_m["1"] - state.offset[0]
    border[: layout.offset_column] = (block.truth.camera.parameters - state.parameters[0])[camera.sigmas > 0]
    return Joint(error, found.joint(np.arange(len(state.rotation))))


def within_99(total: float, degrees: int) -> bool:
    low, high = (float(chi2.ppf(share, degrees)) for share in (0.005, 0.995))
    return bool(low < total < high)


def truth_of_points(block: SimulatedBlock, result: Adjustment) -> FloatArray:
    """True positions of the tie points that took part, found by their first observations."""
    tie, kept = block.block.tie_points, result.block.tie_points
    point_at = {(p, f): q for p, f, q in zip(tie.photograph, tie.feature, tie.point, strict=True)}
    first = kept.first_observation[:-1]
    index = [point_at[p, f] for p, f in zip(kept.photograph[first], kept.feature[first], strict=True)]
    return block.tie_point_position_world_m[index]


def test_all_variables_scatter_as_their_joint_covariance_predicts() -> None:
    errors = [joint(seed) for seed in SEEDS]
    assert within_99(sum(e.squared for e in errors), sum(len(e.error) for e in errors))


def test_cameras_scatter_as_predicted() -> None:
    # One camera of each survey: the cameras of one survey share the errors of its control.
    total = 0.0
    for seed in SEEDS:
        i = seed % 6
        error = position_error(simulated(seed), adjusted(seed))[i]
        total += float(error @ np.linalg.solve(adjusted(seed).covariances.position_m2[i], error))
    assert within_99(total, 3 * len(SEEDS))


def test_tie_points_scatter_as_predicted() -> None:
    total = 0.0
    for seed in SEEDS:
        result = adjusted(seed)
        error = result.block.tie_points.position_world_m - truth_of_points(simulated(seed), result)
        p = (7 * seed) % len(error)
        total += float(error[p] @ np.linalg.solve(result.covariances.tie_point_m2[p], error[p]))
    assert within_99(total, 3 * len(SEEDS))


def test_check_points_scatter_as_predicted() -> None:
    total, points = 0.0, 0
    for seed in SEEDS:
        block, result = simulated(seed), adjusted(seed)
        for g, role in enumerate(block.block.control_points.role):
            if role == "check" and np.isfinite(result.estimates.ground_world_m[g]).all():
                error = result.estimates.ground_world_m[g] - block.truth.control_position_world_m[g]
                total += float(error @ np.linalg.solve(result.covariances.ground_m2[g], error))
                points += 1
                break
    assert points > 0.8 * len(SEEDS)
    assert within_99(total, 3 * points)


def test_sigma0_is_one_when_the_stated_noise_is_the_true_noise() -> None:
    sigma0 = np.array([adjusted(seed).sigma0 for seed in SEEDS])
    assert np.all(np.abs(sigma0 - 1.0) < 0.1)
    assert abs(sigma0.mean() - 1.0) < limit(0.01, 50)


def test_ten_percent_mismatches_leave_the_result_within_1_2_times_the_clean_one() -> None:
    clean = [np.sum(position_error(simulated(seed), adjusted(seed)) ** 2) for seed in SEEDS]
    spoilt = [np.sum(position_error(simulated(seed, 0.1), adjusted(seed, 0.1)) ** 2) for seed in SEEDS]
    assert np.sqrt(np.mean(spoilt)) < 1.2 * np.sqrt(np.mean(clean))
    assert abs(np.mean([adjusted(seed, 0.1).sigma0 for seed in SEEDS]) - 1.0) < 0.1


def test_mismatches_are_discarded_and_good_observations_kept() -> None:
    block, result = simulated(3, 0.1), adjusted(3, 0.1)
    kept = {(p, f) for p, f in zip(result.block.tie_points.photograph, result.block.tie_points.feature, strict=True)}
    tie = block.block.tie_points
    took_part = np.array([(p, f) in kept for p, f in zip(tie.photograph, tie.feature, strict=True)])
    assert np.mean(took_part[block.mismatch]) < 0.1
    assert np.mean(took_part[~block.mismatch]) > 0.9


def with_mismatch_at(made: SimulatedBlock, share_of_depth: float) -> tuple[Block, int]:
    """The block with a tie point of two rays matched wrongly in its second photograph, along the epipolar line: where
    its rays meet is ``share_of_depth`` of the true depth away from the first; and the point's index."""
    block, truth = made.block, made.truth
    tie = block.tie_points
    X = made.tie_point_position_world_m
    for p in np.flatnonzero(tie.rays == 2).tolist():
        n = int(tie.first_observation[p])
        a, b = (truth.poses[i] for i in tie.photograph[n : n + 2].tolist())
        wrong = a.position_world_m + share_of_depth * (X[p] - a.position_world_m)
        pixel = project_points(truth.camera, b, wrong[None])
        if truth.camera.contains(pixel)[0] and not made.mismatch[n : n + 2].any():
            moved = tie.pixel.copy()
            moved[n : n + 2] = project_points(truth.camera, a, wrong[None])[0], pixel[0]
            return replace(block, tie_points=replace(tie, pixel=moved)), p
    raise ValueError("no point of two rays has room for a mismatch")


LONG_LENS = replace(PLAN, calibration_sigmas=(60.0, 3.0, 3.0, *PLAN.calibration_sigmas[3:]), gnss_tags=False)


@pytest.mark.parametrize("share_of_depth", [0.5, 0.9])
def test_a_mismatch_along_the_epipolar_line_moves_no_focal_length(share_of_depth: float) -> None:
    """It leaves no residual. At half the depth nothing else of two rays lies there, and it is rejected; at nine tenths
    it might be a tree, and stays."""
    made = simulate_block(LONG_LENS, 2, tie_points=150, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5)
    block, p = with_mismatch_at(made, share_of_depth)
    clean, spoilt = adjust(made.block, SETTINGS), adjust(block, SETTINGS)
    off_px = spoilt.block.cameras[0].focal_px - clean.block.cameras[0].focal_px
    sigma_px = [float(np.sqrt(r.covariances.calibration[0, 0, 0])) for r in (clean, spoilt)]
    assert abs(off_px) < 0.3 * sigma_px[0]
    assert sigma_px[1] > 0.95 * sigma_px[0]
    n = int(block.tie_points.first_observation[p])
    kept = set(zip(spoilt.block.tie_points.photograph, spoilt.block.tie_points.feature, strict=True))
    found = (block.tie_points.photograph[n], block.tie_points.feature[n]) in kept
    assert found is (share_of_depth > 0.7)


def test_what_stands_far_above_the_ground_is_kept_where_three_photographs_see_it() -> None:
    """Two rays alone cannot tell a mast from a mismatch; three can."""
    made = simulated(3)
    state = state_of(adjusted(3))
    points, tie = made.tie_point_position_world_m.copy(), made.block.tie_points
    two, three = (int(np.flatnonzero(tie.rays == rays)[0]) for rays in (2, 3))
    points[[two, three], 2] += 50.0  # of 80 m of flying height
    used = within_depths(made.block, state, np.ones(len(tie.point), dtype=bool), points)
    assert np.unique(tie.point[~used]).tolist() == [two]
    few = np.isin(tie.point, np.arange(10)) | (tie.point == two)
    assert within_depths(made.block, state, few, points)[few].all()


def test_the_same_input_gives_the_same_result_bit_for_bit() -> None:
    again = adjust(simulated(1).block, SETTINGS)
    np.testing.assert_array_equal(
        again.block.tie_points.position_world_m, adjusted(1).block.tie_points.position_world_m
    )
    np.testing.assert_array_equal(again.covariances.position_m2, adjusted(1).covariances.position_m2)


def test_check_points_take_no_part() -> None:
    block = simulated(2).block
    points = block.control_points
    check = np.array([role == "check" for role in points.role])
    moved = points.position_world_m + np.where(check[:, None], 3.0, 0.0)
    other = adjust(replace(block, control_points=replace(points, position_world_m=moved)), SETTINGS)
    np.testing.assert_array_equal(other.estimates.ground_world_m, adjusted(2).estimates.ground_world_m)
    assert other.sigma0 == adjusted(2).sigma0


# ---- GTSAM's own factors as referee --------------------------------------------------------------------------------


def referee(block: Block) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The same adjustment without k3 and GNSS, of GTSAM's native factors alone, at the start values of ``block``."""
    camera = block.cameras[0]
    q = camera.parameters
    K = gtsam.Cal3DS2(q[0], q[0], 0.0, q[1], q[2], q[3], q[4], *camera.tangential)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    tie, control = block.tie_points, block.control_points.with_role("control")
    for i in range(len(tie.photograph)):
        noise = gtsam.noiseModel.Isotropic.Sigma(2, tie.sigma_px[i])
        graph.add(
            gtsam.GenericProjectionFactorCal3DS2(
                tie.pixel[i], noise, gtsam.symbol("x", tie.photograph[i]), gtsam.symbol("l", tie.point[i]), K
            )
        )
    for m in range(len(control.mark_point)):
        noise = gtsam.noiseModel.Isotropic.Sigma(2, control.mark_sigma_px[m])
        x, g = gtsam.symbol("x", control.mark_photograph[m]), gtsam.symbol("g", control.mark_point[m])
        graph.add(gtsam.GenericProjectionFactorCal3DS2(control.mark_pixel[m], noise, x, g, K))
    for g in range(len(control)):
        surveyed = gtsam.noiseModel.Diagonal.Sigmas(control.sigma_m[g])
        graph.add(gtsam.PriorFactorPoint3(gtsam.symbol("g", g), control.position_world_m[g], surveyed))
        values.insert(gtsam.symbol("g", g), control.position_world_m[g])
    for i, pose in enumerate(block.poses):
        assert pose is not None
        values.insert(
            gtsam.symbol("x", i), gtsam.Pose3(gtsam.Rot3(pose.rotation_world_from_camera), pose.position_world_m)
        )
    for p, X in enumerate(tie.position_world_m):
        values.insert(gtsam.symbol("l", p), X)
    return graph, values


def control_only(block: SimulatedBlock) -> Block:
    """The block at its true poses and points, with a fixed camera without k3, no GNSS and no attitudes."""
    camera = block.block.cameras[0]
    fixed = Camera(
        camera.name, camera.width_px, camera.height_px, camera.focal_px, camera.principal_point_px,
        np.array([*camera.radial[:2], 0.0, 0.0]), camera.tangential,
    )  # fmt: skip
    photographs = tuple(
        replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for p in block.block.photographs
    )
    tie_points = replace(block.block.tie_points, position_world_m=block.tie_point_position_world_m)
    return replace(
        block.block, cameras=(fixed,), photographs=photographs, poses=block.truth.poses, tie_points=tie_points
    )


def test_equals_gtsams_native_graph_in_minimum_and_covariance() -> None:
    block = control_only(simulate_block(PLAN, 5, tie_points=60))
    settings = AdjustmentSettings(robust_loss="none", relative_tolerance=1e-14)
    problem = make_problem(block, settings)
    found = minimise(problem, start_state(problem), settings)
    graph, values = referee(block)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-12)
    optimum = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    assert found.cost == pytest.approx(graph.error(optimum), rel=1e-9)
    covariance = covariances(problem, found.state)
    marginals = gtsam.Marginals(graph, optimum)
    for i in range(len(block.poses)):
        expected = marginals.marginalCovariance(gtsam.symbol("x", i))
        np.testing.assert_allclose(covariance.pose(i), expected, atol=1e-5 * np.abs(expected).max())
        sigma = np.sqrt(np.diag(expected)[3:])
        centre = optimum.atPose3(gtsam.symbol("x", i)).translation()
        np.testing.assert_allclose(found.state.position[i], centre, atol=1e-4 * sigma.min())
    for p in (0, 20, 41):
        expected = marginals.marginalCovariance(gtsam.symbol("l", p))
        np.testing.assert_allclose(covariance.tie_point[p], expected, atol=1e-5 * np.abs(expected).max())


# ---- graphs that cannot be solved ----------------------------------------------------------------------------------


def test_two_points_in_plan_and_three_in_height_are_a_datum() -> None:
    """The least there is: seven coordinates for seven parameters, which none of them contradicts."""
    block = control_only(simulated(2))
    points = block.control_points
    control = np.flatnonzero([role == "control" for role in points.role])
    controlled = np.zeros((len(points), 3), dtype=bool)
    controlled[control[[0, -1]]] = True
    controlled[control[2], 2] = True
    roles: tuple[Role, ...] = tuple("control" if any(c) else "check" for c in controlled.tolist())
    few = replace(block, control_points=replace(points, role=roles, controlled=controlled))
    result = adjust(few, SETTINGS)
    off = result.estimates.ground_world_m - points.position_world_m
    assert np.abs(off[controlled]).max() < 1e-6
    assert np.isfinite(result.covariances.position_m2).all()
    in_plan = controlled & np.array([True, True, False])
    roles = tuple("control" if any(c) else "check" for c in in_plan.tolist())
    with pytest.raises(AdjustmentError, match="leave its height and its tilt open"):
        adjust(replace(few, control_points=replace(points, role=roles, controlled=in_plan)), SETTINGS)


def test_a_block_without_any_datum_says_so() -> None:
    block = control_only(simulated(0))
    points = block.control_points.with_role("check")
    with pytest.raises(AdjustmentError, match="the block has no datum"):
        adjust(replace(block, control_points=points), SETTINGS)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_gnss_in_one_line_leaves_the_strip_free_to_turn_and_says_so(seed: int) -> None:
    plan = replace(PLAN, strips=1, photographs_per_strip=5, position_noise_m=0.0)
    made = simulate_block(plan, seed, tie_points=200)
    centre = np.array([pose.position_world_m for pose in made.truth.poses])
    assert np.linalg.svd(centre - centre.mean(axis=0))[1][1] < 1e-9
    block = replace(control_only(made), control_points=made.block.control_points.with_role("check"))
    photographs = tuple(
        replace(p, gnss_world_m=centre[i], gnss_sigma_m=np.array([0.02, 0.02, 0.04]))
        for i, p in enumerate(block.photographs)
    )
    strip = replace(block, photographs=photographs, gnss_offset_sigma_m=np.zeros(3))
    with pytest.raises(AdjustmentError, match="the block as a whole: a rotation is not determined"):
        adjust(strip, SETTINGS)


def test_two_blocks_that_share_nothing_are_held_by_their_positions_or_named() -> None:
    block = simulated(0).block
    tie, points = block.tie_points, block.control_points
    second = tie.photograph >= 3
    firsts = np.bincount(tie.point[~second], minlength=len(tie))[tie.point] >= 2
    apart = np.where(firsts, ~second, second)
    rays = np.bincount(tie.point[apart], minlength=len(tie)) >= 2
    marks = points.mark_photograph < 3
    control = replace(
        points, mark_photograph=points.mark_photograph[marks], mark_point=points.mark_point[marks],
        mark_pixel=points.mark_pixel[marks], mark_covariance_px2=points.mark_covariance_px2[marks],
    )  # fmt: skip
    split = replace(block, tie_points=tie.select(rays, apart), control_points=control)
    assert adjust(split, SETTINGS).converged
    bare = tuple(
        replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        if i >= 3
        else p
        for i, p in enumerate(block.photographs)
    )
    names = "|".join(p.name for p in block.photographs[3:])
    with pytest.raises(AdjustmentError, match=f"({names}): its position or attitude is not determined"):
        adjust(replace(split, photographs=bare), SETTINGS)


def test_a_photograph_without_image_points_is_left_out() -> None:
    block = simulated(0).block
    photographs = (
        replace(block.photographs[0], attitude_world_from_camera=None, attitude_sigma_rad=None),
        *block.photographs[1:],
    )
    tie = block.tie_points
    elsewhere = tie.photograph != 0
    rays = np.bincount(tie.point[elsewhere], minlength=len(tie)) >= 2
    points = block.control_points
    marks = points.mark_photograph != 0
    control = replace(
        points, mark_photograph=points.mark_photograph[marks], mark_point=points.mark_point[marks],
        mark_pixel=points.mark_pixel[marks], mark_covariance_px2=points.mark_covariance_px2[marks],
    )  # fmt: skip
    bare = replace(block, photographs=photographs, tie_points=tie.select(rays, elsewhere), control_points=control)
    result = adjust(bare, SETTINGS)
    name = block.photographs[0].name
    assert result.block.poses[0] is None
    assert result.decisions.reason[0].startswith("0 image points, at least 3 are needed")
    assert result.decisions.reason[1:] == ("",) * 5
    assert result.warnings[0] == f"Photograph {name} is left out: {result.decisions.reason[0]}"
    np.testing.assert_array_equal(
        result.estimates.ground_world_m, adjust(without_photograph(bare, 0), SETTINGS).estimates.ground_world_m
    )


def test_a_control_point_behind_its_photograph_is_named() -> None:
    block = simulated(0).block
    control = block.control_points
    g = control.mark_point[0]
    above = control.position_world_m.copy()
    above[g, 2] += 500.0
    name, photograph = control.name[g], block.photographs[control.mark_photograph[0]].name
    with pytest.raises(AdjustmentError, match=f"{name} is marked in {photograph}"):
        adjust(replace(block, control_points=replace(control, position_world_m=above)), SETTINGS)


def test_a_photograph_without_a_pose_takes_no_part() -> None:
    block = simulated(0).block
    lost = replace(block, poses=(*block.poses[:2], None, *block.poses[3:]))
    result = adjust(lost, SETTINGS)
    assert result.block.photographs == block.photographs
    assert [pose is None for pose in result.block.poses] == [i == 2 for i in range(6)]
    assert not np.any(result.block.tie_points.photograph == 2)
    for values in (result.covariances.position_m2, result.covariances.rotation_rad2):
        assert np.flatnonzero(np.isnan(values).any(axis=(1, 2))).tolist() == [2]
    marks = block.control_points.mark_photograph == 2
    assert marks.any()
    assert np.isnan(result.estimates.mark_residual_px[marks]).all()
    without = adjust(without_photograph(block, 2), SETTINGS)
    assert result.cost == without.cost
    np.testing.assert_array_equal(np.delete(result.covariances.position_m2, 2, axis=0), without.covariances.position_m2)
    np.testing.assert_array_equal(result.estimates.ground_world_m, without.estimates.ground_world_m)
    np.testing.assert_array_equal(result.estimates.mark_residual_px[~marks], without.estimates.mark_residual_px)
    assert result.block.control_points is block.control_points


def without_photograph(block: Block, index: int) -> Block:
    """The block as if the photograph had never been taken."""
    tie, points = block.tie_points, block.control_points
    tie = tie.select(np.ones(len(tie), dtype=bool), tie.photograph != index)
    marks = points.mark_photograph != index
    number = points.mark_photograph[marks]
    control = replace(
        points, mark_photograph=number - (number > index), mark_point=points.mark_point[marks],
        mark_pixel=points.mark_pixel[marks], mark_covariance_px2=points.mark_covariance_px2[marks],
    )  # fmt: skip
    return replace(
        block,
        photographs=(*block.photographs[:index], *block.photographs[index + 1 :]),
        poses=(*block.poses[:index], *block.poses[index + 1 :]),
        tie_points=replace(tie, photograph=tie.photograph - (tie.photograph > index)),
        control_points=control,
    )


def test_without_any_pose_there_is_nothing_to_adjust() -> None:
    block = simulated(0).block
    with pytest.raises(AdjustmentError, match="no photograph is oriented"):
        adjust(replace(block, poses=(None,) * len(block.poses)), SETTINGS)


# ---- two engines ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("estimated", "alike"), [(False, 1e-9), (True, 1e-6)])
def test_both_engines_give_the_same_adjustment(estimated: bool, alike: float) -> None:
    """Sigmas are estimated from drafts, which the engines end at within their rounding alone."""
    block, settings = simulated(5, 0.05).block, replace(SETTINGS, estimate_sigmas=estimated)
    fast, slow = (adjust(block, replace(settings, engine=engine)) for engine in ("fast", "reference"))
    assert fast.converged
    assert slow.converged
    assert fast.rounds == slow.rounds
    assert fast.cost == pytest.approx(slow.cost, rel=alike)
    np.testing.assert_array_equal(fast.block.tie_points.feature, slow.block.tie_points.feature)
    np.testing.assert_allclose(
        fast.block.tie_points.position_world_m, slow.block.tie_points.position_world_m, rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(fast.covariances.position_m2, slow.covariances.position_m2, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(fast.covariances.ground_m2, slow.covariances.ground_m2, rtol=1e-6, atol=1e-12)


# ---- pieces --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_weight_is_the_derivative_of_the_cost(loss: str) -> None:
    norm = np.linspace(0.1, 20.0, 50)
    step = 1e-6

    def cost(s: FloatArray) -> FloatArray:
        return robust_terms(np.column_stack([s, np.zeros_like(s)]), loss, 3.0)[0]  # type: ignore[arg-type]

    _, weight, _ = robust_terms(np.column_stack([norm, np.zeros_like(norm)]), loss, 3.0)  # type: ignore[arg-type]
    slope = (cost(norm + step) - cost(norm - step)) / (2.0 * step)
    np.testing.assert_allclose(weight, slope / (2.0 * norm), rtol=1e-5)


def test_noise_scale_sees_through_the_freedom_of_the_points() -> None:
    # Residuals of two-ray points are half as large as the noise; the scale must come out as the noise itself.
    result = adjusted(4)
    tie = result.block.tie_points
    scale = noise_scale(result.estimates.residual_px / tie.sigma_px[:, None], tie.point, len(tie))
    assert scale == pytest.approx(1.0, abs=0.1)


def test_long_tracks_with_many_mismatches_are_intersected_from_a_bounded_number_of_pairs() -> None:
    rng = np.random.default_rng(0)
    rays = 60
    assert rays * (rays - 1) // 2 > 20 * MANY_PAIRS
    X = np.array([1.0, -2.0, 3.0])
    C = np.column_stack([rng.uniform(-30, 30, (rays, 2)), np.full(rays, 80.0)])
    R = np.tile(np.diag([1.0, -1.0, -1.0]), (rays, 1, 1))
    ideal = (X - C)[:, :2] / (X - C)[:, 2:] * np.array([-1.0, 1.0])
    pixel = ideal * 1000.0 + np.array([500.0, 400.0])
    wrong = rng.permutation(rays) < 24
    pixel[wrong] += rng.uniform(-90, 90, (24, 2)) + 30.0
    ideal = (pixel - np.array([500.0, 400.0])) / 1000.0
    pinhole = Camera("c", 1000, 800, 1000.0, np.array([500.0, 400.0]))
    cameras = oriented_cameras([pinhole], np.zeros(rays, np.int64), R, C)
    points, agreeing = consensus_intersections(
        np.array([0, rays]), np.arange(rays), pixel, ideal, np.full(rays, 3.0), cameras
    )
    np.testing.assert_allclose(points[0], X, atol=1e-6)
    assert agreeing[~wrong].all()
    assert np.count_nonzero(agreeing[wrong]) <= 1


def test_the_limit_of_a_residual_is_lower_the_fewer_rays_a_point_has() -> None:
    """The mean redundancy of a coordinate is (2n − 3) / 2n; with two rays, where it all lies in one direction, 0.64."""
    rays = [2, 3, 4, 10]
    point = np.repeat(np.arange(4), rays)
    sigma = np.random.default_rng(0).uniform(0.5, 2.0, len(point))
    nothing, count = np.zeros((4, 3)), np.arange(len(point))
    ties = TiePoints(count, point, count, np.zeros((len(point), 2)), sigma, nothing, nothing.astype(np.uint8))
    share = np.array([0.64, np.sqrt(0.5), np.sqrt(5 / 8), np.sqrt(17 / 20)])
    np.testing.assert_allclose(outlier_limit_px(ties, 1.5, 3.0), 4.5 * sigma * share[point], rtol=1e-12)


def test_a_choice_is_settled_where_one_of_twenty_thousand_differs() -> None:
    for count, differing, expected in ((19_999, 0, True), (19_999, 1, False), (40_000, 2, True), (40_000, 3, False)):
        before = np.random.default_rng(count).random(count) < 0.5
        after = before.copy()
        after[:differing] ^= True
        assert settled(before, after) is expected


def test_what_is_found_undetermined_at_the_end_is_said_with_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem(simulated(1).block, SETTINGS)

    def open_still(*_: object) -> None:
        raise IndeterminateError((POSE, 1))

    monkeypatch.setattr("photogram.adjustment.adjustment.adjustment_of", open_still)
    with pytest.raises(AdjustmentError, match=problem.block.photographs[1].name):
        _judged(cast(Ended, SimpleNamespace(whole=problem)), SETTINGS)


@pytest.mark.parametrize(("heights", "said"), [(2, "2 control points and"), (1, r"2 .*2 of them in plan, 1 in height")])
def test_what_a_block_without_a_datum_has_is_counted(heights: int, said: str) -> None:
    problem = make_problem(simulated(1).block, SETTINGS)
    bare = tuple(replace(photograph, gnss_world_m=None, gnss_sigma_m=None) for photograph in problem.block.photographs)
    sigma = np.full((2, 3), 0.01)
    sigma[heights:, 2] = np.inf
    few = replace(
        problem,
        block=replace(problem.block, photographs=bare),
        control_world_m=problem.control_world_m[:2],
        control_sigma_m=sigma,
    )
    with pytest.raises(AdjustmentError, match=f"no datum in .*: {said}"):
        check_determined(few)


@pytest.mark.parametrize(
    ("direction", "said"),
    [
        ((1.0, 0.0, 0.0), "a horizontal axis at 90° from grid north"),
        ((-1.0, 1.0, 0.0), "a horizontal axis at 135° from grid north"),
        ((1.0, -1.0, 1.0), "an axis at 135° from grid north, inclined by 35°"),
        ((1.0, -1.0, -1.0), "an axis at 315° from grid north, inclined by 35°"),
        ((0.01, 0.0, -1.0), "the vertical"),
    ],
)
def test_an_axis_is_said_by_its_azimuth(direction: tuple[float, float, float], said: str) -> None:
    assert _axis(np.array(direction) / np.linalg.norm(direction)) == said


def test_medians_of_stated_sigmas_are_those_of_plan_and_of_height() -> None:
    block = simulated(1).block
    stated = tuple(
        replace(p, gnss_sigma_m=np.array([0.01, 0.03, 0.05]) * (1 + (i == 0))) for i, p in enumerate(block.photographs)
    )
    groups = cast(TieGroups, SimpleNamespace(stated_px=np.array([0.3, 0.5, 0.9])))
    medians = _median_sigmas(replace(block, photographs=stated), groups)
    assert medians["tie_points"] == 0.5
    assert medians["gnss_height"] == pytest.approx(0.05)
    assert medians["gnss_plan"] == pytest.approx(0.025), "between 1 and 3 cm, five of six alike"


def test_the_covariances_of_poses_are_those_of_the_normal_matrix_in_the_world() -> None:
    settings = replace(SETTINGS, common_errors="none", estimate_sigmas=False)
    result = adjust(simulated(1).block, settings)
    problem = make_problem(result.block, settings)
    poses, R = covariances(problem, state_of(result)).poses, state_of(result).rotation
    found = result.covariances
    assert found.rotation_rad2.shape == found.position_m2.shape == (len(R), 3, 3)
    np.testing.assert_allclose(found.rotation_rad2, poses[:, :3, :3], rtol=1e-6, atol=1e-6 * poses[:, :3, :3].max())
    turned = np.einsum("nij,njk,nlk->nil", R, poses[:, 3:, 3:], R)
    np.testing.assert_allclose(found.position_m2, turned, rtol=1e-6, atol=1e-6 * turned.max())


def test_a_coordinate_that_nobody_surveyed_is_no_observation() -> None:
    problem = make_problem(simulated(1).block, SETTINGS)
    sigma = problem.control_sigma_m.copy()
    sigma[0, 2] = sigma[3, 0] = np.inf
    whole, without = (
        sigma0_and_redundancy(stated, start_state(problem))[1]
        for stated in (problem, replace(problem, control_sigma_m=sigma))
    )
    assert whole - without == 2


def test_a_block_of_which_more_than_a_few_photographs_are_undetermined_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One of six may be left out, two may not."""
    block, whole, asked = simulated(1).block, adjusted(1), list[int]()
    for undetermined in (1, 2):
        asked.clear()

        def adjusting(part: Block, *_: object, count: int = undetermined) -> Adjustment:
            asked.append(len(part.photographs))
            if len(asked) == 1:
                raise UndeterminedPartError("few", photographs=dict.fromkeys(range(count), "few image points"))
            return whole

        monkeypatch.setattr("photogram.adjustment.adjustment._adjust_oriented", adjusting)
        monkeypatch.setattr("photogram.adjustment.adjustment.with_all_photographs", lambda result, *_: result)
        if undetermined == 1:
            assert any("Photograph sim_0001.JPG is left out" in said for said in adjust(block, SETTINGS).warnings)
            assert asked == [6, 5]
        else:
            with pytest.raises(UndeterminedPartError):
                adjust(block, SETTINGS)
