"""Least squares of a few observations with stated standard deviations, and the tests of its residuals.

With the design A, observations l of weight P = diag(1/σ²) and x = (AᵀPA)⁻¹AᵀPl, the residuals v = Ax − l have the
cofactors Q_vv = P⁻¹ − A(AᵀPA)⁻¹Aᵀ, and Q_vv P has the redundancy numbers r on its diagonal (Baarda 1968; Förstner &
Wrobel 2016, sec. 4.6). A group of m observations is tested by T = v̄ᵀ (P Q_vv P)⁻¹ v̄ with v̄ = Pv, which is χ² of m
without a blunder; left out, it is predicted with the residual (Q_vv P)⁻¹ v.
"""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray

LEAST_REDUNDANCY = 1e-6
"""Below it nothing else determines an observation."""


@dataclass(frozen=True, eq=False)
class TestedFit:
    """Parameters (U) of observations (N), with what the residuals say of them."""

    __test__ = False  # no test of pytest, whatever its name begins with

    parameter: FloatArray
    """Parameters (U,)."""
    covariance: FloatArray
    """Covariance of the parameters under the stated sigmas (U, U)."""
    residual: FloatArray
    """Fitted minus observed (N,)."""
    sigma: FloatArray
    """Stated standard deviations (N,)."""
    reduction: FloatArray
    """Q_vv P (N, N): what of an error of an observation each residual shows, but for its sign."""

    @property
    def redundancy(self) -> FloatArray:
        """Redundancy numbers (N,)."""
        return np.asarray(np.clip(np.diag(self.reduction), 0.0, 1.0))

    @property
    def degrees_of_freedom(self) -> int:
        """Redundancy of all."""
        return len(self.residual) - len(self.parameter)

    @property
    def weighted_square(self) -> float:
        """Sum of the squared residuals over their sigmas: χ² of the degrees of freedom without a blunder."""
        return float(np.sum((self.residual / self.sigma) ** 2))

    @property
    def w(self) -> FloatArray:
        """Standardised residuals (N,), NaN without redundancy."""
        known = self.redundancy > LEAST_REDUNDANCY
        divisor = self.sigma * np.sqrt(np.where(known, self.redundancy, 1.0))
        return np.where(known, self.residual / divisor, np.nan)

    def group_statistic(self, group: IntArray) -> float:
        """Return T of a group of observations by their numbers (M,), NaN where nothing else determines them."""
        weight = 1.0 / self.sigma[group] ** 2
        Q = weight[:, None] * self.reduction[np.ix_(group, group)]
        if np.linalg.eigvalsh(self._whitened(group))[0] <= LEAST_REDUNDANCY:
            return float("nan")
        scaled = weight * self.residual[group]
        return float(scaled @ np.linalg.solve(Q, scaled))

    def left_out(self, group: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return predicted minus observed (M,) of a group that takes no part, and the covariance of that (M, M); NaN
        where nothing else determines it."""
        if np.linalg.eigvalsh(self._whitened(group))[0] <= LEAST_REDUNDANCY:
            return np.full(len(group), np.nan), np.full((len(group), len(group)), np.nan)
        inverse = np.linalg.inv(self.reduction[np.ix_(group, group)])
        return inverse @ self.residual[group], inverse * self.sigma[group] ** 2

    def _whitened(self, group: IntArray) -> FloatArray:
        """Return the cofactors of the residuals over their sigmas (M, M), which are symmetric."""
        sigma = self.sigma[group]
        Q = self.reduction[np.ix_(group, group)] * sigma / sigma[:, None]
        return np.asarray(0.5 * (Q + Q.T))


def fit(A: FloatArray, misfit: FloatArray, sigma: FloatArray) -> TestedFit:
    """Return the fit of observations by a design (N, U): ``misfit`` (N,) is observed minus what no correction gives.

    ``parameter`` is the correction. Raises LinAlgError where the design does not determine it.
    """
    whitened = A / sigma[:, None]
    Q, R = np.linalg.qr(whitened)
    inverse = np.linalg.inv(R)
    parameter = inverse @ (Q.T @ (misfit / sigma))
    projector = Q @ Q.T
    reduction = (np.eye(len(misfit)) - projector) * sigma[:, None] / sigma
    return TestedFit(parameter, inverse @ inverse.T, A @ parameter - misfit, sigma, reduction)
