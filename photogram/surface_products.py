"""Surface, orthophoto and dense cloud as they are handed over, and what the report shows of them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import date, datetime
from pathlib import Path
from typing import Any

import numpy as np

from photogram.block_files import BlockFiles
from photogram.camera import Pose
from photogram.dense_surface import FILLED, MEASURED
from photogram.files.atomic import replacing
from photogram.files.dense_points import (
    CHUNK_CELLS,
    GROUND,
    NEVER_CLASSIFIED,
    NOT_GROUND,
    DensePoints,
    points_of_cells,
    write_dense_laz,
)
from photogram.files.points import NO_DATE
from photogram.files.rasters import picture_on_grid, read_codes
from photogram.map_grid import MapGrid
from photogram.orthophoto_stage import LEFT_OUT
from photogram.records import Run
from photogram.report.dense import DenseSurface, OrthophotoPicture, ground_marks
from photogram.report.dense_numbers import dense_numbers, orthophoto_numbers, sigma_numbers
from photogram.report.page_figures import PageFigure
from photogram.report.surface_figures import (
    SURFACE_PICTURES,
    DrawnFigure,
    drawn_orthophoto,
    drawn_surface,
    surface_figures,
    write_surface_pictures,
)
from photogram.stages import RELATIVE_SIGMA_FILE
from photogram.surface_stages import matched, surface_layers
from photogram.workspace import read_json

PRODUCTS = {
    "surface": (
        "dsm.tif",
        "dsm_sigma.tif",
        RELATIVE_SIGMA_FILE,
        "dsm_filled.tif",
        "dsm_source.tif",
        "dsm_source.tif.aux.xml",
    ),
    "relief": ("dtm.tif", "dtm_source.tif", "dtm_source.tif.aux.xml", "contours.gpkg"),
    "orthophoto": ("orthophoto.tif",),
}
"""Files of results by the stage that makes them; those that a project does not ask for are not there."""

CLOUD = "dense.laz"
MAXIMUM_PICTURE_PX = 1800
"""Longer side of the orthophoto on the page, at most."""

DROWNS = 3.0
"""A datum known so many times worse in height than the shape hides it: figures then show the relative sigma."""

SEEN_BY = 3
"""A cell that so many photographs show counts for the completeness."""


def copy_products(run: Run, results: Path) -> list[str]:
    """Copy what the stages of surfaces have made into the folder of results, and remove what is not made any more;
    returns the names."""
    names = []
    for stage, files in PRODUCTS.items():
        for name in files:
            made = run.workspace.stage(stage) / name
            if made.is_file():
                with replacing(results / name) as partial:
                    shutil.copyfile(made, partial)
                names.append(name)
            else:
                (results / name).unlink(missing_ok=True)
    return names


def flight_date(notes: Sequence[Mapping[str, Any]], poses: Sequence[Pose | None]) -> date:
    """Return the day of the last exposure with a pose whose time the tags give, in their notes, NO_DATE where none
    does: the date of the clouds."""
    times = [note["time"] for note, pose in zip(notes, poses, strict=True) if pose is not None]
    return max((datetime.fromisoformat(time).date() for time in times if time is not None), default=NO_DATE)


def write_dense_cloud(run: Run, results: Path) -> list[str]:
    """Write a point for every measured cell of the dense surface that the orthophoto shows, in its colour; for every
    one, without colours, where there is no orthophoto; no file where nothing was matched. Returns the names of what was
    written."""
    path = results / CLOUD
    if not matched(run):
        path.unlink(missing_ok=True)
        return []
    layers, created = surface_layers(run), flight_date(run.notes(), run.adjustment().block.poses)
    picture = run.workspace.stage("orthophoto") / "orthophoto.tif"
    coloured = picture.is_file()
    chunks = _chunks(run, layers, picture if coloured else None)
    write_dense_laz(path, layers.grid, run.project.product_crs, chunks, created, coloured=coloured)
    return [CLOUD]


def _chunks(run: Run, layers: BlockFiles, picture: Path | None) -> Iterator[DensePoints]:
    terrain = run.workspace.stage("relief") / "dtm_source.tif"
    for window in layers.grid.tiles(CHUNK_CELLS):
        height, sigma, confidence, rays = layers.read(window, "height", "sigma", "confidence", "rays")
        colour = np.zeros((*window.shape, 3), np.uint8)
        if picture is not None:
            rgba = picture_on_grid(picture, layers.grid, window)
            # over the finished surface no photograph sees it: its height and its visibility contradict each other
            colour, height = rgba[..., :3], np.where(rgba[..., 3] > 0, height, np.float32(np.nan))
        classes = np.full(window.shape, NEVER_CLASSIFIED, np.uint8)
        if terrain.is_file():
            classes = np.where(read_codes(terrain, window) == MEASURED, GROUND, NOT_GROUND).astype(np.uint8)
        yield points_of_cells(layers.grid, window, height, colour, sigma, confidence, rays, classes)


def orthophoto_picture(run: Run) -> OrthophotoPicture | None:
    """Return the orthophoto small enough for a page, None where there is none."""
    folder = run.workspace.stage("orthophoto")
    path = folder / "orthophoto.tif"
    if not path.is_file():
        return None
    whole = MapGrid(**read_json(folder / "grid.json"))
    block = -(-max(whole.rows, whole.columns) // MAXIMUM_PICTURE_PX)
    rows, columns = -(-whole.rows // block), -(-whole.columns // block)
    grid = MapGrid(whole.west_map_m, whole.north_map_m, whole.cell_m * block, rows, columns)
    rgba = picture_on_grid(path, grid, grid.whole)
    return OrthophotoPicture(
        rgba, grid.west_map_m, grid.north_map_m, grid.cell_m, whole.cell_m, (whole.rows, whole.columns)
    )


def dense_surface(run: Run) -> DenseSurface | None:
    """Return the dense surface as the report takes it, None where nothing was matched."""
    if not matched(run):
        return None
    layers = surface_layers(run)
    source, rays, confidence, seen = layers.read(layers.grid.whole, "source", "rays", "confidence", "seen")
    names = tuple(
        p.name
        for p, pose in zip(run.project.photographs, run.adjustment().block.poses, strict=True)
        if pose is not None
    )
    return DenseSurface(
        run.surface(), run.surface_sigma(), source == FILLED, rays, confidence, seen >= SEEN_BY, names,
        {k: v for k, v in asdict(run.project.dense).items() if k != "enabled"},
    )  # fmt: skip


def _shown(run: Run, dense: DenseSurface, numbers: dict[str, Any]) -> tuple[DenseSurface, dict[str, Any], float | None]:
    """Return the surface and its numbers as figures show them, and the datum's sigma in height where it is left out of
    them: where it would hide everything else."""
    shape, relative = run.shape(), run.surface_relative_sigma()
    if shape is None or relative is None or numbers["sigma_m"] is None:
        return dense, numbers, None
    without = replace(dense, sigma=relative)
    spread, datum_sigma_m = sigma_numbers(without), float(np.sqrt(shape.datum_covariance_m2[2, 2]))
    if spread is None or not datum_sigma_m > DROWNS * spread["median"]:
        return dense, numbers, None
    return without, {**numbers, "sigma_m": spread}, datum_sigma_m


def report_surface(
    run: Run, numbers: dict[str, Any], results: Path
) -> tuple[dict[str, Any], list[PageFigure], list[str]]:
    """Return what report.json says of the orthophoto and of the dense surface, their figures for the page, and the
    names of their pictures, which are written; nothing of what the project asks for none of."""
    for name in SURFACE_PICTURES:
        (results / "pictures" / name).unlink(missing_ok=True)
    value = dict[str, Any]()
    drawn, ground = list[DrawnFigure](), ground_marks(numbers["control_points"])
    orthophoto, dense = orthophoto_picture(run), dense_surface(run)
    if orthophoto is not None:
        value["orthophoto"] = orthophoto_numbers(orthophoto)
        drawn.append(drawn_orthophoto(orthophoto, ground))
    left_out = run.workspace.stage("orthophoto") / LEFT_OUT
    if left_out.is_file():
        value["orthophoto"] = dict(read_json(left_out))
    if dense is not None:
        value["dense"] = dense_numbers(dense, ground)
        target_m = run.project.report.target_rmse_v_m
        shown, numbers_shown, datum_sigma_m = _shown(run, dense, value["dense"])
        drawn += drawn_surface(shown, ground, numbers_shown, target_m, datum_sigma_m)
    names = write_surface_pictures(results / "pictures", drawn)
    return value, surface_figures(drawn), [f"pictures/{name}" for name in names]
