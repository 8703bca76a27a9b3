"""Similarity transforms between frames: least squares, and robust against positions that are wrong.

x_target = s R x_source + t; closed-form solution by Umeyama (1991, eq. 40–43), with weights. Three pairs of points fix
the seven parameters, so triples are drawn and the one with the most agreeing pairs wins (RANSAC; Fischler & Bolles
1981).
"""

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Similarity
from photogram.errors import OrientationError
from photogram.measures.collinearity import COLLINEAR, collinear

TRIPLES = 500
AGREEING_SHARE = 0.5  # of all pairs: a similarity with which more agree is accepted
LIMIT = 4.0  # sigmas, within which a pair agrees
UNEXPLAINED, NOISE = 0.25, 3.0
"""Squares that it leaves, over those about the mean, and sigmas: a shrunken one agrees with whatever lies close by, but
where positions scatter by more than the block is wide, by no more than their sigmas."""


def open_turn_rad(source: FloatArray, target: FloatArray, sigma_m: FloatArray) -> float:
    """Return how well ``target`` (N, 3), known to ``sigma_m`` (N,), holds a turn of ``source`` (N, 3) about the line
    that both lie along: its standard deviation, infinite in one line."""
    if collinear(source) or collinear(target):
        return float("inf")
    extent = [np.linalg.svd(points - points.mean(axis=0), compute_uv=False) for points in (source, target)]
    # the shape is the block's own; noise widens the measured one
    across = float(np.linalg.norm(extent[0][1:])) / extent[0][0] * extent[1][0]
    return float(np.median(sigma_m) / np.sqrt(3.0) / across)


def fit_similarity(source: FloatArray, target: FloatArray, weight: FloatArray | None = None) -> Similarity:
    """Return the similarity that takes ``source`` (N, 3) to ``target`` (N, 3) with the least weighted squares.

    Raises OrientationError when the points do not fix it.
    """
    w = np.ones(len(source)) if weight is None else weight
    if collinear(source) or collinear(target):
        raise OrientationError(
            f"{len(source)} collinear positions do not determine a similarity: rotation about the line is free"
        )
    w = w / w.sum()
    a, b = w @ source, w @ target
    p, q = source - a, target - b
    U, D, Vt = np.linalg.svd((q * w[:, None]).T @ p)
    S = np.ones(3)
    S[2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = (U * S) @ Vt
    scale = float((D * S).sum() / (w @ np.sum(p**2, axis=1)))
    return Similarity(scale, R, b - scale * R @ a)


def upright_similarity(
    source: FloatArray, up_source: FloatArray, target: FloatArray, sigma_m: FloatArray, scale: float | None = None
) -> Similarity:
    """Return the similarity that sets ``up_source`` (3,) upright and takes ``source`` (N, 3) to ``target`` (N, 3),
    known to ``sigma_m`` (N, 3), with the least weighted squares in plan; at a ``scale`` that is known.

    In plan a similarity is a number z = s exp(iθ) and a shift, in which positions are linear (Helmert's
    transformation): the fit has one minimum, however much they scatter. A similarity of space has an upside-down one.
    """
    east = np.cross(up_source, np.eye(3)[np.argmin(np.abs(up_source))])
    east = east / np.linalg.norm(east)
    level = np.array([east, np.cross(up_source, east), up_source])
    weight = 1.0 / sigma_m**2 / np.sum(1.0 / sigma_m**2, axis=0)
    middle, wanted = np.sum(weight * (source @ level.T), axis=0), np.sum(weight * target, axis=0)
    p, q = ((x - m)[:, :2] @ [1.0, 1.0j] for x, m in ((source @ level.T, middle), (target, wanted)))
    own = weight[:, :2].mean(axis=1)
    z = complex(np.sum(own * p.conj() * q) / np.sum(own * np.abs(p) ** 2))
    c, s = z.real / abs(z), z.imag / abs(z)
    heading = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    factor = abs(z) if scale is None else scale
    return Similarity(factor, heading @ level, wanted - factor * heading @ middle)


def _triples(count: int, seed: int) -> IntArray:
    rng = np.random.default_rng(seed)
    drawn = np.array([rng.permutation(count)[:3] for _ in range(TRIPLES)])
    return np.asarray(np.unique(np.sort(drawn, axis=1), axis=0), dtype=np.int64)


def robust_similarity(
    source: FloatArray, target: FloatArray, sigma_m: FloatArray, *, seed: int = 0
) -> tuple[Similarity, BoolArray]:
    """Return the similarity that most pairs of positions (N, 3) agree with, and which do.

    ``sigma_m`` (N,) is the standard deviation of a target; a pair agrees within LIMIT of them. The least-squares
    fit of the agreeing pairs is repeated until they stay the same. Raises OrientationError when no three pairs, not in
    one line, agree, or no more than half of all, or hardly better than if all stood in one place and by more than their
    sigmas.
    """
    best = np.zeros(len(source), dtype=bool)
    best_cost = np.inf
    extent = 0.5 * np.linalg.norm(np.ptp(target, axis=0)) if len(target) else 0.0
    for triple in _triples(len(source), seed) if len(source) >= 3 else []:
        spread = np.linalg.svd(target[triple] - target[triple].mean(axis=0), compute_uv=False)[1]
        if spread < COLLINEAR * extent or collinear(source[triple]) or collinear(target[triple]):
            continue
        fit = fit_similarity(source[triple], target[triple])
        error = np.linalg.norm(fit.points(source) - target, axis=1) / sigma_m
        # three positions are worse than all: what spreads from their noise is allowed for
        agrees = error < 2.0 * LIMIT
        cost = float(np.minimum(error, 2.0 * LIMIT).sum())
        if (agrees.sum(), -cost) > (best.sum(), -best_cost):
            best, best_cost = agrees, cost
    if best.sum() < 3:
        raise OrientationError(
            f"no three of {len(source)} positions agree with the block's shape: they are wrong, or collinear"
        )
    for _ in range(10):
        fit = fit_similarity(source[best], target[best], 1.0 / sigma_m[best] ** 2)
        agrees = np.linalg.norm(fit.points(source) - target, axis=1) < LIMIT * sigma_m
        if agrees.sum() < 3 or collinear(target[agrees]) or np.array_equal(agrees, best):
            break
        best = agrees
    wanted, left = target[best], np.sum((fit.points(source[best]) - target[best]) ** 2, axis=1)
    share = float(left.sum() / np.sum((wanted - wanted.mean(axis=0)) ** 2))
    scatter = float(np.sqrt(np.mean(left / sigma_m[best] ** 2)))
    if best.sum() <= AGREEING_SHARE * len(source):
        raise OrientationError(
            f"no more than {int(best.sum())} of {len(source)} positions agree with the block's shape, to "
            f"{np.sqrt(left.mean()):.1f} m: check that they belong to these photographs"
        )
    if share > UNEXPLAINED and scatter > NOISE:
        raise OrientationError(
            f"the positions scatter by {np.sqrt(left.mean()):.1f} m about the block's shape, {scatter:.1f} times what "
            "their standard deviations say: check that they belong to these photographs, or enter larger ones"
        )
    return fit, best


def common_rotation(rotations: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) nearest to most of the rotations (N, 3, 3): an iteratively reweighted chordal mean
    (Hartley et al. 2013, sec. 5)."""
    weight = np.ones(len(rotations))
    R = np.eye(3)
    for _ in range(30):
        U, _, Vt = np.linalg.svd(np.einsum("n,nij->ij", weight, rotations))
        R = np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
        weight = 1.0 / np.maximum(np.linalg.norm(rotations - R, axis=(1, 2)), 0.02)
    return R


def similarity_from_attitudes(
    source: FloatArray, rotation_source: FloatArray, target: FloatArray, rotation_target: FloatArray
) -> Similarity:
    """Return the similarity of photographs whose attitudes are measured too; two positions are enough.

    ``source``, ``target`` (N, 3) projection centres, ``rotation_source``, ``rotation_target`` (N, 3, 3) frame from
    camera. The rotation is the one nearest to most of the measured ones (``common_rotation``). Raises
    OrientationError when the positions coincide.
    """
    R = common_rotation(rotation_target @ np.swapaxes(rotation_source, 1, 2))
    turned = source @ R.T  # before the medians, which are taken axis by axis
    p, q = turned - np.median(turned, axis=0), target - np.median(target, axis=0)
    length, wanted = np.linalg.norm(p, axis=1), np.linalg.norm(q, axis=1)
    if not length.max(initial=0.0) > 0:
        raise OrientationError("the photographs of the block stand in one place, so nothing defines its scale")
    far = length > 0.3 * length.max()
    scale = float(np.median(wanted[far] / length[far]))
    return Similarity(scale, R, np.median(target - scale * turned, axis=0))
