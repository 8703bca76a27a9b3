"""GTSAM as the referee: its normal equations of everything, and its own factors among ours. Tests that import this, or
gtsam itself, are left out where it is not installed."""

from dataclasses import dataclass

import gtsam
import numpy as np

from photogram.arrays import FloatArray
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.linearised.alike import Factors, Linearised, Values
from photogram.factors.reference.graph import ground_graph, linearise_all, variable_size
from photogram.factors.reference.native import in_gtsam
from photogram.factors.variables import POSE, kind_and_index


@dataclass(frozen=True, eq=False)
class OfGtsam(Factors):
    """One of GTSAM's own factors, linearised by GTSAM."""

    native: gtsam.NonlinearFactor

    @property
    def rows(self) -> int:
        """Return how many observations it has."""
        return int(self.native.dim())

    def linearised(self, values: Values) -> Linearised:
        """Return the factor linearised at values."""
        there = gtsam.Values()
        for variable in self.variables[0].tolist():
            alone = np.array([variable])
            if kind_and_index(variable)[0] == POSE:
                R, C = values.poses(alone)
                there.insert(variable, gtsam.Pose3(gtsam.Rot3(R[0]), C[0]))
            else:
                there.insert(variable, values.vectors(alone)[0])
        A, b = self.native.linearize(there).jacobian()
        return Linearised(-b[None], A[None])


def of_gtsam(native: gtsam.NonlinearFactor) -> OfGtsam:
    """Return one of GTSAM's own factors as ours."""
    return OfGtsam(np.array([list(native.keys())], dtype=np.int64), native)


def native(factors: Factors) -> gtsam.NonlinearFactor:
    """Return the one factor of ours as GTSAM's."""
    (one,) = in_gtsam(factors)
    return one


def gtsam_marginals(problem: Problem, state: State) -> gtsam.Marginals:
    """Return GTSAM's own marginals of the whole linear graph at a state."""
    system = linearise_all(problem, ground_graph(problem), state)
    zero = gtsam.VectorValues()
    for variable in system.variables:
        zero.insert(variable, np.zeros(len(system.diagonal[variable])))
    return gtsam.Marginals(system.graph, zero)


def whole_normal_equations(problem: Problem, state: State) -> tuple[FloatArray, FloatArray, dict[int, slice]]:
    """Return GTSAM's normal matrix of the whole linear graph, its right-hand side, and where each variable sits."""
    system = linearise_all(problem, ground_graph(problem), state, 1.0)
    ordering, place, start = gtsam.Ordering(), {}, 0
    for variable in system.variables:
        ordering.push_back(variable)
        place[variable] = slice(start, start + variable_size(problem, variable))
        start = place[variable].stop
    information, right = system.graph.hessian(ordering)
    return information, np.ravel(right), place


def whole_covariance(problem: Problem, state: State) -> tuple[FloatArray, dict[int, slice]]:
    """Return the inverse of the whole normal matrix, and where each variable sits."""
    information, _, place = whole_normal_equations(problem, state)
    scale = np.sqrt(np.diag(information))
    return np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale), place


def dense_redundancy(problem: Problem, state: State) -> tuple[FloatArray, FloatArray, int]:
    """Return the redundancy numbers (m,) and whitened residuals (m,) of all observations in the order of GTSAM's whole
    linear graph, those of tie points last, and the number of unknowns: the hat matrix, row by row."""
    system = linearise_all(problem, ground_graph(problem), state, 1.0)
    ordering = gtsam.Ordering()
    for variable in system.variables:
        ordering.push_back(variable)
    J, b = (np.array(part) for part in system.graph.jacobian(ordering))
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    return 1.0 - np.einsum("ij,ji->i", J, np.linalg.pinv(J)), b.ravel(), J.shape[1]
