"""The damped reduced system solved by GTSAM.

GTSAM gets a Gaussian factor graph of few large Hessian factors. Photographs that are neighbours in the band are one
variable; where two such groups have points in common a factor joins them, and a factor joins each with the border of
calibrations and offsets, which is eliminated last.
"""

from itertools import pairwise

import gtsam
import numpy as np
from numpy.lib.stride_tricks import as_strided

from photogram.arrays import FloatArray
from photogram.factors.elimination.reduced import Layout, NormalEquations, SingularError

GROUP = 16
"""Photographs of one variable."""


def _block(A: FloatArray, layout: Layout, rows: tuple[int, int], columns: tuple[int, int]) -> FloatArray:
    """Return a block of the poses' matrix on or below its diagonal, zero above it and beyond the band."""
    top, bottom = rows
    left, right = columns
    step = A.itemsize
    view = as_strided(A[left * layout.stride + top :], (bottom - top, right - left), (step, layout.stride * step))
    below = np.arange(top, bottom)[:, None] - np.arange(left, right)
    return np.where((below >= 0) & (layout.dense | (below <= layout.stride)), view, 0.0)


def _joint(first: int, second: int, block: FloatArray) -> gtsam.HessianFactor:
    """Return the factor of two variables that has nothing but the ``block`` (n, m) between them."""
    n, m = block.shape
    return gtsam.HessianFactor(
        first, second, np.zeros((n, n)), np.ascontiguousarray(block), np.zeros(n), np.zeros((m, m)), np.zeros(m), 0.0
    )


def _graph(normal: NormalEquations, damping: float, edges: list[int]) -> gtsam.GaussianFactorGraph:
    """Return the factors of groups of columns between ``edges``; the border's variable has the number of groups."""
    layout = normal.layout
    graph = gtsam.GaussianFactorGraph()
    groups = list(pairwise(edges))
    A = normal.damped_poses(damping)
    B = normal.B
    border = len(groups)
    for i, (left, right) in enumerate(groups):
        lower = _block(A, layout, (left, right), (left, right))
        graph.push_back(gtsam.HessianFactor(i, lower + np.tril(lower, -1).T, normal.g[left:right], 0.0))
        for j in range(i + 1, border):
            if edges[j] // 6 > (right - 1) // 6 + layout.reach:
                break
            graph.push_back(_joint(i, j, _block(A, layout, groups[j], (left, right)).T))
        if layout.border:
            graph.push_back(_joint(i, border, B[left:right]))
    if layout.border:
        graph.push_back(gtsam.HessianFactor(border, normal.damped_border(damping), normal.h, 0.0))
    return graph


def solve_with_gtsam(normal: NormalEquations, damping: float) -> tuple[FloatArray, FloatArray]:
    """Return the steps as ``Banded`` does, GTSAM eliminating groups of photographs in the order of the band."""
    layout = normal.layout
    edges = [*range(0, layout.columns, 6 * GROUP), layout.columns]
    graph, ordering = _graph(normal, damping, edges), gtsam.Ordering()
    groups = len(edges) - 1
    for variable in range(groups + (layout.border > 0)):
        ordering.push_back(variable)
    try:
        solution = graph.optimize(ordering)
    except RuntimeError as error:
        raise SingularError(_first_column(str(error), edges)) from error
    poses = np.concatenate([np.zeros(0), *(solution.at(i) for i in range(groups))])
    return poses, solution.at(groups) if layout.border else np.zeros(0)


def _first_column(message: str, edges: list[int]) -> int:
    """Return the first column of the variable that GTSAM names near its error."""
    numbers = [int(word.strip(".,)")) for word in message.split() if word.strip(".,)").isdigit()]
    return edges[min(numbers[0], len(edges) - 1)] if numbers else 0
