"""GeoPackages, written whole, and contour lines as one, which is read back."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError

from photogram.errors import ProjectError
from photogram.files.atomic import replacing, scratch_folder
from photogram.geodesy.crs import map_units, plan_of, written_crs
from photogram.survey import Contours

LAYER = "contours"

DATASET = {"VERSION": "1.3"}
"""Options of a GeoPackage: programs of a few years ago complain of later versions."""

# GeoPackage stores when a layer was changed; the same lines are to give the same bytes.
_NO_TIME = "2000-01-01T00:00:00.000Z"


@contextmanager
def geopackage(path: Path) -> Iterator[Path]:
    """Give a file for the layers of a GeoPackage; it takes the place of ``path`` whole or not at all, and the same
    layers give the same bytes. Raises WorkspaceError where it cannot be written."""
    before = pyogrio.get_gdal_config_option("OGR_CURRENT_DATE")
    with replacing(path) as partial, scratch_folder(partial) as folder, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'crs' was not provided", UserWarning)  # of a local frame on purpose
        pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": _NO_TIME})
        file = folder / "layers.gpkg"
        try:
            yield file
        except (DataSourceError, DataLayerError) as error:
            raise OSError(str(error)) from error
        finally:
            pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": before})
        file.replace(partial)


def write_contours(path: Path, contours: Contours, crs: str) -> None:
    """Write lines in the plan of ``crs`` as a GeoPackage with the layer ``contours``; whole or not at all.

    Vertices carry the height as z. Fields: ``height_m`` and ``index``, true for every fifth line. The layer's
    description says what the heights are counted from where ``crs`` does. Where ``crs`` counts feet, so do vertices and
    the field ``height_ft`` or ``height_ftUS``. The same lines give the same bytes.

    Raises FrameError where ``crs`` is no map grid, WorkspaceError where the file cannot be written.
    """
    plan, written = plan_of(crs), written_crs(crs)
    named = "local frame" if written is None else written.name
    of_line = np.repeat(np.arange(len(contours)), np.diff(contours.first))
    units = map_units(crs)
    height = contours.height_m / units.height_m
    vertices = np.column_stack([contours.vertex_map_m / units.plan_m, height[of_line]])
    lines = shapely.linestrings(vertices, indices=of_line) if len(contours) else np.zeros(0, dtype=object)
    with geopackage(path) as file:
        pyogrio.raw.write(
            file,
            geometry=shapely.to_wkb(lines),
            field_data=[height, contours.is_index],
            fields=[f"height_{units.height_symbol}", "index"],
            layer=LAYER,
            driver="GPKG",
            geometry_type="LineString Z",
            crs=None if written is None else plan,
            dataset_options=DATASET,
            layer_options={
                "IDENTIFIER": "Contour lines",
                "DESCRIPTION": f"interval {contours.interval_m / units.height_m:g} {units.height_symbol}, {named}",
            },
        )


def read_contours(path: Path, crs: str, interval_m: float, cell_m: float) -> Contours:
    """Return the lines that ``write_contours`` has written in ``crs``, in metres, with the interval and the cells that
    they were traced with. Raises ProjectError where the file cannot be read."""
    units = map_units(crs)
    try:
        _, _, shapes, (height, _) = pyogrio.raw.read(path, layer=LAYER)
    except (DataSourceError, DataLayerError) as error:
        words = " ".join(str(error).split())
        raise ProjectError(f"contours {path}: cannot be read ({words}): delete it and run again") from error
    lines = shapely.from_wkb(shapes)
    first = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(lines))]).astype(np.int64)
    return Contours(height * units.height_m, shapely.get_coordinates(lines) * units.plan_m, first, interval_m, cell_m)
