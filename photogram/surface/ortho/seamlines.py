"""Which photograph an orthophoto takes where: labels of square blocks of cells, chosen for the whole survey at once.

Each block has a short list of the photographs that see it best, with their costs; neighbouring blocks pay for
different photographs: much near height edges, and where the photographs show different things there, little on open
ground on which they agree.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Window, cell_steps, vertical_nodes
from photogram.projection import FOCAL, OrientedCameras, seen_called
from photogram.surface.ortho.labelling import DIFFERENCE_UNIT, chosen_labels
from photogram.surface.ortho.visibility import MASKED, VISIBLE, SeenCells, SurfaceModel, height_at, place_between
from photogram.surface.views import Views

Number = TypeVar("Number", bound=np.generic)

CANDIDATES = 8
"""Photographs that a block may be taken from, in part."""

LABELS = 5
"""Photographs that the whole of a block may be taken from."""

SMALLEST_BLOCK, LARGEST_LATTICE = 8, 400_000
"""Cells along a block, and the number of blocks above which they are made larger."""

MIDDLE_WEIGHT, SCALE_WEIGHT, HIDDEN_COST = 0.5, 0.5, 0.02
"""Costs beside tan² of the angle from the nadir: of r² in the photograph, of the squared logarithm of how much coarser
its pixels are than the finest there, and of being hidden or cut off over the whole of a block."""

MASKED_COST = 10.0
"""Cost of a photograph that is masked over the whole of a block: more than that of any other that sees it."""

SEAM_COST, OPEN_SHARE = 4e-3, 0.01
"""Cost of a seam along a height edge, per flying height over the side of a block, and the share of it on open ground.

From the costs of the photographs: a seam that lies D beside its best place costs some 1.5 b D²/(h² s) more per block of
side s, for a base b of h/5 and a flying height h; it is worth moving it away from an edge by D = 0.115 h."""

DIFFERENCE_DN = 40.0
"""Mean difference of two balanced photographs over a block, in grey levels, that costs a seam as much as a height
edge; less of it costs the square of its share."""

STEEP = 1.5
"""Slope over three blocks from which they count as a height edge."""

OBJECT_SIZE, OBJECT_HEIGHT = 0.3, 0.03
"""What is narrower than this and rises above the ground around it by this, in flying heights, counts as a height edge
all over, so that a roof is not cut in two."""

SWEEPS = 10
"""So often messages pass to and fro."""

SAMPLES = 4
"""Places along a block at which photographs are looked up and compared."""

FORCED_COST = -1000.0
"""Of the photograph that is asked for in a block."""

_HEIGHTS_ALONG = 8
_FAR_SHARE = 0.02  # of the depth: a height that differs more is projected by itself


@dataclass(frozen=True, eq=False)
class Lattice:
    """The lattice of blocks of ``block_cells`` × ``block_cells`` cells of a grid, and what photographs see of it."""

    block_cells: int
    candidate: Int32Array
    """The views (R, C, CANDIDATES) that show a block, best first, then −1."""
    cost: Float32Array
    """What each costs (R, C, CANDIDATES)."""
    height_map_m: Float32Array
    """Mean, lowest and highest height (R, C, 3), NaN where there is no surface."""
    sample_map_m: Float32Array
    """Height at SAMPLES² places (R, C, SAMPLES²), NaN where there is no surface."""
    centre_world_m: FloatArray
    """The centre of each block at its mean height (R, C, 3)."""
    seen: ByteArray
    """At how many of SAMPLES² places (R, C, CANDIDATES) each sees the block."""
    inside: BoolArray
    """Whether it shows all of the block (R, C, CANDIDATES), hidden or not."""
    grey: ByteArray
    """Its grey values (R, C, CANDIDATES, SAMPLES²), 0 beside the photograph and where it is masked."""
    looks: ByteArray
    """How many photographs (R, C) show the middle of the block."""
    masked: ByteArray
    """At how many of SAMPLES² places (R, C, CANDIDATES) each is masked."""

    @staticmethod
    def unseen(
        block: int, candidate: Int32Array, cost: Float32Array, height: Float32Array, sample: Float32Array,
        centre: FloatArray, looks: ByteArray,
    ) -> Lattice:  # fmt: skip
        """Return a lattice that nobody has looked at."""
        nothing = np.zeros(candidate.shape, np.uint8)
        grey = np.zeros((*candidate.shape, SAMPLES**2), np.uint8)
        inside, masked = nothing.astype(np.bool_), nothing.copy()
        return Lattice(block, candidate, cost, height, sample, centre, nothing, inside, grey, looks, masked)

    @property
    def clear(self) -> BoolArray:
        """Return whether each candidate (R, C, CANDIDATES) sees all of a block."""
        return np.asarray(self.seen == SAMPLES**2)


@dataclass(frozen=True, eq=False)
class Seams:
    """The photographs of the blocks of a lattice.

    ``label`` (R, C): the view that a block is taken from, −1 where none sees it; ``candidate`` (R, C, CANDIDATES): the
    views that see it, best first, then −1; ``clear`` (R, C, CANDIDATES): whether they see all of it, ``inside`` whether
    they show all of it; ``height_map_m`` (R, C): its mean height, NaN where there is no surface; ``looks`` (R, C): how
    many photographs show its middle.
    """

    block_cells: int
    label: Int32Array
    candidate: Int32Array
    clear: BoolArray
    inside: BoolArray
    height_map_m: Float32Array
    looks: ByteArray


def block_cells(grid: MapGrid) -> int:
    """Return the side of the blocks of a grid, in cells."""
    side = SMALLEST_BLOCK
    while -(-grid.rows // side) * -(-grid.columns // side) > LARGEST_LATTICE:
        side *= 2
    return side


def rate_blocks(
    views: Views,
    frame: LocalFrame,
    terrain: SurfaceModel,
    grid: MapGrid,
    executor: Executor,
    forced: Int32Array | None = None,
    side_cells: int = 512,
) -> Lattice:
    """Return the lattice of a grid with the candidates of each block, not yet looked at.

    ``forced`` (R, C) is the view that a block is to be taken from, if it shows it, −1 for none. About ``side_cells`` ×
    ``side_cells`` cells at once change nothing but memory and time.
    """
    block = block_cells(grid)
    blocks = grid.coarser(block)
    shape = blocks.rows, blocks.columns
    wanted = np.full(shape, -1, np.int32) if forced is None else forced
    candidate = np.full((*shape, CANDIDATES), -1, np.int32)
    cost = np.full((*shape, CANDIDATES), np.inf, np.float32)
    height = np.full((*shape, 3), np.nan, np.float32)
    sample = np.full((*shape, SAMPLES**2), np.nan, np.float32)
    beyond = int(np.ceil(block * grid.cell_m / terrain.grid.cell_m)) + 1  # as far as the last blocks reach
    centre = np.zeros((*shape, 3))
    looks = np.zeros(shape, np.uint8)

    def fill(window: Window) -> None:
        part = window.coarser(block).slices
        near, around = terrain.cells_around(grid, window, 1), terrain.cells_around(grid, window, beyond)
        _rate(
            terrain.heights(around), _corner(terrain.grid, around), views.cameras, terrain.views_over(near),
            terrain.position_map_m, grid.centres_map_m(window), (window.row, window.column),
            (float(frame.origin_map_m[2]), vertical_nodes(frame, grid, window)), (block, block * grid.cell_m),
            wanted[part], (candidate[part], cost[part], height[part], sample[part], centre[part], looks[part]),
            (np.empty(3), np.empty(len(views)), np.empty(len(views))),
        )  # fmt: skip

    for done in [executor.submit(fill, window) for window in grid.tiles(max(side_cells // block, 1) * block)]:
        done.result()
    return Lattice.unseen(block, candidate, cost, height, sample, centre, looks)


def sample_blocks(
    views: Views, frame: LocalFrame, terrain: SurfaceModel, grid: MapGrid, lattice: Lattice, seen: SeenCells, view: int,
    picture: ByteArray,
) -> None:  # fmt: skip
    """Fill in what a photograph sees of the blocks that list it: how much, and the grey values of its ``picture``
    (H, W, 3), none of an empty one.

    Photographs may be looked at in any order, and at the same time.
    """
    box = terrain.boxes[view]
    if box is None:
        return
    blocks, dsm = grid.coarser(lattice.block_cells), terrain.grid
    corner = np.array([dsm.west_map_m, dsm.north_map_m])
    low = corner + dsm.cell_m * np.array([box.column, -box.row])
    high = corner + dsm.cell_m * np.array([box.column_end, -box.row_end])
    columns = np.floor((np.array([low[0], high[0]]) - blocks.west_map_m) / blocks.cell_m).astype(int)
    rows = np.floor((blocks.north_map_m - np.array([low[1], high[1]])) / blocks.cell_m).astype(int)
    part = (
        slice(max(rows[0] - 1, 0), max(rows[1] + 2, 0)), slice(max(columns[0] - 1, 0), max(columns[1] + 2, 0))
    )  # fmt: skip
    first = (part[0].start, part[1].start)
    east, south = cell_steps(frame, grid)
    up = -np.cross(east, south)
    up /= np.linalg.norm(up)
    _sample_blocks(
        views.cameras, view, _corner(dsm, box), seen.of(view), picture,
        (blocks.west_map_m, blocks.north_map_m, blocks.cell_m), first, (east, south, up), lattice.block_cells,
        lattice.candidate[part], lattice.height_map_m[part], lattice.sample_map_m[part], lattice.centre_world_m[part],
        (lattice.seen[part], lattice.inside[part], lattice.grey[part], lattice.masked[part]), np.empty(3),
    )  # fmt: skip


def seams_of(lattice: Lattice, terrain: SurfaceModel, grid: MapGrid, log_gain: FloatArray) -> Seams:
    """Return the photographs that make small the sum of all costs; ``log_gain`` (V,) is the logarithm of by how much
    each view is too bright."""
    rated = _ordered(lattice)
    flying = float(np.median(terrain.position_map_m[:, 2]) - np.nanmedian(rated.height_map_m[..., 0]))
    side = lattice.block_cells * grid.cell_m
    right, below, full = _prices(rated.height_map_m, side, max(flying, side))
    candidate = np.ascontiguousarray(rated.candidate[..., :LABELS])
    cost = np.ascontiguousarray(rated.cost[..., :LABELS])
    right_by, below_by = (np.zeros((*candidate.shape, LABELS), np.uint8) for _ in range(2))
    _compare(rated.candidate, rated.grey, log_gain, right_by, below_by)
    label = chosen_labels(candidate, cost, (right, below), (right_by, below_by, full * DIFFERENCE_UNIT), SWEEPS)
    return Seams(
        lattice.block_cells, label, rated.candidate, rated.clear, rated.inside,
        np.ascontiguousarray(rated.height_map_m[..., 0]), rated.looks,
    )  # fmt: skip


def _corner(grid: MapGrid, window: Window) -> tuple[float, float, float]:
    """Return the outer corner of a window of a grid, easting and northing, and the side of a cell."""
    west, north = grid.west_map_m + window.column * grid.cell_m, grid.north_map_m - window.row * grid.cell_m
    return float(west), float(north), float(grid.cell_m)


def _ordered(lattice: Lattice) -> Lattice:
    """Return a lattice with the cost of what is hidden and masked added, and its lists sorted by cost."""
    share = lattice.seen.astype(np.float32) / np.float32(SAMPLES**2)
    cost = np.where(lattice.candidate >= 0, lattice.cost + np.float32(HIDDEN_COST) * (1 - share), np.float32(np.inf))
    if lattice.masked.any():
        cost += np.float32(MASKED_COST / SAMPLES**2) * lattice.masked
    order = np.argsort(cost, axis=2, kind="stable")

    def sort(values: NDArray[Number]) -> NDArray[Number]:
        return np.ascontiguousarray(np.take_along_axis(values, order, axis=2))

    grey = np.ascontiguousarray(np.take_along_axis(lattice.grey, order[..., None], axis=2))
    return replace(
        lattice, candidate=sort(lattice.candidate), cost=sort(cost), seen=sort(lattice.seen),
        inside=sort(lattice.inside), grey=grey,
    )  # fmt: skip


def _prices(height: Float32Array, side_m: float, flying_m: float) -> tuple[Float32Array, Float32Array, float]:
    """Return what a seam costs between blocks and their neighbours to the right, and below (R, C), and at a height
    edge."""
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
    return right, below, float(full)


@njit(cache=True, nogil=True)
def _block_heights(
    height: Float32Array,
    corner: tuple[float, float, float],
    east: FloatArray,
    north: FloatArray,
    rows: tuple[int, int],
    columns: tuple[int, int],
) -> tuple[float, float, float]:
    """Return the mean, lowest and highest known height of the cells of a block, of at most 8 × 8 of them."""
    total, count, low, high = 0.0, 0, np.inf, -np.inf
    step = max((rows[1] - rows[0]) // _HEIGHTS_ALONG, 1)
    across = max((columns[1] - columns[0]) // _HEIGHTS_ALONG, 1)
    for i in range(rows[0], rows[1], step):
        for j in range(columns[0], columns[1], across):
            h = height_at(height, (corner[1] - north[i]) / corner[2], (east[j] - corner[0]) / corner[2])
            if not np.isnan(h):
                total, count = total + h, count + 1
                low, high = min(low, h), max(high, h)
    return (total / count, low, high) if count else (np.nan, np.nan, np.nan)


@njit(cache=True, nogil=True)
def _cost_at(
    cameras: OrientedCameras,
    n: int,
    centre: FloatArray,
    X: FloatArray,
    place: tuple[float, float, float],
    side_m: float,
) -> tuple[float, float, bool]:
    """Return what a photograph costs at a place, ``X`` in the world, ``place`` in the map, but for its scale: infinite
    where it lies farther out of it than a block reaches; the size of its pixel there; and whether it shows it."""
    C, size = cameras.position, cameras.size_px
    u, v, depth = seen_called(cameras, np.int64(n), X[0], X[1], X[2])
    if not depth > 0.0:
        return np.inf, np.inf, False
    m = cameras.camera[n]
    focal = cameras.parameters[m, FOCAL]
    margin = side_m * focal / depth
    right, bottom = size[m, 0] - 1.0, size[m, 1] - 1.0
    if not (u >= -margin and v >= -margin and u <= right + margin and v <= bottom + margin):
        return np.inf, np.inf, False
    away2 = (centre[n, 0] - place[0]) ** 2 + (centre[n, 1] - place[1]) ** 2
    above = centre[n, 2] - place[2]
    distance2 = (X[0] - C[n, 0]) ** 2 + (X[1] - C[n, 1]) ** 2 + (X[2] - C[n, 2]) ** 2
    tan2 = min(away2 / (above * above), 100.0) if above > 0.0 else 100.0
    cost = tan2 + MIDDLE_WEIGHT * max(distance2 / (depth * depth) - 1.0, 0.0)
    return cost, depth / focal, u >= 0.0 and v >= 0.0 and u <= right and v <= bottom


@njit(cache=True, nogil=True)
def _insert(number: int, value: float, candidate: Int32Array, cost: Float32Array) -> None:
    """Put a photograph into a list sorted by cost, the last falls out."""
    k = len(cost) - 1
    if not value < cost[k]:
        return
    while k > 0 and value < cost[k - 1]:
        candidate[k], cost[k] = candidate[k - 1], cost[k - 1]
        k -= 1
    candidate[k], cost[k] = number, value


@njit(cache=True, nogil=True, _nrt=False)
def _rate(
    surface: Float32Array,
    corner: tuple[float, float, float],
    cameras: OrientedCameras,
    near: Int32Array,
    centre: FloatArray,
    cells: tuple[FloatArray, FloatArray],
    first: tuple[int, int],
    lines: tuple[float, FloatArray],
    sides: tuple[int, float],
    wanted: Int32Array,
    out: tuple[Int32Array, Float32Array, Float32Array, Float32Array, FloatArray, ByteArray],
    room: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Fill candidates, costs, heights, sampled heights, centres and how many photographs look at the blocks of a
    window; ``near`` are the photographs that may, ``sides`` of a block in cells and in m.

    Arrays are made outside (``room``), here and in other loops over cells: where none is made references need not be
    counted, and a projection takes 15 ns, not 140.
    """
    candidate, cost, height, sample, middle, looks = out
    block, side_m = sides
    east, north = cells
    base, nodes = lines
    X, own, pixel = room
    half, along = 0.5 * side_m / block, side_m / corner[2]
    for i in range(height.shape[0]):
        for j in range(height.shape[1]):
            rows = (i * block, min((i + 1) * block, len(north)))
            columns = (j * block, min((j + 1) * block, len(east)))
            mean, low, high = _block_heights(surface, corner, east, north, rows, columns)
            height[i, j, 0], height[i, j, 1], height[i, j, 2] = mean, low, high
            if np.isnan(mean):
                continue
            y = (corner[1] - north[rows[0]] - half) / corner[2]
            x = (east[columns[0]] - half - corner[0]) / corner[2]
            for a in range(SAMPLES * SAMPLES):
                down, right = (a // SAMPLES + 0.5) / SAMPLES, (a % SAMPLES + 0.5) / SAMPLES
                sample[i, j, a] = height_at(surface, y + down * along, x + right * along)
            r, c = (rows[0] + rows[1]) // 2, (columns[0] + columns[1]) // 2
            place_between(nodes, first, first[0] + r, first[1] + c, mean - base, X)
            for k in range(3):
                middle[i, j, k] = X[k]
            finest = np.inf
            for k in range(len(near)):
                own[k], pixel[k], shown = _cost_at(cameras, near[k], centre, X, (east[c], north[r], mean), side_m)
                finest = min(finest, pixel[k])
                if shown and looks[i, j] < 255:
                    looks[i, j] += 1
            for k in range(len(near)):
                if np.isfinite(own[k]):
                    own[k] += SCALE_WEIGHT * np.log(pixel[k] / finest) ** 2
                    _insert(near[k], FORCED_COST if near[k] == wanted[i, j] else own[k], candidate[i, j], cost[i, j])


@njit(nogil=True, inline="always")
def _seen_beside(
    cameras: OrientedCameras, view: int, centre: FloatArray, steps: float, step: FloatArray, X: FloatArray
) -> tuple[float, float, float]:
    """Return what ``seen_at`` does of the place (3,) so many steps (3,) from another, which X is filled with."""
    for k in range(3):
        X[k] = centre[k] + steps * step[k]
    return seen_called(cameras, view, X[0], X[1], X[2])


@njit(cache=True, nogil=True)
def _grey_at(picture: ByteArray, u: float, v: float) -> int:
    """Return the grey value, 1 to 255, of a photograph around the pixel (u, v): the mean of four pixels."""
    c = min(max(int(np.floor(u)), 0), picture.shape[1] - 2)
    r = min(max(int(np.floor(v)), 0), picture.shape[0] - 2)
    total = 0
    for a in range(2):
        for b in range(2):
            total += picture[r + a, c + b, 0] + 2 * picture[r + a, c + b, 1] + picture[r + a, c + b, 2]
    return max(total // 16, 1)


@njit(cache=True, nogil=True, _nrt=False)
def _sample_blocks(
    cameras: OrientedCameras,
    view: int,
    corner: tuple[float, float, float],
    seen: ByteArray,
    picture: ByteArray,
    blocks: tuple[float, float, float],
    first: tuple[int, int],
    steps: tuple[FloatArray, FloatArray, FloatArray],
    block: int,
    candidate: Int32Array,
    height: Float32Array,
    sample: Float32Array,
    middle: FloatArray,
    out: tuple[ByteArray, BoolArray, ByteArray, ByteArray],
    X: FloatArray,
) -> None:
    """Fill how much of the blocks a photograph sees, whether it shows all of them, its grey values there, and how much
    of them is masked.

    ``steps`` (3,) are those of a cell to the east and to the south, and of a metre up, in the world. A photograph is
    linear over a block, but where its surface is far from its mean height. ``X`` (3,) is room.
    """
    count, inside, grey, masked = out
    m = cameras.camera[view]
    width, rows_px = cameras.size_px[m, 0] - 0.5, cameras.size_px[m, 1] - 0.5
    east, south, up = steps
    half, has_picture = 0.5 * block, len(picture) > 0
    step_m = half * np.sqrt(east[0] ** 2 + east[1] ** 2 + east[2] ** 2)
    for i in range(candidate.shape[0]):
        for j in range(candidate.shape[1]):
            k = -1
            for n in range(candidate.shape[2]):
                if candidate[i, j, n] == view:
                    k = n
            if k < 0:
                continue
            centre = middle[i, j]
            u0, v0, depth = seen_called(cameras, view, centre[0], centre[1], centre[2])
            eu, ev, _ = _seen_beside(cameras, view, centre, half, east, X)
            su, sv, _ = _seen_beside(cameras, view, centre, half, south, X)
            hu, hv, _ = _seen_beside(cameras, view, centre, step_m, up, X)
            whole = True
            for a in range(SAMPLES * SAMPLES):
                down, right = (a // SAMPLES + 0.5) / SAMPLES - 0.5, (a % SAMPLES + 0.5) / SAMPLES - 0.5
                e = blocks[0] + (first[1] + j + 0.5 + right) * blocks[2]
                n_ = blocks[1] - (first[0] + i + 0.5 + down) * blocks[2]
                h = sample[i, j, a]
                y, x = int(np.floor((corner[1] - n_) / corner[2])), int(np.floor((e - corner[0]) / corner[2]))
                if np.isnan(h) or y < 0 or x < 0 or y >= seen.shape[0] or x >= seen.shape[1]:
                    whole = False
                    continue
                rise = h - height[i, j, 0]
                if abs(rise) < _FAR_SHARE * depth:
                    s, t, w = 2.0 * right, 2.0 * down, rise / step_m
                    u = u0 + s * (eu - u0) + t * (su - u0) + w * (hu - u0)
                    v = v0 + s * (ev - v0) + t * (sv - v0) + w * (hv - v0)
                else:
                    for b in range(3):
                        X[b] = middle[i, j, b] + block * (right * east[b] + down * south[b]) + rise * up[b]
                    u, v, _ = seen_called(cameras, view, X[0], X[1], X[2])
                if not (u >= -0.5 and v >= -0.5 and u <= width and v <= rows_px):
                    whole = False
                    continue
                margin = 2.0 + 0.25 * (abs(eu - u0) + abs(su - u0))
                low = 2.0 + 0.25 * (abs(ev - v0) + abs(sv - v0))
                if u < margin or v < low or u > width - margin or v > rows_px - low:
                    whole = False
                if seen[y, x] == MASKED:
                    masked[i, j, k] += 1
                elif has_picture:
                    grey[i, j, k, a] = _grey_at(picture, u, v)
                if seen[y, x] == VISIBLE:
                    count[i, j, k] += 1
            inside[i, j, k] = whole


@njit(cache=True, nogil=True)
def _place(number: int, candidate: Int32Array) -> int:
    for k in range(len(candidate)):
        if candidate[k] == number:
            return k
    return -1


@njit(cache=True, nogil=True)
def _add_differences(candidate: Int32Array, grey: ByteArray, factor: FloatArray, sums: FloatArray) -> None:
    """Fill the differences of each two candidates (K,) of a block and their number: ``sums`` (K, K, 2)."""
    sums[:] = 0.0
    for a in range(len(candidate)):
        for b in range(a):
            if candidate[a] < 0 or candidate[b] < 0:
                continue
            one, other, total, count = factor[candidate[a]], factor[candidate[b]], 0.0, 0.0
            for n in range(grey.shape[1]):
                if grey[a, n] > 0 and grey[b, n] > 0:
                    total += abs(one * grey[a, n] - other * grey[b, n])
                    count += 1.0
            sums[a, b, 0], sums[a, b, 1] = total, count
            sums[b, a, 0], sums[b, a, 1] = total, count


@njit(cache=True, nogil=True, error_model="numpy")
def _compare_two(
    mine: Int32Array, yours: Int32Array, in_mine: FloatArray, in_yours: FloatArray, out: ByteArray
) -> None:
    """Fill how much the candidates (K,) of two blocks differ over both (K, K), as _compare says, from the differences
    (K, K, 2) in each."""
    for a in range(len(mine)):
        if mine[a] < 0:
            continue
        there = _place(mine[a], yours)
        for b in range(len(yours)):
            if yours[b] < 0 or mine[a] == yours[b]:
                continue
            here, total, count = _place(yours[b], mine), 0.0, 0.0
            if here >= 0:
                total, count = total + in_mine[a, here, 0], count + in_mine[a, here, 1]
            if there >= 0:
                total, count = total + in_yours[there, b, 0], count + in_yours[there, b, 1]
            share = min(total / count / DIFFERENCE_DN, 1.0) if count > 0.0 else 0.0
            out[a, b] = np.uint8(share * share / DIFFERENCE_UNIT + 0.5)


@njit(cache=True, nogil=True)
def _compare(candidate: Int32Array, grey: ByteArray, log_gain: FloatArray, right: ByteArray, below: ByteArray) -> None:
    """Fill how much the candidates of each block and those of its neighbours differ over both: the square of their mean
    difference in DIFFERENCE_DN, at most 1, in DIFFERENCE_UNIT."""
    rows, columns, k = candidate.shape
    factor = np.exp(-log_gain)
    sums = np.empty((2, columns, k, k, 2))  # of a row of blocks and of the next
    for i in range(rows):
        own, next_ = sums[i % 2], sums[(i + 1) % 2]
        for j in range(columns):
            if i == 0:
                _add_differences(candidate[0, j], grey[0, j], factor, own[j])
            if i + 1 < rows:
                _add_differences(candidate[i + 1, j], grey[i + 1, j], factor, next_[j])
        for j in range(columns):
            if j + 1 < columns:
                _compare_two(candidate[i, j], candidate[i, j + 1], own[j], own[j + 1], right[i, j])
            if i + 1 < rows:
                _compare_two(candidate[i, j], candidate[i + 1, j], own[j], next_[j], below[i, j])
