"""Heights of a piece of ground from pairs of photographs, matched in the pictures and joined on the ground.

A steep face is small on the ground and large in the photographs that look at it. So where ground is steep, pairs of
photographs are matched in their own pictures (semi-global matching, Hirschmüller 2008, as OpenCV has it), and each cell
of the ground takes the height on which most pairs agree. It is not measured by this, but tells along which surface the
windows of all photographs lie (`tile_matching`).
"""

from typing import NamedTuple

import cv2
import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray
from photogram.compilation import njit
from photogram.grid import Verticals
from photogram.surface.dense.rectification import Picture, RectifiedPair, choose_pairs, rectified, rectify
from photogram.surface.views import Views

SPREAD_DN = 40.0
"""Standard deviation to which pictures are stretched."""


class Smoothness(NamedTuple):
    """Side of the window of the matching, and its penalties for each pixel of it."""

    block_px: int
    small_step: int
    large_step: int


TEXTURED, WEAK = Smoothness(3, 4, 24), Smoothness(5, 2, 12)
"""Of textured ground, and of ground on which photographs show little but their noise: costs of a larger window differ
less."""

NEAR_PX = 16
"""Pixels to each side of known disparities that are tried."""

SPECKLE_PX, UNIQUE_PERCENT, PREFILTER = 100, 10, 63
"""Fewer pixels of one surface are no heights, nor are those whose second best is so near; the cut of its gradients."""

PAIRS = 6
"""Pairs that are matched over a piece of ground at most."""

NODES = 5
"""Places along the sides of a piece of ground at which it is looked up."""


class StereoHeights(NamedTuple):
    """Heights (rows, columns) of a window over the base, in m, NaN where no pair has one, and how many pairs agree."""

    height_m: Float32Array
    pairs: ByteArray


def stereo_heights(
    views: Views, picture: Picture, reduction: int, lines: Verticals, near: Float32Array, bounds_m: tuple[float, float],
    agree_m: float, *, closely: bool = False, smoothness: Smoothness = TEXTURED,
) -> StereoHeights:  # fmt: skip
    """Return the heights of a window from pairs; they lie about ``near`` (rows, columns), between ``bounds_m``, and
    agree within ``agree_m``. Those ``closely`` around ``near`` alone are tried, NEAR_PX of disparity to each side, or
    all within the bounds."""
    rows, columns = near.shape
    at = np.ix_(*(np.linspace(0, n - 1, NODES).astype(int) for n in (rows, columns)))
    foot, up = lines.foot_world_m[at].reshape(-1, 3), lines.up[at].reshape(-1, 3)
    bottom, top = bounds_m
    middle = foot + near[at].reshape(-1, 1) * up
    bounds = np.concatenate([foot + bottom * up, foot + top * up])
    to_cell = _to_cell(lines, bottom, top)
    found = []
    for pair in choose_pairs(views, middle, PAIRS):
        geometry = rectify(views, pair, bounds, reduction, NEAR_PX if closely else None)
        if geometry is None:
            continue
        left, right = (rectified(views, geometry, side, picture, reduction) for side in (0, 1))
        known = _known_disparities(geometry, lines, near) if closely else None
        disparity = _disparities(geometry, left, right, known, smoothness)
        found.append(_pair_heights(disparity, geometry, to_cell, bounds_m, (rows, columns)))
    height, count = np.full((rows, columns), np.nan, np.float32), np.zeros((rows, columns), np.uint8)
    if found:
        _fill_agreed(np.stack(found), np.float32(agree_m), height, count)
    return StereoHeights(height, count)


def _stretched(picture: Float32Array) -> ByteArray:
    """Return a picture in bytes, of a mean of 127 and a standard deviation of SPREAD_DN; the mean for NaN, whose edge
    is none of the ground's."""
    known = picture[np.isfinite(picture)]
    if not len(known):
        return np.full(picture.shape, 127, np.uint8)
    mean, spread = float(known.mean()), max(float(known.std()), 0.5)
    value = np.clip(127.0 + (picture - mean) * (SPREAD_DN / spread), 0.0, 255.0)
    return np.asarray(np.nan_to_num(value, nan=127.0).astype(np.uint8))


def _disparities(
    pair: RectifiedPair, left: Float32Array, right: Float32Array, known: Float32Array | None, smoothness: Smoothness
) -> Float32Array:
    """Return the disparities (height, width) of the left picture, in pixels, NaN where there is none: all that the pair
    allows, or those near ``known`` ones, by which the right picture is moved before."""
    width = left.shape[1]
    column = np.arange(width, dtype=np.float32)[None, :]
    one, other = _stretched(left), _stretched(right)
    if known is None:
        found = _matched(one, other, 0, pair.disparities, smoothness)
    else:
        start = np.rint(known)
        moved = np.clip(column - start, 0, width - 1).astype(np.int64)
        other = np.ascontiguousarray(np.take_along_axis(other, moved, axis=1))
        found = start + _matched(one, other, -NEAR_PX, 2 * NEAR_PX, smoothness)
    partner = np.nan_to_num(column - found, nan=-1.0)
    at = np.clip(np.rint(partner), 0, width - 1).astype(np.int64)
    there = (partner >= 0) & np.isfinite(left) & np.isfinite(np.take_along_axis(right, at, axis=1))
    return np.where(there, found + np.float32(pair.first_disparity), np.float32(np.nan)).astype(np.float32)


def _matched(left: ByteArray, right: ByteArray, first: int, count: int, smoothness: Smoothness) -> Float32Array:
    """Return disparities (height, width) above ``first``, NaN where there is none: the first is what pictures without
    texture give."""
    block_px, small_step, large_step = smoothness
    matcher = cv2.StereoSGBM.create(
        minDisparity=first, numDisparities=count, blockSize=block_px, P1=small_step * block_px**2,
        P2=large_step * block_px**2, disp12MaxDiff=1, preFilterCap=PREFILTER, uniquenessRatio=UNIQUE_PERCENT,
        speckleWindowSize=SPECKLE_PX, speckleRange=1, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    raw = matcher.compute(left, right)
    return np.where(raw > 16 * first, raw.astype(np.float32) / np.float32(16.0), np.float32(np.nan))


def _known_disparities(pair: RectifiedPair, lines: Verticals, near: Float32Array) -> Float32Array:
    """Return the disparities (height, width) of a surface ``near`` (rows, columns) in the left picture, counted from
    the pair's first."""
    surface = lines.foot_world_m + near[..., None] * lines.up
    place = (surface - pair.position_world_m[0]) @ pair.rotation_world_from_rectified
    pixel = pair.focal_px * place[..., :2] / place[..., 2:] - np.array(pair.corner_px)
    disparity = pair.focal_px * pair.base_m / place[..., 2] - pair.first_disparity
    out = np.full((pair.size_px[1], pair.size_px[0]), np.nan, np.float32)
    _draw(np.ascontiguousarray(pixel), disparity, out)
    return out


@njit(cache=True, nogil=True)
def _draw(pixel: FloatArray, disparity: FloatArray, out: Float32Array) -> None:
    """Fill the disparities of what is nearest of a surface with places ``pixel`` (rows, columns, 2), and between and
    beside these in a row."""
    rows, columns = disparity.shape
    height, width = out.shape
    for r in range(rows):
        for c in range(columns):
            x, y, d = int(np.rint(pixel[r, c, 0])), int(np.rint(pixel[r, c, 1])), np.float32(disparity[r, c])
            for i in range(max(y - 1, 0), min(y + 2, height)):
                for j in range(max(x - 1, 0), min(x + 2, width)):
                    if not out[i, j] >= d:
                        out[i, j] = d
    last = np.float32(np.nan)
    for i in range(height):
        left = -1
        for j in range(width):
            if out[i, j] == out[i, j]:
                for k in range(left + 1, j):
                    share = np.float32((k - left) / (j - left))
                    before = out[i, left] if left >= 0 else out[i, j]
                    out[i, k] = before + share * (out[i, j] - before)
                left = j
        if left >= 0:
            for k in range(left + 1, width):
                out[i, k] = out[i, left]
            last = out[i, left]
        else:
            for k in range(width):
                out[i, k] = last if last == last else np.float32(0.0)


def _to_cell(lines: Verticals, bottom: float, top: float) -> tuple[FloatArray, FloatArray]:
    """Return the middle (3,) of a window in the world and coefficients (10, 3) that give row, column and height of
    places counted from there: exact to a thousandth of a cell, as far as a map curves."""
    rows, columns = lines.up.shape[:2]
    r, c = (np.unique(np.linspace(0, n - 1, 7).astype(int)) for n in (rows, columns))
    h = np.linspace(bottom, top, 3)
    row, column, height = (a.ravel() for a in np.meshgrid(r, c, h, indexing="ij"))
    place = lines.foot_world_m[row, column] + height[:, None] * lines.up[row, column]
    middle = place.mean(axis=0)
    target = np.column_stack([row, column, height])
    coefficients, *_ = np.linalg.lstsq(_terms(place - middle), target, rcond=None)
    return middle, np.ascontiguousarray(coefficients)


def _terms(p: FloatArray) -> FloatArray:
    x, y, z = p.T
    return np.column_stack([np.ones(len(p)), x, y, z, x * x, x * y, y * y, x * z, y * z, z * z])


def _pair_heights(
    disparity: Float32Array, pair: RectifiedPair, to_cell: tuple[FloatArray, FloatArray], bounds_m: tuple[float, float],
    shape: tuple[int, int],
) -> Float32Array:  # fmt: skip
    """Return the median height (rows, columns) of the pixels of a pair in each cell, NaN in one without; what lies out
    of bounds, as pictures without texture give it, is none."""
    middle, coefficients = to_cell
    out = np.full(shape, np.nan, np.float32)
    offset = pair.position_world_m[0] - middle
    scale = pair.focal_px * pair.base_m
    _fill_pair_heights(
        disparity, np.array(pair.corner_px, np.float64), pair.focal_px, scale, pair.rotation_world_from_rectified,
        offset, coefficients, bounds_m, out,
    )  # fmt: skip
    return out


@njit(cache=True, nogil=True)
def _fill_pair_heights(
    disparity: Float32Array, corner: FloatArray, focal: float, scale: float, rotation: FloatArray, offset: FloatArray,
    coefficients: FloatArray, bounds_m: tuple[float, float], out: Float32Array,
) -> None:  # fmt: skip
    rows, columns = out.shape
    height, width = disparity.shape
    cell = np.full(height * width, -1, np.int64)
    value = np.empty(height * width, np.float32)
    begin = np.zeros(rows * columns + 1, np.int64)
    t = np.empty(10)
    t[0] = 1.0
    for i in range(height):
        for j in range(width):
            d = disparity[i, j]
            if not d > 0.0:
                continue
            depth = scale / d
            a, b = (j + corner[0]) / focal * depth, (i + corner[1]) / focal * depth
            x = offset[0] + rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * depth
            y = offset[1] + rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * depth
            z = offset[2] + rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * depth
            t[1], t[2], t[3], t[4], t[5] = x, y, z, x * x, x * y
            t[6], t[7], t[8], t[9] = y * y, x * z, y * z, z * z
            r, c, h = 0.0, 0.0, 0.0
            for k in range(10):
                r += t[k] * coefficients[k, 0]
                c += t[k] * coefficients[k, 1]
                h += t[k] * coefficients[k, 2]
            ri, ci = int(np.floor(r + 0.5)), int(np.floor(c + 0.5))
            if 0 <= ri < rows and 0 <= ci < columns and bounds_m[0] <= h <= bounds_m[1]:
                n = i * width + j
                cell[n] = ri * columns + ci
                value[n] = h
                begin[cell[n] + 1] += 1
    for n in range(rows * columns):
        begin[n + 1] += begin[n]
    end, sorted_ = begin[:-1].copy(), np.empty(begin[-1], np.float32)
    for n in range(height * width):
        if cell[n] >= 0:
            at = end[cell[n]]
            while at > begin[cell[n]] and sorted_[at - 1] > value[n]:
                sorted_[at] = sorted_[at - 1]
                at -= 1
            sorted_[at] = value[n]
            end[cell[n]] += 1
    for n in range(rows * columns):
        count = begin[n + 1] - begin[n]
        if count > 0:
            middle = begin[n] + (count - 1) // 2
            out[n // columns, n % columns] = 0.5 * (sorted_[middle] + sorted_[begin[n] + count // 2])


@njit(cache=True, nogil=True)
def _fill_agreed(heights: Float32Array, reach: np.float32, out: Float32Array, pairs: ByteArray) -> None:
    """Fill the mean of most heights (K, rows, columns) of a cell within ``reach`` of each other, of two such groups the
    tighter, and how many these are."""
    most, rows, columns = heights.shape
    value = np.empty(most, np.float32)
    for r in range(rows):
        for c in range(columns):
            known = 0
            for k in range(most):
                h = heights[k, r, c]
                if h == h:
                    at = known
                    while at > 0 and value[at - 1] > h:
                        value[at] = value[at - 1]
                        at -= 1
                    value[at] = h
                    known += 1
            best, width, last = 0, np.float32(np.inf), 0
            for first in range(known):
                while last < known and value[last] - value[first] <= reach:
                    last += 1
                count, spread = last - first, value[last - 1] - value[first]
                if count > best or (count == best and spread < width):
                    best, width = count, spread
                    out[r, c] = value[first:last].mean()
            pairs[r, c] = best
