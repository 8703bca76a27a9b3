"""The stage `orthophoto`: reads the adjustment, the surface and the photographs, and writes `orthophoto.tif` with its
rim and its seams, and the bands of companions beside it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from photogram.arrays import ByteArray
from photogram.camera import Pose
from photogram.errors import ProjectError
from photogram.files.atomic import scratch_folder, temporary_name
from photogram.files.maps.cogs import CATEGORY_SUFFIX, write_cog_rgba
from photogram.files.maps.seam_files import NamedPolygon, read_seams, write_seams
from photogram.files.npz_json import file_fingerprint, write_json
from photogram.grid import Window
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import (
    LIBRARIES_BYTES,
    MATCHED_CELL_BYTES,
    PICTURE_BYTES,
    TILE_BYTES,
    Costs,
    Extent,
    Memory,
    Rate,
)
from photogram.pipeline.stages.bands.band_orthophoto import BANDS_FILE, make_bands
from photogram.pipeline.stages.orthophoto_pieces import (
    CachedPhotographs,
    looked_at,
    masks_of,
    tiles_of,
)
from photogram.pipeline.stages.photographs import stretches
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.stages.stored_surface import LEFT_OUT, reason_left_out
from photogram.pipeline.stages.surface_frame import GridSummary, cells_in_words, depression, made_frame
from photogram.pipeline.stages.surfaces.closing import stored_closing
from photogram.pipeline.stages.surfaces.plan_quality import SIGMA_FILE, SOURCE_FILE, PlanQuality
from photogram.pipeline.store.run import Run
from photogram.project.project import Project
from photogram.project.rigs.entries import without_products
from photogram.surface.ortho.orthophoto import (
    CACHE_BYTES,
    LEAST_CACHED,
    ONLY_MASKED,
    TILE_CELLS,
    ForcedOf,
    Orthophoto,
    above_ground_m,
    chosen_orthophoto,
    scored_samples,
)
from photogram.surface.ortho.outline import (
    SeamPolygon,
    cells_inside,
    seam_polygons,
    sides_of,
    views_in_blocks,
)
from photogram.surface.ortho.seamlines import LARGEST_LATTICE, SMALLEST_BLOCK
from photogram.surface.views import Views
from photogram.wording import Progress, some, things


class OrthophotoSummary(GridSummary, total=False):
    """What the stage says of itself."""

    cells: int
    """Number of cells that are shown."""
    transparent: int
    """Number of cells within its rim that are not shown."""
    photographs: int
    """Number of photographs used."""
    least_factor: float
    """Least factor of the brightness of a photograph, mean of the channels."""
    greatest_factor: float
    """Greatest factor of the brightness of a photograph, mean of the channels."""
    left_out: str
    """Why there is none."""


OUTLINE_FILE = "outline.gpkg"
"""The rim with the seams."""

RIM_FILE = "rim.json"
"""How many cells the rim holds, and how many of them show nothing."""

LEAST_DEPRESSION_DEG = 40.0
"""Of the median optical axis, below the horizon: what is flatter shows facades, which a plan does not; oblique flights
for models of towns look down by 45°."""


def left_out_reason(poses: Sequence[Pose | None]) -> str:
    """Return why photographs of these poses make no orthophoto in plan, empty where they do."""
    below_deg, words = depression(poses)
    if below_deg >= LEAST_DEPRESSION_DEG:
        return ""
    return f"the photographs are oblique (median optical axis {words}): an orthophoto would not show what they show"


def make_orthophoto(run: Run, folder: Path, progress: Progress) -> OrthophotoSummary:
    """Make the orthophoto on the closed surface and write it as ``orthophoto.tif``, tile by tile, with its rim and its
    seams as ``outline.gpkg``; of photographs that look sideways none, and why in ``left_out.json``."""
    if not run.project.orthophoto.enabled:
        return {}
    site = made_frame(run)
    reason = reason_left_out(run, "surface")
    if not reason and run.project.surface.plane != "auto":
        reason = left_out_reason(block_as_adjusted(run).poses)
    if reason:
        write_json(folder / LEFT_OUT, {"left_out": reason})
        return {"left_out": reason}
    block = site.block()
    views = Views.of(block)
    names = [block.photographs[i].name for i in views.photograph]
    pixels_of = CachedPhotographs.of(run, views)
    camera = np.array([block.photographs[i].camera for i in views.photograph], dtype=np.int64)
    progress(0, 0, "seams and exposure")
    with scratch_folder(temporary_name(folder)) as scratch:
        surface, rim = stored_closing(run)
        settings, edited = run.project.orthophoto, edited_seams(run.project, names, site.plan)
        masks = masks_of(run, views)
        block_samples = scored_samples(views, block.frame, surface, run.executor, settings, forced=edited, masks=masks)
        samples = looked_at(run, folder, scratch, block_samples, pixels_of)
        orthophoto = chosen_orthophoto(block_samples, samples, settings, camera)
        grid, blocks, seams = orthophoto.grid, orthophoto.blocks, orthophoto.seams
        sides = sides_of(rim)
        inside = visible = masked = 0
        quality = PlanQuality.of(
            run, site, surface, float(np.median(above_ground_m(views, orthophoto.terrain))), scratch
        )

        def counted() -> Iterator[tuple[Window, ByteArray]]:
            nonlocal inside, visible, masked
            total = -(-grid.rows // TILE_CELLS) * -(-grid.columns // TILE_CELLS)
            made = tiles_of(run, folder, scratch, orthophoto, pixels_of)
            for done, (window, (rgba, rays)) in enumerate(made, 1):
                within = cells_inside(sides, grid, window)
                quality.take(rays, cells_inside(sides, surface.grid, rays.window))
                rgba[~within] = 0
                only_masked = rgba[..., 3] == ONLY_MASKED
                rgba[only_masked] = 0
                masked += int(np.count_nonzero(only_masked))
                inside += int(np.count_nonzero(within))
                visible += int(np.count_nonzero(rgba[..., 3]))
                yield window, rgba
                progress(done, total, f"{grid.columns} × {grid.rows} cells of {grid.cell_m:g} m")

        write_cog_rgba(folder / "orthophoto.tif", grid, site.plan, counted(), note=site.note)
        quality.write(folder, site)
        if without_products(run.project.rigs):
            progress(0, 0, "bands")
            make_bands(run, folder, site, surface, orthophoto, sides, pixels_of)
    polygons = seam_polygons(seams.label, blocks, rim)
    write_seams(folder / OUTLINE_FILE, rim, [NamedPolygon(names[p.view], p.polygon) for p in polygons], site.plan)
    write_json(folder / "grid.json", grid)
    transparent = inside - visible - masked
    rim_record = {"cells": inside, "transparent": transparent, "masked": masked, "area_m2": rim.area}
    write_json(folder / RIM_FILE, rim_record)
    size: OrthophotoSummary = {"rows": grid.rows, "columns": grid.columns, "cell_m": grid.cell_m}
    return {**size, "cells": visible, "transparent": transparent, **summary(orthophoto)}


def edited_seams(project: Project, names: Sequence[str], crs: str) -> ForcedOf | None:
    """Return the photographs that the project's file of seams, in ``crs``, asks for, None without one.

    Raises ProjectError where the file cannot be read, or names what is no photograph of the project, or one without a
    pose.
    """
    path = project.orthophoto.seams
    if path is None:
        return None
    polygons = read_seams(Path(path), [p.name for p in project.photographs], crs)
    missing = sorted({p.photograph for p in polygons} - set(names))
    if missing:
        raise ProjectError(
            f"seams {path}: {some(missing)}: not oriented, nothing can be taken from it: give its polygons to others"
        )
    seams = [SeamPolygon(names.index(p.photograph), p.polygon) for p in polygons]
    return lambda blocks: views_in_blocks(seams, blocks)


def summary(orthophoto: Orthophoto) -> OrthophotoSummary:
    """Return how many photographs an orthophoto is made of, and by what the brightest and the darkest of them are
    multiplied, as the mean of the channels."""
    label = orthophoto.seams.label
    used = np.unique(label[label >= 0])
    factor = np.exp(-orthophoto.balance.log_gain[used]).mean(axis=1)
    least, most = (float(factor.min()), float(factor.max())) if len(used) else (1.0, 1.0)
    return {"photographs": len(used), "least_factor": round(least, 4), "greatest_factor": round(most, 4)}


def _words(summary: OrthophotoSummary) -> str:
    if "columns" not in summary:
        return "not requested"
    return f"{cells_in_words(summary)} from {things(summary['photographs'], 'photograph')}"


def _settings(run: Run) -> object:
    seams = run.project.orthophoto.seams
    edited = None if seams is None else file_fingerprint(Path(seams))
    return [run.photograph_fingerprints, run.project.orthophoto, edited, *stretches(run)]


LATTICE_BYTES = 600.0
"""In memory for a block of the lattice of seams: candidates with their costs, grey values and messages, counted."""


def _memory(extent: Extent) -> Memory:
    picture, largest_px = extent.size.orthophoto_cells, extent.largest_px
    decoded = min(3.0 * len(extent.project.photographs) * largest_px, max(3.0 * LEAST_CACHED * largest_px, CACHE_BYTES))
    lattice = LATTICE_BYTES * min(picture / SMALLEST_BLOCK**2, LARGEST_LATTICE)
    tiles = min(extent.workers * TILE_BYTES, MATCHED_CELL_BYTES * (picture + extent.cells))
    made = (4.0 * extent.cells + lattice + decoded + tiles) * extent.project.orthophoto.enabled
    return Memory(LIBRARIES_BYTES + made, remedy="set orthophoto.enabled to false")


ORTHOPHOTO: Stage = Stage(
    "orthophoto",
    "Orthophoto",
    ("adjustment", "surface"),
    _settings,
    make_orthophoto,
    line_of(OrthophotoSummary, _words),
    Costs(
        0.2,
        (Rate("orthophoto_mpx", 1.5), Rate("megapixels", 0.02)),
        1.5,
        ("photogram.surface.ortho",),
        is_asked_for=lambda extent: extent.size.orthophoto_cells > 0,
        is_tested=True,
        disk_bytes=lambda extent: extent.size.orthophoto_cells * extent.size.covered_share * PICTURE_BYTES,
        memory=_memory,
    ),
    products=("orthophoto.tif", SIGMA_FILE, SOURCE_FILE, SOURCE_FILE + CATEGORY_SUFFIX, BANDS_FILE, OUTLINE_FILE),
)
