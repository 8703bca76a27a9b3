"""What photographs and calibration do to the ground, jointly at places over the block: what distances share of it.

Neighbouring points are displaced alike by an error of the photographs that see them, so it drops out of the distance
between them; far apart they share the datum alone. Both are in the joint covariance of a few dozen places.
"""

import numpy as np

from photogram.arrays import FloatArray
from photogram.factors.elimination.state import State
from photogram.factors.functionals import Solvable, functions_of_tie_points
from photogram.factors.graph import Problem
from photogram.quality.deformation import Places, cells_of

CELLS = 7
"""Of the grid over a block, along each side: a cell with tie points is a place."""

_NEGLIGIBLE = 0.03  # of a variance: one and a half per cent of a standard deviation


def ground_errors(problem: Problem, state: State, solvable: Solvable, places: Places) -> tuple[FloatArray, FloatArray]:
    """Return places (Q, 3) over a block, m in the world, and the joint covariance (3 Q, 3 Q), m², of the ground there:
    what the errors of photographs and calibration do to it, without what its points scatter by themselves.

    A place is the mean of the tie points of a cell, so that it stands for no single pair of rays.
    """
    position = state.tie_point[places.points]
    _, cell, count = np.unique(cells_of(position[:, :2], CELLS), return_inverse=True, return_counts=True)
    share = (cell[:, None] == np.arange(len(count))) / count
    weights = np.einsum("pq,ij->piqj", share, np.eye(3)).reshape(len(position), 3, -1)
    functions = functions_of_tie_points(problem, state, solvable.layout, places.points, weights)
    return share.T @ position, functions.shared(solvable)


def factor_of_differences(covariance_m2: FloatArray, negligible_m: float = 1e-4) -> FloatArray:
    """Return L (Q, 3, R) of a joint covariance (3 Q, 3 Q): the error of the difference of places i and j has the
    covariance (L_i − L_j)(L_i − L_j)ᵀ.

    What all places share is taken out, so that a datum of metres takes no digits from millimetres. R is as small as
    leaves out ``_NEGLIGIBLE`` of the variance at each place, or ``negligible_m``, at most.
    """
    count = len(covariance_m2) // 3
    if not count:
        return np.zeros((0, 3, 0))
    mean = np.kron(np.full((count, count), 1.0 / count), np.eye(3))
    centred = covariance_m2 - mean @ covariance_m2
    centred = centred - centred @ mean
    value, vector = np.linalg.eigh(0.5 * (centred + centred.T))
    factor = vector[:, ::-1] * np.sqrt(np.maximum(value[::-1], 0.0))
    left = np.cumsum((factor**2)[:, ::-1], axis=1)[:, ::-1]  # variance from each column on
    enough = np.all(left <= _NEGLIGIBLE * left[:, :1] + negligible_m**2, axis=0)
    rank = int(np.argmax(enough)) if enough.any() else factor.shape[1]
    return np.asarray(factor[:, : max(rank, 1)].reshape(count, 3, -1))
