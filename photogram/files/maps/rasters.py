"""GeoTIFF in and out: one band of float32, north up, square cells, in a map grid; in metres once it is read."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio.windows
from rasterio._err import CPLE_BaseError
from rasterio.crs import CRS
from rasterio.enums import MaskFlags, Resampling
from rasterio.errors import RasterioError
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT

from photogram.arrays import BoolArray, ByteArray, Float32Array
from photogram.errors import FrameError, PhotogramError, ProjectError
from photogram.files.maps.cogs import write_cog
from photogram.files.reading import regular_file_size
from photogram.files.tables.column_units import unit_m
from photogram.geodesy.crs import METRES, NO_CRS, MapUnits, map_units
from photogram.grid import MapGrid, Window
from photogram.survey import Raster
from photogram.wording import shortened

# A drift of a thousandth of a cell over the whole raster is rounding, not rotation.
_TOLERANCE_CELLS = 1e-3
MOST_CELLS = 1_000_000_000
LARGEST_RATIO = 5000
LARGEST_COORDINATE_M = 1e9

LOWEST_M, HIGHEST_M = -1000.0, 9000.0
"""Heights beyond which no ground lies on land: what stands there stands for no data."""
FAR_M = 10.0
"""By how much zeros at the rim lie away from all other heights that stand for no data."""
RIM_SHARE = 0.05
"""Of the cells at the rim, that are zeros then."""
_LOOKED_AT = 1024

DAMAGE = (RasterioError, CPLE_BaseError, OSError, ValueError, TypeError, LookupError, ArithmeticError, MemoryError)
"""What rasterio raises where a file is damaged."""


def write_raster(
    path: Path | str, raster: Raster, crs: str, overviews: bool = True, description: str = "", note: str = ""
) -> None:
    """Write ``raster`` in ``crs`` as a Cloud Optimized GeoTIFF, NaN as NODATA; all or nothing: ``cogs.write_cog`` of a
    raster in memory.

    Raises FrameError where ``crs`` is no map grid, WorkspaceError where the file cannot be written,
    ValueError where a cell holds NODATA as its value.
    """
    grid = MapGrid.of(raster)
    write_cog(Path(path), grid, crs, [(grid.whole, raster.values)], overviews, description, note)


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


def read_raster(path: Path | str, *, local: bool = False) -> tuple[Raster, str]:
    """Return the raster of a GeoTIFF of one band, NaN where it has no data, and its CRS as EPSG:… or, where it has no
    such number, as WKT; NO_CRS where a raster in a ``local`` frame has none. Grid and heights of a CRS in feet come
    back in metres.

    Raises ProjectError where the file is missing, damaged or has several bands; FrameError where its cells are rotated
    or not square, or its CRS is missing or no map grid.
    """
    path = Path(path)
    with _opened(path) as dataset:
        band = dataset.read(1, masked=True)
        file = _described(path, dataset, local)
    values = file.heights(band)
    return Raster(values, file.grid.west_map_m, file.grid.north_map_m, file.grid.cell_m), file.crs


@dataclass(frozen=True)
class RasterFile:
    """A GeoTIFF of one band of which windows are read."""

    path: Path
    grid: MapGrid
    """Its cells."""
    crs: str
    """EPSG:…, WKT or NO_CRS."""
    scale: float = 1.0
    """What its numbers are multiplied by to be metres."""
    offset: float = 0.0
    """What is added then."""
    declares_none: bool = True
    """Whether the file declares what stands for no data."""
    zeros_are_none: bool = False
    """Whether zeros stand for no data, which the file does not declare."""
    holds_impossible: bool = False
    """Whether values beyond all ground stand for no data, which the file does not declare."""

    def heights(self, band: np.ma.MaskedArray[Any, Any]) -> Float32Array:
        """Return the heights of cells of the file, m, NaN where they have none: masked, infinite, and where the file
        declares nothing beyond all ground, or zeros that stand for it."""
        values = _scaled(band, self.scale, self.offset)
        if not self.declares_none:
            values[_impossible(values)] = np.nan
        if self.zeros_are_none:
            values[np.asarray(band.data) == 0] = np.nan
        return values

    def read(self, window: Window) -> Float32Array:
        """Return the values (rows, columns) of a window, which may reach beyond the grid: NaN there and where there is
        no data. Raises ProjectError where the file is damaged."""
        values = np.full(window.shape, np.nan, dtype=np.float32)
        inner = self.grid.common(window)
        if inner is not None:
            rows, columns = inner.shape
            with _opened(self.path) as dataset:
                at = rasterio.windows.Window(inner.column, inner.row, columns, rows)
                band = dataset.read(1, window=at, masked=True)
            values[inner.within(window)] = self.heights(band)
        return values


def open_raster(path: Path | str, *, local: bool = False, assumed_crs: str | None = None) -> RasterFile:
    """Return a GeoTIFF of one band of which windows are read; one that names no CRS is taken in ``assumed_crs``, and in
    its units, if there is one. Raises as ``read_raster``, of its cells nothing."""
    path = Path(path)
    with _opened(path) as dataset:
        return _described(path, dataset, local, assumed_crs)


@contextmanager
def _opened(path: Path) -> Iterator[rasterio.DatasetReader]:
    """Give a GeoTIFF of one band, no larger than its file can hold. Raises ProjectError where it is missing or damaged,
    and for what the block raises of such a file."""
    if not isfile(path):
        raise ProjectError(f"raster {path}: file not found: check its path")
    try:
        size = regular_file_size(path)
        with rasterio.open(path, driver="GTiff") as dataset:
            _check_size(path, dataset, size)
            if dataset.count != 1:
                raise ProjectError(
                    f"raster {path}: {dataset.count} bands, one is expected: extract it (gdal_translate -b 1 IN OUT)"
                )
            yield dataset
    except PhotogramError:
        raise
    except DAMAGE as error:
        words = " ".join(str(error).split())
        raise ProjectError(f"raster {path}: cannot be read ({words}): export it again as GeoTIFF") from error


def _described(path: Path, dataset: rasterio.DatasetReader, local: bool, assumed_crs: str | None = None) -> RasterFile:
    """Return the grid and the CRS of an open file. Raises FrameError as ``read_raster``."""
    transform, crs, scale, offset = dataset.transform, dataset.crs, dataset.scales[0], dataset.offsets[0]
    if not np.isfinite([*transform[:6], scale, offset]).all() or np.abs(transform[:6]).max() > LARGEST_COORDINATE_M:
        raise FrameError(f"raster {path}: its affine {tuple(transform)[:6]} is damaged: export it again as GeoTIFF")
    cell = _cell_size(path, transform, dataset.height, dataset.width)
    name, units = _crs_name(path, crs, local) if crs or assumed_crs is None else (assumed_crs, map_units(assumed_crs))
    west, north = float(transform.c * units.plan_m), float(transform.f * units.plan_m)
    grid = MapGrid(west, north, cell * units.plan_m, dataset.height, dataset.width)
    unit = _height_unit_m(path, dataset.units[0], units)
    file = RasterFile(path, grid, name, float(scale) * unit, float(offset) * unit)
    if dataset.nodata is not None or MaskFlags.all_valid not in dataset.mask_flag_enums[0]:
        return file
    return _looked_through(dataset, replace(file, declares_none=False))


def _height_unit_m(path: Path, stated: str | None, units: MapUnits) -> float:
    """Return the unit of a band's heights in metres: the one that it states itself, else that of the CRS. Raises
    FrameError where it states another."""
    if not stated or stated.lower() in ("unknown", "none"):
        return units.height_m
    own = unit_m(stated)
    if own is None:
        raise FrameError(
            f"raster {path}: its band is in {shortened(stated)!r}, which is no unit of length: write it in metres, or "
            "correct its unit (gdal_edit.py -units m FILE)"
        )
    return own


def _impossible(heights_m: Float32Array) -> BoolArray:
    with np.errstate(invalid="ignore"):
        return np.asarray((heights_m < LOWEST_M) | (heights_m > HIGHEST_M))


def _looked_through(dataset: rasterio.DatasetReader, file: RasterFile) -> RasterFile:
    """Return a file that declares nothing for no data with what stands for it: heights that no ground has, and zeros
    that fill a part of the rim while all other heights lie far off."""
    step = max(1, int(np.ceil(max(dataset.height, dataset.width) / _LOOKED_AT)))
    shape = int(np.ceil(dataset.height / step)), int(np.ceil(dataset.width / step))
    band = dataset.read(1, out_shape=shape, masked=True)
    impossible = bool(_impossible(_scaled(band, file.scale, file.offset)).any())
    zero, heights = np.asarray(band.data) == 0, file.heights(band)
    rim = np.concatenate([zero[0], zero[-1], zero[:, 0], zero[:, -1]])
    others = heights[~zero & np.isfinite(heights)]
    zeros = bool(rim.mean() > RIM_SHARE and len(others) and np.abs(others - file.offset).min() > FAR_M)
    return replace(file, zeros_are_none=zeros, holds_impossible=impossible)


def _crs_name(path: Path, crs: CRS | None, local: bool) -> tuple[str, MapUnits]:
    """Return a CRS as EPSG:… or WKT, NO_CRS of a ``local`` raster without, and its units. Raises FrameError where it is
    none or no map grid."""
    if not crs and local:
        return NO_CRS, METRES
    if not crs:
        raise FrameError(f"raster {path}: no CRS: add it (gdal_edit.py -a_srs EPSG:… FILE)")
    epsg = crs.to_epsg()
    # the first edition of WKT knows no third axis of a map grid
    name = f"EPSG:{epsg}" if epsg is not None else str(crs.to_wkt(version="WKT2_2019"))
    try:
        units = map_units(name)
    except FrameError as error:
        raise FrameError(f"raster {path}: {error}") from error
    return name, units


def _scaled(band: np.ma.MaskedArray[Any, Any], scale: float, offset: float) -> Float32Array:
    """Return the values of a band, NaN where it has no data or, as many programs write such a cell, infinity; those of
    floats that nothing scales are taken as they are."""
    if band.dtype == np.float32 and scale == 1.0 and offset == 0.0:
        values = np.asarray(band.filled(np.nan))
    else:
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.asarray(np.ma.filled(band.astype(np.float64) * scale + offset, np.nan).astype(np.float32))
    values[np.isinf(values)] = np.nan
    return values


def _check_size(path: Path, dataset: rasterio.DatasetReader, size: int) -> None:
    """Raise ProjectError where a raster claims more cells than its file of ``size`` bytes can hold, or are read here.

    No compression in use makes more than LARGEST_RATIO bytes of one; memory for the cells is found before any is read.
    """
    cells = dataset.width * dataset.height
    what = f"raster {path}: {dataset.width} × {dataset.height} cells"
    if cells > MOST_CELLS:
        raise ProjectError(
            f"{what}, up to {MOST_CELLS:.0e} are read: cut out the site (gdalwarp -te XMIN YMIN XMAX YMAX)"
        )
    if cells * np.dtype(dataset.dtypes[0]).itemsize > LARGEST_RATIO * size:
        raise ProjectError(
            f"{what} do not fit into a file of {size} bytes, it is damaged or sparse: write it again (gdal_translate)"
        )


def value_range(path: Path, low: float, high: float) -> tuple[float, float]:
    """Return the quantiles ``low`` and ``high`` of a raster's numbers as its file has them, of a thousand cells along a
    side at most; 0 and 0 where no cell has any. Raises ProjectError where it cannot be read."""
    with _opened(path) as dataset:
        step = max(1, int(np.ceil(max(dataset.height, dataset.width) / _LOOKED_AT)))
        shape = int(np.ceil(dataset.height / step)), int(np.ceil(dataset.width / step))
        numbers = dataset.read(1, out_shape=shape, masked=True).compressed()
    numbers = numbers[np.isfinite(numbers)]
    if not len(numbers):
        return 0.0, 0.0
    least, greatest = np.quantile(numbers.astype(np.float64), [low, high]).tolist()
    return least, greatest


def read_codes(path: Path, window: Window) -> ByteArray:
    """Return the codes (rows, columns) of a window of a file's cells. Raises ProjectError where it cannot be read."""
    rows, columns = window.shape
    try:
        with rasterio.open(path) as dataset:
            codes = dataset.read(1, window=rasterio.windows.Window(window.column, window.row, columns, rows))
    except RasterioError as error:
        raise ProjectError(f"raster {path}: cannot be read ({error}): delete it and run again") from error
    return np.asarray(codes, dtype=np.uint8)


def _plan_unit_m(dataset: rasterio.DatasetReader) -> float:
    return map_units(str(dataset.crs.to_wkt(version="WKT2_2019"))).plan_m if dataset.crs else 1.0


def pixel_m(path: Path) -> float:
    """Return the side of the pixels of a picture in a map grid, m. Raises ProjectError where it cannot be read."""
    try:
        with rasterio.open(path, driver="GTiff") as dataset:
            return float(dataset.res[0] * _plan_unit_m(dataset))
    except RasterioError as error:
        raise ProjectError(f"picture {path}: cannot be read ({error}): delete it and run again") from error


def picture_on_grid(path: Path, grid: MapGrid, window: Window) -> ByteArray:
    """Return what a picture file shows in a window of a grid of its own CRS, in m: red, green, blue and alpha (rows,
    columns, 4), means over the cells, 0 beyond the picture. Cells of many pixels are means of its overviews' pixels.
    Raises ProjectError where it cannot be read."""
    west, north = grid.west_map_m + window.column * grid.cell_m, grid.north_map_m - window.row * grid.cell_m
    rows, columns = window.shape
    try:
        with rasterio.open(path, driver="GTiff") as whole:
            unit_m = _plan_unit_m(whole)
            fine = [
                n for n, factor in enumerate(whole.overviews(1)) if 2 * factor * whole.res[0] <= grid.cell_m / unit_m
            ]
        with rasterio.open(path, driver="GTiff", **({"overview_level": fine[-1]} if fine else {})) as dataset:
            cell, west, north = (length / unit_m for length in (grid.cell_m, west, north))
            with WarpedVRT(
                dataset,
                crs=dataset.crs,
                transform=Affine(cell, 0.0, west, 0.0, -cell, north),
                width=columns,
                height=rows,
                resampling=Resampling.average,
            ) as view:
                bands = view.read([1, 2, 3, 4])
    except RasterioError as error:
        raise ProjectError(f"picture {path}: cannot be read ({error}): delete it and run again") from error
    return np.ascontiguousarray(np.moveaxis(bands, 0, 2))
