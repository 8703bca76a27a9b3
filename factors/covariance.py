"""Covariances of all variables on the final linearisation, from the factor of the reduced system.

A-priori sigmas are used as they stand: nothing is rescaled by sigma0. With the reduced system [A B; Bᵀ E], T = A⁻¹ B
and the border's covariance C = (E − Bᵀ T)⁻¹, two poses have the covariance (A⁻¹)_ij + T_i C T_jᵀ. Of A⁻¹ only what lies
within the band of A is computed, where all photographs that share a point are.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from photogram.arrays import FloatArray, IntArray
from photogram.factors.datum import TURN, Datum, datum_of, reach_m, weights_of
from photogram.factors.elimination.bundle import limited_threads
from photogram.factors.elimination.loss import NO_LOSS
from photogram.factors.elimination.points import Points, point_covariances
from photogram.factors.elimination.reduced import Factor, Layout, NormalEquations, SingularError, scale_matrix
from photogram.factors.elimination.reprojection import Linearisation, Observations, linearise, predicted
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.ground_terms import GroundTerms, bundle_of, eliminated, variable_at
from photogram.factors.variables import CONTROL_POINT, DATUM, POSE, TIE_POINT
from photogram.measures.rough_place import HEADING_SIGMA_RAD, rough_place
from photogram.projection import PARAMETERS
from photogram.survey import Block

RANK_TOLERANCE = 1e-13
RANK_SHIFT = 1e-11  # makes a singular system solvable for its null vectors
MEANINGLESS_SIGMA_RAD = 0.8  # an attitude known no better than this may be any
WHOLE = 0.9  # of a change that nothing holds, that is one of the block as a whole
STILL = 1e-3  # of a direction that nothing holds, up to which the cameras do not move along it
MARKS_AT_ONCE = 256  # predicted together: each is a row as long as all poses


@dataclass(frozen=True, eq=False)
class Covariances:
    """A-priori covariances at the solution.

    ``inverse`` (flat) of the poses' matrix within the band of ``layout``, ``T`` (6 free, border), ``border`` (border,
    border) of calibrations and common errors; ``factor`` of the system whose rows were divided by ``scale``.
    ``tie_point`` (P, 3, 3) and ``control_point`` (G, 3, 3) in the world, m², NaN for tie points without rays.
    """

    layout: Layout
    factor: Factor
    scale: FloatArray
    inverse: FloatArray
    T: FloatArray
    border: FloatArray
    tie_point: FloatArray
    control_point: FloatArray

    @property
    def poses(self) -> FloatArray:
        """Return the covariances (N, 6, 6) of all poses' tangents (ω in rad, v in m, camera frame)."""
        rows = 6 * self.layout.place[:, None] + np.arange(6)
        T = self.T[rows]
        own = self._inverse(rows[:, :, None], rows[:, None, :])
        return np.asarray(own + T @ self.border @ T.transpose(0, 2, 1))

    def pose(self, photograph: int) -> FloatArray:
        """Return the covariance (6, 6) of a pose's tangent (ω in rad, v in m, camera frame)."""
        return self.joint(np.array([photograph]))[:6, :6]

    def offset(self, flight: int) -> FloatArray:
        """Return the covariance (3, 3) of a flight's GNSS offset in the world, m²."""
        column = self.layout.offset_column + 3 * flight
        return self.border[column : column + 3, column : column + 3]

    def common(self, error: int) -> FloatArray:
        """Return the covariance (d, d) of a common error that is no GNSS offset."""
        columns = self.layout.columns_of_common(error)
        return np.asarray(self.border[np.ix_(columns, columns)])

    def rig(self, rig: int) -> FloatArray:
        """Return the covariance (6, 6) of the relative pose of a rig: of its rotation, rad, and its offset, m."""
        columns = self.layout.columns_of_rig(rig)
        return np.asarray(self.border[np.ix_(columns, columns)])

    def calibration(self, camera: int) -> FloatArray:
        """Return the covariance (12, 12) of a camera's parameters, zero where they are fixed."""
        return self.lens(camera)[:PARAMETERS, :PARAMETERS]

    def lens(self, camera: int) -> FloatArray:
        """Return the covariance (12 + K, 12 + K) of a camera's parameters and the coefficients of its lens field, zero
        where they are fixed."""
        owner, parameter = self.layout.free_parameters
        columns = np.flatnonzero(owner == camera)
        unit, free = self.layout.border_unit[columns], parameter[columns]
        covariance = np.zeros((self.layout.unit.shape[1],) * 2)
        covariance[np.ix_(free, free)] = self.border[np.ix_(columns, columns)] * np.outer(unit, unit)
        return covariance

    def joint(self, photographs: IntArray) -> FloatArray:
        """Return the joint covariance (6 k + border) of k poses, in the order given, and the border.

        The border holds the calibrations' free parameters, in their natural units, as ``layout.free_parameters`` has
        them, then the GNSS offsets, the other common errors and the control points of the border. Photographs farther
        apart than the band cost a solution of the system.
        """
        layout, place = self.layout, self.layout.place[photographs]
        rows = (6 * place[:, None] + np.arange(6)).ravel()
        if layout.dense or np.ptp(place) <= layout.reach:
            own = self._inverse(rows[:, None], rows[None, :])
        else:
            right = np.zeros((layout.columns, len(rows)))
            right[rows, np.arange(len(rows))] = 1.0 / self.scale[rows]
            own = self.factor.solve_poses(right)[rows] / self.scale[rows][:, None]
        T, unit = self.T[rows], layout.border_unit
        cross = -T @ self.border
        return np.block(
            [[own - cross @ T.T, cross * unit], [(cross * unit).T, self.border * np.outer(unit, unit)]]
        )  # fmt: skip

    def between(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return firstᵀ S⁻¹ second of columns (6 free + border, k) in the order of the reduced system S."""
        return np.asarray(first.T @ self.solve(second))

    def solve(self, columns: FloatArray) -> FloatArray:
        """Return S⁻¹ times columns (6 free + border, k) in the order of the reduced system S.

        Its bits do not depend on the number of cores.
        """
        with limited_threads(0):
            return self.factor.solve_scaled(columns, self.scale)

    def _inverse(self, row: IntArray, column: IntArray) -> FloatArray:
        low, high = np.minimum(row, column), np.maximum(row, column)
        return np.asarray(self.inverse[low * self.layout.stride + high])


def _rows(observations: Observations, linear: Linearisation, layout: Layout) -> FloatArray:
    """Return the rows of linearised observations on poses and border (M, 2, 6 free + border)."""
    rows = np.zeros((len(observations), 2, layout.columns + layout.border))
    at = 6 * layout.place[observations.photograph][:, None] + np.arange(6)
    np.put_along_axis(rows, np.repeat(at[:, None], 2, axis=1), linear.pose, axis=2)
    rows[:, :, layout.columns :] = _border_rows(linear, layout)
    return rows


def _border_rows(linear: Linearisation, layout: Layout) -> FloatArray:
    """Return the rows of linearised observations on the border (M, 2, border)."""
    owner, parameter = layout.free_parameters
    rows = np.zeros((len(linear.camera), 2, layout.border))
    for c in np.unique(linear.camera).tolist():
        own, columns = np.flatnonzero(linear.camera == c), np.flatnonzero(owner == c)
        free = linear.calibration[np.ix_(own, np.arange(2), parameter[columns])] * layout.border_unit[columns]
        rows[np.ix_(own, np.arange(2), columns)] = free
    return rows


def point_columns(
    observations: Observations, linear: Linearisation, normal: FloatArray, layout: Layout, number: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what few points, observed or surveyed, have to do with the cameras: the rows of their linearised
    observations on poses and border (M, 2, 6 free + border), V⁻¹ (K, 3, 3) of their ``normal`` matrices V, and W V⁻¹
    (6 free + border, K, 3).

    ``number`` (K,) are the points' numbers as control points, −1 for others. A point of the border moves with its own
    columns, δX = −(W V⁻¹)ᵀ δ as the others do, and by nothing else: its V⁻¹ is zero.
    """
    place = np.searchsorted(layout.coupled, number)
    kept = np.isin(number, layout.coupled)
    rows = _rows(observations, linear, layout)
    W = np.zeros((len(normal), rows.shape[2], 3))
    np.add.at(W, observations.point, np.einsum("nrc,nri->nci", rows, linear.point))
    inverse = np.zeros_like(normal)
    inverse[~kept] = np.linalg.inv(normal[~kept])
    turned = np.einsum("gci,gij->cgj", W, inverse)
    at = layout.columns + layout.ground_column + 3 * place[kept][:, None] + np.arange(3)
    turned[at, np.flatnonzero(kept)[:, None], np.arange(3)] = -1.0
    return rows, inverse, turned


def joint_points(covariances: Covariances, inverse: FloatArray, turned: FloatArray) -> FloatArray:
    """Return the joint covariance (3 K, 3 K) of points in the world, m², from V⁻¹ and W V⁻¹ of ``point_columns``.

    With a point's own normal matrix V and W towards cameras, two points a and b have the covariance
    δ V_a⁻¹ + V_a⁻¹ W_aᵀ S⁻¹ W_b V_b⁻¹ (Förstner & Wrobel 2016, sec. 15.4), whether they took part or not.
    """
    columns = turned.reshape(len(turned), -1)
    joint = covariances.between(columns, columns)
    own = np.arange(columns.shape[1]).reshape(-1, 3)
    joint[own[:, :, None], own[:, None, :]] += inverse
    return joint


def _control_columns(
    problem: Problem, state: State, covariances: Covariances
) -> tuple[Linearisation, FloatArray, FloatArray, FloatArray]:
    """Return the linearised marks, their rows on poses and border (M, 2, 6 free + border), the inverse normal matrices
    V⁻¹ (G, 3, 3) of the control points, from their marks and their survey, and W V⁻¹ (6 free + border, G, 3).

    Of a mark of the border's points, its row on the point's own columns is what −B W V⁻¹ adds.
    """
    marks = problem.marks
    linear = linearise(marks, state.cameras, state.control)
    V = GroundTerms(problem, covariances.layout).linearise(state).control
    np.add.at(V, marks.point, np.einsum("nri,nrj->nij", linear.point, linear.point))
    return linear, *point_columns(marks, linear, V, covariances.layout, np.arange(len(V)))


def mark_covariances(problem: Problem, state: State, covariances: Covariances) -> FloatArray:
    """Return the covariances (M, 2, 2) of the adjusted marks of control points, in units of their stated variances."""
    linear, rows, inverse, turned = _control_columns(problem, state, covariances)
    return _projected(problem.marks.point, linear, rows, inverse, turned, covariances)


def predicted_marks(
    problem: Problem, state: State, covariances: Covariances, photograph: IntArray, point: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return where photographs (M,) show control points (M,), px (M, 2), NaN behind a camera, and the covariances (M,
    2, 2), px², of these places: what the block as it is adjusted says of a mark that nobody has made."""
    _, _, inverse, turned = _control_columns(problem, state, covariances)
    pixel, covariance = np.empty((len(point), 2)), np.empty((len(point), 2, 2))
    in_poses = np.any(turned[: covariances.layout.columns], axis=(0, 2))[point]
    numbers = np.flatnonzero(in_poses)
    several = [numbers[k : k + MARKS_AT_ONCE] for k in range(0, len(numbers), MARKS_AT_ONCE)]
    for part in (*several, np.flatnonzero(~in_poses)):
        asked = predicted(photograph[part], point[part], state.cameras, state.control)
        linear = linearise(asked, state.cameras, state.control)
        pixel[part] = asked.pixel
        if in_poses[part].any():
            rows = _rows(asked, linear, covariances.layout)
            covariance[part] = _projected(point[part], linear, rows, inverse, turned, covariances)
        else:
            covariance[part] = _projected_by_one(asked, linear, inverse, turned, covariances)
    return pixel, covariance


def _projected_by_one(
    asked: Observations, linear: Linearisation, inverse: FloatArray, turned: FloatArray, covariances: Covariances
) -> FloatArray:
    """Return what ``_projected`` does of points that no photograph has marked: each of their images depends on one
    pose and the border."""
    layout = covariances.layout
    i = asked.photograph
    g = asked.point
    A = linear.pose
    B = _border_rows(linear, layout) - linear.point @ turned[layout.columns :, g].transpose(1, 2, 0)
    T = covariances.T[6 * layout.place[i][:, None] + np.arange(6)]
    cross = A @ -T @ covariances.border @ B.transpose(0, 2, 1)
    own = linear.point @ inverse[g] @ linear.point.transpose(0, 2, 1)
    own += A @ covariances.poses[i] @ A.transpose(0, 2, 1) + B @ covariances.border @ B.transpose(0, 2, 1)
    return np.asarray(own + cross + cross.transpose(0, 2, 1))


@dataclass(frozen=True, eq=False)
class JointMarks:
    """Where photographs show control points, predicted together (M)."""

    pixel: FloatArray
    """Places (M, 2), px, NaN behind a camera."""
    covariance: FloatArray
    """Their joint covariance (2 M, 2 M), px²: u and v of the first, of the second, …"""
    by_point: FloatArray
    """Derivatives (M, 2, 3) of the places by their points, px/m."""


def joint_marks(
    problem: Problem, state: State, covariances: Covariances, photograph: IntArray, point: IntArray
) -> JointMarks:
    """Return what ``predicted_marks`` does, with the covariances of all places with each other.

    Two images have U₁ S⁻¹ U₂ᵀ, and those of one point B₁ V⁻¹ B₂ᵀ beside, with U = A − B V⁻¹ Wᵀ.
    """
    asked = predicted(photograph, point, state.cameras, state.control)
    linear = linearise(asked, state.cameras, state.control)
    _, _, inverse, turned = _control_columns(problem, state, covariances)
    U = _rows(asked, linear, covariances.layout) - np.einsum("nri,cni->nrc", linear.point, turned[:, point])
    columns = U.reshape(-1, U.shape[2]).T
    joint = covariances.between(columns, columns)
    for g in np.unique(point).tolist():
        own = np.flatnonzero(point == g)
        B = linear.point[own].reshape(-1, 3)
        at = (2 * own[:, None] + np.arange(2)).ravel()
        joint[np.ix_(at, at)] += B @ inverse[g] @ B.T
    return JointMarks(asked.pixel, joint, linear.point)


def _projected(
    point: IntArray, linear: Linearisation, rows: FloatArray, inverse: FloatArray, turned: FloatArray,
    covariances: Covariances,
) -> FloatArray:  # fmt: skip
    """Return the covariances (M, 2, 2) of the images of control points, linearised.

    An image with the Jacobians A on the cameras and B on its point has B V⁻¹ Bᵀ + U S⁻¹ Uᵀ, U = A − B V⁻¹ Wᵀ.
    """
    U = rows - np.einsum("nri,cni->nrc", linear.point, turned[:, point])
    columns = U.reshape(-1, U.shape[2]).T
    solved = covariances.solve(columns).T.reshape(U.shape)
    own = linear.point @ inverse[point] @ linear.point.transpose(0, 2, 1)
    return np.asarray(own + np.einsum("nrc,nsc->nrs", U, solved))


def _weakest_direction(factor: Factor) -> tuple[float, FloatArray]:
    """Return the smallest eigenvalue of a factored system, and its eigenvector."""
    m = factor.layout.columns
    size = m + factor.layout.border

    def solve(right: FloatArray) -> FloatArray:
        poses, border = factor.solve(np.ravel(right)[:m], np.ravel(right)[m:])
        return np.concatenate([poses, border])

    inverse = LinearOperator((size, size), matvec=solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(size)
    value, vector = eigsh(inverse, k=1, which="LM", v0=start, tol=1e-3)
    return 1.0 / float(value[0]), np.asarray(vector[:, 0])


def _undetermined(normal: NormalEquations, scale: FloatArray, whole: Datum) -> IndeterminateError:
    """Return the error that names the variable that moves most along a direction that nothing holds, or the datum."""
    layout = normal.layout
    try:
        _, direction = _weakest_direction(normal.factor(scale=scale, shift=RANK_SHIFT))
    except SingularError as error:
        return IndeterminateError(variable_at(layout, error.column))
    return _open(layout, direction, scale, whole)


def _open(layout: Layout, direction: FloatArray, scale: FloatArray, whole: Datum) -> IndeterminateError:
    """Return the error that names what moves along a ``direction`` of the system whose rows were divided by
    ``scale``."""
    change = direction / scale
    cameras = direction[: layout.columns + layout.ground_column]
    moving = float(np.sum(cameras**2))
    in_border = float(np.sum(cameras[layout.columns :] ** 2)) / max(moving, 1e-300)
    # where a point alone moves, what the cameras do is rounding
    together = moving > STILL * float(np.sum(direction**2)) and in_border < 1.0 - WHOLE
    if layout.free > 1 and together and whole.share(change) > WHOLE:
        return IndeterminateError((DATUM, whole.main_part(change)))
    return IndeterminateError(_weakest(layout, direction))


def _weakest(layout: Layout, direction: FloatArray) -> tuple[str, int]:
    weight: dict[tuple[str, int], float] = {}
    for column, square in enumerate((direction**2).tolist()):
        variable = variable_at(layout, column)
        weight[variable] = weight.get(variable, 0.0) + square
    return max(weight, key=lambda variable: weight[variable])


def _checked_factor(normal: NormalEquations, scale: FloatArray, whole: Datum) -> Factor:
    """Factor the normalised system. Raises IndeterminateError where it is singular to working precision."""
    try:
        factor = normal.factor(scale=scale)
    except SingularError as error:
        raise _undetermined(normal, scale, whole) from error
    smallest, direction = _weakest_direction(factor)
    if not smallest > RANK_TOLERANCE:
        raise _open(normal.layout, direction, scale, whole)
    return factor


def _check_attitudes(covariances: Covariances, whole: Datum, block: Block) -> None:
    """Raise IndeterminateError where an attitude may be any, naming the block that turns or the photograph; but for the
    heading of a block that is placed roughly, and said to be open."""
    rough = rough_place(block)
    heading_rad = HEADING_SIGMA_RAD if rough is not None and rough.open_heading else 0.0
    limit = MEANINGLESS_SIGMA_RAD**2 + heading_rad**2
    variance = np.einsum("naa->na", covariances.poses)[:, :3].max(axis=1, initial=0.0)
    if not np.any(variance > limit):
        return
    worst = int(np.argmax(variance))
    turn = covariances.between(whole.fit, whole.fit)[3:6, 3:6]
    if covariances.layout.free > 1 and float(np.linalg.eigvalsh(turn)[-1]) > 0.5 * limit:
        steady = weights_of(covariances.poses, whole.distance_m)
        again = datum_of(covariances.layout, whole.state, whole.distance_m, steady)
        turn = covariances.between(again.fit, again.fit)[3:6, 3:6]
        if float(np.linalg.eigvalsh(turn)[-1]) > 0.5 * limit:
            raise IndeterminateError((DATUM, TURN))
    raise IndeterminateError((POSE, worst))


def covariances(problem: Problem, state: State) -> Covariances:
    """Compute the covariances of all variables at ``state``.

    What is weak has large sigmas. Raises IndeterminateError naming the variable that nothing holds when the normal
    equations are singular to working precision, or an attitude may be any: the datum where the whole block is shifted,
    turned or scaled, such as a strip which may turn about its own axis.
    """
    bundle = bundle_of(problem, state)
    bundle = replace(bundle, loss=bundle.loss.weights_alone())
    layout, m = bundle.layout, bundle.layout.columns
    with limited_threads(len(bundle.tie)) as pool:
        terms = bundle.ground.linearise(state)
        normal = eliminated(bundle, state, terms, pool)
        scale = np.sqrt(np.maximum(normal.diagonal(), 1e-300))
        whole = datum_of(layout, state, reach_m(problem, state))
        factor = _checked_factor(normal, scale, whole)
        inverse = factor.inverse_within_band()
        scale_matrix(inverse, scale, layout)
        T = factor.T * scale[m:] / scale[:m, None]
        border = factor.border_covariance() / np.outer(scale[m:], scale[m:])
        of_cameras = Covariances(layout, factor, scale, inverse, T, border, np.zeros((0, 3, 3)), np.zeros((0, 3, 3)))
        _check_attitudes(of_cameras, whole, problem.block)
        cameras, blocks = state.cameras, (inverse, T, border)
        ties, controls = Points.unknown(state.tie_point), Points(state.control, terms.control_prior)
        tie, lost = point_covariances(bundle.tie, cameras, ties, layout, bundle.loss, blocks, pool)
        control, missing = point_covariances(bundle.marks, cameras, controls, layout, NO_LOSS, blocks)
        rows = layout.ground_column + 3 * np.arange(len(layout.coupled))[:, None] + np.arange(3)
        control[layout.coupled] = border[rows[:, :, None], rows[:, None, :]]
    if lost >= 0 or missing >= 0:
        raise IndeterminateError((TIE_POINT, lost) if lost >= 0 else (CONTROL_POINT, missing))
    return Covariances(layout, factor, scale, inverse, T, border, tie, control)
