"""GeoTIFF in and out: one band of float32, north up, square cells, in a map grid in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rasterio
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.transform import Affine

from photogram.errors import FrameError, ProjectError
from photogram.files.atomic import replacing
from photogram.frames import projected_crs, written_crs
from photogram.heights import flat_crs
from photogram.survey import Raster

NODATA = -9999.0
"""Stands for NaN in the files; other programs expect a number."""

_TILE = 256
# A drift of a thousandth of a cell over the whole raster is rounding, not rotation.
_TOLERANCE_CELLS = 1e-3


def _overview_factors(rows: int, columns: int) -> list[int]:
    factors = []
    factor = 2
    while max(rows, columns) > _TILE * factor // 2:
        factors.append(factor)
        factor *= 2
    return factors


def write_geotiff(path: Path, raster: Raster, crs: str, overviews: bool = True) -> None:
    """Write ``raster`` as a tiled, compressed GeoTIFF in ``crs``, NaN as NODATA, overviews averaged; all or nothing.

    The file names the height system where ``crs`` does.

    The same raster gives the same bytes. Raises FrameError where ``crs`` is no map grid in metres, WorkspaceError where
    the file cannot be written, ValueError where a cell holds NODATA as its value.
    """
    grid = flat_crs(written_crs(crs))
    if np.any(raster.values == NODATA):
        raise ValueError(f"{path}: {NODATA:g} stands for no data and cannot be a value")
    rows, columns = raster.values.shape
    values = np.where(np.isnan(raster.values), np.float32(NODATA), raster.values).astype(np.float32)
    with (
        replacing(path) as partial,
        rasterio.open(
            partial,
            "w",
            driver="GTiff",
            height=rows,
            width=columns,
            count=1,
            dtype="float32",
            crs=CRS.from_wkt(grid.to_wkt()),
            transform=Affine(raster.cell_m, 0.0, raster.west_map_m, 0.0, -raster.cell_m, raster.north_map_m),
            nodata=NODATA,
            tiled=True,
            blockxsize=_TILE,
            blockysize=_TILE,
            compress="deflate",
            predictor=3,
            bigtiff="if_safer",
        ) as dataset,
    ):
        dataset.write(values, 1)
        if overviews and (factors := _overview_factors(rows, columns)):
            dataset.build_overviews(factors, Resampling.average)


def _cell_size(path: Path, transform: Affine, rows: int, columns: int) -> float:
    """Return the cell's side in m. Raises FrameError unless cells are square, rows go south and columns east."""
    slack = _TOLERANCE_CELLS * abs(transform.a) / max(rows, columns)
    if abs(transform.b) > slack or abs(transform.d) > slack or transform.a <= 0 or transform.e >= 0:
        raise FrameError(
            f"raster {path}: its affine {tuple(transform)[:6]} is rotated, mirrored or missing, north up is expected: "
            "warp it first (gdalwarp -t_srs CRS)"
        )
    if abs(transform.a + transform.e) > slack:
        raise FrameError(
            f"raster {path}: cells of {transform.a:g} × {-transform.e:g} m, square cells are expected: "
            "resample it first (gdalwarp -tr CELL CELL)"
        )
    return float(transform.a)


def read_raster(path: Path) -> tuple[Raster, str]:
    """Return the raster, NaN where it has no data, and its CRS as EPSG:… or, where it has no such number, as WKT.

    Raises ProjectError where the file is missing, damaged or has several bands; FrameError where its cells are rotated
    or not square, or its CRS is missing or no map grid in metres.
    """
    if not path.is_file():
        raise ProjectError(f"raster {path}: there is no such file: check its path")
    try:
        with rasterio.open(path) as dataset:
            if dataset.count != 1:
                raise ProjectError(
                    f"raster {path}: {dataset.count} bands, one is expected: extract it (gdal_translate -b 1 IN OUT)"
                )
            transform, crs = dataset.transform, dataset.crs
            band = dataset.read(1, masked=True)
            scale, offset = dataset.scales[0], dataset.offsets[0]
    except RasterioError as fault:
        raise ProjectError(f"raster {path}: cannot be read ({fault}): export it again as GeoTIFF") from fault
    values = np.ma.filled(band.astype(np.float64) * scale + offset, np.nan).astype(np.float32)
    cell_m = _cell_size(path, transform, *values.shape)
    if not crs:
        raise FrameError(f"raster {path}: it has no CRS: add it (gdal_edit.py -a_srs EPSG:… FILE)")
    epsg = crs.to_epsg()
    # the first edition of WKT knows no third axis of a map grid
    name = f"EPSG:{epsg}" if epsg is not None else str(crs.to_wkt(version="WKT2_2019"))
    try:
        projected_crs(name)
    except FrameError as fault:
        raise FrameError(f"raster {path}: {fault}") from fault
    return Raster(values, float(transform.c), float(transform.f), cell_m), name
