"""Covariances of points beyond what the adjustment itself needs: of all ground points together, check points included,
and of tie points if the cameras were known.

Check points take no part in the adjustment. Each is intersected from its marks with the adjusted cameras, whose errors
all of them share: to first order it moves as a control point does that nobody surveyed.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.factors.covariance import Covariances, joint_points, point_columns
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.points import first_observations
from photogram.factors.elimination.reprojection import Observations, linearise, observed_marks
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.ground_terms import GroundTerms

OBSERVATIONS_AT_ONCE = 100_000
SINGULAR = 1e-18  # determinant over the cube of the trace, below which rays determine no point


def joint_ground_covariance(
    problem: Problem, state: State, covariances: Covariances, ground_world_m: FloatArray
) -> FloatArray:
    """Return the joint covariance (3 G, 3 G) of all ground points at ``ground_world_m`` (G, 3) in the world, m².

    Control points as adjusted, check points as intersected from their marks; NaN for points without a position.
    """
    known, inverse, turned = ground_columns(problem, state, covariances, ground_world_m)
    joint = np.full((3 * len(ground_world_m), 3 * len(ground_world_m)), np.nan)
    if len(known):
        rows = (3 * known[:, None] + np.arange(3)).ravel()
        joint[np.ix_(rows, rows)] = joint_points(covariances, inverse, turned)
    return joint


def ground_columns(
    problem: Problem, state: State, covariances: Covariances, ground_world_m: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the numbers (K,) of the ground points that have a position, V⁻¹ (K, 3, 3) and W V⁻¹ (6 free + border, K,
    3) of ``point_columns``."""
    points = problem.block.control_points
    known = np.flatnonzero(np.isfinite(ground_world_m).all(axis=1))
    if not len(known):
        return known, np.zeros((0, 3, 3)), np.zeros((covariances.layout.columns + covariances.layout.border, 0, 3))
    marks = np.isin(points.mark_point, known) & np.isfinite(points.mark_sigma_px)
    number = np.searchsorted(known, points.mark_point[marks]).astype(np.int64)
    observations = replace(observed_marks(points, marks), point=number)
    linear = linearise(observations, state.cameras, ground_world_m[known])
    V = np.zeros((len(known), 3, 3))
    np.add.at(V, observations.point, np.einsum("nri,nrj->nij", linear.point, linear.point))
    controls = np.flatnonzero(np.array(points.role) == "control")
    V[np.searchsorted(known, controls)] += GroundTerms(problem, covariances.layout).linearise(state).control
    number = np.full(len(known), -1)
    number[np.searchsorted(known, controls)] = np.arange(len(controls))
    return known, *point_columns(observations, linear, V, covariances.layout, number)[1:]


def parts_of(observations: Observations, count: int) -> Iterator[tuple[int, int, Observations]]:
    """Yield ranges of points and their observations, numbered from the first of them, some 100 000 at once."""
    first = first_observations(observations.point, count)
    begin = 0
    while begin < count:
        end = max(begin + 1, int(np.searchsorted(first, first[begin] + OBSERVATIONS_AT_ONCE, side="right")) - 1)
        part = observations.select(np.arange(first[begin], first[end]))
        yield begin, end, replace(part, point=part.point - begin)
        begin = end


def ray_covariances(problem: Problem, state: State) -> FloatArray:
    """Return the covariances V⁻¹ (P, 3, 3) that the tie points would have in the world, m², if the cameras were known.

    Every point needs two rays; observations are sorted by point and count with their robust weights.
    """
    count = len(state.tie_point)
    covariance = np.full((count, 3, 3), np.nan)
    for begin, end, part in parts_of(problem.tie, count):
        X = state.tie_point[begin:end]
        linear = linearise(part, state.cameras, X)
        _, weight, _ = robust_terms(linear.residual, problem.robust_loss, problem.robust_threshold)
        J = np.sqrt(weight)[:, None, None] * linear.point
        V = np.add.reduceat(J.transpose(0, 2, 1) @ J, first_observations(part.point, end - begin)[:-1], axis=0)
        covariance[begin:end] = np.linalg.inv(V)
    return covariance


def points_redundancy(problem: Problem, state: State) -> FloatArray:
    """Return the redundancy numbers (N,) that the observations of tie points would have if the cameras were known,
    summed over both coordinates: 2 − tr(B V⁻¹ Bᵀ), with an observation's Jacobian B on its point and V = Σ BᵀB.

    Every point that is observed needs two rays; observations are sorted by point.
    """
    redundancy = np.empty(len(problem.tie))
    done = 0
    for begin, end, part in parts_of(problem.tie, len(state.tie_point)):
        if not len(part):
            continue
        J = linearise(part, state.cameras, state.tie_point[begin:end]).point
        seen, own = np.unique(part.point, return_inverse=True)
        V = np.add.reduceat(J.transpose(0, 2, 1) @ J, np.searchsorted(own, np.arange(len(seen))), axis=0)
        # of a point that some of its photographs have behind them too little may be left
        lost = np.linalg.det(V) <= np.trace(V, axis1=1, axis2=2) ** 3 * SINGULAR
        V[lost] = np.eye(3)
        redundancy[done : done + len(part)] = 2.0 - np.einsum("nri,nij,nrj->n", J, np.linalg.inv(V)[own], J)
        done += len(part)
    return redundancy
