"""What was measured on a map as a GeoPackage: outlines, lines and places with their figures, for a GIS and to go on
from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.files.maps.contour_files import DATASET, geopackage
from photogram.geodesy.crs import map_units, plan_of, written_crs

LAYER = "measurements"
_FIELDS = ("name", "kind", "figures", "record")
_SHAPES = ("Point", "LineString", "Polygon")


@dataclass(frozen=True, eq=False)
class StoredMeasurement:
    """A measurement as its file keeps it."""

    name: str
    kind: str
    corners_map_m: FloatArray
    """Easting and northing (N, 2)."""
    is_outline: bool
    """Whether the corners close an outline; else they are a line, or one place."""
    figures: str
    """In words, for a GIS."""
    record: str
    """Whatever the program that measured keeps of it."""


def write_measurements(path: Path, measurements: Sequence[StoredMeasurement], crs: str) -> None:
    """Write measurements in the plan of ``crs`` as a GeoPackage with the layer ``measurements``; whole or not at all.
    Where ``crs`` counts feet, so do the corners. The same measurements give the same bytes. Raises WorkspaceError where
    the file cannot be written."""
    units, written = map_units(crs), written_crs(crs)
    shapes = np.array([_shape(m, units.plan_m) for m in measurements] or [], dtype=object)
    with geopackage(path) as file:
        pyogrio.raw.write(
            file,
            geometry=shapely.to_wkb(shapes),
            field_data=[np.array([getattr(m, name) for m in measurements], dtype=object) for name in _FIELDS],
            fields=list(_FIELDS),
            layer=LAYER,
            driver="GPKG",
            geometry_type="Unknown",
            crs=None if written is None else plan_of(crs),
            dataset_options=DATASET,
            layer_options={"IDENTIFIER": "Measurements"},
        )


def read_measurements(path: Path, crs: str) -> list[StoredMeasurement]:
    """Return what ``write_measurements`` has written in ``crs``. Raises ProjectError where the file is damaged or
    something else."""
    try:
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=LAYER)
        named = dict(zip(meta["fields"], fields, strict=True))
        columns = [named[name] for name in _FIELDS]
        shapes = shapely.from_wkb(np.zeros(0, object) if geometry is None else geometry)
        if any(shape is None or shape.is_empty or shape.geom_type not in _SHAPES for shape in shapes.tolist()):
            raise ValueError("one has no place")
    except (DataSourceError, DataLayerError, KeyError, OSError, ValueError, shapely.errors.ShapelyError) as error:
        words = " ".join(str(error).split())[:200]
        raise ProjectError(
            f"measurements {path}: cannot be read ({words}): move it away to begin without any"
        ) from error
    plan_m = map_units(crs).plan_m
    return [
        StoredMeasurement(str(row[0]), str(row[1]), *_corners(shape, plan_m), str(row[2]), str(row[3]))
        for shape, row in zip(shapes, zip(*columns, strict=True), strict=True)
    ]


def _shape(measurement: StoredMeasurement, plan_m: float) -> Any:  # noqa: ANN401 - of shapely, which has no types
    corners = measurement.corners_map_m / plan_m
    if measurement.is_outline:
        return shapely.Polygon(corners)
    return shapely.Point(corners[0]) if len(corners) == 1 else shapely.LineString(corners)


def _corners(shape: Any, plan_m: float) -> tuple[FloatArray, bool]:  # noqa: ANN401 - of shapely
    outline = shape.geom_type == "Polygon"
    corners = shapely.get_coordinates(shape.exterior if outline else shape) * plan_m
    return (corners[:-1] if outline else corners), outline
