"""Which lever arm would be estimated from the GNSS positions, beside the one that is counted: none should be left.

An arm a from the antenna to the camera, along the camera's axes and common to all photographs, adds R_i a to where the
measured positions put the projection centres. Its score test (as in gnss_offsets) asks what one step of the adjustment
would give it, with everything else free to follow: residuals alone show an arm only in part, because the block bends
and the principal point moves by f a / H instead. Beside the arm stands an offset of each flight, of which a single
heading cannot tell it; components and directions that are not told are NaN.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from photogram.arrays import FloatArray
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.priors import position_jacobian

SIGNIFICANCE = 0.001
LEAST_ARM_M = 0.05
"""A shorter arm is within what antennas' phase centres and the moment of exposure leave: no word is lost about it."""
LEAST_SHARE = 1e-3
"""Of the information that the positions have on an arm, the least share left by everything else that is unknown."""


@dataclass(frozen=True, eq=False)
class LeftArm:
    """An arm (3,) along the camera's axes that would be estimated, with its sigmas (3,), and the p of there being
    none; NaN for components that are not told, and p where none is."""

    arm_camera_m: FloatArray
    sigma_m: FloatArray
    p: float

    @property
    def significant(self) -> bool:
        """Return whether the positions show an arm that is worth a warning."""
        told = self.arm_camera_m[np.isfinite(self.arm_camera_m)]
        return bool(self.p < SIGNIFICANCE and len(told) and np.linalg.norm(told) > LEAST_ARM_M)


NOTHING_TOLD = LeftArm(np.full(3, np.nan), np.full(3, np.nan), float("nan"))


def left_arm(problem: Problem, state: State, found: Covariances) -> LeftArm:
    """Return the lever arm that is left at the solution ``state`` with its covariances ``found``."""
    block = problem.block
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    members = {p.flight for p in block.photographs if p.gnss_world_m is not None}
    flights = [] if problem.flights else sorted(members)
    own = 3 * len(flights)
    N, score = np.zeros((own + 3, own + 3)), np.zeros(own + 3)
    L = np.zeros((found.layout.columns + found.layout.border, own + 3))
    for i, photograph in enumerate(block.photographs):
        measured = photograph.measured_centre_world_m(state.rotation[i])
        if measured is None or photograph.gnss_sigma_m is None:
            continue
        weight = axes @ np.diag(photograph.gnss_sigma_m**-2.0) @ axes.T
        rows = np.zeros((3, own + 3))
        rows[:, own:] = state.rotation[i]
        residual = state.position[i] - measured
        jacobian = position_jacobian(state.rotation[i], photograph.lever_arm_camera_m)
        if flights:
            f = 3 * flights.index(photograph.flight)
            rows[:, f : f + 3] = np.eye(3)
        else:
            column = found.layout.columns + found.layout.offset_column + 3 * problem.flights.index(photograph.flight)
            residual = residual - state.offset[problem.flights.index(photograph.flight)]
            L[column : column + 3] -= weight @ rows
        N += rows.T @ weight @ rows
        score += rows.T @ weight @ residual
        at = 6 * int(found.layout.place[i])
        L[at : at + 6] += jacobian.T @ weight @ rows
    if not members:
        return NOTHING_TOLD
    return _solved(N, N - found.between(L, L), score, own)


def _solved(N: FloatArray, K: FloatArray, score: FloatArray, own: int) -> LeftArm:
    """Return the last three unknowns of K x = score, those before, ``own`` in number, eliminated; ``N`` is K before the
    rest of the block took its share."""
    follow = K[own:, :own] @ _pseudo_inverse(K[:own, :own], np.trace(N[:own, :own]) / max(own, 1))
    M, t = K[own:, own:] - follow @ K[:own, own:], score[own:] - follow @ score[:own]
    value, U = np.linalg.eigh(M)
    told = value > LEAST_SHARE * np.trace(N[own:, own:]) / 3.0
    if not told.any():
        return NOTHING_TOLD
    U, value = U[:, told], value[told]
    along = U.T @ t
    known = np.sum(U**2, axis=1) > 0.99
    arm, sigma = U @ (along / value), np.sqrt(np.sum(U**2 / value, axis=1))
    p = float(chi2.sf(float(np.sum(along**2 / value)), len(value)))
    return LeftArm(np.where(known, arm, np.nan), np.where(known, sigma, np.nan), p)


def _pseudo_inverse(K: FloatArray, scale: float) -> FloatArray:
    """Return the inverse of K on the directions that carry more than LEAST_SHARE of ``scale``."""
    if not len(K):
        return K
    value, U = np.linalg.eigh(K)
    kept = value > LEAST_SHARE * scale
    return np.asarray((U[:, kept] / value[kept]) @ U[:, kept].T)
