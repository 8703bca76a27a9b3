"""Where ground is steep or torn, and what pairs of photographs tell of it.

Ground on which the coarser level tells heights closely is matched as it is (`tile_matching`). Where it does not, over
more than a wall's width, heights of pairs (`stereo_heights`) tell the surface along which windows lie, and the range
that is searched around it: pairs of pictures of half the size first, and of the whole size where what these tell is a
steep face.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from scipy.ndimage import (
    binary_dilation,
    binary_opening,
    distance_transform_edt,
    maximum_filter,
    median_filter,
    minimum_filter,
)

from photogram.arrays import BoolArray, ByteArray, Float32Array
from photogram.compilation import njit
from photogram.grid import Verticals, Window
from photogram.surface.dense.pyramid import RANGE_STEPS, Level, Prior
from photogram.surface.dense.rectification import Picture
from photogram.surface.dense.refinement import own_side_mean
from photogram.surface.dense.slopes import STEEPEST_GENTLE, slopes_without_walls
from photogram.surface.dense.stereo_heights import StereoHeights, stereo_heights
from photogram.surface.dsm import STEEPEST
from photogram.surface.views import Views

OPEN_CELLS, WALL_CELLS = 3.0, 7
"""A cell whose range is wider than so many cells, beyond what every range is, is steep or torn, over WALL_CELLS to each
side: across a wall the range is wide as well, on a narrower band."""

FACE_SLOPES, FACE_CELLS = (1.0, 7.0), 5
"""Rise over run of faces that pictures of the whole size tell better, where so many cells to each side have it."""

FACE_TOLERANCE_STEPS, FACE_ERROR = 4.0, 0.09
"""Steps within which heights of a face count for its mean, and what a height's own standard deviation grows by, in
steps, over the square of the slope: a window is as much shorter on it, and its error in plan counts as much more."""

COARSER = 2
"""By which the pictures and cells of the first heights are larger."""

TILE_CELLS, AROUND_CELLS = 104, 12
"""Side of the pieces of ground that are looked up in pictures of the whole size, and how far beyond its edge one is."""

WHOLLY_CELLS, PARTLY_CELLS = 6.0, 14.0
"""How far around steep places their surface is that of pairs alone, and how far in parts."""

FACE_RIM_CELLS, NEAR_SHARE, NEAR_STEPS = 3, 0.15, 4.0
"""So many cells around a face count as its own; how far beyond its heights pairs are matched, as a share of their range
and in steps."""

OUTLYING_PERCENT = 0.5
"""Of the lowest and of the highest heights that torn cells may have, so many count for none of the pairs' bounds."""

AGREE_STEPS, SEARCHED_STEPS = 2.0, 3.0
"""Steps of height within which pairs agree, and that are searched around what several tell; around what one tells the
whole range is."""

NEIGHBOURS_CELLS = 3
"""Side of the window around a cell whose heights are all searched: pairs tell edges to a cell or so."""

REACH_CELLS, MET = 24, 5
"""A cell of which no pair tells lies between those that it meets in so many of eight directions, no farther away."""

SMOOTH_STEPS = 1.5
"""Steps within which heights that pairs tell count for the mean along their plane."""


class SteepGround(NamedTuple):
    """The surface (rows, columns) of steep places in m over the base, to which ``share`` (rows, columns) each cell is
    one, and which of them several pairs have ``told``."""

    surface: Float32Array
    share: Float32Array
    told: BoolArray

    @property
    def steepest(self) -> Float32Array:
        """Return what rises by more than so many times its run is a wall."""
        return np.where(self.share > 0.0, np.float32(STEEPEST), np.float32(STEEPEST_GENTLE))


class _Told(NamedTuple):
    """Heights (rows, columns) that pairs tell, in m over the base, and how many of them agree."""

    height: Float32Array
    pairs: ByteArray


class _Sources(NamedTuple):
    """What heights of pairs come from."""

    views: Views
    picture: Picture
    level: Level
    lines: Verticals

    def heights(self, part: Window, near: Float32Array, bounds_m: tuple[float, float], cells: int) -> StereoHeights:
        """Return the heights of every so many ``cells`` of a part of the window, from pictures as much reduced: all
        within bounds, or of all cells those close to ``near`` (rows, columns)."""
        foot, up = (layer[part.slices][::cells, ::cells] for layer in (self.lines.foot_world_m, self.lines.up))
        return stereo_heights(
            self.views, self.picture, cells * self.level.reduction, Verticals(self.lines.base_map_m, foot, up), near,
            bounds_m, AGREE_STEPS * cells * self.level.step_m, closely=cells == 1,
        )  # fmt: skip


def torn_cells(prior: Prior, level: Level, looked_at: BoolArray) -> BoolArray:
    """Return which cells are steep, or torn, of those ``looked_at`` (rows, columns each)."""
    width = prior.high - prior.low - np.float32(2.0 * RANGE_STEPS * level.step_m)
    wide = looked_at & (width > np.float32(OPEN_CELLS * level.grid.cell_m))
    return np.asarray(binary_opening(wide, np.ones((WALL_CELLS, WALL_CELLS), np.bool_)))


def _smoothed(height: Float32Array, level: Level, cells: int) -> Float32Array:
    """Return heights (rows, columns) of cells so many times as large as the level's, without outliers, smoothed along
    their own planes."""
    surface = np.asarray(median_filter(height, 3, mode="nearest"), dtype=np.float32)
    slope = slopes_without_walls(surface, cells * level.grid.cell_m, STEEPEST)
    smooth = np.empty_like(surface)
    own_side_mean(surface, slope, SMOOTH_STEPS * cells * level.step_m, 1, smooth)
    return smooth


def steep_ground(
    views: Views, picture: Picture, level: Level, lines: Verticals, prior: Prior, torn: BoolArray
) -> tuple[Prior, SteepGround]:
    """Return the range of a window with what pairs tell of its ``torn`` cells, and the surface of these."""
    if not torn.any():
        return prior, SteepGround(prior.surface, np.zeros(torn.shape, np.float32), torn)
    away = distance_transform_edt(~torn)
    share = np.clip((PARTLY_CELLS - away) / (PARTLY_CELLS - WHOLLY_CELLS), 0.0, 1.0).astype(np.float32)
    sources = _Sources(views, picture, level, lines)
    first = _told_by_half_size(sources, prior, torn, share)
    height, pairs = _told_by_whole_size(sources, first, share)
    lowest, highest, filled = height.copy(), height.copy(), np.where(np.isfinite(height), height, first.height)
    _fill_between(height, share, REACH_CELLS, filled, lowest, highest)
    share[np.isnan(lowest)] = 0.0
    smooth = _smoothed(filled, level, 1)
    low, high = np.fmin(lowest, smooth), np.fmax(highest, smooth)
    reach_m = np.float32(SEARCHED_STEPS * level.step_m)
    low = minimum_filter(low, NEIGHBOURS_CELLS, mode="nearest") - reach_m
    high = maximum_filter(high, NEIGHBOURS_CELLS, mode="nearest") + reach_m
    several, steep = (share >= 1.0) & (pairs > 1), share > 0.0
    low = np.where(several, low, np.where(steep, np.minimum(prior.low, low), prior.low))
    high = np.where(several, high, np.where(steep, np.maximum(prior.high, high), prior.high))
    surface = np.where(steep, smooth, prior.surface)
    worthwhile = None if prior.worthwhile is None else prior.worthwhile | several
    return Prior(low, high, surface, worthwhile), SteepGround(surface, share, several)


def means_of_faces(
    height: Float32Array, sigma: Float32Array, steep: SteepGround, level: Level
) -> tuple[Float32Array, Float32Array]:
    """Return heights (rows, columns) and their standard deviations, those of faces as means along their planes."""
    if not steep.share.any():
        return height, sigma
    cell_m = level.grid.cell_m
    slope = slopes_without_walls(np.where(np.isfinite(height), height, steep.surface), cell_m, STEEPEST)
    mean = np.empty_like(height)
    own_side_mean(height, slope, FACE_TOLERANCE_STEPS * level.step_m, 1, mean)
    tangent = np.hypot(slope[..., 0], slope[..., 1]) / np.float32(cell_m)
    face = (steep.share > 0.0) & (tangent > FACE_SLOPES[0])
    place_m = FACE_ERROR * level.step_m * tangent**2
    return np.where(face, mean, height), np.where(face, np.hypot(sigma, place_m), sigma).astype(np.float32)


def _pieces(which: BoolArray, side: int, around: int) -> Iterator[tuple[Window, Window]]:
    """Yield windows that hold all cells of an array (rows, columns), of up to ``side`` cells, and the same with so many
    cells ``around`` them as there are."""
    whole = Window(0, 0, *which.shape)
    for tile in whole.tiles(side):
        rows, columns = (np.flatnonzero(which[tile.slices].any(axis=axis)) for axis in (1, 0))
        if len(rows):
            row, column = tile.row + int(rows[0]), tile.column + int(columns[0])
            core = Window(row, column, tile.row + int(rows[-1]) + 1, tile.column + int(columns[-1]) + 1)
            part = core.around(around).common(whole)
            assert part is not None
            yield core, part


def _told_by_half_size(sources: _Sources, prior: Prior, torn: BoolArray, share: Float32Array) -> _Told:
    """Return the surface of steep places as pairs of half the size tell it."""
    surface, pairs = prior.surface.copy(), np.zeros(torn.shape, np.uint8)
    for core, part in _pieces(share > 0.0, COARSER * TILE_CELLS, COARSER * AROUND_CELLS):
        at = part.slices
        near, asked = prior.surface[at][::COARSER, ::COARSER], torn[at] if torn[at].any() else share[at] > 0.0
        low = float(np.percentile(prior.low[at][asked], OUTLYING_PERCENT))
        high = float(np.percentile(prior.high[at][asked], 100.0 - OUTLYING_PERCENT))
        told = sources.heights(part, near, (low, high), COARSER)
        filled = np.where(np.isfinite(told.height_m), told.height_m, near).astype(np.float32)
        _fill_between(told.height_m, np.ones_like(filled), REACH_CELLS // COARSER, filled, filled.copy(), filled.copy())
        smooth = _smoothed(filled, sources.level, COARSER)
        inner = core.within(part)
        surface[core.slices] = _finer(smooth, part.shape)[inner]
        pairs[core.slices] = _finer(told.pairs.astype(np.float32), part.shape)[inner]
    return _Told(surface, pairs)


def _told_by_whole_size(sources: _Sources, told: _Told, share: Float32Array) -> _Told:
    """Return the heights of steep faces as pairs of the whole size tell them, and elsewhere what is ``told``."""
    height = np.where(told.pairs > 0, told.height, np.float32(np.nan))
    pairs, level = told.pairs.copy(), sources.level
    slope = np.abs(slopes_without_walls(told.height, level.grid.cell_m, np.inf)).max(axis=-1) / level.grid.cell_m
    steep = (slope > FACE_SLOPES[0]) & (slope < FACE_SLOPES[1]) & (share > 0.0)
    faces = binary_opening(steep, np.ones((FACE_CELLS, FACE_CELLS), np.bool_))
    faces = binary_dilation(faces, np.ones((2 * FACE_RIM_CELLS + 1, 2 * FACE_RIM_CELLS + 1), np.bool_)) & (share > 0.0)
    for core, part in _pieces(faces, TILE_CELLS, AROUND_CELLS):
        near = told.height[part.slices]
        beyond = NEAR_SHARE * float(np.ptp(near)) + NEAR_STEPS * level.step_m
        found = sources.heights(part, near, (float(near.min()) - beyond, float(near.max()) + beyond), 1)
        at, inner = core.slices, core.within(part)
        better = faces[at] & np.isfinite(found.height_m[inner])
        height[at] = np.where(better, found.height_m[inner], height[at])
        pairs[at] = np.where(better, found.pairs[inner], pairs[at])
    return _Told(height, pairs)


def _finer(values: Float32Array, shape: tuple[int, ...]) -> Float32Array:
    """Return values (rows, columns) linear between those of every COARSER-th cell."""
    u, v = np.meshgrid(*(np.arange(n, dtype=np.float32) / COARSER for n in reversed(shape)))
    return np.asarray(cv2.remap(values, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


@njit(cache=True, nogil=True)
def _fill_between(
    height: Float32Array, share: Float32Array, reach: int, out: Float32Array, low: Float32Array, high: Float32Array
) -> None:  # fmt: skip
    """Fill cells that have a ``share`` and no ``height`` with the mean of the heights around, weighted by the inverse
    square of their distances, and ``low`` and ``high`` with the least and the largest of these."""
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            if height[r, c] == height[r, c] or share[r, c] == 0.0:
                continue
            met, total, weight, least, most = 0, 0.0, 0.0, np.inf, -np.inf
            for k in range(9):
                dr, dc = k // 3 - 1, k % 3 - 1
                if k == 4:
                    continue
                for step in range(1, reach + 1):
                    i, j = r + step * dr, c + step * dc
                    if not (0 <= i < rows and 0 <= j < columns):
                        break
                    z = height[i, j]
                    if z == z:
                        w = 1.0 / (step * step * (dr * dr + dc * dc))
                        met += 1
                        total += w * z
                        weight += w
                        least, most = min(least, z), max(most, z)
                        break
            if met >= MET:
                out[r, c], low[r, c], high[r, c] = total / weight, least, most
