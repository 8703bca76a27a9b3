"""Cloud Optimized GeoTIFFs, written tile by tile: heights and sigmas as float32, orthophotos as RGBA, codes as bytes.

The cells go into an uncompressed GeoTIFF beside the file first, in whatever order they come; GDAL's COG driver copies
it (OGC 21-026, Cloud Optimized GeoTIFF): so memory does not grow with the raster, and the file depends on the values
alone.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import rasterio
import rasterio.shutil
import rasterio.windows
from numpy.typing import NDArray
from rasterio._err import CPLE_BaseError
from rasterio.crs import CRS
from rasterio.transform import Affine

from photogram.arrays import ByteArray, Float32Array
from photogram.files.atomic import replacing, scratch_folder
from photogram.files.maps.geo_keys import set_vertical_key
from photogram.geodesy.crs import MapUnits, map_units, written_crs
from photogram.geodesy.height_systems import auxiliary_wkt, gdal_wkt, geotiff_crs
from photogram.grid import MapGrid, Window

NODATA = -9999.0
"""Stands for NaN in the files; other programs expect a number."""

NO_CODE = 255
"""Stands for no data in rasters of codes."""

BLOCK_CELLS = 256
"""Side of the blocks in which a file is compressed and read."""

CATEGORY_SUFFIX = ".aux.xml"
"""Of the file beside a raster of codes with the names of its categories, as GDAL and QGIS look for it."""

# compressing the overviews on their way to the file takes longer than everything else
_ENVIRONMENT = {"GDAL_CACHEMAX": 64, "COG_TMP_COMPRESSION": "NONE"}
# more effort takes twice the time and saves 2 % of a photograph, 1 % of heights
_DEFLATE = {"compress": "deflate", "level": "1"}
_PICTURE = {**_DEFLATE, "predictor": "standard", "overview_resampling": "average"}
_PLACE = {"driver": "GTiff", "tiled": True, "blockxsize": BLOCK_CELLS, "blockysize": BLOCK_CELLS, "sparse_ok": True}


@dataclass(frozen=True)
class Category:
    """What a code means, and the colour, red, green and blue, in which it is shown."""

    code: int
    name: str
    colour: tuple[int, int, int]


@dataclass(frozen=True)
class _Band:
    """What a file says of its bands: their descriptions and unit, the colours of codes, and a note on the whole."""

    descriptions: tuple[str, ...] = ()
    unit: str = ""
    colours: Mapping[int, tuple[int, int, int, int]] | None = None
    note: str = ""


def write_cog(
    path: Path,
    grid: MapGrid,
    crs: str,
    tiles: Iterable[tuple[Window, Float32Array]],
    overviews: bool = True,
    description: str = "",
    note: str = "",
) -> None:
    """Write lengths in m as a Cloud Optimized GeoTIFF of float32 in ``crs``, NaN as NODATA; all or nothing. The file
    holds grid and lengths in the units of ``crs``, and says so.

    ``tiles`` are windows of the grid with their values (rows, columns), in any order and of any size; cells in none of
    them have no data. An overview holds the mean of the cells that have data. Compressed without loss. The file names
    the height system where ``crs`` does, what the band holds in its ``description``, and a ``note`` on the whole as its
    image description.

    The same values give the same bytes. Raises FrameError where ``crs`` is no map grid, WorkspaceError where
    the file cannot be written, ValueError where a tile does not fit its window or the grid, or a cell holds NODATA as
    its value.
    """

    def bands(window: Window, values: Float32Array) -> Float32Array:
        _check_tile(path, grid, window, values.shape)
        if np.any(values == NODATA):
            raise ValueError(f"{path}: {NODATA:g} stands for no data and cannot be a value")
        own = values if units.height_m == 1.0 else (values.astype(np.float64) / units.height_m).astype(np.float32)
        return np.where(np.isnan(own), np.float32(NODATA), own).astype(np.float32)[None]

    units = map_units(crs)

    kind = {"count": 1, "dtype": "float32", "nodata": NODATA}
    look = {**_DEFLATE, "predictor": "floating_point", "overview_resampling": "average"}
    band = _Band((description,), _unit_name(units), note=note)
    _write(path, grid, crs, kind, look, ((w, bands(w, v)) for w, v in tiles), band, overviews=overviews)


def write_cog_codes(
    path: Path,
    grid: MapGrid,
    crs: str,
    tiles: Iterable[tuple[Window, ByteArray]],
    categories: Sequence[Category] = (),
    note: str = "",
) -> None:
    """Write codes or counts, NO_CODE standing for no data, as a Cloud Optimized GeoTIFF of uint8; all or nothing.

    As ``write_cog``; an overview holds the code that most of its cells have. ``categories`` become the palette and the
    description of the band; their names, for which a GeoTIFF has no place, stand in a file with CATEGORY_SUFFIX too.
    """

    def bands(window: Window, values: ByteArray) -> ByteArray:
        _check_tile(path, grid, window, values.shape)
        return _bytes(path, values)[None]

    kind = {"count": 1, "dtype": "uint8", "nodata": NO_CODE}
    look = {**_DEFLATE, "overview_resampling": "mode"}
    band = _Band(note=note)
    if categories:
        colours = dict.fromkeys(range(NO_CODE + 1), (0, 0, 0, 0)) | {c.code: (*c.colour, 255) for c in categories}
        band = _Band((", ".join(f"{c.code} {c.name}" for c in categories),), colours=colours, note=note)
    _write(path, grid, crs, kind, look, ((w, bands(w, v)) for w, v in tiles), band, categories=categories)


def _unit_name(units: MapUnits) -> str:
    """Return the unit of heights as GDAL and QGIS know it."""
    return {"metre": "m", "foot": "ft"}.get(units.height, units.height)


def _write_auxiliary(path: Path, wkt: str | None, categories: Sequence[Category]) -> None:
    """Write what a GeoTIFF has no place for as GDAL's persistent auxiliary metadata: the CRS as WKT, where its keys
    cannot hold it whole, and the names of codes. Without either there is no such file."""
    if wkt is None and not categories:
        return
    dataset = ElementTree.Element("PAMDataset")
    if wkt is not None:
        ElementTree.SubElement(dataset, "SRS", dataAxisToSRSAxisMapping="1,2").text = wkt
    if categories:
        _add_category_names(dataset, categories)
    ElementTree.indent(dataset)
    with replacing(path) as partial:
        partial.write_text(ElementTree.tostring(dataset, encoding="unicode") + "\n", encoding="utf-8")


def _add_category_names(dataset: ElementTree.Element, categories: Sequence[Category]) -> None:
    names = {c.code: c.name for c in categories}
    listed = ElementTree.SubElement(ElementTree.SubElement(dataset, "PAMRasterBand", band="1"), "CategoryNames")
    for code in range(max(names) + 1):
        ElementTree.SubElement(listed, "Category").text = names.get(code, "")


def write_cog_rgba(
    path: Path,
    grid: MapGrid,
    crs: str,
    tiles: Iterable[tuple[Window, ByteArray]],
    note: str = "",
) -> None:
    """Write a picture in ``crs`` as a Cloud Optimized GeoTIFF; all or nothing.

    ``tiles`` are windows of the grid with red, green, blue and alpha (rows, columns, 4), in any order and of any size;
    cells in none of them are transparent. Overviews hold means of the cells that are not transparent. The file has an
    alpha band and loses nothing (DEFLATE with predictor 2), which every reader of GeoTIFF opens.

    The same values give the same bytes. Raises FrameError where ``crs`` is no map grid, WorkspaceError where
    the file cannot be written, ValueError where a tile does not fit its window or the grid.
    """
    kind = {"count": 4, "dtype": "uint8", "photometric": "rgb", "alpha": "non-premultiplied", "interleave": "pixel"}
    band = _Band(("red", "green", "blue", "alpha"), note=note)
    _write(path, grid, crs, kind, _PICTURE, _by_band(path, grid, tiles, 4), band)


def write_cog_bands(
    path: Path,
    grid: MapGrid,
    crs: str,
    names: Sequence[str],
    tiles: Iterable[tuple[Window, ByteArray]],
    note: str = "",
) -> None:
    """Write bands of bytes with these names, red, green and blue the first three, in ``crs`` as a Cloud Optimized
    GeoTIFF; all or nothing. 0 stands for no data.

    ``tiles`` are windows of the grid with their values (rows, columns, bands), in any order and of any size; cells in
    none of them have no data. Raises as ``write_cog_rgba`` does.
    """

    kind = {"count": len(names), "dtype": "uint8", "nodata": 0, "photometric": "rgb", "interleave": "pixel"}
    band = _Band(tuple(names), note=note)
    _write(path, grid, crs, kind, _PICTURE, _by_band(path, grid, tiles, len(names)), band)


def _by_band(
    path: Path, grid: MapGrid, tiles: Iterable[tuple[Window, ByteArray]], bands: int
) -> Iterator[tuple[Window, ByteArray]]:
    """Yield windows with their values (bands, rows, columns) in place of (rows, columns, bands)."""
    for window, values in tiles:
        _check_tile(path, grid, window, values.shape, (bands,))
        yield window, np.ascontiguousarray(np.moveaxis(_bytes(path, values), 2, 0))


def _check_tile(path: Path, grid: MapGrid, window: Window, shape: tuple[int, ...], bands: tuple[int, ...] = ()) -> None:
    if shape != (*window.shape, *bands):
        raise ValueError(f"{path}: values of shape {shape} do not fit {window}")
    if window.row < 0 or window.column < 0 or window.row_end > grid.rows or window.column_end > grid.columns:
        raise ValueError(f"{path}: {window} reaches over the grid of {grid.rows} × {grid.columns} cells")


def _bytes(path: Path, values: ByteArray) -> ByteArray:
    if values.dtype != np.uint8:
        raise ValueError(f"{path}: values of type {values.dtype}, expected uint8")
    return values


def _write(
    path: Path,
    grid: MapGrid,
    crs: str,
    kind: Mapping[str, Any],
    look: Mapping[str, Any],
    tiles: Iterable[tuple[Window, NDArray[Any]]],
    band: _Band,
    *,
    categories: Sequence[Category] = (),
    overviews: bool = True,
) -> None:
    """Write bands (bands, rows, columns) of windows to a GeoTIFF of a ``kind`` and copy it to a COG of a ``look``; what
    its keys cannot hold stands in a file beside it."""
    named, unit_m = written_crs(crs), map_units(crs).plan_m
    written, vertical_code = (None, None) if named is None else geotiff_crs(named)
    auxiliary = None if named is None else auxiliary_wkt(named)
    place = {
        "height": grid.rows,
        "width": grid.columns,
        "crs": None if written is None or auxiliary_wkt(written) else CRS.from_wkt(gdal_wkt(written)),
        "transform": Affine(
            grid.cell_m / unit_m, 0.0, grid.west_map_m / unit_m, 0.0, -grid.cell_m / unit_m, grid.north_map_m / unit_m
        ),
        "bigtiff": "if_safer",
    }
    options = {
        **look,
        "driver": "COG",
        "blocksize": BLOCK_CELLS,
        "bigtiff": "if_safer",
        "overviews": "auto" if overviews else "none",
        "num_threads": "all_cpus",
    }
    with replacing(path) as partial, scratch_folder(partial) as folder, rasterio.Env(**_ENVIRONMENT):
        cells, finished = folder / "cells.tif", folder / "finished.tif"
        with rasterio.open(cells, "w", **_PLACE, **place, **kind) as dataset:
            for number, text in enumerate(band.descriptions, 1):
                dataset.set_band_description(number, text)
            if band.unit:
                dataset.units = [band.unit] * dataset.count
            if band.note:
                dataset.update_tags(TIFFTAG_IMAGEDESCRIPTION=band.note)
            if band.colours is not None:
                dataset.write_colormap(1, band.colours)
            for window, bands in tiles:
                rows, columns = window.shape
                dataset.write(bands, window=rasterio.windows.Window(window.column, window.row, columns, rows))
        _copy(cells, finished, options)
        if vertical_code is not None:
            set_vertical_key(finished, vertical_code)
        finished.replace(partial)
    _write_auxiliary(path.with_name(path.name + CATEGORY_SUFFIX), auxiliary, categories)


def _copy(cells: Path, finished: Path, options: Mapping[str, Any]) -> None:
    """Copy a GeoTIFF to a COG and read it back. Raises OSError where that failed.

    GDAL does not say of every block that it could not write it, on a full disk for example.
    """
    try:
        rasterio.shutil.copy(cells, finished, **options)
        with rasterio.open(cells) as source, rasterio.open(finished) as copy:
            for row in range(0, copy.height, BLOCK_CELLS):
                strip = rasterio.windows.Window(0, row, copy.width, min(BLOCK_CELLS, copy.height - row))
                if not np.array_equal(copy.read(window=strip), source.read(window=strip)):
                    raise OSError(f"rows from {row} differ from what was written")
    except CPLE_BaseError as error:
        raise OSError(str(error)) from error
