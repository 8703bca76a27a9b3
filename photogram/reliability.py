"""Reliability of what was surveyed: how well a blunder would show (Baarda 1968; Förstner & Wrobel 2016, sec. 4.6).

With the whitened residuals v of a group of observations and their Jacobian A, the covariance of v is Q = I − A Σ Aᵀ
under the a-priori sigmas. Its diagonal holds the redundancy numbers r, the share of a blunder that shows in its own
residual; w = v / √r is standard normal without blunders. A blunder of δ₀ σ / √r is found with the power of POWER at the
significance of SIGNIFICANCE. Without the group, everything else would predict it with the residual Q⁻¹ v, and the
covariance Q⁻¹ of that: leaving a point out costs no adjustment.
"""

from __future__ import annotations

import numpy as np

from photogram.factors.camera_position import position_jacobian
from photogram.factors.covariance import Covariances, mark_covariances
from photogram.factors.graph import Problem
from photogram.factors.reprojection import residuals
from photogram.factors.state import State
from photogram.survey import FloatArray, Reliability

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


def _gnss(problem: Problem, state: State, found: Covariances, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return redundancy numbers and w (N, 3) of GNSS positions along the map's axes, NaN where there are none."""
    block = problem.block
    redundancy, w = (np.full((len(block.photographs), 3), np.nan) for _ in range(2))
    for i, photograph in enumerate(block.photographs):
        measured = photograph.measured_centre_world_m(state.rotation[i])
        if measured is None or photograph.gnss_sigma_m is None:
            continue
        joint = found.joint(np.array([i]))
        rows = np.zeros((3, len(joint)))
        rows[:, :6] = axes.T @ position_jacobian(state.rotation[i], photograph.lever_arm_camera_m)
        misfit = state.position[i] - measured
        if problem.flights:
            flight = problem.flights.index(photograph.flight)
            column = 6 + found.layout.offset_column + 3 * flight
            rows[:, column : column + 3] = -axes.T
            misfit = misfit - state.offset[flight]
        rows /= photograph.gnss_sigma_m[:, None]
        whitened = (axes.T @ misfit) / photograph.gnss_sigma_m
        r, t = w_tests(whitened[None], (rows @ joint @ rows.T)[None])
        redundancy[i], w[i] = r[0], t[0]
    return redundancy, w


def reliability(problem: Problem, state: State, found: Covariances) -> Reliability:
    """Return the reliability of control points, their marks and GNSS positions on the final linearisation."""
    block, points = problem.block, problem.block.control_points
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    own = problem.control_axes
    controls = np.flatnonzero(np.array(points.role) == "control")
    marks = np.flatnonzero(np.isin(points.mark_point, controls))
    ground_redundancy, ground_w, ground_left_out = (np.full((len(points), 3), np.nan) for _ in range(3))
    covariance = np.full((len(points), 3, 3), np.nan)
    sigma = problem.control_sigma_m
    if len(controls):
        tested = np.isfinite(sigma)
        whitened = np.einsum("gji,gj->gi", own, state.control - problem.control_world_m) / sigma
        adjusted = own.transpose(0, 2, 1) @ found.control_point @ own / (sigma[:, :, None] * sigma[:, None, :])
        redundancy, w = w_tests(whitened, adjusted)
        ground_redundancy[controls], ground_w[controls] = np.where(tested, [redundancy, w], np.nan)
        residual, spread = left_out(whitened, adjusted)
        scale = np.where(tested, sigma, np.nan)
        ground_left_out[controls] = residual * scale
        covariance[controls] = spread * scale[:, :, None] * scale[:, None, :]
    mark_redundancy, mark_w, mark_left_out = (np.full((len(points.mark_point), 2), np.nan) for _ in range(3))
    mark_covariance = np.full((len(points.mark_point), 2, 2), np.nan)
    if len(marks):
        v = residuals(problem.marks, state.parameters, state.rotation, state.position, state.control)
        adjusted_marks, sigma_px = mark_covariances(problem, state, found), problem.marks.sigma_px
        mark_redundancy[marks], mark_w[marks] = w_tests(v, adjusted_marks)
        residual, spread = left_out(v, adjusted_marks)
        mark_left_out[marks] = residual * sigma_px[:, None]
        mark_covariance[marks] = spread * sigma_px[:, None, None] ** 2
    gnss_redundancy, gnss_w = _gnss(problem, state, found, axes)
    return Reliability(
        ground_redundancy, ground_w, ground_left_out, covariance,
        mark_redundancy, mark_w, mark_left_out, mark_covariance, gnss_redundancy, gnss_w,
    )  # fmt: skip
