"""Robust losses of tie points: their cost, weight and radial curvature.

An observation with the squared whitened norm s costs ρ(s)/2. Its Hessian is ρ' Jᵀ (I + 2 s ρ''/ρ' n nᵀ) J, n the
direction of the residual (Triggs et al. 2000, sec. 4.3), so along its residual a mismatch bends the cost by the factor
c = 1 + 2 s ρ''/ρ' of what weights alone say: not at all under Huber's loss, downwards under Cauchy's. Least squares
with the Jacobian √ρ' (I − (1 − √c) n nᵀ) J and the residual √(ρ'/c) r have this Hessian and the exact gradient; c is
kept above LEAST_CURVATURE, so that the system stays positive definite. Far from the minimum, where most observations
are beyond the threshold, weights alone lead there faster.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from photogram.arrays import FloatArray

RobustLoss = Literal["none", "huber", "cauchy"]
KINDS: dict[RobustLoss, int] = {"none": 0, "huber": 1, "cauchy": 2}
LEAST_CURVATURE = 0.1


@dataclass(frozen=True, eq=False)
class Loss:
    """The loss of observations: ``kind`` as kernels.robust knows it, ``threshold`` in sigmas.

    ``least_curvature`` bounds c from below: of 1 there are weights alone, as covariances want them.
    """

    kind: int
    threshold: float
    least_curvature: float = 1.0

    def weights_alone(self) -> Loss:
        """Return the loss without its curvature."""
        return replace(self, least_curvature=1.0)


NO_LOSS = Loss(KINDS["none"], 1.0)


def steering(loss: RobustLoss, threshold: float) -> Loss:
    """Return the loss as steps towards the minimum want it, with its curvature."""
    return Loss(KINDS[loss], threshold, LEAST_CURVATURE)


def robust_terms(whitened: FloatArray, loss: RobustLoss, threshold: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cost ρ (N,), weight ρ' (N,) and radial curvature c (N,) of whitened residuals (N, 2).

    Of their norm s and the threshold k: Huber (1964): ρ = s² or 2ks − k², ρ' = min(1, k/s), c = 1 or 0. Cauchy:
    ρ = k² ln(1 + s²/k²), ρ' = 1/(1 + s²/k²), c = (k² − s²)/(k² + s²).
    """
    square = np.einsum("ij,ij->i", whitened, whitened)
    if loss == "none":
        return square, np.ones_like(square), np.ones_like(square)
    if loss == "cauchy":
        ratio = square / threshold**2
        return threshold**2 * np.log1p(ratio), robust_weight(square, loss, threshold), (1.0 - ratio) / (1.0 + ratio)
    norm = np.sqrt(square)
    outer = norm > threshold
    cost = np.where(outer, 2.0 * threshold * norm - threshold**2, square)
    return cost, robust_weight(square, loss, threshold), np.where(outer, 0.0, 1.0)


def robust_weight(square: FloatArray, loss: RobustLoss, threshold: float) -> FloatArray:
    """Return the weight ρ' (N,) of ``robust_terms`` alone, from the squared norms (N,) of whitened residuals."""
    if loss == "none":
        return np.ones_like(square)
    if loss == "cauchy":
        return 1.0 / (1.0 + square / threshold**2)
    norm = np.sqrt(square)
    return np.where(norm > threshold, threshold / np.maximum(norm, threshold), 1.0)


def steer(
    whitened: FloatArray, loss: RobustLoss, threshold: float, least_curvature: float
) -> tuple[FloatArray, FloatArray]:
    """Return √ρ' (I − (1 − √c) n nᵀ) (N, 2, 2) and √(ρ'/c) r (N, 2) of whitened residuals r (N, 2)."""
    _, weight, bend = robust_terms(whitened, loss, threshold)
    root, curvature = np.sqrt(weight), np.sqrt(np.maximum(bend, least_curvature))
    norm = np.linalg.norm(whitened, axis=1)
    direction = whitened / np.where(norm > 0, norm, 1.0)[:, None]
    along = (1.0 - curvature)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    return root[:, None, None] * (np.eye(2) - along), whitened * (root / curvature)[:, None]
