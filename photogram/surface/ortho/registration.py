"""How well one band of an orthophoto lies on another: shifts of patches by the correlation of their gradients.

Bands show the same edges in other grey values, brighter or darker, so that grey values themselves do not correlate; the
magnitudes of their gradients do. The shift of a patch is that of the largest correlation coefficient (ECC: Evangelidis
& Psarakis 2008), begun at the peak of the phase correlation of both (Kuglin & Hines 1975) and at no shift. Patches
without enough structure, those that correlate badly wherever they are shifted, and those that correlate nearly as well
in two places say nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import BoolArray, Float32Array, FloatArray

PATCH_CELLS = 128
"""Side of a patch."""
LEAST_CORRELATION = 0.5
"""Least correlation coefficient of the gradients of two patches."""
LEAST_STRUCTURE = 2.0
"""Least standard deviation of the gradients of a patch, grey values per cell."""
SAME_CELLS = 0.1
"""Between tops of the correlation from two starts that are one."""
CLEARLY = 0.1
"""By how much the better of two tops must correlate better to be the shift."""
FARTHEST_CELLS = 10.0
"""Shift beyond which a peak is no registration of two bands, but chance."""
_SMOOTH = 0.7
_ENOUGH = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)


@dataclass(frozen=True)
class Registration:
    """How a band lies on another, from ``patches``: the mean shift (east, north) and the root mean square per axis, in
    cells; NaN without patches. Of a shift to the east or north what both show lies farther there in the second."""

    patches: int
    mean_cells: tuple[float, float]
    rms_cells: float

    @staticmethod
    def of(shifts_cells: FloatArray) -> Registration:
        """Return the registration that shifts (n, 2), east and north, make."""
        if not len(shifts_cells):
            return Registration(0, (float("nan"), float("nan")), float("nan"))
        east, north = shifts_cells.mean(axis=0).tolist()
        return Registration(len(shifts_cells), (east, north), float(np.sqrt(np.mean(shifts_cells**2))))


def _gradient(grey: FloatArray) -> Float32Array:
    """Return the magnitude of the gradient of grey values (rows, columns), per cell."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTH)
    across, down = np.gradient(smooth, axis=1), np.gradient(smooth, axis=0)
    return np.asarray(np.hypot(across, down), dtype=np.float32)


def shift_of(first: FloatArray, second: FloatArray) -> FloatArray | None:
    """Return by how much the second of two patches (rows, columns) lies farther east and north (2,), in cells; None
    where they do not tell."""
    gradients = [_gradient(patch) for patch in (first, second)]
    if min(float(g.std()) for g in gradients) < LEAST_STRUCTURE:
        return None
    own, other = gradients
    taper = cv2.createHanningWindow((own.shape[1], own.shape[0]), cv2.CV_32F)
    peak, _ = cv2.phaseCorrelate(own - own.mean(), other - other.mean(), taper)
    tops = [top for start in (peak, (0.0, 0.0)) if (top := _top_near(own, other, *start)) is not None]
    if not tops:
        return None
    correlation, right, down = max(tops)
    rivals = [top for top in tops if np.hypot(top[1] - right, top[2] - down) > SAME_CELLS]
    if correlation < LEAST_CORRELATION or any(correlation - top[0] < CLEARLY for top in rivals):
        return None
    return None if np.hypot(right, down) > FARTHEST_CELLS else np.array([right, -down])


def _top_near(own: Float32Array, other: Float32Array, right: float, down: float) -> tuple[float, float, float] | None:
    """Return the largest correlation of two pictures near a shift, and its shift; None where there is none."""
    warp = np.array([[1.0, 0.0, right], [0.0, 1.0, down]], dtype=np.float32)
    try:
        correlation, warp = cv2.findTransformECC(own, other, warp, cv2.MOTION_TRANSLATION, _ENOUGH, None, 1)
    except cv2.error:
        return None  # no shift correlates better than its neighbours
    return float(correlation), float(warp[0, 2]), float(warp[1, 2])


def _patches(shape: tuple[int, int]) -> Iterator[tuple[slice, slice]]:
    for row in range(0, shape[0] - PATCH_CELLS + 1, PATCH_CELLS):
        for column in range(0, shape[1] - PATCH_CELLS + 1, PATCH_CELLS):
            yield slice(row, row + PATCH_CELLS), slice(column, column + PATCH_CELLS)


def shifts_in(first: FloatArray, second: FloatArray, shown: BoolArray) -> FloatArray:
    """Return the shifts (n, 2), east and north, of the patches of two bands (rows, columns) that are ``shown`` whole in
    both, and tell."""
    found = [
        shift
        for patch in _patches(shown.shape)
        if shown[patch].all() and (shift := shift_of(first[patch], second[patch])) is not None
    ]
    return np.array(found).reshape(-1, 2)
