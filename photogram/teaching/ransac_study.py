"""The textbook experiment: RANSAC on the fundamental matrix with the normalised 8-point algorithm.

For teaching: it shows how the number of inliers varies between iterations, what larger samples cost, and what the
threshold means. The convention is x2ᵀ F x1 = 0, with pixels of photographs free of distortion. The survey itself is
matched with a modern robust estimator, not with this.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from photogram.arrays import FloatArray, Int32Array, IntArray, check_shape
from photogram.errors import SettingError, check_positive

Residual = Literal["sampson", "symmetric", "algebraic"]

BATCH_RESIDUALS = 400_000


def fundamental_matrix(first_px: FloatArray, second_px: FloatArray) -> FloatArray:
    """Return F (..., 3, 3), of unit Frobenius norm and rank 2, from corresponding pixels (..., s, 2), s at least 8.

    The normalised 8-point algorithm (Hartley 1997, sec. 3; Hartley & Zisserman 2004, alg. 11.1): pixels are shifted
    and scaled to a mean distance of √2 from their centroid, the epipolar constraints are solved by SVD, the smallest
    singular value of F is set to zero, and the scaling is undone. Leading axes are a batch.
    """
    x1, T1 = _normalised(first_px)
    x2, T2 = _normalised(second_px)
    design = (x2[..., :, None] * x1[..., None, :]).reshape(*x1.shape[:-1], 9)
    # R has the right singular vectors of the design matrix, and at most nine rows.
    R = np.linalg.qr(design, mode="r")
    F = np.linalg.svd(R, full_matrices=True)[2][..., -1, :].reshape(*x1.shape[:-2], 3, 3)
    U, S, Vt = np.linalg.svd(F)
    S[..., 2] = 0.0
    F = np.swapaxes(T2, -1, -2) @ (U * S[..., None, :]) @ Vt @ T1
    return np.asarray(F / np.linalg.norm(F, axis=(-2, -1), keepdims=True))


def _normalised(pixel: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return homogeneous normalised coordinates (..., s, 3) and the transform (..., 3, 3) that made them."""
    centroid = pixel.mean(axis=-2)
    offset = pixel - centroid[..., None, :]
    scale = np.sqrt(2.0) / np.maximum(np.linalg.norm(offset, axis=-1).mean(axis=-1), np.finfo(np.float64).tiny)
    T = np.zeros((*centroid.shape[:-1], 3, 3))
    T[..., 0, 0] = T[..., 1, 1] = scale
    T[..., :2, 2] = -scale[..., None] * centroid
    T[..., 2, 2] = 1.0
    return np.concatenate([offset * scale[..., None, None], np.ones((*offset.shape[:-1], 1))], axis=-1), T


def epipolar_residual(
    F: FloatArray, first_px: FloatArray, second_px: FloatArray, kind: Residual = "sampson"
) -> FloatArray:
    """Return the residuals (..., N) of pixels (N, 2) against F (..., 3, 3).

    ``sampson``: first-order distance to the epipolar constraint, px (root of a term of Hartley & Zisserman 2004, eq.
    11.9). ``symmetric``: root of the squared distances to both epipolar lines, px (eq. 11.10). ``algebraic``: |x2ᵀ F
    x1| for F of unit Frobenius norm; it has no unit of length: it grows with the distance from the epipoles and with
    the photograph's size, so one threshold on it is a different number of pixels at every point.
    """
    x1 = np.column_stack([first_px, np.ones(len(first_px))])
    x2 = np.column_stack([second_px, np.ones(len(second_px))])
    line2 = x1 @ np.swapaxes(F, -1, -2)
    algebraic = np.abs(np.sum(line2 * x2, axis=-1))
    if kind == "algebraic":
        return np.asarray(algebraic)
    line1 = x2 @ F[..., :2]
    slope2 = line2[..., 0] ** 2 + line2[..., 1] ** 2
    slope1 = line1[..., 0] ** 2 + line1[..., 1] ** 2
    # Both slopes vanish together only at the epipoles, where every residual is zero.
    tiny = np.finfo(np.float64).tiny
    if kind == "symmetric":
        return np.asarray(algebraic * np.sqrt(1.0 / np.maximum(slope1, tiny) + 1.0 / np.maximum(slope2, tiny)))
    return np.asarray(algebraic / np.sqrt(np.maximum(slope1 + slope2, tiny)))


def draw_samples(points: int, sample_size: int, iterations: int, generator: np.random.Generator) -> IntArray:
    """Return samples (iterations, sample_size) of distinct indices below ``points``, every subset equally likely.

    Floyd's algorithm (Bentley & Floyd 1987), for all iterations at once.
    """
    sample = np.empty((iterations, sample_size), dtype=np.int64)
    for column, last in enumerate(range(points - sample_size, points)):
        candidate = generator.integers(0, last + 1, size=iterations)
        taken = np.any(sample[:, :column] == candidate[:, None], axis=1)
        sample[:, column] = np.where(taken, last, candidate)
    return sample


def needed_iterations(
    inlier_fraction: float, sample_size: FloatArray | IntArray | int, probability: float = 0.99
) -> FloatArray:
    """Return how many samples it takes for one free of outliers, with ``probability`` p and inlier fraction w.

    N = log(1 − p) / log(1 − wˢ) (Fischler & Bolles 1981, sec. II.B). At least 1; infinite where no point is an inlier.
    """
    free = np.clip(np.power(float(inlier_fraction), np.asarray(sample_size, dtype=np.float64)), 0.0, 1.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.maximum(np.log1p(-probability) / np.log1p(-free), 1.0))


def success_probability(inlier_fraction: float, sample_size: int, iteration: IntArray | int) -> FloatArray:
    """Return the probability 1 − (1 − wˢ)ⁿ that one of the first n samples at least was free of outliers."""
    free = float(inlier_fraction) ** sample_size
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-np.expm1(np.asarray(iteration, dtype=np.float64) * np.log1p(-free)))


@dataclass(frozen=True, eq=False)
class RansacStudy:
    """What every iteration found: ``inliers`` (sample sizes S, thresholds T, iterations I).

    ``iterations`` are the numbers of iterations to look at, the largest of them I; ``thresholds_px`` are px, but for
    the algebraic residual. ``best_fundamental`` (S, T, 3, 3) belongs to the most inliers of each.
    """

    points: int
    iterations: tuple[int, ...]
    sample_sizes: tuple[int, ...]
    thresholds_px: tuple[float, ...]
    residual: Residual
    inliers: Int32Array
    best_fundamental: FloatArray

    def __post_init__(self) -> None:
        shape = (len(self.sample_sizes), len(self.thresholds_px))
        check_shape("inliers", self.inliers, (*shape, max(self.iterations)))
        check_shape("best_fundamental", self.best_fundamental, (*shape, 3, 3))

    @property
    def running_best(self) -> Int32Array:
        """Most inliers (S, T, I) up to each iteration."""
        return np.maximum.accumulate(self.inliers, axis=2)

    @property
    def best_inliers(self) -> Int32Array:
        """Most inliers (S, T, len(iterations)) after each of the numbers of iterations."""
        return self.running_best[..., np.array(self.iterations) - 1]

    @property
    def inlier_fraction(self) -> FloatArray:
        """The fraction w (T,) of inliers as the best model of any sample size sees it, for each threshold."""
        return np.asarray(self.inliers.max(axis=(0, 2)) / self.points)

    def first_reached(self, fraction: float = 0.95) -> IntArray:
        """Iteration (S, T) at which the running best first came to ``fraction`` of the most of any sample size.

        Counted from 1; 0 where it never did.
        """
        goal = fraction * self.inliers.max(axis=(0, 2))
        reached = self.inliers >= goal[None, :, None]
        return np.where(reached.any(axis=2), reached.argmax(axis=2) + 1, 0).astype(np.int64)


def study(
    first_px: FloatArray,
    second_px: FloatArray,
    iterations: Sequence[int] = (10, 100, 1000),
    sample_sizes: Sequence[int] = (8, 10, 12, 16, 24),
    thresholds_px: Sequence[float] = (0.5, 1.0, 2.0, 4.0),
    seed: int = 0,
    residual: Residual = "sampson",
) -> RansacStudy:
    """Run RANSAC for each sample size on corresponding pixels (N, 2) of two photographs.

    Inliers are counted in each iteration. Every threshold judges the same models; every sample size draws its own
    samples, whatever the others are. Raises SettingError for samples below 8, more than there are matches, and for
    iterations or thresholds that are not positive.
    """
    check_shape("first_px", first_px, (None, 2))
    check_shape("second_px", second_px, first_px.shape)
    _check(len(first_px), iterations, sample_sizes, thresholds_px, residual)
    total = max(iterations)
    limits = np.asarray(thresholds_px, dtype=np.float64)
    inliers = np.empty((len(sample_sizes), len(limits), total), dtype=np.int32)
    best = np.empty((len(sample_sizes), len(limits), 3, 3))
    batch = max(1, BATCH_RESIDUALS // len(first_px))
    for s, size in enumerate(sample_sizes):
        sample = draw_samples(len(first_px), size, total, np.random.default_rng([seed, size]))
        models = np.empty((total, 3, 3))
        for start in range(0, total, batch):
            part = slice(start, start + batch)
            models[part] = fundamental_matrix(first_px[sample[part]], second_px[sample[part]])
            distance = epipolar_residual(models[part], first_px, second_px, residual)
            for t, limit in enumerate(limits):
                inliers[s, t, part] = np.count_nonzero(distance <= limit, axis=1)
        best[s] = models[inliers[s].argmax(axis=1)]
    return RansacStudy(
        len(first_px), tuple(iterations), tuple(sample_sizes), tuple(thresholds_px), residual, inliers, best
    )


def _check(
    points: int,
    iterations: Sequence[int],
    sample_sizes: Sequence[int],
    thresholds_px: Sequence[float],
    residual: Residual,
) -> None:
    if not iterations or not sample_sizes or not thresholds_px:
        raise SettingError("iterations, sample_sizes, thresholds_px", "give at least one of each")
    check_positive("iterations", min(iterations))
    check_positive("thresholds_px", min(thresholds_px))
    if min(sample_sizes) < 8:
        raise SettingError("sample_sizes", f"a sample of {min(sample_sizes)} matches: the algorithm needs at least 8")
    if max(sample_sizes) > points:
        raise SettingError("sample_sizes", f"{points} matches: too few for a sample of {max(sample_sizes)}")
    if residual not in get_args(Residual):
        kinds = ", ".join(get_args(Residual))
        raise SettingError("residual", f"no residual is called {residual!r}: choose one of {kinds}")
