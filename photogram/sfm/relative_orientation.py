"""Relative orientation of two photographs from matched points, without known ground points.

The essential matrix is found by the five-point method (Nistér 2004) in RANSAC, as OpenCV implements it: unlike the
fundamental matrix it is determined by a plane too. A plane leaves two solutions, though (Longuet-Higgins 1986), so
where a homography explains the points as well, its decompositions (Malis & Vargas 2007) are tried beside it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import BoolArray, FloatArray

UNITS = 2.0  # that the threshold is for OpenCV: its USAC refines nothing at unit focal length
PLANAR = 0.7  # share of points on one homography from which a scene counts as a plane


@dataclass(frozen=True, eq=False)
class RelativeOrientation:
    """Second photograph relative to the first: x₂ = ``rotation`` x₁ + ``translation``, of unit length.

    ``inliers`` (M,) agree and lie in front of both, ``ray_angle_rad`` is the median angle between their rays.
    """

    rotation: FloatArray
    translation: FloatArray
    inliers: BoolArray
    ray_angle_rad: float


def _judged(
    R: FloatArray, t: FloatArray, first: FloatArray, second: FloatArray, threshold: float
) -> RelativeOrientation:
    """Intersect rays (M, 2) of two photographs by their midpoints and keep those that meet in front of both."""
    a = np.column_stack([first, np.ones(len(first))])
    b = np.column_stack([second, np.ones(len(second))]) @ R
    centre = -R.T @ t
    aa, bb = np.sum(a * a, 1), np.sum(b * b, 1)
    ab = np.sum(a * b, 1)
    determinant = np.maximum(aa * bb - ab * ab, 1e-300)
    ta = (bb * (a @ centre) - ab * (b @ centre)) / determinant
    tb = (ab * (a @ centre) - aa * (b @ centre)) / determinant
    X = 0.5 * (a * ta[:, None] + centre + b * tb[:, None])
    Y = X @ R.T + t
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.maximum(
            np.linalg.norm(X[:, :2] / X[:, 2:] - first, axis=1), np.linalg.norm(Y[:, :2] / Y[:, 2:] - second, axis=1)
        )
    inliers = (ta > 0) & (tb > 0) & (X[:, 2] > 0) & (Y[:, 2] > 0) & (error < threshold)
    angle = np.arccos(np.clip(ab / np.sqrt(aa * bb), -1.0, 1.0))
    return RelativeOrientation(R, t, inliers, float(np.median(angle[inliers])) if inliers.any() else 0.0)


def relative_orientations(first: FloatArray, second: FloatArray, threshold: float) -> list[RelativeOrientation]:
    """Return the relative orientations that matched ideal coordinates (M, 2) of two photographs allow, best first.

    ``threshold`` is the largest disagreement at unit focal length. Empty when nothing agrees.
    """
    if len(first) < 8:
        return []
    focal = UNITS / threshold
    K = np.diag([focal, focal, 1.0])
    a, b = focal * first, focal * second
    matrix, mask = cv2.findEssentialMat(a, b, K, cv2.USAC_MAGSAC, 0.9999, UNITS)
    if matrix is None or mask is None or matrix.shape != (3, 3):
        return []
    inlier = mask.ravel().astype(bool)
    if inlier.sum() < 8:
        return []
    _, R, t, _ = cv2.recoverPose(matrix, a[inlier], b[inlier], K)
    motions = [(np.asarray(R), np.asarray(t).ravel())]
    H, planar = cv2.findHomography(a[inlier], b[inlier], cv2.USAC_MAGSAC, UNITS)
    if H is not None and planar is not None and planar.sum() > PLANAR * inlier.sum():
        _, rotations, translations, _ = cv2.decomposeHomographyMat(H, K)
        for R, t in zip(rotations, translations, strict=True):
            length = float(np.linalg.norm(t))
            if length > 1e-6:
                motions.append((np.asarray(R), np.asarray(t).ravel() / length))
    orientations = [_judged(R, t, first, second, threshold) for R, t in motions]
    return sorted((o for o in orientations if o.inliers.sum() >= 8), key=lambda o: -int(o.inliers.sum()))
