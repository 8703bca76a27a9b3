"""Candidate matches of pairs of photographs, and their verification by epipolar geometry."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, image_plane_or_nan, undistort
from photogram.projection import SIDEWAYS
from photogram.settings.settings import Settings, Within
from photogram.sfm.tie_points.matchers.euclidean import Euclidean
from photogram.sfm.tie_points.matchers.hamming import Hamming
from photogram.sfm.tie_points.matchers.nearest import Matcher
from photogram.survey import Features, Matches, Metric

MATCHERS: Mapping[Metric, Matcher] = {"euclidean": Euclidean(), "hamming": Hamming()}
"""Who compares descriptors, by their metric."""


@dataclass(frozen=True)
class MatchingSettings(Settings):
    """How key points are matched and verified."""

    ratio: Annotated[
        float,
        Within(0.01, 1),
        "Nearest to second nearest descriptor distance (Lowe 2004, sec. 7.1); 1 switches the test off.",
    ] = 0.8
    threshold_px: Annotated[
        float,
        Within(0.01, 100, "px"),
        "Distance from the epipolar line, times the coarseness of the key points.",
    ] = 1.5
    minimum_inliers: Annotated[int, Within(8, 10_000), "A pair with fewer verified matches is not connected."] = 20


def candidate_matches(first: Features, second: Features, settings: MatchingSettings) -> IntArray:
    """Match descriptors by ratio test, mutually: returns the indices (M, 2) of candidate matches."""
    if len(first) < 2 or len(second) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    near = MATCHERS[first.metric].nearest(first.descriptor, second.descriptor)
    distinct = near.distance[:, 0] < settings.ratio**2 * near.distance[:, 1]
    mutual = near.back[near.nearest] == np.arange(len(first))
    matched = np.flatnonzero(distinct & mutual)
    return np.column_stack([matched, near.nearest[matched]])


def verified_matches(
    cameras: tuple[Camera, Camera],
    features: tuple[Features, Features],
    candidates: IntArray,
    settings: MatchingSettings,
    coarseness: float = 1.0,
) -> BoolArray:
    """Return which candidates (M, 2) obey one fundamental matrix, estimated on undistorted pixels.

    MAGSAC++ (Barath et al. 2020) as OpenCV implements it, with its fixed seed; all False when no matrix is supported by
    ``minimum_inliers``. ``coarseness`` (features.coarseness) multiplies the threshold.
    """
    rejected = np.zeros(len(candidates), dtype=bool)
    if len(candidates) < max(8, settings.minimum_inliers):
        return rejected
    first = _undistorted(cameras[0], features[0].pixel[candidates[:, 0]])
    second = _undistorted(cameras[1], features[1].pixel[candidates[:, 1]])
    seen = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    if np.count_nonzero(seen) < max(8, settings.minimum_inliers):
        return rejected
    inlier = rejected.copy()
    inlier[seen] = _on_epipolar_lines(first[seen], second[seen], coarseness * settings.threshold_px)
    return inlier if int(inlier.sum()) >= settings.minimum_inliers else rejected


def _undistorted(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return pixels (N, 2) as a pinhole would see them, NaN where a fisheye looks sideways: at the edge of its circle,
    or into the black around it."""
    if camera.model != "fisheye":
        return undistort(camera, pixel)
    ideal = image_plane_or_nan(camera, pixel)
    ideal[~(np.linalg.norm(ideal, axis=1) < SIDEWAYS)] = np.nan
    return ideal * camera.focal_px + camera.principal_point_px


def _on_epipolar_lines(first: FloatArray, second: FloatArray, threshold_px: float) -> BoolArray:
    """Return which undistorted pixels (N, 2) of two photographs obey one fundamental matrix, within ``threshold_px``.

    OpenCV's MAGSAC++ gives up with a failed assertion on some small sets of points that lie nearly in one plane; its
    plain RANSAC (Fischler & Bolles 1981) takes those.
    """
    for method in (cv2.USAC_MAGSAC, cv2.FM_RANSAC):
        try:
            matrix, mask = cv2.findFundamentalMat(first, second, method, threshold_px, 0.9999, 10000)
        except cv2.error as error:
            if "model.empty()" not in str(error):
                raise
            continue
        if matrix is not None and mask is not None:
            return np.asarray(mask.ravel().astype(bool))
        break
    return np.zeros(len(first), dtype=bool)


def match_pair(
    pair: tuple[int, int],
    cameras: tuple[Camera, Camera],
    features: tuple[Features, Features],
    settings: MatchingSettings,
    coarseness: float = 1.0,
) -> tuple[Matches, BoolArray]:
    """Match one pair of photographs, by their numbers, cameras and key points: returns the candidate matches (M, 2) and
    which of them (M,) obey one fundamental matrix within ``threshold_px`` of the settings, as ``verified_matches``."""
    candidates = candidate_matches(*features, settings)
    verified = verified_matches(cameras, features, candidates, settings, coarseness)
    return Matches(pair[0], pair[1], candidates), verified
