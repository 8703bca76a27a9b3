"""A picture on the map as a pyramid of square tiles in another CRS, made tile by tile.

Tiles of the finest level are resampled from the raster; each above is the mean of the four below it, weighted by what
is not transparent, so that rims do not darken. In memory are four tiles of each level at most.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, floor, log2
from pathlib import Path

import numpy as np
import rasterio
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.transform import from_origin
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds
from rasterio.windows import Window

from photogram.arrays import ByteArray
from photogram.errors import ProjectError
from photogram.geodesy.crs import WGS84, map_units

EQUATOR_M = 111_319.49
"""A degree of the equator of WGS 84."""

_RIM_SAMPLES = 101


@dataclass(frozen=True)
class TileGrid:
    """Square tiles in rows from the north-west corner; each level has twice the tiles of the one above it a side."""

    crs: str
    west: float
    north: float
    pixel_x: float
    """Width of a pixel of the finest level, in units of the CRS."""
    pixel_y: float
    side_px: int
    finest: int
    """Number of the finest level."""
    extent: tuple[float, float, float, float]
    """West, south, east and north of the raster."""

    def bounds(self, level: int, column: int, row: int) -> tuple[float, float, float, float]:
        """Return west, south, east and north of a tile."""
        x, y = (step * self.side_px * 2.0 ** (self.finest - level) for step in (self.pixel_x, self.pixel_y))
        west, north = self.west + column * x, self.north - row * y
        return west, north - y, west + x, north

    def covered(self, level: int) -> tuple[range, range]:
        """Return the columns and rows of tiles that the raster can touch."""
        left, bottom, right, top = self.bounds(level, 0, 0)
        west, south, east, north = self.extent
        return (
            _touched((west - left) / (right - left), (east - left) / (right - left)),
            _touched((top - north) / (top - bottom), (top - south) / (top - bottom)),
        )


def _touched(first: float, end: float) -> range:
    return range(floor(first), max(ceil(end), floor(first) + 1))


@dataclass(frozen=True, eq=False)
class Tile:
    """A tile and its pixels (side, side, 4), red, green, blue and alpha."""

    level: int
    column: int
    row: int
    rgba: ByteArray


def degree_grid(path: Path, crs: str, side_px: int) -> TileGrid:
    """Return tiles in longitude and latitude of a picture in ``crs``, one of them at level 0; pixels are as large as
    its cells. Raises ProjectError where it cannot be read."""
    cell_m, (west, south, east, north) = _cell_and_bounds(path, crs, WGS84)
    pixel_y = cell_m / EQUATOR_M
    pixel_x = pixel_y / np.cos(np.deg2rad((south + north) / 2.0))
    tiles = max((east - west) / pixel_x, (north - south) / pixel_y) / side_px
    finest = max(0, ceil(log2(max(tiles, 1.0))))
    return TileGrid(WGS84, west, north, float(pixel_x), pixel_y, side_px, finest, (west, south, east, north))


def tiles_of(path: Path, crs: str, grid: TileGrid, coarsest: int = 0) -> Iterator[Tile]:
    """Yield the tiles of a picture (red, green, blue, alpha) in the plan ``crs``, from the finest level to the
    ``coarsest``, those that show nothing left out; each after the four that it is the mean of. Raises ProjectError
    where the picture cannot be read."""
    columns, rows = grid.covered(grid.finest)
    x, y = grid.pixel_x, grid.pixel_y
    corner = from_origin(grid.west + columns.start * grid.side_px * x, grid.north - rows.start * grid.side_px * y, x, y)
    try:
        with (
            rasterio.open(path) as source,
            WarpedVRT(
                source,
                src_crs=crs,
                crs=grid.crs,
                transform=corner,
                width=len(columns) * grid.side_px,
                height=len(rows) * grid.side_px,
                resampling=Resampling.bilinear,
            ) as warped,
        ):
            for column in grid.covered(coarsest)[0]:
                for row in grid.covered(coarsest)[1]:
                    yield from _below(warped, grid, coarsest, column, row)
    except RasterioError as error:
        raise ProjectError(f"picture {path}: cannot be read ({error}): delete it and run again") from error


def _below(warped: WarpedVRT, grid: TileGrid, level: int, column: int, row: int) -> Iterator[Tile]:
    """Yield what is below a tile and, last, the tile itself."""
    columns, rows = grid.covered(level)
    if column not in columns or row not in rows:
        return
    side = grid.side_px
    if level == grid.finest:
        first_column, first_row = (covered.start for covered in (columns, rows))
        window = Window((column - first_column) * side, (row - first_row) * side, side, side)
        rgba = np.moveaxis(warped.read((1, 2, 3, 4), window=window), 0, -1)
    else:
        whole = np.zeros((2 * side, 2 * side, 4), np.uint8)
        for down in (0, 1):
            for right in (0, 1):
                child = None
                for child in _below(warped, grid, level + 1, 2 * column + right, 2 * row + down):
                    yield child
                if child is not None and child.level == level + 1:
                    whole[down * side : (down + 1) * side, right * side : (right + 1) * side] = child.rgba
        rgba = _halved(whole)
    if rgba[..., 3].any():
        yield Tile(level, column, row, np.ascontiguousarray(rgba))


def _halved(rgba: ByteArray) -> ByteArray:
    """Return the means of squares of 2 × 2 pixels, colours weighted by alpha."""
    rows, columns = (size // 2 for size in rgba.shape[:2])
    blocks = rgba.reshape(rows, 2, columns, 2, 4).astype(np.float32)
    alpha = blocks[..., 3:]
    total = alpha.sum(axis=(1, 3))
    colour = (blocks[..., :3] * alpha).sum(axis=(1, 3)) / np.maximum(total, 1.0)
    return np.asarray(np.rint(np.concatenate([colour, total / 4.0], axis=-1)), np.uint8)


def _cell_and_bounds(path: Path, crs: str, target: str) -> tuple[float, tuple[float, float, float, float]]:
    """Return the cell of a raster in m and its west, south, east and north in another CRS."""
    try:
        with rasterio.open(path) as source:
            return abs(source.transform.a) * map_units(crs).plan_m, transform_bounds(
                crs, target, *source.bounds, densify_pts=_RIM_SAMPLES
            )
    except RasterioError as error:
        raise ProjectError(f"picture {path}: cannot be read ({error}): delete it and run again") from error
