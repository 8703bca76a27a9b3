"""Reliability of what was surveyed: how well a blunder would show (Baarda 1968; Förstner & Wrobel 2016, sec. 4.6).

With the whitened residuals v of a group of observations and their Jacobian A, the covariance of v is Q = I − A Σ Aᵀ
under the a-priori sigmas. Its diagonal holds the redundancy numbers r, the share of a blunder that shows in its own
residual; w = v / √r is standard normal without blunders. A blunder of δ₀ σ / √r is found with the power of POWER at the
significance of SIGNIFICANCE. Without the group, everything else would predict it with the residual Q⁻¹ v, and the
covariance Q⁻¹ of that: leaving a point out costs no adjustment.
"""

from dataclasses import dataclass

import numpy as np

from photogram.adjustment.gnss_offsets import measured_positions
from photogram.arrays import FloatArray
from photogram.factors.common_errors import attitude_groups
from photogram.factors.covariance import Covariances, mark_covariances
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.measures.mark_covariances import lower_factors
from photogram.results import Reliability

SIGNIFICANCE, POWER = 0.001, 0.80
CRITICAL = 3.29  # |w| beyond which a blunder is suspected: two-sided, at SIGNIFICANCE
NONCENTRALITY = 4.132  # δ₀ of SIGNIFICANCE and POWER
LEAST_REDUNDANCY = 1e-6  # below it nothing else determines an observation, and no statement is possible


def minimal_detectable_blunder(sigma: FloatArray, redundancy: FloatArray) -> FloatArray:
    """Return the least blunder that is found with POWER, in the unit of ``sigma``; infinite without redundancy."""
    known = redundancy > LEAST_REDUNDANCY
    return np.where(known, NONCENTRALITY * sigma / np.sqrt(np.where(known, redundancy, 1.0)), np.inf)


def w_tests(whitened: FloatArray, adjusted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return redundancy numbers (K, d) and w (K, d) of groups of d observations.

    ``whitened`` (K, d) are their residuals, ``adjusted`` (K, d, d) the covariances of the adjusted observations, in
    units of the stated sigmas; w is NaN where nothing else determines the observation.
    """
    redundancy = 1.0 - np.einsum("kii->ki", adjusted)
    known = redundancy > LEAST_REDUNDANCY
    return redundancy, np.where(known, whitened / np.sqrt(np.where(known, redundancy, 1.0)), np.nan)


def left_out(whitened: FloatArray, adjusted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the residuals (K, d) and covariances (K, d, d), whitened, of groups that took no part; NaN where nothing
    else determines them. Arguments as of ``w_tests``."""
    d = whitened.shape[1]
    Q = np.eye(d) - adjusted
    known = np.linalg.eigvalsh(Q)[:, 0] > LEAST_REDUNDANCY if len(Q) else np.zeros(0, dtype=bool)
    inverse = np.full_like(Q, np.nan)
    inverse[known] = np.linalg.inv(Q[known])
    return np.einsum("kij,kj->ki", inverse, whitened), inverse


@dataclass(frozen=True, eq=False)
class _Known:
    """Covariances at the solution as tests need them: of the unknowns as they were estimated, ``fixed``, and with the
    focal lengths that are considered, ``counted``, for its own problem; one and the same where none is.

    An error of a considered focal length stays in the residuals, so that their covariance grows by what that of the
    adjusted observations grows by: Q = I − 2 A Σ_held Aᵀ + A Σ_counted Aᵀ, and 2 Σ_held − Σ_counted stands for Σ.
    """

    fixed: Covariances
    counted: Covariances

    def joint(self, photograph: int) -> FloatArray:
        """Return what stands in tests for the joint covariance (6 + border) of a pose and the border."""
        fixed = self.fixed.joint(np.array([photograph]))
        if self.counted is self.fixed:
            return fixed
        counted = self.counted.joint(np.array([photograph]))
        # a considered focal length is one of the border's first columns, which no measured position or attitude has
        own, same = (
            np.concatenate([np.arange(6), np.arange(6 + at.offset_column, 6 + at.ground_column)])
            for at in (self.fixed.layout, self.counted.layout)
        )
        whole = np.zeros_like(fixed)
        whole[np.ix_(own, own)] = _doubled(fixed[np.ix_(own, own)], counted[np.ix_(same, same)])
        return whole


def _doubled(fixed: FloatArray, counted: FloatArray) -> FloatArray:
    return np.asarray(2.0 * fixed - counted)


def _gnss(
    problem: Problem, state: State, known: _Known, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return redundancy numbers and w (N, 3) of GNSS positions along the map's axes, and the prediction by all other
    observations minus the measurement (N, 3), with its covariance (N, 3, 3); NaN where there are none."""
    block, layout = problem.block, known.fixed.layout
    redundancy, w, predicted = (np.full((len(block.photographs), 3), np.nan) for _ in range(3))
    covariance = np.full((len(block.photographs), 3, 3), np.nan)
    for i, sigma, misfit, _, columns, jacobian in measured_positions(problem, state, layout):
        joint = known.joint(i)
        rows = np.zeros((3, len(joint)))
        rows[:, :6] = axes.T @ jacobian[:, :6]
        rows[:, columns[6:] - layout.columns + 6] = axes.T @ jacobian[:, 6:]
        rows /= sigma[:, None]
        whitened, adjusted = ((axes.T @ misfit) / sigma)[None], (rows @ joint @ rows.T)[None]
        r, t = w_tests(whitened, adjusted)
        residual, spread = left_out(whitened, adjusted)
        redundancy[i], w[i] = r[0], t[0]
        predicted[i] = residual[0] * sigma
        covariance[i] = spread[0] * np.outer(sigma, sigma)
    return redundancy, w, predicted, covariance


def _attitudes(problem: Problem, state: State, known: _Known) -> tuple[FloatArray, FloatArray]:
    """Return by how much everything else turns the cameras away from their measured attitudes (N, 3), rad, about their
    own axes, and the covariances of that (N, 3, 3); NaN where there are none, or their heading is not known."""
    photographs, layout = problem.block.photographs, known.fixed.layout
    turned, covariance = np.full((len(photographs), 3), np.nan), np.full((len(photographs), 3, 3), np.nan)
    for group in attitude_groups(problem.block, state.rotation, state.common):
        columns = 6 + layout.columns_of_common(group.error) if group.error >= 0 else np.zeros(0, dtype=np.int64)
        for i, error, *jacobians in zip(group.photograph.tolist(), *group[2:], strict=True):
            sigma = photographs[i].attitude_sigma_rad
            if sigma is None or not photographs[i].heading_known:
                continue
            joint, at = known.joint(i), np.concatenate([np.arange(3), columns])
            rows = np.hstack(jacobians)
            adjusted = rows @ joint[np.ix_(at, at)] @ rows.T / sigma**2
            residual, spread = left_out(error[None] / sigma, adjusted[None])
            turned[i], covariance[i] = residual[0] * sigma, spread[0] * sigma**2
    return turned, covariance


def _focal_lengths(problem: Problem, state: State, covariances: Covariances) -> tuple[FloatArray, FloatArray]:
    """Return by how much everything else wants other focal lengths than were given (cameras,), px, and the standard
    deviations of that; NaN where they are held or nothing was known of them."""
    cameras = problem.block.cameras
    off, sigma = np.full(len(cameras), np.nan), np.full(len(cameras), np.nan)
    for c, camera in enumerate(cameras):
        prior = float(camera.sigmas[0])
        if not (0.0 < prior < np.inf):
            continue
        whitened = np.array([[(state.parameters[c, 0] - camera.focal_px) / prior]])
        residual, spread = left_out(whitened, covariances.calibration(c)[None, :1, :1] / prior**2)
        off[c], sigma[c] = residual[0, 0] * prior, np.sqrt(spread[0, 0, 0]) * prior
    return off, sigma


def reliability(
    problem: Problem,
    state: State,
    fixed: Covariances,
    counted_problem: Problem | None = None,
    counted: Covariances | None = None,
) -> Reliability:
    """Return the reliability of control points, their marks, GNSS positions, attitudes and focal lengths on the final
    linearisation.

    ``fixed`` are the covariances of the adjustment as it stands; ``counted``, for ``counted_problem``, those in which
    focal lengths count that are considered, left out where there are none.
    """
    block, points = problem.block, problem.block.control_points
    known = _Known(fixed, fixed if counted is None else counted)
    other = problem if counted_problem is None else counted_problem
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    own = problem.control_axes
    controls = np.flatnonzero(np.array(points.role) == "control")
    marks = np.flatnonzero(np.isin(points.mark_point, controls) & np.isfinite(points.mark_sigma_px))
    ground_redundancy, ground_w, ground_left_out = (np.full((len(points), 3), np.nan) for _ in range(3))
    covariance = np.full((len(points), 3, 3), np.nan)
    sigma = problem.control_sigma_m
    if len(controls):
        tested = np.isfinite(sigma)
        whitened = np.einsum("gji,gj->gi", own, state.control - problem.control_world_m) / sigma
        spread = _doubled(known.fixed.control_point, known.counted.control_point)
        adjusted = own.transpose(0, 2, 1) @ spread @ own / (sigma[:, :, None] * sigma[:, None, :])
        redundancy, w = w_tests(whitened, adjusted)
        ground_redundancy[controls], ground_w[controls] = np.where(tested, [redundancy, w], np.nan)
        residual, spread = left_out(whitened, adjusted)
        scale = np.where(tested, sigma, np.nan)
        ground_left_out[controls] = residual * scale
        covariance[controls] = spread * scale[:, :, None] * scale[:, None, :]
    mark_redundancy, mark_w, mark_left_out = (np.full((len(points.mark_point), 2), np.nan) for _ in range(3))
    mark_covariance = np.full((len(points.mark_point), 2, 2), np.nan)
    if len(marks):
        v = residuals(problem.marks, state.cameras, state.control)
        adjusted_marks = mark_covariances(problem, state, known.fixed)
        L = lower_factors(points.mark_covariance_px2[marks])
        if known.counted is not known.fixed:
            adjusted_marks = _doubled(adjusted_marks, mark_covariances(other, state, known.counted))
        mark_redundancy[marks], mark_w[marks] = w_tests(v, adjusted_marks)
        residual, spread = left_out(v, adjusted_marks)
        mark_left_out[marks] = np.einsum("kij,kj->ki", L, residual)
        # in this order an isotropic covariance is multiplied by the square of its standard deviation
        mark_covariance[marks] = np.einsum("kia,kjb,kab->kij", L, L, spread)
    redundancy, w, predicted, spread = _gnss(problem, state, known, axes)
    turned, turned_covariance = _attitudes(problem, state, known)
    focal, focal_sigma = _focal_lengths(problem, state, fixed)
    return Reliability(
        ground_redundancy, ground_w, ground_left_out, covariance,
        mark_redundancy, mark_w, mark_left_out, mark_covariance,
        redundancy, w, predicted, spread, turned, turned_covariance, focal, focal_sigma,
    )  # fmt: skip
