"""One surface from several levels of matching: each cell is taken from the finest one that tells its height.

A window of the finest level holds some cells; where nothing in it agrees between the photographs (crowns, low texture,
the water's edge), a window of two, four or eight times the side may. Its height is that of a wider piece of ground, and
the cell's own may be any of those there: the variance is the mean square of the differences between it and the heights
around, finer ones where there are any, and that of the matching at least. Its own error is in these differences. Beside
a wall they are the step, on level ground next to nothing.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from photogram.arrays import BoolArray, ByteArray, Float32Array
from photogram.compilation import njit
from photogram.surface.dsm import SURE_RAYS, sure_cells
from photogram.surface.planes import REACH, off_planes, surface_slopes

HALF = (1, 2)
"""Share of the photographs that look at a rough surface which must agree there."""

WINDOW_HALF = 2
"""Cells of a level to each side of one whose heights tell how the surface strays from it: a window of the matching.
Their weights fall linearly to none at the next."""

MOSTLY_FINEST, STEEP_CELLS = 0.5, 2.0
"""Where the finest level has so much of the surface around a cell, and heights differ by so many cells of the level,
its height is that of one side of a wall that the finest level shows better, and not taken."""

AROUND_HALF, FINEST_SHARE, NEAR_CELLS = 32, 0.6, 2.0
"""Where the finest level has more than this share of the steep ground up to AROUND_HALF cells to each side, a larger
cell must lie within NEAR_CELLS of what several pairs of photographs tell: most others were wrong on simulated faces. In
leaves, where the finest level has a third, pairs tell no more than it does."""


def margin_cells(coarser: Iterable[int]) -> int:
    """Return how far beyond a window heights must be known, in cells of the finest level, so that what is taken there
    does not depend on the window; ``coarser`` are the sides of the cells of all others that are asked."""
    return (WINDOW_HALF + 2) * sum(coarser) + AROUND_HALF


@dataclass(frozen=True, eq=False)
class LevelHeights:
    """What one level tells of a window, (rows, columns) of its own cells each: heights that are kept, in m over the
    base, NaN elsewhere, their standard deviations in m, their correlations, the number of photographs that agree, and
    of those that were looked at. Where smooth ground is a ``face`` no larger cell tells its height; where it is
    ``steep`` pairs of photographs were asked, and ``pairs_m`` are the heights on which several agree, NaN elsewhere: in
    no cell of a coarser level.

    ``cells`` is the side of one of its cells in cells of the finest level; ``row`` and ``column`` are those of the
    window's first cell in the grid of the level.
    """

    height_m: Float32Array
    sigma_m: Float32Array
    correlation: Float32Array
    rays: ByteArray
    seen: ByteArray
    cells: int
    row: int
    column: int
    face: BoolArray
    steep: BoolArray
    pairs_m: Float32Array


@dataclass(frozen=True, eq=False)
class LevelSurface:
    """Heights (rows, columns) of a window from whichever level, in m over the base, NaN in holes; their standard
    deviations, correlations, numbers of photographs that agree and of those that were looked at, and the side of the
    cells that they were matched in, in cells of the finest level, 0 in holes."""

    height_m: Float32Array
    sigma_m: Float32Array
    correlation: Float32Array
    rays: ByteArray
    seen: ByteArray
    cells: ByteArray


@njit(cache=True, nogil=True)
def _fill_moments(
    fine: Float32Array, place: tuple[int, int, int], coarse: Float32Array, share: Float32Array, mean: Float32Array,
    variance: Float32Array,
) -> None:  # fmt: skip
    """Fill the share of each coarser cell whose heights are known, their mean and their variance: finer ones where
    there are any, its own elsewhere. ``place`` are row and column of the first finer cell from the corner of the
    coarser ones, and the side of those, in finer cells."""
    top, left, cells = place
    rows, columns = coarse.shape
    for i in range(rows):
        for j in range(columns):
            zero, n, total, squares = coarse[i, j], 0, 0.0, 0.0
            for r in range(max(i * cells - top, 0), min((i + 1) * cells - top, fine.shape[0])):
                for c in range(max(j * cells - left, 0), min((j + 1) * cells - left, fine.shape[1])):
                    if np.isnan(fine[r, c]):
                        continue
                    if np.isnan(zero):
                        zero = fine[r, c]
                    n += 1
                    total += fine[r, c] - zero
                    squares += (fine[r, c] - zero) ** 2
            counted = n if np.isnan(coarse[i, j]) else cells**2  # what the finer ones leave has the height of the cell
            share[i, j] = counted / cells**2
            if counted > 0:
                mean[i, j] = zero + total / counted
                variance[i, j] = max(squares / counted - (total / counted) ** 2, 0.0)


@njit(cache=True, nogil=True)
def _fill_spread(
    height: Float32Array, share: Float32Array, mean: Float32Array, variance: Float32Array, finer: Float32Array,
    spread: Float32Array, covered: Float32Array,
) -> None:  # fmt: skip
    """Fill the root mean square by which heights around each cell differ from its own, NaN where it has none, and the
    mean of ``finer`` there."""
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            spread[r, c], covered[r, c] = np.nan, np.nan
            if np.isnan(height[r, c]):
                continue
            whole, weight, squares, fine = 0.0, 0.0, 0.0, 0.0
            for i in range(max(r - WINDOW_HALF, 0), min(r + WINDOW_HALF + 1, rows)):
                for j in range(max(c - WINDOW_HALF, 0), min(c + WINDOW_HALF + 1, columns)):
                    w = float((WINDOW_HALF + 1 - abs(i - r)) * (WINDOW_HALF + 1 - abs(j - c)))
                    whole += w
                    fine += w * finer[i, j]
                    if share[i, j] > 0.0:
                        weight += w * share[i, j]
                        squares += w * share[i, j] * (variance[i, j] + (mean[i, j] - height[r, c]) ** 2)
            spread[r, c], covered[r, c] = np.sqrt(squares / weight), fine / whole


@njit(inline="always")
def _height_at(
    height: Float32Array, slope: Float32Array, r: int, c: int, row: float, column: float, reach_m: float
) -> float:
    """Return the height at a place near the centre of cell (r, c), linear between it and those of the three cells
    around the place that lie on one plane with it."""
    down, right = row - r, column - c
    rr, cc = r + (1 if down > 0.0 else -1), c + (1 if right > 0.0 else -1)
    down, right = abs(down), abs(right)
    total, weight = 0.0, 0.0
    for i, j, w in ((r, c, (1 - down) * (1 - right)), (rr, c, down * (1 - right)), (r, cc, (1 - down) * right),
                    (rr, cc, down * right)):  # fmt: skip
        run = 1.5 if i != r and j != c else 1.0
        if not (0 <= i < height.shape[0] and 0 <= j < height.shape[1]):
            continue
        if off_planes(height, slope, r, c, i, j)[0] <= run * reach_m:
            total += w * height[i, j]
            weight += w
    return float(total / weight)


@njit(cache=True, nogil=True)
def _take(
    coarse: Float32Array, slope: Float32Array, sigma: Float32Array, correlation: Float32Array, rays: ByteArray,
    seen: ByteArray, place: tuple[int, int, int], reach_m: float, near: tuple[Float32Array, float],
    out: tuple[Float32Array, Float32Array, Float32Array, ByteArray, ByteArray, ByteArray],
) -> None:  # fmt: skip
    """Give cells without height what the coarser cell that holds them has, ``near`` heights within a distance of which
    it must lie, none for NaN; ``place`` as above. ``out`` are heights, standard deviations, correlations, numbers of
    photographs that agree and that look, and sides of cells."""
    top, left, cells = place
    near_m, within_m = near
    height, own, alike, agreeing, looking, side = out
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            if not np.isnan(height[r, c]) or np.isnan(near_m[r, c]):
                continue
            i, j = (top + r) // cells, (left + c) // cells
            if not np.isnan(coarse[i, j]):
                row, column = (top + r + 0.5) / cells - 0.5, (left + c + 0.5) / cells - 0.5
                z = _height_at(coarse, slope, i, j, row, column, reach_m)
                if np.isfinite(near_m[r, c]) and abs(z - near_m[r, c]) > within_m:
                    continue
                height[r, c] = z
                own[r, c], alike[r, c] = sigma[i, j], correlation[i, j]
                agreeing[r, c], looking[r, c], side[r, c] = rays[i, j], seen[i, j], cells


@njit(cache=True, nogil=True)
def _keep_near(
    fine: Float32Array, coarse: Float32Array, slope: Float32Array, place: tuple[int, int, int], reach_m: float,
    out: Float32Array,
) -> None:  # fmt: skip
    """Fill the finer heights to which the coarser level is near, where ``out`` has none; ``place`` as above."""
    top, left, cells = place
    for r in range(fine.shape[0]):
        for c in range(fine.shape[1]):
            i, j = (top + r) // cells, (left + c) // cells
            if np.isnan(fine[r, c]) or np.isnan(coarse[i, j]) or not np.isnan(out[r, c]):
                continue
            row, column = (top + r + 0.5) / cells - 0.5, (left + c + 0.5) / cells - 0.5
            if abs(fine[r, c] - _height_at(coarse, slope, i, j, row, column, reach_m)) <= reach_m:
                out[r, c] = fine[r, c]


def agreed_level(level: LevelHeights, share: tuple[int, int]) -> LevelHeights:
    """Return a level without the heights on which fewer than SURE_RAYS photographs agree, or a smaller ``share``, a
    fraction, of those that look there."""
    agree, look = level.rays.astype(np.int32), level.seen.astype(np.int32)
    kept = (agree >= SURE_RAYS) & (share[1] * agree >= share[0] * look)
    return replace(level, height_m=np.where(kept, level.height_m, np.float32(np.nan)))


def told_by_pairs(height_m: Float32Array, pairs_m: Float32Array, cell_m: float) -> BoolArray:
    """Return which heights (rows, columns) several pairs of photographs tell to a cell."""
    return np.asarray(np.abs(height_m - pairs_m) <= np.float32(cell_m))


def confirmed(level: LevelHeights, coarser: LevelHeights, cell_m: float) -> LevelHeights:
    """Return a level without the heights that are not sure, that pairs do not tell, and that the next ``coarser`` level
    does not confirm, within REACH of one of its cells; on faces it cannot. It covers the level and reaches two cells
    further as far as the grid goes. ``cell_m`` is the side of the finest cells."""
    n = coarser.cells // level.cells
    place = (level.row - coarser.row * n, level.column - coarser.column * n, n)
    at_m = cell_m * coarser.cells
    sure, _ = sure_cells(level.height_m, level.rays, level.seen, level.face, cell_m * level.cells)
    needs_none = sure | level.face | told_by_pairs(level.height_m, level.pairs_m, cell_m * level.cells)
    height = np.where(needs_none, level.height_m, np.float32(np.nan))
    slope = surface_slopes(coarser.height_m, at_m)
    _keep_near(level.height_m, coarser.height_m, slope, place, REACH * at_m, height)
    return replace(level, height_m=height)


def around_cells(
    level: LevelHeights, known_m: Float32Array, finest_m: Float32Array, place: tuple[int, int, int]
) -> tuple[Float32Array, Float32Array]:
    """Return the root mean square (rows, columns) by which the surface around each cell of a level differs from its
    height, in m, NaN where it has none, and the share of the cells there that the finest level has heights of.

    The surface is ``known_m`` where finer levels have told it, NaN elsewhere, and the level itself there; both it and
    ``finest_m`` are heights of cells of the finest level. ``place`` is the row and column of the first of them from the
    corner of the level's first cell, and how many a cell of the level holds to a side.
    """
    share, mean, variance, finer, spread, covered = (np.empty_like(level.height_m) for _ in range(6))
    nothing = np.full_like(level.height_m, np.nan)
    _fill_moments(finest_m, place, nothing, finer, mean, variance)
    _fill_moments(known_m, place, level.height_m, share, mean, variance)
    _fill_spread(level.height_m, share, mean, variance, finer, spread, covered)
    return spread, covered


def heights_for_larger(finest: LevelHeights) -> Float32Array:
    """Return the heights (rows, columns) near which alone a larger cell may lie, in m over the base: NaN where there is
    none, infinite where it may lie anywhere."""
    side = 2 * AROUND_HALF + 1
    known, asked = (
        cv2.boxFilter(which.astype(np.float32), -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for which in (finest.steep & np.isfinite(finest.height_m), finest.steep)
    )
    anywhere = ~finest.steep | (known <= np.float32(FINEST_SHARE) * asked)
    near_m = np.where(anywhere, np.float32(np.inf), finest.pairs_m)
    return np.where(finest.face, np.float32(np.nan), near_m)


def surface_of_levels(finest: LevelHeights, coarser: Sequence[LevelHeights], cell_m: float) -> LevelSurface:
    """Return the surface of the window of the finest level, whose cells have a side of ``cell_m``.

    ``coarser`` levels, in the order in which they are asked, cover the window, and reach two cells of theirs beyond it
    as far as the grid goes. All is as with a larger window from ``margin_cells`` inside this one on.
    """
    height, sigma = finest.height_m.copy(), finest.sigma_m.copy()
    cells = np.isfinite(height).astype(np.uint8)
    correlation = np.where(cells, finest.correlation, np.float32(0))
    rays, seen = (np.where(cells, counted, np.uint8(0)) for counted in (finest.rays, finest.seen))
    made = LevelSurface(height, sigma, correlation, rays, seen, cells)
    near = heights_for_larger(finest), NEAR_CELLS * cell_m
    for level in coarser:
        place = (finest.row - level.row * level.cells, finest.column - level.column * level.cells, level.cells)
        spread, covered = around_cells(level, height, finest.height_m, place)
        at_m, out = cell_m * level.cells, (height, sigma, correlation, rays, seen, cells)
        adds = (covered < MOSTLY_FINEST) | (spread < STEEP_CELLS * at_m)
        taken_m, own = np.where(adds, level.height_m, np.float32(np.nan)), np.maximum(level.sigma_m, spread)
        slope = surface_slopes(taken_m, at_m)
        _take(taken_m, slope, own, level.correlation, level.rays, level.seen, place, REACH * at_m, near, out)
    return made
