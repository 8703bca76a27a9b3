"""Whether the GNSS positions of a flight are off together: the offset that is estimated, or would be, against zero.

With the offset o of a flight among the unknowns, its prior N(0, P) and its posterior N(ô, Q): what the measurements
alone say of it is the normal matrix D⁻¹ = Q⁻¹ − P⁻¹. Were o zero, ô would scatter with Q − Q P⁻¹ Q, and
ôᵀ (Q − Q P⁻¹ Q)⁻¹ ô = dᵀ D⁻¹ d is χ² with three degrees of freedom (d = D Q⁻¹ ô, the estimate without the prior).

With the offset held at zero: the score s = Σ Sᵢ⁻¹ vᵢ of the flight's residuals v has the covariance
K = Σ Sᵢ⁻¹ − Lᵀ Σ L, with L = Σ Aᵢᵀ Sᵢ⁻¹ and the covariance Σ of all unknowns. K⁻¹ s is the offset that one step would
give, K⁻¹ its covariance, sᵀ K⁻¹ s the statistic (Rao's score test; Förstner & Wrobel 2016, sec. 4.6.4).

Directions that the measurements do not determine are left out of the test.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, norm

from photogram.arrays import FloatArray, IntArray
from photogram.factors.common_errors import position_effects
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.reduced import Layout
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.priors import position_jacobian

SIGNIFICANCE = 0.001
LEAST_SHARE = 1e-3
"""Of the information on an offset, the least share that must come from the measurements for a direction to be tested:
against the prior where there is one, against the positions themselves where there is none."""


class MeasuredPosition(NamedTuple):
    """A GNSS position at a solution: the number of its ``photograph``, its ``sigma_m`` (3,) along the axes of the map,
    the ``misfit`` (3,) of the projection centre to where the position and all common errors put it, in the world, m,
    its ``weight`` (3, 3), and the ``jacobian`` (3, c) of the misfit on the ``columns`` (c,) of the reduced system: six
    of the pose, then some of the border."""

    photograph: int
    sigma_m: FloatArray
    misfit: FloatArray
    weight: FloatArray
    columns: IntArray
    jacobian: FloatArray


def measured_positions(problem: Problem, state: State, layout: Layout) -> Iterator[MeasuredPosition]:
    """Yield the GNSS positions at ``state``."""
    block, border = problem.block, layout.columns
    axes, effects = block.frame.rotation_world_from_map(np.zeros(3)), position_effects(block)
    common = [layout.columns_of_common(k) for k in range(len(layout.common))]
    for i, photograph in enumerate(block.photographs):
        if photograph.gnss_world_m is None or photograph.gnss_sigma_m is None:
            continue
        R = state.rotation[i]
        arm = photograph.lever_arm_camera_m
        shift = np.zeros(3)
        columns, of_border = [6 * int(layout.place[i]) + np.arange(6)], []
        if problem.flights:
            flight = problem.flights.index(photograph.flight)
            columns.append(border + layout.offset_column + 3 * flight + np.arange(3))
            of_border.append(-np.eye(3))
            shift = shift + state.offset[flight]
        for effect in effects[i]:
            own = common[effect.error]
            moved = effect.matrix @ state.common[own - layout.common_column]
            if effect.in_camera:
                arm = moved if arm is None else arm + moved
            else:
                shift = shift + moved
            columns.append(border + own)
            of_border.append(-effect.in_world(R))
        misfit = state.position[i] - photograph.gnss_world_m - shift - (0.0 if arm is None else R @ arm)
        weight = axes @ np.diag(photograph.gnss_sigma_m**-2.0) @ axes.T
        jacobian = np.hstack([position_jacobian(R, arm), *of_border])
        yield MeasuredPosition(i, photograph.gnss_sigma_m, misfit, weight, np.concatenate(columns), jacobian)


@dataclass(frozen=True, eq=False)
class OffsetTest:
    """The test of an offset (d,) against zero: ``chi2`` with ``degrees`` of freedom, ``p`` of it, ``p_axes`` (d,).

    Without degrees of freedom nothing but the prior determines the offset, and ``chi2`` and ``p`` are NaN.
    """

    chi2: float
    degrees: int
    p: float
    p_axes: FloatArray

    @property
    def significant(self) -> bool:
        """Return whether the offset is not zero, at the level SIGNIFICANCE."""
        return self.degrees > 0 and self.p < SIGNIFICANCE


def estimated_offset_test(offset_m: FloatArray, covariance_m2: FloatArray, prior_sigma_m: FloatArray) -> OffsetTest:
    """Test an adjusted offset (d,) with covariance (d, d), whose prior has ``prior_sigma_m`` (d,) along the same axes,
    none of them 0."""
    # In units of the prior, Q has the eigenvalues 1 / (1 + λ), λ the information of the measurements.
    share, U = np.linalg.eigh(np.eye(len(offset_m)) - covariance_m2 / np.outer(prior_sigma_m, prior_sigma_m))
    share = np.clip(share, 0.0, 1.0)  # λ / (1 + λ)
    known = share > LEAST_SHARE
    u = U.T @ (offset_m / prior_sigma_m)
    scatter = share * (1.0 - share)  # of u if the offset were zero: λ / (1 + λ)²
    scatter = np.maximum(scatter, np.finfo(float).tiny)
    statistic = float(np.sum(u[known] ** 2 / scatter[known]))
    axes = np.einsum("ij,j,ij->i", U[:, known], scatter[known], U[:, known])
    return _test(statistic, int(known.sum()), offset_m / prior_sigma_m, axes)


def _test(statistic: float, degrees: int, offset: FloatArray, variance: FloatArray) -> OffsetTest:
    with np.errstate(divide="ignore", invalid="ignore"):
        p_axes = np.where(variance > 0.0, 2.0 * norm.sf(np.abs(offset) / np.sqrt(variance)), np.nan)
    if not degrees:
        return OffsetTest(float("nan"), 0, float("nan"), np.full(len(offset), np.nan))
    return OffsetTest(statistic, degrees, float(chi2.sf(statistic, degrees)), p_axes)


def implied_offset_test(offset_m: FloatArray, covariance_m2: FloatArray) -> OffsetTest:
    """Test an offset (3,) that would be estimated, with covariance (3, 3), as of ``implied_offsets``; NaN where nothing
    else than the positions says where they are."""
    if not np.isfinite(covariance_m2).all():
        return OffsetTest(float("nan"), 0, float("nan"), np.full(3, np.nan))
    statistic = float(offset_m @ np.linalg.solve(covariance_m2, offset_m))
    return _test(statistic, 3, offset_m, np.diag(covariance_m2))


def implied_offsets(
    problem: Problem, state: State, covariances: Covariances
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Return the flights whose offset is held at zero, the offset that would be estimated for each (F, 3) in the world,
    and its covariance (F, 3, 3): NaN where nothing else than the positions themselves says where they are.

    None where the offsets are among the unknowns.
    """
    block = problem.block
    flights: list[str] = []
    offsets, of_offsets = [], []
    positions = [] if problem.flights else list(measured_positions(problem, state, covariances.layout))
    of_flight = [block.photographs[position.photograph].flight for position in positions]
    for flight in sorted(set(of_flight)):
        N, score = np.zeros((3, 3)), np.zeros(3)
        L = np.zeros((covariances.layout.columns + covariances.layout.border, 3))
        for position, own in zip(positions, of_flight, strict=True):
            if own == flight:
                N += position.weight
                score += position.weight @ position.misfit
                L[position.columns] += position.jacobian.T @ position.weight
        K = N - covariances.between(L, L)
        flights.append(flight)
        root = np.linalg.cholesky(N)
        share = np.linalg.eigvalsh(np.linalg.solve(root, np.linalg.solve(root, K).T))
        known = share.min() > LEAST_SHARE
        of_offsets.append(np.linalg.inv(K) if known else np.full((3, 3), np.nan))
        offsets.append(np.linalg.solve(K, score) if known else np.full(3, np.nan))
    return tuple(flights), np.array(offsets).reshape(-1, 3), np.array(of_offsets).reshape(-1, 3, 3)
