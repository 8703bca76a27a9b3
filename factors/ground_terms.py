"""What is known of poses, control points, common errors and calibrations, linearised and laid out for the reduced
system.

A factor on one variable goes to its diagonal block, or to the control point, which is eliminated with it. What joins
several goes to the blocks between them: of poses and border, of two poses, of two variables of the border. A control
point that a factor joins to anything is a variable of the border: eliminated by its own 3 × 3 matrix, it would lose the
block beside it. Its marks are then ground terms too.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import calibration_sigmas
from photogram.factors.elimination.bundle import Bundle, SingularPointError
from photogram.factors.elimination.loss import steering
from photogram.factors.elimination.points import first_observations, lay_out
from photogram.factors.elimination.reduced import Layout, NormalEquations, Terms, make_layout
from photogram.factors.elimination.reprojection import linearise, residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import GroundValues, IndeterminateError, Problem, ground_factors
from photogram.factors.linearised.alike import Factors
from photogram.factors.rigs.exposures import estimated
from photogram.factors.variables import (
    CALIBRATION,
    COMMON_ERROR,
    CONTROL_POINT,
    GNSS_OFFSET,
    POSE,
    RIG,
    TIE_POINT,
    WORDS,
)


@dataclass(frozen=True, eq=False)
class _Sums:
    """The terms as they are summed, and the entries between two poses: rows and columns (E, 2) of the poses' matrix and
    values (E,)."""

    terms: Terms
    entries: list[tuple[IntArray, FloatArray]]

    def add(self, layout: Layout, columns: IntArray, A: FloatArray, b: FloatArray) -> float:
        """Add observations with the Jacobians A (n, r, c) on ``columns`` (n, c) and the residuals −b (n, r), in place;
        returns half the sum of their squares."""
        m = layout.columns
        edge = layout.columns + layout.border
        terms = self.terms
        information, gradient = np.einsum("nri,nrj->nij", A, A), np.einsum("nri,nr->ni", A, b)
        row, column = np.broadcast_arrays(columns[:, :, None], columns[:, None, :])
        pose = row < m
        border = (row >= m) & (row < edge)
        control = row >= edge
        both = pose & (column < m)
        for target, chosen, index in (
            (terms.pose, both & (row // 6 == column // 6), (row // 6, row % 6, column % 6)),
            (terms.pose_border, pose & (column >= m), (row, column - m)),
            (terms.border, border & (column >= m), (row - m, column - m)),
            (terms.control, control, ((row - edge) // 3, (row - edge) % 3, (column - edge) % 3)),
        ):
            np.add.at(target, tuple(i[chosen] for i in index), information[chosen])
        between = both & (row // 6 > column // 6)
        if between.any():
            self.entries.append((np.column_stack([row[between], column[between]]), information[between]))
        control_gradient = terms.control_gradient.reshape(-1)
        for vector, chosen, start in (
            (terms.pose_gradient, columns < m, 0),
            (terms.border_gradient, (columns >= m) & (columns < edge), m),
            (control_gradient, columns >= edge, edge),
        ):
            np.add.at(vector, columns[chosen] - start, gradient[chosen])
        return 0.5 * float(np.sum(b**2))

    def whole(self, cost: float) -> Terms:
        """Return the terms with the entries between two poses."""
        if not self.entries:
            return replace(self.terms, cost=cost)
        at, values = (np.concatenate(part) for part in zip(*self.entries, strict=True))
        return replace(self.terms, cost=cost, between_at=at, between=values)


def _joined(ground: tuple[Factors, ...]) -> tuple[IntArray, IntArray]:
    """Return the control points (K,) that a factor joins to another variable, ascending, and the pairs (n, 2) of
    photographs that a factor joins."""
    several = [factors for factors in ground if len(factors.kinds) > 1]
    points, pairs = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 2), dtype=np.int64)]
    for factors in several:
        kinds = np.array(factors.kinds)
        points.append(factors.index[:, kinds == CONTROL_POINT].ravel())
        pairs += [factors.index[:, ends] for ends in combinations(np.flatnonzero(kinds == POSE).tolist(), 2)]
    return np.unique(np.concatenate(points)), np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)


class GroundTerms:
    """The factors of a problem on everything but image points, for one layout of the reduced system, and the marks of
    the layout's coupled control points.

    Raises ValueError for a factor that the layout has no place for: one on a tie point, one between two photographs
    farther apart than its reach, one between a control point and another variable that is not among its ``coupled``.
    """

    def __init__(self, problem: Problem, layout: Layout, ground: tuple[Factors, ...] | None = None) -> None:
        self._problem, self._layout = problem, layout
        self._ground = ground_factors(problem) if ground is None else ground
        self._columns = [self._columns_of(factors) for factors in self._ground]
        self._marks = problem.marks.select(np.isin(problem.marks.point, layout.coupled))

    def _columns_of(self, factors: Factors) -> IntArray:
        """Return the columns (n, c) of factors in the numbering poses, border, control points."""
        kinds, index, layout = factors.kinds, factors.index, self._layout
        if len(kinds) > 1:
            lost = np.setdiff1d(index[:, np.array(kinds) == CONTROL_POINT], layout.coupled)
            if len(lost):
                raise ValueError(
                    f"a factor joins control point {lost[0]} to another variable; the layout eliminates it"
                )
            places = layout.place[index[:, np.array(kinds) == POSE]]
            apart = int(np.ptp(places, axis=1).max()) if places.shape[1] else 0
            if apart > layout.reach:
                raise ValueError(f"a factor joins photographs {apart} places apart: beyond the band")
        return np.hstack([self._columns_at(kind, own) for kind, own in zip(kinds, index.T, strict=True)])

    def _columns_at(self, kind: str, index: IntArray) -> IntArray:
        """Return the columns (n, d) of variables (n,) of one kind."""
        layout = self._layout
        if kind == POSE:
            return 6 * layout.place[index][:, None] + np.arange(6)
        if kind == CALIBRATION:
            own = [layout.camera_column[c] + np.arange(len(self._problem.free[c])) for c in index.tolist()]
            return layout.columns + np.array(own, dtype=np.int64)
        if kind in (COMMON_ERROR, RIG):
            of = layout.columns_of_rig if kind == RIG else layout.columns_of_common
            return layout.columns + np.array([of(k) for k in index.tolist()], dtype=np.int64)
        if kind == GNSS_OFFSET:
            first = layout.offset_column + 3 * index
        elif kind != CONTROL_POINT:
            raise ValueError(f"a factor on {WORDS.get(kind, kind)} {index[0]}: only rays know tie points")
        else:
            coupled = layout.ground_column + 3 * np.searchsorted(layout.coupled, index)
            first = np.where(np.isin(index, layout.coupled), coupled, layout.border + 3 * index)
        return layout.columns + first[:, None] + np.arange(3)

    def cost(self, state: State) -> float:
        """Return half the sum of squared whitened residuals."""
        values = GroundValues(self._problem, state)
        ground = sum((factors.cost(values) for factors in self._ground), 0.0)
        if self._problem.summary is not None:
            ground += self._problem.summary.cost_at(state.cameras)
        return ground + self._mark_cost(state) if len(self._marks) else ground

    def rows_of(self, state: State, kind: type[Factors]) -> tuple[FloatArray, FloatArray]:
        """Return the whitened misfits (n,) of all factors of a ``kind``, and their rows (n, 6 free + border) on poses
        and border; ValueError where one is on a control point that the layout eliminates."""
        layout, values = self._layout, GroundValues(self._problem, state)
        misfits, rows = [np.zeros(0)], [np.zeros((0, layout.columns + layout.border))]
        for factors, columns in zip(self._ground, self._columns, strict=True):
            if not isinstance(factors, kind):
                continue
            if columns.max(initial=-1) >= layout.columns + layout.border:
                raise ValueError("a factor on a control point that the layout eliminates has no row")
            linear = factors.linearised(values)
            own = np.zeros((*linear.misfit.shape, layout.columns + layout.border))
            np.put_along_axis(own, np.repeat(columns[:, None], own.shape[1], axis=1), linear.jacobian, axis=2)
            misfits.append(linear.misfit.ravel())
            rows.append(own.reshape(-1, own.shape[2]))
        return np.concatenate(misfits), np.concatenate(rows)

    def _mark_cost(self, state: State) -> float:
        marks = self._marks
        whitened = marks.with_penalty(residuals(marks, state.cameras, state.control))
        return 0.5 * float(np.sum(whitened**2))

    def linearise(self, state: State) -> Terms:
        """Return the terms of all factors at ``state``."""
        layout, values = self._layout, GroundValues(self._problem, state)
        sums, cost = self._of_tie_points(state)
        for factors, columns in zip(self._ground, self._columns, strict=True):
            linear = factors.linearised(values)
            cost += sums.add(layout, columns, linear.jacobian, -linear.misfit)
        if len(self._marks):
            self._add_marks(state, sums)
            cost += self._mark_cost(state)
        terms = sums.terms
        if self._problem.focal_information is not None:
            owner, parameter = layout.free_parameters
            at = np.flatnonzero(parameter == 0)
            unit = layout.border_unit[at]
            terms.border[np.ix_(at, at)] += self._problem.focal_information[np.ix_(owner[at], owner[at])] * np.outer(
                unit, unit
            )
        return sums.whole(cost)

    def _of_tie_points(self, state: State) -> tuple[_Sums, float]:
        """Return what a summary says of the tie points, to which all else is added, and its cost."""
        summary, controls = self._problem.summary, len(state.control)
        if summary is None:
            return _Sums(Terms.zero(self._layout, controls), []), 0.0
        terms = summary.terms(state.cameras, self._layout, controls)
        return _Sums(terms, [(terms.between_at, terms.between)]), terms.cost

    def _add_marks(self, state: State, sums: _Sums) -> None:
        """Add the marks of the coupled control points, camera by camera."""
        layout, marks = self._layout, self._marks
        linear = linearise(marks, state.cameras, state.control)
        camera_of = state.cameras.camera[marks.photograph]
        owner, parameter = layout.free_parameters
        point = layout.ground_column + 3 * np.searchsorted(layout.coupled, marks.point)
        for camera in np.unique(camera_of).tolist():
            own, lens = camera_of == camera, np.flatnonzero(owner == camera)
            pose = 6 * layout.place[marks.photograph[own]][:, None] + np.arange(6)
            columns = np.hstack(
                [
                    pose,
                    layout.columns + np.broadcast_to(lens, (len(pose), len(lens))),
                    layout.columns + point[own][:, None] + np.arange(3),
                ]
            )
            calibration = linear.calibration[own][:, :, parameter[lens]] * layout.border_unit[lens]
            A = np.concatenate([linear.pose[own], calibration, linear.point[own]], axis=2)
            sums.add(layout, columns, A, -linear.residual[own])


def bundle_of(problem: Problem, state: State) -> Bundle:
    """Return the problem laid out for elimination: a band of photographs, a border of calibrations, common errors, and
    the control points that a factor joins to another variable."""
    ground = ground_factors(problem)
    coupled, pairs = _joined(ground)
    if problem.summary is not None:
        pairs = np.concatenate([pairs, problem.summary.pair])
    free = calibration_sigmas(problem.block.cameras) > 0
    index = np.flatnonzero(np.bincount(problem.tie.point, minlength=len(state.tie_point)))
    control = np.setdiff1d(np.arange(len(problem.control_world_m)), coupled)
    marks = problem.marks.select(~np.isin(problem.marks.point, coupled))
    order = np.argsort(marks.point, kind="stable")
    layout = make_layout(
        [
            (first_observations(np.searchsorted(index, problem.tie.point), len(index)), problem.tie.photograph),
            (first_observations(marks.point[order], len(problem.control_world_m)), marks.photograph[order]),
            (2 * np.arange(len(pairs) + 1), pairs.ravel()),
        ],
        np.zeros(len(problem.block.photographs), dtype=bool),
        state.position,
        problem.scale.reshape(free.shape) * free,
        len(problem.flights),
        coupled,
        np.array([len(error.sigma) for error in problem.block.common_errors], dtype=np.int64),
        estimated(problem.block),
    )
    return Bundle(
        layout,
        lay_out(problem.tie, index, layout),
        lay_out(marks, control, layout),
        GroundTerms(problem, layout, ground),
        steering(problem.robust_loss, problem.robust_threshold),
    )


def eliminated(bundle: Bundle, state: State, terms: Terms, pool: ThreadPoolExecutor | None) -> NormalEquations:
    """Return the undamped reduced normal equations.

    Raises IndeterminateError naming the point that its rays cannot fix.
    """
    try:
        return bundle.eliminated(state, terms, 0.0, pool)
    except SingularPointError as error:
        raise indeterminate_point(error) from error


def indeterminate_point(error: SingularPointError) -> IndeterminateError:
    """Return the error that names the point that its rays cannot fix."""
    return IndeterminateError((TIE_POINT if error.kind == "tie" else CONTROL_POINT, error.point))


def variable_at(layout: Layout, column: int) -> tuple[str, int]:
    """Return kind and index of the variable at a column of the reduced system."""
    if column < layout.columns:
        return POSE, int(layout.photograph_at[column // 6])
    border = column - layout.columns
    if border >= layout.ground_column:
        return CONTROL_POINT, int(layout.coupled[(border - layout.ground_column) // 3])
    if border >= layout.common_column:
        number = int(np.searchsorted(np.cumsum(layout.common), border - layout.common_column, side="right"))
        errors = len(layout.common) - len(layout.rigs)
        return (COMMON_ERROR, number) if number < errors else (RIG, int(layout.rigs[number - errors]))
    if border >= layout.offset_column:
        return GNSS_OFFSET, (border - layout.offset_column) // 3
    return CALIBRATION, int(layout.free_parameters[0][border])
