"""Lines, points and outlines as Shapefiles in one zip: what every GIS and most programs of construction open.

The format (ESRI 1998) has names of fields up to 10 characters, no text beyond 254 bytes and no unit: each row names it.
"""

import shutil
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError

from photogram.delivery.survey_contents import SurveyContents
from photogram.files.atomic import replacing, scratch_folder
from photogram.geodesy.crs import NO_CRS, MapUnits, esri_wkt, map_units
from photogram.wording import things

NAME, ROLE, HEIGHT, UNIT, INDEX = "name", "role", "height", "unit", "index"
"""Fields."""

# The same survey is to give the same bytes.
_NO_DATE, _NO_TIME = "2000-01-01", (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, eq=False)
class _Layer:
    """A Shapefile: shapes of one kind, in the units of the map, and a value of each field for each."""

    name: str
    kind: str
    one: str
    """What a shape is called."""
    shapes: Any
    fields: dict[str, Any]


def write_shapefiles(path: Path, contents: SurveyContents) -> str:
    """Write contour lines, ground points, rim and footprints as a zip of Shapefiles, whole or not at all, and return in
    words what it holds.

    Easting and northing have the unit of the plan, heights theirs. The same survey gives the same bytes. Raises
    WorkspaceError where the file cannot be written.
    """
    layers = [layer for layer in _layers(contents, map_units(contents.crs)) if len(layer.shapes)]
    with replacing(path) as partial, scratch_folder(partial) as folder:
        for layer in layers:
            _write(folder, layer, contents.crs)
        with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(folder.iterdir()):
                entry = zipfile.ZipInfo(file.name, _NO_TIME)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.file_size = file.stat().st_size
                with file.open("rb") as source, archive.open(entry, "w") as target:
                    shutil.copyfileobj(source, target)
    return ", ".join(things(len(layer.shapes), layer.one) for layer in layers) or "nothing"


def _layers(contents: SurveyContents, units: MapUnits) -> Iterator[_Layer]:
    contours, points, symbol = contents.contours, contents.points, units.height_symbol
    if contours is not None and len(contours):
        of_line = np.repeat(np.arange(len(contours)), np.diff(contours.first))
        height = contours.height_m / units.height_m
        lines = shapely.linestrings(
            np.column_stack([contours.vertex_map_m / units.plan_m, height[of_line]]), indices=of_line
        )
        fields = {HEIGHT: height, UNIT: _text([symbol] * len(height)), INDEX: contours.is_index.astype(np.int32)}
        yield _Layer("contours", "LineString Z", "contour line", lines, fields)
    place = units.from_metres(points.position_map_m)
    level = np.where(np.isfinite(place[:, 2]), place[:, 2], 0.0)
    roles = ["control" if control else "check" for control in points.is_control]
    yield _Layer(
        "ground_points",
        "Point Z",
        "ground point",
        shapely.points(np.column_stack([place[:, :2], level])),
        {NAME: _text(points.name), ROLE: _text(roles), HEIGHT: place[:, 2].copy(), UNIT: _text([symbol] * len(roles))},
    )
    if contents.rim is not None:
        plan = shapely.transform(contents.rim, lambda at: at / units.plan_m)
        yield _Layer("rim", "Polygon", "rim", np.array([plan]), {"area_m2": np.array([contents.rim.area])})
    shown = contents.footprints
    corners = [units.from_metres(footprint.corner_map_m) for footprint in shown]
    outlines = shapely.polygons(np.array(corners)) if corners else np.zeros(0, dtype=object)
    yield _Layer("footprints", "Polygon Z", "footprint", outlines, {NAME: _text([f.name for f in shown])})


def _text(values: Any) -> Any:  # noqa: ANN401 - arrays of objects, as pyogrio takes text
    return np.array(list(values), dtype=object)


def _write(folder: Path, layer: _Layer, crs: str) -> None:
    file = folder / f"{layer.name}.shp"
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "'crs' was not provided", UserWarning)  # written below
            pyogrio.raw.write(
                file,
                geometry=shapely.to_wkb(layer.shapes),
                field_data=list(layer.fields.values()),
                fields=list(layer.fields),
                driver="ESRI Shapefile",
                geometry_type=layer.kind,
                crs=None,
                layer_options={"ENCODING": "UTF-8", "DBF_DATE_LAST_UPDATE": _NO_DATE},
            )
    except (DataSourceError, DataLayerError) as error:
        raise OSError(str(error)) from error
    if crs != NO_CRS:
        file.with_suffix(".prj").write_text(esri_wkt(crs), encoding="utf-8")
