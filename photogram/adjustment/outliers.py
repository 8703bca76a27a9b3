"""Mismatches among the observations of tie points: how large the noise is, which observations agree, which do not.

Between rounds of the adjustment every observation is judged anew, so one that was wrongly rejected comes back. A
mismatch along the epipolar line of two rays leaves no residual. It shows only by a depth unlike that of everything else
in both photographs, and by such a depth it can outweigh all other points in what they say of a focal length.
"""

import numpy as np
from scipy.stats import chi2

from photogram.arrays import BoolArray, FloatArray, IntArray, grouped
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.survey import Block, TiePoints
from photogram.triangulation import consensus_intersections, ideal_observations, ray_angles

TWO_RAY_ALLOWANCE = 1.5
NARROWED = 0.5  # of the least ray angle: points that meet it may fall short of it by their noise
ENOUGH = 0.7  # of all observations, that must agree for poses to be good enough to tell mismatches

TAIL = 0.05
"""Share of a photograph's inverse depths beyond either of the two quantiles from which its fences are counted."""

FENCE_RANGES, FENCE_SHARE = 2.0, 0.1
"""From the quantiles to the fences: ranges between the quantiles, and parts of the median."""

FEWEST_DEPTHS = 20
"""Observations of a photograph from which its depths have fences."""


def noise_scale(whitened: FloatArray, point: IntArray, count: int) -> float:
    """Return the robust sigma of whitened residuals (N, 2) of tie points against what was stated.

    The squares of a point with n rays sum to χ² with 2n − 3 degrees of freedom; their ratio to its median is 1 for
    half of the points when the noise is as stated, whatever n, and a few mismatches do not move the median of the
    ratios. Never below 0.3: matches far better than stated are no reason to reject those that are as good as stated.
    """
    rays = np.bincount(point, minlength=count)
    squares = np.bincount(point, weights=np.einsum("ij,ij->i", whitened, whitened), minlength=count)
    seen = rays >= 2
    if not seen.any():
        return 1.0
    median = chi2.ppf(0.5, np.maximum(2 * np.arange(rays.max() + 1) - 3, 1))
    return max(0.3, float(np.sqrt(np.median(squares[seen] / median[rays[seen]]))))


def outlier_limit_px(tie: TiePoints, scale: float, threshold: float) -> FloatArray:
    """Return the largest residual (N,) in px of an observation that is no mismatch.

    The threshold is for a point of many rays. With n rays a residual is smaller than the noise by sqrt((2n − 3)/2n);
    with two all of it lies across the epipolar line, in one dimension, where 0.64 of the threshold is exceeded as
    rarely.
    """
    rays = tie.rays[tie.point].astype(np.float64)
    share = np.sqrt(np.maximum(2.0 * rays - 3.0, 1.0) / (2.0 * rays))
    return threshold * scale * tie.sigma_px * np.maximum(share, 0.64)


def agreeing_observations(
    problem: Problem, state: State, limit_px: FloatArray, minimum_ray_angle_rad: float
) -> tuple[BoolArray, FloatArray]:
    """Return the observations that agree with the cameras as they stand, and where to start their points.

    A point whose observations all lie within ``limit_px`` (N,) of where the adjusted point projects keeps them all.
    For any other the largest set of rays that meet is found anew; a point from two rays is noisier than the adjusted
    one, so the limit is wider.
    """
    block, tie = problem.block, problem.block.tie_points
    camera_of = block.camera_of
    known = np.isfinite(state.tie_point).all(axis=1)
    whitened = residuals(problem.tie, state.cameras, np.nan_to_num(state.tie_point))
    misfit_px = np.linalg.norm(whitened, axis=1) * tie.sigma_px
    good = known & (np.bincount(tie.point[~(misfit_px < limit_px)], minlength=len(tie)) == 0)
    used, points = good[tie.point], state.tie_point.copy()
    rest = tie.select(~good)
    if len(rest):
        cameras = tuple(c.with_parameters(q) for c, q in zip(block.cameras, state.parameters, strict=True))
        points[~good], used[~used] = consensus_intersections(
            rest.first_observation,
            rest.photograph,
            rest.pixel,
            ideal_observations(cameras, camera_of, rest, draft=True),
            TWO_RAY_ALLOWANCE * limit_px[~good[tie.point]],
            state.cameras,
        )
    narrow = ray_angles(tie, used, state.position, points) < minimum_ray_angle_rad
    used &= ~narrow[tie.point]
    points[np.bincount(tie.point[used], minlength=len(tie)) < 2] = np.nan
    return used, points


def _inverse_depths(block: Block, state: State, seen: IntArray, points: FloatArray) -> FloatArray:
    """Return the inverse depth (n,) of the points of the observations ``seen`` (n,) in their photographs, 1/m; of a
    fisheye camera the inverse distance."""
    i = block.tie_points.photograph[seen]
    ray = points[block.tie_points.point[seen]] - state.position[i]
    fisheye = np.array([camera.model == "fisheye" for camera in block.cameras], dtype=bool)[block.camera_of[i]]
    depth = np.einsum("nk,nk->n", ray, state.rotation[i, :, 2])
    depth[fisheye] = np.linalg.norm(ray[fisheye], axis=1)
    inverse: FloatArray = np.divide(1.0, depth, out=np.full(len(depth), np.inf), where=depth > 0.0)
    return inverse


def within_depths(block: Block, state: State, used: BoolArray, points: FloatArray) -> BoolArray:
    """Return the observations (N,) without those of points of two rays that lie, in both photographs, far nearer or
    farther than all others; ``points`` (P, 3) are the tie points of ``block``.

    The fences are those of exploratory statistics, quantiles plus a multiple of the range between them (Tukey 1977,
    ch. 2), of inverse depths and with wider quantiles: a facade and the ground before it are both usual.
    """
    tie = block.tie_points
    seen = np.flatnonzero(used & ~np.isnan(points[:, 0])[tie.point])
    photograph, point = tie.photograph[seen], tie.point[seen]
    near, photographs = _inverse_depths(block, state, seen, points), len(block.photographs)
    order, first = grouped(photograph, photographs)
    fenced = np.diff(first) >= FEWEST_DEPTHS
    if not fenced.any():
        return used
    quantile = np.zeros((3, photographs))
    for k in np.flatnonzero(fenced).tolist():
        count = int(first[k + 1] - first[k])
        at = [int(share * (count - 1)) for share in (TAIL, 0.5, 1.0 - TAIL)]
        quantile[:, k] = np.partition(near[order[first[k] : first[k + 1]]], at)[at]
    lower, middle, upper = quantile
    reach = FENCE_RANGES * (upper - lower) + FENCE_SHARE * middle
    beyond = (near > (upper + reach)[photograph]) | (near < (lower - reach)[photograph])
    outside = np.bincount(point[beyond & fenced[photograph]], minlength=len(tie))
    usual: BoolArray = (np.bincount(point, minlength=len(tie)) != 2) | (outside != 2)
    return np.logical_and(used, usual[tie.point])


def without_narrow(tie: TiePoints, state: State, used: BoolArray, minimum_ray_angle_rad: float) -> BoolArray:
    """Return the observations (N,) without those of points that the last round has moved so far away that their rays,
    nearly parallel, do not tell where."""
    narrow = ray_angles(tie, used, state.position, state.tie_point) < NARROWED * minimum_ray_angle_rad
    return used & ~narrow[tie.point]


def first_agreement(
    problem: Problem, state: State, limit_px: float, minimum_ray_angle_rad: float
) -> tuple[float, BoolArray, FloatArray]:
    """Return the limit in px before anything is adjusted, the observations that agree within it, and where to start
    their points; the limit is ``limit_px``, or more where poses are so far off that most of what is right would be
    beyond it."""
    count, largest = len(problem.tie), max(max(c.width_px, c.height_px) for c in problem.block.cameras)
    while True:
        used, points = agreeing_observations(problem, state, np.full(count, limit_px), minimum_ray_angle_rad)
        if np.count_nonzero(used) >= ENOUGH * count or limit_px >= largest:
            return limit_px, used, points
        limit_px *= 4.0


def settled(before: BoolArray, after: BoolArray) -> bool:
    """Return whether two choices (N,) of observations differ in so few that another round would change nothing."""
    return int(np.count_nonzero(before != after)) <= len(after) // 20000
