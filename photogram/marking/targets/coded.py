"""Coded targets, AprilTag (Olson 2011) and ArUco (Garrido-Jurado et al. 2014): detected by OpenCV, then fitted whole.

The corners that the detector gives are those of the black square. The homography of the square and its code is fitted
to the grey values: q = A (p − c) / (1 + h·(p − c)), so that c is where the diagonals meet, the image of the centre.
"""

from functools import cache
from math import factorial
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr

from photogram.arrays import ByteArray, Float32Array, FloatArray
from photogram.marking.targets.fitting import centre_covariance
from photogram.marking.targets.kinds import Kind, MeasuredCentre

FAMILIES = {
    "apriltag 36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "apriltag 25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "apriltag 16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "aruco 4x4": cv2.aruco.DICT_4X4_50,
    "aruco 5x5": cv2.aruco.DICT_5X5_100,
    "aruco 6x6": cv2.aruco.DICT_6X6_250,
    "aruco original": cv2.aruco.DICT_ARUCO_ORIGINAL,
}
"""Families of codes and OpenCV's number of each."""
LEAST_EXPLAINED = 0.94
MODEL_ERROR = 0.96
"""Factor of standard deviations, as of fitting."""
LEAST_CONTRAST_DN = 20.0
SHORTEST_PX = 40.0
"""Perimeter from which a coded target may be read: a field has two pixels or less there."""
_BLUR = 8  # place of the blur among the ten parameters: c, A, h, blur; the levels follow
LEAST_FIELD_PX = 2.2
"""Side of a field from which a code can be distinguished from other squares."""
RIM = 0.5
"""Fields around the black square that are fitted too: they are white."""


@cache
def _detector(perimeter: float) -> Any:  # noqa: ANN401 - OpenCV carries no types
    """Return the detector of targets whose perimeter is at least so many times the longer side of the patch."""
    options = cv2.aruco.DetectorParameters()
    # fields that a blur has misread are corrected: the fit to the grey values then rejects a code that is not there
    options.errorCorrectionRate = 0.4
    # the middle of a field is read, where its neighbours have the least part
    options.perspectiveRemovePixelPerCell, options.perspectiveRemoveIgnoredMarginPerCell = 8, 0.3
    options.minMarkerPerimeterRate = perimeter
    options.maxErroneousBitsInBorderRate = 0.15
    options.adaptiveThreshWinSizeMin, options.adaptiveThreshWinSizeMax = 5, 45
    options.minSideLengthCanonicalImg = 12
    options.minOtsuStdDev = 8.0
    dictionaries = [cv2.aruco.getPredefinedDictionary(number) for number in FAMILIES.values()]
    return cv2.aruco.ArucoDetector(dictionaries, options)


@cache
def _fields(family: str, number: int) -> FloatArray:
    """Return the fields (n, n) of a code, 0 black and 1 white, with its black border and a white rim."""
    dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])
    picture = cv2.aruco.generateImageMarker(dictionary, number, dictionary.markerSize + 2)
    return np.pad(np.asarray(picture, np.float64) / 255.0, 1, constant_values=1.0)


def find_coded(grey: ByteArray | Float32Array) -> list[MeasuredCentre]:
    """Return the coded targets in a patch (H, W) of grey values, each fitted."""
    byte = np.ascontiguousarray(np.clip(grey, 0, 255).astype(np.uint8))
    # a detector that works with whole pixels finds small targets in an enlarged patch
    factor = 2 if max(byte.shape) <= 1000 else 1
    large = cv2.resize(byte, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC) if factor > 1 else byte
    centres: list[MeasuredCentre] = []
    detector = _detector(round(factor * SHORTEST_PX / max(large.shape), 3))
    names = list(FAMILIES)
    for patch in (large, _sharpened(large, factor)):
        corners, numbers, _, family = detector.detectMarkersMultiDict(patch)
        if numbers is None:
            continue
        for quadrangle, number, index in zip(corners, np.ravel(numbers), np.ravel(family), strict=True):
            corner = (np.asarray(quadrangle, np.float64).reshape(4, 2) + 0.5) / factor - 0.5
            if any(np.hypot(*(f.centre_px - corner.mean(axis=0))) < 4.0 for f in centres):
                continue
            measured = _fitted(grey.astype(np.float64), corner, names[int(index)], int(number))
            if measured is not None:
                centres.append(measured)
    return centres


def _sharpened(grey: ByteArray, factor: int) -> ByteArray:
    """Return a patch in which what is blurred by a pixel or two can be read; it is fitted as it was."""
    return np.asarray(cv2.addWeighted(grey, 5.0, cv2.GaussianBlur(grey, (0, 0), 2.0 * factor), -4.0, 0.0), np.uint8)


def _fitted(grey: FloatArray, corner: FloatArray, family: str, number: int) -> MeasuredCentre | None:
    """Return a coded target fitted to a patch (H, W), from the corners (4, 2) of its black square."""
    fields = _fields(family, number)
    half = 0.5 * (len(fields) - 2)
    square = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    H, _ = cv2.findHomography(corner, square)
    sides = np.linalg.norm(corner - np.roll(corner, 1, axis=0), axis=1)
    if H is None or sides.min() < 2.0 * half * LEAST_FIELD_PX:
        return None
    start = _centred(np.asarray(H, np.float64))
    low = np.maximum(np.floor(corner.min(axis=0)).astype(int) - 3, 0)
    high = np.minimum(np.ceil(corner.max(axis=0)).astype(int) + 4, np.array(grey.shape)[::-1])
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    place = np.column_stack([columns.ravel(), rows.ravel()])
    place = place[np.abs(_target_place(start, place.astype(np.float64))[0]).max(axis=1) < half + RIM]
    if len(place) < 40:
        return None
    own, exact = grey[place[:, 1], place[:, 0]], place.astype(np.float64)
    theta = np.concatenate([start, [0.7, float(np.percentile(own, 5)), float(np.percentile(own, 95))]])
    scale = np.concatenate([[0.1, 0.1], np.full(4, 0.01 * np.abs(start[2:6]).max()), [1e-4, 1e-4], [0.1, 2.0, 2.0]])
    free = np.full(8, np.inf)
    bounds = (np.array([*-free, 0.25, -200.0, -200.0]), np.array([*free, 6.0, 500.0, 500.0]))

    def misfit(t: FloatArray) -> FloatArray:
        return np.asarray(own - picture(fields, t, exact), np.float64)

    solution = least_squares(misfit, theta, x_scale=scale, method="trf", max_nfev=40, bounds=bounds)
    theta, residual = solution.x, solution.fun
    explained = 1.0 - float(residual @ residual) / max(float(((own - own.mean()) ** 2).sum()), 1e-9)
    contrast = float(theta[-1] - theta[-2])
    if explained < LEAST_EXPLAINED or contrast < LEAST_CONTRAST_DN:
        return None
    own_noise = centre_covariance(place, -np.asarray(solution.jac), residual, np.ones(len(own)), np.zeros(len(own)))
    covariance = MODEL_ERROR**2 * own_noise
    return MeasuredCentre(
        Kind.CODED,
        theta[:2].copy(),
        covariance,
        explained,
        float(sides.max()),
        contrast,
        (family, number),
    )


def _centred(H: FloatArray) -> FloatArray:
    """Return c, A and h (8,) of a homography (3, 3) from the photograph to a target whose centre is its origin."""
    inverse = np.linalg.inv(H)
    centre = inverse[:2, 2] / inverse[2, 2]
    shifted = H @ np.array([[1.0, 0.0, centre[0]], [0.0, 1.0, centre[1]], [0.0, 0.0, 1.0]])
    shifted /= shifted[2, 2]
    return np.concatenate([centre, shifted[:2, :2].ravel(), shifted[2, :2]])


def _target_place(theta: FloatArray, place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return where pixels (N, 2) lie in the target (N, 2), how many of its units a pixel is along its axes (N, 2), and
    the cosine (N,) of the angle between the directions of its edges."""
    r = place - theta[:2]
    A, h = theta[2:6].reshape(2, 2), theta[6:8]
    scale = 1.0 + r @ h
    q = (r @ A.T) / scale[:, None]
    gradient = (A[None] - q[:, :, None] * h[None, None, :]) / scale[:, None, None]
    unit = np.linalg.norm(gradient, axis=2)
    return q, unit, (gradient[:, 0] * gradient[:, 1]).sum(axis=1) / unit.prod(axis=1)


def _leaning(fields: FloatArray, distance: FloatArray, cosine: FloatArray) -> FloatArray:
    """Return how much more white (N,) pixels are than the products of their shares, because edges at a ``distance``
    (N, n − 1, 2), in standard deviations of the blur, cross at a ``cosine`` (N,): Pearson's series, as of picture."""
    corner = np.diff(np.diff(fields, axis=0), axis=1).T  # across x, across y
    density = np.exp(-0.5 * distance**2) / np.sqrt(2.0 * np.pi)
    hermite = (np.ones_like(distance), distance, distance**2 - 1.0, distance * (distance**2 - 3.0))
    gain = np.zeros(len(distance))
    for n, polynomial in enumerate(hermite, 1):
        part = density * polynomial
        gain += cosine**n / factorial(n) * ((part[:, :, 0] @ corner) * part[:, :, 1]).sum(axis=1)
    return gain


def picture(fields: FloatArray, theta: FloatArray, place: FloatArray) -> FloatArray:
    """Return the grey values (N,) that a code of ``fields`` (n, n) makes at ``place`` (N, 2).

    ``theta`` (11,) are centre, affine map to fields, h, blur px, dark and bright level DN.
    """
    q, unit, cosine = _target_place(theta, place)
    n = len(fields)
    line = np.arange(1, n) - 0.5 * n
    sigma = theta[_BLUR] * unit
    distance = (q[:, None, :] - line[None, :, None]) / sigma[:, None, :]
    past = ndtr(distance)
    ends = np.concatenate([np.ones((len(q), 1, 2)), past, np.zeros((len(q), 1, 2))], axis=1)
    share = ends[:, :-1] - ends[:, 1:]
    white = ((share[:, :, 1] @ fields) * share[:, :, 0]).sum(axis=1) + _leaning(fields, distance, cosine)
    return np.asarray(theta[9] + (theta[10] - theta[9]) * white)
