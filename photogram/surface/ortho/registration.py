"""How well one band of an orthophoto lies on another: shifts of patches by the correlation of their gradients.

Bands show the same edges in other grey values, brighter or darker, so that grey values themselves do not correlate; the
magnitudes of their gradients do. The shift of a patch is that of the largest correlation coefficient: whole cells by
looking at all within reach, then refined (ECC: Evangelidis & Psarakis 2008). Patches without enough structure, those
that correlate badly wherever they are shifted, and those that correlate nearly as well at another shift, as rows of a
crop do, say nothing.
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
CLEARLY = 0.1
"""By how much the best shift must correlate better than any other top."""
FARTHEST_CELLS = 10
"""Shift along an axis up to which bands are looked for: what matches farther away is no registration, but chance."""
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
    own, other = (_gradient(patch) for patch in (first, second))
    if min(float(own.std()), float(other.std())) < LEAST_STRUCTURE:
        return None
    start = _only_top(own, other)
    if start is None:
        return None
    warp = np.array([[1.0, 0.0, start[0]], [0.0, 1.0, start[1]]], dtype=np.float32)
    try:
        correlation, warp = cv2.findTransformECC(own, other, warp, cv2.MOTION_TRANSLATION, _ENOUGH, None, 1)
    except cv2.error:
        return None  # no shift correlates better than its neighbours
    right, down = float(warp[0, 2]), float(warp[1, 2])
    is_there = max(abs(right - start[0]), abs(down - start[1])) <= 1.0
    return np.array([right, -down]) if is_there and correlation >= LEAST_CORRELATION else None


def _only_top(own: Float32Array, other: Float32Array) -> tuple[int, int] | None:
    """Return the whole shift, right and down, at which two pictures correlate clearly better than at any other top of
    the correlation within reach; None where there is none."""
    inner = own[FARTHEST_CELLS:-FARTHEST_CELLS, FARTHEST_CELLS:-FARTHEST_CELLS]
    correlation = cv2.matchTemplate(other, inner, cv2.TM_CCOEFF_NORMED)
    around = cv2.dilate(correlation, np.ones((3, 3), dtype=np.uint8))
    tops = np.argwhere(correlation == around)
    heights = correlation[tops[:, 0], tops[:, 1]]
    best = int(heights.argmax())
    rivals = np.delete(heights, best)
    if heights[best] < LEAST_CORRELATION or np.any(heights[best] - rivals < CLEARLY):
        return None
    row, column = (int(k) for k in tops[best])
    if not (0 < row < 2 * FARTHEST_CELLS and 0 < column < 2 * FARTHEST_CELLS):
        return None  # it may be higher beyond
    return column - FARTHEST_CELLS, row - FARTHEST_CELLS


def _patches(shape: tuple[int, int]) -> Iterator[tuple[slice, slice]]:
    for row in range(0, shape[0] - PATCH_CELLS + 1, PATCH_CELLS):
        for column in range(0, shape[1] - PATCH_CELLS + 1, PATCH_CELLS):
            yield slice(row, row + PATCH_CELLS), slice(column, column + PATCH_CELLS)


def shifts_in(first: FloatArray, second: FloatArray, shown: BoolArray) -> FloatArray:
    """Return the shifts (n, 2), east and north, of the patches of two bands (rows, columns) that are ``shown`` whole in
    both, and tell."""
    shifts = [
        shift
        for patch in _patches(shown.shape)
        if shown[patch].all() and (shift := shift_of(first[patch], second[patch])) is not None
    ]
    return np.array(shifts).reshape(-1, 2)
