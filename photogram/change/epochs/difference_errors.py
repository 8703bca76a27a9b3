"""What photographs and calibration do to the difference of two epochs, from the joint covariance of one adjustment.

A ground point that is intersected from the photographs of one epoch follows them by u = W V⁻¹, and that of the other
epoch at the same place by u′: their difference has the covariance (u′ − u)ᵀ S⁻¹ (u′ − u), S the reduced system of all
photographs (Förstner & Wrobel 2016, sec. 15.4). What both follow alike drops out.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.errors import SurfaceError
from photogram.factors.elimination.bundle import limited_threads
from photogram.factors.elimination.reduced import Layout
from photogram.factors.elimination.state import State
from photogram.factors.functionals import factored, intersected
from photogram.factors.graph import Problem
from photogram.quality.deformation import cells_of
from photogram.quality.improvements import final_linearisation
from photogram.results import Adjustment
from photogram.volumes.joint_errors import JointErrors

CELLS = 7
"""Of the grid over the ground that both epochs show, along each side: a cell with points of both is a place."""
FEWEST_RAYS, TRIED = 2, 5
"""Rays of a point in its epoch, at least; points of a cell that are looked at."""
NEGLIGIBLE, NEGLIGIBLE_M2 = 1e-3, 1e-10
"""Of the largest variance of a cause, and of any, below which it is left out."""


def _points_of(problem: Problem, epoch: BoolArray) -> IntArray:
    """Return the tie points (P,) with enough rays in the photographs of an epoch (N,): three where many have them."""
    tie = problem.tie
    rays = np.bincount(tie.point[epoch[tie.photograph]], minlength=int(tie.point.max(initial=-1)) + 1)
    firm = np.flatnonzero(rays > FEWEST_RAYS)
    return firm if len(firm) >= TRIED * CELLS**2 else np.flatnonzero(rays >= FEWEST_RAYS)


def _columns(
    problem: Problem, state: State, layout: Layout, epoch: BoolArray, points: IntArray
) -> tuple[FloatArray, BoolArray]:
    """Return the columns (6 free + border, 3 P) of tie points (P,) as the photographs of an epoch alone intersect them,
    and which of them (P,) their rays fix."""
    tie = problem.tie
    wanted, place = np.unique(points, return_inverse=True)
    chosen = np.flatnonzero(epoch[tie.photograph] & np.isin(tie.point, wanted))
    chosen = chosen[np.argsort(tie.point[chosen], kind="stable")]
    own = tie.select(chosen)
    own = replace(own, point=np.searchsorted(wanted, own.point).astype(np.int64))
    found = intersected(own, state.tie_point[wanted], state, layout)
    each = (3 * place[:, None] + np.arange(3)).ravel()
    return np.asarray(found.columns[:, each].toarray()), found.known[place]


def _candidates(before: FloatArray, after: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return points (K,) of the earlier epoch, the nearest (K,) of the later one, and the cell (K,) of each, of the
    cells in which both have points, (P, 2) and (Q, 2) in plan: those nearest to the middle of the earlier ones."""
    of = cells_of(np.concatenate([before, after]), CELLS)
    cell = of[: len(before)], of[len(before) :]
    first, second, cells = list[int](), list[int](), list[int]()
    for number in np.intersect1d(cell[0], cell[1]).tolist():
        own, other = (np.flatnonzero(each == number) for each in cell)
        middle = before[own].mean(axis=0)
        near = own[np.argsort(np.linalg.norm(before[own] - middle, axis=1), kind="stable")][:TRIED]
        first += near.tolist()
        second += other[cKDTree(after[other]).query(before[near])[1]].tolist()
        cells += [number] * len(near)
    return np.array(first, dtype=np.int64), np.array(second, dtype=np.int64), np.array(cells, dtype=np.int64)


def _median_of_each(cell: IntArray, variance: FloatArray) -> IntArray:
    """Return one of each cell's candidates (K,): that of the median variance, which stands for no single pair of rays
    and, other than a mean, for a single point."""
    chosen = []
    for number in np.unique(cell).tolist():
        own = np.flatnonzero(cell == number)
        chosen.append(own[np.argsort(variance[own], kind="stable")[len(own) // 2]])
    return np.array(chosen, dtype=np.int64)


def _factor(covariance_m2: FloatArray) -> FloatArray:
    """Return F (Q, 3, R) of a joint covariance (3 Q, 3 Q) ≈ F Fᵀ, without causes that are negligible."""
    value, vector = np.linalg.eigh(0.5 * (covariance_m2 + covariance_m2.T))
    kept = value > max(NEGLIGIBLE * float(value[-1]), NEGLIGIBLE_M2)
    kept[-1] = True
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0)))[:, kept][:, ::-1].reshape(len(value) // 3, 3, -1))


def difference_errors(
    result: Adjustment, settings: AdjustmentSettings, earlier: BoolArray, later: BoolArray
) -> JointErrors:
    """Return the errors of the difference of two epochs, later minus earlier, along the axes of the map; ``earlier``
    and ``later`` (N,) say which photographs of an adjustment are of each.

    Raises SurfaceError where the two show no ground in common.
    """
    problem, state, kept = final_linearisation(result, settings)
    epochs = earlier[kept], later[kept]
    points = [_points_of(problem, epoch) for epoch in epochs]
    first, second, cell = _candidates(*(state.tie_point[own, :2] for own in points))
    if not len(first):
        raise SurfaceError("two epochs show no ground in common: there is no difference")
    points = [points[0][first], points[1][second]]
    with limited_threads(0):
        solvable = factored(problem, state)
        before, after = (
            _columns(problem, state, solvable.layout, epoch, own) for epoch, own in zip(epochs, points, strict=True)
        )
        columns, known = after[0] - before[0], np.flatnonzero(before[1] & after[1])
        if not len(known):
            raise SurfaceError("two epochs show no ground in common that their rays fix: there is no difference")
        rising = columns[:, 3 * known + 2]
        variance = np.einsum("ck,ck->k", rising, solvable.solve(rising))
        chosen = known[_median_of_each(cell[known], variance)]
        columns = columns[:, (3 * chosen[:, None] + np.arange(3)).ravel()]
        covariance = columns.T @ solvable.solve(columns)
    place, frame = state.tie_point[points[0][chosen]], result.block.frame
    axes = np.array([frame.rotation_world_from_map(at) for at in place])
    factor = np.einsum("qji,qjr->qir", axes, _factor(covariance))
    return JointErrors(frame.map_from_world(place)[:, :2], factor)
