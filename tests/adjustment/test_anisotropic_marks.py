"""Marks with a covariance: what the adjustment makes of it, against the truth and against GTSAM's graph."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.constraints.between_points import Distance
from photogram.factors.elimination.reprojection import Observations, linearise, observed_marks, residuals
from photogram.measures.mark_covariances import isotropic_px2, lower_factors
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

MAJOR_PX, MINOR_PX = 3.0, 0.15
PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=8, check_points=6, mark_sigma_px=1e-9,
    gnss_sigma_m=(2.0, 2.0, 4.0), gnss_offset_sigma_m=(1.0, 1.0, 2.0),
    calibration_sigmas=(1.0, 0.5, 0.5, *(0.0,) * 8),
)  # fmt: skip
SEEDS = range(1, 11)
SETTINGS = AdjustmentSettings(estimate_sigmas=False)


def of_axes(angle_rad: FloatArray, major_px: float, minor_px: float) -> FloatArray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    R = np.array([[c, -s], [s, c]]).transpose(2, 0, 1)
    return np.asarray(R @ np.diag([major_px**2, minor_px**2]) @ R.transpose(0, 2, 1))


@cache
def survey(seed: int) -> Block:
    """Marks that scatter 20 times as much along one direction, another for each, as across it."""
    block = simulate_block(PLAN, seed, tie_points=120, start_position_sigma_m=0.2, start_attitude_sigma_deg=0.2).block
    points, rng = block.control_points, np.random.default_rng(seed)
    covariance = of_axes(rng.uniform(0.0, np.pi, len(points.mark_point)), MAJOR_PX, MINOR_PX)
    noise = np.einsum("mij,mj->mi", lower_factors(covariance), rng.standard_normal(points.mark_pixel.shape))
    marked = replace(points, mark_pixel=points.mark_pixel + noise, mark_covariance_px2=covariance)
    return replace(block, control_points=marked)


@cache
def adjusted(seed: int, isotropic: bool = False) -> Adjustment:
    block = survey(seed)
    if isotropic:
        points = block.control_points
        block = replace(block, control_points=replace(points, mark_covariance_px2=isotropic_px2(points.mark_sigma_px)))
    return adjust(block, SETTINGS)


def check_errors(result: Adjustment) -> tuple[FloatArray, FloatArray]:
    """Adjusted minus surveyed (C, 3) of the check points, and the covariances (C, 3, 3) of that."""
    points = result.block.control_points
    checks = np.array(points.role) == "check"
    axes = result.block.frame.rotation_world_from_map(np.zeros(3))
    surveyed = axes @ (points.sigma_m[checks][:, :, None] ** 2 * axes.T)
    return (result.estimates.ground_world_m - points.position_world_m)[checks], result.covariances.ground_m2[
        checks
    ] + surveyed


def test_check_points_scatter_as_predicted_and_less_than_with_one_number_for_each_mark() -> None:
    squares, sums = list[FloatArray](), {False: 0.0, True: 0.0}
    for seed in SEEDS:
        off, covariance = check_errors(adjusted(seed))
        squares.append(np.einsum("ki,ki->k", off, np.linalg.solve(covariance, off[..., None])[..., 0]))
        for isotropic in sums:
            sums[isotropic] += float(np.sum(check_errors(adjusted(seed, isotropic))[0] ** 2))
    # points of a survey share its cameras: the bounds are those of a third as many degrees of freedom
    T = np.concatenate(squares)
    low, high = (float(chi2.ppf(share, len(T))) / len(T) for share in (0.001, 0.999))
    assert low < np.mean(T) / 3.0 < high
    assert sums[False] < 0.5 * sums[True]


def test_whitened_residuals_of_marks_scatter_by_their_redundancy() -> None:
    total, redundancy = 0.0, 0.0
    for seed in SEEDS:
        r = adjusted(seed).tests.reliability
        known = np.isfinite(r.mark_w)
        total += float(np.sum(r.mark_w[known] ** 2 * r.mark_redundancy[known]))
        redundancy += float(np.sum(r.mark_redundancy[known]))
        parts = adjusted(seed).tests.components
        at = parts.group.tolist().index("marks")
        assert parts.squares[at] == pytest.approx(np.sum(r.mark_w[known] ** 2 * r.mark_redundancy[known]), rel=1e-9)
    low, high = (float(chi2.ppf(share, redundancy)) for share in (0.0005, 0.9995))
    assert low < total < high


def test_a_mark_left_out_is_predicted_with_its_covariance() -> None:
    T = []
    for seed in SEEDS:
        r = adjusted(seed).tests.reliability
        for off, covariance in zip(r.mark_left_out_px, r.mark_left_out_covariance_px2, strict=True):
            if np.isfinite(off).all():
                T.append(float(off @ np.linalg.solve(covariance, off)))
    assert 1.7 < np.mean(T) < 2.3


@pytest.mark.parametrize("joined", [False, True])
def test_both_engines_come_to_the_same(joined: bool) -> None:
    block = survey(1)
    if joined:  # control points that a distance joins are unknowns of the border, and their marks ground terms
        ends = block.control_points.position_world_m[:2]
        length = float(np.linalg.norm(ends[0] - ends[1]))
        names = block.control_points.name
        block = replace(block, constraints=(Distance(ends=(names[0], names[1]), length_m=length, sigma_m=0.01),))
    tight = replace(SETTINGS, relative_tolerance=1e-14, robust_loss="none")
    fast, slow = (adjust(block, replace(tight, engine=engine)) for engine in ("fast", "reference"))
    np.testing.assert_allclose(fast.estimates.ground_world_m, slow.estimates.ground_world_m, rtol=0, atol=2e-7)
    np.testing.assert_allclose(fast.cost, slow.cost, rtol=1e-9)
    np.testing.assert_allclose(fast.covariances.ground_m2, slow.covariances.ground_m2, rtol=1e-6, atol=1e-12)
    for mine, theirs in zip(fast.block.poses, slow.block.poses, strict=True):
        assert mine is not None
        assert theirs is not None
        np.testing.assert_allclose(mine.position_world_m, theirs.position_world_m, rtol=0, atol=2e-7)


def test_the_other_solver_comes_to_the_same() -> None:
    other = adjust(survey(2), replace(SETTINGS, solver="gtsam"))
    np.testing.assert_allclose(other.estimates.ground_world_m, adjusted(2).estimates.ground_world_m, rtol=0, atol=1e-6)


def test_a_residual_is_whitened_by_the_inverse_factor_of_its_covariance() -> None:
    block = survey(1)
    problem = make_problem(block, SETTINGS)
    state = start_state(problem)
    points = problem.block.control_points.with_role("control")
    marks, X = problem.marks, state.control
    plain = Observations(marks.photograph, marks.point, marks.pixel, np.ones(len(marks)))
    inverse = np.linalg.inv(lower_factors(points.mark_covariance_px2))
    expected = np.einsum("mij,mj->mi", inverse, residuals(plain, state.cameras, X))
    np.testing.assert_allclose(residuals(marks, state.cameras, X), expected, rtol=1e-11, atol=1e-11)
    linear = linearise(marks, state.cameras, X)
    np.testing.assert_allclose(linear.residual, expected, rtol=1e-11, atol=1e-11)
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis]
        slope = (residuals(marks, state.cameras, X + step) - residuals(marks, state.cameras, X - step)) / 2e-4
        np.testing.assert_allclose(linear.point[:, :, axis], slope, rtol=1e-5, atol=1e-4)


def test_isotropic_marks_among_others_are_whitened_to_the_last_bit_as_alone() -> None:
    block = survey(1)
    points = block.control_points
    alone = replace(points, mark_covariance_px2=isotropic_px2(np.linspace(0.1, 2.0, len(points.mark_point))))
    mixed = alone.mark_covariance_px2.copy()
    mixed[0] = points.mark_covariance_px2[0]
    rest = np.arange(1, len(points.mark_point))
    one = observed_marks(alone, rest)
    other = observed_marks(replace(points, mark_covariance_px2=mixed), np.arange(len(mixed))).select(rest)
    assert len(one.mixing) == 0
    assert len(other.mixing) == len(rest)
    cameras, X = block.oriented_cameras(), points.position_world_m
    np.testing.assert_array_equal(residuals(one, cameras, X), residuals(other, cameras, X))
    np.testing.assert_array_equal(linearise(one, cameras, X).point, linearise(other, cameras, X).point)
