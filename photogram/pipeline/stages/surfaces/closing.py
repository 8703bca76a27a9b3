"""The surface closed within the rim of the survey: made and stored by the stage `surface`, read back by others."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import shapely

from photogram.arrays import BoolArray, ByteArray, Float32Array
from photogram.errors import SurfaceError
from photogram.files.atomic import scratch_folder, temporary_name
from photogram.files.npz_json import read_json, write_json
from photogram.grid import MapGrid, Window
from photogram.pipeline.stages.surface_frame import SurfaceFrame
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.tiles import BlockFiles, GridFile
from photogram.surface.dense.pyramid import MINIMUM_RAYS
from photogram.surface.dsm import INTERPOLATED, MEASURED, MEASURED_IN, WATER
from photogram.surface.dtm import ground_between
from photogram.surface.mapped_area import Geometry, cells_within
from photogram.surface.ortho.closed_surface import close_surface
from photogram.surface.ortho.outline import cells_inside, polygons_of, rim_of, sides_of
from photogram.surface.ortho.seamlines import rate_blocks
from photogram.surface.ortho.visibility import SurfaceModel, WindowedSurface
from photogram.surface.views import Views

CLOSED_HEIGHT, CLOSED_SIGMA = "closed_height.f32", "closed_sigma.f32"
"""Files of the stage `surface`: the closed surface over all of its grid, and by how much its heights may be off."""

RIM = "rim.json"
"""File of the stage `surface` with the grid and the rim of the closed surface; not there where no photograph shows
it."""

CLOSED_BYTES = 8.0
"""On disk for a cell of the surface."""

COARSER = tuple(code for code in MEASURED_IN.values() if code != MEASURED)
"""Codes of the cells that larger ones alone tell."""

Parts = Iterable[tuple[Window, Float32Array, Float32Array]]
"""Windows with their heights, NaN where there is none, and standard deviations, NaN where none was measured."""


def close_within_rim(
    run: Run, site: SurfaceFrame, folder: Path, grid: MapGrid, parts: Parts, area: Geometry | None = None
) -> Geometry | None:
    """Close a surface over all of its grid, write it and the rim within which photographs show it, and return the rim,
    polygons in the map, inside an ``area`` where one is given; None where no photograph shows it."""
    height, sigma = GridFile(folder / CLOSED_HEIGHT, grid), GridFile(folder / CLOSED_SIGMA, grid)
    with scratch_folder(temporary_name(folder)) as scratch:
        known, own = GridFile(scratch / "known.f32", grid), GridFile(scratch / "own.f32", grid)
        for file in (known, own, height, sigma):
            file.make()
        measured = False
        for window, heights_m, sigmas_m in parts:
            known.write(window, heights_m)
            own.write(window, sigmas_m)
            measured = measured or bool(np.isfinite(sigmas_m).any())
        if not measured:
            return None

        def part(window: Window) -> tuple[Float32Array, BoolArray, Float32Array]:
            deviation = own.read(window)
            return known.read(window), np.isfinite(deviation), deviation

        def write(window: Window, values: Float32Array, sigmas: Float32Array) -> None:
            height.write(window, values)
            sigma.write(window, sigmas)

        close_surface(grid, part, run.executor, write, ground_between(grid, lambda of: (known.read(of), own.read(of))))
    for file in (height, sigma):
        file.flush()
    block = site.block()
    views = Views.of(block)
    if not len(views):
        return None
    terrain = SurfaceModel.under(views, block.frame, WindowedSurface(grid, height.read, sigma.read))
    pixels = MapGrid(grid.west_map_m, grid.north_map_m, 0.5 * grid.cell_m, 2 * grid.rows, 2 * grid.columns)
    lattice = rate_blocks(views, block.frame, terrain, pixels, run.executor)
    rim = rim_of(lattice.looks, lattice.looks > 0, pixels.coarser(lattice.block_cells))
    if rim is not None and area is not None:
        rim = polygons_of(shapely.intersection(rim, area))
    if rim is not None:
        write_json(folder / RIM, {"grid": asdict(grid), "rim": shapely.to_wkb(rim, hex=True)})
    return rim


def stored_closing(run: Run) -> tuple[WindowedSurface, Geometry]:
    """Return the closed surface of a run and its rim, polygons in the map. Raises SurfaceError where no photograph
    shows the surface."""
    if not run.workspace.has("surface", RIM):
        raise SurfaceError("orthophoto: no photograph shows the surface: check its heights and the poses")
    stored = read_json(run.workspace.file("surface", RIM))
    grid = MapGrid(**stored["grid"])
    height, sigma = (GridFile(run.workspace.file("surface", name), grid) for name in (CLOSED_HEIGHT, CLOSED_SIGMA))
    return WindowedSurface(grid, height.read, sigma.read), shapely.from_wkb(stored["rim"])


def measured_parts(layers: BlockFiles) -> Parts:
    """Return the tiles of a matched surface as they are closed."""
    nowhere = np.float32(np.nan)

    def part(window: Window) -> tuple[Window, Float32Array, Float32Array]:
        filled, own, source = layers.read(window, "filled", "own", "source")
        # coarser levels are too rough to hide what is behind them
        measured = np.where(source == MEASURED, own, nowhere)
        measured = np.where(np.isin(source, COARSER), np.float32(np.inf), measured)
        # water is shown on its level, which its shore tells
        return window, filled, np.where(source == WATER, np.float32(layers.grid.cell_m), measured)

    return map(part, layers.windows)


def closed_tiles(
    layers: BlockFiles, folder: Path, rim: Geometry | None, area: Geometry | None
) -> Iterator[tuple[Window, Float32Array, ByteArray]]:
    """Yield the tiles of a matched surface with heights and codes, closed within the rim and wherever photographs
    enough show it, in an ``area`` where one is given."""
    height, sides = GridFile(folder / CLOSED_HEIGHT, layers.grid), None if rim is None else sides_of(rim)
    for window in layers.windows:
        filled, source, seen = layers.read(window, "filled", "source", "seen")
        if sides is not None:
            shown = (seen >= MINIMUM_RAYS) & cells_within(area, layers.grid, window)
            gap = np.isnan(filled) & (shown | cells_inside(sides, layers.grid, window))
            filled = np.where(gap, height.read(window), filled)
            source = np.where(gap, np.uint8(INTERPOLATED), source)
        yield window, filled, source
