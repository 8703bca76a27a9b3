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
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.grid import MapGrid, Window
from photogram.surface.nearest_heights import DIRECTIONS, steps_to_heights
from photogram.surface.planes import REACH, cells_of_patches, off_planes, support_of_cells, surface_slopes

HOLE, MEASURED, FILLED = 0, 1, 2
"""What a cell of the surface is."""

MEASURED_IN = {1: MEASURED, 2: 3, 4: 4, 8: 5}
"""The code of a measured cell by the side of the cells that it was measured in, in cells of the surface."""

WATER = 6
"""The code of a cell that lies on water: its height is the water's level, and not measured there."""

INTERPOLATED = 7
"""The code of a cell whose height is interpolated from heights farther off, or that do not lie on one plane with it."""


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

NOISE_CELLS = 1.0
"""No more than so many cells of a standard deviation count for that: in one of a face is that of its place, which its
neighbours share."""

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


def _sure_slopes(height_m: Float32Array, rays: ByteArray, cell_m: float) -> Float32Array:
    """Return the planes of cells as ``surface_slopes`` does, their slopes by the median of 3 × 3 cells on which
    SURE_RAYS photographs agree, others are level: a row that hangs between two surfaces has no plane of its own, and
    what two photographs agree on by chance has none."""
    slopes = surface_slopes(np.where(rays >= SURE_RAYS, height_m, np.float32(np.nan)), cell_m)
    for slope in slopes:
        slope[:] = cv2.medianBlur(slope, 3)
    return slopes


def patch_cells(
    height_m: Float32Array, sigma_m: Float32Array, rays: ByteArray, cell_m: float, enough: int
) -> Int32Array:
    """Return how many cells (rows, columns) the patch of each cell has, ``enough`` where it has more, 0 where there is
    no height: cells that are connected as ``cells_of_patches`` says. Where PATCH_RAYS agree on both of two, a standard
    deviation of their difference is allowed; with fewer it says nothing, for that of a match by chance is small."""
    allowed = np.where(rays >= PATCH_RAYS, sigma_m, np.float32(np.nan)).astype(np.float32)
    return cells_of_patches(height_m, _sure_slopes(height_m, rays, cell_m), allowed, cell_m, enough)


@njit(inline="always")
def _sureness(
    down_m: np.float32, right_m: np.float32, rays: np.uint8, seen: np.uint8, face: np.bool_, cell: np.float32
) -> tuple[np.bool_, float]:
    """Return whether a cell is sure, and the cosine of its slope, as ``sure_cells`` does."""
    down, right = float(down_m / cell), float(right_m / cell)
    cosine = 1.0 / np.sqrt(1.0 + (down * down + right * right))
    look = float(seen) * ((1.0 + cosine) / 2.0 if face else 1.0)
    return (rays >= SURE_RAYS) & (SURE_SHARE[1] * float(rays) >= SURE_SHARE[0] * look), cosine


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_sure(
    slope: Float32Array, rays: ByteArray, seen: ByteArray, face: BoolArray, cell: np.float32, sure: BoolArray,
    cosine: FloatArray,
) -> None:  # fmt: skip
    for r in range(rays.shape[0]):
        down, right, agree, look, smooth = slope[0, r], slope[1, r], rays[r], seen[r], face[r]
        is_sure, upright = sure[r], cosine[r]
        for c in range(len(agree)):
            is_sure[c], upright[c] = _sureness(down[c], right[c], agree[c], look[c], smooth[c], cell)


def sure_cells(
    height_m: Float32Array, rays: ByteArray, seen: ByteArray, face: BoolArray, cell_m: float
) -> tuple[BoolArray, FloatArray]:
    """Return on which cells (rows, columns) SURE_RAYS photographs agree, and SURE_SHARE of those that look, and the
    cosines of their slopes. Of the sky a smooth ``face`` sees (1 + cosine) / 2: the others that look see what is
    before it."""
    sure, cosine = np.empty(rays.shape, np.bool_), np.empty(rays.shape)
    _fill_sure(_sure_slopes(height_m, rays, cell_m), rays, seen, face, np.float32(cell_m), sure, cosine)
    return sure, cosine


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_agreed(
    height: Float32Array, slope: Float32Array, correlation: Float32Array, rays: ByteArray, seen: ByteArray,
    face: BoolArray, cell: np.float32, least: Float32Array, out: Float32Array,
) -> None:  # fmt: skip
    for r in range(rays.shape[0]):
        z, down, right, agree, look, smooth = height[r], slope[0, r], slope[1, r], rays[r], seen[r], face[r]
        alike, enough, kept = correlation[r], least[r], out[r]
        for c in range(len(agree)):
            sure, cosine = _sureness(down[c], right[c], agree[c], look[c], smooth[c], cell)
            outvoted = (agree[c] < 2) | ((agree[c] == 2) & (look[c] >= 2 + OUTVOTED))
            agreed = (alike[c] >= enough[c] * (cosine if sure else 1.0)) & (not outvoted)
            kept[c] = z[c] if agreed else np.float32(np.nan)


def _agreed_heights(
    height_m: Float32Array, correlation: Float32Array, rays: ByteArray, seen: ByteArray, face: BoolArray,
    cell_m: float, least: Float32Array | float,
) -> Float32Array:  # fmt: skip
    """Return the heights (rows, columns) on which enough photographs agree, that correlate by the ``least`` of all or
    of each cell. On a slope they see a window foreshortened, the texture in it finer: sure cells may correlate less
    there, by the cosine."""
    out, slope = np.empty(height_m.shape, np.float32), _sure_slopes(height_m, rays, cell_m)
    of_each = np.array(np.broadcast_to(least, height_m.shape), dtype=np.float32)
    _fill_agreed(height_m, slope, correlation, rays, seen, face, np.float32(cell_m), of_each, out)
    return out


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
        lone = (patch_cells(height, sigma_m, rays, cell_m, fewer) < fewer) & ~spared
        height = np.where(lone, np.float32(np.nan), height).astype(np.float32)
    return height


@njit(cache=True, nogil=True)
def _fill(height: Float32Array, slope: Float32Array, steps: ByteArray, reach_m: float, out: Float32Array) -> None:
    rows, columns = height.shape
    row, column, run = np.empty(8, np.int64), np.empty(8, np.int64), np.empty(8)
    for r in range(rows):
        for c in range(columns):
            out[r, c] = height[r, c]
            if not np.isnan(height[r, c]):
                continue
            met = 0
            for k, (dr, dc) in enumerate(DIRECTIONS):
                step = np.int64(steps[k, r, c])
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
    steps, slope = steps_to_heights(height_m, reach_cells), surface_slopes(height_m, cell_m)
    _fill(height_m, slope, steps, REACH * cell_m, out)
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
            e, n = slope[1, r, c], -slope[0, r, c]
            variance = e * e * six[0] + n * n * six[1] + six[2] + 2.0 * (e * n * six[3] - e * six[4] - n * six[5])
            out[r, c] = np.sqrt(max(variance, 0.0) + float(own[r, c]) ** 2)


def shared_plan_variance(shared: SharedError, grid: MapGrid, window: Window) -> FloatArray:
    """Return the sum of the variances (rows, columns) in easting and northing, m², that cells have in common."""
    row, column = _places_in(shared.grid, grid, window)
    plan = shared.covariance_m2[..., 0] + shared.covariance_m2[..., 1]
    last = np.array(plan.shape) - 1
    i, j = (np.clip(at, 0.0, most) for at, most in zip((row, column), last, strict=True))
    return np.asarray(map_coordinates(plan, np.stack(np.meshgrid(i, j, indexing="ij")), order=1, mode="nearest"))


def _places_in(wide: MapGrid, grid: MapGrid, window: Window) -> tuple[FloatArray, FloatArray]:
    """Return rows and columns of the centres of a window's cells in a wide grid, in its cells from its first centre."""
    east, north = grid.centres_map_m(window)
    return (wide.north_map_m - north) / wide.cell_m - 0.5, (east - wide.west_map_m) / wide.cell_m - 0.5


def surface_sigma_m(
    shared: SharedError, grid: MapGrid, window: Window, height_m: Float32Array, matching_sigma_m: Float32Array
) -> Float32Array:
    """Return the standard deviations (rows, columns), m, of heights at fixed places, NaN where there is none:
    σ² = σ_matching² + nᵀ Σ n with n = (−∂h/∂E, −∂h/∂N, 1), of the gentler side, Σ being what photographs and
    calibration contribute."""
    row, column = _places_in(shared.grid, grid, window)
    out = np.empty(height_m.shape, np.float32)
    slope = surface_slopes(height_m, grid.cell_m) / np.float32(grid.cell_m)
    _fill_sigma(shared.covariance_m2, row, column, height_m, slope, matching_sigma_m, out)
    return out
