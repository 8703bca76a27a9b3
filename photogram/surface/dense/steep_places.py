"""Where ground is steep or torn or its texture weak, and what pairs of photographs tell of it.

Ground on which the coarser level tells heights closely is matched as it is (`tile_matching`). Where it does not, over
more than a wall's width, heights of pairs (`stereo_heights`) tell the surface along which windows lie, and the range
that is searched around it: pairs of pictures of half the size first, and of the whole size where what these tell is a
steep face. Where texture is weak (`texture`) the coarser level tells too little as well; pairs of half the size do.
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
from photogram.surface.dense.pyramid import RANGE_STEPS, Level, Prior, is_narrow
from photogram.surface.dense.rectification import Picture
from photogram.surface.dense.refinement import own_side_mean
from photogram.surface.dense.slopes import STEEPEST_GENTLE, slopes_without_walls
from photogram.surface.dense.stereo_heights import TEXTURED, WEAK, Smoothness, StereoHeights, stereo_heights
from photogram.surface.planes import STEEPEST
from photogram.surface.views import Views

OPEN_CELLS, WALL_CELLS, CLOSED_CELLS = 3.0, 5, 12
"""A cell whose range is wider than so many cells, beyond what every range is, is steep or torn, over WALL_CELLS to each
side: across a wall the range is wide as well, on a narrower band. So are cells as wide in range within CLOSED_CELLS
between such, where a coarser level has found nothing that would make them worthwhile."""

FACE_SLOPES, FACE_CELLS = (1.0, 7.0), 5
"""Rise over run of faces that pictures of the whole size tell better, where so many cells to each side have it."""

FACE_TOLERANCE_STEPS, FACE_ERROR = 4.0, 0.06
"""Steps within which heights of a face count for its mean, and what a height's own standard deviation grows by, in
steps, over the cube of the slope: an error in plan counts the more, and a window is the shorter, the steeper it is. How
much both do was found on simulated faces."""

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

TOLD_CELLS, LEAST_TOLD = 32, 0.1
"""Where several pairs of half the size tell less than this share of the steep ground up to so many cells to each side,
as in woods, none of the whole size are asked, and the finest level leaves out what has a wide range. In a real wood
these cells took four fifths of its hypotheses, for 2 % of the heights that were kept."""

ROUGH_CELLS, ROUGH_AROUND, ROUGHEST_CELLS = 0.3, 17, 5.0
"""Where heights differ from the median of 5 × 5 cells by so many cells, in the mean over ROUGH_AROUND cells, and none
counted with more than ROUGHEST_CELLS, ground is rough: crowns are, faces are not."""

RISE = 1.5
"""What rises by more than so many times its run around a hole in weak texture is beyond a wall."""

WEAK_STEPS = 2.0
"""Steps that are searched around the surface that pairs tell of weak texture."""


class Asked(NamedTuple):
    """Of which cells (rows, columns) pairs are asked: those that are ``torn``, and those of ``weak`` texture."""

    torn: BoolArray
    weak: BoolArray


class PairSurface(NamedTuple):
    """The surface (rows, columns) of which pairs were asked, in m over the base, to which ``share`` (rows, columns)
    each cell is theirs, and of those that are ``steep`` as a whole the heights on which several pairs agree, NaN
    elsewhere."""

    surface: Float32Array
    share: Float32Array
    steep: BoolArray
    pairs_m: Float32Array

    @property
    def told(self) -> BoolArray:
        """Return which steep cells (rows, columns) several pairs have told."""
        return np.isfinite(self.pairs_m)

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

    def heights(
        self, part: Window, near: Float32Array, bounds_m: tuple[float, float], cells: int, smoothness: Smoothness
    ) -> StereoHeights:
        """Return the heights of every so many ``cells`` of a part of the window, from pictures as much reduced: all
        within bounds, or of all cells those close to ``near`` (rows, columns)."""
        foot, up = (layer[part.slices][::cells, ::cells] for layer in (self.lines.foot_world_m, self.lines.up))
        return stereo_heights(
            self.views, self.picture, cells * self.level.reduction, Verticals(self.lines.base_map_m, foot, up), near,
            bounds_m, AGREE_STEPS * cells * self.level.step_m, closely=cells == 1, smoothness=smoothness,
        )  # fmt: skip


def torn_cells(prior: Prior, level: Level, looked_at: BoolArray) -> BoolArray:
    """Return which cells are steep, or torn, of those ``looked_at`` (rows, columns each)."""
    width = prior.high - prior.low - np.float32(2.0 * RANGE_STEPS * level.step_m)
    wide = looked_at & (width > np.float32(OPEN_CELLS * level.grid.cell_m))
    worthwhile = wide if prior.worthwhile is None else wide & prior.worthwhile
    torn = np.asarray(binary_opening(worthwhile, np.ones((WALL_CELLS, WALL_CELLS), np.bool_)))
    if torn.any():
        side, inner = 2 * CLOSED_CELLS + 1, slice(CLOSED_CELLS, -CLOSED_CELLS)
        closed = cv2.morphologyEx(
            np.pad(torn, CLOSED_CELLS).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((side, side), np.uint8)
        )
        torn |= wide & (closed[inner, inner] > 0)
    return torn


def _smoothed(height: Float32Array, level: Level, cells: int) -> Float32Array:
    """Return heights (rows, columns) of cells so many times as large as the level's, without outliers, smoothed along
    their own planes."""
    surface = np.asarray(median_filter(height, 3, mode="nearest"), dtype=np.float32)
    slope = slopes_without_walls(surface, cells * level.grid.cell_m, STEEPEST)
    smooth = np.empty_like(surface)
    own_side_mean(surface, slope, SMOOTH_STEPS * cells * level.step_m, 1, smooth)
    return smooth


def _share_around(which: BoolArray) -> Float32Array:
    """Return to which share (rows, columns) cells are those of an array or around them."""
    if not which.any():
        return np.zeros(which.shape, np.float32)
    away = distance_transform_edt(~which)
    return np.clip((PARTLY_CELLS - away) / (PARTLY_CELLS - WHOLLY_CELLS), 0.0, 1.0).astype(np.float32)


def _without_strays(told: _Told, share: Float32Array, level: Level) -> _Told:
    """Return heights of weak texture without those that one pair alone tells and that are not near what several tell
    around: beside a wall, where most see the roof, it may be the only one, and wrong."""
    several = np.where(told.pairs > 1, told.height, np.float32(np.nan))
    around, low, high = several.copy(), several.copy(), several.copy()
    _fill_between(several, share, REACH_CELLS, RISE * level.grid.cell_m, around, low, high)
    astray = np.abs(told.height - around) > np.float32(AGREE_STEPS * COARSER * level.step_m)
    kept = (told.pairs > 0) & ~astray
    return _Told(np.where(kept, told.height, np.float32(np.nan)), np.where(kept, told.pairs, np.uint8(0)))


def _told_by_pairs(
    sources: _Sources, prior: Prior, asked: Asked, steep: Float32Array, weak: Float32Array
) -> tuple[_Told, Float32Array]:
    """Return what pairs tell of the shares (rows, columns) of cells that are steep and weak, NaN where none does, and a
    surface that has no holes."""
    first = _told_by_half_size(sources, prior, asked.torn, steep, TEXTURED)
    told, surface = _told_by_whole_size(sources, first, steep, TEXTURED), first.height
    if asked.weak.any():
        first, instead = _told_by_half_size(sources, prior, asked.weak, weak, WEAK), weak > steep
        other = _without_strays(_told_by_whole_size(sources, first, weak, WEAK), weak, sources.level)
        surface = np.where(instead, first.height, surface)
        told = _Told(np.where(instead, other.height, told.height), np.where(instead, other.pairs, told.pairs))
    return told, np.where(np.isfinite(told.height), told.height, surface)


def pair_surface(
    views: Views, picture: Picture, level: Level, lines: Verticals, prior: Prior, asked: Asked
) -> tuple[Prior, PairSurface]:
    """Return the range of a window with what pairs tell of its ``asked`` cells, and the surface of these."""
    torn, weak = asked
    if not (torn.any() or weak.any()):
        nothing = np.full_like(prior.surface, np.nan)
        return prior, PairSurface(prior.surface, np.zeros_like(prior.surface), torn, nothing)
    of_steep, of_weak = _share_around(torn), _share_around(weak)
    share, sources = np.maximum(of_steep, of_weak), _Sources(views, picture, level, lines)
    (height, pairs), filled = _told_by_pairs(sources, prior, asked, of_steep, of_weak)
    lowest, highest, told_m = height.copy(), height.copy(), height.copy()
    for of, rise in ((np.where(weak, np.float32(0.0), share), np.inf), (np.where(weak, share, np.float32(0.0)), RISE)):
        _fill_between(height, of, REACH_CELLS, rise * level.grid.cell_m, filled, lowest, highest)
    share[np.isnan(lowest)] = 0.0
    smooth = _smoothed(filled, level, 1)
    least, most = np.fmin(lowest, smooth), np.fmax(highest, smooth)
    reach_m, weak_m = np.float32(SEARCHED_STEPS * level.step_m), np.float32(WEAK_STEPS * level.step_m)
    low = minimum_filter(least, NEIGHBOURS_CELLS, mode="nearest") - reach_m
    high = maximum_filter(most, NEIGHBOURS_CELLS, mode="nearest") + reach_m
    whole, known = (share >= 1.0) & (of_steep >= 1.0), share > 0.0
    several = whole & (pairs > 1)
    told_m[~several] = np.nan
    gentle = known & weak & ~several
    low = np.where(several, low, np.where(known, np.minimum(prior.low, low), prior.low))
    high = np.where(several, high, np.where(known, np.maximum(prior.high, high), prior.high))
    low, high = np.where(gentle, least - weak_m, low), np.where(gentle, most + weak_m, high)
    surface = np.where(known, smooth, prior.surface)
    asked_for = is_narrow(low, high, level) | _are_told_around(of_steep >= 1.0, several)
    worthwhile = None if prior.worthwhile is None else np.where(of_steep < 1.0, prior.worthwhile | gentle, asked_for)
    return Prior(low, high, surface, worthwhile), PairSurface(surface, share, whole, told_m)


def _are_told_around(whole: BoolArray, several: BoolArray) -> BoolArray:
    """Return around which cells (rows, columns) several pairs tell LEAST_TOLD of the ``whole`` steep ground."""
    side = 2 * TOLD_CELLS + 1
    told, of = (cv2.blur(which.astype(np.float32), (side, side)) for which in (whole & several, whole))
    return np.asarray(told >= np.float32(LEAST_TOLD) * of)


def means_of_faces(
    height: Float32Array, sigma: Float32Array, paired: PairSurface, level: Level
) -> tuple[Float32Array, Float32Array]:
    """Return heights (rows, columns) and their standard deviations, those of faces as means along their planes."""
    if not paired.share.any():
        return height, sigma
    cell_m = level.grid.cell_m
    slope = slopes_without_walls(np.where(np.isfinite(height), height, paired.surface), cell_m, STEEPEST)
    mean = np.empty_like(height)
    own_side_mean(height, slope, FACE_TOLERANCE_STEPS * level.step_m, 1, mean)
    tangent = np.hypot(slope[..., 0], slope[..., 1]) / np.float32(cell_m)
    face = (paired.share > 0.0) & (tangent > FACE_SLOPES[0])
    place_m = FACE_ERROR * level.step_m * tangent**3
    return np.where(face, mean, height), np.where(face, np.hypot(sigma, place_m), sigma).astype(np.float32)


def smooth_places(height: Float32Array, paired: PairSurface, level: Level) -> BoolArray:
    """Return which cells (rows, columns) lie on steep ground that is smooth, as its matched heights have it: faces, not
    crowns. A larger cell tells nothing there that is not told better or cannot be told."""
    whole, known = paired.share >= 1.0, (paired.share > 0.0) & np.isfinite(height)
    if not whole.any():
        return whole
    median = cv2.medianBlur(np.where(np.isfinite(height), height, paired.surface), 5)
    rough = np.minimum(np.abs(height - median) / np.float32(level.grid.cell_m), np.float32(ROUGHEST_CELLS))
    off, count = (
        cv2.blur(np.where(known, values, np.float32(0.0)), (ROUGH_AROUND, ROUGH_AROUND))
        for values in (rough, np.float32(1.0))
    )
    return np.asarray(whole & (off < np.float32(ROUGH_CELLS) * count))


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


def _told_by_half_size(
    sources: _Sources, prior: Prior, torn: BoolArray, share: Float32Array, smoothness: Smoothness
) -> _Told:
    """Return the surface of the places that have a ``share`` as pairs of half the size tell it."""
    surface, pairs = prior.surface.copy(), np.zeros(torn.shape, np.uint8)
    for core, part in _pieces(share > 0.0, COARSER * TILE_CELLS, COARSER * AROUND_CELLS):
        at = part.slices
        near, asked = prior.surface[at][::COARSER, ::COARSER], torn[at] if torn[at].any() else share[at] > 0.0
        low = float(np.percentile(prior.low[at][asked], OUTLYING_PERCENT))
        high = float(np.percentile(prior.high[at][asked], 100.0 - OUTLYING_PERCENT))
        told = sources.heights(part, near, (low, high), COARSER, smoothness)
        filled = np.where(np.isfinite(told.height_m), told.height_m, near).astype(np.float32)
        spare = filled.copy(), filled.copy()
        rise_m = RISE * COARSER * sources.level.grid.cell_m if smoothness == WEAK else np.inf
        _fill_between(told.height_m, np.ones_like(filled), REACH_CELLS // COARSER, rise_m, filled, *spare)
        smooth = _smoothed(filled, sources.level, COARSER)
        inner = core.within(part)
        surface[core.slices] = _finer(smooth, part.shape)[inner]
        pairs[core.slices] = _finer(told.pairs.astype(np.float32), part.shape)[inner]
    return _Told(surface, pairs)


def _told_by_whole_size(sources: _Sources, told: _Told, share: Float32Array, smoothness: Smoothness) -> _Told:
    """Return the heights of steep faces as pairs of the whole size tell them, and elsewhere what is ``told``."""
    height = np.where(told.pairs > 0, told.height, np.float32(np.nan))
    pairs, level = told.pairs.copy(), sources.level
    slope = np.abs(slopes_without_walls(told.height, level.grid.cell_m, np.inf)).max(axis=-1) / level.grid.cell_m
    steep = (slope > FACE_SLOPES[0]) & (slope < FACE_SLOPES[1]) & (share > 0.0)
    steep &= _are_told_around(share >= 1.0, told.pairs > 1)
    faces = binary_opening(steep, np.ones((FACE_CELLS, FACE_CELLS), np.bool_))
    faces = binary_dilation(faces, np.ones((2 * FACE_RIM_CELLS + 1, 2 * FACE_RIM_CELLS + 1), np.bool_)) & (share > 0.0)
    for core, part in _pieces(faces, TILE_CELLS, AROUND_CELLS):
        near = told.height[part.slices]
        beyond = NEAR_SHARE * float(np.ptp(near)) + NEAR_STEPS * level.step_m
        bounds_m = float(near.min()) - beyond, float(near.max()) + beyond
        found = sources.heights(part, near, bounds_m, 1, smoothness)
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
    height: Float32Array, share: Float32Array, reach: int, rise_m: float, out: Float32Array, low: Float32Array,
    high: Float32Array,
) -> None:  # fmt: skip
    """Fill cells that have a ``share`` and no ``height`` with the mean of the heights around, weighted by the inverse
    square of their distances, and ``low`` and ``high`` with the least and the largest of these. What rises from the
    least by more than ``rise_m`` for each cell between is beyond a wall, and not in the mean."""
    rows, columns = height.shape
    around, square = np.empty(8), np.empty(8)
    for r in range(rows):
        for c in range(columns):
            if height[r, c] == height[r, c] or share[r, c] == 0.0:
                continue
            met, lowest = 0, 0
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
                        around[met], square[met] = z, step * step * (dr * dr + dc * dc)
                        lowest = met if z < around[lowest] else lowest
                        met += 1
                        break
            if met < MET:
                continue
            total, weight = 0.0, 0.0
            for k in range(met):
                if around[k] - around[lowest] <= rise_m * (np.sqrt(square[k]) + np.sqrt(square[lowest])):
                    w = 1.0 / square[k]
                    total += w * around[k]
                    weight += w
            out[r, c], low[r, c], high[r, c] = total / weight, around[lowest], around[:met].max()
