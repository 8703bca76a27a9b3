"""What the tie points of a block say, in one quadratic form: whatever else is measured can change without their rays.

At exterior orientations and calibrations x₀ the tie points are eliminated from their normal equations. What is left,
the reduced matrix S with the right-hand side b and the cost c₀, is all that hundreds of thousands of rays say near x₀:

    c(x) ≈ c₀ − bᵀδ + ½ δᵀS δ

Tie points know no datum. Hence δ is what remains of x − x₀ once the similarity between both sets of projection centres
is taken off: with the rotation R, the scale s and the shift t of it, x has the orientations R R₀ Exp(ω) and the centres
s R (C₀ + R₀ v) + t, and (ω, v) are its δ. A block that is shifted, turned or scaled as a whole keeps its cost exactly.
S has these seven directions as its null space, so that at δ = 0 the derivative by the similarity vanishes; elsewhere it
is of the order of δ, and is left out of the gradient.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray, IntArray
from photogram.factors.elimination.bundle import limited_threads
from photogram.factors.elimination.loss import Loss
from photogram.factors.elimination.points import (
    Points,
    Rays,
    eliminate,
    first_observations,
    lay_out,
    observation_cost,
    substitute,
)
from photogram.factors.elimination.reduced import Layout, NormalEquations, Terms, make_layout
from photogram.factors.elimination.reprojection import Observations
from photogram.projection import OrientedCameras

SETTLING = 2
"""Gauss–Newton steps of the tie points, their cameras at rest, after these have moved."""


@dataclass(frozen=True, eq=False)
class TiePointSummary:
    """The tie points of a block at ``cameras``, x₀.

    ``own`` (N, 6, 6) blocks of S of the photographs, ``pair`` (B, 2) two photographs with tie points in common and
    ``between`` (B, 6, 6) their block of S, the first's rows and the second's columns; ``calibration`` (P, P) of all
    parameters of all cameras, camera by camera in their own units, and ``mixed`` (6 N, P); ``right`` (6 N,) and
    ``right_calibration`` (P,) are b, ``cost`` is c₀. ``observations`` and ``points`` were eliminated, at the median
    distance ``reach_m`` from the photographs.
    """

    cameras: OrientedCameras
    own: FloatArray
    pair: IntArray
    between: FloatArray
    calibration: FloatArray
    mixed: FloatArray
    right: FloatArray
    right_calibration: FloatArray
    cost: float
    observations: int
    points: int
    reach_m: float

    @cached_property
    def poses(self) -> csr_array:
        """Return the part (6 N, 6 N) of S that belongs to the poses."""
        own = np.arange(len(self.own))
        first = np.concatenate([own, self.pair[:, 0], self.pair[:, 1]])
        second = np.concatenate([own, self.pair[:, 1], self.pair[:, 0]])
        blocks = np.concatenate([self.own, self.between, self.between.transpose(0, 2, 1)])
        six = np.arange(6)
        rows = np.broadcast_to(6 * first[:, None, None] + six[:, None], blocks.shape)
        columns = np.broadcast_to(6 * second[:, None, None] + six, blocks.shape)
        size = 6 * len(own)
        return csr_array(coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)))

    def _left(self, of_poses: FloatArray, of_calibration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return S δ of the poses (6 N,) and of the calibrations (P,)."""
        poses = self.poses @ of_poses + self.mixed @ of_calibration
        return np.asarray(poses), np.asarray(self.mixed.T @ of_poses + self.calibration @ of_calibration)

    def departure(self, cameras: OrientedCameras) -> Departure:
        """Return δ of other orientations and calibrations of the same photographs."""
        scale, turn, shift = _similarity(self.cameras, cameras)
        into = self.cameras.rotation.transpose(0, 2, 1)
        rotation = into @ turn.T @ cameras.rotation
        position = (cameras.position - shift) @ turn / scale - self.cameras.position
        omega = Rotation.from_matrix(rotation).as_rotvec()
        v = np.einsum("nij,nj->ni", into, position)
        return Departure(
            np.concatenate([omega, v], axis=1).ravel(),
            (cameras.parameters - self.cameras.parameters).ravel(),
            _steps(omega, rotation, scale),
        )

    def cost_at(self, cameras: OrientedCameras) -> float:
        """Return half the sum of squared whitened residuals of the tie points, as the quadratic form has it."""
        off = self.departure(cameras)
        poses, calibration = self._left(off.poses, off.calibration)
        return self.cost + float(
            (0.5 * poses - self.right) @ off.poses + (0.5 * calibration - self.right_calibration) @ off.calibration
        )

    def terms(self, cameras: OrientedCameras, layout: Layout, controls: int) -> Terms:
        """Return the information in steps from ``cameras`` for a layout of the reduced system whose photographs are all
        free, with so many control points, which it says nothing of. Raises ValueError where the layout has no place for
        two photographs with tie points in common, or has parameters of lens fields that were not eliminated."""
        count = self.cameras.parameters.shape[1]
        if layout.unit.shape[1] > count:
            raise ValueError("the lens fields of the layout were no unknowns when the tie points were summarised")
        off, result = self.departure(cameras), Terms.zero(layout, controls)
        poses, calibration = self._left(off.poses, off.calibration)
        steps, at = off.steps, layout.photograph_at
        turned = steps.transpose(0, 2, 1)
        camera, parameter = layout.free_parameters
        columns, unit = count * camera + parameter, layout.unit[camera, parameter]
        border = len(columns)
        result.pose[...] = (turned @ self.own @ steps)[at]
        right = np.einsum("nji,nj->ni", steps, (self.right - poses).reshape(-1, 6))
        result.pose_gradient[...] = right[at].ravel()
        mixed = turned @ self.mixed.reshape(len(steps), 6, -1)[:, :, columns] * unit
        result.pose_border[:, :border] = mixed[at].reshape(6 * len(at), border)
        result.border[:border, :border] = self.calibration[np.ix_(columns, columns)] * np.outer(unit, unit)
        result.border_gradient[:border] = (self.right_calibration - calibration)[columns] * unit
        between, values = self._between(layout, steps)
        return Terms(
            self.cost_at(cameras), result.pose, result.pose_border, result.pose_gradient, result.border,
            result.border_gradient, result.control, result.control_gradient, between, values,
        )  # fmt: skip

    def _between(self, layout: Layout, steps: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return rows and columns (36 B, 2) below the diagonal blocks of the layout's poses, and their values."""
        place = layout.place[self.pair]
        swapped = place[:, 0] < place[:, 1]
        later, earlier = place.max(axis=1, initial=-1), place.min(axis=1, initial=len(layout.place))
        if len(place) and int((later - earlier).max()) > layout.reach:
            raise ValueError("two photographs with tie points in common are farther apart than the layout reaches")
        blocks = steps[self.pair[:, 0]].transpose(0, 2, 1) @ self.between @ steps[self.pair[:, 1]]
        blocks = np.where(swapped[:, None, None], blocks.transpose(0, 2, 1), blocks)
        six = np.arange(6)
        rows = np.broadcast_to(6 * later[:, None, None] + six[:, None], blocks.shape)
        columns = np.broadcast_to(6 * earlier[:, None, None] + six, blocks.shape)
        return np.column_stack([rows.ravel(), columns.ravel()]), blocks.ravel()


@dataclass(frozen=True, eq=False)
class Departure:
    """δ of ``poses`` (6 N,), (ω, v) in the cameras' own axes and in the lengths of x₀, and of the ``calibration`` (P,);
    ``steps`` (N, 6, 6) are its derivatives by steps of the poses."""

    poses: FloatArray
    calibration: FloatArray
    steps: FloatArray


def _similarity(before: OrientedCameras, after: OrientedCameras) -> tuple[float, FloatArray, FloatArray]:
    """Return scale, rotation (3, 3) and shift (3,) that take the projection centres ``before`` to those ``after``.

    The rotation is that of the centres and of the attitudes together, which the mean square distance of the centres
    makes comparable (orthogonal Procrustes; Umeyama 1991, eq. 40–43): centres in one line leave nothing open.
    """
    a, b = before.position.mean(axis=0), after.position.mean(axis=0)
    p, q = before.position - a, after.position - b
    size, other = float(np.mean(np.sum(p**2, axis=1))), float(np.mean(np.sum(q**2, axis=1)))
    of_attitudes = np.mean(after.rotation @ before.rotation.transpose(0, 2, 1), axis=0)
    U, _, Vt = np.linalg.svd(q.T @ p / len(p) + np.sqrt(size * other) * of_attitudes if size > 0.0 else of_attitudes)
    turn = (U * [1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    scale = float(np.sum((p @ turn.T) * q)) / (len(p) * size) if size > 0.0 else 1.0
    scale = scale if scale > 0.0 else 1.0
    return scale, turn, b - scale * turn @ a


def _steps(omega: FloatArray, rotation: FloatArray, scale: float) -> FloatArray:
    """Return the derivatives (N, 6, 6) of (ω, v) by a step R Exp(ω'), C + R v': the inverse right Jacobian of the
    rotation (Chirikjian 2012, eq. 10.86) and the rotation over the scale."""
    angle = np.linalg.norm(omega, axis=1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe)))
    W = np.zeros((len(omega), 3, 3))
    W[:, 0, 1], W[:, 0, 2], W[:, 1, 2] = -omega[:, 2], omega[:, 1], -omega[:, 0]
    W -= W.transpose(0, 2, 1)
    steps = np.zeros((len(omega), 6, 6))
    steps[:, :3, :3] = np.eye(3) + 0.5 * W + factor[:, None, None] * (W @ W)
    steps[:, 3:, 3:] = rotation / scale
    return steps


def _laid_out(tie: Observations, cameras: OrientedCameras, points: int) -> tuple[Layout, Rays]:
    """Return the layout in which all photographs and all parameters of their cameras are free, and the observations of
    so many points in it."""
    index = np.flatnonzero(np.bincount(tie.point, minlength=points))
    first = first_observations(np.searchsorted(index, tie.point), len(index))
    fixed = np.zeros(len(cameras.position), dtype=bool)
    unit = np.ones_like(cameras.parameters)
    layout = make_layout([(first, tie.photograph)], fixed, cameras.position, unit)
    return layout, lay_out(tie, index, layout)


def summarise(tie: Observations, cameras: OrientedCameras, tie_point: FloatArray, loss: Loss) -> TiePointSummary:
    """Return the summary of observations of points ``tie_point`` (P, 3), m, at ``cameras``, whose velocities are used
    for the derivatives by read-out times; points without an observation may be NaN. The loss counts by its weights.

    Raises ValueError naming a point whose rays are parallel.
    """
    layout, rays = _laid_out(tie, cameras, len(tie_point))
    normal = NormalEquations.zero(layout)
    with limited_threads(len(tie)) as pool:
        lost = eliminate(rays, cameras, Points.unknown(tie_point), normal, loss.weights_alone(), 0.0, pool)
    if lost >= 0:
        raise ValueError(f"tie point {lost} cannot be intersected: its rays are parallel")
    at, place = layout.photograph_at, layout.place
    number = layout.block_at
    U = np.tril(normal.U.transpose(0, 2, 1))  # the lower half, rows first
    seen_twice = normal.A[number[:, 0]].reshape(-1, 6, 6).transpose(0, 2, 1)
    lower = U + np.tril(seen_twice)
    own = lower + np.tril(lower, -1).transpose(0, 2, 1)
    earlier, after = np.nonzero(number[:, 1:] >= 0)
    pair = np.column_stack([at[earlier + after + 1], at[earlier]])
    between = normal.A[number[earlier, after + 1]].reshape(-1, 6, 6).transpose(0, 2, 1)
    of_photograph = (6 * place[:, None] + np.arange(6)).ravel()
    sample = np.linspace(0, max(len(tie) - 1, 0), min(len(tie), 1000)).astype(np.int64)
    distance = np.linalg.norm(tie_point[tie.point[sample]] - cameras.position[tie.photograph[sample]], axis=1)
    return TiePointSummary(
        cameras, own[place], pair, between, normal.E, normal.B[of_photograph], normal.g[of_photograph], normal.h,
        observation_cost(rays, cameras, tie_point, loss), len(tie), len(rays.index),
        float(np.median(distance)) if len(distance) else 1.0,
    )  # fmt: skip


def followed(
    summary: TiePointSummary, tie: Observations, tie_point: FloatArray, cameras: OrientedCameras, loss: Loss
) -> FloatArray:
    """Return the points ``tie_point`` (P, 3), m, that were summarised, where other orientations and calibrations of the
    photographs have them: taken along by the similarity, moved by their part of the step that remains, and settled."""
    before = summary.cameras
    scale, turn, shift = _similarity(before, cameras)
    carried = before._replace(rotation=turn @ before.rotation, position=scale * before.position @ turn.T + shift)
    into = carried.rotation.transpose(0, 2, 1)
    omega = Rotation.from_matrix(into @ cameras.rotation).as_rotvec()
    v = np.einsum("nij,nj->ni", into, cameras.position - carried.position)
    layout, rays = _laid_out(tie, cameras, len(tie_point))
    poses = np.concatenate([omega, v], axis=1)[layout.photograph_at].ravel()
    step = poses, (cameras.parameters - before.parameters).ravel()
    points, still = scale * tie_point @ turn.T + shift, np.zeros((4, 3))
    with limited_threads(len(tie)) as pool:
        points, _, _ = substitute(rays, carried, Points.unknown(points), layout, loss, 0.0, step, cameras, still, pool)
        nothing = np.zeros_like(step[0]), np.zeros_like(step[1])
        for _ in range(SETTLING):
            points, _, _ = substitute(
                rays, cameras, Points.unknown(points), layout, loss, 0.0, nothing, cameras, still, pool
            )
    return points
