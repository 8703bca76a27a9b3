"""Shapes as Shapefiles in one zip: what every GIS and most programs of construction open.

The format (ESRI 1998) has names of fields up to 10 characters, no text beyond 254 bytes and no unit.
"""

import shutil
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from pyogrio.errors import DataLayerError, DataSourceError

from photogram.files.atomic import replacing, scratch_folder
from photogram.geodesy.crs import NO_CRS, esri_wkt

# The same shapes are to give the same bytes.
_NO_DATE, _NO_TIME = "2000-01-01", (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, eq=False)
class ShapeLayer:
    """A Shapefile: shapes of one kind, in the units of the map, and a value of each field for each."""

    name: str
    kind: str
    shapes: Any
    fields: Mapping[str, NDArray[np.generic]]


def write_shapefile_zip(path: Path, layers: Sequence[ShapeLayer], crs: str) -> None:
    """Write layers as a zip of Shapefiles in the plan of a CRS, whole or not at all. The same layers give the same
    bytes. Raises WorkspaceError where the file cannot be written."""
    with replacing(path) as partial, scratch_folder(partial) as folder:
        for layer in layers:
            _write(folder, layer, crs)
        with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(folder.iterdir()):
                entry = zipfile.ZipInfo(file.name, _NO_TIME)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.file_size = file.stat().st_size
                with file.open("rb") as source, archive.open(entry, "w") as target:
                    shutil.copyfileobj(source, target)


def _write(folder: Path, layer: ShapeLayer, crs: str) -> None:
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
