"""From matched heights to a surface model: which cells are kept, how sure they are, how holes may be closed.

A cell is kept when the photographs agree on it as well as they do elsewhere, and when at least SUPPORT of its eight
neighbours lie within reach of it at the steepest slope, give or take their standard deviations: what hangs between a
roof and the ground has too few. Neighbours share most of their window, so one match by chance makes several cells that
support each other: a patch that stands alone and holds no more than a few windows needs a third photograph, and nearly
all that look at it.
"""

from dataclasses import dataclass

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

STEEPEST = 1.5
"""Rise over run up to which neighbouring cells belong to one surface."""

NOISE_SIGMAS = 2.0
"""How many standard deviations of their difference neighbours may differ besides."""

LINK_SLOPE = 1.0
"""Rise over run up to which neighbouring cells belong to one patch. Where three photographs agree on both, a standard
deviation of their difference is allowed besides; with two it says nothing, for that of a match by chance is small."""

LEAST_PATCH_CELLS = 50
"""Fewer connected cells than these hold no more than a few windows of 7 × 7 pixels (2.5 to 5 cells wide)."""

PATCH_RAYS, PATCH_DISSENT = 3, 1
"""In a smaller patch so many photographs must agree at least, and so many may look there and disagree: two agree by
chance on a window, and nobody objects."""

LEAST_WINDOW_CELLS = 9
"""Fewer connected cells than these are not even one window, whoever agrees on them."""

KEPT_MARGIN_CELLS = LEAST_PATCH_CELLS + LEAST_WINDOW_CELLS + 1
"""How far beyond a window heights must be known, so that what is kept of it does not depend on the window."""

OUTVOTED = 3
"""So many photographs that look at a cell and do not agree outvote two that do: a third of such heights are wrong."""

FILL_DIRECTIONS = 5
"""A hole is closed when it meets the surface in this many of eight directions."""

_NEAREST = 8


@njit(cache=True, nogil=True)
def _supported(height: Float32Array, sigma: Float32Array, rise_m: float, least: int, out: BoolArray) -> None:
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            near = 0
            for k in range(9):
                rr, cc = r + k // 3 - 1, c + k % 3 - 1
                if k != 4 and 0 <= rr < rows and 0 <= cc < columns:
                    run = np.sqrt(2.0) if k % 2 == 0 else 1.0
                    noise = NOISE_SIGMAS * np.sqrt(sigma[rr, cc] ** 2 + sigma[r, c] ** 2)
                    near += abs(height[rr, cc] - height[r, c]) < rise_m * run + noise
            out[r, c] = near >= least


def supported_cells(height_m: Float32Array, sigma_m: Float32Array, cell_m: float, least: int = SUPPORT) -> BoolArray:
    """Return which cells (rows, columns) have so many neighbours within reach at the steepest slope, give or take their
    standard deviations; those without height have none."""
    out = np.empty(height_m.shape, dtype=bool)
    _supported(height_m, sigma_m, STEEPEST * cell_m, least, out)
    return out


@njit(cache=True, nogil=True)
def _patch_cells(height: Float32Array, allowed: Float32Array, rise_m: float, out: Int32Array) -> None:
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
                reach = rise_m * (np.sqrt(2.0) if k % 2 == 0 else 1.0)
                noise = np.sqrt(allowed[rr, cc] ** 2 + allowed[r, c] ** 2)
                if not np.isnan(noise):
                    reach += noise
                if abs(height[rr, cc] - height[r, c]) < reach:
                    out[rr, cc] = -1
                    place[count] = rr * columns + cc
                    count += 1
        for n in range(count):
            out[place[n] // columns, place[n] % columns] = count


def patch_cells(height_m: Float32Array, sigma_m: Float32Array, rays: ByteArray, cell_m: float) -> Int32Array:
    """Return how many cells (rows, columns) the patch of each cell has, 0 where there is no height: cells that are
    connected by neighbours, diagonal ones too, as LINK_SLOPE says."""
    count = np.empty(height_m.shape, dtype=np.int32)
    allowed = np.where(rays >= PATCH_RAYS, sigma_m, np.float32(np.nan)).astype(np.float32)
    _patch_cells(height_m, allowed, LINK_SLOPE * cell_m, count)
    return count


def _agreed_heights(
    height_m: Float32Array, correlation: Float32Array, rays: ByteArray, seen: ByteArray, least: float
) -> Float32Array:
    """Return the heights (rows, columns) on which enough photographs agree."""
    outvoted = (rays == 2) & (seen >= 2 + OUTVOTED)
    agreed = (correlation >= least) & (rays >= 2) & ~outvoted
    return np.where(agreed, height_m, np.float32(np.nan)).astype(np.float32)


def rough_heights(
    height_m: Float32Array,
    sigma_m: Float32Array,
    correlation: Float32Array,
    rays: ByteArray,
    seen: ByteArray,
    cell_m: float,
    least: float,
) -> Float32Array:
    """Return the heights (rows, columns) of a coarser level on which photographs agree as ``filtered_heights`` says,
    with ROUGH_CORRELATION, and that ROUGH_SUPPORT neighbours confirm; the outermost cells lack neighbours."""
    height = _agreed_heights(height_m, correlation, rays, seen, max(least, ROUGH_CORRELATION))
    supported = supported_cells(height, sigma_m, cell_m, ROUGH_SUPPORT)
    return np.where(supported, height, np.float32(np.nan)).astype(np.float32)


def filtered_heights(
    height_m: Float32Array,
    sigma_m: Float32Array,
    correlation: Float32Array,
    rays: ByteArray,
    seen: ByteArray,
    cell_m: float,
    least: float,
) -> Float32Array:
    """Return the heights (rows, columns) without those that too few photographs or neighbours confirm: ``rays`` agree
    of those ``seen``, and two alone are not believed against OUTVOTED or more. In a patch of fewer than
    LEAST_PATCH_CELLS at least PATCH_RAYS must agree and no more than PATCH_DISSENT may not; one of fewer than
    LEAST_WINDOW_CELLS goes.

    The outermost cells of the arrays lack neighbours, and patches are cut off there: give KEPT_MARGIN_CELLS more on
    each side than are needed.
    """
    height = _agreed_heights(height_m, correlation, rays, seen, least)
    height = np.where(supported_cells(height, sigma_m, cell_m), height, np.float32(np.nan)).astype(np.float32)
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
def _fill(height: Float32Array, reach: int, rise_m: float, out: Float32Array) -> None:
    rows, columns = height.shape
    z, run = np.empty(8), np.empty(8)
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
                    z[met], run[met] = height[r + step * dr, c + step * dc], step * np.hypot(dr, dc)
                    met += 1
            if met < FILL_DIRECTIONS:
                continue
            low = 0
            for k in range(met):
                low = k if z[k] < z[low] else low
            total, weight = 0.0, 0.0
            for k in range(met):
                if z[k] - z[low] <= rise_m * (run[k] + run[low]):
                    total += z[k] / (run[k] * run[k])
                    weight += 1.0 / (run[k] * run[k])
            out[r, c] = total / weight


def filled_heights(height_m: Float32Array, cell_m: float, reach_cells: int) -> Float32Array:
    """Return heights whose holes are closed where the surface lies within ``reach_cells`` in most of eight directions.

    The height is the mean of what was met, weighted by the inverse square of the distance. What the photographs cannot
    see behind a wall is the ground, so what stands higher than the lowest by more than the steepest slope is left out.
    """
    out = np.empty_like(height_m)
    _fill(height_m, reach_cells, STEEPEST * cell_m, out)
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


@njit(inline="always")
def _gentler(behind: float, ahead: float) -> float:
    """Return the step of the gentler side; 0 where neither is known."""
    if np.isnan(behind) and np.isnan(ahead):
        return 0.0
    if np.isnan(behind) or abs(ahead) < abs(behind):
        return ahead
    return behind


@njit(cache=True, nogil=True)
def _fill_sigma(
    covariance: FloatArray, row: FloatArray, column: FloatArray, height: Float32Array, own: Float32Array,
    cell_m: float, out: Float32Array,
) -> None:  # fmt: skip
    """Fill the standard deviations of heights; ``row`` and ``column`` are those of the cells in the wide grid of
    ``covariance`` (R, C, 6), which is linear between its nodes."""
    rows, columns = height.shape
    last_i, last_j = covariance.shape[0] - 1, covariance.shape[1] - 1
    six = np.empty(6)
    for r in range(rows):
        down = min(max(row[r], 0.0), float(last_i))
        i = min(int(down), max(last_i - 1, 0))
        ii, down = min(i + 1, last_i), down - i
        for c in range(columns):
            z = float(height[r, c])
            if np.isnan(z):
                out[r, c] = np.nan
                continue
            right = min(max(column[c], 0.0), float(last_j))
            j = min(int(right), max(last_j - 1, 0))
            jj, right = min(j + 1, last_j), right - j
            for k in range(6):
                above = (1.0 - right) * covariance[i, j, k] + right * covariance[i, jj, k]
                below = (1.0 - right) * covariance[ii, j, k] + right * covariance[ii, jj, k]
                six[k] = (1.0 - down) * above + down * below
            west = z - height[r, c - 1] if c > 0 else np.nan
            east = height[r, c + 1] - z if c + 1 < columns else np.nan
            north = z - height[r - 1, c] if r > 0 else np.nan
            south = height[r + 1, c] - z if r + 1 < rows else np.nan
            e, n = _gentler(west, east) / cell_m, -_gentler(north, south) / cell_m
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
    _fill_sigma(shared.covariance_m2, row, column, height_m, matching_sigma_m, grid.cell_m, out)
    return out
