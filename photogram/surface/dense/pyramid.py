"""The levels of dense matching, from coarse to fine: grids, reduced pictures, steps of height, search ranges."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.ndimage import map_coordinates, maximum_filter, median_filter, minimum_filter, uniform_filter
from scipy.spatial import cKDTree

from photogram.arrays import NMAD_FACTOR, BoolArray, Float32Array, FloatArray, IntArray
from photogram.errors import SurfaceError
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Window
from photogram.measures.ground_sampling import ground_sampling_m
from photogram.measures.round_lengths import CELL_STEPS, round_near
from photogram.surface.dense.resolution import COARSEST_GSD, STEEP_TANGENT, choose_views, resolved_m
from photogram.surface.mapped_area import Geometry
from photogram.surface.views import Views

STEP_PX = 0.7
"""Parallax, in pixels of the reduced picture, between neighbouring hypotheses."""

COARSEST_PX = 110
"""Shorter side of the smallest reduced picture that is worth matching."""

MOST_LEVELS = 5

COARSEST_MEASURED = 8
"""Side of the largest cells, in cells of the finest level, that a surface takes heights from."""

RANGE_STEPS = 1.5
"""How far beyond the heights of the coarser level, in steps of its own, a finer one searches."""

DOUBTFUL_NMAD, DOUBTFUL_BETWEEN = 3.0, (0.3, 0.75)
"""A correlation so many NMAD below the median of all is not believed; the limit lies between these two."""

AROUND_CELLS = 8
"""How far around a doubtful cell, in cells of the coarser level, the finest one looks for heights to try."""

MOST_STEPS = 550
"""Hypotheses that the whole range of a doubtful cell may have; where it has more, only heights nearby are tried."""

CONFIRMED_STEPS, CONFIRMED_SHARE = 6.0, 0.7
"""A height is confirmed if those of the eight cells around differ by less than so many steps and so many agreed."""

CLOSELY = 2
"""Side of the largest cells, in cells of the finest level, that are searched between what was agreed on nearby alone,
where the coarser level knows nothing or is in doubt."""

WIDE_STEPS, CONFIRMED_AROUND, CONFIRMED_LEAST = 32.0, 4, 0.1
"""Levels finer than COARSEST_MEASURED leave out cells whose range has more steps, where no more than this share of the
heights of the coarser level is confirmed so many of its cells around. In a real wood these were half of all hypotheses
in cells of twice the finest side, and told 0.2 % of the heights that were kept there."""

SAMPLED = 2000
"""Tie points at which is looked up what photographs resolve."""

OBLIQUE = 1.25
"""Photographs are oblique where they resolve ground by so much worse than flying height and focal length say: those of
flights straight down differ by some per cent."""

CORRELATION_BINS = 1000
_LOCAL_SHARE, _BEYOND_SHARE = 0.25, 0.06


@dataclass(frozen=True)
class Level:
    """One level: its grid, the reduction of the pictures (1: the photographs as they are), the distance of samples in
    cells, the step between hypotheses, in m, and the side of a cell in cells of the finest level."""

    grid: MapGrid
    reduction: int
    spacing: float
    step_m: float
    cells: int = 1

    @property
    def measured(self) -> bool:
        """Return whether the surface may take heights from this level."""
        return self.cells <= COARSEST_MEASURED


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the heights (rows, columns) of a window beforehand, in m over the base: they lie between ``low``
    and ``high``, near ``surface``; whether it is ``worthwhile`` to look for them, None where it is for all."""

    low: Float32Array
    high: Float32Array
    surface: Float32Array
    worthwhile: BoolArray | None = None


@dataclass(frozen=True, eq=False)
class KnownGround:
    """Tie points (N, 3) of the map and what follows from them: flying height over them, GSD, and the spread of the
    nearest photographs in relation to the flying height."""

    points_map_m: FloatArray
    flying_height_m: float
    gsd_m: float
    spread: float

    @property
    def coarsest_m(self) -> float:
        """Return the worst that photographs may resolve of ground at which they look flat and that is mapped."""
        return COARSEST_GSD * self.gsd_m


def known_ground(points_map_m: FloatArray, points_world_m: FloatArray, views: Views, most: int) -> KnownGround:
    """Return what tie points tell of a survey matched in ``most`` photographs at a time.

    The GSD is flying height over focal length; of oblique photographs, which are farther from the ground than they are
    high, what they resolve of level ground at the tie points, the median over those that would be matched. Raises
    SurfaceError with fewer than three points or two photographs.
    """
    if len(points_map_m) < 3 or len(views) < 2:
        raise SurfaceError(
            f"dense matching starts from tie points: {len(points_map_m)} in {len(views)} photographs are too few"
        )
    low, high = np.percentile(points_map_m[:, 2], [0.1, 99.9])
    kept = points_map_m[(points_map_m[:, 2] >= low) & (points_map_m[:, 2] <= high)]
    centre = views.position_world_m
    below = nearest_in_plan(points_world_m, centre, min(50, len(points_world_m)))
    above = centre[:, 2] - np.median(points_world_m[below, 2], axis=1)
    flying = float(np.median(above))
    if not flying > 0:
        raise SurfaceError("dense matching needs photographs above the ground they show")
    gsd = ground_sampling_m(above, views.focal_px)
    resolved = resolved_m(views, points_world_m[:: -(-len(points_world_m) // SAMPLED)], min(most, len(views)))
    resolved = resolved[np.isfinite(resolved)]
    if len(resolved) and np.median(resolved) > OBLIQUE * gsd:
        gsd = float(np.median(resolved))
    neighbours = nearest_in_plan(centre, centre, min(most, len(views)))
    away = np.linalg.norm(centre[neighbours[:, -1], :2] - centre[:, :2], axis=1)
    spread = float(np.median(away)) / flying
    return KnownGround(kept, flying, gsd, max(spread, 0.05))


def nearest_in_plan(points: FloatArray, places: FloatArray, count: int) -> IntArray:
    """Return the numbers (P, count) of the points (N, 2 or 3) that are next to places (P, 2 or 3) in plan."""
    _, index = cKDTree(points[:, :2]).query(places[:, :2], k=list(range(1, count + 1)))
    return np.asarray(index, dtype=np.int64)


@dataclass(frozen=True)
class MappedGround:
    """The grid of a map, and the area of ground around that enough photographs see, but none resolves."""

    grid: MapGrid
    left_out_m2: float


def mapped_ground(
    frame: LocalFrame, known: KnownGround, views: Views, cell_m: float, rays: int, area: Geometry | None = None
) -> MappedGround:
    """Return the grid around all ground, of an ``area`` of the map where one is given, that at least ``rays``
    photographs see and resolve (``choose_views``), its height being that of the next tie point.

    Raises SurfaceError where there is none.
    """
    points = known.points_map_m
    coarse = known.flying_height_m / 40
    reach = 2.0 * known.flying_height_m
    corners = np.vstack([points[:, :2].min(axis=0) - reach, points[:, :2].max(axis=0) + reach])
    wide = MapGrid.around(corners, coarse)
    east, north = wide.centres_map_m(wide.whole)
    plan = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    place = np.column_stack([plan, points[nearest_in_plan(points, plan, 1)[:, 0], 2]])
    world = frame.world_from_map(place)
    chosen, tangent = choose_views(replace(views, coarsest_m=np.inf), world, rays)
    seen = np.asarray((chosen >= 0).all(axis=1))
    flat = np.flatnonzero(seen & (tangent[:, -1] > STEEP_TANGENT))
    lost = flat[(choose_views(views, world[flat], rays)[0] < 0).any(axis=1)]
    seen[lost] = False
    mapped, half = plan[seen], coarse / 2
    if not len(mapped):
        raise SurfaceError(f"no ground is visible in {rays} photographs: dense matching needs overlap")
    if area is not None:
        mapped = mapped[shapely.dwithin(area, shapely.points(mapped), half)]
        if not len(mapped):
            text = f"surface.area lies beside all ground that {rays} photographs show"
            raise SurfaceError(f"{text}: draw it where they overlap, in the coordinates of the map")
    corners = np.vstack([mapped - half, mapped + half])
    if area is not None:
        west, south, east_end, north_end = area.bounds
        corners = np.clip(corners, [west, south], [east_end, north_end])
    return MappedGround(MapGrid.around(corners, cell_m), len(lost) * coarse**2)


def reductions_of(cell_gsd: float, shorter_px: int) -> tuple[int, int]:
    """Return by which power of two the pictures of the finest level are reduced, and how many coarser levels there are,
    for cells of so many GSD and photographs whose shorter side is ``shorter_px``."""
    finest = max(0, round(float(np.log2(cell_gsd)) - 1.0))
    return finest, int(np.clip(np.floor(np.log2(shorter_px / COARSEST_PX)) - finest, 0, MOST_LEVELS - 1))


def plan_levels(known: KnownGround, views: Views, grid: MapGrid) -> tuple[Level, ...]:
    """Return the levels, coarse to fine, the last on ``grid``.

    The pictures are reduced so that a pixel is about half a cell or a whole one; each coarser level has cells and
    pixels of twice the size, until the pictures are COARSEST_PX wide.
    """
    finest, coarser = reductions_of(grid.cell_m / known.gsd_m, int(views.size_px.min()))
    levels = []
    for level in range(coarser, -1, -1):
        reduction, factor = 2 ** (finest + level), 2**level
        pixel_m = known.gsd_m * reduction
        coarse = grid.coarser(factor)
        spacing, step_m = min(pixel_m / coarse.cell_m, 1.0), STEP_PX * pixel_m / known.spread
        levels.append(Level(coarse, reduction, spacing, step_m, factor))
    return tuple(levels)


def first_prior(known: KnownGround, level: Level, window: Window, base_map_m: float) -> Prior:
    """Return the range of the coarsest level: that of the tie points around, and some more for what stands out."""
    tree = cKDTree(known.points_map_m[:, :2])
    # one query per lattice node: the range changes slowly
    reach = _LOCAL_SHARE * known.flying_height_m
    axes = [np.unique(np.round(v / (reach / 4)), return_inverse=True) for v in level.grid.centres_map_m(window)]
    (east, column), (north, row) = axes
    nodes = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2) * (reach / 4)
    heights = known.points_map_m[:, 2] - base_map_m
    nearest = nearest_in_plan(known.points_map_m, nodes, min(5, len(heights)))
    low, high, middle = (np.empty(len(nodes)) for _ in range(3))
    for n, near in enumerate(tree.query_ball_point(nodes, reach)):
        around = heights[np.union1d(np.array(near, dtype=np.int64), nearest[n])]
        low[n], high[n], middle[n] = around.min(), around.max(), np.median(around)
    beyond = _BEYOND_SHARE * known.flying_height_m
    which = row[:, None] * len(east) + column[None, :]
    low, high, middle = (v[which].astype(np.float32) for v in (low - beyond, high + beyond, middle))
    return Prior(low, high, middle)


def finer_prior(
    coarse: Float32Array,
    correlation: Float32Array,
    at: Window,
    level: Level,
    window: Window,
    known: Prior,
) -> Prior:
    """Return the range of a window of a finer level from heights ``coarse`` of the next coarser one, and their
    correlations, in its window ``at``.

    Where the coarser level knows nothing, all of ``known`` is searched, and also where its photographs did not agree on
    a cell: a tree too small for it, a roof taken for the ground. Cells of CLOSELY or smaller are searched there only
    between the heights that were agreed on up to AROUND_CELLS cells away: all else would cost more than the rest. Below
    the coarsest cells that are measured it is not worth while to look for those with a wide range around which the
    coarser level scatters, as in woods. Where ``known`` has more than MOST_STEPS hypotheses, as from great flying
    heights, every level looks between heights that their neighbours confirm. ``at`` reaches at least AROUND_CELLS + 3
    cells beyond the finer window, as far as the grid goes.
    """
    rows, columns = (np.arange(a, b) for a, b in ((window.row, window.row_end), (window.column, window.column_end)))
    r, c = rows // 2 - at.row, columns // 2 - at.column
    smooth = median_of_known(coarse)
    has = np.isfinite(smooth)
    low = minimum_filter(np.where(has, smooth, np.inf), 3, mode="nearest")[np.ix_(r, c)]
    high = maximum_filter(np.where(has, smooth, -np.inf), 3, mode="nearest")[np.ix_(r, c)]
    beyond = RANGE_STEPS * level.step_m
    none = ~np.isfinite(low)
    least = least_correlation_of(correlation_histogram(correlation))
    doubtful = maximum_filter(has & (correlation < least), 3, mode="nearest")[np.ix_(r, c)]
    agreed = correlation >= least
    confirmed = _confirmed(smooth, agreed, CONFIRMED_STEPS * level.step_m)
    lowest, highest = known.low, known.high
    if level.cells <= CLOSELY:
        lowest, highest = _agreed_around(smooth, agreed, r, c, beyond)
    too_wide = known.high - known.low > np.float32(MOST_STEPS * level.step_m)
    if too_wide.any():
        nearby = _agreed_around(smooth, confirmed, r, c, beyond)
        lowest, highest = np.where(too_wide, nearby[0], lowest), np.where(too_wide, nearby[1], highest)
    nowhere = ~np.isfinite(lowest)
    low = np.where(none, np.where(nowhere, known.low, lowest), low - beyond)
    high = np.where(none, np.where(nowhere, known.high, highest), high + beyond)
    low = np.where(doubtful, np.minimum(low, lowest), low).astype(np.float32)
    high = np.where(doubtful, np.maximum(high, highest), high).astype(np.float32)
    worthwhile = np.ones(low.shape, np.bool_)
    if level.cells < COARSEST_MEASURED:
        around = uniform_filter(confirmed.astype(np.float32), 2 * CONFIRMED_AROUND + 1, mode="nearest")
        worthwhile = is_narrow(low, high, level) | (around[np.ix_(r, c)] > CONFIRMED_LEAST)
    place = np.meshgrid((rows + 0.5) / 2 - 0.5 - at.row, (columns + 0.5) / 2 - 0.5 - at.column, indexing="ij")
    weight = map_coordinates(has.astype(np.float32), place, order=1, mode="nearest")
    surface = map_coordinates(np.where(has, smooth, 0.0), place, order=1, mode="nearest") / np.maximum(weight, 1e-6)
    surface = np.where(weight > 1e-3, surface, np.where(none, known.surface, 0.5 * (low + high)))
    return Prior(low, high, surface.astype(np.float32), worthwhile)


def is_narrow(low: Float32Array, high: Float32Array, level: Level) -> BoolArray:
    """Return which ranges (rows, columns) of a level have fewer than WIDE_STEPS hypotheses."""
    return np.asarray(high - low < np.float32(WIDE_STEPS * level.step_m))


def _confirmed(smooth: Float32Array, agreed: BoolArray, tolerance_m: float) -> BoolArray:
    """Return which cells were ``agreed`` on, as most of the 3 × 3 around them, with heights within ``tolerance_m``."""
    has = np.isfinite(smooth)
    low = minimum_filter(np.where(has, smooth, np.float32(np.inf)), 3, mode="nearest")
    high = maximum_filter(np.where(has, smooth, np.float32(-np.inf)), 3, mode="nearest")
    share = uniform_filter(agreed.astype(np.float32), 3, mode="nearest")
    return agreed & has & (high < low + np.float32(tolerance_m)) & (share > CONFIRMED_SHARE)


def _agreed_around(
    smooth: Float32Array, agreed: BoolArray, rows: IntArray, columns: IntArray, beyond: float
) -> tuple[Float32Array, Float32Array]:
    """Return the lowest and the highest of heights that were ``agreed`` on, up to AROUND_CELLS cells from cells at
    ``rows`` and ``columns``, and ``beyond``; infinite where there are none."""
    there, side = agreed & np.isfinite(smooth), 2 * AROUND_CELLS + 1
    low = minimum_filter(np.where(there, smooth, np.float32(np.inf)), side, mode="nearest")
    high = maximum_filter(np.where(there, smooth, np.float32(-np.inf)), side, mode="nearest")
    at = np.ix_(rows, columns)
    return low[at] - np.float32(beyond), high[at] + np.float32(beyond)


def correlation_histogram(correlation: Float32Array) -> IntArray:
    """Return how many cells have which correlation, in CORRELATION_BINS from 0 to 1; cells without any do not count."""
    known = correlation[correlation > 0]
    bins = np.minimum((known * CORRELATION_BINS).astype(np.int64), CORRELATION_BINS - 1)
    return np.bincount(bins, minlength=CORRELATION_BINS)


def least_correlation_of(histogram: IntArray) -> float:
    """Return the correlation below which a height is doubtful: so many NMAD below the median of all cells, for what is
    ordinary depends on texture and light."""
    if not histogram.sum():
        return DOUBTFUL_BETWEEN[0]
    value = (np.arange(CORRELATION_BINS) + 0.5) / CORRELATION_BINS
    middle = _weighted_median(value, histogram)
    nmad = NMAD_FACTOR * _weighted_median(np.abs(value - middle), histogram)
    return float(np.clip(middle - DOUBTFUL_NMAD * nmad, *DOUBTFUL_BETWEEN))


def _weighted_median(value: FloatArray, weight: IntArray) -> float:
    order = np.argsort(value, kind="stable")
    reached = np.cumsum(weight[order])
    return float(value[order][np.searchsorted(reached, reached[-1] / 2)])


def median_of_known(z: Float32Array) -> Float32Array:
    """Return heights after a median over 3 × 3 cells; a cell without one stays so."""
    has = np.isfinite(z)
    filled = np.where(has, z, np.float32(0.0))
    smooth = median_filter(filled, 3, mode="nearest")
    whole = minimum_filter(has.astype(np.uint8), 3, mode="nearest") > 0
    return np.where(whole, smooth, z).astype(np.float32)


CELL_GSD = 2.0
"""Cell of the surface where none is asked for, in ground sampling distances."""

MINIMUM_RAYS = 2


def default_cell_m(gsd_m: float) -> float:
    """Return the cell of the surface where none is asked for: about CELL_GSD ground sampling distances."""
    return round_near(CELL_GSD * gsd_m, CELL_STEPS)
