"""Heights from many photographs at once, matched on the ground itself.

For each cell of a map grid heights are tried: a window of ground at each of them is looked up in the photographs that
see the cell from straightest above, through the full camera model, and the better they agree, the likelier the height
(`correlation`). A semi-global regularisation over the cells picks one (`semi_global`), and the correlation itself
tells its fraction and its standard deviation (`refinement`). From coarse to fine: each level searches around the
heights of the coarser one (`pyramid`).

A level is matched in blocks of BLOCK_CELLS × BLOCK_CELLS cells with a margin, each by itself, so results depend on
neither the order of the blocks nor the number of workers, and memory not on the size of the survey.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from photogram.errors import SettingError
from photogram.geodesy.frames import LocalFrame
from photogram.grid import Verticals, Window, cell_steps, verticals
from photogram.settings.settings import Settings, Title, Within
from photogram.surface.dense.correlation import NEUTRAL, Hypotheses, fill_costs
from photogram.surface.dense.lattice import NOTHING_HIDDEN, Crops, GroundCells, grey_of_cells, places_per_cell
from photogram.surface.dense.neighbours import combined_where_weak, smoothed_where_weak
from photogram.surface.dense.pyramid import Level, Prior, median_of_known
from photogram.surface.dense.rectification import Picture
from photogram.surface.dense.refinement import InitialHeights, Refined, own_side_mean, refine_heights
from photogram.surface.dense.resolution import choose_views
from photogram.surface.dense.semi_global import CostVolume, regularised
from photogram.surface.dense.sight import hidden_cells
from photogram.surface.dense.slopes import slopes_without_walls, surface_along
from photogram.surface.dense.steep_places import (
    Asked,
    PairSurface,
    means_of_faces,
    pair_surface,
    smooth_places,
    torn_cells,
)
from photogram.surface.dense.texture import (
    MOST_VIEWS,
    Effort,
    Texture,
    as_around,
    effort_for,
    noise_of,
    noise_over_texture,
    texture_of,
    weak_patches,
    windows_for,
)
from photogram.surface.dense.window_sums import PatchWindows
from photogram.surface.planes import STEEPEST
from photogram.surface.views import Views, places_in_view

BLOCK_CELLS = 384
"""Cells along the side of a block: part of the result, for a path of the regularisation ends with its block."""

MARGIN_CELLS = 16
"""How far a block looks beyond its edge: paths of the regularisation start there."""

PATCH_CELLS = 16
"""Cells along the side of a patch, all of which are looked up in the same photographs."""

LARGEST_STEP = 1000.0
"""The largest penalty: with it sums over eight paths stay well within 16 bits."""

MASKED_SPARE = 3
"""So many times more photographs are asked for a patch where some have masks, for those that show it unmasked."""

PLACES_ALONG = 3
"""Places along a patch at which masks are looked up."""

RIM_PX = 8
"""Pixels around what a block shows that are kept for the windows at its edge."""

_COST_HALF, _REFINEMENT_HALF, _SMOOTH_HALF = 2, 3, 3
_COARSE_LARGE_STEP_SHARE = 0.5
_PROBE_SHARE, _TOLERANCE_SHARE = 0.3, 1.0


ScalarT = TypeVar("ScalarT", bound=np.generic)


@dataclass(frozen=True)
class DenseSettings(Settings):
    """How dense heights are matched."""

    enabled: Annotated[bool, "Whether heights are matched."] = True
    photographs: Annotated[
        int,
        Within(2, 16),
        "In how many photographs a cell is looked up at most: those that see it from straightest above; where "
        "texture is weak in up to ten.",
        Title("photographs for a cell, at most"),
    ] = 6
    agreeing_share: Annotated[
        float,
        Within(0.01, 1),
        "Share of these that must agree; the others may be hidden.",
        Title("share of them that must agree"),
    ] = 0.5
    small_step: Annotated[
        float,
        Within(0, LARGEST_STEP, "hundredths of a correlation"),
        "Penalty of the regularisation for a change of height by one step, below `large_step`; more is smoother.",
        Title("penalty of a small step"),
    ] = 5.0
    large_step: Annotated[
        float,
        Within(0, LARGEST_STEP, "hundredths of a correlation"),
        "Its penalty for a larger change.",
        Title("penalty of a large step"),
    ] = 47.0
    contrast_dn: Annotated[
        float,
        Within(0.01, 255, "grey values"),
        "Change of grey value at which the large penalty is halved.",
        Title("contrast that halves it"),
    ] = 30.0
    noise_dn: Annotated[
        float,
        Within(0.01, 255, "grey values"),
        "Standard deviation of the photographs' noise; windows with little more than that correlate with nothing.",
        Title("noise of the photographs"),
    ] = 1.5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.small_step >= self.large_step:
            limit = f"must be below large_step, {self.large_step:g}"
            raise SettingError("small_step", f"{limit}, found {self.small_step:g}")


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights (rows, columns) of a window over the base, in m, NaN where there is none; their standard deviations as
    far as the matching goes, the mean correlation of the photographs that agree, how many these are, and how many were
    looked at because they show the place (to PATCH_CELLS cells). ``expected`` is the correlation that photographs have
    by their texture and noise, in that of textured ground: 1 there, less where texture is weak. Where smooth ground is
    a ``face`` no larger cell tells its height; where it is ``steep`` pairs of photographs were asked, ``pairs_m`` are
    the heights on which several of them agree, NaN elsewhere and where texture is weak."""

    height_m: Float32Array
    sigma_m: Float32Array
    correlation: Float32Array
    rays: ByteArray
    seen: ByteArray
    expected: NDArray[np.float16]
    face: BoolArray
    steep: BoolArray
    pairs_m: Float32Array

    def part(self, rows: slice, columns: slice) -> Heights:
        """Return a part of the window."""
        return Heights(*(layer[rows, columns] for layer in vars(self).values()))


OF_FINEST = ("expected", "face", "steep", "pairs_m")
"""Those of them that the finest cells alone tell."""


@dataclass(frozen=True, eq=False)
class MatchedBlock:
    """What the matching of a block finds: the heights (rows, columns) that the regularisation chose, in m over the
    base, and their correlations, around which the next finer level searches; and the refined heights, None of a level
    that is no part of the surface."""

    start_m: Float32Array
    agreement: Float32Array
    heights: Heights | None


@dataclass(frozen=True, eq=False)
class Scene:
    """What is matched: the frame, the oriented photographs, where their pictures come from, and which of them (V,) have
    pixels that are left out and are NaN in their pictures, None for none."""

    frame: LocalFrame
    views: Views
    picture: Picture
    masked: BoolArray | None = None


def match_block(
    scene: Scene, level: Level, block: Window, prior: Prior, settings: DenseSettings, *, refined: bool = True
) -> MatchedBlock:
    """Match one block of a level; ``prior`` covers it with its margin. What is no part of the surface is not
    ``refined``.

    Returns what was found in the block without the margin.
    """
    outer = level.grid.around_window(block, MARGIN_CELLS)
    lines = verticals(scene.frame, level.grid, outer)
    inner = block.within(outer)
    views = _views_of_patches(scene, lines, prior.surface, settings.photographs, level.reduction)
    if not (views >= 0).any():
        return unmatched_block(block.shape, refined=refined)
    steps = cell_steps(scene.frame, level.grid)
    weak = _weak_patches(scene, lines, steps, views, prior, level)
    torn, weak_cells = _torn(views, prior, level), _of_cells(weak, (prior.surface.shape[0], prior.surface.shape[1]))
    asked = Asked(torn & ~weak_cells, weak_cells)
    prior, paired = pair_surface(scene.views, scene.picture, level, lines, prior, asked)
    views, hidden, effort = _views_of_asked(scene, lines, steps, views, prior, paired, weak, level, settings)
    ground = _ground(lines, steps, views, level, hidden)
    crops = _crops(scene, lines, views, prior, level.reduction)
    start, agreement = _regularised(crops, ground, prior, paired, effort, level, settings)
    if not refined:
        return MatchedBlock(start[inner], agreement[inner], None)
    heights = _refined(crops, ground, start, prior.surface, paired, effort, level, settings)
    return MatchedBlock(start[inner], agreement[inner], heights.part(*inner))


def _ground(
    lines: Verticals, steps: tuple[FloatArray, FloatArray], views: IntArray, level: Level,
    hidden: BoolArray = NOTHING_HIDDEN,
) -> GroundCells:  # fmt: skip
    return GroundCells(lines.foot_world_m, lines.up, *steps, places_per_cell(level.spacing), views, PATCH_CELLS, hidden)


def unmatched_block(shape: tuple[int, int], *, refined: bool) -> MatchedBlock:
    """Return a block without heights."""
    none, zero = np.full(shape, np.nan, np.float32), np.zeros(shape, np.uint8)
    zeros, ones, no = np.zeros(shape, np.float32), np.ones(shape, np.float16), np.zeros(shape, np.bool_)
    nothing = Heights(none, none.copy(), zeros, zero, zero.copy(), ones, no, no.copy(), none.copy())
    return MatchedBlock(none, zeros, nothing if refined else None)


def _of_cells(of_patches: NDArray[ScalarT], shape: tuple[int, int]) -> NDArray[ScalarT]:
    """Return values (rows, columns, …) of cells from those of their patches."""
    return np.repeat(np.repeat(of_patches, PATCH_CELLS, axis=0), PATCH_CELLS, axis=1)[: shape[0], : shape[1]]


def _seen(ground: GroundCells, shape: tuple[int, int]) -> ByteArray:
    """Return in how many photographs each cell is looked up, of those that see it."""
    shown = _of_cells(np.asarray(ground.views >= 0), shape)
    if ground.hidden.size:
        shown = np.asarray(shown & ~ground.hidden)
    return np.asarray(shown.sum(axis=2), dtype=np.uint8)


def _is_finest(prior: Prior, level: Level) -> bool:
    """Return whether a level is the finest of several."""
    return level.cells == 1 and prior.worthwhile is not None


def _weak_patches(
    scene: Scene, lines: Verticals, steps: tuple[FloatArray, FloatArray], views: IntArray, prior: Prior, level: Level
) -> BoolArray:
    """Return which patches have weak texture, as far as the surface of the coarser level tells: of the finest level."""
    if not _is_finest(prior, level):
        return np.zeros(views.shape[:2], dtype=np.bool_)
    return weak_patches(_texture(scene, lines, steps, views, prior, level))


def _texture(
    scene: Scene, lines: Verticals, steps: tuple[FloatArray, FloatArray], views: IntArray, prior: Prior, level: Level
) -> Texture:
    ground, crops = _ground(lines, steps, views, level), _crops(scene, lines, views, prior, level.reduction)
    return texture_of(crops, ground, prior.surface)


def _views_of_asked(
    scene: Scene, lines: Verticals, steps: tuple[FloatArray, FloatArray], views: IntArray, prior: Prior,
    paired: PairSurface, weak: BoolArray, level: Level, settings: DenseSettings,
) -> tuple[IntArray, BoolArray, Effort]:  # fmt: skip
    """Return the views of patches, of ``weak`` texture (patch rows, patch columns) as many as it needs, and where
    ground is steep those that see most of it best; which of them do not see a cell, and how patches are matched."""
    views = _views_of_steep(scene, lines, steps, views, paired, level)
    ratio = np.zeros(weak.shape)
    if weak.any():
        ratio = as_around(noise_over_texture(_texture(scene, lines, steps, views, prior, level)), weak)
        more = _views_of_patches(scene, lines, prior.surface, max(settings.photographs, MOST_VIEWS), level.reduction)
        effort = effort_for(ratio, (more >= 0).sum(axis=2), settings.photographs, settings.agreeing_share)
        more[np.arange(more.shape[2]) >= effort.views[..., None]] = -1
        more[~effort.weak, : views.shape[2]] = views[~effort.weak]
        views = more
    else:
        effort = effort_for(ratio, (views >= 0).sum(axis=2), settings.photographs, settings.agreeing_share)
    return views, _hidden_from(scene, lines, steps, views, paired, level), effort


def _torn(views: IntArray, prior: Prior, level: Level) -> BoolArray:
    """Return which cells are steep, or torn, as a coarser level tells: of the finest level, for larger cells are none
    of steep ground."""
    if not _is_finest(prior, level):
        return np.zeros(prior.surface.shape, dtype=np.bool_)
    assert prior.worthwhile is not None
    looked_at = _of_cells(np.asarray((views >= 0).any(axis=2)), (prior.surface.shape[0], prior.surface.shape[1]))
    return torn_cells(prior, level, looked_at)


def _views_of_steep(
    scene: Scene, lines: Verticals, steps: tuple[FloatArray, FloatArray], views: IntArray, paired: PairSurface,
    level: Level,
) -> IntArray:  # fmt: skip
    """Return the views of patches, where ground is steep those that see most of it best."""
    if not paired.told.any():
        return views
    most = views.shape[2]
    wide = _views_of_patches(scene, lines, paired.surface, 2 * most, level.reduction)
    facing = _sight(scene, lines, steps, wide, paired, level)[1]
    order = np.argsort(-facing, axis=2, kind="stable")[..., :most]
    best = np.take_along_axis(wide, order, axis=2)
    best[np.take_along_axis(facing, order, axis=2) <= 0.0] = -1
    return np.ascontiguousarray(np.where(((best >= 0).sum(axis=2) > 1)[..., None], best, views))


def _hidden_from(
    scene: Scene, lines: Verticals, steps: tuple[FloatArray, FloatArray], views: IntArray, paired: PairSurface,
    level: Level,
) -> BoolArray:  # fmt: skip
    """Return which of the views of its patch do not see a cell where ground is steep."""
    return _sight(scene, lines, steps, views, paired, level)[0] if paired.told.any() else NOTHING_HIDDEN


def _sight(
    scene: Scene, lines: Verticals, steps: tuple[FloatArray, FloatArray], views: IntArray, paired: PairSurface,
    level: Level,
) -> tuple[BoolArray, Float32Array]:  # fmt: skip
    slope = slopes_without_walls(paired.surface, level.grid.cell_m, STEEPEST)
    of_patch = PATCH_CELLS, lines, steps, paired.surface, slope, paired.told, level.step_m
    return hidden_cells(scene.views.position_world_m, views, *of_patch)


def _views_of_patches(scene: Scene, lines: Verticals, surface: Float32Array, most: int, reduction: int) -> IntArray:
    """Return the views (patch rows, patch columns, most) in which the cells of each patch are looked up."""
    rows, columns = surface.shape
    row, column = (np.minimum(np.arange(0, n, PATCH_CELLS) + PATCH_CELLS // 2, n - 1) for n in (rows, columns))
    at = np.ix_(row, column)
    place = lines.foot_world_m[at] + surface[at][..., None] * lines.up[at]
    several = scene.masked is not None and bool(scene.masked.any())
    chosen, _ = choose_views(scene.views, place.reshape(-1, 3), most * (MASKED_SPARE if several else 1))
    if several:
        chosen = _unmasked(scene, chosen, _patch_places(lines, surface, row, column), reduction)[:, :most]
    chosen[(chosen >= 0).sum(axis=1) < 2] = -1
    return np.ascontiguousarray(chosen).reshape(len(row), len(column), most)


def _patch_places(lines: Verticals, surface: Float32Array, row: IntArray, column: IntArray) -> FloatArray:
    """Return places (P, N, 3) of patches, given by the row and column of their middles: of cells spread over each."""
    step = np.linspace(-0.4, 0.4, PLACES_ALONG) * PATCH_CELLS
    rows, columns = (
        np.clip(np.rint(middle[:, None] + step).astype(np.int64), 0, n - 1)
        for middle, n in zip((row, column), surface.shape, strict=True)
    )
    r, c = rows[:, None, :, None], columns[None, :, None, :]
    place = lines.foot_world_m[r, c] + surface[r, c][..., None] * lines.up[r, c]
    return np.asarray(place.reshape(len(row) * len(column), PLACES_ALONG**2, 3))


def _unmasked(scene: Scene, chosen: IntArray, places_world_m: FloatArray, reduction: int) -> IntArray:
    """Return the views (P, M) of patches in their order without those whose masks leave out half or more of the
    ``places_world_m`` (P, N, 3) that they show, then −1."""
    assert scene.masked is not None
    kept = chosen.copy()
    for view in np.unique(chosen[chosen >= 0]).tolist():
        if not scene.masked[view]:
            continue
        patch, rank = np.nonzero(chosen == view)
        picture = scene.picture(view, reduction)
        pixel = places_in_view(scene.views, view, places_world_m[patch].reshape(-1, 3)) / reduction
        inside = np.asarray(np.isfinite(pixel).all(axis=1))
        whole = np.rint(np.where(inside[:, None], pixel, -1.0)).astype(np.int64)
        inside &= np.all((whole >= 0) & (whole < np.array([picture.shape[1], picture.shape[0]])), axis=1)
        shown = np.zeros(len(pixel), dtype=bool)
        shown[inside] = np.isfinite(picture[whole[inside, 1], whole[inside, 0]])
        left = shown.reshape(len(patch), -1).sum(axis=1)
        lost = 2 * left <= inside.reshape(len(patch), -1).sum(axis=1)
        kept[patch[lost], rank[lost]] = -1
    return np.asarray(np.take_along_axis(kept, np.argsort(kept < 0, axis=1, kind="stable"), axis=1))


def _crops(scene: Scene, lines: Verticals, views: IntArray, prior: Prior, reduction: int) -> Crops:
    """Return the parts of the pictures in which a block is looked up."""
    wanted = np.unique(views[views >= 0])
    every, end = slice(None, None, 8), slice(-1, None)
    edge = [(every, every), (every, end), (end, every), (end, end)]
    foot, up = (np.concatenate([a[r, c].reshape(-1, 3) for r, c in edge]) for a in (lines.foot_world_m, lines.up))
    low, high = float(prior.low.min()), float(prior.high.max())
    corners = np.concatenate([foot + low * up, foot + high * up])
    count = len(scene.views)
    start, left, top, width, height = (np.zeros(count, np.int64) for _ in range(5))
    pixels: list[Float32Array] = []
    total = 0
    for v in wanted:
        picture = scene.picture(int(v), reduction)
        box = _box_px(scene.views, int(v), corners, reduction, picture.shape)
        part = np.asarray(picture[box.slices], dtype=np.float32)
        start[v], left[v], top[v] = total, box.column, box.row
        height[v], width[v] = part.shape
        pixels.append(part.ravel())
        total += part.size
    flat = np.concatenate(pixels)
    return Crops(scene.views.cameras, start, left, top, width, height, flat, 1.0 / reduction)


def _box_px(views: Views, view: int, corners: FloatArray, reduction: int, shape: tuple[int, ...]) -> Window:
    """Return the part of a reduced picture that shows places (N, 3), with a rim for the windows around them."""
    pixel = places_in_view(views, view, corners) / reduction
    pixel = pixel[np.isfinite(pixel).all(axis=1)]
    low = np.floor(pixel.min(axis=0)).astype(int) - RIM_PX if len(pixel) else np.zeros(2, int)
    high = np.ceil(pixel.max(axis=0)).astype(int) + RIM_PX if len(pixel) else np.zeros(2, int)
    column, row = np.clip(low, 0, [shape[1] - 1, shape[0] - 1])
    column_end, row_end = np.clip(high, [column + 1, row + 1], [shape[1], shape[0]])
    return Window(int(row), int(column), int(row_end), int(column_end))


def _regularised(
    crops: Crops, ground: GroundCells, prior: Prior, paired: PairSurface, effort: Effort, level: Level,
    settings: DenseSettings,
) -> tuple[Float32Array, Float32Array]:  # fmt: skip
    """Return the best height (rows, columns), to a fraction of a hypothesis, of cells that two photographs see, NaN
    elsewhere, and its correlation."""
    rows, columns = prior.surface.shape
    along = surface_along(prior.surface, level.grid.cell_m, paired.surface, paired.share)
    first = np.floor((prior.low - along) / level.step_m).astype(np.int32)
    count = np.ceil((prior.high - along) / level.step_m).astype(np.int64) - first + 1
    count[_seen(ground, (rows, columns)) == 0] = 0
    if prior.worthwhile is not None:
        count[~prior.worthwhile] = 0
    start = np.concatenate([[0], np.cumsum(count.ravel())]).astype(np.int64)
    cost = np.empty(start[-1], np.uint8)
    tried = Hypotheses(along, level.step_m, first, count, start[:-1].reshape(rows, columns))
    fill_costs(crops, ground, _windows(_COST_HALF, effort, level, ground, settings), tried, cost)
    guide = np.empty((rows, columns), np.float32)
    grey_of_cells(crops, ground, prior.surface, guide)
    unit = NEUTRAL / 100.0
    large = settings.large_step * (1.0 if level.cells == 1 else _COARSE_LARGE_STEP_SHARE)
    volume = CostVolume(cost, start, first.ravel(), guide)
    best, own = regularised(volume, settings.small_step * unit, large * unit, settings.contrast_dn)
    return along + best * np.float32(level.step_m), 1.0 - own / np.float32(NEUTRAL)


def _windows(half: int, effort: Effort, level: Level, ground: GroundCells, settings: DenseSettings) -> PatchWindows:
    """Return the windows of patches with the ground of ± ``half`` samples a pixel apart, where it is textured."""
    own, weak = (
        max(1, round(((2 * h + 1) * level.spacing * ground.per_cell - 1.0) / 2.0)) for h in (half, _REFINEMENT_HALF)
    )
    return windows_for(effort, own, weak, settings.noise_dn)


def _refined(
    crops: Crops,
    ground: GroundCells,
    height: Float32Array,
    elsewhere: Float32Array,
    paired: PairSurface,
    effort: Effort,
    level: Level,
    settings: DenseSettings,
) -> Heights:
    """Return heights to a fraction of a hypothesis, with their standard deviations; where there are none, windows reach
    to the heights ``elsewhere``."""
    z = median_of_known(height)
    slope = slopes_without_walls(z, level.grid.cell_m, paired.steepest)
    tolerance, smooth = _TOLERANCE_SHARE * level.step_m, np.empty_like(z)
    own_side_mean(z, slope, tolerance, _SMOOTH_HALF, smooth)
    smooth = np.where(np.isfinite(smooth), smooth, elsewhere)
    shape = z.shape[0], z.shape[1]
    expected, weak = _of_cells(effort.expected.astype(np.float16), shape), _of_cells(effort.weak, shape)
    smooth, slope = smoothed_where_weak(smooth, slope, weak, tolerance, level.grid.cell_m)
    refined = Refined(*(np.empty(z.shape, kind) for kind in (np.float32, np.float32, np.float32, np.uint8)))
    start = InitialHeights(
        z, smooth, slope, _PROBE_SHARE * level.step_m, tolerance, 1.0 / (ground.per_cell * level.spacing),
        level.step_m / np.sqrt(3.0),
    )  # fmt: skip
    windows = _windows(_REFINEMENT_HALF, effort, level, ground, settings)
    refine_heights(crops, ground, windows, start, refined)
    side = _of_cells((2 * windows.half + 1) / ground.per_cell, shape)
    noise = np.where(weak, noise_of(expected), 0.0)
    height, sigma = combined_where_weak(
        refined.height, refined.sigma, slope, noise, side, level.step_m, level.grid.cell_m
    )
    height, sigma = means_of_faces(height, sigma, paired, level)
    face = smooth_places(refined.height, paired, level) & ~weak
    pairs_m = np.where(weak, np.float32(np.nan), paired.pairs_m)
    seen = _seen(ground, shape)
    return Heights(height, sigma, refined.correlation, refined.rays, seen, expected, face, paired.steep, pairs_m)
