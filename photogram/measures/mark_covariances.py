"""Covariances of marks: 2 × 2, of u and v in px², with the lower Cholesky factor L, C = L Lᵀ, that whitens them.

Isotropic ones come back to their standard deviation bit for bit: √(σ²) = σ in binary arithmetic, and L = σ I.
"""

import numpy as np

from photogram.arrays import BoolArray, FloatArray, check_shape


def isotropic_px2(sigma_px: FloatArray) -> FloatArray:
    """Return the covariances (M, 2, 2) of marks with one standard deviation (M,) in every direction; infinite variances
    for infinite ones."""
    return covariances_px2(np.column_stack([sigma_px, sigma_px]), np.zeros(len(sigma_px)))


def covariances_px2(sigma_px: FloatArray, rho: FloatArray) -> FloatArray:
    """Return the covariances (M, 2, 2) of marks from standard deviations of u and v (M, 2) and correlations (M,)."""
    check_shape("sigma_px", sigma_px, (len(rho), 2))
    covariance = np.zeros((len(rho), 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = sigma_px[:, 0] ** 2, sigma_px[:, 1] ** 2
    related = rho != 0.0  # nothing times an infinite standard deviation is no number
    covariance[related, 0, 1] = covariance[related, 1, 0] = rho[related] * sigma_px[related].prod(axis=1)
    return covariance


def sigmas_and_rho(covariance_px2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of u and v (M, 2) and the correlations (M,) of covariances (M, 2, 2)."""
    sigma = np.sqrt(np.einsum("mii->mi", covariance_px2))
    rho, shared = np.zeros(len(sigma)), covariance_px2[:, 0, 1]
    np.divide(shared, sigma.prod(axis=1), out=rho, where=shared != 0.0)
    return sigma, rho


def stated_pairs(covariance_px2: FloatArray) -> list[tuple[tuple[float, float], float]]:
    """Return the standard deviations of u and v, and their correlation, of each covariance (M, 2, 2), as files hold
    them."""
    sigma, rho = sigmas_and_rho(covariance_px2)
    return [((u, v), r) for (u, v), r in zip(sigma.tolist(), rho.tolist(), strict=True)]


def lower_factors(covariance_px2: FloatArray) -> FloatArray:
    """Return L (M, 2, 2) of covariances C = L Lᵀ (M, 2, 2); infinite on the diagonal for rejected marks."""
    L = np.zeros_like(covariance_px2)
    L[:, 0, 0] = np.sqrt(covariance_px2[:, 0, 0])
    L[:, 1, 0] = covariance_px2[:, 1, 0] / L[:, 0, 0]
    L[:, 1, 1] = np.sqrt(covariance_px2[:, 1, 1] - L[:, 1, 0] ** 2)
    return L


def scaled(covariance_px2: FloatArray, factor: FloatArray) -> FloatArray:
    """Return the covariances (M, 2, 2) of marks whose standard deviations are multiplied by factors (M,); rejected
    marks stay rejected."""
    L = lower_factors(covariance_px2) * factor[:, None, None]
    used = np.isfinite(L).all(axis=(1, 2))
    result = covariance_px2.copy()
    result[used] = L[used] @ L[used].transpose(0, 2, 1)
    return result


def rejecting_marks(covariance_px2: FloatArray, rejected: BoolArray) -> FloatArray:
    """Return the covariances (M, 2, 2) with infinite variances of the marks ``rejected`` (M,)."""
    return np.where(rejected[:, None, None], isotropic_px2(np.array([np.inf])), covariance_px2)


def is_isotropic(covariance_px2: FloatArray) -> BoolArray:
    """Return which marks (M,) have the same standard deviation in every direction."""
    alike = covariance_px2[:, 0, 0] == covariance_px2[:, 1, 1]
    return np.asarray(alike & (covariance_px2[:, 0, 1] == 0.0))


def semi_axes(covariance_px2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations (M, 2) along the axes of the ellipses of covariances (M, 2, 2), the larger first,
    and the direction (M,) of the larger, rad from u towards v, from −π/2 to π/2."""
    a, b, c = covariance_px2[:, 0, 0], covariance_px2[:, 0, 1], covariance_px2[:, 1, 1]
    half, spread = (a + c) / 2.0, np.hypot((a - c) / 2.0, b)
    # the smaller from the determinant: a difference would lose the digits of narrow ellipses
    smaller = (a * c - b**2) / (half + spread)
    return np.sqrt(np.column_stack([half + spread, smaller])), np.arctan2(2.0 * b, a - c) / 2.0
