"""Adjusted positions of ground points: control points as estimated, check points intersected from their marks alone.

A check point whose marks do not meet in front of their photographs has no position, and a sentence that names it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, image_plane_or_nan
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.points import first_observations
from photogram.factors.elimination.reprojection import Linearisation, Observations, linearise, observed_marks, residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.projection import OrientedCameras
from photogram.survey import Block, ControlPoints
from photogram.triangulation import consensus_intersections

LARGEST_CONDITION = 1e14  # of the normal equations of a point whose rays meet


def _intersected(points: ControlPoints) -> IntArray:
    """Return the check points that have two marks at least that take part."""
    used = np.bincount(points.mark_point[np.isfinite(points.mark_sigma_px)], minlength=len(points))
    return np.flatnonzero((np.array(points.role) == "check") & (used >= 2))


def unmet(block: Block, ground_world_m: FloatArray) -> list[str]:
    """Return a sentence for each check point with two marks or more that has no position in ``ground_world_m`` (G, 3),
    because they do not meet in front of their photographs."""
    points = block.control_points
    sentences = []
    for g in _intersected(points).tolist():
        if np.isfinite(ground_world_m[g]).all():
            continue
        seen = points.mark_photograph[(points.mark_point == g) & np.isfinite(points.mark_sigma_px)]
        names = ", ".join(block.photographs[i].name for i in seen.tolist())
        sentences.append(
            f"Check point {points.name[g]} has no adjusted position, because its marks in {names} do not "
            "intersect in front of these photographs: check its marks"
        )
    return sentences


def _check_points(
    problem: Problem, state: State, covariances: Covariances, ground: FloatArray, covariance: FloatArray
) -> None:
    """Intersect the check points from their marks with the adjusted cameras; fill ``ground`` and ``covariance`` in
    place."""
    points = problem.block.control_points
    index = _intersected(points)
    if not len(index):
        return
    mask = np.isin(points.mark_point, index) & np.isfinite(points.mark_sigma_px)
    order = np.flatnonzero(mask)[np.lexsort((points.mark_photograph[mask], points.mark_point[mask]))]
    number = np.searchsorted(index, points.mark_point[order])
    observations = replace(observed_marks(points, order), point=number)
    cameras = [c.with_parameters(q) for c, q in zip(problem.block.cameras, state.parameters, strict=True)]
    X = intersect_weighted(observations, cameras, state.cameras, len(index))
    linear = linearise(observations, state.cameras, X)
    first = first_observations(number, len(index))
    for n, g in enumerate(index.tolist()):
        if not np.isfinite(X[n]).all():
            continue
        rays = slice(int(first[n]), int(first[n + 1]))
        ground[g], covariance[g] = X[n], _intersection_covariance(observations, linear, rays, covariances)


def _intersection_covariance(
    observations: Observations, linear: Linearisation, rays: slice, covariances: Covariances
) -> FloatArray:
    """Return the covariance (3, 3) of a point intersected from its marks with uncertain cameras."""
    J_point = linear.point[rays].reshape(-1, 3)
    photographs, number = np.unique(observations.photograph[rays], return_inverse=True)
    border = 6 * len(photographs)
    cameras = covariances.joint(photographs)
    owner, parameter = covariances.layout.free_parameters
    J = np.zeros((len(number), 2, len(cameras)))
    for n, (i, camera) in enumerate(zip(number.tolist(), linear.camera[rays].tolist(), strict=True)):
        J[n, :, 6 * i : 6 * i + 6] = linear.pose[rays][n]
        columns = np.flatnonzero(owner == camera)
        J[n, :, border + columns] = linear.calibration[rays][n][:, parameter[columns]].T
    G = np.linalg.solve(J_point.T @ J_point, J_point.T)
    rows = J.reshape(2 * len(number), -1)
    return np.asarray(G @ (np.eye(len(G.T)) + rows @ cameras @ rows.T) @ G.T)


def intersect_weighted(
    observations: Observations, cameras: Sequence[Camera], oriented: OrientedCameras, count: int
) -> FloatArray:
    """Intersect ``count`` points from observations sorted by point with fixed cameras: Gauss–Newton from the best two
    rays; returns positions (count, 3) in the world, NaN where rays do not meet in front of all their photographs."""
    o = observations
    ideal = np.empty_like(o.pixel)
    camera = oriented.camera[o.photograph]
    for c in np.unique(camera):
        ideal[camera == c] = image_plane_or_nan(cameras[c], o.pixel[camera == c])
    everything = np.full(len(o), 1e6)
    X, _ = consensus_intersections(
        first_observations(o.point, count),
        o.photograph,
        o.pixel,
        ideal,
        everything,
        oriented,
    )
    met = np.isfinite(X).all(axis=1)
    for _ in range(20):
        linear = linearise(o, oriented, np.nan_to_num(X))
        V, g = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(V, o.point, np.einsum("nri,nrj->nij", linear.point, linear.point))
        np.add.at(g, o.point, np.einsum("nri,nr->ni", linear.point, linear.residual))
        eigenvalue = np.linalg.eigvalsh(np.nan_to_num(V))
        met &= np.isfinite(g).all(axis=1) & (eigenvalue[:, 0] * LARGEST_CONDITION > eigenvalue[:, 2])
        step = np.zeros((count, 3))
        step[met] = np.linalg.solve(V[met], g[met][..., None])[..., 0]
        X = X - step
        if np.abs(step).max(initial=0.0) < 1e-9:
            break
    left = residuals(o, oriented, np.nan_to_num(X))
    met &= np.bincount(o.point, ~np.isfinite(left).all(axis=1), minlength=count) == 0
    return np.where(met[:, None], X, np.nan)


def _is_control(points: ControlPoints) -> BoolArray:
    return np.array([role == "control" for role in points.role], dtype=bool)


def of_control(problem: Problem, state: State) -> FloatArray:
    """Return the positions (G, 3) of the ground points that are estimated, NaN for check points."""
    points = problem.block.control_points
    ground = np.full((len(points), 3), np.nan)
    ground[_is_control(points)] = state.control
    return ground


def ground_points(problem: Problem, state: State, covariances: Covariances) -> tuple[FloatArray, FloatArray]:
    """Return the adjusted positions (G, 3) and covariances (G, 3, 3) of all ground points, control and check, in the
    world, m; NaN for check points with fewer than two marks, or whose marks do not meet."""
    points = problem.block.control_points
    ground = of_control(problem, state)
    covariance = np.full((len(points), 3, 3), np.nan)
    covariance[_is_control(points)] = covariances.control_point
    _check_points(problem, state, covariances, ground, covariance)
    return ground, covariance


def mark_residuals_px(block: Block, ground_world_m: FloatArray, state: State) -> FloatArray:
    """Return projected minus measured (M, 2) of all marks, NaN for points without a position."""
    points = block.control_points
    known = np.asarray(np.isfinite(ground_world_m).all(axis=1))[points.mark_point]
    residual = np.full((len(known), 2), np.nan)
    marks = Observations(
        points.mark_photograph,
        points.mark_point,
        points.mark_pixel,
        np.ones(len(known)),
    ).select(known)
    residual[known] = residuals(marks, state.cameras, np.nan_to_num(ground_world_m))
    return residual
