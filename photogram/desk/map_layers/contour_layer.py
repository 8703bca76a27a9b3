"""Contour lines for the map: those of the survey, or of another interval, traced from its terrain or surface."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.delivery.thinned_lines import DEFAULT_TOLERANCE_CELLS, thinned
from photogram.delivery.thinned_tin import reduced_raster
from photogram.errors import SettingError, SurfaceError
from photogram.files.maps.contour_files import read_contours
from photogram.geodesy.crs import NO_CRS
from photogram.languages.said import Figures, Said
from photogram.result_files import result_path
from photogram.surface.contours import ContourSettings, contour_lines
from photogram.survey import Contours

MOST_VERTICES = 400_000
"""More are not drawn: a larger interval shows the same relief."""

MOST_CELLS = 2_000_000
"""Of a raster that lines are traced from for the screen."""

_SURFACES = "dtm.tif", "dsm.tif"


class ContourLine(TypedDict):
    """A line of one height."""

    height_m: float
    is_index: bool
    """Whether it is a fifth one."""
    places_map_m: list[list[float]]


class ContourLayer(TypedDict):
    """Contour lines as the map draws them."""

    interval_m: float
    of: str
    """What they are lines of, and where they come from, in words."""
    lines: list[ContourLine]


def contour_layer(results: Path, crs: str, interval_m: float | None = None) -> ContourLayer:
    """Return the contour lines of a folder of results; of another ``interval_m`` they are traced anew, from cells that
    are averaged where there are many.

    Raises SurfaceError where there is nothing to trace or too much to draw, SettingError for no interval, ProjectError
    where a file is damaged.
    """
    path = result_path(results, "contours.gpkg")
    if interval_m is None and path.is_file():
        lines, of = read_contours(path, crs, 1.0, 0.0), Said("{file} of the results", file=path.name)
        step_m = _interval(lines.height_m)
        lines = Contours(lines.height_m, lines.vertex_map_m, lines.first, step_m, lines.cell_m)
    else:
        if interval_m is not None and not 0.01 <= interval_m <= 1000.0:
            found = f"{interval_m:g}"
            raise SettingError("interval_m", Said("0.01 to 1000 m are expected, found {found}", found=found))
        lines, of = _traced(results, crs, interval_m)
    if len(lines.vertex_map_m) > MOST_VERTICES:
        raise SurfaceError(
            Said(
                "{count} vertices are too many for the screen: choose an interval above {interval} m",
                count=len(lines.vertex_map_m),
                interval=Figures(f"{lines.interval_m:g}"),
            )
        )
    parts: Sequence[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]
    parts = np.split(np.round(lines.vertex_map_m, 2), lines.first[1:-1]) if len(lines) else []
    return {
        "interval_m": lines.interval_m,
        "of": of,
        "lines": [
            {"height_m": height, "is_index": index, "places_map_m": places.tolist()}
            for height, index, places in zip(lines.height_m.tolist(), lines.is_index.tolist(), parts, strict=True)
        ],
    }


def _interval(height_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Return the interval of lines: the least step between their heights; 1 m of a single height."""
    steps = np.diff(np.unique(np.round(height_m, 4)))
    return float(np.round(steps.min(), 4)) if len(steps) else 1.0


def _traced(results: Path, crs: str, interval_m: float | None) -> tuple[Contours, Said]:
    known = [path for name in _SURFACES if (path := result_path(results, name)).is_file()]
    if not known:
        raise SurfaceError(Said("there is no surface to trace contour lines from: run the survey first"))
    raster = reduced_raster(known[0], local=crs == NO_CRS, most=MOST_CELLS)
    lines = contour_lines(raster, ContourSettings(interval_m=interval_m))
    tolerance_m = DEFAULT_TOLERANCE_CELLS * raster.cell_m
    cell = Figures(f"{raster.cell_m:g}")
    said = (
        Said("terrain, traced from cells of {cell} m for the screen", cell=cell)
        if known[0].name == "dtm.tif"
        else Said("surface, traced from cells of {cell} m for the screen", cell=cell)
    )
    return thinned(lines, tolerance_m), said
