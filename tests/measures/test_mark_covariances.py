"""Covariances of marks: their factors, axes and one number in their place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.measures.mark_covariances import (
    covariances_px2,
    is_isotropic,
    isotropic_px2,
    lower_factors,
    rejecting_marks,
    scaled,
    semi_axes,
    sigmas_and_rho,
    stated_pairs,
)
from photogram.survey import rms_sigma_px

sigmas = st.floats(1e-4, 1e3)


@given(sigma=sigmas, factor=st.floats(1e-3, 1e12))
def test_an_isotropic_mark_is_its_standard_deviation_bit_for_bit(sigma: float, factor: float) -> None:
    covariance = isotropic_px2(np.array([sigma]))
    assert is_isotropic(covariance).all()
    assert rms_sigma_px(covariance).tolist() == [sigma]
    assert lower_factors(covariance)[0].tolist() == [[sigma, 0.0], [0.0, sigma]]
    assert stated_pairs(covariance) == [((sigma, sigma), 0.0)]
    assert rms_sigma_px(scaled(covariance, np.array([factor]))).tolist() == [sigma * factor]


@given(u=sigmas, v=sigmas, rho=st.integers(-99, 99).map(lambda n: n / 100.0))
def test_factors_and_sigmas_give_the_covariance_back(u: float, v: float, rho: float) -> None:
    covariance = covariances_px2(np.array([[u, v]]), np.array([rho]))
    assert covariance[0].tolist() == [[u * u, rho * (u * v)], [rho * (u * v), v * v]]
    L = lower_factors(covariance)
    assert L[0, 0, 1] == 0.0
    np.testing.assert_allclose(L @ L.transpose(0, 2, 1), covariance, rtol=1e-13)
    sigma, again = sigmas_and_rho(covariance)
    assert sigma[0].tolist() == [u, v]
    assert again[0] == pytest.approx(rho, rel=1e-15, abs=1e-300)
    np.testing.assert_allclose(scaled(covariance, np.array([3.0])), 9.0 * covariance, rtol=1e-13)


@given(major=st.floats(0.1, 10.0), ratio=st.floats(0.01, 0.99), degrees=st.floats(-89.0, 89.0))
def test_semi_axes_are_those_that_the_covariance_was_made_of(major: float, ratio: float, degrees: float) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    R, D = np.array([[c, -s], [s, c]]), np.diag([major**2, (ratio * major) ** 2])
    covariance = (R @ D @ R.T)[None]
    axes, direction = semi_axes(covariance)
    np.testing.assert_allclose(axes[0], [major, ratio * major], rtol=1e-9)
    off = (np.degrees(direction[0]) - degrees + 90.0) % 180.0 - 90.0
    assert abs(off) < 1e-6 / (1.0 - ratio)
    assert rms_sigma_px(covariance)[0] ** 2 == pytest.approx((axes**2).sum() / 2.0)


def test_a_rejected_mark_has_no_weight_and_stays_rejected() -> None:
    given_px2 = covariances_px2(np.array([[0.3, 0.4], [0.5, 0.5]]), np.array([0.5, 0.0]))
    rejected = rejecting_marks(given_px2, np.array([True, False]))
    assert rms_sigma_px(rejected).tolist() == [np.inf, 0.5]
    assert np.isfinite(rejected[:, 0, 1]).all()
    np.testing.assert_array_equal(
        scaled(rejected, np.array([2.0, 2.0])), rejecting_marks(4.0 * given_px2, rejected[:, 0, 0] > 1e9)
    )
