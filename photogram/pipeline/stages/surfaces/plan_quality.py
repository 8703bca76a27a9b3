"""How well the orthophoto is known in plan and what it stands on, on the grid of the surface, for the stage
`orthophoto`."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray, ByteArray, Float32Array
from photogram.files.maps.cogs import Category, write_cog, write_cog_codes
from photogram.files.maps.rasters import read_codes
from photogram.grid import MapGrid, Window
from photogram.pipeline.stages.stored_surface import SOURCE, StoredSurface
from photogram.pipeline.stages.surface_frame import SurfaceFrame
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.tiles import GridFile
from photogram.surface.dsm import MEASURED_IN, SharedError, shared_error
from photogram.surface.ortho.cell_choice import EDGE_REACH
from photogram.surface.ortho.plan_sigma import (
    DOUBTFUL,
    HIDDEN_EVERYWHERE,
    MASKED_EVERYWHERE,
    NOTHING,
    RaysAt,
    plan_sigma_m,
)
from photogram.surface.ortho.unsure_heights import BLOCK_CELLS, UNIFORM, edge_sigma_m, height_ranges_m
from photogram.surface.ortho.visibility import WindowedSurface

SIGMA_FILE, SOURCE_FILE = "orthophoto_sigma.tif", "orthophoto_source.tif"

ON_MEASURED, ON_SMOOTH, ON_INTERPOLATED, UNSEEN, HIDDEN, MASKED = 1, 2, 3, 4, 5, 6
PICTURE_SOURCES = (
    Category(0, "nothing", (255, 255, 255)),
    Category(ON_MEASURED, "on measured heights", (70, 130, 180)),
    Category(ON_SMOOTH, "on the mean of torn heights", (140, 195, 120)),
    Category(ON_INTERPOLATED, "on interpolated heights", (176, 122, 184)),
    Category(UNSEEN, "hidden by the surface, shown all the same", (220, 60, 40)),
    Category(HIDDEN, "hidden from all photographs", (60, 60, 60)),
    Category(MASKED, "masked", (150, 150, 150)),
)
"""What the codes of SOURCE_FILE mean, and their colours."""

PLAN_SIGMA = "standard deviation of the position, per axis"
TILE_CELLS = 1024
_SMOOTH_CELLS = 1.0  # standard deviation from which a surface is a mean
_SPACING_SHARE = 0.05  # of the flying height, between nodes of what photographs do to the surface


@dataclass(frozen=True, eq=False)
class PlanQuality:
    """What is found of the orthophoto's cells while they are made, kept in a scratch folder."""

    surface: WindowedSurface
    shared: SharedError
    made_of: Path | None
    """Codes of a matched surface, None of one from tie points alone."""
    range_m: Float32Array
    """How far heights around differ, by blocks of the surface."""
    sigma: GridFile
    code: GridFile

    @staticmethod
    def of(run: Run, site: SurfaceFrame, surface: WindowedSurface, above_m: float, scratch: Path) -> "PlanQuality":
        """Return it for an orthophoto on a surface some metres below its photographs."""
        grid, cloud = surface.grid, site.cloud()
        shared = shared_error(cloud.position_map_m, site.precision().cameras_m2, grid, _SPACING_SHARE * above_m)
        has_codes = run.workspace.has("surface", SOURCE)
        made_of = run.workspace.file("surface", SOURCE) if has_codes else None
        files = [GridFile(scratch / name, grid) for name in ("plan_sigma.f32", "picture_code.f32")]
        for file in files:
            file.make()
        ranges_m = height_ranges_m(grid, StoredSurface(run).measured().read)
        return PlanQuality(surface, shared, made_of, ranges_m, *files)

    def take(self, rays: RaysAt, within: BoolArray) -> None:
        """Take the rays of a tile, whose cells (rows, columns) lie ``within`` the rim or not."""
        window = rays.window
        if not window.shape[0]:
            return
        assert self.surface.sigmas is not None
        height_sigma_m = self.surface.sigmas(window)
        smooth = height_sigma_m >= _SMOOTH_CELLS * self.surface.grid.cell_m
        code = np.where(self._measured(window), np.where(smooth, ON_SMOOTH, ON_MEASURED), ON_INTERPOLATED)
        for state, name in ((DOUBTFUL, UNSEEN), (HIDDEN_EVERYWHERE, HIDDEN), (MASKED_EVERYWHERE, MASKED), (NOTHING, 0)):
            code = np.where(rays.state == state, name, code)
        off = np.where(code == ON_MEASURED, self._at_edges(window), self._in_range(window))
        sigma = plan_sigma_m(rays, np.hypot(height_sigma_m, off), self.shared, self.surface.grid)
        self.sigma.write(window, np.where(within, sigma, np.float32(np.nan)))
        self.code.write(window, np.where(within, code, 0).astype(np.float32))

    def _at_edges(self, window: Window) -> Float32Array:
        grid = self.surface.grid
        outer = grid.around_window(window, EDGE_REACH)
        return edge_sigma_m(self.surface.heights(outer), grid.cell_m)[window.within(outer)]

    def _in_range(self, window: Window) -> Float32Array:
        row, column = (
            np.arange(a, b) // BLOCK_CELLS
            for a, b in ((window.row, window.row_end), (window.column, window.column_end))
        )
        return self.range_m[np.ix_(row, column)] / np.float32(UNIFORM)

    def _measured(self, window: Window) -> BoolArray:
        if self.made_of is None:
            return np.ones(window.shape, np.bool_)
        return np.isin(read_codes(self.made_of, window), [*MEASURED_IN.values()])

    def write(self, folder: Path, site: SurfaceFrame) -> None:
        """Write both rasters."""
        grid: MapGrid = self.surface.grid

        def sigmas() -> Iterator[tuple[Window, Float32Array]]:
            for window in grid.tiles(TILE_CELLS):
                values = self.sigma.read(window)
                yield window, np.where(values > 0.0, values, np.float32(np.nan))

        def codes() -> Iterator[tuple[Window, ByteArray]]:
            return ((window, self.code.read(window).astype(np.uint8)) for window in grid.tiles(TILE_CELLS))

        write_cog(folder / SIGMA_FILE, grid, site.plan, sigmas(), description=PLAN_SIGMA, note=site.note)
        write_cog_codes(folder / SOURCE_FILE, grid, site.plan, codes(), categories=PICTURE_SOURCES, note=site.note)
