"""Reliability of constraints between points, and the differences and sigmas of those that are checks.

With the whitened misfits v of a constraint's observations, their Jacobian J on the points and A on unknowns of their
own, the projector P across A and the covariance C = J Σ Jᵀ, the misfits of what took part have Q = P − P C P (Förstner
& Wrobel 2016, sec. 4.6; P = I without such unknowns), those of a check P + P C P: it has no part in Σ. Its square roots
of the diagonal are what a difference of a check is divided by. A point that is out of a surface is compared with the
one that the others lie on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.adjustment.reliability import w_tests
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.constraints.between_points import Constraint
from photogram.factors.constraints import (
    Heights,
    Rows,
    basis_across,
    rows_of,
    taking_part,
    unknowns_of,
    without_shape,
)
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.joint_covariance import ground_columns
from photogram.results import ConstraintTests
from photogram.survey import Block

TESTED = 1e-3
"""Least redundancy number of an observation that something else tests."""


@dataclass(frozen=True, eq=False)
class _Known:
    """A constraint whose points have positions: its number, where its rows (m,) stand among all observations, its
    points' numbers (n,) among ground points or photographs, its linearised observations, their standard deviations,
    infinite for those that are out of it, and whether it took part."""

    number: int
    at: IntArray
    index: IntArray
    of_photographs: bool
    rows: Rows
    sigma_m: FloatArray
    took_part: bool


def _known(block: Block, ground_world_m: FloatArray, centre_world_m: FloatArray) -> list[_Known]:
    """Return the constraints whose points have positions, those of ground points (G, 3) and photographs (N, 3)."""
    points = {name: g for g, name in enumerate(block.control_points.name)}
    photographs = {p.name: i for i, p in enumerate(block.photographs)}
    parts = {placed.number: placed.rows for placed in taking_part(block)}
    known, start = [], 0
    for number, constraint in enumerate(block.constraints):
        first, start = start, start + len(constraint.sigmas_m)
        numbers, places = (photographs, centre_world_m) if constraint.of_photographs else (points, ground_world_m)
        index = np.array([numbers.get(name, -1) for name in constraint.points], dtype=np.int64)
        there = (index >= 0) & np.isfinite(places[index]).all(axis=1) if len(places) else index < -1
        sigma_m, took_part = np.array(constraint.sigmas_m), number in parts
        if took_part:
            sigma_m = np.where(np.isin(np.arange(len(sigma_m)), parts[number]), sigma_m, np.inf)
        if len(sigma_m) == 1:
            used: BoolArray = np.ones(1, dtype=bool)
            if not there.all():
                continue
        else:
            used = np.asarray(there & np.isfinite(sigma_m))
            if used.sum() < unknowns_of(constraint) or without_shape(constraint, places[index], used):
                continue
            index, sigma_m = index[there], sigma_m[there]
        own = places[index]
        rows = rows_of(constraint, own, sigma_m, Heights.near(block.frame, own))
        at = first + (np.arange(1) if len(used) == 1 else np.flatnonzero(there))
        known.append(_Known(number, at, index, constraint.of_photographs, rows, sigma_m, took_part))
    return known


def _spread(
    problem: Problem, state: State, covariances: Covariances, ground_world_m: FloatArray, known: Sequence[_Known]
) -> list[FloatArray]:
    """Return the covariances (m, m), m², of what every constraint observes, as the points have them."""
    numbers, inverse, turned = ground_columns(problem, state, covariances, ground_world_m)
    layout, spreads = covariances.layout, []
    for k in known:
        J = k.rows.jacobian
        if k.of_photographs:
            columns, own = np.zeros((layout.columns + layout.border, len(J))), np.zeros((len(J), len(J)))
            for n, i in enumerate(k.index.tolist()):
                first = 6 * int(layout.place[i]) + 3
                columns[first : first + 3] += state.rotation[i].T @ J[:, n].T
        else:
            at = np.searchsorted(numbers, k.index)
            columns = -np.einsum("mni,cni->cm", J, turned[:, at])
            own = np.einsum("mni,nij,lnj->ml", J, inverse[at], J)
        spreads.append(own + covariances.between(columns, columns))
    return spreads


def _filled(tests: ConstraintTests, k: _Known, tested: FloatArray, counted: FloatArray) -> None:
    """Fill in what is to say of a constraint, in place; ``tested`` and ``counted`` (m, m) are the covariances of what
    it observes for tests, and with everything that counts."""
    used = np.isfinite(k.sigma_m)
    sigma, at = k.sigma_m[used], k.at[used]
    tests.residual_m[k.at] = k.rows.misfit_m
    A = k.rows.common[used] / sigma[:, None]
    B = basis_across(A)
    P = B @ B.T
    weight = np.outer(sigma, sigma)
    v, C = k.rows.misfit_m[used] / sigma, counted[np.ix_(used, used)] / weight
    if k.took_part:
        Q = P - P @ (tested[np.ix_(used, used)] / weight) @ P
        redundancy, w = w_tests(v[:, None], (1.0 - np.diag(Q))[:, None, None])
        redundancy, w = redundancy[:, 0], np.where(redundancy[:, 0] > TESTED, w[:, 0], np.nan)
        root = np.sqrt(np.where(np.isfinite(w), redundancy, np.nan))
        tests.adjusted_sigma_m[at] = sigma * np.sqrt(np.clip(1.0 - np.diag(P - P @ C @ P), 0.0, None))
        tests.redundancy[at], tests.w[at] = redundancy, w
        tests.left_out_m[at], tests.left_out_sigma_m[at] = w * sigma / root, sigma / root
    elif used.any():
        S = np.diag(P @ C @ P)
        tests.adjusted_sigma_m[at] = sigma * np.sqrt(np.clip(S, 0.0, None))
        share = np.diag(P)  # zero where a plane has three points
        tests.z[at] = np.where(share > TESTED, v / np.sqrt(np.where(share > TESTED, S + share, 1.0)), np.nan)
    out = np.flatnonzero(~used)
    if len(out):
        a = k.rows.common[out]
        normal = np.linalg.inv(A.T @ A) if A.shape[1] else np.zeros((0, 0))
        turn = np.zeros((len(out), len(k.sigma_m)))
        turn[np.arange(len(out)), out] = 1.0
        turn[:, np.flatnonzero(used)] = -(a @ normal @ A.T) / sigma
        spread = turn @ counted @ turn.T + a @ normal @ a.T
        tests.adjusted_sigma_m[k.at[out]] = np.sqrt(np.clip(np.diag(spread), 0.0, None))


def constraint_tests(
    problem: Problem,
    state: State,
    fixed: Covariances,
    counted_problem: Problem,
    counted: Covariances,
    ground_world_m: FloatArray,
) -> ConstraintTests:
    """Return what is to say of the constraints of a solved problem, the ground points of its block at
    ``ground_world_m`` (G, 3), NaN for those that have no position; covariances as of reliability."""
    block = problem.block
    tests = ConstraintTests.unknown(sum(len(c.sigmas_m) for c in block.constraints))
    known = _known(block, ground_world_m, state.position)
    if not known:
        return tests
    spread = _spread(counted_problem, state, counted, ground_world_m, known)
    tested = spread if counted is fixed else _spread(problem, state, fixed, ground_world_m, known)
    for k, own, counted_spread in zip(known, tested, spread, strict=True):
        # what is considered stays in the residuals: see photogram.adjustment.reliability
        _filled(tests, k, own if counted is fixed else 2.0 * own - counted_spread, counted_spread)
    return tests


def whitened_misfits(
    block: Block, state: State, control_world_m: FloatArray, fitted: Sequence[Constraint]
) -> FloatArray:
    """Return the residuals (K,) of all observations of constraints in their standard deviations, NaN for what takes no
    part. Control points are at ``control_world_m`` (G, 3); surfaces fit them by the sigmas of ``fitted``, the same
    constraints."""
    sizes = [len(c.sigmas_m) for c in block.constraints]
    first, whitened = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64), np.full(sum(sizes), np.nan)
    for placed in taking_part(block):
        places = (state.position if placed.constraint.of_photographs else control_world_m)[placed.index]
        sigma_m = placed.sigma_m
        by = np.array(fitted[placed.number].sigmas_m)[placed.rows]
        rows = rows_of(placed.constraint, places, by, Heights.near(block.frame, places))
        whitened[first[placed.number] + placed.rows] = rows.misfit_m / sigma_m
    return whitened
