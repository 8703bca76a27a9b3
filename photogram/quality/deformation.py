"""How a block may be deformed as a whole: its mean height, tilt and dome, jointly with calibration and GNSS offsets.

Nadir photographs from one height see a wrong focal length as another flying height and a wrong radial distortion as a
dome (Wackrow & Chandler 2011; James & Robson 2014). What holds against that is in the covariance: each such mode is a
linear function of all tie points, see photogram.factors.functionals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.factors.elimination.reprojection import linearise
from photogram.factors.elimination.state import State
from photogram.factors.functionals import (
    Functions,
    Solvable,
    functions_of_attitudes,
    functions_of_border,
    functions_of_positions,
    functions_of_tie_points,
    joined,
)
from photogram.factors.graph import Problem
from photogram.projection import PARAMETERS
from photogram.results import Deformation

FEWEST_POINTS, MOST_POINTS = 10, 20_000
BADLY = 3.0  # times the median sigma in height, beyond which rays too nearly parallel would speak for the whole block
TOGETHER = 64  # places whose three columns each are solved for at once
CELLS, PLACES = 24, 7  # of the grids over a block, for the tie points that stand for it and for those looked at singly
EDGE = 95.0  # percentile of the distances of tie points from the centre that is taken as the block's radius
MIDDLE = 0.15  # of the radius, within which the point in the middle is sought
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GROUND, SLOPES, DOME, CENTRES, MODES = slice(0, 3), slice(3, 5), 5, slice(6, 9), 9


def rotations_of(camera: int) -> slice:
    """Return where the mean rotations of a camera's photographs stand in Deformation.covariance."""
    return slice(MODES + 2 * camera, MODES + 2 * camera + 2)


def parameters_of(camera: int, cameras: int) -> slice:
    """Return where the parameters of a camera stand in Deformation.covariance, of so many cameras."""
    start = MODES + 2 * cameras + PARAMETERS * camera
    return slice(start, start + PARAMETERS)


def offset_of(flight: int, cameras: int) -> slice:
    """Return where the GNSS offset of a flight stands in Deformation.covariance, with so many cameras."""
    start = MODES + (2 + PARAMETERS) * cameras + 3 * flight
    return slice(start, start + 3)


def cells_of(xy: FloatArray, cells: int) -> IntArray:
    """Return in which cell each of the points (P, 2) lies, of a grid of ``cells`` × ``cells`` over them."""
    low, extent = xy.min(axis=0), np.maximum(np.ptp(xy, axis=0), 1e-9)
    row, column = np.minimum((xy - low) / extent * cells, cells - 1).astype(np.int64).T
    return np.asarray(row * cells + column)


def spread_points(xy: FloatArray, cells: int) -> IntArray:
    """Return the first of the points (P, 2) in each cell of a grid of ``cells`` × ``cells``, sorted."""
    return np.sort(np.unique(cells_of(xy, cells), return_index=True)[1]).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Places:
    """The tie points that stand for a block: ``points`` (P,) their numbers, sorted; of those ``looked_at`` (Q,) singly,
    the one in the ``middle`` and those in the ``corners`` (at most 4,), all as indices into ``points``."""

    centre_world_m: FloatArray
    radius_m: float
    points: IntArray
    looked_at: IntArray
    middle: int
    corners: IntArray


def firm_points(problem: Problem, state: State, points: IntArray, most: int = MOST_POINTS) -> IntArray:
    """Return ``most`` of tie points (P,), numbers sorted, at most, spread over their order, without those whose rays
    are too nearly parallel."""
    some = points[np.unique(np.linspace(0, max(len(points) - 1, 0), min(len(points), most)).astype(np.int64))]
    sigma = _intersection_sigmas_m(problem, state, some)[:, 2]
    return some[sigma <= BADLY * np.median(sigma)] if len(some) else some


def places_of(problem: Problem, state: State) -> Places | None:
    """Choose the tie points that stand for a block, None where there are fewer than FEWEST_POINTS."""
    rays = np.bincount(problem.tie.point, minlength=len(state.tie_point))
    seen = firm_points(problem, state, np.flatnonzero((rays >= 2) & np.isfinite(state.tie_point).all(axis=1)))
    if len(seen) < FEWEST_POINTS:
        return None
    xy = state.tie_point[seen, :2]
    centre = np.median(xy, axis=0)
    distance = np.linalg.norm(xy - centre, axis=1)
    radius = float(np.percentile(distance, EDGE))
    near = np.flatnonzero(distance <= max(MIDDLE * radius, float(distance.min())))
    middle = seen[near[np.argmax(rays[seen[near]])]]
    within = xy[distance <= radius]
    low, high = within.min(axis=0), within.max(axis=0)
    targets = 0.5 * (low + high) + 0.4 * CORNERS * (high - low)
    corners = np.unique([seen[np.argmin(np.linalg.norm(xy - target, axis=1))] for target in targets])
    looked_at, standing = seen[spread_points(xy, PLACES)], seen[spread_points(xy, CELLS)]
    points = np.unique(np.concatenate([standing, looked_at, [middle], corners])).astype(np.int64)
    return Places(
        centre, radius, points, np.searchsorted(points, looked_at).astype(np.int64),
        int(np.searchsorted(points, middle)), np.searchsorted(points, corners).astype(np.int64),
    )  # fmt: skip


def height_shapes(xy: FloatArray, centre: FloatArray, radius_m: float, standing: FloatArray) -> FloatArray:
    """Return at places (P, 2) the shapes (P, 4) of a block's errors in height: mean, slopes east and north and the
    dome, each 1 m at the radius; slopes and dome have no mean over the places ``standing`` (S, 2)."""
    offset, middle = (xy - centre) / radius_m, (standing - centre) / radius_m
    square, mean = np.sum(offset**2, axis=1), np.mean(np.sum(middle**2, axis=1))
    return np.asarray(np.column_stack([np.ones(len(xy)), offset - middle.mean(axis=0), square - mean]))


def height_modes(xy: FloatArray, centre: FloatArray, radius_m: float) -> FloatArray:
    """Return the weights (4, P) that fit mean, slopes east and north and the dome, each in m at the radius, to height
    errors at places (P, 2) by least squares."""
    return np.asarray(np.linalg.pinv(height_shapes(xy, centre, radius_m, xy)))


def _ground_weights(state: State, places: Places) -> FloatArray:
    """Return the weights (P, 3, 6 + 3 (1 + corners) + Q) of the modes, of middle and corners, and of single heights."""
    xy = state.tie_point[places.points, :2]
    fixed = np.array([places.middle, *places.corners])
    a = np.zeros((len(xy), 3, 6 + 3 * len(fixed) + len(places.looked_at)))
    a[:, range(3), range(3)] = 1.0 / len(xy)
    a[:, 2, 3:6] = height_modes(xy, places.centre_world_m, places.radius_m)[1:].T
    for n, point in enumerate(fixed.tolist()):
        a[point, range(3), range(6 + 3 * n, 9 + 3 * n)] = 1.0
    a[places.looked_at, 2, np.arange(6 + 3 * len(fixed), a.shape[2])] = 1.0
    return a


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Joint covariances of a block as a whole: ``modes`` as in Deformation.covariance; ``ground`` (6 + 3 (1 + corners)
    + Q,) squared, of the modes of the ground, the points in middle and corners, and the heights looked at, as far as
    it comes from the cameras; ``own`` (3 (1 + corners),) squared, what the points in middle and corners scatter by
    themselves."""

    modes: FloatArray
    ground: FloatArray
    own: FloatArray

    def surveyed(self, points: int, sigma_m: FloatArray) -> Stiffness:
        """Return the same with the first ``points`` of middle and corners surveyed with ``sigma_m`` (3,); modes beside
        the ground stay as they were."""
        C = self.ground
        where = slice(6, 6 + 3 * points)
        own = slice(0, 3 * points)
        noise = self.own[own, own] + np.diag(np.tile(sigma_m**2, points))
        gain = np.linalg.solve(C[where, where] + noise, C[where])
        return Stiffness(self.modes, C - C[:, where] @ gain, self.own)

    @property
    def height_sigma_m(self) -> FloatArray:
        """Return the sigmas in height (Q,) over the block."""
        return np.sqrt(np.diag(self.ground)[6 + len(self.own) :])

    @property
    def _placed(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return variances, covariances with the mean of their axis, and axes of the coordinates that are looked at."""
        count = len(self.own)
        axis = np.concatenate([np.tile(np.arange(3), count // 3), np.full(len(self.ground) - 6 - count, 2)])
        return np.diag(self.ground)[6:], self.ground[np.arange(6, len(self.ground)), axis], axis

    @property
    def absolute_sigma_m(self) -> FloatArray:
        """Return root mean squares (3,) of the sigmas over the block, as far as they come from the cameras: east, north
        (in middle and corners), up (there and at the heights looked at), m."""
        variance, _, axis = self._placed
        return np.sqrt([np.mean(variance[axis == k]) for k in range(3)])

    @property
    def relative_sigma_m(self) -> FloatArray:
        """Return the same (3,) of the differences from the mean shift of the block: its shape, without the datum."""
        variance, with_mean, axis = self._placed
        relative = variance - 2.0 * with_mean + np.diag(self.ground)[axis]
        return np.sqrt([max(float(np.mean(relative[axis == k])), 0.0) for k in range(3)])

    @property
    def summary(self) -> FloatArray:
        """Return sigma in height in the middle, root mean square over the block, sigma of the dome (3,), m."""
        variance = np.diag(self.ground)
        return np.sqrt([variance[8], np.mean(variance[6 + len(self.own) :]), variance[DOME]])


def stiffness(problem: Problem, state: State, solvable: Solvable, places: Places) -> Stiffness:
    """Return the joint covariances of the modes of a block."""
    layout, cameras = solvable.layout, len(problem.block.cameras)
    ground = functions_of_tie_points(problem, state, layout, places.points, _ground_weights(state, places))
    count, singled = ground.columns.shape[1], slice(6, 9 + 3 * len(places.corners))
    camera_of = problem.block.camera_of
    use = (camera_of == np.arange(cameras)[:, None]).astype(np.float64)
    use /= np.maximum(use.sum(axis=1, keepdims=True), 1.0)
    parts: list[Functions] = [
        ground,
        functions_of_positions(state, layout, np.full(len(camera_of), 1 / len(camera_of))),
    ]
    parts += [functions_of_attitudes(layout, weight) for weight in use]
    functions = joined([*parts, functions_of_border(layout)])
    shared = functions.shared(solvable)
    kept = np.concatenate([np.arange(6), np.arange(count, len(shared))])
    modes = (shared + functions.own)[np.ix_(kept, kept)]
    return Stiffness(modes, shared[:count, :count], ground.own[singled, singled])


def _intersection_sigmas_m(problem: Problem, state: State, points: IntArray) -> FloatArray:
    """Return the sigmas (P, 3) of tie points, numbers sorted, with the cameras taken as known: east, north, up."""
    o = problem.tie.select(np.isin(problem.tie.point, points))
    linear = linearise(o, state.cameras, state.tie_point)
    V = np.zeros((len(points), 3, 3))
    np.add.at(V, np.searchsorted(points, o.point), np.einsum("nri,nrj->nij", linear.point, linear.point))
    return np.asarray(np.sqrt(np.einsum("pii->pi", np.linalg.inv(V))))


def intersection_sigma_m(problem: Problem, state: State, places: Places) -> FloatArray:
    """Return the median sigmas (3,) of tie points with the cameras taken as known: east, north, up."""
    return np.asarray(np.median(_intersection_sigmas_m(problem, state, places.points), axis=0))


def deformation(problem: Problem, state: State, stiff: Stiffness, places: Places) -> Deformation:
    """Return how a block may be deformed as a whole, with no remedy tried yet."""
    return Deformation(
        places.centre_world_m,
        places.radius_m,
        stiff.modes,
        intersection_sigma_m(problem, state, places),
        stiff.height_sigma_m,
        given_parameters(problem),
        np.zeros(0, np.str_),
        np.zeros((0, 2, 3)),
        np.zeros((len(problem.block.cameras), PARAMETERS)),
        np.zeros((len(problem.block.cameras), PARAMETERS)),
        np.full(3, np.nan),
        np.full(3, np.nan),
        stiff.absolute_sigma_m,
        stiff.relative_sigma_m,
    )


def shape_covariances(problem: Problem, state: State, solvable: Solvable, places: Places) -> FloatArray:
    """Return what the cameras add to the errors of the places' points relative to the mean error of all of them: their
    covariances (P, 3, 3) in the world, m².

    A point follows the cameras as x = uᵀ δ, the mean as mᵀ δ: (u − m)ᵀ S⁻¹ (u − m). The difference is taken before it
    is solved for, since a datum known to metres and a shape known to millimetres would cancel out afterwards.
    """
    layout = solvable.layout
    points = places.points
    count = len(places.points)
    alike = np.broadcast_to(np.eye(3) / count, (count, 3, 3))
    mean = functions_of_tie_points(problem, state, layout, points, alike).columns
    covariance = np.empty((count, 3, 3))
    for first in range(0, count, TOGETHER):
        some = points[first : first + TOGETHER]
        each = np.zeros((len(some), 3, 3 * len(some)))
        for axis in range(3):
            each[np.arange(len(some)), axis, 3 * np.arange(len(some)) + axis] = 1.0
        columns = functions_of_tie_points(problem, state, layout, some, each).columns - np.tile(mean, len(some))
        u, v = (c.reshape(-1, len(some), 3) for c in (columns, solvable.solve(columns)))
        covariance[first : first + len(some)] = np.einsum("cpi,cpj->pij", u, v)
    return np.asarray(0.5 * (covariance + covariance.transpose(0, 2, 1)))


def component_shifts(problem: Problem, state: State, solvable: Solvable, component: IntArray) -> FloatArray:
    """Return the covariances (C, 3, 3) in the world, m², of the vectors from the mean of the firm tie points of the
    first component to that of each, by its number in ``component`` (N,), that of the photographs: NaN of those without
    such points; empty for a block in one piece."""
    tie = problem.tie
    of_point = np.full(len(state.tie_point), -1)
    of_point[tie.point] = component[tie.photograph]
    pieces = range(int(of_point.max(initial=-1)) + 1)
    if len(pieces) < 2:
        return np.zeros((0, 3, 3))
    most = MOST_POINTS // len(pieces)
    firm = [firm_points(problem, state, np.flatnonzero(of_point == number), most) for number in pieces]
    points = np.sort(np.concatenate(firm))
    numbers, counts = np.unique(of_point[points], return_counts=True)
    if len(numbers) < 2:
        return np.zeros((0, 3, 3))
    means = np.zeros((len(points), 3, len(numbers), 3))
    which = np.searchsorted(numbers, of_point[points])
    means[np.arange(len(points)), :, which] = np.eye(3) / counts[which][:, None, None]
    # the difference is taken before it is solved for, as in shape_covariances
    means = means - means[:, :, :1]
    functions = functions_of_tie_points(
        problem, state, solvable.layout, points, means.reshape(len(points), 3, -1)
    ).covariance(solvable)
    covariance = np.full((len(pieces), 3, 3), np.nan)
    covariance[numbers] = np.einsum("cicj->cij", functions.reshape(len(numbers), 3, len(numbers), 3))
    return covariance


def given_parameters(problem: Problem) -> FloatArray:
    """Return the interior orientations (cameras, 12) before the adjustment."""
    return np.array([camera.parameters for camera in problem.block.cameras]).reshape(-1, PARAMETERS)
