"""What follows from the normal equations: covariances, those of all ground points together, tests, and what the block
says of a measurement that is left out. A priori, from the standard deviations that were used.

Focal lengths that were held and count all the same are consider parameters (Tapley, Schutz & Born 2004, sec. 6.2).
Covariances of a network without a datum are those in which all tie points have no shift, turn and scale in common
(S-transformation, Baarda 1973).
"""

from typing import NamedTuple

import numpy as np

from photogram.verification import equations as eq
from photogram.verification.camera import Numbers, cross
from photogram.verification.equations import Arrays, Columns, Group, Normal, camera_columns, images, used_marks

LEAST_REDUNDANCY, OBJECT = 1e-6, 9.0


class Tested(NamedTuple):
    """Redundancy numbers and w (m, r), predictions by all else minus what was measured (m, r) and their covariances
    (m, r, r), in standard deviations."""

    redundancy: Numbers
    w: Numbers
    left_out: Numbers
    spread: Numbers


class Solution(NamedTuple):
    """A block derived again: covariances of the unknowns with what is considered held, ``fixed``, as ``tests`` have it,
    and as they are ``shown``; ``step`` (n,) that is left, in standard deviations; ground points (G, 3) with the joint
    covariance (3 G, 3 G); vᵀPv and the redundancy; ``precision``, to how much of themselves doubles tell covariances:
    ten times the condition of the normal equations times the rounding of one."""

    arrays: Arrays
    columns: Columns
    groups: list[Group]
    normal: Normal
    fixed: Numbers
    tests: Numbers
    shown: Numbers
    step: Numbers
    ground_world_m: Numbers
    ground_joint_m2: Numbers
    squares: float
    redundancy: int
    precision: float


def tested(group: Group, covariance: Numbers) -> Tested:
    """Return Q = I − A Σ Aᵀ of a group as its tests: r = diag Q, w = v/√r, Q⁻¹ v, Q⁻¹ (Baarda 1968)."""
    _, at, J, v = group
    Q = np.eye(v.shape[1]) - J @ covariance[at[:, :, None], at[:, None, :]] @ J.transpose(0, 2, 1)
    r, inverse = np.einsum("mii->mi", Q), np.full_like(Q, np.nan)
    w = np.where(r > LEAST_REDUNDANCY, v / np.sqrt(np.maximum(r, LEAST_REDUNDANCY)), np.nan)
    whole = np.linalg.eigvalsh(Q)[:, 0] > LEAST_REDUNDANCY
    inverse[whole] = np.linalg.inv(Q[whole])
    return Tested(r, w, np.einsum("mij,mj->mi", inverse, v), inverse)


def inverse_of(S: Numbers) -> Numbers:
    """Return the inverse of a symmetric matrix. Raises ValueError where it has none."""
    scale = np.sqrt(np.outer(np.diagonal(S), np.diagonal(S)))
    try:
        np.linalg.cholesky(S / scale)
    except np.linalg.LinAlgError as error:
        raise ValueError("the normal equations have no unique solution") from error
    return np.asarray(np.linalg.inv(S / scale) / scale)


def largest_eigenvalue(M: Numbers) -> float:
    """Return the largest eigenvalue of a positive definite matrix, nearly: 20 steps of the power method."""
    v = np.ones(len(M))
    for _ in range(20):
        v = M @ (v / np.linalg.norm(v))
    return float(np.linalg.norm(v))


def with_considered(a: Arrays, columns: Columns, S: Numbers) -> tuple[Numbers, Numbers]:
    """Return the covariances with considered focal lengths held, zero for these, and with them counted: D⁻¹ − P⁻¹ is
    added to their normal equations, D what they are given, P what these equations say of them."""
    held = columns.lens + np.flatnonzero(columns.considered)
    free, fixed = np.setdiff1d(np.arange(columns.total), held), np.zeros_like(S)
    fixed[np.ix_(free, free)] = inverse_of(S[np.ix_(free, free)])
    if not len(held):
        return fixed, fixed
    sigma, changed = a["considered_focal_sigma_px"][columns.parameter[columns.considered, 0]], S.copy()
    changed[np.ix_(held, held)] += np.diag(sigma**-2.0) - np.linalg.inv(inverse_of(S)[np.ix_(held, held)])
    return fixed, inverse_of(changed)


def moved(apart: Numbers, parts: int) -> Numbers:
    """Return how shifts, turns and the scale, the first so many, move places (n, 3) from the centre (n, 3, parts)."""
    shifts = np.tile(np.eye(3), (len(apart), 1, 1))
    return np.concatenate([shifts, -cross(apart), apart[:, :, None]], axis=2)[:, :, :parts]


def open_directions(a: Arrays, columns: Columns, centre: Numbers, parts: int) -> Numbers:
    """Return how the open parts of a datum move the unknowns (n, parts)."""
    D, R = np.zeros((columns.total, parts)), a["rotation_world_from_camera"].transpose(0, 2, 1)
    D[: columns.lens].reshape(-1, 6, parts)[:, :3, 3:6] = R
    D[: columns.lens].reshape(-1, 6, parts)[:, 3:] = R @ moved(a["centre_world_m"] - centre, parts)
    control = moved(a["ground_world_m"][a["ground_is_control"]] - centre, parts)
    D[columns.control :] = control.reshape(-1, parts)
    return D


class Datum(NamedTuple):
    """The datum of the object: its centre (3,), covariances (k, k) of the open parts, and of the unknowns with them
    (n, k)."""

    centre: Numbers
    own: Numbers
    mixed: Numbers

    def transformed(self, covariance: Numbers, D: Numbers, mixed: Numbers) -> Numbers:
        """Return a covariance (m, m) in the datum, of what moves as D and has ``mixed`` with its parts (m, k)."""
        return np.asarray(covariance - D @ mixed.T - mixed @ D.T + D @ self.own @ D.T)


def object_datum(a: Arrays, columns: Columns, covariance: Numbers, rays: Numbers, parts: int) -> Datum:
    """Return the datum of the tie points, but for those that are known three times worse than most."""
    weight, X = (rays <= OBJECT * np.median(rays)).astype(np.float64), a["tie_point_world_m"]
    centre = weight @ X / weight.sum()
    D = weight[:, None, None] * moved(X - centre, parts)
    size = np.sqrt(np.sum(D**2, axis=(0, 1)))
    fit = (D / size) @ np.linalg.inv(np.einsum("pik,pil->kl", D, D) / np.outer(size, size)) / size
    u, own = np.zeros((columns.total, parts)), np.zeros((parts, parts))
    for part in eq.tie_parts(a, columns):
        pulled = np.linalg.solve(part.V, fit[part.points])
        own += np.einsum("pik,pil->kl", fit[part.points], pulled)
        u[part.columns[:-1]] -= np.einsum("cpi,pik->ck", part.W[:-1], pulled)
    return Datum(centre, own + u.T @ covariance @ u, covariance @ u)


def ground_points(a: Arrays, columns: Columns, covariance: Numbers, datum: Datum | None) -> tuple[Numbers, Numbers]:
    """Return all ground points (G, 3), check points intersected from their marks alone by Gauss-Newton, and their joint
    covariance: δ V⁻¹ + V⁻¹ Wᵀ S⁻¹ W V⁻¹, NaN of those without a position."""
    X, control = a["ground_world_m"].copy(), a["ground_is_control"]
    there = np.isfinite(X).all(axis=1)
    m, L = used_marks(a, there & ~control)
    photograph, g = a["mark_photograph"][m], a["mark_point"][m]
    V, own, T = np.tile(np.eye(3), (len(X), 1, 1)), np.zeros((len(X), 3, 3)), np.zeros((len(X), 3, columns.total))
    for _ in range(10):
        image, b = images(a, columns, photograph, a["mark_pixel_px"][m], X[g]), np.zeros((len(X), 3))
        B, V[g] = L @ image.point, 0.0
        np.add.at(V, g, B.transpose(0, 2, 1) @ B)
        np.add.at(b, g, np.einsum("nri,nrj,nj->ni", B, L, image.residual))
        X[there] -= np.linalg.solve(V[there], b[there][:, :, None])[:, :, 0]
    own[g] = np.linalg.inv(V[g])
    pull = own[g] @ B.transpose(0, 2, 1) @ L @ np.concatenate(image[1:3], axis=2)
    np.add.at(T.transpose(0, 2, 1), (g[:, None], camera_columns(columns, photograph)), -pull.transpose(0, 2, 1))
    at = columns.control + 3 * columns.number[control][:, None] + np.arange(3)
    T[np.flatnonzero(control)[:, None], np.arange(3), at] = 1.0
    A = T[there].reshape(-1, columns.total)
    both, joint = A @ covariance @ A.T, np.full((3 * len(X),) * 2, np.nan)
    if datum is not None:
        D = moved(X[there] - datum.centre, len(datum.own)).reshape(len(A), len(datum.own))
        both = datum.transformed(both, D, A @ datum.mixed)
    for k, spread in enumerate(own[there]):
        both[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += spread
    joint[np.ix_(np.repeat(there, 3), np.repeat(there, 3))] = both
    joint[2::3, 2::3] += a["ground_model_error_m2"]
    return X, joint


def solved(a: Arrays) -> Solution:
    """Derive a block again from the arrays of observations.npz. Raises ValueError where they determine none."""
    columns = eq.columns_of(a)
    groups = eq.observed(a, columns)
    normal = eq.reduced(a, columns, groups)
    parts, S, datum = (7 - bool(len(a["distance_m"]))) * bool(a["network_is_free"]), normal.S, None
    if parts:
        G = open_directions(a, columns, a["centre_world_m"].mean(axis=0), parts)
        G *= np.sqrt(np.diagonal(S).max()) / np.linalg.norm(G, axis=0)
        S = S + G @ G.T
    fixed, shown = with_considered(a, columns, S)
    tests, scale = 2.0 * fixed - shown, np.sqrt(np.outer(np.diagonal(S), np.diagonal(S)))
    precision = 10.0 * np.finfo(float).eps * largest_eigenvalue(S / scale) * largest_eigenvalue(shown * scale)
    if parts:
        datum = object_datum(a, columns, shown, normal.rays, parts)
    ground, joint = ground_points(a, columns, shown, datum)
    if datum is not None:
        shown = datum.transformed(shown, open_directions(a, columns, datum.centre, parts), datum.mixed)
    whitened = normal.residual / a["tie_sigma_px"][:, None]
    squares = float(np.sum(normal.weight[:, None] * whitened**2) + sum(np.sum(v**2) for *_, v in groups))
    open_axes = ~a["ground_controlled"] | np.isinf(a["ground_sigma_m"])
    measured = whitened.size + sum(v.size for *_, v in groups) - int(open_axes[a["ground_is_control"]].sum()) + parts
    unknown = columns.total - int(columns.considered.sum()) + 3 * len(np.unique(a["tie_point"]))
    step = np.abs(fixed @ normal.right) / np.sqrt(np.maximum(np.diagonal(fixed), 1e-300))
    redundancy = int(measured - unknown)
    return Solution(
        a, columns, groups, normal, fixed, tests, shown, step, ground, joint, squares, redundancy, precision
    )
