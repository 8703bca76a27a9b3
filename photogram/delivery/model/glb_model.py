"""The surface with the orthophoto on it as one file for viewers: model.glb."""

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from photogram.delivery.land_xml import within
from photogram.delivery.model.draped_mesh import draped, picture_of, within_rim
from photogram.delivery.model.gltf import glb
from photogram.delivery.survey_contents import SurveyContents
from photogram.delivery.thinned_tin import (
    DEFAULT_ERROR_INTERVALS,
    ROUNDING_M,
    ThinnedTin,
    interval_of,
    reduced_raster,
    thinned_tin,
)
from photogram.files.atomic import write_whole
from photogram.files.maps.rasters import pixel_m
from photogram.geodesy.crs import NO_CRS, map_units
from photogram.grid import MapGrid
from photogram.report.view.drawn_surface import STEEPEST_DEG
from photogram.wording import things

MOST_VERTICES = 100_000
"""Of the model: some 200 000 triangles, which every viewer turns smoothly."""

MOST_CELLS = 4_000_000
"""A larger surface is averaged to so many cells."""

MOST_PIXELS = 4096
"""Along a side of its picture, which is as much as every viewer takes."""


def write_model(path: Path, contents: SurveyContents, error_m: float | None) -> tuple[str, tuple[str, ...]]:
    """Write the model, whole or not at all; return in words what it holds, nothing where there is no surface and no
    file was written, and sentences on what it does not hold.

    It is off by ``error_m`` at most, a tenth of a contour interval if None, unless that takes more than MOST_VERTICES.
    Raises ProjectError where a raster cannot be read, SurfaceError where it has hardly any heights, WorkspaceError
    where the file cannot be written.
    """
    if contents.top is None:
        return "", (f"Surface: {contents.absent.get('surface') or 'there is none'}.",)
    heights = reduced_raster(contents.top, local=contents.crs == NO_CRS, most=MOST_CELLS)
    if contents.orthophoto is not None:
        heights = within_rim(heights, contents.orthophoto)
    error_m = DEFAULT_ERROR_INTERVALS * interval_of(heights) if error_m is None else error_m
    tin = thinned_tin(heights, error_m, MOST_VERTICES)
    origin_map_m = np.round(tin.vertex_map_m.mean(axis=0))
    picture = (
        None if contents.orthophoto is None else picture_of(contents.orthophoto, _pixels(contents.orthophoto, tin))
    )
    uv = None if picture is None else picture.uv(tin.vertex_map_m)
    parts = draped(tin.vertex_map_m - origin_map_m, uv, tin.triangle)
    said = _said(contents, tin, origin_map_m.tolist())
    write_whole(path, glb(parts, None if picture is None else picture.jpeg, said))
    shown = f"surface of {things(len(tin.triangle), 'triangle')}, {within(tin)}"
    lacks = []
    if tin.greatest_m > error_m + ROUNDING_M:
        lacks.append(
            f"Heights within {error_m:g} m: that takes more than {MOST_VERTICES} vertices: give a larger "
            "--surface-error-m, or take survey.xml."
        )
    if picture is None:
        return shown, (*lacks, "Orthophoto: there is none, so the surface is grey.")
    return f"{shown}, with the orthophoto in {picture.grid.columns} × {picture.grid.rows} pixels", tuple(lacks)


def _pixels(orthophoto: Path, tin: ThinnedTin) -> MapGrid:
    """Return the pixels of the model's picture: those of the orthophoto around the vertices, or larger ones."""
    low, high = tin.vertex_map_m[:, :2].min(axis=0), tin.vertex_map_m[:, :2].max(axis=0)
    cell_m = max(pixel_m(orthophoto), float((high - low).max()) / (MOST_PIXELS - 1))
    columns, rows = (min(MOST_PIXELS, ceil(length / cell_m) + 1) for length in (high - low).tolist())
    return MapGrid(float(low[0]), float(high[1]), cell_m, rows, columns)


def _said(contents: SurveyContents, tin: ThinnedTin, origin_map_m: list[float]) -> dict[str, Any]:
    units = map_units(contents.crs)
    return {
        "crs": contents.crs,
        "crs_in_words": contents.crs_words,
        "origin_map_m": origin_map_m,
        "axes": "x east, y up, z south, m; map = origin + (x, -z, y)",
        "units_of_the_crs_m": {"plan": units.plan_m, "height": units.height_m},
        "greatest_vertical_error_m": round(tin.greatest_m, 4),
        "rms_vertical_error_m": round(tin.rms_m, 4),
        "cell_m": tin.cell_m,
        "walls": f"triangles steeper than {STEEPEST_DEG:g}°, which the orthophoto does not see: grey, material walls",
    }
