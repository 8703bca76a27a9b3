"""Orthophoto: photographs resampled on the surface, each cell from the photograph that shows it best.

Three steps: ``seams_of`` chooses a photograph for every block of cells, for the whole survey at once;
``balance_exposure`` makes the photographs equally bright; then tile by tile each cell is read from the photograph of
its block, from another where that one does not see it, and across seams from both for a few cells. What a cell holds
depends on its place alone, never on the tile in which it is made.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray
from photogram.compilation import njit
from photogram.errors import SurfaceError
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Window, cell_steps, vertical_nodes
from photogram.measures.ground_sampling import ground_sampling_m
from photogram.projection import OrientedCameras, ideal_point, lens_of, without_field
from photogram.settings.settings import Default, Settings, Within
from photogram.surface.ortho.block_samples import BlockSamples
from photogram.surface.ortho.cell_choice import (
    EDGE_REACH,
    MIXED,
    SLIVER_CELLS,
    Chosen,
    choose,
    close_slivers,
    edges_of,
    slivers_of,
)
from photogram.surface.ortho.colour_balance import (
    KNEE_DN,
    WHITE_DN,
    Balance,
    PixelsOf,
    balance_exposure,
    highlight_curve,
    joined,
)
from photogram.surface.ortho.masked_cells import Masks
from photogram.surface.ortho.plan_sigma import RaysAt, rays_at
from photogram.surface.ortho.resampling import Tone, add_photograph
from photogram.surface.ortho.seamlines import (
    SMALLEST_BLOCK,
    Seams,
    block_cells,
    rate_blocks,
    seams_of,
)
from photogram.surface.ortho.visibility import (
    UNSURE_CELLS,
    SeenCells,
    SurfaceModel,
    WindowedSurface,
)
from photogram.surface.views import Views
from photogram.survey import Raster

ForcedOf = Callable[[MapGrid], Int32Array]
"""Gives the view (R, C) that each block of a grid of blocks is to be taken from, −1 for any."""

LEAST_CACHED = 4
"""Decoded photographs that are kept, however little memory there is."""

CACHE_BYTES = 512 * 2**20
"""Most memory of decoded photographs that are kept, where LEAST_CACHED take less."""

TILE_CELLS = 512
GROUP_TILES = 8
"""Tiles along a square of them that is finished before the next is begun."""
TILES_AHEAD = 4
"""Tiles that are worked on, or wait, at the same time."""

ONLY_MASKED = 1
"""Alpha of cells that photographs show in masked pixels alone, until they are written as transparent."""

_NOTHING = np.zeros((0, 1, 1), np.uint8)


@dataclass(frozen=True)
class OrthophotoSettings(Settings):
    """How photographs become an orthophoto."""

    enabled: Annotated[bool, "Whether an orthophoto is made."] = True
    cell_m: Annotated[
        float | None, Within(0.0005, 1000, "m"), "Side of a cell.", Default("GSD, rounded to two digits")
    ] = None
    balance: Annotated[bool, "Whether photographs are made equally bright."] = True
    feather_cells: Annotated[float, Within(0, SMALLEST_BLOCK, "cells"), "Width of a seam; 0 is a sharp one."] = 4.0
    seams: Annotated[
        str | None,
        "File of edited seams, polygons with the photograph that each is taken from, relative to the project file.",
        Default("none"),
    ] = None


def above_ground_m(views: Views, terrain: SurfaceModel) -> FloatArray:
    """Return how high the views (V,) are over the ground below them, in m.

    Ground without a height counts with the mean of the heights there are.
    """
    dsm, low = terrain.grid, terrain.coarse[0]
    row, column = dsm.cells_at(terrain.position_map_m)
    ground = np.full(len(views), float(np.mean(terrain.coarse[:, np.isfinite(low)])))
    for n in np.flatnonzero(row >= 0).tolist():
        height = float(terrain.heights(Window(int(row[n]), int(column[n]), int(row[n]) + 1, int(column[n]) + 1))[0, 0])
        ground[n] = height if np.isfinite(height) else ground[n]
    return np.asarray(terrain.position_map_m[:, 2] - ground)


def orthophoto_grid(views: Views, terrain: SurfaceModel, cell_m: float | None = None) -> MapGrid:
    """Return the grid of an orthophoto over all of the surface that has heights.

    Raises SurfaceError where no photograph is above the surface.
    """
    if cell_m is None:
        gsd = ground_sampling_m(above_ground_m(views, terrain), views.focal_px)
        if not gsd > 0:
            raise SurfaceError("orthophoto: the photographs are not above the surface: check the surface's heights")
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
    terrain: SurfaceModel
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
        return self.grid.coarser(self.seams.block_cells)

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
        return self.tile_with_rays(window, pixels_of)[0]

    def tile_with_rays(self, window: Window, pixels_of: PixelsOf) -> tuple[ByteArray, RaysAt]:
        """Return the same, and the rays that show the cells of the surface whose middles lie in the window."""
        terrain, half = self.terrain, int(np.ceil(0.5 * SLIVER_CELLS * self.terrain.grid.cell_m / self.grid.cell_m))
        wide = self.grid.around_window(window, 4 * half)
        shape, near = wide.shape, terrain.cells_around(self.grid, wide, EDGE_REACH + 1)
        height, cell_m = terrain.heights(near), terrain.grid.cell_m
        over = terrain.views_over(near)
        slot = np.full(len(self.views), -1, np.int32)
        slot[over] = np.arange(len(over))
        seen = np.stack([self.seen.part(n, near) for n in over.tolist()]) if len(over) else _NOTHING
        chosen = Chosen(
            np.full((*shape, MIXED), -1, np.int32), np.zeros((*shape, MIXED), np.float32), np.zeros((*shape, 3)),
            np.zeros(len(self.views), np.bool_), np.zeros(shape, np.bool_), np.zeros(shape, np.bool_),
        )  # fmt: skip
        unsure = terrain.tolerances_m(near) > UNSURE_CELLS * cell_m
        corner = terrain.grid.west_map_m, terrain.grid.north_map_m, cell_m, near.row, near.column
        cells, at = self.grid.centres_map_m(wide), (wide.row, wide.column)
        relief = (height, edges_of(height, cell_m), unsure, seen, slot)
        choose(
            relief, corner, self.views.cameras, cells, at,
            (float(self.frame.origin_map_m[2]), vertical_nodes(self.frame, self.grid, wide)),
            (self.seams.label, self.seams.candidate, self.seams.inside, self.plain),
            (self.seams.block_cells, self.feather_cells / self.seams.block_cells), over, chosen,
            (np.empty(3), np.empty(MIXED, np.int32), np.empty(MIXED)),
        )  # fmt: skip
        if (slivers := slivers_of(chosen.hidden, half)).any():
            close_slivers(
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
        rays = rays_at(terrain, self.grid, window, wide, chosen, near, seen, slot)
        return np.ascontiguousarray(rgba[window.within(wide)]), rays

    def tiles(
        self, pixels_of: PixelsOf, executor: Executor, side: int = TILE_CELLS
    ) -> Iterator[tuple[Window, ByteArray]]:
        """Yield all windows of ``side`` × ``side`` cells with their colours, in squares of GROUP_TILES × GROUP_TILES of
        them, so that photographs that are decoded for one serve its neighbours."""
        return ((window, rgba) for window, (rgba, _) in self.tiles_with_rays(pixels_of, executor, side))

    def tiles_with_rays(
        self, pixels_of: PixelsOf, executor: Executor, side: int = TILE_CELLS
    ) -> Iterator[tuple[Window, tuple[ByteArray, RaysAt]]]:
        """Yield the same with the rays that show them."""
        waiting: deque[tuple[Window, Future[tuple[ByteArray, RaysAt]]]] = deque()
        for window in _grouped(self.grid, side):
            waiting.append((window, executor.submit(self.tile_with_rays, window, pixels_of)))
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
    surface: Raster | WindowedSurface,
    pixels_of: PixelsOf,
    executor: Executor,
    settings: OrthophotoSettings,
    *,
    grid: MapGrid | None = None,
    camera: IntArray | None = None,
    masks: Masks | None = None,
) -> Orthophoto:
    """Choose the seams and the gains of an orthophoto; then its tiles can be made.

    ``surface`` holds heights of the map, NaN where there is none; ``pixels_of`` gives the photograph of a view, and may
    be asked from several threads at once. ``camera`` (V,) is the camera of each view, all of one where it is not given;
    ``masks`` says which pixels of the photographs are used, all where it is not given. Raises SurfaceError where no
    photograph is above the surface, or the surface has no height.
    """
    block_samples = scored_samples(views, frame, surface, executor, settings, grid=grid, masks=masks)
    samples = list(executor.map(lambda view: block_samples.at(view, pixels_of(view)), range(len(views))))
    return chosen_orthophoto(block_samples, samples, settings, camera)


def scored_samples(
    views: Views,
    frame: LocalFrame,
    surface: Raster | WindowedSurface,
    executor: Executor,
    settings: OrthophotoSettings,
    *,
    grid: MapGrid | None = None,
    forced: ForcedOf | None = None,
    masks: Masks | None = None,
) -> BlockSamples:
    """Rate the photographs of each block by where they were taken: ``plan_orthophoto`` before photographs are read.

    ``forced`` gives for the grid of the blocks which view each is to be taken from, −1 for any.
    """
    terrain = SurfaceModel.under(views, frame, WindowedSurface.of(surface) if isinstance(surface, Raster) else surface)
    grid = grid or orthophoto_grid(views, terrain, settings.cell_m)
    wanted = None if forced is None else forced(grid.coarser(block_cells(grid)))
    return BlockSamples.of(
        views, frame, terrain, grid, rate_blocks(views, frame, terrain, grid, executor, wanted), masks
    )


def chosen_orthophoto(
    block_samples: BlockSamples,
    samples: Sequence[tuple[IntArray, FloatArray]],
    settings: OrthophotoSettings,
    camera: IntArray | None,
) -> Orthophoto:
    """Choose seams and gains once all photographs were looked at; ``samples`` (V,) are those of ``BlockSamples.at``."""
    balance = Balance.none(len(block_samples.views))
    if settings.balance:
        cameras = np.zeros(len(block_samples.views), np.int64) if camera is None else camera
        balance = balance_exposure(joined(samples), cameras)
    log_gain = balance.log_gain.mean(axis=1)
    seams = seams_of(block_samples.lattice, block_samples.terrain, block_samples.grid, log_gain)
    highlights = highlight_curve(block_samples.lattice, seams.label, log_gain)
    return Orthophoto(
        block_samples.views,
        block_samples.frame,
        block_samples.terrain,
        block_samples.grid,
        seams,
        balance,
        block_samples.seen,
        settings.feather_cells,
        highlights,
        plain_blocks(seams),
    )


def plain_blocks(seams: Seams) -> BoolArray:
    """Return the blocks (R, C) of one photograph, which shows all of them, among eight of the same."""
    label = seams.label
    same = (maximum_filter(label, 3, mode="nearest") == label) & (minimum_filter(label, 3, mode="nearest") == label)
    whole = ((seams.candidate == label[..., None]) & seams.inside).any(axis=2)
    return np.asarray(same & whole & (label >= 0))


@njit(cache=True, nogil=True)
def ideal_radius2(cameras: OrientedCameras, camera: int, pixel: FloatArray) -> FloatArray:
    """Return the squared ideal radii (N,) of pixels (N, 2); 16 where a pixel shows no direction in front."""
    out, q = np.empty(len(pixel)), lens_of(cameras.parameters, camera)
    for n in range(len(pixel)):
        u, v = without_field(cameras, camera, pixel[n, 0], pixel[n, 1])
        x, y = ideal_point(cameras.model[camera], q, u, v)
        r2 = x * x + y * y
        out[n] = min(r2, 16.0) if np.isfinite(r2) else 16.0
    return out


@njit(cache=True, nogil=True)
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
