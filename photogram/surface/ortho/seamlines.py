"""Which photograph an orthophoto takes where: labels of square blocks of cells, chosen for the whole survey at once.

Each block has a short list of the photographs that see it best, with their costs; neighbouring blocks pay for
different photographs, much near height edges, little on open ground. The sum is made small by sequential
tree-reweighted message passing (Kolmogorov 2006, section 4, TRW-S) on the grid of blocks, always in the same order.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from photogram.arrays import BoolArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.frames import LocalFrame
from photogram.grid import MapGrid, Verticals, Window, verticals
from photogram.projection import FOCAL, OrientedCameras, seen_at
from photogram.surface.ortho.visibility import STRICT, Relief, Terrain, height_at, is_hidden
from photogram.surface.views import Views

CANDIDATES = 12
"""Photographs that a block may be taken from."""

SMALLEST_BLOCK, LARGEST_LATTICE = 8, 400_000
"""Cells along a block, and the number of blocks above which they are made larger."""

MIDDLE_WEIGHT, SCALE_WEIGHT, HIDDEN_COST = 0.5, 0.5, 0.02
"""Costs beside tan² of the angle from the nadir: of r² in the photograph, of the squared logarithm of how much coarser
its pixels are than the finest there, and of being hidden or cut off over the whole of a block."""

SEAM_COST, OPEN_SHARE = 4e-3, 0.01
"""Cost of a seam along a height edge, per flying height over the side of a block, and the share of it on open ground.

From the costs of the photographs: a seam that lies D beside its best place costs some 1.5 b D²/(h² s) more per block of
side s, for a base b of h/5 and a flying height h; it is worth moving it away from an edge by D = 0.115 h."""

STEEP = 1.5
"""Slope over three blocks from which they count as a height edge."""

OBJECT_SIZE, OBJECT_HEIGHT = 0.3, 0.03
"""What is narrower than this and rises above the ground around it by this, in flying heights, counts as a height edge
all over, so that a roof is not cut in two."""

SWEEPS = 15
"""So often messages pass to and fro."""


@dataclass(frozen=True, eq=False)
class Seams:
    """The lattice of blocks of ``block_cells`` × ``block_cells`` cells of a grid.

    ``label`` (R, C): the view that a block is taken from, −1 where none sees it; ``candidate`` (R, C, CANDIDATES): the
    views that see it, best first, then −1; ``clear`` (R, C, CANDIDATES): whether they see all of it; ``height_map_m``
    (R, C): its mean height, NaN where there is no surface.
    """

    block_cells: int
    label: Int32Array
    candidate: Int32Array
    clear: BoolArray
    height_map_m: Float32Array


def block_cells(grid: MapGrid) -> int:
    """Return the side of the blocks of a grid, in cells."""
    side = SMALLEST_BLOCK
    while -(-grid.rows // side) * -(-grid.columns // side) > LARGEST_LATTICE:
        side *= 2
    return side


def find_seams(
    views: Views, frame: LocalFrame, terrain: Terrain, grid: MapGrid, executor: Executor, side_cells: int = 512
) -> Seams:
    """Choose a photograph for every block of a grid; about ``side_cells`` × ``side_cells`` cells at once change nothing
    but memory and time."""
    block = block_cells(grid)
    shape = (-(-grid.rows // block), -(-grid.columns // block))
    candidate = np.full((*shape, CANDIDATES), -1, np.int32)
    cost = np.full((*shape, CANDIDATES), np.inf, np.float32)
    clear = np.zeros((*shape, CANDIDATES), np.bool_)
    height = np.full((*shape, 3), np.nan, np.float32)

    def fill(window: Window) -> None:
        rows = slice(window.row // block, -(-window.row_end // block))
        part = (rows, slice(window.column // block, -(-window.column_end // block)))
        relief, lines = terrain.around(grid, window), verticals(frame, grid, window)
        _rate(
            relief, views.cameras, terrain.position_map_m, grid.centres_map_m(window), bundled_lines(lines),
            (block, block * grid.cell_m),
            (candidate[part], cost[part], clear[part], height[part]),
        )  # fmt: skip

    for done in [executor.submit(fill, window) for window in grid.tiles(max(side_cells // block, 1) * block)]:
        done.result()
    flying = float(np.median(terrain.position_map_m[:, 2]) - np.nanmedian(terrain.surface.values))
    price = _prices(height, block * grid.cell_m, max(flying, block * grid.cell_m))
    label = chosen_labels(candidate, cost, *price, SWEEPS)
    return Seams(block, label, candidate, clear, np.ascontiguousarray(height[..., 0]))


def bundled_lines(lines: Verticals) -> tuple[float, FloatArray, FloatArray]:
    """Return vertical lines as the kernels of orthophotos take them."""
    return lines.base_map_m, lines.foot_world_m, lines.up


def _prices(height: Float32Array, side_m: float, flying_m: float) -> tuple[Float32Array, Float32Array]:
    """Return what a seam costs between blocks and their neighbours to the right, and below (R, C)."""
    low = np.where(np.isnan(height[..., 1]), np.inf, height[..., 1])
    high = np.where(np.isnan(height[..., 2]), -np.inf, height[..., 2])
    range_m = maximum_filter(high, 3, mode="nearest") - minimum_filter(low, 3, mode="nearest")
    steep = np.clip(range_m / (3.0 * side_m * STEEP), 0.0, 1.0) ** 2
    across = 2 * round(0.5 * OBJECT_SIZE * flying_m / side_m) + 1
    ground = maximum_filter(minimum_filter(low, across, mode="nearest"), across, mode="nearest")
    with np.errstate(invalid="ignore"):
        raised = np.clip((height[..., 0] - ground) / (OBJECT_HEIGHT * flying_m), 0.0, 1.0) ** 2
    steep = np.fmax(steep, raised)
    full = SEAM_COST * flying_m / side_m
    price = (full * (OPEN_SHARE + (1.0 - OPEN_SHARE) * steep)).astype(np.float32)
    right, below = price.copy(), price.copy()
    right[:, :-1] = np.maximum(price[:, :-1], price[:, 1:])
    below[:-1] = np.maximum(price[:-1], price[1:])
    return right, below


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _block_heights(
    relief: Relief, east: FloatArray, north: FloatArray, rows: tuple[int, int], columns: tuple[int, int]
) -> tuple[float, float, float]:
    """Return the mean, lowest and highest known height of the cells of a block."""
    total, count, low, high = 0.0, 0, np.inf, -np.inf
    for i in range(rows[0], rows[1]):
        for j in range(columns[0], columns[1]):
            h = height_at(relief, east[j], north[i])
            if not np.isnan(h):
                total, count = total + h, count + 1
                low, high = min(low, h), max(high, h)
    return (total / count, low, high) if count else (np.nan, np.nan, np.nan)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _costs_at(
    cameras: OrientedCameras,
    centre: FloatArray,
    X: FloatArray,
    place: tuple[float, float, float],
    side_m: float,
    out: FloatArray,
) -> None:
    """Fill the costs (V,) of photographs at a place, ``X`` in the world, ``place`` in the map; infinite where it lies
    farther out of a photograph than a block reaches."""
    R, C, size = cameras.rotation, cameras.position, cameras.size_px
    finest = np.inf
    for n in range(len(out)):
        out[n] = np.inf
        u, v, depth = seen_at(cameras, n, X)
        if not depth > 0.0:
            continue
        m = cameras.camera[n]
        focal = cameras.parameters[m, FOCAL]
        margin = side_m * focal / depth
        if u >= -margin and v >= -margin and u <= size[m, 0] - 1.0 + margin and v <= size[m, 1] - 1.0 + margin:
            away2 = (centre[n, 0] - place[0]) ** 2 + (centre[n, 1] - place[1]) ** 2
            above = centre[n, 2] - place[2]
            distance2 = (X[0] - C[n, 0]) ** 2 + (X[1] - C[n, 1]) ** 2 + (X[2] - C[n, 2]) ** 2
            tan2 = min(away2 / (above * above), 100.0) if above > 0.0 else 100.0
            out[n] = tan2 + MIDDLE_WEIGHT * max(distance2 / (depth * depth) - 1.0, 0.0)
            finest = min(finest, depth / focal)
    for n in range(len(out)):
        if np.isfinite(out[n]):
            depth = 0.0
            for k in range(3):
                depth += R[n, k, 2] * (X[k] - C[n, k])
            focal = cameras.parameters[cameras.camera[n], FOCAL]
            out[n] += SCALE_WEIGHT * np.log(depth / focal / finest) ** 2


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _insert(number: int, value: float, candidate: Int32Array, cost: Float32Array) -> None:
    """Put a photograph into a list sorted by cost, the last falls out."""
    k = len(cost) - 1
    if not value < cost[k]:
        return
    while k > 0 and value < cost[k - 1]:
        candidate[k], cost[k] = candidate[k - 1], cost[k - 1]
        k -= 1
    candidate[k], cost[k] = number, value


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def sees(
    cameras: OrientedCameras,
    n: int,
    relief: Relief,
    centre: FloatArray,
    X: FloatArray,
    place: tuple[float, float, float],
    mercy: int,
) -> bool:
    """Return whether the photograph n shows a place of the surface, ``X`` in the world, ``place`` in the map; ``mercy``
    as in ``is_hidden``."""
    u, v, _ = seen_at(cameras, n, X)
    size, m = cameras.size_px, cameras.camera[n]
    if not (u >= -0.5 and v >= -0.5 and u <= size[m, 0] - 0.5 and v <= size[m, 1] - 0.5):
        return False
    return not is_hidden(relief, place, centre[n], mercy)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _rate(
    relief: Relief,
    cameras: OrientedCameras,
    centre: FloatArray,
    cells: tuple[FloatArray, FloatArray],
    lines: tuple[float, FloatArray, FloatArray],
    sides: tuple[int, float],
    out: tuple[Int32Array, Float32Array, BoolArray, Float32Array],
) -> None:
    """Fill candidates, costs, whether all of a block is seen, and heights of the blocks of a window; ``sides`` of a
    block are in cells and in m."""
    candidate, cost, clear, height = out
    block, side_m = sides
    east, north = cells
    base, foot, up = lines
    X, all_costs, order = np.empty(3), np.empty(len(centre)), np.empty(cost.shape[2], np.float32)
    seen = np.empty(cost.shape[2])
    for i in range(height.shape[0]):
        for j in range(height.shape[1]):
            rows = (i * block, min((i + 1) * block, len(north)))
            columns = (j * block, min((j + 1) * block, len(east)))
            mean, low, high = _block_heights(relief, east, north, rows, columns)
            height[i, j, 0], height[i, j, 1], height[i, j, 2] = mean, low, high
            if np.isnan(mean):
                continue
            r, c = (rows[0] + rows[1]) // 2, (columns[0] + columns[1]) // 2
            for k in range(3):
                X[k] = foot[r, c, k] + (mean - base) * up[r, c, k]
            _costs_at(cameras, centre, X, (east[c], north[r], mean), side_m, all_costs)
            for n in range(len(all_costs)):
                if np.isfinite(all_costs[n]):
                    _insert(n, all_costs[n], candidate[i, j], cost[i, j])
            for k in range(len(seen)):
                seen[k] = 0.0
            count = 0.0
            for a in range(4):
                r = rows[0] + (rows[1] - rows[0]) * (1 + 2 * (a // 2)) // 4
                c = columns[0] + (columns[1] - columns[0]) * (1 + 2 * (a % 2)) // 4
                h = height_at(relief, east[c], north[r])
                if np.isnan(h):
                    continue
                count += 1.0
                for k in range(3):
                    X[k] = foot[r, c, k] + (h - base) * up[r, c, k]
                for k in range(len(seen)):
                    n = candidate[i, j, k]
                    if n >= 0 and sees(cameras, n, relief, centre, X, (east[c], north[r], h), STRICT):
                        seen[k] += 1.0
            _order_again(candidate[i, j], cost[i, j], clear[i, j], seen, max(count, 1.0), order)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _order_again(
    candidate: Int32Array, cost: Float32Array, clear: BoolArray, seen: FloatArray, count: float, order: Float32Array
) -> None:
    """Add the cost of what is hidden to that of each candidate, and sort the lists by cost."""
    for k in range(len(order)):
        order[k] = cost[k] + HIDDEN_COST * (1.0 - seen[k] / count)
    before, whole = candidate.copy(), seen == count
    candidate[:] = -1
    cost[:] = np.inf
    for k in range(len(order)):
        if before[k] >= 0:
            _insert(k, order[k], candidate, cost)
    for k in range(len(order)):
        if candidate[k] >= 0:
            clear[k] = whole[candidate[k]]
            candidate[k] = before[candidate[k]]


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _send(
    belief: FloatArray, back: Float32Array, mine: Int32Array, yours: Int32Array, price: float, message: Float32Array
) -> None:
    """Pass a message over an edge of the lattice: ``belief`` (K,) of the sender, already weighted, less what came back
    over the edge; different photographs cost ``price``."""
    least = np.inf
    for a in range(len(mine)):
        if mine[a] >= 0:
            belief[a] -= back[a]
            least = min(least, belief[a])
    if not np.isfinite(least):
        return
    lowest = np.inf
    for b in range(len(yours)):
        if yours[b] >= 0:
            value = least + price
            for a in range(len(mine)):
                if mine[a] == yours[b]:
                    value = min(value, belief[a])
            message[b] = value
            lowest = min(lowest, value)
    if np.isfinite(lowest):
        for b in range(len(yours)):
            message[b] -= lowest


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _sweep(
    candidate: Int32Array,
    cost: Float32Array,
    right: Float32Array,
    below: Float32Array,
    message: Float32Array,
    step: int,
) -> None:
    """Pass messages through the lattice, row by row from the north-west (step 1) or from the south-east (step −1).

    ``message`` (4, R, C, K) are those that a block has from its west, east, north and south.
    """
    rows, columns, k = candidate.shape
    belief, copy = np.empty(k), np.empty(k)
    for a in range(rows):
        i = a if step > 0 else rows - 1 - a
        for b in range(columns):
            j = b if step > 0 else columns - 1 - b
            for n in range(k):
                total = cost[i, j, n] + message[0, i, j, n] + message[1, i, j, n]
                belief[n] = 0.5 * (total + message[2, i, j, n] + message[3, i, j, n])
            if 0 <= j + step < columns:
                price = right[i, j] if step > 0 else right[i, j - 1]
                copy[:] = belief
                back, to = (1, 0) if step > 0 else (0, 1)
                _send(
                    copy, message[back, i, j], candidate[i, j], candidate[i, j + step], price, message[to, i, j + step]
                )
            if 0 <= i + step < rows:
                price = below[i, j] if step > 0 else below[i - 1, j]
                copy[:] = belief
                back, to = (3, 2) if step > 0 else (2, 3)
                _send(
                    copy, message[back, i, j], candidate[i, j], candidate[i + step, j], price, message[to, i + step, j]
                )


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def chosen_labels(
    candidate: Int32Array, cost: Float32Array, right: Float32Array, below: Float32Array, sweeps: int
) -> Int32Array:
    """Return labels (R, C) out of lists ``candidate`` (R, C, K) with costs, sorted, that make small the sum of costs
    and of what differing neighbours pay: ``right`` and ``below`` (R, C); −1 where a list is empty."""
    rows, columns, k = candidate.shape
    message = np.zeros((4, rows, columns, k), np.float32)
    for _ in range(sweeps):
        _sweep(candidate, cost, right, below, message, 1)
        _sweep(candidate, cost, right, below, message, -1)
    label = np.full((rows, columns), -1, np.int32)
    for i in range(rows):
        for j in range(columns):
            least = np.inf
            for n in range(k):
                if candidate[i, j, n] < 0:
                    break
                value = cost[i, j, n] + message[1, i, j, n] + message[3, i, j, n]
                if j > 0 and label[i, j - 1] >= 0 and label[i, j - 1] != candidate[i, j, n]:
                    value += right[i, j - 1]
                if i > 0 and label[i - 1, j] >= 0 and label[i - 1, j] != candidate[i, j, n]:
                    value += below[i - 1, j]
                if value < least:
                    least, label[i, j] = value, candidate[i, j, n]
    return label
