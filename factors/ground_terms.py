"""What is known of poses, control points, offsets and calibrations, linearised by GTSAM and laid out for the reduced
system.

Every factor joins at most one photograph; its Jacobian goes to the pose's diagonal block, to the border, or to the
control point that is eliminated with it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from photogram.arrays import IntArray
from photogram.factors.elimination.bundle import Bundle, SingularPointError
from photogram.factors.elimination.loss import steering
from photogram.factors.elimination.points import first_observations, lay_out
from photogram.factors.elimination.reduced import Layout, NormalEquations, Terms, make_layout
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem, ground_graph, ground_values
from photogram.factors.variables import CALIBRATION, CONTROL_POINT, GNSS_OFFSET, POSE, TIE_POINT, kind_and_index
from photogram.projection import PARAMETERS


@dataclass(frozen=True, eq=False)
class _Alike:
    """Factors with the same kinds of variables: their numbers in the graph and the columns (n, c) of their Jacobians in
    the numbering poses, border, control points."""

    factor: IntArray
    columns: IntArray


class GroundTerms:
    """The factors of a problem on everything but image points, for one layout of the reduced system."""

    def __init__(self, problem: Problem, layout: Layout) -> None:
        self._problem, self._layout = problem, layout
        self._graph = ground_graph(problem)
        alike: dict[tuple[int, int], tuple[list[int], list[list[int]]]] = {}
        for i in range(self._graph.size()):
            factor = self._graph.at(i)
            columns = [column for variable in factor.keys() for column in self._columns(variable)]  # noqa: SIM118
            numbers, rows = alike.setdefault((factor.dim(), len(columns)), ([], []))
            numbers.append(i)
            rows.append(columns)
        self._alike = [
            _Alike(np.array(numbers, dtype=np.int64), np.array(rows, dtype=np.int64))
            for numbers, rows in alike.values()
        ]

    def _columns(self, variable: int) -> list[int]:
        kind, index = kind_and_index(variable)
        layout = self._layout
        if kind == POSE:
            return list(range(6 * int(layout.place[index]), 6 * int(layout.place[index]) + 6))
        if kind == CALIBRATION:
            start = layout.columns + int(layout.camera_column[index])
            return list(range(start, start + len(self._problem.free[index])))
        start = layout.columns + (layout.offset_column if kind == GNSS_OFFSET else layout.border) + 3 * index
        return list(range(start, start + 3))

    def cost(self, state: State) -> float:
        """Return half the sum of squared whitened residuals."""
        return float(self._graph.error(ground_values(self._problem, state)))

    def linearise(self, state: State) -> Terms:
        """Return the terms of all factors at ``state``."""
        layout, linear = self._layout, self._graph.linearize(ground_values(self._problem, state))
        m, edge = layout.columns, layout.columns + layout.border
        terms, cost = Terms.zero(layout, len(state.control)), 0.0
        for alike in self._alike:
            jacobians = [linear.at(i).jacobian() for i in alike.factor.tolist()]
            A, b = np.array([a for a, _ in jacobians]), np.array([b for _, b in jacobians])
            cost += 0.5 * float(np.sum(b**2))
            information, gradient = np.einsum("nri,nrj->nij", A, A), np.einsum("nri,nr->ni", A, b)
            rows, columns = np.broadcast_arrays(alike.columns[:, :, None], alike.columns[:, None, :])
            pose, border, control = rows < m, (rows >= m) & (rows < edge), rows >= edge
            for target, chosen, index in (
                (terms.pose, pose & (columns < m), (rows // 6, rows % 6, columns % 6)),
                (terms.pose_border, pose & (columns >= m), (rows, columns - m)),
                (terms.border, border & (columns >= m), (rows - m, columns - m)),
                (terms.control, control, ((rows - edge) // 3, (rows - edge) % 3, (columns - edge) % 3)),
            ):
                np.add.at(target, tuple(i[chosen] for i in index), information[chosen])
            row = alike.columns
            control_gradient = terms.control_gradient.reshape(-1)
            for vector, chosen, start in (
                (terms.pose_gradient, row < m, 0),
                (terms.border_gradient, (row >= m) & (row < edge), m),
                (control_gradient, row >= edge, edge),
            ):
                np.add.at(vector, row[chosen] - start, gradient[chosen])
        if self._problem.focal_information is not None:
            owner, parameter = layout.free_parameters
            at = np.flatnonzero(parameter == 0)
            unit = layout.border_unit[at]
            terms.border[np.ix_(at, at)] += self._problem.focal_information[np.ix_(owner[at], owner[at])] * np.outer(
                unit, unit
            )
        return Terms(
            cost, terms.pose, terms.pose_border, terms.pose_gradient, terms.border, terms.border_gradient,
            terms.control, terms.control_gradient,
        )  # fmt: skip


def bundle_of(problem: Problem, state: State) -> Bundle:
    """Return the problem laid out for elimination: a band of photographs, a border of calibrations and offsets."""
    free = np.array([camera.sigmas > 0 for camera in problem.block.cameras]).reshape(-1, PARAMETERS)
    index = np.flatnonzero(np.bincount(problem.tie.point, minlength=len(state.tie_point)))
    control = np.arange(len(problem.control_world_m))
    marks = np.argsort(problem.marks.point, kind="stable")
    layout = make_layout(
        [
            (first_observations(np.searchsorted(index, problem.tie.point), len(index)), problem.tie.photograph),
            (first_observations(problem.marks.point[marks], len(control)), problem.marks.photograph[marks]),
        ],
        np.zeros(len(problem.block.photographs), dtype=bool),
        state.position,
        problem.scale.reshape(-1, PARAMETERS) * free,
        len(problem.flights),
    )
    return Bundle(
        layout,
        lay_out(problem.tie, index, layout),
        lay_out(problem.marks, control, layout),
        GroundTerms(problem, layout),
        steering(problem.robust_loss, problem.robust_threshold),
    )


def eliminated(bundle: Bundle, state: State, terms: Terms, pool: ThreadPoolExecutor | None) -> NormalEquations:
    """Return the undamped reduced normal equations.

    Raises IndeterminateError naming the point that its rays cannot fix.
    """
    try:
        return bundle.eliminated(state, terms, 0.0, pool)
    except SingularPointError as fault:
        raise indeterminate_point(fault) from fault


def indeterminate_point(fault: SingularPointError) -> IndeterminateError:
    """Return the fault that names the point that its rays cannot fix."""
    return IndeterminateError((TIE_POINT if fault.kind == "tie" else CONTROL_POINT, fault.point))


def variable_at(layout: Layout, column: int) -> tuple[str, int]:
    """Return kind and index of the variable at a column of the reduced system."""
    if column < layout.columns:
        return POSE, int(layout.photograph_at[column // 6])
    border = column - layout.columns
    if border >= layout.offset_column:
        return GNSS_OFFSET, (border - layout.offset_column) // 3
    return CALIBRATION, int(layout.free_parameters[0][border])
