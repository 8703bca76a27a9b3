"""Orientations and descriptors of key points from the gradients around them (Lowe 2004, secs. 5 and 6).

The numbers are those of OpenCV's SIFT, its approximation of the arctangent among them (within 0.01 rad); weights are
products of those of rows and columns.
"""

import numpy as np

from photogram.arrays import ByteArray, Float32Array, Int32Array
from photogram.compilation import njit

_DIRECTIONS = 36  # of the histogram of orientations
_PEAK = 0.8  # of the highest: further orientations of a key point
_CELLS, _BINS = 4, 8  # of a descriptor: cells on a side, directions in each
_CLIPPED = 0.2  # share of a descriptor's length that one direction may have

_SIDE, _DEEP = _CELLS + 2, _BINS + 1  # with a margin, into which the outermost pixels reach

Float32 = np.float32


@njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _polar(dx: Float32Array, dy: Float32Array) -> None:
    """Replace the gradients (L,) by their lengths and their angles in degrees, from 0 to 360."""
    for n in range(len(dx)):
        x, y = dx[n], dy[n]
        ax, ay = abs(x), abs(y)
        small, large = (ay, ax) if ax >= ay else (ax, ay)
        c = small / (large + Float32(2.220446e-16))
        s = c * c
        a = ((Float32(-2.5397231) * s + Float32(8.9140005)) * s + Float32(-18.667446)) * s + Float32(57.283627)
        a = a * c
        a = a if ax >= ay else Float32(90.0) - a
        a = Float32(180.0) - a if x < Float32(0.0) else a
        dx[n] = np.sqrt(x * x + y * y)
        dy[n] = Float32(360.0) - a if y < Float32(0.0) else a


@njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _gather(
    picture: Float32Array, y: int, start: int, stop: int, factor: float, weight: Float32Array,
    dx: Float32Array, dy: Float32Array, share: Float32Array,
) -> None:  # fmt: skip
    """Fill the gradients (L,) of the columns ``start`` to ``stop`` of a row, and their weights: ``factor`` times those
    of the columns (L,)."""
    row, above, below = picture[y, start - 1 : stop + 1], picture[y - 1, start:stop], picture[y + 1, start:stop]
    for n in range(stop - start):
        dx[n] = row[n + 2] - row[n]
        dy[n] = above[n] - below[n]
        share[n] = Float32(factor) * weight[n]


@njit(cache=True, nogil=True)
def orientations(
    level: Float32Array, layer: Int32Array, pixel: Int32Array, sigma_px: Float32Array, largest_px: float,
    angle_deg: Float32Array,
) -> None:  # fmt: skip
    """Fill ``angle_deg`` (N, A) with the orientations of key points on the levels (3, H, W), NaN where there are no
    more; ``sigma_px`` (N,) is their scale in pixels of the level, ``largest_px`` the
    largest of them."""
    height, width = level.shape[1], level.shape[2]
    longest = 2 * int(np.ceil(4.5 * largest_px)) + 3
    room, weight = np.empty((3, longest**2), dtype=np.float32), np.empty(longest, dtype=np.float32)
    raw, smooth = np.empty(_DIRECTIONS, dtype=np.float32), np.empty(_DIRECTIONS, dtype=np.float32)
    for n in range(len(layer)):
        picture, y0, x0 = level[layer[n]], pixel[n, 0], pixel[n, 1]
        radius = round(4.5 * sigma_px[n])
        for i in range(-radius, radius + 1):
            weight[i + radius] = np.exp(-0.5 * (i / (1.5 * sigma_px[n])) ** 2)
        start, stop = max(x0 - radius, 1), min(x0 + radius, width - 2) + 1
        column_weight, count = weight[start - x0 + radius :], 0
        for y in range(max(y0 - radius, 1), min(y0 + radius, height - 2) + 1):
            factor = weight[y - y0 + radius]
            _gather(picture, y, start, stop, factor, column_weight, room[0, count:], room[1, count:], room[2, count:])
            count += stop - start
        _polar(room[0, :count], room[1, :count])
        for i in range(_DIRECTIONS):
            raw[i] = 0.0
        for i in range(count):
            direction = int(np.rint(room[1, i] * Float32(_DIRECTIONS / 360.0)))
            direction = direction - _DIRECTIONS if direction >= _DIRECTIONS else direction
            raw[direction] += room[2, i] * room[0, i]
        highest = Float32(0.0)
        for i in range(_DIRECTIONS):
            one = raw[(i - 1) % _DIRECTIONS] + raw[(i + 1) % _DIRECTIONS]
            two = raw[(i - 2) % _DIRECTIONS] + raw[(i + 2) % _DIRECTIONS]
            smooth[i] = two * Float32(1.0 / 16.0) + one * Float32(4.0 / 16.0) + raw[i] * Float32(6.0 / 16.0)
            highest = max(highest, smooth[i])
        count = 0
        for i in range(_DIRECTIONS):
            before, here, after = smooth[(i - 1) % _DIRECTIONS], smooth[i], smooth[(i + 1) % _DIRECTIONS]
            if here > before and here > after and here >= Float32(_PEAK) * highest and count < angle_deg.shape[1]:
                peak = (i + Float32(0.5) * (before - after) / (before - 2 * here + after)) % _DIRECTIONS
                turned = Float32(360.0 - 360.0 / _DIRECTIONS * peak)
                angle_deg[n, count] = 0.0 if turned >= 360.0 else turned
                count += 1
        for i in range(count, angle_deg.shape[1]):
            angle_deg[n, i] = np.nan


@njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _span(low: float, high: float, slope: float, offset: float) -> tuple[float, float]:
    """The least and greatest j for which slope · j + offset lies between low and high, and a little more."""
    if abs(slope) < 1e-9:
        return (-1e9, 1e9) if low < offset < high else (1.0, -1.0)
    a, b = (low - offset) / slope, (high - offset) / slope
    return (a, b) if a < b else (b, a)


@njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _bins(length: Float32Array, weight: Float32Array, angle: Float32Array, turned: float, at: Int32Array) -> None:
    """Weight the lengths (L,), turn angles into shares of the bin above, both in place, and fill the bin below."""
    zero, per_degree = Float32(turned), Float32(_BINS / 360.0)
    for n in range(len(length)):
        length[n] = length[n] * weight[n]
    for n in range(len(length)):
        direction = (angle[n] - zero) * per_degree
        below = np.floor(direction)
        at[n] = np.int32(below) & np.int32(_BINS - 1)
        angle[n] = direction - below


@njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _cells(
    row: Float32Array, column: Float32Array, cosine: float, sine: float, length: Float32Array, at: Int32Array
) -> None:
    """Turn rows and columns (L,) into shares of the cell below and to the right, in place; add to ``at`` the place of
    the cell, and leave nothing of the length of what lies outside of all."""
    middle, low, high = Float32(_CELLS / 2 - 0.5), Float32(-1.0), Float32(_CELLS)
    down, right = Float32(cosine), Float32(sine)
    for n in range(len(length)):
        i, j = row[n], column[n]
        y = j * right + i * down + middle
        x = j * down - i * right + middle
        within = (y > low) & (y < high) & (x > low) & (x < high)
        y, x = y if within else Float32(0.0), x if within else Float32(0.0)
        length[n] = length[n] if within else Float32(0.0)
        above, left = np.floor(y), np.floor(x)
        row[n], column[n] = y - above, x - left
        cell = (np.int32(above) + np.int32(1)) * np.int32(_SIDE) + np.int32(left) + np.int32(1)
        at[n] = np.int32(at[n] + cell * np.int32(_DEEP))


@njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _add(
    length: Float32Array, angle: Float32Array, row: Float32Array, column: Float32Array, at: Int32Array,
    cell: Float32Array,
) -> None:  # fmt: skip
    """Share lengths (L,) out among the cells and bins next to them, linearly."""
    for n in range(len(length)):
        lower = length[n] * row[n]
        upper = length[n] - lower
        lower_right, upper_right = lower * column[n], upper * column[n]
        lower_left, upper_left = lower - lower_right, upper - upper_right
        o, rest, k = angle[n], Float32(1.0) - angle[n], np.uint64(at[n])
        cell[k] += upper_left * rest
        cell[k + np.uint64(1)] += upper_left * o
        cell[k + np.uint64(_DEEP)] += upper_right * rest
        cell[k + np.uint64(_DEEP + 1)] += upper_right * o
        cell[k + np.uint64(_SIDE * _DEEP)] += lower_left * rest
        cell[k + np.uint64(_SIDE * _DEEP + 1)] += lower_left * o
        cell[k + np.uint64(_SIDE * _DEEP + _DEEP)] += lower_right * rest
        cell[k + np.uint64(_SIDE * _DEEP + _DEEP + 1)] += lower_right * o


@njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _histogram(
    picture: Float32Array, y0: int, x0: int, turned: float, sigma_px: float,
    weight: Float32Array, room: Float32Array, at: Int32Array, cell: Float32Array,
) -> None:  # fmt: skip
    """Fill ``cell``, 6 × 6 cells of 9 bins, a margin on all sides and after the last bin, with the gradients around a
    key point. ``weight``, ``room`` (5, L) and ``at`` (L,) are for what is counted on the way."""
    height, width = picture.shape
    wide = 3.0 * sigma_px
    radius = min(round(wide * np.sqrt(2.0) * (_CELLS + 1) * 0.5), int(np.hypot(height, width)))
    cosine, sine = np.cos(np.deg2rad(turned)) / wide, np.sin(np.deg2rad(turned)) / wide
    for i in range(-radius, radius + 1):
        weight[i + radius] = np.exp(-((i / wide) ** 2) / (0.5 * _CELLS**2))
    middle, count = _CELLS / 2 - 0.5, 0
    for y in range(max(y0 - radius, 1), min(y0 + radius, height - 2) + 1):
        i = y - y0
        a, b = _span(-1.0 - middle, _CELLS - middle, cosine, -i * sine)
        c, d = _span(-1.0 - middle, _CELLS - middle, sine, i * cosine)
        start = max(int(np.floor(max(a, c, -radius))) + x0, 1)
        stop = min(int(np.ceil(min(b, d, radius))) + x0, width - 2) + 1
        if stop <= start:
            continue
        column_weight, factor = weight[start - x0 + radius :], weight[i + radius]
        _gather(picture, y, start, stop, factor, column_weight, room[0, count:], room[1, count:], room[2, count:])
        row, column = room[3, count:], room[4, count:]
        for n in range(stop - start):
            row[n], column[n] = Float32(i), Float32(start - x0 + n)
        count += stop - start
    length, angle, row, column = room[0, :count], room[1, :count], room[3, :count], room[4, :count]
    _polar(length, angle)
    _bins(length, room[2, :count], angle, turned, at[:count])
    _cells(row, column, cosine, sine, length, at[:count])
    for n in range(len(cell)):
        cell[n] = 0.0
    _add(length, angle, row, column, at[:count], cell)


@njit(cache=True, nogil=True)
def descriptors(
    level: Float32Array, layer: Int32Array, pixel: Int32Array, sigma_px: Float32Array, largest_px: float,
    angle_deg: Float32Array, descriptor: ByteArray,
) -> None:  # fmt: skip
    """Fill ``descriptor`` (N, 128) with SIFT descriptors of key points on the levels (3, H, W); see orientations."""
    longest = 2 * int(np.ceil(10.7 * largest_px)) + 5
    room, weight = np.empty((5, longest**2), dtype=np.float32), np.empty(longest, dtype=np.float32)
    at = np.empty(longest**2, dtype=np.int32)
    cell = np.empty(_SIDE * _SIDE * _DEEP, dtype=np.float32)
    raw = np.empty(_CELLS * _CELLS * _BINS, dtype=np.float32)
    for n in range(len(layer)):
        turned = 360.0 - angle_deg[n]
        turned = 0.0 if turned >= 360.0 else turned
        _histogram(level[layer[n]], pixel[n, 0], pixel[n, 1], turned, sigma_px[n], weight, room, at, cell)
        count, square = 0, Float32(0.0)
        for i in range(1, _CELLS + 1):
            for j in range(1, _CELLS + 1):
                start = (i * _SIDE + j) * _DEEP
                cell[start] += cell[start + _BINS]
                for k in range(_BINS):
                    raw[count] = cell[start + k]
                    square += raw[count] * raw[count]
                    count += 1
        most, square = np.sqrt(square) * Float32(_CLIPPED), Float32(0.0)
        for i in range(len(raw)):
            raw[i] = min(raw[i], most)
            square += raw[i] * raw[i]
        scale = Float32(512.0) / max(np.sqrt(square), Float32(1.1920929e-07))
        for i in range(len(raw)):
            descriptor[n, i] = min(int(np.rint(raw[i] * scale)), 255)
