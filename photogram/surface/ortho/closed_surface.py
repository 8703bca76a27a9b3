"""The surface on which photographs become an orthophoto: the DSM, sharp where it is sure, smooth in canopy, closed.

Where the cells around are measured and hang together the DSM is taken as it is, walls and roofs with it. Where they do
not, in crowns above all, a photograph that is resampled on every single height is torn to pieces; there the surface is
made of medians over some forty cells, averaged again, and its standard deviation is the spread of the heights about
them. Whether a cell is one or the other is decided by the best of nine windows around it (after Nagao & Matsuyama
1979), so that a roof keeps its edge. What is not measured at all is filled from coarser and coarser means (pull-push,
Gortler et al. 1996). The result is for the orthophoto alone: these heights are in no surface model.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from photogram.arrays import NMAD_FACTOR, BoolArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.grid import MapGrid, Window
from photogram.surface.dsm import SUPPORT
from photogram.surface.nearest_heights import known_of_block
from photogram.surface.planes import support_of_cells, surface_slopes

BLOCK_CELLS = 4
"""Side of the blocks whose medians make the smooth surface."""

AROUND_BLOCKS = 4
"""Blocks to each side of one whose medians belong to its own median."""

BLUR_BLOCKS = 4.0
"""Standard deviation, in blocks, of the weights with which medians are averaged."""

LEAST_CELLS = 12
"""Fewer measured cells than these in all of them make no median."""

WINDOW_CELLS = 25
"""Side of the windows in which cells hang together, or not."""

SURE_SHARE, TORN_SHARE = 0.8, 0.55
"""Share of cells that hang together in the best window around a cell from which it is as the DSM has it, and below
which it is smooth; between, it is something of both."""

UNSURE_CELLS = 2.0
"""Standard deviation, in cells, that a smooth surface has at least: what it hides is not sure."""

TILE_CELLS = 1024

_MARGIN_CELLS = 28
_OFF = WINDOW_CELLS // 2

CANOPY_SHARE = 0.25
"""Share of the cells around that are torn, measured or told by larger cells, from which what is empty between them
belongs to a crown; else it is ground that something hides, or that has no texture."""

PartOf = Callable[[Window], tuple[Float32Array, BoolArray, Float32Array]]
"""Gives of a window (rows, columns) the heights with holes closed, NaN where they are not; which are measured; and the
standard deviations of these, infinite where larger cells alone tell a height."""

GroundOf = Callable[[Window], Float32Array]
"""Gives of a window (rows, columns) the ground between the ground that is measured."""


@dataclass(frozen=True, eq=False)
class SmoothSurface:
    """Smooth heights around the blocks of a grid (R, C), and the spread of the heights about them."""

    height: Float32Array
    spread: Float32Array


def close_surface(
    grid: MapGrid,
    part_of: PartOf,
    executor: Executor,
    write: Callable[[Window, Float32Array, Float32Array], None],
    ground_of: GroundOf | None = None,
) -> None:
    """Make the closed surface of a grid: ``write`` takes windows with their heights and standard deviations (rows,
    columns), from several threads. Nothing is written where nothing is measured. What is empty beside canopy lies on
    the ground, where it is given."""
    shape = (-(-grid.rows // BLOCK_CELLS), -(-grid.columns // BLOCK_CELLS))
    height = np.empty(shape, np.float32)
    spread = np.empty(shape, np.float32)
    loose = np.empty(shape, np.bool_)
    crown = np.empty(shape, np.float32)

    def medians(window: Window) -> None:
        outer = grid.around_window(window, AROUND_BLOCKS * BLOCK_CELLS + _MARGIN_CELLS)
        known, measured, sigma = part_of(outer)
        values = np.where(measured, known, np.float32(np.nan))
        block, count = _block_medians(values)
        cells = _torn(values, sigma, grid.cell_m)
        torn = _block_means(cells) > 0.5
        told = _block_means(((cells > 0.5) & (measured | np.isinf(sigma))).astype(np.float32))
        row, column = ((a - b) // BLOCK_CELLS for a, b in ((window.row, outer.row), (window.column, outer.column)))
        blocks = window.coarser(BLOCK_CELLS)
        rows, columns = blocks.shape
        _medians_around(block, count, torn, (row, column), height[blocks.slices], spread[blocks.slices])
        loose[blocks.slices] = torn[row : row + rows, column : column + columns]
        around = cv2.blur(told.astype(np.float32), (2 * AROUND_BLOCKS + 1,) * 2, borderType=cv2.BORDER_REPLICATE)
        crown[blocks.slices] = around[row : row + rows, column : column + columns]

    tiles = list(grid.tiles(TILE_CELLS))
    for _ in executor.map(medians, tiles):
        pass
    if not np.isfinite(height).any():
        return
    smooth = _smoothed(filled_from_coarser(height), filled_from_coarser(spread), loose)

    def close(window: Window) -> None:
        write(window, *_closed(grid, part_of, smooth, window, crown, ground_of))

    for _ in executor.map(close, tiles):
        pass


def _smoothed(height: Float32Array, spread: Float32Array, loose: BoolArray) -> SmoothSurface:
    """Return heights and spreads (R, C) of blocks, those of loose ones averaged with the loose ones around them."""
    level = float(np.median(height))
    share = _blurred(loose.astype(np.float64))
    means = [
        np.where(loose, _blurred(np.where(loose, values - base, 0.0)) / np.maximum(share, 1e-12) + base, values)
        for values, base in ((height, level), (spread, 0.0))
    ]
    return SmoothSurface(means[0].astype(np.float32), means[1].astype(np.float32))


def _blurred(values: FloatArray) -> FloatArray:
    return np.asarray(gaussian_filter(values, BLUR_BLOCKS, mode="nearest", truncate=2.5))


def _closed(
    grid: MapGrid,
    part_of: PartOf,
    smooth: SmoothSurface,
    window: Window,
    crown: Float32Array,
    ground_of: GroundOf | None,
) -> tuple[Float32Array, Float32Array]:
    """Return the closed heights and their standard deviations in a window."""
    outer = grid.around_window(window, _MARGIN_CELLS)
    known, measured, sigma = part_of(outer)
    at = window.within(outer)
    torn = _torn(np.where(measured, known, np.float32(np.nan)), sigma, grid.cell_m)[at]
    known, own = known[at], np.where(measured, sigma, np.float32(grid.cell_m))[at]
    level, spread = (_between_blocks(a, window) for a in (smooth.height, smooth.spread))
    if ground_of is not None:
        bare = ~measured[at] & ~np.isinf(sigma[at]) & (_between_blocks(crown, window) < CANOPY_SHARE)
        known = np.where(bare & np.isnan(known), ground_of(window), known)
        torn = np.where(bare, np.float32(0.0), torn)
    torn = np.where(np.isnan(known), np.float32(1.0), torn)
    height = np.where(torn > 0, torn * level + (1 - torn) * np.where(torn < 1, known, np.float32(0.0)), known)
    loose = np.maximum(spread, np.float32(UNSURE_CELLS * grid.cell_m))
    return height.astype(np.float32), np.sqrt((1 - torn) * own**2 + torn * loose**2).astype(np.float32)


def _torn(height: Float32Array, sigma: Float32Array, cell_m: float) -> Float32Array:
    """Return how far each cell is to be smooth, 0 to 1: by the share of cells that hang together in the best of the
    nine windows that hold it in their middle, on a side or in a corner."""
    supported = (support_of_cells(height, surface_slopes(height, cell_m), sigma, cell_m) >= SUPPORT).astype(np.uint8)
    # whole numbers: a running mean of others depends on where it began
    side = (WINDOW_CELLS, WINDOW_CELLS)
    count = cv2.boxFilter(supported, cv2.CV_32S, side, normalize=False, borderType=cv2.BORDER_CONSTANT)
    together = (count / np.float32(WINDOW_CELLS**2)).astype(np.float32)
    padded = np.pad(together, _OFF)
    best = np.zeros_like(together)
    rows, columns = together.shape
    for down in (0, _OFF, 2 * _OFF):
        for right in (0, _OFF, 2 * _OFF):
            best = np.maximum(best, padded[down : down + rows, right : right + columns])
    return np.asarray(np.clip((SURE_SHARE - best) / (SURE_SHARE - TORN_SHARE), 0.0, 1.0), np.float32)


@njit(cache=True, nogil=True)
def _middle(values: FloatArray, count: int) -> float:
    """Return the median of the first ``count`` values, and sort them (insertion)."""
    for n in range(1, count):
        value, k = values[n], n
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value
    return float(0.5 * (values[(count - 1) // 2] + values[count // 2]))


@njit(cache=True, nogil=True)
def _fill_blocks(height: Float32Array, out: Float32Array, count: Int32Array) -> None:
    values = np.empty(BLOCK_CELLS * BLOCK_CELLS)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            n = known_of_block(height, BLOCK_CELLS, i, j, values)
            count[i, j], out[i, j] = n, np.nan
            if n:
                out[i, j] = _middle(values, n)


def _block_medians(height: Float32Array) -> tuple[Float32Array, Int32Array]:
    """Return the median of the known heights of every block (R, C), NaN where there are none, and their number."""
    shape = tuple(-(-n // BLOCK_CELLS) for n in height.shape)
    out, count = np.empty(shape, np.float32), np.empty(shape, np.int32)
    _fill_blocks(height, out, count)
    return out, count


def _block_means(values: Float32Array) -> FloatArray:
    """Return the means (R, C) of blocks of values, those at the south and east as large as there are cells."""
    total = values.astype(np.float64)
    size = np.ones(values.shape)
    for axis in (0, 1):
        starts = np.arange(0, values.shape[axis], BLOCK_CELLS)
        total, size = np.add.reduceat(total, starts, axis=axis), np.add.reduceat(size, starts, axis=axis)
    return np.asarray(total / size)


@njit(cache=True, nogil=True)
def _medians_around(
    block: Float32Array,
    count: Int32Array,
    torn: BoolArray,
    first: tuple[int, int],
    height: Float32Array,
    spread: Float32Array,
) -> None:
    """Fill the medians of the block medians of torn blocks around every torn block, from the block ``first`` on, and
    1.4826 times the median of their distances from it, NaN with fewer than LEAST_CELLS; of others their own median."""
    side = 2 * AROUND_BLOCKS + 1
    values = np.empty(side * side)
    for i in range(height.shape[0]):
        for j in range(height.shape[1]):
            n, cells = 0, 0
            r, c = first[0] + i, first[1] + j
            if not torn[r, c]:
                height[i, j], spread[i, j] = block[r, c], 0.0 if count[r, c] else np.nan
                continue
            for a in range(max(r - AROUND_BLOCKS, 0), min(r + AROUND_BLOCKS + 1, block.shape[0])):
                for b in range(max(c - AROUND_BLOCKS, 0), min(c + AROUND_BLOCKS + 1, block.shape[1])):
                    if torn[a, b] and count[a, b]:
                        values[n] = block[a, b]
                        n, cells = n + 1, cells + count[a, b]
            height[i, j], spread[i, j] = np.nan, np.nan
            if cells < LEAST_CELLS:
                continue
            middle = _middle(values, n)
            for k in range(n):
                values[k] = abs(values[k] - middle)
            height[i, j], spread[i, j] = middle, NMAD_FACTOR * _middle(values, n)


def filled_from_coarser(values: Float32Array) -> Float32Array:
    """Return values (R, C) with what is NaN taken, linearly between, from means over twice the side, and these from
    theirs; NaN all over where nothing is known."""
    known = np.isfinite(values)
    if known.all() or not known.any() or max(values.shape) == 1:
        return values
    rows, columns = (n + n % 2 for n in values.shape)
    total, count = np.zeros((rows, columns)), np.zeros((rows, columns))
    total[: values.shape[0], : values.shape[1]] = np.where(known, values, 0.0)
    count[: values.shape[0], : values.shape[1]] = known
    shape = (rows // 2, 2, columns // 2, 2)
    total, count = total.reshape(shape).sum(axis=(1, 3)), count.reshape(shape).sum(axis=(1, 3))
    half = np.where(count > 0, total / np.maximum(count, 1.0), np.nan).astype(np.float32)
    coarser = filled_from_coarser(half)
    row, column = ((np.arange(n) + 0.5) / 2 - 0.5 for n in values.shape)
    return np.where(known, values, _linear(coarser, row, column)).astype(np.float32)


def _between_blocks(values: Float32Array, window: Window) -> Float32Array:
    """Return values of blocks linearly between their centres at the cells of a window."""
    row, column = (
        (np.arange(a, b) + 0.5) / BLOCK_CELLS - 0.5
        for a, b in ((window.row, window.row_end), (window.column, window.column_end))
    )
    return _linear(values, row, column)


def _linear(values: Float32Array, row: FloatArray, column: FloatArray) -> Float32Array:
    """Return values (R, C) at rows and columns, linear between; beyond the last centre its value goes on."""
    indices = []
    for place, n in ((row, values.shape[0]), (column, values.shape[1])):
        place = np.clip(place, 0.0, n - 1.0)
        low = np.minimum(np.floor(place).astype(int), max(n - 2, 0))
        indices.append((low, np.minimum(low + 1, n - 1), (place - low).astype(np.float32)))
    (r0, r1, down), (c0, c1, right) = indices
    upper, lower = values[r0], values[r1]
    between = upper * (1 - down[:, None]) + lower * down[:, None]
    return np.asarray(between[:, c0] * (1 - right) + between[:, c1] * right, np.float32)
