"""Orthophoto: photographs resampled on the surface, each cell from the photograph that shows it best.

Three steps: ``find_seams`` chooses a photograph for every block of cells, for the whole survey at once;
``balance_exposure`` makes the photographs equally bright; then tile by tile each cell is read from the photograph of
its block, from another where that one does not see it, and across seams from both for a few cells. What a cell holds
depends on its place alone, never on the tile in which it is made.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.errors import PhotogramError, check_positive, check_range
from photogram.frames import LocalFrame
from photogram.grid import MapGrid, Window, verticals
from photogram.projection import OrientedCameras
from photogram.surface.ortho.colour_balance import Balance, PixelsOf, balance_exposure, sample_overlaps
from photogram.surface.ortho.resampling import add_photograph
from photogram.surface.ortho.seamlines import SMALLEST_BLOCK, Seams, bundled_lines, find_seams, sees
from photogram.surface.ortho.visibility import NARROW, STRICT, Relief, Terrain, at_edge, height_at
from photogram.surface.views import Views
from photogram.survey import Raster

LEAST_HELD = 4
"""Decoded photographs that are kept, however little memory there is."""


TILE_CELLS = 512
TILES_AHEAD = 4
"""Tiles that are worked on, or wait, at the same time."""


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

    def __post_init__(self) -> None:
        if self.cell_m is not None:
            check_positive("cell_m", self.cell_m)
        check_range("feather_cells", self.feather_cells, 0, SMALLEST_BLOCK)


def ground_sampling_distance_m(views: Views, terrain: Terrain) -> float:
    """Return the median over the photographs of the side of a pixel on the ground below them, in m.

    A photograph beside the surface counts with the surface's median height.
    """
    dsm, values = MapGrid.of(terrain.surface), terrain.surface.values
    column = np.floor((terrain.position_map_m[:, 0] - dsm.west_map_m) / dsm.cell_m).astype(int)
    row = np.floor((dsm.north_map_m - terrain.position_map_m[:, 1]) / dsm.cell_m).astype(int)
    inside = (row >= 0) & (row < dsm.rows) & (column >= 0) & (column < dsm.columns)
    ground = np.full(len(views), np.nan)
    ground[inside] = values[row[inside], column[inside]]
    ground = np.where(np.isfinite(ground), ground, np.nanmedian(values))
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
    dsm, known = MapGrid.of(terrain.surface), np.isfinite(terrain.surface.values)
    row, column = np.flatnonzero(known.any(axis=1))[[0, -1]], np.flatnonzero(known.any(axis=0))[[0, -1]]
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
    feather_cells: float

    def tile(self, window: Window, pixels_of: PixelsOf) -> ByteArray:
        """Return red, green, blue and alpha (rows, columns, 4) of a window; one photograph at a time is held.

        Alpha is 0 where there is no surface, or no photograph that sees it, else 255.
        """
        rows, columns = window.shape
        # one more to the south and east, for the sides of the last cells
        widened = Window(window.row, window.column, window.row_end + 1, window.column_end + 1)
        lines = verticals(self.frame, self.grid, widened)
        label, weight = np.full((rows, columns, 4), -1, np.int32), np.zeros((rows, columns, 4), np.float32)
        height = np.full((rows, columns), np.nan)
        _choose(
            self.terrain.around(self.grid, window), self.views.cameras, self.terrain.position_map_m,
            self.grid.centres_map_m(window), bundled_lines(lines), (window.row, window.column),
            (self.seams.label, self.seams.candidate),
            (self.seams.block_cells, self.feather_cells / self.seams.block_cells), (label, weight, height),
        )  # fmt: skip
        colour = np.zeros((rows, columns, 3), np.float32)
        places = (lines.foot_world_m, lines.up, height - lines.base_map_m)
        for view in np.unique(label[label >= 0]).tolist():
            gain, falloff = self.balance.log_gain[view], self.balance.falloff[view]
            add_photograph(view, pixels_of(view), self.views.cameras, gain, falloff, places, label, weight, colour)
        shown = (label[..., 0] >= 0)[..., None]
        rgb = np.clip(np.rint(colour), 0, 255).astype(np.uint8)
        return np.concatenate([np.where(shown, rgb, 0), np.where(shown, 255, 0)], axis=2).astype(np.uint8)

    def tiles(
        self, pixels_of: PixelsOf, executor: Executor, side: int = TILE_CELLS
    ) -> Iterator[tuple[Window, ByteArray]]:
        """Yield all windows of ``side`` × ``side`` cells with their colours, row by row."""
        waiting: deque[tuple[Window, Future[ByteArray]]] = deque()
        for window in self.grid.tiles(side):
            waiting.append((window, executor.submit(self.tile, window, pixels_of)))
            if len(waiting) >= TILES_AHEAD:
                first, future = waiting.popleft()
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()


def plan_orthophoto(
    views: Views,
    frame: LocalFrame,
    surface: Raster,
    pixels_of: PixelsOf,
    executor: Executor,
    settings: OrthophotoSettings | None = None,
    *,
    grid: MapGrid | None = None,
    camera: NDArray[np.int64] | None = None,
) -> Orthophoto:
    """Choose the seams and the gains of an orthophoto; then its tiles can be made.

    ``surface`` holds heights of the map, NaN where there is none; ``pixels_of`` gives the photograph of a view,
    and may be asked from several threads at once. ``camera`` (V,) is the camera of each view, all of one where it is
    not given. Raises PhotogramError where no photograph is above the surface, or the surface has no height.
    """
    settings = settings or OrthophotoSettings()
    terrain = Terrain.under(views, frame, surface)
    grid = grid or orthophoto_grid(views, terrain, settings.cell_m)
    seams = find_seams(views, frame, terrain, grid, executor)
    balance = Balance.none(len(views))
    if settings.balance:
        samples = sample_overlaps(views, frame, grid, seams, pixels_of, executor)
        balance = balance_exposure(samples, np.zeros(len(views), np.int64) if camera is None else camera)
    return Orthophoto(views, frame, terrain, grid, seams, balance, settings.feather_cells)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _shares(row: int, column: int, block: int, label: Int32Array, found: Int32Array, share: FloatArray) -> None:
    """Fill the labels (4,) of the blocks around the centre of a cell of the grid, each once, else −1, and how much of a
    bilinear mean they make."""
    y, x = (row + 0.5) / block - 0.5, (column + 0.5) / block - 0.5
    r, c = int(np.floor(y)), int(np.floor(x))
    found[:] = -1
    share[:] = 0.0
    for k in range(4):
        a, b = min(max(r + k // 2, 0), label.shape[0] - 1), min(max(c + k % 2, 0), label.shape[1] - 1)
        if label[a, b] < 0:
            continue
        w = (y - r if k // 2 else 1.0 - (y - r)) * (x - c if k % 2 else 1.0 - (x - c))
        for n in range(4):
            if found[n] == label[a, b] or found[n] < 0:
                found[n] = label[a, b]
                share[n] += w
                break


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _choose(
    relief: Relief,
    cameras: OrientedCameras,
    centre: FloatArray,
    cells: tuple[FloatArray, FloatArray],
    lines: tuple[float, FloatArray, FloatArray],
    corner: tuple[int, int],
    lattice: tuple[Int32Array, Int32Array],
    widths: tuple[int, float],
    out: tuple[Int32Array, NDArray[np.float32], FloatArray],
) -> None:
    """Fill which photographs every cell of a window is made of, with which weights (R, C, 4), and its height (R, C).

    Of the photographs of the blocks around a cell those that see it and whose share is within ``feather`` of the
    largest are mixed; near a height edge the largest alone counts. Where none of them sees the cell the best candidate
    that does is taken.
    """
    east, north = cells
    base, foot, up = lines
    label, candidate = lattice
    block, feather = widths
    chosen, weight, height = out
    X, found, share = np.empty(3), np.empty(4, np.int32), np.empty(4)
    for i in range(len(north)):
        for j in range(len(east)):
            _shares(corner[0] + i, corner[1] + j, block, label, found, share)
            if found[0] < 0:
                continue
            h = height_at(relief, east[j], north[i])
            if np.isnan(h):
                continue
            height[i, j] = h
            for k in range(3):
                X[k] = foot[i, j, k] + (h - base) * up[i, j, k]
            place = (east[j], north[i], h)
            edge = at_edge(relief, east[j], north[i])
            soft = 0.0 if edge else feather
            if not _mix(relief, cameras, centre, X, place, soft, found, share):
                row = min((corner[0] + i) // block, label.shape[0] - 1)
                column = min((corner[1] + j) // block, label.shape[1] - 1)
                _second_best(relief, cameras, centre, X, place, edge, candidate[row, column], found, share)
            n = 0
            for k in range(4):
                if found[k] >= 0 and share[k] > 0.0:
                    chosen[i, j, n], weight[i, j, n] = found[k], share[k]
                    n += 1


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _mix(
    relief: Relief,
    cameras: OrientedCameras,
    centre: FloatArray,
    X: FloatArray,
    place: tuple[float, float, float],
    feather: float,
    found: Int32Array,
    share: FloatArray,
) -> bool:
    """Turn shares into weights of the photographs that see a place; False where none does."""
    largest, best = 0.0, -1
    for k in range(4):
        if found[k] >= 0 and share[k] > 0.0 and not sees(cameras, found[k], relief, centre, X, place, STRICT):
            found[k] = -1
        if found[k] >= 0 and share[k] > largest:
            largest, best = share[k], k
    if best < 0:
        return False
    total = 0.0
    for k in range(4):
        share[k] = max(0.0, share[k] - largest + feather) if found[k] >= 0 else 0.0
        if feather == 0.0:
            share[k] = 1.0 if k == best else 0.0
        total += share[k]
    for k in range(4):
        share[k] /= total
    return True


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _second_best(
    relief: Relief,
    cameras: OrientedCameras,
    centre: FloatArray,
    X: FloatArray,
    place: tuple[float, float, float],
    edge: bool,
    candidate: Int32Array,
    found: Int32Array,
    share: FloatArray,
) -> None:
    """Give all weight to the first candidate that sees a place by the strict test, at a height edge else by the
    narrow one; to none where none does."""
    found[:] = -1
    share[:] = 0.0
    for mercy in range(STRICT, NARROW + 1 if edge else STRICT + 1):
        for k in range(len(candidate)):
            if candidate[k] >= 0 and sees(cameras, candidate[k], relief, centre, X, place, mercy):
                found[0], share[0] = candidate[k], 1.0
                return
