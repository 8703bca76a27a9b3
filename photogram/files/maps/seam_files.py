"""The rim of an orthophoto and its seams as a GeoPackage, and seams that were edited in another program.

Two layers: ``outline``, the rim, and ``seams``, a polygon for each piece that is taken from one photograph, with the
photograph's name in the field ``photograph``. What is read needs the second alone.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError

from photogram.errors import ProjectError
from photogram.files.maps.contour_files import DATASET, geopackage
from photogram.geodesy.crs import crs_label, map_units, plan_of, same_plan, written_crs
from photogram.wording import shortened, some

OUTLINE, SEAMS, PHOTOGRAPH = "outline", "seams", "photograph"

LARGEST_OVERLAP = 1e-3
"""Share of the smaller of two polygons of different photographs by which they may overlap."""

Geometry = Any  # of shapely, which has no types


@dataclass(frozen=True, eq=False)
class NamedPolygon:
    """A polygon in the map that is taken from a photograph, by its name."""

    photograph: str
    polygon: Geometry


def write_seams(path: Path, rim: Geometry, seams: Sequence[NamedPolygon], crs: str) -> None:
    """Write a rim and its seams, in the plan of ``crs`` and its unit, as a GeoPackage; whole or not at all. Areas are
    in m² always.

    The same polygons give the same bytes. Raises FrameError where ``crs`` is no map grid, WorkspaceError
    where the file cannot be written.
    """
    written = None if written_crs(crs) is None else plan_of(crs)
    unit_m = map_units(crs).plan_m
    polygons = np.array([_scaled(seam.polygon, 1.0 / unit_m) for seam in seams], dtype=object)
    names = np.array([seam.photograph for seam in seams], dtype=object)
    area = np.array([seam.polygon.area for seam in seams])
    whole = _scaled(rim, 1.0 / unit_m)
    parts = np.array([whole if whole.geom_type == "MultiPolygon" else shapely.MultiPolygon([whole])], dtype=object)
    with geopackage(path) as file:
        pyogrio.raw.write(
            file,
            geometry=shapely.to_wkb(parts),
            field_data=[np.array([rim.area])],
            fields=["area_m2"],
            layer=OUTLINE,
            driver="GPKG",
            geometry_type="MultiPolygon",
            crs=written,
            dataset_options=DATASET,
            layer_options={"IDENTIFIER": "Rim of the orthophoto"},
        )
        pyogrio.raw.write(
            file,
            geometry=shapely.to_wkb(polygons),
            field_data=[names, area],
            fields=[PHOTOGRAPH, "area_m2"],
            layer=SEAMS,
            driver="GPKG",
            geometry_type="Polygon",
            crs=written,
            append=True,
            layer_options={"IDENTIFIER": "Seams", "DESCRIPTION": "the photograph that each part is taken from"},
        )


def read_rim(path: Path, crs: str) -> Geometry:
    """Return the rim that ``write_seams`` has written in ``crs``, in metres. Raises ProjectError where the file cannot
    be read."""
    try:
        shapes = pyogrio.raw.read(path, layer=OUTLINE)[2]
    except (DataSourceError, DataLayerError) as error:
        words = " ".join(str(error).split())
        raise ProjectError(f"rim {path}: cannot be read ({words}): delete it and run again") from error
    return _scaled(shapely.from_wkb(shapes[0]), map_units(crs).plan_m)


def read_seams(path: Path, names: Sequence[str], crs: str) -> list[NamedPolygon]:
    """Return the polygons of the layer ``seams`` of a file (GeoPackage, or whatever else GDAL reads), in its order.

    ``names`` are those of the photographs; a polygon may give a name with or without its suffix, in any case. Raises
    ProjectError where the file cannot be read, lies in another CRS than ``crs``, or a polygon is damaged, overlaps that
    of another photograph, or names none.
    """
    layer, written, geometry, photograph = _layer(path)
    expected = written_crs(crs)
    if expected is not None and written is not None and not same_plan(written, crs):
        raise ProjectError(
            f"seams {path}: their CRS is not that of the project, {crs_label(plan_of(crs))}: "
            f"reproject the layer (ogr2ogr -t_srs {crs_label(plan_of(crs))} OUT.gpkg {path.name})"
        )
    stems = Counter(_stem(name) for name in names)
    known = {name.casefold(): name for name in names} | {_stem(name): name for name in names if stems[_stem(name)] == 1}
    polygons, errors = [], []
    unit_m = map_units(crs).plan_m
    for number, (shape, name) in enumerate(zip(geometry.tolist(), photograph, strict=True), 1):
        where = f"polygon {number}"
        if shape is None or shape.geom_type not in ("Polygon", "MultiPolygon"):
            errors.append(f"{where} is {'empty' if shape is None else shape.geom_type}, a polygon is expected")
        elif not shape.is_valid:
            errors.append(f"{where} ({shortened(str(name))}): {shapely.is_valid_reason(shape)}: repair its outline")
        elif str(name or "").casefold() not in known:
            errors.append(
                f"{where}: {PHOTOGRAPH} {shortened(str(name))!r} is none of the project's: write the name of a file"
            )
        else:
            polygons.append(NamedPolygon(known[str(name).casefold()], _scaled(shapely.force_2d(shape), unit_m)))
    errors += _overlaps(polygons)
    if errors:
        more = f" (and {len(errors) - 3} more)" if len(errors) > 3 else ""
        raise ProjectError(f"seams {path}, layer {layer}: {'; '.join(errors[:3])}{more}")
    return polygons


def _scaled(shape: Geometry, factor: float) -> Geometry:
    """Return a geometry with its coordinates times a factor."""
    return shape if factor == 1.0 else shapely.transform(shape, lambda place: place * factor)


def _stem(name: str) -> str:
    return Path(name).stem.casefold()


def _layer(path: Path) -> tuple[str, str | None, Any, list[str | None]]:
    """Return the layer of the seams: its name, its CRS, its geometries and the names of the photographs."""
    try:
        layers = [str(name) for name in pyogrio.list_layers(path)[:, 0]]
        layer = SEAMS if SEAMS in layers else layers[0] if len(layers) == 1 else None
        if layer is None:
            raise ProjectError(
                f"seams {path}: no layer {SEAMS}, found {some(layers or ['none'])}: give the polygons that name"
            )
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=layer)
        shapes = None if geometry is None else shapely.from_wkb(geometry)
    except ProjectError:
        raise
    except (DataSourceError, DataLayerError, OSError, ValueError, shapely.errors.ShapelyError) as error:
        words = " ".join(str(error).split())[:200]
        raise ProjectError(f"seams {path}: cannot be read ({words}): export them again as GeoPackage") from error
    columns = [str(name) for name in meta["fields"]]
    if PHOTOGRAPH not in columns:
        raise ProjectError(
            f"seams {path}, layer {layer}: no field {PHOTOGRAPH}, found {some(columns or ['none'])}: "
            "write in it the photograph that each polygon is taken from"
        )
    if shapes is None or not len(shapes):
        raise ProjectError(f"seams {path}, layer {layer}: no polygons: remove the key, or export them again")
    return layer, meta["crs"], shapes, list(fields[columns.index(PHOTOGRAPH)])


def _overlaps(seams: Sequence[NamedPolygon]) -> list[str]:
    """Return where polygons of different photographs overlap."""
    tree = shapely.STRtree([seam.polygon for seam in seams])
    errors = []
    for i, seam in enumerate(seams):
        for j in sorted(int(k) for k in tree.query(seam.polygon, predicate="intersects") if k > i):
            if seams[j].photograph == seam.photograph:
                continue
            common = shapely.intersection(seam.polygon, seams[j].polygon)
            if common.area > LARGEST_OVERLAP * min(seam.polygon.area, seams[j].polygon.area):
                x, y = common.representative_point().coords[0]
                errors.append(
                    f"polygons of {seam.photograph} and {seams[j].photograph} overlap by {common.area:.3g} m² "
                    f"at {x:.2f}, {y:.2f}: cut one of them"
                )
    return errors
