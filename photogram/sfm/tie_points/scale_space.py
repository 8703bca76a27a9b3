"""Scale space of a picture and its extrema: where SIFT finds key points (Lowe 2004, secs. 3 and 4).

The numbers are those of OpenCV's SIFT, whose filters make the levels. OpenCV makes them anew to describe what it has
found, and orients and describes all of it or nothing; here they stay until that is done, and what is not wanted is not
oriented. Differences of levels are taken row by row where they are looked at.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit

LEVELS = 3
"""Scales of an octave at which key points are found."""

_FIRST_SIGMA = 1.6  # of an octave, in its pixels
_GIVEN_SIGMA = 1.0  # of the doubled picture as it is
_EDGE_RATIO = 10.0  # of the principal curvatures, at most (Lowe 2004, sec. 4.1)
_STEPS = 5  # of the place's refinement
_BORDER = 5  # px, in which nothing is looked for


@dataclass(frozen=True, eq=False)
class Octave:
    """One octave of a scale space, every pixel ``step`` pixels of the doubled picture: ``level`` (3, H, W) are those on
    which key points are found, ``outer`` (3, H, W) the one below and the two above."""

    step: int
    level: Float32Array
    outer: Float32Array


def _blurs() -> list[float]:
    """Return the standard deviations by which a level differs from the one before."""
    factor = 2.0 ** (1.0 / LEVELS)
    before = [_FIRST_SIGMA * factor**k for k in range(LEVELS + 2)]
    return [float(np.sqrt((factor * sigma) ** 2 - sigma**2)) for sigma in before]


def octaves(grey: ByteArray, largest_px: float, *, inner_only: bool = False) -> Iterator[Octave]:
    """Yield the octaves of the doubled picture, as long as they hold key points smaller than ``largest_px`` pixels of
    the picture (H, W); with ``inner_only`` not what lies above the levels, where nothing comes after.

    The arrays ``outer`` are used again for the next octave.
    """
    height, width = (2 * length for length in grey.shape)
    base = cv2.warpAffine(
        grey.astype(np.float32), np.array([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]], dtype=np.float32), (width, height),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT,
    )  # fmt: skip
    sigma = float(np.sqrt(_FIRST_SIGMA**2 - _GIVEN_SIGMA**2))
    cv2.GaussianBlur(base, (0, 0), sigma, dst=base, sigmaY=sigma)
    room = np.empty(3 * height * width, dtype=np.float32)
    step = 1
    while min(height, width) > 2 * _BORDER and _FIRST_SIGMA * 2.0 ** (0.5 / LEVELS) * step < largest_px:
        outer = room[: 3 * height * width].reshape(3, height, width)
        level = np.empty((LEVELS, height, width), dtype=np.float32)
        outer[0] = base
        targets = [*level, *outer[1:]]
        before = base
        for target, sigma in zip(targets[: LEVELS if inner_only else None], _blurs(), strict=False):
            cv2.GaussianBlur(before, (0, 0), sigma, dst=target, sigmaY=sigma)
            before = target
        yield Octave(step, level, outer)
        base = np.ascontiguousarray(level[-1, : height // 2 * 2 : 2, : width // 2 * 2 : 2])
        height, width = base.shape
        step *= 2


@njit(cache=True, nogil=True, _nrt=False)
def _row_of_difference(
    upper: Float32Array, lower: Float32Array, difference: Float32Array, high: Float32Array, low: Float32Array
) -> None:
    """Fill a row of the difference of two levels, and the greatest and least of each pixel and its two neighbours."""
    for x in range(len(difference)):
        difference[x] = upper[x] - lower[x]
    left, middle, right, top, bottom = difference[:-2], difference[1:-1], difference[2:], high[1:-1], low[1:-1]
    for x in range(len(middle)):
        a, b, c = left[x], middle[x], right[x]
        greater, smaller = (a, b) if a > b else (b, a)
        top[x] = c if c > greater else greater
        bottom[x] = c if c < smaller else smaller


@njit(cache=True, nogil=True, _nrt=False)
def _greatest(one: Float32Array, two: Float32Array, three: Float32Array, result: Float32Array) -> None:
    """Fill the greatest of three rows."""
    for x in range(len(result)):
        greater = one[x] if one[x] > two[x] else two[x]
        result[x] = three[x] if three[x] > greater else greater


@njit(cache=True, nogil=True, _nrt=False)
def _least(one: Float32Array, two: Float32Array, three: Float32Array, result: Float32Array) -> None:
    """Fill the least of three rows."""
    for x in range(len(result)):
        smaller = one[x] if one[x] < two[x] else two[x]
        result[x] = three[x] if three[x] < smaller else smaller


@njit(cache=True, nogil=True, _nrt=False)
def _mark(value: Float32Array, high: Float32Array, low: Float32Array, least: float, marked: ByteArray) -> None:
    """Fill 1 where a row is as great, or as small, as the greatest or least around it, 0 elsewhere."""
    limit = np.float32(least)
    for x in range(len(value)):
        v = value[x]
        peak, pit = (v > limit) & (v >= high[x]), (v < -limit) & (v <= low[x])
        marked[x] = np.uint8(peak | pit)


@njit(cache=True, nogil=True, _nrt=False)
def _extrema(
    level: Float32Array, outer: Float32Array, least: float, room: Float32Array, marked: ByteArray, index: Int32Array
) -> int:
    """Fill ``index`` (N, 3) with level, row, column of the extrema of an octave; return their number, which may be more
    than there is room for. ``room`` (3, 5, 4, W) and ``marked``, W zeros and as many more as make eights, are for what
    is counted on the way."""
    height, width = level.shape[1], level.shape[2]
    difference, high, low = room[0], room[1], room[2]
    top, bottom = difference[0, 3], difference[1, 3]
    eight = marked.view(np.uint64)
    count = 0
    for y in range(_BORDER - 1, height - _BORDER + 1):
        slot = y % 3
        for k in range(LEVELS + 2):
            upper = level[k, y] if k < LEVELS else outer[k - LEVELS + 1, y]
            below = level[k - 1, y] if k <= LEVELS else outer[1, y]
            lower = outer[0, y] if k == 0 else below
            _row_of_difference(upper, lower, difference[k, slot], high[k, slot], low[k, slot])
            _greatest(high[k, 0], high[k, 1], high[k, 2], high[k, 3])
            _least(low[k, 0], low[k, 1], low[k, 2], low[k, 3])
        if y < _BORDER + 1:
            continue
        for k in range(LEVELS):
            _greatest(high[k, 3], high[k + 1, 3], high[k + 2, 3], top)
            _least(low[k, 3], low[k + 1, 3], low[k + 2, 3], bottom)
            _mark(difference[k + 1, (y - 1) % 3], top, bottom, least, marked)
            for start in range(len(eight)):
                if eight[start] == 0:
                    continue
                for x in range(max(8 * start, _BORDER), min(8 * start + 8, width - _BORDER)):
                    if marked[x] != 0:
                        if count < len(index):
                            index[count, 0], index[count, 1], index[count, 2] = k + 1, y - 1, x
                        count += 1
    return count


@njit(cache=True, nogil=True)
def _difference(level: Float32Array, outer: Float32Array, k: int, y: int, x: int) -> float:
    """The difference ``k`` of the levels at a pixel."""
    if k == 0:
        return np.float64(level[0, y, x] - outer[0, y, x])
    if k < LEVELS:
        return np.float64(level[k, y, x] - level[k - 1, y, x])
    if k == LEVELS:
        return np.float64(outer[1, y, x] - level[LEVELS - 1, y, x])
    return np.float64(outer[2, y, x] - outer[1, y, x])


@njit(cache=True, nogil=True)
def _refined(level: Float32Array, outer: Float32Array, contrast: float, index: Int32Array, place: FloatArray) -> None:
    """Move extrema (N, 3) to the pixel of the parabola's extremum (Brown & Lowe 2002), and fill ``place`` (N, 4): scale
    and row and column there, and response; the scale is NaN where there is none, its contrast is too small, or it lies
    on an edge."""
    height, width = level.shape[1], level.shape[2]
    cube = np.empty((3, 3, 3))
    for n in range(len(index)):
        place[n, 0] = np.nan
        k, y, x = index[n]
        for _ in range(_STEPS):
            for i in range(3):
                for j in range(3):
                    for m in range(3):
                        cube[i, j, m] = _difference(level, outer, k + i - 1, y + j - 1, x + m - 1) / 255.0
            centre = cube[1, 1, 1]
            gx, gy = (cube[1, 1, 2] - cube[1, 1, 0]) / 2.0, (cube[1, 2, 1] - cube[1, 0, 1]) / 2.0
            gs = (cube[2, 1, 1] - cube[0, 1, 1]) / 2.0
            xx = cube[1, 1, 2] + cube[1, 1, 0] - 2.0 * centre
            yy = cube[1, 2, 1] + cube[1, 0, 1] - 2.0 * centre
            ss = cube[2, 1, 1] + cube[0, 1, 1] - 2.0 * centre
            xy = (cube[1, 2, 2] - cube[1, 2, 0] - cube[1, 0, 2] + cube[1, 0, 0]) / 4.0
            xs = (cube[2, 1, 2] - cube[2, 1, 0] - cube[0, 1, 2] + cube[0, 1, 0]) / 4.0
            ys = (cube[2, 2, 1] - cube[2, 0, 1] - cube[0, 2, 1] + cube[0, 0, 1]) / 4.0
            a, b, c = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - yy * xs
            determinant = xx * a + xy * b + xs * c
            if determinant == 0.0:
                break
            dx = -(a * gx + b * gy + c * gs) / determinant
            dy = -(b * gx + (xx * ss - xs * xs) * gy + (xy * xs - xx * ys) * gs) / determinant
            ds = -(c * gx + (xy * xs - xx * ys) * gy + (xx * yy - xy * xy) * gs) / determinant
            if abs(dx) < 0.5 and abs(dy) < 0.5 and abs(ds) < 0.5:
                response = abs(centre + 0.5 * (gx * dx + gy * dy + gs * ds))
                trace, flat = xx + yy, xx * yy - xy * xy
                sharp = trace * trace * _EDGE_RATIO < (_EDGE_RATIO + 1.0) ** 2 * flat
                if response * LEVELS >= contrast and flat > 0.0 and sharp:
                    place[n, 0], place[n, 1], place[n, 2], place[n, 3] = k + ds, y + dy, x + dx, response
                    index[n, 0], index[n, 1], index[n, 2] = k, y, x
                break
            if not (abs(dx) < 1e6 and abs(dy) < 1e6 and abs(ds) < 1e6):
                break
            k, y, x = k + round(ds), y + round(dy), x + round(dx)
            within = _BORDER <= x < width - _BORDER and _BORDER <= y < height - _BORDER
            if not (within and 1 <= k <= LEVELS):
                break


@dataclass(frozen=True, eq=False)
class Extrema:
    """Extrema of one octave: the level (N,), 0 to 2, and pixel (N, 2), row and column, on which each lies, and
    ``place`` (N, 4): column and row in pixels of the picture, size in px, response."""

    level: Int32Array
    pixel: Int32Array
    place: FloatArray


def extrema(octave: Octave, contrast: float) -> Extrema:
    """Return the extrema of an octave that have at least the ``contrast``, on grey values of 0 to 1, every one once."""
    least = float(np.floor(0.5 * contrast / LEVELS * 255.0))
    _, height, width = octave.level.shape
    rows, marked = np.zeros((3, LEVELS + 2, 4, width), dtype=np.float32), np.zeros(width + -width % 8, dtype=np.uint8)
    most = height * width // 50 + 100
    while True:
        index = np.empty((most, 3), dtype=np.int32)
        count = _extrema(octave.level, octave.outer, least, rows, marked, index)
        if count <= most:
            break
        most = count
    index = index[:count]
    place = np.empty((count, 4))
    _refined(octave.level, octave.outer, contrast, index, place)
    good = np.isfinite(place[:, 0])
    shape = octave.level.shape
    pixel = np.ravel_multi_index((index[good, 0] - 1, index[good, 1], index[good, 2]), shape)
    at = np.unique(pixel, return_index=True)[1]  # several may have moved to one place
    index = index[good][at]
    scale, row, column, response = place[good][at].T
    size = octave.step * _FIRST_SIGMA * 2.0 ** (scale / LEVELS)
    return Extrema(
        index[:, 0] - 1,
        np.ascontiguousarray(index[:, 1:]),
        np.column_stack([0.5 * octave.step * column, 0.5 * octave.step * row, size, response]),
    )
