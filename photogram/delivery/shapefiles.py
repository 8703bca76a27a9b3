"""Contour lines, ground points, rim and footprints as Shapefiles, whose rows name the unit of their heights."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from photogram.delivery.survey_contents import SurveyContents
from photogram.files.maps.shapefile_zips import ShapeLayer, write_shapefile_zip
from photogram.geodesy.crs import MapUnits, map_units
from photogram.wording import things

NAME, ROLE, HEIGHT, UNIT, INDEX = "name", "role", "height", "unit", "index"
"""Fields."""

_ONE = {"contours": "contour line", "ground_points": "ground point", "rim": "rim", "footprints": "footprint"}


def write_shapefiles(path: Path, contents: SurveyContents) -> str:
    """Write contour lines, ground points, rim and footprints as a zip of Shapefiles, whole or not at all, and return in
    words what it holds.

    Easting and northing have the unit of the plan, heights theirs. The same survey gives the same bytes. Raises
    WorkspaceError where the file cannot be written.
    """
    layers = [layer for layer in _layers(contents, map_units(contents.crs)) if len(layer.shapes)]
    write_shapefile_zip(path, layers, contents.crs)
    return ", ".join(things(len(layer.shapes), _ONE[layer.name]) for layer in layers) or "nothing"


def _layers(contents: SurveyContents, units: MapUnits) -> Iterator[ShapeLayer]:
    contours, points, symbol = contents.contours, contents.points, units.height_symbol
    if contours is not None and len(contours):
        of_line = np.repeat(np.arange(len(contours)), np.diff(contours.first))
        height = contours.height_m / units.height_m
        lines = shapely.linestrings(
            np.column_stack([contours.vertex_map_m / units.plan_m, height[of_line]]), indices=of_line
        )
        fields = {HEIGHT: height, UNIT: _text([symbol] * len(height)), INDEX: contours.is_index.astype(np.int32)}
        yield ShapeLayer("contours", "LineString Z", lines, fields)
    place = units.from_metres(points.position_map_m)
    level = np.where(np.isfinite(place[:, 2]), place[:, 2], 0.0)
    roles = ["control" if control else "check" for control in points.is_control]
    yield ShapeLayer(
        "ground_points",
        "Point Z",
        shapely.points(np.column_stack([place[:, :2], level])),
        {NAME: _text(points.name), ROLE: _text(roles), HEIGHT: place[:, 2].copy(), UNIT: _text([symbol] * len(roles))},
    )
    if contents.rim is not None:
        plan = shapely.transform(contents.rim, lambda at: at / units.plan_m)
        yield ShapeLayer("rim", "Polygon", np.array([plan]), {"area_m2": np.array([contents.rim.area])})
    shown = contents.footprints
    corners = [units.from_metres(footprint.corner_map_m) for footprint in shown]
    outlines = shapely.polygons(np.array(corners)) if corners else np.zeros(0, dtype=object)
    yield ShapeLayer("footprints", "Polygon Z", outlines, {NAME: _text([f.name for f in shown])})


def _text(values: Iterable[str]) -> NDArray[np.generic]:
    return np.array(list(values), dtype=object)
