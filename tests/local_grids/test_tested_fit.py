"""The tests of residuals, beside fits that really leave observations out."""

import numpy as np
import pytest

from photogram.local_grids.tested_fit import TestedFit, fit


def straight_line(seed: int = 0, n: int = 9) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A = np.column_stack([np.ones(n), rng.uniform(-5, 5, n), rng.normal(size=n)])
    sigma = rng.uniform(0.5, 2.0, n)
    return A, A @ np.array([1.0, 2.0, -0.5]) + rng.normal(0.0, sigma), sigma


def without(A: np.ndarray, values: np.ndarray, sigma: np.ndarray, group: np.ndarray) -> TestedFit:
    kept = np.setdiff1d(np.arange(len(values)), group)
    return fit(A[kept], values[kept], sigma[kept])


def test_redundancy_numbers_add_up_and_are_those_of_differences() -> None:
    A, values, sigma = straight_line()
    found = fit(A, values, sigma)
    assert found.redundancy.sum() == pytest.approx(found.degrees_of_freedom)
    moved = values.copy()
    moved[3] += 1.0
    changed = fit(A, moved, sigma)
    assert changed.residual[3] - found.residual[3] == pytest.approx(-found.redundancy[3])


@pytest.mark.parametrize("group", [[2], [0, 1], [4, 7]])
def test_left_out_is_a_fit_without(group: list[int]) -> None:
    A, values, sigma = straight_line(1)
    index = np.array(group)
    other = without(A, values, sigma, index)
    difference, covariance = fit(A, values, sigma).left_out(index)
    assert difference == pytest.approx(A[index] @ other.parameter - values[index])
    expected = A[index] @ other.covariance @ A[index].T + np.diag(sigma[index] ** 2)
    assert covariance == pytest.approx(expected)


@pytest.mark.parametrize("group", [[2], [0, 1]])
def test_the_statistic_is_what_leaving_out_takes_from_the_weighted_square(group: list[int]) -> None:
    A, values, sigma = straight_line(2)
    found, index = fit(A, values, sigma), np.array(group)
    other = without(A, values, sigma, index)
    assert found.group_statistic(index) == pytest.approx(found.weighted_square - other.weighted_square)
    if len(group) == 1:
        assert found.w[group[0]] ** 2 == pytest.approx(found.group_statistic(index))


def test_nothing_is_said_of_what_nothing_else_determines() -> None:
    A = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    found = fit(A, np.array([1.0, 3.0, 7.0]), np.ones(3))
    assert np.isnan(found.group_statistic(np.array([2])))
    assert np.isnan(found.left_out(np.array([2]))[0]).all()
    assert np.isnan(found.w[2])
    assert found.residual == pytest.approx([1.0, -1.0, 0.0])
