"""Surface, orthophoto and dense cloud as they are handed over, and what the report shows of them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from photogram.block_files import BlockFiles
from photogram.dense_surface import FILLED
from photogram.files.atomic import replacing
from photogram.files.dense_points import CHUNK_CELLS, DensePoints, points_of_cells, write_dense_laz
from photogram.files.rasters import picture_on_grid
from photogram.map_grid import MapGrid
from photogram.orthophoto_stage import LEFT_OUT
from photogram.records import Run
from photogram.report.dense import DenseSurface, OrthophotoPicture, ground_marks
from photogram.report.dense_numbers import dense_numbers, orthophoto_numbers
from photogram.report.page_figures import PageFigure
from photogram.report.surface_figures import (
    DrawnFigure,
    drawn_orthophoto,
    drawn_surface,
    surface_figures,
    write_surface_pictures,
)
from photogram.surface_stages import matched, surface_layers
from photogram.workspace import read_json

PRODUCTS = {
    "surface": ("dsm.tif", "dsm_sigma.tif", "dsm_filled.tif", "dsm_source.tif"),
    "relief": ("dtm.tif", "dtm_source.tif", "contours.gpkg"),
    "orthophoto": ("orthophoto.tif",),
}
"""Files of results by the stage that makes them; those that a project does not ask for are not there."""

CLOUD = "dense.laz"
MAXIMUM_PICTURE_PX = 1800
"""Longer side of the orthophoto on the page, at most."""

SEEN_BY = 3
"""A cell that so many photographs show counts for the completeness."""


def copy_products(run: Run, results: Path) -> list[str]:
    """Copy what the stages of surfaces have made into the folder of results; returns the names."""
    names = []
    for stage, files in PRODUCTS.items():
        for name in files:
            if run.workspace.has(stage, name):
                made = run.workspace.file(stage, name)
                with replacing(results / name) as partial:
                    shutil.copyfile(made, partial)
                names.append(name)
    return names


def write_dense_cloud(run: Run, results: Path) -> list[str]:
    """Write a point for every measured cell of the dense surface, coloured by the orthophoto (black without one); no
    file where nothing was matched. Returns the names of what was written."""
    if not matched(run):
        return []
    layers = surface_layers(run)
    write_dense_laz(results / CLOUD, layers.grid, run.project.product_crs, _chunks(run, layers))
    return [CLOUD]


def _chunks(run: Run, layers: BlockFiles) -> Iterator[DensePoints]:
    has_picture = run.workspace.has("orthophoto", "orthophoto.tif")
    for window in layers.grid.tiles(CHUNK_CELLS):
        height, sigma, confidence, rays = layers.read(window, "height", "sigma", "confidence", "rays")
        colour = np.zeros((*window.shape, 3), np.uint8)
        if has_picture:
            picture = run.workspace.file("orthophoto", "orthophoto.tif")
            colour = picture_on_grid(picture, layers.grid, window)[..., :3]
        yield points_of_cells(layers.grid, window, height, colour, sigma, confidence, rays)


def orthophoto_picture(run: Run) -> OrthophotoPicture | None:
    """Return the orthophoto small enough for a page, None where there is none."""
    if not run.workspace.has("orthophoto", "orthophoto.tif"):
        return None
    path = run.workspace.file("orthophoto", "orthophoto.tif")
    whole = MapGrid(**read_json(run.workspace.file("orthophoto", "grid.json")))
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


def report_surface(
    run: Run, numbers: dict[str, Any], results: Path
) -> tuple[dict[str, Any], list[PageFigure], list[str]]:
    """Return what report.json says of the orthophoto and of the dense surface, their figures for the page, and the
    names of their pictures, which are written; nothing of what the project asks for none of."""
    value = dict[str, Any]()
    drawn, ground = list[DrawnFigure](), ground_marks(numbers["control_points"])
    orthophoto, dense = orthophoto_picture(run), dense_surface(run)
    if orthophoto is not None:
        value["orthophoto"] = orthophoto_numbers(orthophoto)
        drawn.append(drawn_orthophoto(orthophoto, ground))
    if run.workspace.has("orthophoto", LEFT_OUT):
        value["orthophoto"] = dict(read_json(run.workspace.file("orthophoto", LEFT_OUT)))
    if dense is not None:
        value["dense"] = dense_numbers(dense, ground)
        drawn += drawn_surface(dense, ground, value["dense"], run.project.report.target_rmse_v_m)
    names = write_surface_pictures(results / "pictures", drawn)
    return value, surface_figures(drawn), [f"pictures/{name}" for name in names]
