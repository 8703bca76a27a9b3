import numpy as np
import pytest

from photogram.quality.accuracy import check_accuracy


def test_differences_known_by_hand() -> None:
    accuracy = check_accuracy(
        np.array([[0.03, 0.00, -0.05], [-0.03, 0.04, 0.05], [0.03, -0.04, 0.10], [-0.03, 0.00, 0.10]])
    )
    assert accuracy.n == 4
    assert accuracy.rmse_m == pytest.approx((0.03, np.sqrt(0.0008), np.sqrt(0.00625)))
    assert accuracy.mean_m == pytest.approx((0.0, 0.0, 0.05))
    assert accuracy.rmse_h_m == pytest.approx(np.sqrt(0.0017))
    assert accuracy.rmse_v_m == pytest.approx(np.sqrt(0.00625))


def test_a_shift_is_mean_and_error_at_once() -> None:
    accuracy = check_accuracy(np.tile([0.3, -0.4, 1.2], (9, 1)))
    assert accuracy.mean_m == pytest.approx((0.3, -0.4, 1.2))
    assert accuracy.rmse_m == pytest.approx((0.3, 0.4, 1.2))
    assert (accuracy.rmse_h_m, accuracy.rmse_v_m) == pytest.approx((0.5, 1.2))


def test_noise_of_many_points_is_found_again() -> None:
    sigma = np.array([0.02, 0.03, 0.05])
    accuracy = check_accuracy(sigma * np.random.default_rng(0).standard_normal((20_000, 3)))
    np.testing.assert_allclose(accuracy.rmse_m, sigma, rtol=0.02)
    assert accuracy.rmse_h_m == pytest.approx(np.hypot(0.02, 0.03), rel=0.02)


def test_points_that_could_not_be_measured_are_left_out() -> None:
    known = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    unknown = np.full((3, 3), np.nan)
    assert check_accuracy(np.vstack([unknown, known])) == check_accuracy(known)


def test_a_point_may_be_a_check_along_some_axes() -> None:
    accuracy = check_accuracy(np.array([[0.3, -0.4, np.nan], [np.nan, np.nan, 0.2], [np.nan, np.nan, 0.4]]))
    assert (accuracy.n, accuracy.n_axis) == (3, (1, 1, 2))
    np.testing.assert_allclose(accuracy.rmse_m, [0.3, 0.4, np.sqrt(0.1)])
    np.testing.assert_allclose(accuracy.mean_m, [0.3, -0.4, 0.3])
    np.testing.assert_allclose((accuracy.rmse_h_m, accuracy.rmse_v_m), [0.5, np.sqrt(0.1)])


@pytest.mark.parametrize("nothing", [np.zeros((0, 3)), np.full((2, 3), np.nan)])
def test_without_check_points_nothing_is_claimed(nothing: np.ndarray) -> None:
    accuracy = check_accuracy(nothing)
    assert accuracy.n == 0
    assert np.isnan([*accuracy.rmse_m, *accuracy.mean_m, accuracy.rmse_h_m, accuracy.rmse_v_m]).all()
