"""Blocks that are weak, or solvable but for a photograph or a mark: what is said of them, and what is left out."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from makers import assert_same
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.oriented_subset import with_all_marks, without_marks
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.adjustment.solvability import WEAK_CAMERA, UndeterminedPartError, check_in_front, control_marks
from photogram.arrays import IntArray
from photogram.camera import Pose, project_points
from photogram.errors import AdjustmentError
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.pipeline.stages.stored_adjustment import read_adjusted_block, read_adjustment, write_adjustment
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block, CommonError

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=6, check_points=3, buildings=0, trees=0, cell_m=1.0,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip
SETTINGS = AdjustmentSettings()


@cache
def simulated(seed: int) -> SimulatedBlock:
    return simulate_block(PLAN, seed, tie_points=150, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5)


@cache
def adjusted(seed: int) -> Adjustment:
    return adjust(simulated(seed).block, SETTINGS)


def thinned(block: Block, photograph: int, points: IntArray, *, control: bool = False) -> Block:
    """The block with one photograph of few tie points, without marks, position and attitude."""
    photographs = list(block.photographs)
    photographs[photograph] = replace(
        photographs[photograph], gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None,
        attitude_sigma_rad=None,
    )  # fmt: skip
    tie, marked = block.tie_points, block.control_points
    keep = (tie.photograph != photograph) | np.isin(tie.point, points)
    rays = np.bincount(tie.point[keep], minlength=len(tie)) >= 2
    marks = (marked.mark_photograph != photograph) | control
    return replace(without_marks(block, marks), photographs=tuple(photographs), tie_points=tie.select(rays, keep))


def test_a_photograph_that_too_few_rays_hold_is_left_out_with_the_reason() -> None:
    """Four points, each seen once more elsewhere, are four conditions on six unknowns."""
    block = simulated(0).block
    tie = block.tie_points
    mine = tie.point[tie.photograph == 2]
    pairs = mine[tie.rays[mine] == 2][:4]
    assert len(pairs) == 4
    result = adjust(thinned(block, 2, pairs), SETTINGS)
    assert [pose is None for pose in result.block.poses] == [False, False, True, False, False, False]
    assert "not determined" in result.decisions.reason[2]
    assert block.photographs[2].name in result.warnings[0]
    sigma_m = np.sqrt(np.einsum("nii->ni", result.covariances.position_m2))
    for pose, truth, sigma in zip(result.block.poses, simulated(0).truth.poses, sigma_m, strict=True):
        assert pose is None or np.all(np.abs(pose.position_world_m - truth.position_world_m) < 4.5 * sigma)


def test_a_photograph_that_few_rays_hold_is_named_and_not_the_block() -> None:
    block = simulated(0).block
    tie = block.tie_points
    own = (tie.photograph == 2) & (tie.rays[tie.point] >= 3)
    mine, spot = tie.point[own], tie.pixel[own]
    near = mine[np.argsort(np.linalg.norm(spot - spot[0], axis=1))[:4]]
    result = adjust(thinned(block, 2, near), SETTINGS)
    assert all(pose is not None for pose in result.block.poses)
    weak = [w for w in result.warnings if "weakly determined" in w]
    assert len(weak) == 1
    assert weak[0].startswith(
        f"Photograph {block.photographs[2].name} is weakly determined by its 4 tie points and 0 marks"
    )
    assert not [w for w in result.warnings if "of the block" in w]
    sigma = np.sqrt(np.einsum("nii->ni", result.covariances.rotation_rad2).max(axis=1))
    assert sigma[2] > 0.05
    assert np.delete(sigma, 2).max() < 0.02
    assert adjusted(0).warnings == ()


@pytest.mark.parametrize("seed", range(4))
def test_positions_of_a_metre_nearly_in_one_line_are_a_weak_datum_with_its_sigma(seed: int) -> None:
    """Eight photographs in a line: the turn about it is known to some 0.1 rad, and is off by no more than that."""
    plan = replace(PLAN, strips=1, photographs_per_strip=8, position_noise_m=4.0)
    made = simulate_block(plan, seed, tie_points=300)
    centre = np.array([pose.position_world_m for pose in made.truth.poses])
    rng = np.random.default_rng(seed)
    photographs = tuple(
        replace(
            p, gnss_world_m=centre[i] + rng.normal(0.0, 1.0, 3), gnss_sigma_m=np.ones(3),
            attitude_world_from_camera=None, attitude_sigma_rad=None,
        )
        for i, p in enumerate(made.block.photographs)
    )  # fmt: skip
    block = replace(
        made.block, cameras=(replace(made.truth.camera, sigmas=np.zeros(12)),), photographs=photographs,
        gnss_offset_sigma_m=np.zeros(3), control_points=made.block.control_points.with_role("check"),
    )  # fmt: skip
    result = adjust(block, SETTINGS)
    whole = [w for w in result.warnings if w.startswith("The rotation of the block about a horizontal axis at")]
    assert len(whole) == 1
    assert not [w for w in result.warnings if "weakly determined" in w]
    stated = np.deg2rad(float(re.findall(r"known to ([0-9.]+)° only \(1 sigma\)", whole[0])[0]))
    sigma = np.sqrt(np.linalg.eigvalsh(result.covariances.rotation_rad2)[:, -1])
    np.testing.assert_allclose(sigma, stated, rtol=0.1)
    assert stated > 0.05
    turns = [
        np.linalg.norm(Rotation.from_matrix(q.rotation_world_from_camera @ t.rotation_world_from_camera.T).as_rotvec())
        for q, t in zip(result.block.poses, made.truth.poses, strict=True)
        if q is not None
    ]
    assert np.max(turns) < 4.0 * stated


@pytest.mark.parametrize("marked", [False, True])
def test_a_photograph_that_starts_upside_down_is_left_out(marked: bool) -> None:
    """Its tie points agree with nothing; marks of its own lie behind it and pull at nothing."""
    block = simulated(0).block
    poses = list(block.poses)
    assert poses[1] is not None
    over = poses[1].rotation_world_from_camera @ np.diag([1.0, -1.0, -1.0])
    poses[1] = Pose(over, poses[1].position_world_m)
    every = block.tie_points.point
    wrong = replace(thinned(block, 1, every, control=marked), poses=tuple(poses))
    assert np.count_nonzero(wrong.control_points.mark_photograph == 1) >= (3 if marked else 0)
    result = adjust(wrong, SETTINGS)
    assert [pose is None for pose in result.block.poses] == [False, True, False, False, False, False]
    assert ("not determined by control points" if marked else "0 image points, at least 3") in result.decisions.reason[
        1
    ]
    assert np.isnan(result.estimates.mark_residual_px[wrong.control_points.mark_photograph == 1]).all()
    kept = adjusted(0)
    error = [
        np.abs(p.position_world_m - q.position_world_m).max()
        for p, q in zip(result.block.poses, kept.block.poses, strict=True)
        if p is not None and q is not None
    ]
    assert max(error) < 0.2


def test_a_focal_length_that_nothing_tells_is_named_with_its_sigma() -> None:
    """Level ground and photographs that look straight down: few tie points and loose control hardly tell it."""
    plan = replace(PLAN, relief_m=0.0, calibration_sigmas=(np.inf, 3.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    block = simulate_block(plan, 1, tie_points=60).block
    photographs = tuple(
        replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for p in block.photographs
    )
    points = block.control_points
    loose = replace(points, sigma_m=np.full_like(points.sigma_m, 2.0))
    result = adjust(replace(block, photographs=photographs, control_points=loose), SETTINGS)
    sigma = np.sqrt(result.covariances.calibration[0, 0, 0])
    assert sigma > WEAK_CAMERA * block.cameras[0].focal_px
    named = [w for w in result.warnings if w.startswith(f"The focal length of {block.cameras[0].name} is known to")]
    assert len(named) == 1
    assert f"{sigma:.3g} px only" in named[0]


def test_an_adjustment_comes_back_from_the_workspace(tmp_path: Path) -> None:
    plain = adjusted(0)
    error = replace(plain.decisions.common_errors[0], as_well="an arm")
    arm = CommonError("lever_arm", None, 0, np.ones(2), np.array([0.05, 0.01]), np.eye(3)[:, :2])
    other = replace(error, error=arm, estimate=np.array([0.05, 0.01, np.nan]), p=float("nan"))
    reason = ("", "left out", "", "", "", "")
    result = replace(
        plain,
        warnings=("One.", "Two, after it: ä."),
        decisions=replace(plain.decisions, common_errors=(error, other), reason=reason),
    )
    write_adjustment(tmp_path, result)
    block = read_adjusted_block(result.block, tmp_path.joinpath)
    assert [e.kind for e in block.common_errors] == ["attitude", "lever_arm"]
    assert_same(block.poses, result.block.poses)
    assert_same(block.tie_points, result.block.tie_points)
    assert_same(replace(read_adjustment(block, tmp_path.joinpath), block=result.block), result)


def test_a_check_point_whose_marks_do_not_meet_is_named_and_has_no_position() -> None:
    block = simulated(0).block
    points = block.control_points
    count = np.bincount(points.mark_point, minlength=len(points))
    checks = [g for g, role in enumerate(points.role) if role == "check" and count[g] >= 2]
    g = checks[0]
    mine = np.flatnonzero(points.mark_point == g)[:2]
    a, b = points.mark_photograph[mine]
    keep = (points.mark_point != g) | np.isin(np.arange(len(points.mark_point)), mine)
    pixel = points.mark_pixel.copy()
    camera = block.cameras[0]
    base = simulated(0).truth.poses[b].position_world_m - simulated(0).truth.poses[a].position_world_m
    for mark, photograph, away in ((mine[0], a, -1.0), (mine[1], b, 1.0)):
        # each looks away from the other: their rays part
        pose = simulated(0).truth.poses[photograph]
        target = pose.position_world_m + np.array([0.0, 0.0, -50.0]) + away * 15.0 * base / np.linalg.norm(base)
        pixel[mark] = project_points(camera, pose, target[None])[0]
    wrong = without_marks(replace(block, control_points=replace(points, mark_pixel=pixel)), keep)
    result = adjust(wrong, SETTINGS)
    assert np.isnan(result.estimates.ground_world_m[g]).all()
    assert np.isnan(result.covariances.ground_m2[g]).all()
    others = [c for c in checks if c != g]
    assert np.isfinite(result.estimates.ground_world_m[others]).all()
    names = f"{block.photographs[a].name}, {block.photographs[b].name}"
    assert f"Check point {points.name[g]} has no adjusted position, because its marks in {names}" in result.warnings[0]


def solved(block: Block) -> tuple[Problem, State]:
    """Problem and state of a block at its start, for what is said of turned photographs."""
    problem = make_problem(block, SETTINGS)
    state = start_state(problem)
    return problem, replace(state, tie_point=simulated(0).tie_point_position_world_m)


def test_a_photograph_or_mark_turned_over_alone_is_named_for_being_left_out() -> None:
    problem, state = solved(simulated(0).block)
    check_in_front(problem, state)
    over = state.rotation.copy()
    over[1] = over[1] @ np.diag([1.0, -1.0, -1.0])
    with pytest.raises(UndeterminedPartError, match="points lie behind the cameras") as fault:
        check_in_front(problem, replace(state, cameras=state.cameras._replace(rotation=over)))
    assert list(fault.value.photographs) == [1]
    assert not fault.value.marks
    alone = problem.with_tie_observations(problem.tie.select(problem.tie.photograph != 1))
    mine = np.flatnonzero(problem.marks.photograph == 1)
    assert len(mine) > 1
    number = control_marks(problem.block)[mine[0]]
    one = np.ones(len(problem.block.control_points.mark_point), dtype=bool)
    one[control_marks(problem.block)[mine[1:]]] = False
    single = make_problem(without_marks(problem.block, one), SETTINGS).with_tie_observations(alone.tie)
    with pytest.raises(UndeterminedPartError, match="lies behind it") as fault:
        check_in_front(single, replace(state, cameras=state.cameras._replace(rotation=over)))
    assert list(fault.value.marks) == [int(np.count_nonzero(one[:number]))]
    over[2] = over[1]
    with pytest.raises(AdjustmentError) as both:
        check_in_front(problem, replace(state, cameras=state.cameras._replace(rotation=over)))
    assert not isinstance(both.value, UndeterminedPartError)


def test_a_mark_that_is_left_out_has_no_residual() -> None:
    block = simulated(0).block
    kept = np.ones(len(block.control_points.mark_point), dtype=bool)
    kept[3] = False
    part = adjust(without_marks(block, kept), SETTINGS)
    whole = with_all_marks(part, block, kept)
    assert whole.block.control_points is block.control_points
    assert np.isnan(whole.estimates.mark_residual_px[3]).all()
    np.testing.assert_array_equal(whole.estimates.mark_residual_px[kept], part.estimates.mark_residual_px)
    assert len(whole.tests.reliability.mark_w) == len(kept)
