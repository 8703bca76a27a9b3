"""Orthophoto: photographs resampled on the surface, each cell from the photograph that shows it best.

Three steps: ``find_seams`` chooses a photograph for every block of cells, for the whole survey at once;
``balance_exposure`` makes the photographs equally bright; then tile by tile each cell is read from the photograph of
its block, from another where that one does not see it, and across seams from both for a few cells. What a cell holds
depends on its place alone, never on the tile in which it is made.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray
from photogram.compilation import njit
from photogram.errors import PhotogramError, check_positive, check_range
from photogram.frames import LocalFrame
from photogram.grid import MapGrid, Window, cell_steps, vertical_nodes
from photogram.projection import OrientedCameras, ideal_point, lens_of, seen_at, without_field
from photogram.surface.ortho.colour_balance import (
    KNEE_DN,
    WHITE_DN,
    Balance,
    PixelsOf,
    balance_exposure,
    highlight_curve,
    joined,
)
from photogram.surface.ortho.looks import Looks
from photogram.surface.ortho.masked_cells import Masks
from photogram.surface.ortho.resampling import Tone, add_photograph
from photogram.surface.ortho.seamlines import (
    SMALLEST_BLOCK,
    Seams,
    block_cells,
    lattice_grid,
    rate_blocks,
    seams_of,
)
from photogram.surface.ortho.visibility import (
    BESIDE,
    MASKED,
    UNSURE_CELLS,
    VISIBLE,
    SeenCells,
    Surface,
    Terrain,
    height_at,
    place_between,
)
from photogram.surface.views import Views
from photogram.survey import Raster

ForcedOf = Callable[[MapGrid], Int32Array]
"""Gives the view (R, C) that each block of a grid of blocks is to be taken from, −1 for any."""

LEAST_HELD = 4
"""Decoded photographs that are kept, however little memory there is."""


TILE_CELLS = 512
GROUP_TILES = 8
"""Tiles along a square of them that is finished before the next is begun."""
TILES_AHEAD = 4
"""Tiles that are worked on, or wait, at the same time."""

MIXED = 4
"""Photographs that a cell may be mixed of."""

SLIVER_CELLS = 3
"""Width up to which something hidden is a sliver, in cells of the surface: half a window of the matching."""

ONLY_MASKED = 1
"""Alpha of cells that photographs show in masked pixels alone, until they are written as transparent."""

EDGE_CELLS = 4.0
"""Difference in height within five cells, in cells, from which there is a height edge: 45° are no edge."""

_EDGE_REACH = 2
_NOTHING = np.zeros((0, 1, 1), np.uint8)


@dataclass(frozen=True)
class OrthophotoSettings:
    """How photographs become an orthophoto."""

    enabled: bool = True
    """Whether they do."""
    cell_m: float | None = None
    """Side of a cell; None: ground sampling distance, rounded to two digits."""
    balance: bool = True
    """Whether photographs are balanced radiometrically."""
    feather_cells: float = 4.0
    """Width of a seam in cells, 0 for a sharp one."""
    seams: str | None = None
    """File of seams, polygons with the photograph of each, that are taken as they are."""

    def __post_init__(self) -> None:
        if self.cell_m is not None:
            check_positive("cell_m", self.cell_m)
        check_range("feather_cells", self.feather_cells, 0, SMALLEST_BLOCK)


def ground_sampling_distance_m(views: Views, terrain: Terrain) -> float:
    """Return the median over the photographs of the side of a pixel on the ground below them, in m.

    Ground without a height counts with the mean of the heights there are.
    """
    dsm, low = terrain.grid, terrain.coarse[0]
    column = np.floor((terrain.position_map_m[:, 0] - dsm.west_map_m) / dsm.cell_m).astype(int)
    row = np.floor((dsm.north_map_m - terrain.position_map_m[:, 1]) / dsm.cell_m).astype(int)
    ground = np.full(len(views), float(np.mean(terrain.coarse[:, np.isfinite(low)])))
    for n in np.flatnonzero((row >= 0) & (row < dsm.rows) & (column >= 0) & (column < dsm.columns)).tolist():
        height = float(terrain.heights(Window(int(row[n]), int(column[n]), int(row[n]) + 1, int(column[n]) + 1))[0, 0])
        ground[n] = height if np.isfinite(height) else ground[n]
    return float(np.median((terrain.position_map_m[:, 2] - ground) / views.focal_px))


def orthophoto_grid(views: Views, terrain: Terrain, cell_m: float | None = None) -> MapGrid:
    """Return the grid of an orthophoto over all of the surface that has heights.

    Raises PhotogramError where no photograph is above the surface.
    """
    if cell_m is None:
        gsd = ground_sampling_distance_m(views, terrain)
        if not gsd > 0:
            raise PhotogramError("orthophoto: the photographs are not above the surface: check the surface's heights")
        cell_m = float(f"{gsd:.1e}")
    dsm = terrain.grid
    rows, columns = np.zeros(dsm.rows, np.bool_), np.zeros(dsm.columns, np.bool_)
    for window in dsm.tiles(2 * TILE_CELLS):
        known = np.isfinite(terrain.heights(window))
        rows[window.slices[0]] |= known.any(axis=1)
        columns[window.slices[1]] |= known.any(axis=0)
    row, column = np.flatnonzero(rows)[[0, -1]], np.flatnonzero(columns)[[0, -1]]
    east = dsm.west_map_m + np.array([column[0], column[1] + 1]) * dsm.cell_m
    north = dsm.north_map_m - np.array([row[0], row[1] + 1]) * dsm.cell_m
    return MapGrid.around(np.column_stack([east, north]), cell_m)


@dataclass(frozen=True, eq=False)
class Orthophoto:
    """All that the cells of an orthophoto follow from."""

    views: Views
    frame: LocalFrame
    terrain: Terrain
    grid: MapGrid
    seams: Seams
    balance: Balance
    seen: SeenCells
    feather_cells: float
    highlights: float
    """How much what is brighter than KNEE_DN is drawn together, see ``highlight_curve``."""
    plain: BoolArray
    """Blocks (R, C) of one photograph, which shows all of them, among eight of the same."""

    @property
    def blocks(self) -> MapGrid:
        """Return the grid of the blocks of the seams."""
        return lattice_grid(self.grid, self.seams.block_cells)

    def tone(self, view: int) -> Tone:
        """Return by what the colours of a view are multiplied."""
        cameras = self.views.cameras
        camera = cameras.camera[view]
        width, height = cameras.size_px[camera]
        corners = np.array([[u, v] for u in (-0.5, width - 0.5) for v in (-0.5, height - 0.5)])
        largest = float(np.max(ideal_radius2(cameras, int(camera), corners)))
        return Tone.of(self.balance.log_gain[view], self.balance.falloff[view], largest)

    def tile(self, window: Window, pixels_of: PixelsOf) -> ByteArray:
        """Return red, green, blue and alpha (rows, columns, 4) of a window; one photograph at a time is held.

        Alpha is 0 where there is no surface, or no photograph that sees it, ONLY_MASKED where none does but in pixels
        that its mask leaves out, else 255.
        """
        terrain, half = self.terrain, int(np.ceil(0.5 * SLIVER_CELLS * self.terrain.grid.cell_m / self.grid.cell_m))
        wide = self.grid.around_window(window, 4 * half)
        shape, near = wide.shape, terrain.cells_around(self.grid, wide, _EDGE_REACH + 1)
        height, cell_m = terrain.heights(near), terrain.grid.cell_m
        over = terrain.views_over(near)
        slot = np.full(len(self.views), -1, np.int32)
        slot[over] = np.arange(len(over))
        seen = np.stack([self.seen.part(n, near) for n in over.tolist()]) if len(over) else _NOTHING
        chosen = _Chosen(
            np.full((*shape, MIXED), -1, np.int32), np.zeros((*shape, MIXED), np.float32), np.zeros((*shape, 3)),
            np.zeros(len(self.views), np.bool_), np.zeros(shape, np.bool_), np.zeros(shape, np.bool_),
        )  # fmt: skip
        unsure = terrain.tolerances_m(near) > UNSURE_CELLS * cell_m
        corner = terrain.grid.west_map_m, terrain.grid.north_map_m, cell_m, near.row, near.column
        cells, at = self.grid.centres_map_m(wide), (wide.row, wide.column)
        relief = (height, _edges(height, cell_m), unsure, seen, slot)
        _choose(
            relief, corner, self.views.cameras, cells, at,
            (float(self.frame.origin_map_m[2]), vertical_nodes(self.frame, self.grid, wide)),
            (self.seams.label, self.seams.candidate, self.seams.inside, self.plain),
            (self.seams.block_cells, self.feather_cells / self.seams.block_cells), over, chosen,
            (np.empty(3), np.empty(MIXED, np.int32), np.empty(MIXED)),
        )  # fmt: skip
        if (slivers := _slivers(chosen.hidden, half)).any():
            _close(
                slivers, corner, self.views.cameras, cells, at, self.seams.candidate,
                self.seams.block_cells, over, (seen, slot), chosen,
            )  # fmt: skip
        colour = np.zeros((*shape, 3), np.float32)
        sides = cell_steps(self.frame, self.grid)
        for view in np.flatnonzero(chosen.used).tolist():
            tone, picture = self.tone(view), pixels_of(view)
            add_photograph(
                view, picture, self.views.cameras, (tone.factor, tone.per_radius2), chosen.place, sides, chosen.label,
                chosen.weight, colour, np.empty((4, 4)),
            )  # fmt: skip
        rgba = np.empty((*shape, 4), np.uint8)
        _rounded(colour, chosen.label, self.highlights, rgba)
        rgba[chosen.masked, 3] = ONLY_MASKED
        row, column = window.row - wide.row, window.column - wide.column
        return np.ascontiguousarray(rgba[row : row + window.shape[0], column : column + window.shape[1]])

    def tiles(
        self, pixels_of: PixelsOf, executor: Executor, side: int = TILE_CELLS
    ) -> Iterator[tuple[Window, ByteArray]]:
        """Yield all windows of ``side`` × ``side`` cells with their colours, in squares of GROUP_TILES × GROUP_TILES of
        them, so that photographs that are decoded for one serve its neighbours."""
        waiting: deque[tuple[Window, Future[ByteArray]]] = deque()
        for window in _grouped(self.grid, side):
            waiting.append((window, executor.submit(self.tile, window, pixels_of)))
            if len(waiting) >= TILES_AHEAD:
                first, future = waiting.popleft()
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()


def _grouped(grid: MapGrid, side: int) -> Iterator[Window]:
    for group in grid.tiles(side * GROUP_TILES):
        for row in range(group.row, group.row_end, side):
            for column in range(group.column, group.column_end, side):
                yield Window(row, column, min(row + side, group.row_end), min(column + side, group.column_end))


def plan_orthophoto(
    views: Views,
    frame: LocalFrame,
    surface: Raster | Surface,
    pixels_of: PixelsOf,
    executor: Executor,
    settings: OrthophotoSettings | None = None,
    *,
    grid: MapGrid | None = None,
    camera: NDArray[np.int64] | None = None,
    forced: ForcedOf | None = None,
    masks: Masks | None = None,
) -> Orthophoto:
    """Choose the seams and the gains of an orthophoto; then its tiles can be made.

    ``surface`` holds heights of the map, NaN where there is none; ``pixels_of`` gives the photograph of a view, and may
    be asked from several threads at once. ``camera`` (V,) is the camera of each view, all of one where it is not given;
    ``forced`` gives for the grid of the blocks which view each is to be taken from, −1 for any; ``masks`` which pixels
    of the photographs are used, all where it is not given. Raises PhotogramError where no photograph is
    above the surface, or the surface has no height.
    """
    settings = settings or OrthophotoSettings()
    looks = rated_looks(views, frame, surface, executor, settings, grid=grid, forced=forced, masks=masks)
    samples = list(executor.map(lambda view: looks.at(view, pixels_of(view)), range(len(views))))
    return chosen_orthophoto(looks, samples, settings, camera)


def rated_looks(
    views: Views, frame: LocalFrame, surface: Raster | Surface, executor: Executor, settings: OrthophotoSettings, *,
    grid: MapGrid | None = None, forced: ForcedOf | None = None, masks: Masks | None = None,
) -> Looks:  # fmt: skip
    """Rate the photographs of each block by where they were taken: ``plan_orthophoto`` before photographs are read."""
    terrain = Terrain.under(views, frame, Surface.of(surface) if isinstance(surface, Raster) else surface)
    grid = grid or orthophoto_grid(views, terrain, settings.cell_m)
    wanted = None if forced is None else forced(lattice_grid(grid, block_cells(grid)))
    return Looks.of(views, frame, terrain, grid, rate_blocks(views, frame, terrain, grid, executor, wanted), masks)


def chosen_orthophoto(
    looks: Looks,
    samples: Sequence[tuple[IntArray, FloatArray]],
    settings: OrthophotoSettings,
    camera: NDArray[np.int64] | None,
) -> Orthophoto:
    """Choose seams and gains once all photographs were looked at, with the ``samples`` (V,) that ``Looks.at`` gave."""
    balance = Balance.none(len(looks.views))
    if settings.balance:
        cameras = np.zeros(len(looks.views), np.int64) if camera is None else camera
        balance = balance_exposure(joined(samples), cameras)
    log_gain = balance.log_gain.mean(axis=1)
    seams = seams_of(looks.lattice, looks.terrain, looks.grid, log_gain)
    highlights = highlight_curve(looks.lattice, seams.label, log_gain)
    return Orthophoto(
        looks.views, looks.frame, looks.terrain, looks.grid, seams, balance, looks.seen, settings.feather_cells,
        highlights, plain_blocks(seams),
    )  # fmt: skip


def plain_blocks(seams: Seams) -> BoolArray:
    """Return the blocks (R, C) of one photograph, which shows all of them, among eight of the same."""
    label = seams.label
    same = (maximum_filter(label, 3, mode="nearest") == label) & (minimum_filter(label, 3, mode="nearest") == label)
    whole = ((seams.candidate == label[..., None]) & seams.inside).any(axis=2)
    return np.asarray(same & whole & (label >= 0))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def ideal_radius2(cameras: OrientedCameras, camera: int, pixel: FloatArray) -> FloatArray:
    """Return the squared ideal radii (N,) of pixels (N, 2); 16 where a pixel shows no direction in front."""
    out, q = np.empty(len(pixel)), lens_of(cameras.parameters, camera)
    for n in range(len(pixel)):
        u, v = without_field(cameras, camera, pixel[n, 0], pixel[n, 1])
        x, y = ideal_point(cameras.model[camera], q, u, v)
        r2 = x * x + y * y
        out[n] = min(r2, 16.0) if np.isfinite(r2) else 16.0
    return out


class _Chosen(NamedTuple):
    """Of what the cells of a window are made: ``label`` (R, C, MIXED) the photographs, −1 for none, the ones there are
    first; ``weight`` (R, C, MIXED); ``place`` (R, C, 3) the centre of each cell on the surface, world; ``used`` (V,)
    which photographs are needed; ``masked`` (R, C) which cells none shows because of masks, ``hidden`` (R, C) which
    none shows for another reason."""

    label: Int32Array
    weight: Float32Array
    place: FloatArray
    used: BoolArray
    masked: BoolArray
    hidden: BoolArray


def _slivers(hidden: BoolArray, half: int) -> BoolArray:
    """Return which cells (R, C) belong to slivers of what is ``hidden`` in all photographs: no window of ± ``half``
    cells fits into them, or into anything hidden within 2 ``half`` of them, whose tips they would be. Whether anything
    so narrow is hidden is beyond the resolution of the surface."""
    if not hidden.any():
        return hidden
    window, near = np.ones((2 * half + 1,) * 2, np.uint8), np.ones((4 * half + 1,) * 2, np.uint8)
    wide = cv2.dilate(cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, window), near)
    return np.asarray(hidden & (wide == 0))


def _edges(height: Float32Array, cell_m: float) -> BoolArray:
    """Return whether there is a height edge within two cells."""
    known = np.isfinite(height)
    low, high = np.where(known, height, np.float32(np.inf)), np.where(known, height, np.float32(-np.inf))
    around = np.ones((2 * _EDGE_REACH + 1,) * 2, np.uint8)
    with np.errstate(invalid="ignore"):
        step = cv2.dilate(high, around) - cv2.erode(low, around)
    return np.asarray(step > EDGE_CELLS * cell_m)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _rounded(colour: Float32Array, label: Int32Array, curve: float, out: ByteArray) -> None:
    """Fill red, green, blue and alpha (R, C, 4); what is brighter than KNEE_DN by x becomes brighter by
    x / (1 + ``curve`` x)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            shown = label[i, j, 0] >= 0
            for k in range(3):
                value = colour[i, j, k]
                if value > KNEE_DN:
                    value = KNEE_DN + (value - KNEE_DN) / (1.0 + curve * (value - KNEE_DN))
                value = min(max(np.rint(value), 0.0), WHITE_DN)
                out[i, j, k] = np.uint8(value) if shown else np.uint8(0)
            out[i, j, 3] = np.uint8(255) if shown else np.uint8(0)


@njit(cache=True, nogil=True, inline="always")  # type: ignore[misc, unused-ignore]
def _shares(row: int, column: int, block: int, label: Int32Array, found: Int32Array, share: FloatArray) -> bool:
    """Fill the labels (4,) of the blocks around the centre of a cell of the grid, each once, else −1, and how much of a
    bilinear mean they make; False where there are none."""
    y, x = (row + 0.5) / block - 0.5, (column + 0.5) / block - 0.5
    r, c = int(np.floor(y)), int(np.floor(x))
    down, right = y - r, x - c
    r0, r1 = max(r, 0), min(r + 1, label.shape[0] - 1)
    c0, c1 = max(c, 0), min(c + 1, label.shape[1] - 1)
    for k in range(1, MIXED):
        found[k] = -1
    found[0], share[0] = label[r0, c0], 1.0
    if found[0] >= 0 and label[r0, c1] == found[0] and label[r1, c0] == found[0] and label[r1, c1] == found[0]:
        return True
    found[0] = -1
    for k in range(4):
        number = label[r0 if k < 2 else r1, c0 if k % 2 == 0 else c1]
        if number < 0:
            continue
        w = (down if k >= 2 else 1.0 - down) * (right if k % 2 else 1.0 - right)
        for n in range(MIXED):
            if found[n] == number:
                share[n] += w
                break
            if found[n] < 0:
                found[n], share[n] = number, w
                break
    return bool(found[0] >= 0)


@njit(cache=True, nogil=True, inline="always")  # type: ignore[misc, unused-ignore]
def _shows(cameras: OrientedCameras, n: int, X: FloatArray) -> bool:
    u, v, _ = seen_at(cameras, n, X)
    m = cameras.camera[n]
    return bool(u >= -0.5 and v >= -0.5 and u <= cameras.size_px[m, 0] - 0.5 and v <= cameras.size_px[m, 1] - 0.5)


@njit(cache=True, nogil=True, _nrt=False)  # type: ignore[misc, unused-ignore]
def _choose(
    relief: tuple[Float32Array, BoolArray, BoolArray, ByteArray, Int32Array],
    corner: tuple[float, float, float, int, int],
    cameras: OrientedCameras,
    cells: tuple[FloatArray, FloatArray],
    first: tuple[int, int],
    lines: tuple[float, FloatArray],
    lattice: tuple[Int32Array, Int32Array, BoolArray, BoolArray],
    widths: tuple[int, float],
    over: Int32Array,
    out: _Chosen,
    room: tuple[FloatArray, Int32Array, FloatArray],
) -> None:
    """Fill which photographs every cell of a window is made of, with which weights, and its place.

    ``relief`` are heights of the DSM around the window, whether there is an edge, whether it is unsure what is hidden,
    what its cells are in the photographs ``over`` it, and the place (V,) of each photograph among these. Of the
    photographs of the blocks around a cell those that see it and whose share is within ``feather`` of the largest are
    mixed; near a height edge the largest alone counts. Where none of them sees the cell another that does is taken.
    """
    height, edges, unsure, seen, slot = relief
    east, north = cells
    base, nodes = lines
    label, candidate, inside, plain = lattice
    block, feather = widths
    lists = candidate.shape[2]
    last_row, last_column = label.shape[0] - 1, label.shape[1] - 1
    X, found, share = room
    for i in range(len(north)):
        row = first[0] + i
        y = (corner[1] - north[i]) / corner[2] - corner[3]  # the same rounding in every tile
        r = int(y)
        own_row = min(row // block, last_row)
        for j in range(len(east)):
            column = first[1] + j
            own_column = min(column // block, last_column)
            simple = plain[own_row, own_column]
            if not simple and not _shares(row, column, block, label, found, share):
                continue
            x = (east[j] - corner[0]) / corner[2] - corner[4]
            c = int(x)
            h = height_at(height, y, x)
            if np.isnan(h):
                continue
            place_between(nodes, first, row, column, h - base, X)
            for k in range(3):
                out.place[i, j, k] = X[k]
            if simple:
                n = label[own_row, own_column]
                if seen[slot[n], r, c] == VISIBLE:
                    out.label[i, j, 0], out.weight[i, j, 0] = n, 1.0
                    out.used[n] = True
                    continue
                found[0], share[0], found[1] = n, 0.0, -1
            largest, best, count = 0.0, -1, 0
            for k in range(MIXED):
                n = found[k]
                if n < 0:
                    break
                shown = share[k] > 0.0 and seen[slot[n], r, c] == VISIBLE
                if shown:
                    whole = False
                    for m in range(lists):
                        if candidate[own_row, own_column, m] == n:
                            whole = inside[own_row, own_column, m]
                    shown = whole or _shows(cameras, n, X)
                if not shown:
                    share[k] = 0.0
                    continue
                count += 1
                if share[k] > largest:
                    largest, best = share[k], k
            if count == 0:
                n = _another(
                    cameras, X, candidate[own_row, own_column], over, seen[:, r, c], slot, edges[r, c], unsure[r, c]
                )
                if n >= 0:
                    out.label[i, j, 0], out.weight[i, j, 0] = n, 1.0
                    out.used[n] = True
                else:
                    for k in range(len(over)):
                        out.masked[i, j] = out.masked[i, j] or seen[k, r, c] == MASKED
                    out.hidden[i, j] = not out.masked[i, j]
                continue
            if count == 1 or feather == 0.0 or edges[r, c]:
                out.label[i, j, 0], out.weight[i, j, 0] = found[best], 1.0
                out.used[found[best]] = True
                continue
            total = 0.0
            for k in range(MIXED):
                if found[k] < 0:
                    break
                share[k] = max(0.0, share[k] - largest + feather) if share[k] > 0.0 else 0.0
                total += share[k]
            m = 0
            for k in range(MIXED):
                if found[k] < 0:
                    break
                if share[k] > 0.0:
                    out.label[i, j, m], out.weight[i, j, m] = found[k], share[k] / total
                    out.used[found[k]] = True
                    m += 1


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _close(
    slivers: BoolArray, corner: tuple[float, float, float, int, int], cameras: OrientedCameras,
    cells: tuple[FloatArray, FloatArray], first: tuple[int, int], candidate: Int32Array, block: int, over: Int32Array,
    states: tuple[ByteArray, Int32Array], out: _Chosen,
) -> None:  # fmt: skip
    """Take cells that are hidden, as ``_slivers`` has them, from the best photograph that shows their places."""
    seen, slot = states
    for i, j in np.argwhere(slivers):
        r = int((corner[1] - cells[1][i]) / corner[2] - corner[3])
        c = int((cells[0][j] - corner[0]) / corner[2] - corner[4])
        row = min((first[0] + i) // block, candidate.shape[0] - 1)
        column = min((first[1] + j) // block, candidate.shape[1] - 1)
        n = _another(cameras, out.place[i, j], candidate[row, column], over, seen[:, r, c], slot, True, True)
        if n >= 0:
            out.label[i, j, 0], out.weight[i, j, 0] = n, 1.0
            out.used[n] = True


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _another(
    cameras: OrientedCameras,
    X: FloatArray,
    listed: Int32Array,
    over: Int32Array,
    seen: ByteArray,
    slot: Int32Array,
    edge: bool,
    unsure: bool,
) -> int:
    """Return the first of a block's candidates that sees a place, or else of all photographs; at an edge else of those
    that see it beside what hides; the first that shows it where nothing is sure, else −1."""
    for state in range(VISIBLE, BESIDE + 1 if edge or unsure else VISIBLE + 1):
        for k in range(len(listed)):
            if listed[k] >= 0 and seen[slot[listed[k]]] == state and _shows(cameras, listed[k], X):
                return int(listed[k])
        for k in range(len(over)):
            if seen[k] == state and _shows(cameras, over[k], X):
                return int(over[k])
    if unsure:
        for k in range(len(listed)):
            if listed[k] >= 0 and seen[slot[listed[k]]] != MASKED and _shows(cameras, listed[k], X):
                return int(listed[k])
    return -1
