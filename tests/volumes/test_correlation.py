"""Sums of errors that neighbours share, against the covariance matrix of all of them."""

import numpy as np
import pytest

from photogram.volumes.correlation import (
    correlation_weights,
    gathered,
    independent_points,
    mean_correlation,
    reach_cells,
)

CELL_M, LENGTH_M = 0.2, 0.9


def overlap(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the share of a window around one place that lies in the window around another, for all pairs."""
    off = np.abs(first[:, None] - second[None])
    return np.asarray(np.prod(np.maximum(1.0 - off / LENGTH_M, 0.0), axis=2))


def test_weights_are_one_for_itself_and_end_at_the_width_of_a_window() -> None:
    np.testing.assert_allclose(correlation_weights(1.0, 0.25), [0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25])
    assert correlation_weights(0.1, 0.25).tolist() == [1.0]
    assert reach_cells(1.0, 0.25) == 3


def test_a_sum_has_the_variance_of_the_covariance_matrix() -> None:
    rng = np.random.default_rng(1)
    weighted = rng.standard_normal((9, 13))  # unequal sides: rows and columns are not exchanged
    place = np.stack(np.meshgrid(np.arange(9), np.arange(13), indexing="ij"), axis=2).reshape(-1, 2) * CELL_M
    flat = weighted.ravel()
    by_matrix = flat @ overlap(place, place) @ flat
    assert np.sum(weighted * gathered(weighted, LENGTH_M, CELL_M)) == pytest.approx(by_matrix, rel=1e-12)


def test_the_mean_correlation_of_a_disc_is_that_of_random_points() -> None:
    rng = np.random.default_rng(2)
    for ratio in (0.1, 0.8, 1.6, 5.0):
        angle, radius = rng.uniform(0, 2 * np.pi, (2, 200_000)), ratio / 2 * np.sqrt(rng.uniform(0, 1, (2, 200_000)))
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        rho = np.maximum(1 - np.abs(x[0] - x[1]), 0) * np.maximum(1 - np.abs(y[0] - y[1]), 0)
        assert mean_correlation(ratio) == pytest.approx(rho.mean(), rel=0.02)


def test_points_far_apart_are_independent_and_close_ones_count_as_one() -> None:
    count = np.full(3, 40.0)
    np.testing.assert_allclose(independent_points(count, 1.0, 0.0), 40.0)
    np.testing.assert_allclose(independent_points(count, 0.01, 100.0), 1.0, rtol=1e-3)
    some = independent_points(np.array([50.0, 50.0, 25.0]), 0.4, 0.5)
    assert some[2] < some[0] < 50.0  # at a rim fewer, and closer together
