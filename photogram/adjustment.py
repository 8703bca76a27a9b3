"""The joint adjustment: Levenberg–Marquardt on the factor graph, outlier rounds, covariances.

Poses, calibration, tie points, control points and GNSS offsets are estimated together. Tie points carry a robust loss
and are tested between rounds, with re-admission; control points, marks and GNSS positions are never down-weighted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from photogram.camera import Camera, Pose, image_plane
from photogram.errors import AdjustmentError
from photogram.factors.covariance import Covariances, covariances
from photogram.factors.elimination import eliminate_tie_points, first_observations, tie_point_covariances
from photogram.factors.graph import (
    IndeterminateError,
    Problem,
    State,
    cost,
    damped_step,
    ground_graph,
    linearise_all,
    retract,
    robust_cost_and_weight,
)
from photogram.factors.reprojection import Observations, linearise, residuals
from photogram.factors.variables import CALIBRATION, CONTROL_POINT, GNSS_OFFSET, POSE, TIE_POINT, WORDS
from photogram.survey import Adjustment, Block, FloatArray, IntArray, TiePoints
from photogram.triangulation import consensus_intersections, ideal_observations, ray_angles

Progress = Callable[[str], None]
TWO_RAY_ALLOWANCE = 1.5


@dataclass(frozen=True)
class AdjustmentSettings:
    """How the joint adjustment is run; thresholds are in sigmas of the measurement."""

    tie_point_sigma_px: float = 0.5
    robust_loss: Literal["none", "huber", "cauchy"] = "huber"
    robust_threshold: float = 3.0
    outlier_threshold: float = 4.0
    first_outlier_threshold_px: float = 40.0  # agreement of rays before anything is adjusted
    minimum_ray_angle_deg: float = 1.0
    maximum_rounds: int = 6
    maximum_iterations: int = 50  # per round
    relative_tolerance: float = 1e-9  # of the cost, between accepted steps; 1e-3 before the last round


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where Levenberg–Marquardt stopped."""

    state: State
    cost: float
    iterations: int
    converged: bool


def minimise(
    problem: Problem, state: State, settings: AdjustmentSettings, progress: Progress = lambda _: None
) -> Minimum:
    """Minimise the cost by Levenberg–Marquardt (Marquardt 1963) with the damping update of Nielsen (1999).

    Raises IndeterminateError when the linear system has no unique solution.
    """
    graph = ground_graph(problem)
    current = cost(problem, graph, state)
    if not np.isfinite(current):
        raise AdjustmentError("a point that takes part lies behind a photograph at the start of the adjustment")
    damping, growth = 1e-5, 2.0
    for iteration in range(1, settings.maximum_iterations + 1):
        system = linearise_all(problem, graph, state)
        while True:
            step = damped_step(system, damping)
            candidate = retract(problem, state, step)
            value = cost(problem, graph, candidate)
            gain = (current - value) / step.predicted_decrease if step.predicted_decrease > 0 else 0.0
            small = step.predicted_decrease <= settings.relative_tolerance * max(current, 1e-12)
            if gain > 0 and np.isfinite(value):
                break
            if small:
                return Minimum(state, current, iteration, True)
            damping *= growth
            growth *= 2.0
            if damping > 1e12:
                return Minimum(state, current, iteration, False)
        saved = current - value
        state, current = candidate, value
        damping = max(1e-9, damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3))
        growth = 2.0
        progress(f"iteration {iteration}: cost {current:.6g}")
        if small or saved <= settings.relative_tolerance * max(current, 1e-12):
            return Minimum(state, current, iteration, True)
    return Minimum(state, current, settings.maximum_iterations, False)


def start_state(block: Block, flights: tuple[str, ...]) -> State:
    """Return the starting values of a block whose photographs are all oriented."""
    control = block.control_points.with_role("control")
    poses = [pose for pose in block.poses if pose is not None]
    return State(
        np.array([pose.rotation_world_from_camera for pose in poses]).reshape(-1, 3, 3),
        np.array([pose.position_world_m for pose in poses]).reshape(-1, 3),
        np.array([camera.parameters for camera in block.cameras]).reshape(-1, 8),
        block.tie_points.position_world_m.copy(),
        control.position_world_m.copy(),
        np.zeros((len(flights), 3)),
    )


def make_problem(block: Block, settings: AdjustmentSettings) -> Problem:
    """Return the problem of a block, with all its tie-point observations.

    Raises AdjustmentError naming every photograph that has no pose.
    """
    missing = [p.name for p, pose in zip(block.photographs, block.poses, strict=True) if pose is None]
    if missing:
        raise AdjustmentError(f"not oriented, so they cannot be adjusted: {', '.join(missing)}")
    camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
    tie, control = block.tie_points, block.control_points.with_role("control")
    flights: tuple[str, ...] = ()
    if np.any(block.gnss_offset_sigma_m > 0):
        flights = tuple(sorted({p.flight for p in block.photographs if p.gnss_world_m is not None}))
    return Problem(
        block,
        Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px, camera_of[tie.photograph]),
        Observations(
            control.mark_photograph,
            control.mark_point,
            control.mark_pixel,
            control.mark_sigma_px,
            camera_of[control.mark_photograph],
        ),
        control.position_world_m,
        control.sigma_m,
        flights,
        settings.robust_loss,
        settings.robust_threshold,
    )


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
    return max(0.3, float(np.sqrt(np.median(squares[seen] / chi2.ppf(0.5, 2 * rays[seen] - 3)))))


def _outlier_limit_px(tie: TiePoints, scale: float, threshold: float) -> FloatArray:
    """Return the largest residual (N,) in px of an observation that is no mismatch.

    The threshold is for a point of many rays. With n rays a residual is smaller than the noise by sqrt((2n − 3)/2n);
    with two all of it lies across the epipolar line, in one dimension, where 0.64 of the threshold is exceeded as
    rarely.
    """
    rays = tie.rays[tie.point].astype(np.float64)
    share = np.sqrt(np.maximum(2.0 * rays - 3.0, 1.0) / (2.0 * rays))
    return threshold * scale * tie.sigma_px * np.maximum(share, 0.64)


def _select(
    problem: Problem, state: State, limit_px: FloatArray, settings: AdjustmentSettings
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return the observations that agree with the cameras as they stand, and where to start their points.

    A point whose observations all lie within ``limit_px`` (N,) of where the adjusted point projects keeps them all.
    For any other the largest set of rays that meet is found anew; a point from two rays is noisier than the adjusted
    one, so the limit is wider.
    """
    block, tie = problem.block, problem.block.tie_points
    camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
    known = np.isfinite(state.tie_point).all(axis=1)
    whitened = residuals(problem.tie, state.parameters, state.rotation, state.position, np.nan_to_num(state.tie_point))
    misfit_px = np.linalg.norm(whitened, axis=1) * tie.sigma_px
    good = known & (np.bincount(tie.point[~(misfit_px < limit_px)], minlength=len(tie)) == 0)
    used, points = good[tie.point], state.tie_point.copy()
    rest = tie.select(~good)
    if len(rest):
        cameras = tuple(c.with_parameters(q) for c, q in zip(block.cameras, state.parameters, strict=True))
        points[~good], used[~used] = consensus_intersections(
            rest.first_observation,
            rest.photograph,
            camera_of,
            rest.pixel,
            ideal_observations(cameras, camera_of, rest),
            TWO_RAY_ALLOWANCE * limit_px[~good[tie.point]],
            state.parameters,
            state.rotation,
            state.position,
        )
    narrow = ray_angles(tie, used, state.position, points) < np.deg2rad(settings.minimum_ray_angle_deg)
    used &= ~narrow[tie.point]
    points[np.bincount(tie.point[used], minlength=len(tie)) < 2] = np.nan
    return used, points


def _settled(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> bool:
    return int(np.count_nonzero(before != after)) <= max(2, len(after) // 500)


@dataclass(frozen=True, eq=False)
class Solved:
    """The end of the outlier rounds: the problem with the observations that took part, and its minimum."""

    problem: Problem
    minimum: Minimum
    used: NDArray[np.bool_]
    rounds: int
    iterations: int


def _solve_rounds(whole: Problem, state: State, settings: AdjustmentSettings, progress: Progress) -> Solved:
    """Alternate between choosing the observations that agree and adjusting with them, until the choice settles."""
    tie = whole.block.tie_points
    limit = np.full(len(tie.photograph), settings.first_outlier_threshold_px)
    used: NDArray[np.bool_] = np.zeros(len(tie.photograph), dtype=bool)
    draft = replace(settings, relative_tolerance=max(1e-3, settings.relative_tolerance))
    iterations = 0
    for number in range(1, settings.maximum_rounds + 1):
        chosen, points = _select(whole, state, limit, settings)
        last = number == settings.maximum_rounds or (number > 2 and _settled(used, chosen))
        used = chosen
        problem = whole.with_tie_observations(whole.tie.select(used))
        _check_determined(problem)
        progress(f"round {number}: {len(problem.tie)} observations of {len(np.unique(problem.tie.point))} tie points")
        minimum = minimise(problem, replace(state, tie_point=points), settings if last else draft, progress)
        iterations += minimum.iterations
        if last:
            break
        state = minimum.state
        whitened = residuals(problem.tie, state.parameters, state.rotation, state.position, state.tie_point)
        scale = noise_scale(whitened, problem.tie.point, len(tie))
        limit = _outlier_limit_px(tie, scale, settings.outlier_threshold)
    return Solved(problem, minimum, used, number, iterations)


def _check_determined(problem: Problem) -> None:
    """Raise AdjustmentError for what can be seen to be undetermined before anything is solved."""
    block = problem.block
    seen = np.bincount(problem.tie.photograph, minlength=len(block.photographs))
    seen += np.bincount(problem.marks.photograph, minlength=len(block.photographs))
    for photograph, rays in zip(block.photographs, seen, strict=True):
        held = photograph.gnss_world_m is not None and photograph.attitude_sigma_rad is not None
        if rays < 3 and not held:
            raise AdjustmentError(
                f"photograph {photograph.name}: {rays} image points take part, at least 3 are needed: "
                "match it with more overlap, mark control points in it, or leave it out"
            )
    positions = sum(p.gnss_world_m is not None for p in block.photographs)
    if len(problem.control_world_m) < 3 and positions < 3:
        raise AdjustmentError(
            f"nothing fixes the block in {block.frame.crs}: {len(problem.control_world_m)} control points "
            f"and {positions} GNSS positions; three of either, not in one line, are needed"
        )
    used = set(problem.tie.camera.tolist()) | set(problem.marks.camera.tolist())
    for c, camera in enumerate(block.cameras):
        if c not in used and np.any(np.isinf(camera.sigmas)):
            raise AdjustmentError(
                f"camera {camera.name}: no photograph of it takes part, its free parameters cannot be estimated"
            )


def _name(problem: Problem, variable: tuple[str, int] | None) -> str:
    if variable is None:
        return "a variable that GTSAM does not name"
    kind, index = variable
    names: dict[str, Callable[[int], str]] = {
        POSE: lambda i: problem.block.photographs[i].name,
        CONTROL_POINT: lambda i: problem.block.control_points.with_role("control").name[i],
        GNSS_OFFSET: lambda i: problem.flights[i],
        CALIBRATION: lambda i: problem.block.cameras[i].name,
        TIE_POINT: str,
    }
    return f"{WORDS[kind]} {names[kind](index)}"


_LACKS = {
    POSE: "its position or attitude is not held by control points, GNSS positions and tie points together",
    CONTROL_POINT: "it has no survey sigma that holds it and too few marks",
    GNSS_OFFSET: "without control points it cannot be told from the block's position: give gnss.offset_sigma_m, or 0",
    CALIBRATION: "the photographs cannot determine every free parameter: give a prior sigma, or hold it",
    TIE_POINT: "its rays are too nearly parallel",
}


def _undetermined(problem: Problem, fault: IndeterminateError) -> AdjustmentError:
    lacks = "it is not determined" if fault.variable is None else _LACKS[fault.variable[0]]
    return AdjustmentError(f"the adjustment has no unique solution: {_name(problem, fault.variable)}: {lacks}")


def sigma0_and_redundancy(problem: Problem, minimum: Minimum) -> tuple[float, int]:
    """Return sigma0 = sqrt(vᵀPv / r) of the minimised squares, and the redundancy r."""
    block, state = problem.block, minimum.state
    graph = ground_graph(problem)
    image = 2 * (len(problem.tie) + len(problem.marks))
    ground = sum(graph.at(i).dim() for i in range(graph.size()))
    points = 3 * (len(np.unique(problem.tie.point)) + len(state.control) + len(state.offset))
    unknowns = 6 * len(block.photographs) + points + sum(len(f) for f in problem.free)
    redundancy = image + ground - unknowns
    tie = residuals(problem.tie, state.parameters, state.rotation, state.position, state.tie_point)
    _, weight = robust_cost_and_weight(tie, problem.robust_loss, problem.robust_threshold)
    robust, _ = robust_cost_and_weight(tie, problem.robust_loss, problem.robust_threshold)
    squares = 2.0 * (minimum.cost - 0.5 * float(robust.sum())) + float(np.sum(weight[:, None] * tie**2))
    return float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan"), redundancy


def _check_points(
    problem: Problem, state: State, found: Covariances, ground: FloatArray, covariance: FloatArray
) -> None:
    """Intersect the check points from their marks with the adjusted cameras; fill ``ground`` and ``covariance`` in
    place."""
    points = problem.block.control_points
    index = [
        g for g, role in enumerate(points.role) if role == "check" and np.count_nonzero(points.mark_point == g) >= 2
    ]
    if not index:
        return
    mask = np.isin(points.mark_point, index)
    order = np.flatnonzero(mask)[np.lexsort((points.mark_photograph[mask], points.mark_point[mask]))]
    number = np.searchsorted(index, points.mark_point[order])
    camera_of = np.array([p.camera for p in problem.block.photographs], dtype=np.int64)
    photograph = points.mark_photograph[order]
    observations = Observations(
        photograph, number, points.mark_pixel[order], points.mark_sigma_px[order], camera_of[photograph]
    )
    cameras = [c.with_parameters(q) for c, q in zip(problem.block.cameras, state.parameters, strict=True)]
    X = intersect_weighted(observations, cameras, state, len(index))
    linear = linearise(observations, state.parameters, state.rotation, state.position, X)
    V_inverse, failed = eliminate_tie_points(
        observations, linear, len(index), found.columns, np.zeros_like(found.reduced)
    )
    if failed >= 0:
        raise AdjustmentError(
            f"check point {points.name[index[failed]]}: its rays are parallel, mark it in more photographs"
        )
    ground[index] = X
    covariance[index] = tie_point_covariances(observations, linear, found.columns, V_inverse, found.reduced)


def intersect_weighted(observations: Observations, cameras: Sequence[Camera], state: State, count: int) -> FloatArray:
    """Intersect ``count`` points from observations sorted by point with fixed cameras: Gauss–Newton from the best two
    rays.

    Raises AdjustmentError when the marks of a point do not meet in front of their photographs.
    """
    o = observations
    ideal = np.empty_like(o.pixel)
    for c in np.unique(o.camera):
        ideal[o.camera == c] = image_plane(cameras[c], o.pixel[o.camera == c])
    camera_of = np.zeros(len(state.rotation), dtype=np.int64)
    camera_of[o.photograph] = o.camera
    everything = np.full(len(o), 1e6)
    X, _ = consensus_intersections(
        first_observations(o.point, count),
        o.photograph,
        camera_of,
        o.pixel,
        ideal,
        everything,
        state.parameters,
        state.rotation,
        state.position,
    )
    for _ in range(20):
        linear = linearise(o, state.parameters, state.rotation, state.position, X)
        V, g = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(V, o.point, np.einsum("nri,nrj->nij", linear.point, linear.point))
        np.add.at(g, o.point, np.einsum("nri,nr->ni", linear.point, linear.residual))
        if not (np.isfinite(g).all() and np.all(np.linalg.cond(V) < 1e14)):
            raise AdjustmentError(
                "the marks of a check point do not meet in front of their photographs: check the marks"
            )
        step = np.linalg.solve(V, g[..., None])[..., 0]
        X = X - step
        if np.abs(step).max() < 1e-9:
            break
    return np.asarray(X)


def _ground_points(problem: Problem, state: State, found: Covariances) -> tuple[FloatArray, FloatArray]:
    """Return the adjusted positions (G, 3) and covariances (G, 3, 3) of all ground points, control and check."""
    points = problem.block.control_points
    ground = np.full((len(points), 3), np.nan)
    covariance = np.full((len(points), 3, 3), np.nan)
    for i, g in enumerate(g for g, role in enumerate(points.role) if role == "control"):
        ground[g], covariance[g] = state.control[i], found.control(i)
    _check_points(problem, state, found, ground, covariance)
    return ground, covariance


def _mark_residuals_px(block: Block, ground_world_m: FloatArray, state: State) -> FloatArray:
    """Return projected minus measured (M, 2) of all marks, NaN for points without a position."""
    points = block.control_points
    camera = np.array([p.camera for p in block.photographs], dtype=np.int64)[points.mark_photograph]
    known = np.asarray(np.isfinite(ground_world_m).all(axis=1))[points.mark_point]
    residual = np.full((len(known), 2), np.nan)
    marks = Observations(
        points.mark_photograph, points.mark_point, points.mark_pixel, np.ones(len(known)), camera
    ).select(known)
    residual[known] = residuals(marks, state.parameters, state.rotation, state.position, np.nan_to_num(ground_world_m))
    return residual


def _adjusted_block(block: Block, state: State, used: NDArray[np.bool_]) -> tuple[Block, NDArray[np.bool_]]:
    """Return the block with adjusted values and only what took part, and the mask (P,) of tie points kept."""
    kept = np.bincount(block.tie_points.point[used], minlength=len(block.tie_points)) >= 2
    tie_points = replace(block.tie_points, position_world_m=state.tie_point).select(kept, used)
    cameras = tuple(c.with_parameters(q) for c, q in zip(block.cameras, state.parameters, strict=True))
    poses = tuple(Pose(R, C) for R, C in zip(state.rotation, state.position, strict=True))
    return replace(block, cameras=cameras, poses=poses, tie_points=tie_points), kept


def adjust(block: Block, settings: AdjustmentSettings, progress: Progress = lambda _: None) -> Adjustment:
    """Adjust a block jointly, reject mismatched observations, and compute covariances.

    Every photograph needs a pose to start from; tie points need none. Raises AdjustmentError naming the variable that
    is not determined, and what it lacks.
    """
    whole = make_problem(block, settings)
    try:
        solved = _solve_rounds(whole, start_state(block, whole.flights), settings, progress)
        state = solved.minimum.state
        adjusted, kept = _adjusted_block(block, state, solved.used)
        camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
        tie = adjusted.tie_points
        final_state = replace(state, tie_point=tie.position_world_m)
        final = solved.problem.with_tie_observations(
            Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px, camera_of[tie.photograph])
        )
        progress("covariances")
        found = covariances(final, final_state)
    except IndeterminateError as fault:
        raise _undetermined(whole, fault) from fault
    sigma0, redundancy = sigma0_and_redundancy(final, replace(solved.minimum, state=final_state))
    ground, ground_covariance = _ground_points(final, final_state, found)
    poses = [found.pose(i) for i in range(len(block.photographs))]
    R = state.rotation
    tie_residual = residuals(final.tie, state.parameters, R, state.position, tie.position_world_m)
    return Adjustment(
        block=adjusted,
        sigma0=sigma0,
        redundancy=redundancy,
        residual_px=tie_residual * tie.sigma_px[:, None],
        mark_residual_px=_mark_residuals_px(block, ground, state),
        position_covariance_m2=np.array([R[i] @ S[3:, 3:] @ R[i].T for i, S in enumerate(poses)]),
        rotation_covariance_rad2=np.array([S[:3, :3] for S in poses]),
        calibration_covariance=np.array([found.calibration(c) for c in range(len(block.cameras))]),
        tie_point_covariance_m2=found.tie_point,
        ground_world_m=ground,
        ground_covariance_m2=ground_covariance,
        flights=whole.flights,
        offset_world_m=state.offset,
        offset_covariance_m2=np.array([found.offset(f) for f in range(len(whole.flights))]).reshape(-1, 3, 3),
        iterations=solved.iterations,
        rounds=solved.rounds,
        converged=solved.minimum.converged,
        cost=solved.minimum.cost,
        discarded_observations=int(np.count_nonzero(~solved.used)),
        discarded_points=int(np.count_nonzero(~kept)),
    )
