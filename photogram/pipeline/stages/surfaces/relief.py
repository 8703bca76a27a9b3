"""The stage `relief`: terrain and contour lines of the DSM."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import ByteArray, Float32Array
from photogram.errors import SurfaceError
from photogram.files.maps.cogs import Category, write_cog, write_cog_codes
from photogram.files.maps.contour_files import write_contours
from photogram.files.maps.rasters import read_raster
from photogram.geodesy.crs import NO_CRS, plan_of
from photogram.grid import Window
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import COARSER, LIBRARIES_BYTES, Costs, Extent, Memory, Rate
from photogram.pipeline.stages.stored_surface import StoredSurface
from photogram.pipeline.stages.surface_frame import made_frame
from photogram.pipeline.stages.surfaces.surface import SIGMA, SOURCES, matched
from photogram.pipeline.store.run import Run
from photogram.surface.contours import MAXIMUM_CELLS as CONTOURED_CELLS
from photogram.surface.contours import contour_lines
from photogram.surface.dsm import FILLED, HOLE, MEASURED
from photogram.surface.dtm import TerrainModel, expected_blocks, terrain_model
from photogram.survey import Raster
from photogram.wording import Progress, things


class ReliefSummary(TypedDict, total=False):
    """What the stage `relief` says of itself."""

    interpolated: int
    """Number of cells of the terrain that were interpolated."""
    contours: int
    """Number of contour lines."""
    interval_m: float
    """Contour interval."""
    of: str
    """What the contour lines are of, terrain or surface."""
    no_terrain: str
    """Why there is no terrain model where none was asked for or against."""
    left_out: str
    """Why there is neither."""


TERRAIN_SOURCES = (
    *SOURCES[:1],
    Category(MEASURED, "ground", (140, 110, 70)),
    Category(FILLED, "interpolated", (230, 120, 20)),
)
"""What the codes of `dtm_source.tif` mean, and their colours."""

ON_PLANE = "terrain and contour lines belong on a map, and the surface lies on a plane"
"""Why neither is made on a plane."""

BARE = "nothing stands on the ground, so the surface is the terrain"
"""Why there is no terrain model."""


def trace_relief(run: Run, folder: Path, progress: Progress) -> ReliefSummary:
    """Make the terrain model and the contour lines that the project asks for."""
    terrain, contours = run.project.terrain, run.project.contours
    summary: ReliefSummary = {}
    surface: Raster | None = None
    if not StoredSurface(run).is_there:
        return summary
    if made_frame(run).plane is not None:
        return {"left_out": ON_PLANE} if terrain.enabled or contours.enabled else summary
    stored = StoredSurface(run)
    model = None
    if terrain.enabled or (run.project.makes_terrain and matched(run)):
        progress(0, 0, "terrain model")
        heights, sigma = stored.files()
        own = stored.own_sigma()

        def read(window: Window) -> tuple[Float32Array, Float32Array]:
            return heights.read(window), sigma.read(window)

        try:
            model = terrain_model(heights.grid, read, terrain, None if own is None else own.read)
        except SurfaceError as error:
            if terrain.enabled:
                raise
            summary["no_terrain"] = str(error)
        if model is not None and model.is_bare and not terrain.enabled:
            model, summary["no_terrain"] = None, BARE
    if model is not None:
        summary["interpolated"] = _write_terrain(run, folder, model)
        surface = read_raster(folder / "dtm.tif", local=run.project.crs == NO_CRS)[0]
    if contours.enabled:
        progress(0, 0, "contour lines")
        lines = contour_lines(surface or stored.filled_nearby(), contours)
        write_contours(folder / "contours.gpkg", lines, run.project.product_crs)
        summary["contours"] = len(lines)
        summary["interval_m"] = lines.interval_m
        summary["of"] = "terrain" if surface else "surface"
    return summary


def _write_terrain(run: Run, folder: Path, model: TerrainModel) -> int:
    """Write the rasters of the terrain tile by tile; returns how many cells are interpolated."""
    grid, plan, interpolated = model.grid, plan_of(run.project.crs), 0

    def codes() -> Iterator[tuple[Window, ByteArray]]:
        nonlocal interpolated
        for window in model.windows:
            tile = model.tile(window)
            interpolated += int(np.count_nonzero(tile.interpolated))
            code = np.where(tile.interpolated, FILLED, np.where(np.isfinite(tile.height), MEASURED, HOLE))
            yield window, code.astype(np.uint8)

    heights = ((window, model.tile(window).height) for window in model.windows)
    sigmas = ((window, model.tile(window).sigma) for window in model.windows)
    write_cog(folder / "dtm.tif", grid, run.project.product_crs, heights, description="height of the terrain")
    write_cog(folder / "dtm_sigma.tif", grid, plan, sigmas, description=SIGMA)
    write_cog_codes(folder / "dtm_source.tif", grid, plan, codes(), categories=TERRAIN_SOURCES)
    return interpolated


def _relief_words(summary: ReliefSummary) -> str:
    parts = []
    if "interpolated" in summary:
        parts.append(f"terrain with {things(summary['interpolated'], 'interpolated cell')}")
    if "no_terrain" in summary:
        parts.append(f"no terrain model ({summary['no_terrain']})")
    if "contours" in summary:
        lines = things(summary["contours"], "contour line")
        parts.append(f"{lines} every {summary['interval_m']:g} m of the {summary['of']}")
    return ", ".join(parts) or "not requested"


TERRAIN_BYTES, BLOCK_BYTES, CONTOUR_BYTES = 0.2, 250.0, 70.0
"""In memory of the terrain model for a cell of the surface and for a block, of the contour lines for a cell that is
contoured. The last was measured on seven million cells, lines included; the others are counted."""


def _relief_memory(extent: Extent) -> Memory:
    cells, project = extent.cells, extent.project
    contoured = cells / np.ceil(np.sqrt(max(cells, 1.0) / CONTOURED_CELLS)) ** 2  # blocks of cells beyond that
    terrain = (TERRAIN_BYTES * cells + BLOCK_BYTES * expected_blocks(cells, extent.size.cell_m)) * project.makes_terrain
    lines = (4.0 * cells + CONTOUR_BYTES * contoured) * project.contours.enabled
    return Memory(LIBRARIES_BYTES, max(terrain, lines), COARSER)


RELIEF: Stage = Stage(
    "relief",
    "Terrain and contours",
    ("surface",),
    lambda run: [run.project.terrain, run.project.contours],
    trace_relief,
    line_of(ReliefSummary, _relief_words),
    Costs(
        0.05,
        (
            Rate("contoured_mcells", 0.15, pieces=False),
            Rate("terrain_mcells", 0.2, pieces=False),
            Rate("terrain_mblocks", 12.0, pieces=False),
        ),
        is_asked_for=lambda extent: extent.project.contours.enabled or extent.project.makes_terrain,
        disk_bytes=lambda extent: extent.relief_bytes,
        memory=_relief_memory,
    ),
    products=("dtm.tif", "dtm_sigma.tif", "dtm_source.tif", "dtm_source.tif.aux.xml", "contours.gpkg"),
)
