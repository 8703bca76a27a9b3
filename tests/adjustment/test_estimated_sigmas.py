"""Sigmas of tie points from their residuals: exact redundancies, known scatter, blurred photographs, bounds."""

from dataclasses import replace

import numpy as np
import pytest
from makers import LEAST_SQUARES, problem_of, simulated
from referees import whole_covariance

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.stochastic_model.estimated_sigmas import (
    CORRELATED,
    FLOOR_PX,
    KEY_POINTS,
    PHOTOGRAPH,
    kept_share,
    stated_again,
    taken_by_cameras,
    tie_groups,
    tie_scatter,
)
from photogram.arrays import FloatArray
from photogram.factors.elimination.loss import RobustLoss, robust_terms
from photogram.factors.elimination.reprojection import linearise
from photogram.factors.graph import Problem
from photogram.factors.joint_covariance import points_redundancy
from photogram.factors.variables import CALIBRATION, POSE, TIE_POINT, key
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import TRANSFERRED, Block

PLAN = SurveyPlan(strips=2, photographs_per_strip=5, forward_overlap=0.8, control_points=5, check_points=2)
STATED_PX = 0.5


def noisy(
    seed: int, sigma_px: tuple[float, float], *, blurred: int | None = None, points: int = 300, mismatches: float = 0.03
) -> Block:
    """A survey whose key points and points by correlation scatter by sigmas that nobody states; one photograph by
    four times as much."""
    rng = np.random.default_rng([seed, 5])
    block = simulate_block(
        PLAN, seed, tie_points=points, sigma_px=1e-3, mismatches=mismatches, start_position_sigma_m=0.1,
        start_attitude_sigma_deg=0.1, start_point_sigma_m=0.1,
    ).block  # fmt: skip
    tie = block.tie_points
    n = len(tie.photograph)
    correlated = rng.random(n) < 0.5
    true_px = np.where(correlated, sigma_px[1], sigma_px[0])
    if blurred is not None:
        true_px = np.where(tie.photograph == blurred, 4.0 * true_px, true_px)
    tie = replace(
        tie,
        feature=np.where(correlated, TRANSFERRED, tie.feature),
        pixel=tie.pixel + true_px[:, None] * rng.standard_normal((n, 2)),
        sigma_px=np.full(n, STATED_PX),
    )
    return replace(block, tie_points=tie)


def exact_redundancy(problem: Problem, state: object) -> FloatArray:
    """Redundancy numbers (N,) of both coordinates together, from the inverse of the whole normal matrix."""
    covariance, place = whole_covariance(problem, state)  # type: ignore[arg-type]
    tie = problem.tie
    linear = linearise(tie, state.cameras, state.tie_point)  # type: ignore[attr-defined]
    found = np.empty(len(tie))
    for i in range(len(tie)):
        camera = int(linear.camera[i])
        variables = key(POSE, int(tie.photograph[i])), key(TIE_POINT, int(tie.point[i])), key(CALIBRATION, camera)
        columns = np.concatenate([np.arange(place[v].start, place[v].stop) for v in variables])
        calibration = (linear.calibration[i] * problem.scale[camera])[:, problem.free[camera]]
        J = np.hstack([linear.pose[i], linear.point[i], calibration])
        found[i] = 2.0 - np.trace(J @ covariance[np.ix_(columns, columns)] @ J.T)
    return found


def test_redundancies_are_those_of_the_whole_system() -> None:
    """The referee is the inverse of GTSAM's whole normal matrix; the approximation knows the points' own alone."""
    block = noisy(1, (0.2, 0.4), points=120, mismatches=0.0)
    problem, state = problem_of(block)
    exact, groups = exact_redundancy(problem, state), tie_groups(block)
    own = points_redundancy(problem, state)
    assert own.sum() == pytest.approx(2 * len(problem.tie) - 3 * len(block.tie_points), abs=1e-6)
    for taken, close in ((float(own.sum() - exact.sum()), 0.01), (taken_by_cameras(problem), 0.06)):
        found = tie_scatter(problem, state, groups, np.full(len(own), 100.0), taken)
        assert found is not None
        assert found.redundancy.sum() == pytest.approx(own.sum() - taken, rel=1e-9)
        for k in range(2):
            mine = groups.group == k
            assert found.redundancy[mine].sum() == pytest.approx(exact[mine].sum(), rel=close)
        of_photograph = np.bincount(problem.tie.photograph, found.redundancy)
        np.testing.assert_allclose(of_photograph, np.bincount(problem.tie.photograph, exact), rtol=0.1)


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy"])
@pytest.mark.parametrize(("count", "own"), [(2, 0.5), (4, 1.25)])
def test_loss_and_limit_leave_as_much_of_normal_errors_as_drawn(loss: RobustLoss, count: int, own: float) -> None:
    problem, _ = problem_of(simulated(PLAN, 1).block, loss)
    threshold, limit = 1.0, 1.5  # far within the errors, so that much is left out
    problem = replace(problem, robust_threshold=threshold)
    problem = problem.with_tie_observations(
        replace(problem.tie.select(np.arange(count)), point=np.zeros(count, dtype=np.int64))
    )
    share = kept_share(problem, np.full(count, own), np.full(count, limit))
    draws = np.random.default_rng(3).standard_normal((400_000, 2)) * np.sqrt(own if count == 2 else 0.5 * own)
    if count == 2:
        draws[:, 1] = 0.0
    draws = draws[np.linalg.norm(draws, axis=1) < limit]
    _, weight, _ = robust_terms(draws, loss, threshold)
    drawn = np.mean(weight * np.sum(draws**2, axis=1)) / own
    assert drawn < 0.9
    np.testing.assert_allclose(share, drawn, rtol=0.01)


@pytest.mark.parametrize("sigma_px", [(0.12, 0.45), (0.55, 0.2)])
def test_sigmas_of_key_points_and_of_correlation_are_found(sigma_px: tuple[float, float]) -> None:
    ratios, sigma0 = [], []
    for seed in range(3):
        result = adjust(noisy(10 + seed, sigma_px), AdjustmentSettings())
        s = result.decisions.sigmas
        assert s.kind.tolist() == [KEY_POINTS, CORRELATED]
        assert s.of.tolist() == ["simulated"] * 2
        np.testing.assert_allclose(s.stated_sigma, STATED_PX)
        np.testing.assert_allclose(s.used_sigma, s.factor * STATED_PX)
        np.testing.assert_allclose(s.estimated_sigma, s.used_sigma, rtol=0.011)
        correlated = result.block.tie_points.feature == TRANSFERRED
        np.testing.assert_allclose(result.block.tie_points.sigma_px, s.used_sigma[correlated.astype(int)])
        ratios.append(s.used_sigma / sigma_px)
        sigma0.append(result.sigma0)
    assert np.all(np.abs(np.array(ratios) - 1.0) < 0.1)
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.05)
    np.testing.assert_allclose(sigma0, 1.0, atol=0.05)


def test_a_blurred_photograph_has_a_factor_of_its_own_and_is_named() -> None:
    result = adjust(noisy(3, (0.2, 0.2), blurred=4), AdjustmentSettings())
    s = result.decisions.sigmas
    assert s.kind.tolist() == [KEY_POINTS, CORRELATED, PHOTOGRAPH]
    assert s.of[2] == result.block.photographs[4].name
    assert s.factor[2] == pytest.approx(4.0, rel=0.2)
    np.testing.assert_allclose(s.used_sigma[:2], 0.2, rtol=0.1)
    said = [text for text in result.warnings if s.of[2] in text]
    assert len(said) == 1
    assert "blurred" in said[0]
    tie = result.block.tie_points
    assert np.median(tie.sigma_px[tie.photograph == 4]) == pytest.approx(0.8, rel=0.25)


def test_sharp_photographs_are_not_accused() -> None:
    for seed in range(4):
        result = adjust(noisy(30 + seed, (0.2, 0.5)), AdjustmentSettings())
        assert PHOTOGRAPH not in result.decisions.sigmas.kind.tolist()
        assert not result.warnings


def test_sigmas_stay_as_stated_where_asked_for_or_too_little_speaks() -> None:
    block = noisy(5, (0.1, 0.1))
    result = adjust(block, AdjustmentSettings(estimate_sigmas=False))
    assert len(result.decisions.sigmas) == 0
    np.testing.assert_array_equal(result.block.tie_points.sigma_px, STATED_PX)
    few = block.tie_points.select(np.arange(len(block.tie_points)) < 20)
    result = adjust(replace(block, tie_points=few), AdjustmentSettings())
    np.testing.assert_array_equal(result.block.tie_points.sigma_px, STATED_PX)
    assert np.isnan(result.decisions.sigmas.estimated_sigma).all()
    np.testing.assert_array_equal(result.decisions.sigmas.factor, 1.0)


def test_no_sigma_falls_below_the_floor() -> None:
    result = adjust(noisy(6, (0.01, 0.01), mismatches=0.0), AdjustmentSettings())
    np.testing.assert_allclose(result.decisions.sigmas.used_sigma, FLOOR_PX)
    assert np.all(result.decisions.sigmas.estimated_sigma < 0.02)


def test_sigmas_that_are_given_are_used_and_give_the_same_result() -> None:
    block = noisy(7, (0.15, 0.3), blurred=2)
    first = adjust(block, AdjustmentSettings())
    again = adjust(block, AdjustmentSettings(), sigmas=first.decisions.sigmas)
    np.testing.assert_array_equal(again.decisions.sigmas.factor, first.decisions.sigmas.factor)
    assert again.cost == pytest.approx(first.cost, rel=0.02)  # an observation at the limit may change sides
    tie = stated_again(first.block, first.decisions.sigmas).tie_points
    np.testing.assert_allclose(tie.sigma_px, STATED_PX)


def test_least_squares_without_loss_or_limits_needs_no_correction() -> None:
    settings = replace(LEAST_SQUARES, estimate_sigmas=True)
    result = adjust(noisy(8, (0.25, 0.25), mismatches=0.0), settings)
    np.testing.assert_allclose(result.decisions.sigmas.used_sigma, 0.25, rtol=0.08)
    assert result.sigma0 == pytest.approx(1.0, abs=0.05)
