"""Covariances of all variables on the final linearisation, from the reduced system of poses, calibration and control.

A-priori sigmas are used as they stand: nothing is rescaled by sigma0.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from photogram.factors.elimination import Columns, eliminate_tie_points, tie_point_covariances
from photogram.factors.graph import (
    IndeterminateError,
    Problem,
    State,
    ground_graph,
    linearise_ground,
    linearise_tie_points,
)
from photogram.factors.variables import CALIBRATION, CONTROL_POINT, GNSS_OFFSET, POSE, TIE_POINT, key
from photogram.survey import FloatArray

RANK_TOLERANCE = 1e-13
MEANINGLESS_SIGMA_RAD = (
    0.2  # an attitude known no better than this is not determined: nothing is linear over such angles
)


@dataclass(frozen=True, eq=False)
class Covariances:
    """A-priori covariances at the solution.

    ``reduced`` (n, n) of poses (tangent ω, v of each), control points, offsets and free calibration parameters (in
    natural units), laid out by ``columns`` and the two first columns; ``tie_point`` (P, 3, 3) in the world, m².
    """

    reduced: FloatArray
    columns: Columns
    control_column: int
    offset_column: int
    tie_point: FloatArray

    def pose(self, photograph: int) -> FloatArray:
        """Return the covariance (6, 6) of a pose's tangent (ω in rad, v in m, camera frame)."""
        c = int(self.columns.pose[photograph])
        return self.reduced[c : c + 6, c : c + 6]

    def control(self, point: int) -> FloatArray:
        """Return the covariance (3, 3) of an adjusted control point in the world, m²."""
        c = self.control_column + 3 * point
        return self.reduced[c : c + 3, c : c + 3]

    def offset(self, flight: int) -> FloatArray:
        """Return the covariance (3, 3) of a flight's GNSS offset in the world, m²."""
        c = self.offset_column + 3 * flight
        return self.reduced[c : c + 3, c : c + 3]

    def calibration(self, camera: int) -> FloatArray:
        """Return the covariance (8, 8) of a camera's parameters, zero where they are fixed."""
        full = np.zeros((8, 8))
        column = self.columns.calibration[camera]
        free = np.flatnonzero(column >= 0)
        full[np.ix_(free, free)] = self.reduced[np.ix_(column[free], column[free])]
        return full


def _layout(problem: Problem, state: State) -> tuple[Columns, int, int, list[int], list[int]]:
    """Return columns, the first control and offset column, and the keys of all reduced variables with their sizes."""
    variables = [(key(POSE, i), 6) for i in range(len(state.rotation))]
    variables += [(key(CONTROL_POINT, g), 3) for g in range(len(state.control))]
    variables += [(key(GNSS_OFFSET, f), 3) for f in range(len(state.offset))]
    variables += [(key(CALIBRATION, c), len(free)) for c, free in enumerate(problem.free) if len(free)]
    sizes = [n for _, n in variables]
    control_column = 6 * len(state.rotation)
    offset_column = control_column + 3 * len(state.control)
    calibration = np.full((len(problem.block.cameras), 8), -1, dtype=np.int64)
    column = offset_column + 3 * len(state.offset)
    for c, free in enumerate(problem.free):
        calibration[c, free] = column + np.arange(len(free))
        column += len(free)
    columns = Columns(6 * np.arange(len(state.rotation), dtype=np.int64), calibration, column)
    return columns, control_column, offset_column, [k for k, _ in variables], sizes


def _ground_information(
    linear: gtsam.GaussianFactorGraph, variables: list[int], sizes: list[int], size: int
) -> FloatArray:
    """Return the normal matrix (size, size) of a linear graph over ``variables``, zero for those it does not hold."""
    S = np.zeros((size, size))
    held = set(linear.keyVector())
    ordering = gtsam.Ordering()
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    index: list[int] = []
    for i, variable in enumerate(variables):
        if variable in held:
            ordering.push_back(variable)
            index.extend(range(start[i], start[i + 1]))
    if index:
        information, _ = linear.hessian(ordering)
        S[np.ix_(index, index)] = information
    return S


def _weakest(S: FloatArray, variables: list[int], sizes: list[int]) -> tuple[str, int]:
    """Return kind and index of the variable that moves most along the direction that nothing holds."""
    scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
    _, vectors = eigh(S / np.outer(scale, scale), subset_by_index=(0, 0))
    owner = np.repeat(np.arange(len(sizes)), sizes)
    weight = np.bincount(owner, weights=vectors[:, 0] ** 2)
    symbol = gtsam.Symbol(variables[int(np.argmax(weight))])
    return chr(symbol.chr()), int(symbol.index())


def covariances(problem: Problem, state: State) -> Covariances:
    """Compute the covariances of all variables at ``state``.

    Raises IndeterminateError naming the variable that nothing holds when the normal equations are singular, or the
    photograph whose attitude they leave open, such as that of a strip which may turn about its own axis.
    """
    columns, control_column, offset_column, variables, sizes = _layout(problem, state)
    linear_ground = linearise_ground(problem, ground_graph(problem), state)
    S = _ground_information(linear_ground, variables, sizes, columns.size)
    linear = linearise_tie_points(problem, state)
    V_inverse, failed = eliminate_tie_points(problem.tie, linear, len(state.tie_point), columns, S)
    if failed >= 0:
        raise IndeterminateError((TIE_POINT, failed))
    S = 0.5 * (S + S.T)
    scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
    normalised = S / np.outer(scale, scale)
    smallest = eigh(normalised, subset_by_index=(0, 0), eigvals_only=True)[0]
    if not smallest > RANK_TOLERANCE:
        raise IndeterminateError(_weakest(S, variables, sizes))
    reduced = cho_solve(cho_factor(normalised), np.eye(columns.size)) / np.outer(scale, scale)
    variance = np.diag(reduced)[columns.pose[:, None] + np.arange(3)].max(axis=1, initial=0.0)
    if np.any(variance > MEANINGLESS_SIGMA_RAD**2):
        raise IndeterminateError((POSE, int(np.argmax(variance))))
    tie_point = tie_point_covariances(problem.tie, linear, columns, V_inverse, reduced)
    unit = np.ones(columns.size)
    for c in range(len(problem.block.cameras)):
        used = columns.calibration[c] >= 0
        unit[columns.calibration[c][used]] = problem.scale[c][used]
    return Covariances(reduced * np.outer(unit, unit), columns, control_column, offset_column, tie_point)
