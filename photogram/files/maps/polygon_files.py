"""Polygons of a site, GeoPackage or GeoJSON: what a volume is asked for, and ground that has not moved."""

from dataclasses import dataclass
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError

from photogram.errors import FrameError, ProjectError
from photogram.files.reading import check_size
from photogram.geodesy.crs import NO_CRS, map_units, plan_of, same_plan

SUFFIXES = (".gpkg", ".geojson", ".json")
NAME_FIELDS = ("name", "label", "title", "id", "fid")
"""Fields that name a polygon, the first that there is; without one it has its number."""

MOST_BYTES, MOST_POLYGONS, LARGEST_COORDINATE_M = 500_000_000, 100_000, 1e9
_WORLD = "OGC:CRS84"
_DAMAGE = (DataSourceError, DataLayerError, OSError, ValueError, shapely.errors.ShapelyError)

Geometry = Any  # of shapely, which has no types


@dataclass(frozen=True, eq=False)
class SitePolygon:
    """A polygon or several parts of one in the map, and what it is called."""

    name: str
    polygon: Geometry


def read_polygons(path: Path, crs: str) -> list[SitePolygon]:
    """Return the polygons of a file's only layer in its order, in the plan of ``crs``; those of a CRS in feet come back
    in metres.

    A GeoJSON that names no CRS in its key ``crs`` is in longitude and latitude (RFC 7946) and refused, unless its
    coordinates cannot be degrees: then they are taken as those of the map, as many programs write them. Raises
    ProjectError where the file is missing, damaged or of another kind, or a polygon is not valid, FrameError where it
    lies in another CRS.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ProjectError(f"polygons {path}: {', '.join(SUFFIXES)} are read: export them as GeoPackage")
    if not isfile(path):
        raise ProjectError(f"polygons {path}: file not found: check its path")
    meta, shapes, fields = _read(path)
    _check_crs(path, meta["crs"], shapes, crs)
    unit_m = map_units(crs).plan_m
    columns = {str(name).casefold(): values for name, values in zip(meta["fields"], fields, strict=True)}
    named = next((columns[name] for name in NAME_FIELDS if name in columns), None)
    errors, polygons = [], []
    for number, shape in enumerate(shapes.tolist(), 1):
        given = None if named is None else named[number - 1]
        name = str(number) if given is None or not str(given).strip() else str(given).strip()
        error = _error_in(shape)
        if error:
            errors.append(f"polygon {number} ({name}): {error}")
        else:
            plan = shapely.force_2d(shape)
            plan = plan if unit_m == 1.0 else shapely.transform(plan, lambda at: unit_m * at)
            polygons.append(SitePolygon(name, plan))
    if errors:
        more = f" (and {len(errors) - 3} more)" if len(errors) > 3 else ""
        raise ProjectError(f"polygons {path}: {'; '.join(errors[:3])}{more}")
    names = [polygon.name for polygon in polygons]
    if len(set(names)) < len(names):
        raise ProjectError(f"polygons {path}: two are called {max(names, key=names.count)!r}: rename one")
    return polygons


def _read(path: Path) -> tuple[dict[str, Any], Any, list[Any]]:
    """Return what a file says of its layer, its geometries (N,) and its fields."""
    try:
        check_size(path, MOST_BYTES)
        layers = [str(name) for name in pyogrio.list_layers(path)[:, 0]]
        if len(layers) != 1:
            raise ProjectError(
                f"polygons {path}: {len(layers)} layers ({', '.join(layers[:5])}), one is expected: export it by itself"
            )
        count = pyogrio.read_info(path)["features"]
        if not 0 <= count <= MOST_POLYGONS:
            raise ProjectError(f"polygons {path}: {count} polygons, up to {MOST_POLYGONS} are read: choose some")
        meta, _, geometry, fields = pyogrio.raw.read(path)
        shapes = shapely.from_wkb(np.zeros(0, object) if geometry is None else geometry)
    except ProjectError:
        raise
    except _DAMAGE as error:
        words = " ".join(str(error).split())[:200]
        raise ProjectError(f"polygons {path}: cannot be read ({words}): export them again as GeoPackage") from error
    if not len(shapes):
        raise ProjectError(f"polygons {path}: it contains no polygons: export it again")
    return meta, shapes, list(fields)


def _error_in(shape: Geometry) -> str:
    """Return what is wrong with a polygon, empty where nothing is."""
    if shape is None or shape.is_empty or shape.geom_type not in ("Polygon", "MultiPolygon"):
        kind = "empty" if shape is None or shape.is_empty else shape.geom_type
        return f"is {kind}, a polygon is expected"
    if not np.abs(shapely.get_coordinates(shape)).max() <= LARGEST_COORDINATE_M:
        return "a coordinate is damaged: export it again"
    return "" if shape.is_valid else f"{shapely.is_valid_reason(shape)}: repair its outline"


def _check_crs(path: Path, written: str | None, shapes: Any, crs: str) -> None:  # noqa: ANN401 - of shapely
    """Raise FrameError where polygons lie in another CRS than the map's."""
    in_degrees = written is None or written in (_WORLD, "EPSG:4326")
    corners = shapely.total_bounds(shapes)
    if crs == NO_CRS or (in_degrees and bool(np.nanmax(np.abs(corners)) > 360.0)):
        return
    remedy = f"reproject them (ogr2ogr -t_srs {plan_of(crs)} OUT.gpkg {path.name})"
    if in_degrees:
        raise FrameError(f"polygons {path}: they are in longitude and latitude, not in {plan_of(crs)}: {remedy}")
    try:
        same = same_plan(str(written), crs)
    except FrameError as error:
        raise FrameError(f"polygons {path}: {error}: {remedy}") from error
    if not same:
        raise FrameError(f"polygons {path}: their CRS {written} is not that of the surface, {plan_of(crs)}: {remedy}")
