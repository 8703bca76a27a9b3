"""Digital terrain model (DTM) from a surface: houses and trees taken away, the gaps interpolated, with sigma.

`ground_filter` finds in blocks of cells what stands on the ground; between the blocks on the ground the terrain is
linear. Cells are looked at tile by tile; what is held for the whole survey are the blocks, and a bit for each cell.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter, maximum_filter
from threadpoolctl import threadpool_limits

from photogram.arrays import BoolArray, Float32Array, FloatArray, IntArray
from photogram.compilation import njit
from photogram.errors import SurfaceError
from photogram.grid import MapGrid, Window
from photogram.settings.settings import Default, Settings, Within
from photogram.surface.ground_filter import LEAST_M, nearest_known, on_ground
from photogram.surface.nearest_heights import known_of_block
from photogram.surface.terrain_sigma import interpolated_sigma
from photogram.survey import Raster

ReadSurface = Callable[[Window], tuple[Float32Array, Float32Array]]
"""Gives of a window the heights (rows, columns) of a surface, whose holes may be closed, and their standard deviations,
NaN where nothing was measured."""

ReadOwn = Callable[[Window], Float32Array]
"""Gives of a window the part of these standard deviations that cells do not share."""

BLOCK_M = 0.5
"""Side of the blocks in which ground is looked for, where cells are smaller."""

MAXIMUM_BLOCKS = 4_000_000
"""Ground is looked for in so many blocks at most; those of a larger surface are made larger."""

BARE_SHARE = 0.001
"""Less of what was measured stands on bare ground."""

_NO_GROUND = "terrain: no ground found in the surface: set terrain.enabled to false, or look at dsm.tif"
_LOW_SHARE = 0.2  # of the known cells of a block, sorted, lie below its low height
_MARGIN_M = 0.5  # around what is high, whose edges a surface smears
_EDGE_M = 0.25
_FAR_M = 2.0
_LEAST_SIGMAS = 3.0
_HIGH = 3.0  # least heights of an object
_SUPPORT = 0.25  # of a block's cells lie on the ground where its mean carries the terrain
_TILE_CELLS = 1024
_SAMPLED_CELLS = 4_000_000  # of the standard deviations make their median


USUAL_CELL_M = 0.05
"""Side of a cell where it is not known yet."""


def expected_blocks(cells: float, cell_m: float | None) -> float:
    """Return in about how many blocks ground is looked for in so many cells of a surface."""
    return min(cells * min(((cell_m or USUAL_CELL_M) / BLOCK_M) ** 2, 1.0), MAXIMUM_BLOCKS)


@dataclass(frozen=True)
class TerrainSettings(Settings):
    """How ground is separated from the surface. Lengths are those of what stands on the ground, bushes, cars and
    houses, and do not follow the picture; nothing is looked for that is smaller than a cell of the surface."""

    gone: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("cell_m", "cloth_m", "rigidness", "reach_m", "step_m", "margin_m"),
        "belonged to the cloth simulation, which a filter without settings has replaced: remove this line",
    )

    enabled: Annotated[
        bool | None, "Whether a terrain model is made.", Default("where houses, trees or cars stand on matched ground")
    ] = None
    maximum_gap_m: Annotated[float, Within(0.001, 100_000, "m"), "What is further from any ground stays open."] = 30.0


@dataclass(frozen=True, eq=False)
class Terrain:
    """A DTM on the grid of its surface, its standard deviations, and which of its cells (rows, columns) are
    interpolated: what stood there is no ground."""

    heights: Raster
    sigma: Raster
    interpolated: BoolArray


@dataclass(frozen=True, eq=False)
class TerrainTile:
    """The same of a window, arrays (rows, columns)."""

    height: Float32Array
    sigma: Float32Array
    interpolated: BoolArray


@dataclass(frozen=True, eq=False)
class TerrainModel:
    """The terrain under a surface, from which windows are made.

    ``between`` and ``deviation`` are heights and standard deviations in blocks (R, C) of ``block`` cells to a side,
    for what is interpolated, and ``shared_m`` (R, C) what the sigmas of cells have in common there; ``kept`` holds by
    tile, packed, which cells lie on the ground; ``standing`` is the share of the measured cells that stand high above
    it.
    """

    grid: MapGrid
    read: ReadSurface
    block: int
    between: FloatArray
    deviation: FloatArray
    shared_m: FloatArray
    kept: Mapping[Window, NDArray[np.uint8]]
    standing: float

    @property
    def is_bare(self) -> bool:
        """Return whether next to nothing stands on the ground, so that the surface is the terrain."""
        return self.standing < BARE_SHARE

    @property
    def windows(self) -> tuple[Window, ...]:
        """Return the windows that ``tile`` takes, row by row."""
        return tuple(self.kept)

    def tile(self, window: Window) -> TerrainTile:
        """Return the terrain in a window."""
        height, sigma = self.read(window)
        there, ground = np.isfinite(height), _unpacked(self.kept[window], window)
        between, alone, shared = (
            _refined(of, self.block, window) for of in (self.between, self.deviation, self.shared_m)
        )
        spread = np.hypot(alone, shared)
        heights = np.where(ground, height, np.where(there, between, np.float32(np.nan))).astype(np.float32)
        sigmas = np.where(ground, sigma, np.where(np.isfinite(heights), spread, np.nan)).astype(np.float32)
        return TerrainTile(heights, sigmas, np.isfinite(heights) & ~ground)


def terrain_from_surface(surface: Raster, sigma: Raster, settings: TerrainSettings | None = None) -> Terrain:
    """Take away what does not lie on the ground: ``terrain_model`` of rasters, whole."""

    def read(window: Window) -> tuple[Float32Array, Float32Array]:
        return surface.values[window.slices], sigma.values[window.slices]

    model = terrain_model(MapGrid.of(surface), read, settings)
    heights, sigmas = (np.empty(surface.values.shape, np.float32) for _ in range(2))
    interpolated = np.empty(surface.values.shape, np.bool_)
    for window in model.windows:
        tile = model.tile(window)
        for whole, part in ((heights, tile.height), (sigmas, tile.sigma), (interpolated, tile.interpolated)):
            whole[window.slices] = part
    return Terrain(model.grid.raster(heights), model.grid.raster(sigmas), interpolated)


def terrain_model(
    grid: MapGrid, read: ReadSurface, settings: TerrainSettings | None = None, read_own: ReadOwn | None = None
) -> TerrainModel:
    """Take away what does not lie on the ground.

    The surface may have its holes closed: where it has no standard deviation it was not measured, and is not looked at.
    Measured cells on the ground keep the surface's height and sigma; the others take the height between the ground
    around them, linear in the triangles of the blocks' means, and a sigma by their distance from it. ``read_own`` gives
    the part of a surface's sigma that its cells do not share, all of it if None: what they share, as the height of a
    survey that GNSS alone has placed, hides nothing that stands on the ground. Cells without data stay so, and what is
    wider than the maximum gap is left open. The same surface gives the same terrain. Raises SurfaceError where there is
    no ground in the surface.
    """
    settings = settings or TerrainSettings()
    block, windows = _blocks_of(grid)
    side_m, blocks = grid.cell_m * block, grid.coarser(block)
    low = _low_heights(grid, read, windows, block, read_own)
    rough, least_m = _rough_ground(low, grid.cell_m * block), low.least_m
    steps = np.gradient(gaussian_filter(rough, 1.0), side_m) if min(rough.shape) > 1 else (0, 0)
    rise = np.broadcast_to(0.5 * side_m * np.hypot(*steps), rough.shape)
    margin = round(_MARGIN_M / grid.cell_m)
    kept, standing, known = dict[Window, NDArray[np.uint8]](), 0, 0
    firm, weak = (_Sums.of(blocks) for _ in range(2))
    for window in windows:
        outer = grid.around_window(window, margin)
        values = _measured(*read(outer))
        off = values - _refined(rough, block, outer)
        high = (off > _HIGH * least_m).astype(np.uint8)
        at = window.within(outer)
        # what a surface smears over an edge bears on the terrain around it only where there is no other ground near
        near, beside = (_near(high, length / grid.cell_m)[at] for length in (_EDGE_M, _MARGIN_M))
        off, high = off[at], high[at]
        on = np.abs(off) <= least_m + _refined(rise, block, window)
        for sums, of in ((firm, on & ~beside), (weak, on & ~near)):
            sums.add(window.coarser(block), block, off, of)
        kept[window] = np.packbits(on & ~near)
        standing, known = standing + int(np.count_nonzero(high)), known + int(np.isfinite(off).sum())
    sides = [np.minimum(block, count - block * np.arange(-(-count // block))) for count in (grid.rows, grid.columns)]
    firm_share, weak_share = (sums.count / np.outer(*sides) for sums in (firm, weak))
    supported = (firm_share > 0) & (firm_share >= min(_SUPPORT, float(firm_share.max())))
    far = distance_transform_edt(~supported) * side_m > _FAR_M if supported.any() else np.ones(rough.shape, dtype=bool)
    supported |= far & (weak_share >= _SUPPORT)
    if not supported.any():
        raise SurfaceError(_NO_GROUND)
    mean = rough + np.where(far, weak.mean(), firm.mean())
    fill, gap_m = linear_between(mean, supported), distance_transform_edt(~supported) * side_m
    deviation = interpolated_sigma(mean, supported, side_m, linear_between)
    fill[gap_m > settings.maximum_gap_m] = np.nan
    return TerrainModel(grid, read, block, fill, deviation, low.shared_m, kept, standing / max(known, 1))


def ground_between(grid: MapGrid, read: ReadSurface) -> Callable[[Window], Float32Array] | None:
    """Return what gives of windows the heights (rows, columns) between the lowest ground of blocks, None where there is
    no ground: the terrain but for its details."""
    block, windows = _blocks_of(grid)
    try:
        rough = _rough_ground(_low_heights(grid, read, windows, block), grid.cell_m * block)
    except SurfaceError:
        return None
    return lambda window: _refined(rough, block, window)


def _blocks_of(grid: MapGrid) -> tuple[int, tuple[Window, ...]]:
    """Return of how many cells the sides of blocks are, and the windows in which they are looked at."""
    cells = grid.rows * grid.columns
    block = max(1, round(BLOCK_M / grid.cell_m), int(np.ceil(np.sqrt(cells / MAXIMUM_BLOCKS))))
    return block, tuple(grid.tiles(block * max(_TILE_CELLS // block, 1)))


@dataclass(frozen=True, eq=False)
class _LowHeights:
    """Of blocks (R, C) a low height that single wrong cells do not lower, NaN where none is known, ``low_m``, and what
    the standard deviations of their cells have in common, ``shared_m``; what stands on the ground at least, m."""

    low_m: FloatArray
    shared_m: FloatArray
    least_m: float


def _rough_ground(low: _LowHeights, side_m: float) -> FloatArray:
    """Return the low heights (R, C) of blocks on the ground, linear between. Raises SurfaceError where there is no
    ground."""
    ground = on_ground(low.low_m, side_m, low.least_m)
    if not ground.any():
        raise SurfaceError(_NO_GROUND)
    return linear_between(low.low_m, ground)


@dataclass(frozen=True, eq=False)
class _Sums:
    """Numbers (R, C) of cells in blocks, and the sums (R, C) of what they are off."""

    count: IntArray
    total_m: FloatArray

    @staticmethod
    def of(blocks: MapGrid) -> "_Sums":
        shape = blocks.rows, blocks.columns
        return _Sums(np.zeros(shape, np.int64), np.zeros(shape))

    def add(self, blocks: Window, block: int, off_m: Float32Array, which: BoolArray) -> None:
        """Add the cells (rows, columns) of some blocks, ``which`` of them."""
        _add_cells(off_m, which, block, self.count[blocks.slices], self.total_m[blocks.slices])

    def mean(self) -> FloatArray:
        """Return the means (R, C), NaN of no cell."""
        return np.where(self.count > 0, self.total_m / np.maximum(self.count, 1), np.nan)


def _measured(height: Float32Array, sigma: Float32Array) -> Float32Array:
    return np.where(np.isfinite(sigma), height, np.float32(np.nan)).astype(np.float32)


def _unpacked(kept: NDArray[np.uint8], window: Window) -> BoolArray:
    rows, columns = window.shape
    return np.unpackbits(kept, count=rows * columns).reshape(rows, columns).astype(np.bool_)


def _near(high: NDArray[np.uint8], cells: float) -> BoolArray:
    return np.asarray(maximum_filter(high, 2 * round(cells) + 1) > 0)


def _low_heights(
    grid: MapGrid, read: ReadSurface, windows: tuple[Window, ...], block: int, read_own: ReadOwn | None = None
) -> _LowHeights:
    blocks, stride = grid.coarser(block), -(-grid.rows * grid.columns // _SAMPLED_CELLS)
    low, sigmas, shared = np.full((blocks.rows, blocks.columns), np.nan), [], _Sums.of(blocks)
    for window in windows:
        height, sigma = read(window)
        own = sigma if read_own is None else read_own(window)
        _fill_low(_measured(height, sigma), block, low[window.coarser(block).slices])
        known = np.isfinite(sigma) & np.isfinite(own)
        common = np.sqrt(np.maximum(np.where(known, sigma, 0.0) ** 2 - np.where(known, own, 0.0) ** 2, np.float32(0.0)))
        shared.add(window.coarser(block), block, common, known)
        sigmas.append(own[known][::stride])
    spread, has = np.concatenate(sigmas), shared.count > 0
    shared_m = linear_between(shared.mean(), has) if has.any() else np.zeros(has.shape)
    return _LowHeights(
        low, shared_m, max(LEAST_M, _LEAST_SIGMAS * float(np.median(spread))) if len(spread) else LEAST_M
    )


@njit(cache=True, nogil=True)
def _fill_low(height: Float32Array, block: int, low: FloatArray) -> None:
    values = np.empty(block * block)
    for i in range(low.shape[0]):
        for j in range(low.shape[1]):
            n = known_of_block(height, block, i, j, values)
            if n:
                values[:n].sort()
                low[i, j] = values[int(_LOW_SHARE * (n - 1))]


@njit(cache=True, nogil=True)
def _add_cells(off: Float32Array, which: BoolArray, block: int, count: IntArray, total: FloatArray) -> None:
    for r in range(off.shape[0]):
        for c in range(off.shape[1]):
            if which[r, c]:
                count[r // block, c // block] += 1
                total[r // block, c // block] += off[r, c]


def linear_between(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return values of a grid where ``known``, elsewhere linear between those around; outside them the nearest."""
    result = values.copy()
    unknown = ~known
    if not unknown.any():
        return result
    result[unknown] = nearest_known(values, known)[unknown]
    edge = known & binary_dilation(unknown, np.ones((3, 3), dtype=bool))
    places = np.argwhere(edge)
    if np.linalg.matrix_rank(places - places[:1]) == 2:
        with threadpool_limits(1, "blas"):  # SciPy solves a 2 × 2 system per triangle, which threads make slower by far
            linear = LinearNDInterpolator(places, values[edge])(np.argwhere(unknown))
        result[unknown] = np.where(np.isfinite(linear), linear, result[unknown])
    return result


def _refined(blocks: FloatArray, block: int, window: Window) -> Float32Array:
    """Return values of blocks at the centres of the cells of a window, bilinear between the blocks' middles."""
    row = (np.arange(window.row, window.row_end) + 0.5) / block - 0.5
    column = (np.arange(window.column, window.column_end) + 0.5) / block - 0.5
    out = np.empty(window.shape, np.float32)
    _fill_between(blocks, row, column, out)
    return out


@njit(cache=True, nogil=True)
def _fill_between(values: FloatArray, row: FloatArray, column: FloatArray, out: Float32Array) -> None:
    last_i, last_j = values.shape[0] - 1, values.shape[1] - 1
    for r in range(len(row)):
        down = min(max(row[r], 0.0), float(last_i))
        i = min(int(down), max(last_i - 1, 0))
        ii, down = min(i + 1, last_i), down - i
        for c in range(len(column)):
            right = min(max(column[c], 0.0), float(last_j))
            j = min(int(right), max(last_j - 1, 0))
            jj, right = min(j + 1, last_j), right - j
            above = (1.0 - right) * values[i, j] + right * values[i, jj]
            below = (1.0 - right) * values[ii, j] + right * values[ii, jj]
            out[r, c] = (1.0 - down) * above + down * below
