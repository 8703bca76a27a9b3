"""The RANSAC experiment: exact geometry, OpenCV as the referee, and its theory within statistical bounds."""

from itertools import combinations
from math import comb
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, chisquare

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import PhotogramError
from photogram.teaching.ransac_study import (
    RansacStudy,
    draw_samples,
    epipolar_residual,
    fundamental_matrix,
    needed_iterations,
    study,
    success_probability,
)

K = np.array([[3660.0, 0, 2430], [0, 3660.0, 1620], [0, 0, 1]])


def two_photographs(count: int, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels (N, 2) of points over a hillside in two photographs, and the F that they obey."""
    random = np.random.default_rng(seed)
    world = random.uniform([-30, -20, 45], [30, 20, 60], (count, 3))
    angle = random.normal(0, 0.05, 3) + np.array([0, 0, 0.3])
    R = cv2.Rodrigues(angle)[0]
    t = np.array([8.0, 3.0, 0.5])
    first = world @ K.T
    second = (world @ R.T + t) @ K.T
    skew = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    F = np.linalg.inv(K).T @ skew @ R @ np.linalg.inv(K)
    return first[:, :2] / first[:, 2:], second[:, :2] / second[:, 2:], F / np.linalg.norm(F)


def with_outliers(count: int, fraction: float, seed: int) -> tuple[FloatArray, FloatArray, BoolArray]:
    first, second, _ = two_photographs(count, seed)
    random = np.random.default_rng(seed + 100)
    wrong = np.arange(count) < round(count * fraction)
    second[wrong] = random.uniform([0, 0], [4860, 3240], (wrong.sum(), 2))
    return first, second, ~wrong


@pytest.mark.parametrize("count", [8, 9, 24, 500])
def test_exact_points_give_the_true_matrix_and_no_residual(count: int) -> None:
    first, second, truth = two_photographs(count, seed=count)
    F = fundamental_matrix(first, second)
    assert min(np.abs(F - truth).max(), np.abs(F + truth).max()) < 1e-8
    for kind in ("sampson", "symmetric"):
        assert epipolar_residual(F, first, second, kind).max() < 1e-6
    assert abs(np.linalg.det(F / np.abs(F).max())) < 1e-12


def test_agrees_with_opencv_on_noisy_points() -> None:
    first, second, _ = two_photographs(60, seed=4)
    random = np.random.default_rng(4)
    first, second = first + random.normal(0, 1, first.shape), second + random.normal(0, 1, second.shape)
    F = fundamental_matrix(first, second)
    referee, _ = cv2.findFundamentalMat(first, second, cv2.FM_8POINT)
    np.testing.assert_allclose(F / F[2, 2], referee / referee[2, 2], rtol=1e-5, atol=1e-10)
    sampson = [cv2.sampsonDistance(np.append(a, 1.0), np.append(b, 1.0), F) for a, b in zip(first, second, strict=True)]
    np.testing.assert_allclose(epipolar_residual(F, first, second) ** 2, sampson, rtol=1e-9)


def test_a_batch_is_its_members() -> None:
    first, second, _ = two_photographs(100, seed=1)
    first = first + np.random.default_rng(1).normal(0, 1, first.shape)
    sample = draw_samples(100, 12, 7, np.random.default_rng(2))
    batch = fundamental_matrix(first[sample], second[sample])
    residual = epipolar_residual(batch, first, second, "symmetric")
    assert residual.shape == (7, 100)
    for i, rows in enumerate(sample):
        one = fundamental_matrix(first[rows], second[rows])
        np.testing.assert_allclose(np.sign(np.sum(one * batch[i])) * one, batch[i], atol=1e-12)
        np.testing.assert_allclose(epipolar_residual(batch[i], first, second, "symmetric"), residual[i], rtol=1e-9)


def test_residuals_are_pixels_and_the_algebraic_one_is_not() -> None:
    first, second, F = two_photographs(400, seed=6)
    line = np.column_stack([first, np.ones(400)]) @ F.T
    normal = line[:, :2] / np.linalg.norm(line[:, :2], axis=1, keepdims=True)
    moved = second + 3.0 * normal
    by_hand = np.abs(np.sum(line[:, :2] * moved, axis=1) + line[:, 2]) / np.linalg.norm(line[:, :2], axis=1)
    np.testing.assert_allclose(by_hand, 3.0, atol=1e-6)
    # 3 px off one line of two: about 3/√2 px to the nearest pair, and √(3² + 3²) px over both lines
    np.testing.assert_allclose(epipolar_residual(F, first, moved), 3 / np.sqrt(2), rtol=0.15)
    np.testing.assert_allclose(epipolar_residual(F, first, moved, "symmetric"), 3 * np.sqrt(2), rtol=0.15)
    algebraic = epipolar_residual(F, first, moved, "algebraic")
    shrunk = fundamental_matrix(first / 4, second / 4)
    small = epipolar_residual(shrunk, first / 4, moved / 4, "algebraic")
    pixels = epipolar_residual(shrunk, first / 4, moved / 4)
    np.testing.assert_allclose(pixels, epipolar_residual(F, first, moved) / 4, rtol=1e-6)
    assert abs(np.median(small / algebraic) / 0.25 - 1) > 0.5


def test_samples_are_distinct_and_every_subset_is_equally_likely() -> None:
    sample = np.sort(draw_samples(6, 3, 20_000, np.random.default_rng(0)), axis=1)
    assert np.all(np.diff(sample, axis=1) > 0)
    subsets = dict.fromkeys(combinations(range(6), 3), 0)
    for subset, count in zip(*np.unique(sample, axis=0, return_counts=True), strict=True):
        subsets[tuple(subset.tolist())] = int(count)
    assert len(subsets) == comb(6, 3)
    assert chisquare(list(subsets.values())).pvalue > 1e-3
    assert np.all(np.sort(draw_samples(8, 8, 5, np.random.default_rng(1)), axis=1) == np.arange(8))


def test_success_frequency_agrees_with_theory() -> None:
    iterations = 4000
    first, second, good = with_outliers(400, 0.3, seed=11)
    result = study(first, second, (iterations,), (8, 12), (0.5,), seed=3)
    for s, size in enumerate(result.sample_sizes):
        # exact points: a sample without outliers, and hardly any other, finds every inlier
        hits = int(np.sum(result.inliers[s, 0] >= good.sum()))
        low, high = (binom.ppf(q, iterations, 0.7**size) for q in (0.0005, 0.9995))
        assert low <= hits <= high
        assert result.inliers[s, 0].max() <= good.sum() + 8
    # the first success of 200 blocks of n iterations, against 1 − (1 − wˢ)ⁿ
    n = 20
    success = (result.inliers[0, 0] >= good.sum()).reshape(-1, n).any(axis=1)
    probability = float(success_probability(0.7, 8, n))
    low, high = (binom.ppf(q, len(success), probability) for q in (0.0005, 0.9995))
    assert low <= success.sum() <= high


@settings(max_examples=50, deadline=None)
@given(w=st.floats(0.05, 0.99), s=st.integers(1, 24), p=st.floats(0.5, 0.9999))
def test_needed_iterations_reach_their_probability(w: float, s: int, p: float) -> None:
    needed = float(needed_iterations(w, s, p))
    reached = 1 - (1 - w**s) ** needed
    if needed > 1 and needed < 1e6:
        assert reached == pytest.approx(p, rel=1e-4)
    assert needed >= 1


def test_needed_iterations_by_hand() -> None:
    # the table of Hartley & Zisserman 2004, p. 119: half outliers, samples of 8, 99 %
    assert np.ceil(needed_iterations(0.5, 8)) == 1177
    assert np.ceil(needed_iterations(0.7, 8)) == 78
    assert np.isinf(needed_iterations(0.0, 8))
    assert needed_iterations(1.0, 8) == 1
    assert success_probability(0.5, 1, np.array([1, 2, 3])).tolist() == [0.5, 0.75, 0.875]


def test_a_study_reports_what_it_ran() -> None:
    first, second, good = with_outliers(150, 0.25, seed=2)
    second = second + np.random.default_rng(5).normal(0, 0.5, second.shape)
    result = study(first, second, (5, 60), (8, 16), (1.0, 4.0), seed=7)
    assert result.inliers.shape == (2, 2, 60)
    assert np.all(result.inliers[:, 1] >= result.inliers[:, 0])
    np.testing.assert_array_equal(result.best_inliers[..., 1], result.inliers.max(axis=2))
    np.testing.assert_array_equal(result.best_inliers[..., 0], result.inliers[..., :5].max(axis=2))
    np.testing.assert_array_equal(result.running_best[..., -1], result.inliers.max(axis=2))
    for s in range(2):
        for t, limit in enumerate(result.thresholds_px):
            count = np.sum(epipolar_residual(result.best_fundamental[s, t], first, second) <= limit)
            assert count == result.inliers[s, t].max()
            reached = result.first_reached()[s, t]
            goal = 0.95 * result.inliers[:, t].max()
            if reached:
                assert result.running_best[s, t, reached - 1] >= goal
                assert reached == 1 or result.running_best[s, t, reached - 2] < goal
            else:
                assert result.inliers[s, t].max() < goal
    assert result.inlier_fraction[1] == pytest.approx(good.mean(), abs=0.1)


def test_a_seed_repeats_and_sample_sizes_do_not_disturb_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, _ = with_outliers(120, 0.3, seed=5)
    both: RansacStudy = study(first, second, (50,), (8, 12), (1.0,), seed=1)
    monkeypatch.setattr("photogram.teaching.ransac_study.BATCH_RESIDUALS", 120 * 7)
    alone = study(first, second, (50,), (12,), (1.0,), seed=1)
    np.testing.assert_array_equal(both.inliers[1], alone.inliers[0])
    assert np.any(study(first, second, (50,), (12,), (1.0,), seed=2).inliers != alone.inliers)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sample_sizes": (7,)}, "at least 8"),
        ({"sample_sizes": (24,)}, "20 matches"),
        ({"iterations": ()}, "at least one"),
        ({"iterations": (0,)}, "iterations: must be a finite number above 0"),
        ({"thresholds_px": (-1.0,)}, "thresholds_px: must be a finite number above 0"),
        ({"residual": "sampsom"}, "sampson, symmetric, algebraic"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], message: str) -> None:
    first, second, _ = two_photographs(20)
    with pytest.raises(PhotogramError, match=message):
        study(first, second, **{"sample_sizes": (8,), **options})
