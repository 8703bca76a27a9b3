"""The normal equations of a block at its estimates, from its observations, tie points eliminated.

Unknowns: six of each photograph, a turn ω (rad) and a shift ν (m) along its camera's axes, R Exp(ω) and C + R ν; free
parameters of cameras; GNSS offsets; other common errors; control points. Observations have whitened residuals v,
adjusted minus measured, and Jacobians A; N = Σ AᵀA, S = U − Σ W V⁻¹ Wᵀ (Triggs et al. 2000, sec. 6.1).
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from photogram.verification import camera as cam
from photogram.verification.camera import READOUT, Numbers, cross

Arrays = Mapping[str, Numbers]
POINTS_AT_ONCE = 1000
NO_HEADING_SIGMA_RAD, OWN_OFFSET_SIGMA_M = 10.0, 1e-6


class Group(NamedTuple):
    """Alike observations: ``columns`` (m, k) of unknowns, whitened ``jacobian`` (m, r, k) and ``residual`` (m, r)."""

    name: str
    columns: Numbers
    jacobian: Numbers
    residual: Numbers


class Columns(NamedTuple):
    """Where unknowns stand: photograph i from 6 i on; ``parameter`` (F, 2), camera and number of each from ``lens`` on,
    ``considered`` those of them (F,) that are held and count all the same; offsets, common errors and control points
    behind them, ``number`` (G,) of each ground point among the latter, −1 for check points."""

    lens: int
    parameter: Numbers
    considered: Numbers
    offset: int
    common: int
    control: int
    total: int
    number: Numbers


def columns_of(a: Arrays) -> Columns:
    """Return where the unknowns of a block stand."""
    free, considered = a["camera_prior_sigma"] > 0.0, np.zeros(a["camera_prior_sigma"].shape, dtype=bool)
    considered[:, 0] = (a["considered_focal_sigma_px"] > 0.0) & ~free[:, 0]
    parameter, control = np.argwhere(free | considered), a["ground_is_control"]
    lens = 6 * len(a["photograph_name"])
    ends = np.cumsum([lens, len(parameter), a["gnss_offset_world_m"].size, len(a["common_error_value"])]).tolist()
    number = np.where(control, np.cumsum(control) - 1, -1)
    held, end = considered[tuple(parameter.T)], ends[3] + 3 * int(control.sum())
    return Columns(lens, parameter, held, ends[1], ends[2], ends[3], end, number)


class Images(NamedTuple):
    """Images linearised: residuals (n, 2) px, projected minus measured, and derivatives by the pose (n, 2, 6), by the
    parameters (n, 2, F), zero for those of other cameras, and by the point (n, 2, 3)."""

    residual: Numbers
    pose: Numbers
    parameter: Numbers
    point: Numbers


def images(a: Arrays, columns: Columns, photograph: Numbers, pixel: Numbers, place: Numbers) -> Images:
    """Linearise images of places (n, 3) of the world, measured at pixels (n, 2) in photographs (n,). A rolling shutter
    stands at C + w T (v/(h − 1) − 1/2). Raises ValueError for a point behind its camera."""
    camera, R = a["photograph_camera"][photograph], a["rotation_world_from_camera"][photograph]
    q, size = a["camera_parameter"][camera], a["camera_size_px"][camera].astype(np.float64)
    way = (pixel[:, 1] / (size[:, 1] - 1.0) - 0.5)[:, None] * a["velocity_world_m_s"][photograph]
    p = np.einsum("nji,nj->ni", R, place - a["centre_world_m"][photograph] - q[:, READOUT, None] * way)
    if np.any(p[:, 2] <= 0.0):
        raise ValueError("a point lies behind a camera that shows it")
    fisheye, wanted = (a["camera_model"] == "fisheye")[camera], np.unique(columns.parameter[:, 1]).tolist()
    inner = [k for k in wanted if k < READOUT]
    G, of_inner = cam.derivatives(fisheye, q, p, inner)
    slopes = dict(zip(inner, np.moveaxis(of_inner, 2, 0), strict=True))
    slopes[READOUT] = np.einsum("nri,nji,nj->nr", G, R, -way)
    residual, functions = cam.image_of(fisheye, q, p) - pixel, a["lens_function_px"]
    if functions.size:  # a measured pixel m less the field there is the projection: π − (m − s(m))
        i, j, w = cam.nodes_around(size, functions.shape[1:3], pixel)
        field = np.einsum("nq,nqrk->nrk", w, functions[camera[:, None], i, j])
        residual = residual + np.einsum("nrk,nk->nr", field, q[:, READOUT + 1 :])
        slopes |= {READOUT + 1 + k: field[:, :, k] for k in range(field.shape[2])}
    parameter = np.zeros((len(p), 2, len(columns.parameter)))
    for f, (c, k) in enumerate(columns.parameter.tolist()):
        parameter[camera == c, :, f] = slopes[k][camera == c]
    return Images(residual, np.concatenate([G @ cross(p), -G], axis=2), parameter, G @ R.transpose(0, 2, 1))


def camera_columns(columns: Columns, photograph: Numbers) -> Numbers:
    """Return the columns (n, 6 + F) of pose and parameters of images in photographs (n,)."""
    lens = np.arange(columns.lens, columns.lens + len(columns.parameter))
    return np.hstack([6 * photograph[:, None] + np.arange(6), np.tile(lens, (len(photograph), 1))])


def used_marks(a: Arrays, of: Numbers) -> tuple[Numbers, Numbers]:
    """Return the numbers (m,) of the marks that were not rejected, of the ground points of a mask (G,), and L⁻¹
    (m, 2, 2) of their covariances L Lᵀ (Förstner & Wrobel 2016, sec. 4.2)."""
    finite = np.isfinite(a["mark_covariance_px2"]).all(axis=(1, 2))
    m = np.flatnonzero(finite & of[a["mark_point"]])
    return m, np.linalg.inv(np.linalg.cholesky(a["mark_covariance_px2"][m]))


def gnss_misfit(a: Arrays) -> tuple[Numbers, Numbers]:
    """Return C − R (l + a) − offset − shift − GNSS (N, 3), NaN without a position, and l + a (N, 3)."""
    moves, value, inside = a["common_error_moves"], a["common_error_value"], a["common_error_in_camera"]
    arm = a["lever_arm_camera_m"] + moves[:, :, inside] @ value[inside]
    shift = moves[:, :, ~inside] @ value[~inside]
    offset = np.vstack([a["gnss_offset_world_m"], np.zeros(3)])[a["gnss_offset_number"]]
    turned = np.einsum("nij,nj->ni", a["rotation_world_from_camera"], arm)
    return a["centre_world_m"] - turned - shift - offset - a["gnss_world_m"], arm


def attitudes(a: Arrays, columns: Columns) -> Iterator[Group]:
    """Yield measured attitudes, Log(R̃ᵀ Exp(h z) R Exp(b)) with boresight b and heading h in common."""
    measured, kinds, number = np.isfinite(a["attitude_sigma_rad"]), a["attitude_common_error"], a["common_error_number"]
    for error in np.unique(kinds[measured]).tolist():
        i, own = np.flatnonzero(measured & (kinds == error)), np.flatnonzero(number == error)
        bias = np.zeros((1, 4))
        bias[0, : len(own)] = a["common_error_value"][own]
        given, R, B = a["attitude_world_from_camera"][i], a["rotation_world_from_camera"][i], cam.rotation(bias[:, :3])
        e = cam.rotation_vector(given.transpose(0, 2, 1) @ cam.rotation(bias[:, 3:] * np.eye(3)[2]) @ R @ B)
        by_heading = (R @ B)[:, 2, :, None]
        of_bias = np.concatenate([np.tile(np.linalg.inv(cam.turn_of(bias[:, :3])), (len(i), 1, 1)), by_heading], axis=2)
        J = cam.turn_of(e) @ np.concatenate(
            [np.tile(B.transpose(0, 2, 1), (len(i), 1, 1)), of_bias[:, :, : len(own)]], axis=2
        )
        around = given[:, 2, :, None] * given[:, 2, None, :] * ~a["attitude_heading_known"][i][:, None, None]
        W = (np.eye(3) - around) / a["attitude_sigma_rad"][i][:, None, None] + around / NO_HEADING_SIGMA_RAD
        at = np.hstack([6 * i[:, None] + np.arange(3), np.tile(columns.common + own, (len(i), 1))])
        yield Group("attitude", at, W @ J, np.einsum("nij,nj->ni", W, e))


def known(name: str, at: Numbers, off: Numbers, sigma: Numbers) -> Group:
    """Return the priors of unknowns that are off by so much, but for those that are free."""
    held = np.isfinite(sigma)
    return Group(name, at[held][:, None], (1.0 / sigma[held])[:, None, None], (off[held] / sigma[held])[:, None])


def priors(a: Arrays, columns: Columns) -> Iterator[Group]:
    """Yield the priors of GNSS offsets, of which flights have a part in common, of common errors and of cameras."""
    offset, sigma = a["gnss_offset_world_m"], a["gnss_offset_sigma_m"]
    K, shared = len(offset), float(a["gnss_offset_common_sigma_m"]) * np.array([1.0, 1.0, 0.0]) * (len(offset) > 1)
    own = np.maximum(sigma**2 - shared**2, OWN_OFFSET_SIGMA_M**2)
    spread = np.kron(np.eye(K), np.diag(own)) + np.kron(np.ones((K, K)), np.diag(shared**2))
    W = np.linalg.inv(np.linalg.cholesky(spread)) @ np.kron(np.eye(K), a["map_axes_world"].T)
    yield Group("gnss_offset", columns.offset + np.arange(3 * K)[None], W[None], (W @ offset.ravel())[None])
    value = a["common_error_value"]
    yield known("common_errors", columns.common + np.arange(len(value)), value, a["common_error_sigma"])
    off, at = a["camera_parameter"] - a["camera_prior"], columns.lens + np.arange(len(columns.parameter))
    for name, part in (
        ("calibration", columns.parameter[:, 1] <= READOUT),
        ("lens_fields", columns.parameter[:, 1] > READOUT),
    ):
        chosen = part & ~columns.considered
        which = tuple(columns.parameter[chosen].T)
        yield known(name, at[chosen], off[which], a["camera_prior_sigma"][which])


def distances(a: Arrays, columns: Columns) -> Iterator[Group]:
    """Yield measured distances between projection centres, and between ground points."""
    for chosen, places in (
        (a["distance_of_photographs"], "centre_world_m"),
        (~a["distance_of_photographs"], "ground_world_m"),
    ):
        ends, sigma = a["distance_ends"][chosen], a["distance_sigma_m"][chosen]
        apart = a[places][ends[:, 1]] - a[places][ends[:, 0]]
        length = np.linalg.norm(apart, axis=1)
        J = (
            np.repeat((apart / (length * sigma)[:, None])[:, None, None], 2, axis=1)
            * np.array([-1.0, 1.0])[:, None, None]
        )
        first = columns.control + 3 * columns.number[ends] if places == "ground_world_m" else 6 * ends + 3
        J = J if places == "ground_world_m" else J @ a["rotation_world_from_camera"][ends]
        at = (first[:, :, None] + np.arange(3)).reshape(-1, 6)
        misfit = (length - a["distance_m"][chosen]) / sigma
        yield Group("distances", at, J.reshape(-1, 1, 6), misfit[:, None])


def observed(a: Arrays, columns: Columns) -> list[Group]:
    """Return all observations but those of tie points, without groups of none."""
    m, W = used_marks(a, a["ground_is_control"])
    photograph, point, place = a["mark_photograph"][m], a["mark_point"][m], a["ground_world_m"]
    own = columns.control + 3 * columns.number[:, None] + np.arange(3)
    image = images(a, columns, photograph, a["mark_pixel_px"][m], place[point])
    J = W @ np.concatenate([image.pose, image.parameter, image.point], axis=2)
    at = np.hstack([camera_columns(columns, photograph), own[point]])
    marks = Group("marks", at, J, np.einsum("nij,nj->ni", W, image.residual))
    g = np.flatnonzero(a["ground_is_control"])
    sigma = np.where(a["ground_controlled"][g], a["ground_sigma_m"][g], np.inf)
    W = a["ground_held_axes"][g].transpose(0, 2, 1) / sigma[:, :, None]
    off = np.nan_to_num(place[g] - a["ground_held_world_m"][g])
    control = Group("control", own[g], W, np.einsum("nij,nj->ni", W, off))
    i = np.flatnonzero(np.isfinite(a["gnss_world_m"]).all(axis=1))
    (off, arm), R, moves = gnss_misfit(a), a["rotation_world_from_camera"][i], a["common_error_moves"][i]
    moves = np.where(a["common_error_in_camera"], R @ moves, moves)
    W = a["map_axes_world"].T / a["gnss_sigma_m"][i][:, :, None]
    shifted = np.tile(-np.eye(3), (len(i), 1, 1))[:, :, : 3 * bool(len(a["gnss_offset_world_m"]))]
    J = W @ np.concatenate([R @ cross(arm[i]), R, shifted, -moves], axis=2)
    offset = columns.offset + 3 * a["gnss_offset_number"][i][:, None] + np.arange(shifted.shape[2])
    common = np.tile(columns.common + np.arange(moves.shape[2]), (len(i), 1))
    at = np.hstack([6 * i[:, None] + np.arange(6), offset, common])
    gnss = Group("gnss", at, J, np.einsum("nij,nj->ni", W, off[i]))
    others = (*attitudes(a, columns), *priors(a, columns), *distances(a, columns))
    return [group for group in (marks, control, gnss, *others) if group.residual.size]


def robust_weights(a: Arrays, whitened: Numbers) -> Numbers:
    """Return the weights (n,) of whitened residuals (n, 2) under the loss that was used (Huber 1964)."""
    norm, limit = np.linalg.norm(whitened, axis=1), float(a["robust_threshold"])
    of_loss = {"huber": limit / np.maximum(norm, limit), "cauchy": 1.0 / (1.0 + (norm / limit) ** 2)}
    return np.asarray(of_loss.get(str(a["robust_loss"]), np.ones_like(norm)))


class Part(NamedTuple):
    """Tie points taken together: numbers of ``observations`` (n,) and ``points`` (p,), residuals (n, 2) px and robust
    ``weight`` (n,); V (p, 3, 3) of the points, U (c, c) of the ``columns`` (c,) of cameras, W (c, p, 3) between both.
    The last of the columns is that of the right side."""

    observations: Numbers
    points: Numbers
    residual: Numbers
    weight: Numbers
    columns: Numbers
    V: Numbers
    W: Numbers
    U: Numbers


def tie_parts(a: Arrays, columns: Columns) -> Iterator[Part]:
    """Yield the tie points, those of neighbouring photographs together, linearised with their robust weights."""
    point, photograph, F = a["tie_point"], a["tie_photograph"], len(columns.parameter) + 1
    lowest = np.full(len(a["tie_point_world_m"]), len(a["photograph_name"]))
    np.minimum.at(lowest, point, photograph)
    number = np.argsort(np.argsort(lowest, kind="stable"), kind="stable") // POINTS_AT_ONCE
    for part in range(number.max(initial=-1) + 1):
        points, n = np.flatnonzero(number == part), np.flatnonzero(number[point] == part)
        image = images(a, columns, photograph[n], a["tie_pixel_px"][n], a["tie_point_world_m"][point[n]])
        own, (seen, local) = np.searchsorted(points, point[n]), np.unique(photograph[n], return_inverse=True)
        weight = robust_weights(a, image.residual / a["tie_sigma_px"][n][:, None])
        scale, poses = (np.sqrt(weight) / a["tie_sigma_px"][n])[:, None, None], 6 * len(seen)
        B, J = scale * image.point, scale * np.concatenate([*image[1:3], image.residual[:, :, None]], axis=2)
        V, of_lens = np.zeros((len(points), 3, 3)), np.zeros((len(points), F, 3))
        of_poses, U = np.zeros((len(seen), len(points), 6, 3)), np.zeros((poses + F, poses + F))
        JB = J.transpose(0, 2, 1) @ B
        np.add.at(V, own, B.transpose(0, 2, 1) @ B)
        np.add.at(of_poses, (local, own), JB[:, :6])
        np.add.at(of_lens, own, JB[:, 6:])
        for k in range(len(seen)):
            A, at = J[local == k].reshape(-1, 6 + F), np.r_[6 * k : 6 * k + 6, poses : poses + F]
            U[np.ix_(at, at)] += A.T @ A
        by_column = of_poses.transpose(0, 2, 1, 3).reshape(poses, len(points), 3)
        W = np.concatenate([by_column, of_lens.transpose(1, 0, 2)])
        at = np.r_[(6 * seen[:, None] + np.arange(6)).ravel(), columns.lens : columns.offset, columns.total]
        yield Part(n, points, image.residual, weight, at, V, W, U)


class Normal(NamedTuple):
    """The normal equations S (n, n) and their right side (n,) at the estimates; of tie points residuals (N, 2) px,
    robust ``weight`` (N,), ``rays`` (P,), the trace of V⁻¹, and ``left`` (P,), the way to where the point would go by
    its own rays, in standard deviations."""

    S: Numbers
    right: Numbers
    residual: Numbers
    weight: Numbers
    rays: Numbers
    left: Numbers


def reduced(a: Arrays, columns: Columns, groups: list[Group]) -> Normal:
    """Return the normal equations, tie points eliminated."""
    S, residual = np.zeros((columns.total + 1, columns.total + 1)), np.zeros((len(a["tie_point"]), 2))
    weight, (rays, left) = np.ones(len(residual)), np.zeros((2, len(a["tie_point_world_m"])))
    for _, at, J, v in groups:
        A, at = np.concatenate([J, v[:, :, None]], axis=2), np.pad(at, [(0, 0), (0, 1)], constant_values=columns.total)
        np.add.at(S, (at[:, :, None], at[:, None, :]), A.transpose(0, 2, 1) @ A)
    for n, points, *own, at, V, W, U in tie_parts(a, columns):
        inverse = np.linalg.inv(np.linalg.cholesky(V))
        Y = np.einsum("cpi,pji->cpj", W, inverse)
        residual[n], weight[n] = own
        rays[points], left[points] = np.sum(inverse**2, axis=(1, 2)), np.linalg.norm(Y[-1], axis=1)
        S[np.ix_(at, at)] += U - np.tensordot(Y, Y, ([1, 2], [1, 2]))
    return Normal(S[:-1, :-1], S[:-1, -1], residual, weight, rays, left)
