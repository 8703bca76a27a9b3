"""From matched heights to a surface model: which cells are kept, how sure they are, how holes may be closed.

A cell is kept when the photographs agree on it as well as they do elsewhere, and when at least SUPPORT of its eight
neighbours lie on one plane with it, give or take their standard deviations: what hangs between a roof and the ground
has too few, a steep face has all. Neighbours share most of their window, so one match by chance makes several cells
that support each other: a patch that stands alone and holds no more than a few windows needs a third photograph, and
nearly all that look at it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.grid import MapGrid, Window

HOLE, MEASURED, FILLED = 0, 1, 2
"""What a cell of the surface is."""

MEASURED_IN = {1: MEASURED, 2: 3, 4: 4, 8: 5}
"""The code of a measured cell by the side of the cells that it was measured in, in cells of the surface."""

WATER = 6
"""The code of a cell that lies on water: its height is the water's level, and not measured there."""


def measured_in(source: ByteArray) -> ByteArray:
    """Return the side (rows, columns) of the cells that each cell was measured in, in cells of the surface; 0 where it
    was not."""
    side = np.zeros(256, np.uint8)
    for cells, code in MEASURED_IN.items():
        side[code] = cells
    return side[source]


SUPPORT = 6
"""How many of its eight neighbours must lie within reach of a cell."""

ROUGH_SUPPORT, ROUGH_CORRELATION = 2, 0.75
"""The same in cells of coarser levels where the surface is rough, as in crowns: their standard deviations tell how far
the heights around differ, so that one that stands alone is not believed. Their photographs must show the same: on
asphalt, where they hardly do, heights that neighbours contradict are false."""

FACE_SUPPORT = 5
"""The same on faces, steep and smooth, whose rims are narrow."""

TOLD_CORRELATION = 0.3
"""What photographs must correlate by at least where pairs tell the same height: two that do not at all show nothing."""

REACH = 1.5
"""How far from the plane of a neighbour a cell of the same surface may lie, over the distance of the two."""

STEEPEST = 5.7
"""Rise over run of the steepest plane, 80°: what rises faster from cell to cell is a wall between two surfaces."""

NOISE_SIGMAS = 2.0
"""How many standard deviations of their difference neighbours may differ besides."""

NOISE_CELLS = 1.0
"""No more than so many cells of a standard deviation count for that: in one of a face is that of its place, which its
neighbours share."""

LINK_REACH = 1.0
"""The same for neighbouring cells of one patch, where each must lie on the other's plane. Where three photographs agree
on both, a standard deviation of their difference is allowed besides; with two it says nothing, for that of a match by
chance is small."""

LEAST_PATCH_CELLS = 50
"""Fewer connected cells than these hold no more than a few windows of 7 × 7 pixels (2.5 to 5 cells wide)."""

PATCH_RAYS, PATCH_DISSENT = 3, 1
"""In a smaller patch so many photographs must agree at least, and so many may look there and disagree: two agree by
chance on a window, and nobody objects."""

LEAST_WINDOW_CELLS = 9
"""Fewer connected cells than these are not even one window, whoever agrees on them."""

KEPT_MARGIN_CELLS = LEAST_PATCH_CELLS + LEAST_WINDOW_CELLS + 9
"""How far beyond a window heights must be known, so that what is kept of it does not depend on the window."""

SURE_RAYS, SURE_SHARE = 3, (2, 3)
"""So many photographs, and this share of those that look, agree on a height that nothing else need confirm. Of others
on the smooth ground of a real survey 2 % were false where the next coarser level did not say the same."""

OUTVOTED = 3
"""So many photographs that look at a cell and do not agree outvote two that do: a third of such heights are wrong."""

FILL_DIRECTIONS = 5
"""A hole is closed when it meets the surface in this many of eight directions."""

_NEAREST = 8


@njit(inline="always")
def _gentler(behind: float, ahead: float, most: float) -> float:
    """Return the step of the gentler side, of ``most`` at most; 0 where neither is known."""
    if np.isnan(behind) and np.isnan(ahead):
        return 0.0
    step = ahead if np.isnan(behind) or abs(ahead) < abs(behind) else behind
    return min(max(step, -most), most)


@njit(cache=True, nogil=True)
def _fill_slopes(height: Float32Array, most_m: float, out: Float32Array) -> None:
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            z = height[r, c]
            north = z - height[r - 1, c] if r > 0 else np.nan
            south = height[r + 1, c] - z if r + 1 < rows else np.nan
            west = z - height[r, c - 1] if c > 0 else np.nan
            east = height[r, c + 1] - z if c + 1 < columns else np.nan
            out[r, c, 0], out[r, c, 1] = _gentler(north, south, most_m), _gentler(west, east, most_m)


def surface_slopes(height_m: Float32Array, cell_m: float) -> Float32Array:
    """Return the plane of each cell: what the surface rises by (rows, columns, 2), m, to the next cell to the south and
    to the east. It is that of the gentler side: beside a wall, a cell lies on the plane of its own side."""
    out = np.empty((*height_m.shape, 2), np.float32)
    _fill_slopes(height_m, STEEPEST * cell_m, out)
    return out


def _sure_slopes(height_m: Float32Array, rays: ByteArray, cell_m: float) -> Float32Array:
    """Return the planes of cells as ``surface_slopes`` does, their slopes by the median of 3 × 3 cells on which
    SURE_RAYS photographs agree, others are level: a row that hangs between two surfaces has no plane of its own, and
    what two photographs agree on by chance has none."""
    slope = surface_slopes(np.where(rays >= SURE_RAYS, height_m, np.float32(np.nan)), cell_m)
    return np.asarray(cv2.medianBlur(slope, 3), np.float32)


@njit(inline="always")
def off_planes(height: Float32Array, slope: Float32Array, r: int, c: int, rr: int, cc: int) -> tuple[float, float]:
    """Return how far two cells (r, c) and (rr, cc) lie from each other's planes, the nearer first; none is further than
    from the other's level. NaN where one of them has no height."""
    rise, down, right = height[rr, cc] - height[r, c], rr - r, cc - c
    from_first = abs(rise - down * slope[r, c, 0] - right * slope[r, c, 1])
    from_other = abs(rise - down * slope[rr, cc, 0] - right * slope[rr, cc, 1])
    return min(abs(rise), from_first, from_other), min(abs(rise), max(from_first, from_other))


@njit(cache=True, nogil=True)
def _fill_support(
    height: Float32Array, slope: Float32Array, sigma: Float32Array, reach_m: float, out: ByteArray
) -> None:
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            near = 0
            for k in range(9):
                rr, cc = r + k // 3 - 1, c + k % 3 - 1
                if k != 4 and 0 <= rr < rows and 0 <= cc < columns:
                    run = np.sqrt(2.0) if k % 2 == 0 else 1.0
                    noise = NOISE_SIGMAS * np.sqrt(sigma[rr, cc] ** 2 + sigma[r, c] ** 2)
                    near += off_planes(height, slope, r, c, rr, cc)[0] < reach_m * run + noise
            out[r, c] = near


def support_of_cells(height_m: Float32Array, slope_m: Float32Array, sigma_m: Float32Array, cell_m: float) -> ByteArray:
    """Return how many neighbours of each cell (rows, columns) lie on one plane with it, within REACH, give or take
    their standard deviations; one without height has none. ``slope_m`` are the planes (rows, columns, 2)."""
    out = np.empty(height_m.shape, np.uint8)
    _fill_support(height_m, slope_m, sigma_m, REACH * cell_m, out)
    return out


@njit(cache=True, nogil=True)
def _patch_cells(
    height: Float32Array, slope: Float32Array, allowed: Float32Array, reach_m: float, out: Int32Array
) -> None:
    """Fill ``out`` with the size of the patch that each cell belongs to, 0 without a height; ``allowed`` is the
    standard deviation of a cell that may count, NaN where none may."""
    rows, columns = height.shape
    out[:] = 0
    place = np.empty(rows * columns, np.int64)
    for start in range(rows * columns):
        if out[start // columns, start % columns] != 0 or np.isnan(height[start // columns, start % columns]):
            continue
        place[0], count, done = start, 1, 0
        out[start // columns, start % columns] = -1
        while done < count:
            r, c = place[done] // columns, place[done] % columns
            done += 1
            for k in range(9):
                rr, cc = r + k // 3 - 1, c + k % 3 - 1
                if k == 4 or not (0 <= rr < rows and 0 <= cc < columns) or out[rr, cc] != 0:
                    continue
                reach = reach_m * (np.sqrt(2.0) if k % 2 == 0 else 1.0)
                noise = np.sqrt(allowed[rr, cc] ** 2 + allowed[r, c] ** 2)
                if not np.isnan(noise):
                    reach += noise
                if off_planes(height, slope, r, c, rr, cc)[1] < reach:
                    out[rr, cc] = -1
                    place[count] = rr * columns + cc
                    count += 1
        for n in range(count):
            out[place[n] // columns, place[n] % columns] = count


def patch_cells(height_m: Float32Array, sigma_m: Float32Array, rays: ByteArray, cell_m: float) -> Int32Array:
    """Return how many cells (rows, columns) the patch of each cell has, 0 where there is no height: cells that are
    connected by neighbours, diagonal ones too, as LINK_REACH says."""
    count = np.empty(height_m.shape, dtype=np.int32)
    allowed = np.where(rays >= PATCH_RAYS, sigma_m, np.float32(np.nan)).astype(np.float32)
    _patch_cells(height_m, _sure_slopes(height_m, rays, cell_m), allowed, LINK_REACH * cell_m, count)
    return count


def sure_cells(
    height_m: Float32Array, rays: ByteArray, seen: ByteArray, face: BoolArray, cell_m: float
) -> tuple[BoolArray, FloatArray]:
    """Return on which cells (rows, columns) SURE_RAYS photographs agree, and SURE_SHARE of those that look, and the
    cosines of their slopes. Of the sky a smooth ``face`` sees (1 + cosine) / 2: the others that look see what is
    before it."""
    slope = _sure_slopes(height_m, rays, cell_m) / np.float32(cell_m)
    cosine = 1.0 / np.sqrt(1.0 + (slope.astype(np.float64) ** 2).sum(axis=-1))
    look = seen * np.where(face, (1.0 + cosine) / 2.0, 1.0)
    return (rays >= SURE_RAYS) & (SURE_SHARE[1] * rays.astype(np.float64) >= SURE_SHARE[0] * look), cosine


def _agreed_heights(
    height_m: Float32Array, correlation: Float32Array, rays: ByteArray, seen: ByteArray, face: BoolArray,
    cell_m: float, least: Float32Array | float,
) -> Float32Array:  # fmt: skip
    """Return the heights (rows, columns) on which enough photographs agree, that correlate by the ``least`` of all or
    of each cell. On a slope they see a window foreshortened, the texture in it finer: sure cells may correlate less
    there, by the cosine."""
    outvoted = (rays == 2) & (seen >= 2 + OUTVOTED)
    sure, cosine = sure_cells(height_m, rays, seen, face, cell_m)
    agreed = (correlation >= least * np.where(sure, cosine, 1.0)) & (rays >= 2) & ~outvoted
    return np.where(agreed, height_m, np.float32(np.nan)).astype(np.float32)


def rough_heights(
    height_m: Float32Array,
    sigma_m: Float32Array,
    correlation: Float32Array,
    rays: ByteArray,
    seen: ByteArray,
    cell_m: float,
    least: Float32Array | float,
) -> Float32Array:
    """Return the heights (rows, columns) of a coarser level on which photographs agree as ``filtered_heights`` says,
    with ROUGH_CORRELATION, and that ROUGH_SUPPORT neighbours confirm; the outermost cells lack neighbours."""
    nowhere, enough = np.zeros(rays.shape, np.bool_), np.maximum(least, ROUGH_CORRELATION)
    height = _agreed_heights(height_m, correlation, rays, seen, nowhere, cell_m, enough)
    support = support_of_cells(height, _sure_slopes(height, rays, cell_m), sigma_m, cell_m)
    return np.where(support >= ROUGH_SUPPORT, height, np.float32(np.nan)).astype(np.float32)


def filtered_heights(
    height_m: Float32Array,
    sigma_m: Float32Array,
    correlation: Float32Array,
    rays: ByteArray,
    seen: ByteArray,
    face: BoolArray,
    told: BoolArray,
    cell_m: float,
    least: Float32Array | float,
) -> Float32Array:
    """Return the heights (rows, columns) without those that too few photographs or neighbours confirm: ``rays`` agree
    of those ``seen``, and two alone are not believed against OUTVOTED or more, unless pairs have ``told`` the same; of
    SUPPORT neighbours, or FACE_SUPPORT on a smooth ``face``. In a patch of fewer than LEAST_PATCH_CELLS at least
    PATCH_RAYS must agree and no more than PATCH_DISSENT may not; one of fewer than LEAST_WINDOW_CELLS goes.

    The outermost cells of the arrays lack neighbours, and patches are cut off there: give KEPT_MARGIN_CELLS more on
    each side than are needed.
    """
    agreed = _agreed_heights(height_m, correlation, rays, seen, face, cell_m, least)
    height = np.where(told & (rays >= 2) & (correlation >= TOLD_CORRELATION), height_m, agreed).astype(np.float32)
    sigma_m = np.minimum(sigma_m, np.float32(NOISE_CELLS * cell_m))
    support = support_of_cells(height, _sure_slopes(height, rays, cell_m), sigma_m, cell_m)
    height = np.where(support >= np.where(face, FACE_SUPPORT, SUPPORT), height, np.float32(np.nan)).astype(np.float32)
    sure = (rays >= PATCH_RAYS) & (seen.astype(np.int16) - rays <= PATCH_DISSENT)
    for fewer, spared in ((LEAST_PATCH_CELLS, sure), (LEAST_WINDOW_CELLS, np.zeros_like(sure))):
        lone = (patch_cells(height, sigma_m, rays, cell_m) < fewer) & ~spared
        height = np.where(lone, np.float32(np.nan), height).astype(np.float32)
    return height


@njit(cache=True, nogil=True)
def steps_to_height(height: Float32Array, r: int, c: int, dr: int, dc: int, reach: int) -> int:
    """Return after how many steps of (dr, dc) from cell (r, c) a height is met, 0 where none is within ``reach``."""
    for step in range(1, reach + 1):
        i, j = r + step * dr, c + step * dc
        if not (0 <= i < height.shape[0] and 0 <= j < height.shape[1]):
            return 0
        if not np.isnan(height[i, j]):
            return step
    return 0


@njit(cache=True, nogil=True)
def _fill(height: Float32Array, slope: Float32Array, reach: int, reach_m: float, out: Float32Array) -> None:
    rows, columns = height.shape
    row, column, run = np.empty(8, np.int64), np.empty(8, np.int64), np.empty(8)
    for r in range(rows):
        for c in range(columns):
            out[r, c] = height[r, c]
            if not np.isnan(height[r, c]):
                continue
            met = 0
            for k in range(9):
                dr, dc = k // 3 - 1, k % 3 - 1
                if k == 4:
                    continue
                step = steps_to_height(height, r, c, dr, dc, reach)
                if step > 0:
                    row[met], column[met], run[met] = r + step * dr, c + step * dc, step * np.hypot(dr, dc)
                    met += 1
            if met < FILL_DIRECTIONS:
                continue
            low = 0
            for k in range(met):
                low = k if height[row[k], column[k]] < height[row[low], column[low]] else low
            total, weight = 0.0, 0.0
            for k in range(met):
                off, _ = off_planes(height, slope, row[low], column[low], row[k], column[k])
                if off <= reach_m * (run[k] + run[low]):
                    total += height[row[k], column[k]] / (run[k] * run[k])
                    weight += 1.0 / (run[k] * run[k])
            out[r, c] = total / weight


def filled_heights(height_m: Float32Array, cell_m: float, reach_cells: int) -> Float32Array:
    """Return heights whose holes are closed where the surface lies within ``reach_cells`` in most of eight directions.

    Whether a cell that was met lies on a wall the cell behind it tells: heights must be known one further. The height
    is the mean of what was met, weighted by the inverse square of the distance. What the photographs cannot
    see behind a wall is the ground, so what is not on one plane with the lowest, within REACH, is left out.
    """
    out = np.empty_like(height_m)
    _fill(height_m, surface_slopes(height_m, cell_m), reach_cells, REACH * cell_m, out)
    return out


@dataclass(frozen=True, eq=False)
class SharedError:
    """Covariances (rows, columns, 6), m², of the surface as a whole at the nodes of a wide grid: what the errors of
    photographs and calibration do to it. The six are EE, NN, HH, EN, EH, NH."""

    grid: MapGrid
    covariance_m2: FloatArray


def shared_error(
    points_map_m: FloatArray, cameras_m2: FloatArray, grid: MapGrid, spacing_m: float, nearest: int = _NEAREST
) -> SharedError:
    """Return what errors of the photographs do to a surface, from the covariances (N, 3, 3) of tie points (N, 3): the
    mean of the ``nearest`` ones at every node."""
    corner = np.array([grid.west_map_m, grid.north_map_m])
    far = corner + np.array([grid.columns, -grid.rows]) * grid.cell_m
    wide = MapGrid.around(
        np.vstack([corner - spacing_m, corner + spacing_m, far - spacing_m, far + spacing_m]), spacing_m
    )
    east, north = wide.centres_map_m(wide.whole)
    nodes = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    count = min(nearest, len(points_map_m))
    _, near = cKDTree(points_map_m[:, :2]).query(nodes, k=list(range(1, count + 1)))
    mean = cameras_m2[near].mean(axis=1)
    six = np.stack([mean[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=-1)
    return SharedError(wide, six.reshape(wide.rows, wide.columns, 6))


@njit(cache=True, nogil=True)
def _fill_sigma(
    covariance: FloatArray, row: FloatArray, column: FloatArray, height: Float32Array, slope: Float32Array,
    own: Float32Array, out: Float32Array,
) -> None:  # fmt: skip
    """Fill the standard deviations of heights; ``slope`` is rise over run; ``row`` and ``column`` are those of the
    cells in the wide grid of ``covariance`` (R, C, 6), which is linear between its nodes."""
    rows, columns = height.shape
    last_i, last_j = covariance.shape[0] - 1, covariance.shape[1] - 1
    six = np.empty(6)
    for r in range(rows):
        down = min(max(row[r], 0.0), float(last_i))
        i = min(int(down), max(last_i - 1, 0))
        ii, down = min(i + 1, last_i), down - i
        for c in range(columns):
            if np.isnan(height[r, c]):
                out[r, c] = np.nan
                continue
            right = min(max(column[c], 0.0), float(last_j))
            j = min(int(right), max(last_j - 1, 0))
            jj, right = min(j + 1, last_j), right - j
            for k in range(6):
                above = (1.0 - right) * covariance[i, j, k] + right * covariance[i, jj, k]
                below = (1.0 - right) * covariance[ii, j, k] + right * covariance[ii, jj, k]
                six[k] = (1.0 - down) * above + down * below
            e, n = slope[r, c, 1], -slope[r, c, 0]
            variance = e * e * six[0] + n * n * six[1] + six[2] + 2.0 * (e * n * six[3] - e * six[4] - n * six[5])
            out[r, c] = np.sqrt(max(variance, 0.0) + float(own[r, c]) ** 2)


def surface_sigma_m(
    shared: SharedError, grid: MapGrid, window: Window, height_m: Float32Array, matching_sigma_m: Float32Array
) -> Float32Array:
    """Return the standard deviations (rows, columns), m, of heights at fixed places, NaN where there is none:
    σ² = σ_matching² + nᵀ Σ n with n = (−∂h/∂E, −∂h/∂N, 1), of the gentler side, Σ being what photographs and
    calibration contribute."""
    east, north = grid.centres_map_m(window)
    wide = shared.grid
    row = (wide.north_map_m - north) / wide.cell_m - 0.5
    column = (east - wide.west_map_m) / wide.cell_m - 0.5
    out = np.empty(height_m.shape, np.float32)
    slope = surface_slopes(height_m, grid.cell_m) / np.float32(grid.cell_m)
    _fill_sigma(shared.covariance_m2, row, column, height_m, slope, matching_sigma_m, out)
    return out
