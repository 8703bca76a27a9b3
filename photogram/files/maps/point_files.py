"""Ground points as a GeoPackage, for a GIS."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyogrio
import shapely

from photogram.arrays import FloatArray
from photogram.files.maps.contour_files import DATASET, geopackage
from photogram.geodesy.crs import map_units, plan_of, written_crs

GROUND_POINTS = "ground_points"


def write_ground_points(
    path: Path, names: Sequence[str], roles: Sequence[str], position_map_m: FloatArray, crs: str
) -> None:
    """Write points (N, 3), in m, with the fields ``name``, ``role`` and ``height_m`` as the layer ``ground_points`` of
    a GeoPackage; whole or not at all. Where ``crs`` counts feet, so do places and the field ``height_ft`` or
    ``height_ftUS``. The same points give the same bytes.

    Raises FrameError where ``crs`` is no map grid, WorkspaceError where the file cannot be written.
    """
    units, written = map_units(crs), written_crs(crs)
    place = units.from_metres(position_map_m)
    with geopackage(path) as file:
        pyogrio.raw.write(
            file,
            geometry=shapely.to_wkb(shapely.points(place)),
            field_data=[np.array(names, dtype=object), np.array(roles, dtype=object), place[:, 2].copy()],
            fields=["name", "role", f"height_{units.height_symbol}"],
            layer=GROUND_POINTS,
            driver="GPKG",
            geometry_type="Point Z",
            crs=None if written is None else plan_of(crs),
            dataset_options=DATASET,
            layer_options={"IDENTIFIER": "Control points and check points"},
        )
