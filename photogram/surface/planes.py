"""The planes of the cells of a surface, and which neighbours hang together on them."""

import numpy as np

from photogram.arrays import ByteArray, Float32Array, Int32Array
from photogram.compilation import njit

REACH = 1.5
"""How far from the plane of a neighbour a cell of the same surface may lie, over the distance of the two."""

STEEPEST = 5.7
"""Rise over run of the steepest plane, 80°: what rises faster from cell to cell is a wall between two surfaces."""

NOISE_SIGMAS = 2.0
"""How many standard deviations of their difference neighbours may differ besides."""

LINK_REACH = 1.0
"""The same as REACH for neighbouring cells of one patch, where each must lie on the other's plane."""


@njit(inline="always")
def _gentler(behind: np.float32, ahead: np.float32, most: np.float32) -> np.float32:
    """Return the step of the gentler side, of ``most`` at most; 0 where neither is known."""
    step = ahead if np.isnan(behind) or abs(ahead) < abs(behind) else behind
    return np.float32(0.0) if np.isnan(step) else min(max(step, np.float32(-most)), most)


@njit(cache=True, nogil=True)
def _fill_slopes(height: Float32Array, most_m: float, out: Float32Array) -> None:
    rows, columns = height.shape
    most, across = np.float32(most_m), np.full(columns + 1, np.nan, np.float32)
    above, below = np.full(columns, np.nan, np.float32), np.empty(columns, np.float32)
    for r in range(rows):
        for c in range(1, columns):
            across[c] = height[r, c] - height[r, c - 1]
        for c in range(columns):
            below[c] = height[r + 1, c] - height[r, c] if r + 1 < rows else np.float32(np.nan)
        for c in range(columns):
            out[0, r, c] = _gentler(above[c], below[c], most)
        for c in range(columns):
            out[1, r, c] = _gentler(across[c], across[c + 1], most)
        above, below = below, above


def surface_slopes(height_m: Float32Array, cell_m: float) -> Float32Array:
    """Return the plane of each cell: what the surface rises by (2, rows, columns), m, to the next cell to the south and
    to the east. It is that of the gentler side: beside a wall, a cell lies on the plane of its own side."""
    out = np.empty((2, *height_m.shape), np.float32)
    _fill_slopes(height_m, STEEPEST * cell_m, out)
    return out


@njit(inline="always")
def _off(
    heights: tuple[float, float], first: tuple[float, float], other: tuple[float, float], down: float, right: float
) -> tuple[float, float]:  # fmt: skip
    """Return ``off_planes`` of two cells from their heights, their planes, and how far the second is from the first."""
    rise = heights[1] - heights[0]
    from_first = abs(rise - down * first[0] - right * first[1])
    from_other = abs(rise - down * other[0] - right * other[1])
    return min(abs(rise), from_first, from_other), min(abs(rise), max(from_first, from_other))


@njit(inline="always")
def off_planes(height: Float32Array, slope: Float32Array, r: int, c: int, rr: int, cc: int) -> tuple[float, float]:
    """Return how far two cells (r, c) and (rr, cc) lie from each other's planes, the nearer first; none is further than
    from the other's level. NaN where one of them has no height."""
    first, other = (slope[0, r, c], slope[1, r, c]), (slope[0, rr, cc], slope[1, rr, cc])
    return _off((height[r, c], height[rr, cc]), first, other, float(rr - r), float(cc - c))


@njit(cache=True, nogil=True)
def _fill_support(
    height: Float32Array, slope: Float32Array, sigma: Float32Array, reach_m: float, out: ByteArray
) -> None:
    """Of two cells each supports the other: every cell asks the next one and those of the next row. Parts of rows with
    indices from 0 on are what the compiler makes vectors of."""
    rows, columns = height.shape
    out[:] = 0
    near = np.empty(columns, np.uint8)
    for r in range(rows):
        for down, right in ((0, 1), (1, -1), (1, 0), (1, 1)):
            if r + down == rows:
                continue
            rr, n = r + down, columns - abs(right)
            at, to = max(-right, 0), max(right, 0)
            z, zz, s, ss = (
                height[r, at : at + n],
                height[rr, to : to + n],
                sigma[r, at : at + n],
                sigma[rr, to : to + n],
            )
            y, yy = slope[0, r, at : at + n], slope[0, rr, to : to + n]
            x, xx = slope[1, r, at : at + n], slope[1, rr, to : to + n]
            reach = reach_m * (np.sqrt(2.0) if down * right != 0 else 1.0)
            for c in range(n):
                off, _ = _off((z[c], zz[c]), (y[c], x[c]), (yy[c], xx[c]), float(down), float(right))
                near[c] = off < reach + NOISE_SIGMAS * np.sqrt(ss[c] ** 2 + s[c] ** 2)
            own, others = out[r, at : at + n], out[rr, to : to + n]
            for c in range(n):
                own[c] += near[c]
            for c in range(n):
                others[c] += near[c]


def support_of_cells(height_m: Float32Array, slope_m: Float32Array, sigma_m: Float32Array, cell_m: float) -> ByteArray:
    """Return how many neighbours of each cell (rows, columns) lie on one plane with it, within REACH, give or take
    their standard deviations; one without height has none. ``slope_m`` are the planes (2, rows, columns)."""
    out = np.empty(height_m.shape, np.uint8)
    _fill_support(height_m, slope_m, sigma_m, REACH * cell_m, out)
    return out


@njit(cache=True, nogil=True)
def _fill_patches(
    height: Float32Array, slope: Float32Array, allowed: Float32Array, reach_m: float, enough: int, out: Int32Array
) -> None:
    """A patch is followed until it has enough cells, or meets one that has."""
    rows, columns = height.shape
    out[:] = 0
    row, column = np.empty(enough + 8, np.int64), np.empty(enough + 8, np.int64)
    for start_row in range(rows):
        for start_column in range(columns):
            if out[start_row, start_column] != 0 or np.isnan(height[start_row, start_column]):
                continue
            row[0], column[0], count, done, size = start_row, start_column, 1, 0, 1
            out[start_row, start_column] = -1
            while done < count and size < enough:
                r, c = row[done], column[done]
                done += 1
                for k in range(9):
                    rr, cc = r + k // 3 - 1, c + k % 3 - 1
                    if k == 4 or not (0 <= rr < rows and 0 <= cc < columns) or out[rr, cc] == -1:
                        continue
                    reach = reach_m * (np.sqrt(2.0) if k % 2 == 0 else 1.0)
                    noise = np.sqrt(allowed[rr, cc] ** 2 + allowed[r, c] ** 2)
                    if not np.isnan(noise):
                        reach += noise
                    if off_planes(height, slope, r, c, rr, cc)[1] < reach:
                        if out[rr, cc] > 0:
                            size = enough
                            break
                        out[rr, cc] = -1
                        row[count], column[count] = rr, cc
                        count += 1
                        size = count
            for n in range(count):
                out[row[n], column[n]] = min(size, enough)


def cells_of_patches(
    height_m: Float32Array, slope_m: Float32Array, allowed_m: Float32Array, cell_m: float, enough: int
) -> Int32Array:
    """Return how many cells (rows, columns) the patch of each cell has, ``enough`` where it has more, 0 where there is
    no height: cells that are connected by neighbours, diagonal ones too, as LINK_REACH says. ``slope_m`` are the planes
    (2, rows, columns), ``allowed_m`` the standard deviations that may count besides, NaN for none."""
    out = np.empty(height_m.shape, np.int32)
    _fill_patches(height_m, slope_m, allowed_m, LINK_REACH * cell_m, enough, out)
    return out
