"""The surface as a mesh for the page: every k-th cell of a raster of heights, with the orthophoto on it.

Heights are those of single cells, none is averaged, so a corner of the mesh is a figure of the raster. Squares of the
mesh whose form nobody has measured are known as such: walls, over which heights stand beside one another, and ground
that was filled or interpolated.
"""

from dataclasses import dataclass
from io import BytesIO
from math import ceil
from pathlib import Path

import numpy as np
from PIL import Image

from photogram.arrays import BoolArray, ByteArray, Float32Array
from photogram.errors import ProjectError
from photogram.files.maps.rasters import RasterFile, open_raster, picture_on_grid, pixel_m, read_codes
from photogram.grid import MapGrid, Window
from photogram.surface.dsm import MEASURED_IN

MOST_CORNERS = 1_000_000
"""Of the mesh: 3 bytes each, 4 MB of the page."""

MOST_PIXELS = 4096
"""Along a side of its picture, which is as much as every graphics processor takes."""

MOST_PICTURE_BYTES = 4_000_000
"""Of its picture; a larger one is made with larger pixels."""

STEEPEST_DEG = 70.0
"""Inclination beyond which a part of the surface is a wall."""

NOT_DRAWN, MEASURED, WALL, INTERPOLATED = 0, 1, 2, 3
"""What a square of the mesh is."""

_JUMP_SPACINGS = 0.5
_STRIP_CELLS = 1_000_000
_JPEG_QUALITY = 85
_OPAQUE = 128
_COARSER = 1.25


@dataclass(frozen=True, eq=False)
class DrawnSurface:
    """Corners (R, C) of a mesh, north-west corner first, and its squares (R − 1, C − 1)."""

    file: str
    """Name of the raster."""
    corner_grid: MapGrid
    """Its cells have the corners in their middle."""
    every: int
    """Cells of the raster from a corner to the next."""
    height_m: Float32Array
    """(R, C) in the map, NaN where there is none, or the orthophoto shows nothing."""
    kind: ByteArray
    """(R − 1, C − 1): NOT_DRAWN, MEASURED, WALL or INTERPOLATED."""
    has_sources: bool
    """Whether the survey says which cells are measured; without, none is taken as interpolated."""
    rms_m: float
    """Root mean square vertical distance of the raster's cells from the mesh, over squares that are MEASURED."""
    picture_m: tuple[float, float]
    """Width and height of the picture, whose north-west corner is the first corner of the mesh."""
    jpeg: bytes
    """The picture."""


def drawn_surface(heights: Path, orthophoto: Path, sources: Path | None, *, local: bool = False) -> DrawnSurface | None:
    """Return the mesh of a raster of heights with an orthophoto on it, None where no square of it can be drawn.

    ``sources`` is the raster of what its cells are (``dsm_source.tif``). Read strip by strip. Raises ProjectError where
    a file cannot be read or the cells of the two differ, FrameError where one is no map grid.
    """
    file = open_raster(heights, local=local)
    if sources is not None and open_raster(sources, local=local).grid != file.grid:
        raise ProjectError(f"raster {sources}: its cells are not those of {heights.name}: run photogram adjust again")
    every = max(1, ceil(np.sqrt(file.grid.rows * file.grid.columns / MOST_CORNERS)))
    corners = _corner_grid(file.grid, every)
    if min(corners.rows, corners.columns) < 2:
        return None
    shown = picture_on_grid(orthophoto, corners, corners.whole)[..., 3] >= _OPAQUE
    parts, squares, sum2, count = [], [], 0.0, 0
    step = max(1, _STRIP_CELLS // (file.grid.columns * every))
    for first in range(0, corners.rows - 1, step):
        rows = min(step, corners.rows - 1 - first)
        strip = _strip(file, sources, Window(first, 0, first + rows, corners.columns - 1), every, shown)
        own = strip.corner_m if first + rows == corners.rows - 1 else strip.corner_m[:-1]
        parts.append(own)
        squares.append(strip.kind)
        sum2, count = sum2 + strip.sum_m2, count + strip.cells
    kind = np.vstack(squares)
    if not kind.any():
        return None
    picture_m, jpeg = _picture(orthophoto, corners)
    rms_m = float(np.sqrt(sum2 / count)) if count else 0.0
    height_m = np.vstack(parts)
    return DrawnSurface(heights.name, corners, every, height_m, kind, sources is not None, rms_m, picture_m, jpeg)


def _corner_grid(grid: MapGrid, every: int) -> MapGrid:
    rows, columns = ((n - 1) // every + 1 for n in (grid.rows, grid.columns))
    outwards_m = (every - 1) * grid.cell_m / 2
    return MapGrid(grid.west_map_m - outwards_m, grid.north_map_m + outwards_m, every * grid.cell_m, rows, columns)


@dataclass(frozen=True, eq=False)
class _Strip:
    """Some rows of squares: their corners and what they are, and how far the cells lie from those that are measured."""

    corner_m: Float32Array
    kind: ByteArray
    sum_m2: float
    cells: int


def _strip(file: RasterFile, sources: Path | None, squares: Window, every: int, shown: BoolArray) -> _Strip:
    cells = Window(squares.row * every, 0, squares.row_end * every + 1, squares.column_end * every + 1)
    heights = file.read(cells)
    corner_m = np.where(shown[squares.row : squares.row_end + 1], heights[::every, ::every], np.float32(np.nan))
    spacing_m = every * file.grid.cell_m
    drawn = _at_all_corners(np.isfinite(corner_m))
    walls = _steep(corner_m, spacing_m) | _jumps(heights, every, file.grid.cell_m)
    kind = np.where(walls, np.uint8(WALL), np.uint8(MEASURED))
    if sources is not None:
        measured = np.isin(read_codes(sources, cells)[::every, ::every], tuple(MEASURED_IN.values()))
        kind[~walls & ~_at_all_corners(measured)] = INTERPOLATED
    kind[~drawn] = NOT_DRAWN
    off_m = (_by_square(heights[:-1, :-1], every) - _on_mesh(corner_m, every))[kind == MEASURED]
    known = off_m[np.isfinite(off_m)].astype(np.float64)
    return _Strip(corner_m, kind, float(np.sum(known**2)), len(known))


def _at_all_corners(of_corner: BoolArray) -> BoolArray:
    rows = of_corner[:-1] & of_corner[1:]
    return np.asarray(rows[:, :-1] & rows[:, 1:])


def _steep(corner_m: Float32Array, spacing_m: float) -> BoolArray:
    """Return which squares have a triangle steeper than STEEPEST_DEG; their diagonals go from south-west to
    north-east."""
    east, south = np.diff(corner_m, axis=1) / spacing_m, np.diff(corner_m, axis=0) / spacing_m
    upper, lower = np.hypot(east[:-1], south[:, :-1]), np.hypot(east[1:], south[:, 1:])
    return np.asarray(np.fmax(upper, lower) > np.tan(np.radians(STEEPEST_DEG)))


def _jumps(heights: Float32Array, every: int, cell_m: float) -> BoolArray:
    """Return over which squares two neighbouring cells stand steeper than STEEPEST_DEG and, so that the surface's
    roughness is no wall, apart by half the side of the square."""
    apart = [np.abs(np.diff(heights, axis=0))[:, :-1], np.abs(np.diff(heights, axis=1))[:-1]]
    most = np.fmax(*(np.fmax.reduce(_by_square(a, every), axis=2) for a in apart))
    least_m = max(np.tan(np.radians(STEEPEST_DEG)) * cell_m, _JUMP_SPACINGS * every * cell_m)
    return np.asarray(most > least_m)


def _by_square(of_cell: Float32Array, every: int) -> Float32Array:
    """Return values of cells (R · k, C · k) as those of squares (R, C, k²)."""
    rows, columns = (n // every for n in of_cell.shape)
    return of_cell.reshape(rows, every, columns, every).swapaxes(1, 2).reshape(rows, columns, -1)


def _on_mesh(corner_m: Float32Array, every: int) -> Float32Array:
    """Return the mesh's heights (R, C, k²) at the cells of its squares."""
    share = np.arange(every, dtype=np.float32) / every
    south, east = (axis.reshape(-1) for axis in np.meshgrid(share, share, indexing="ij"))
    nw, ne, sw, se = (
        corner[..., None] for corner in (corner_m[:-1, :-1], corner_m[:-1, 1:], corner_m[1:, :-1], corner_m[1:, 1:])
    )
    upper = nw + east * (ne - nw) + south * (sw - nw)
    lower = se + (1 - east) * (sw - se) + (1 - south) * (ne - se)
    return np.asarray(np.where(east + south <= 1, upper, lower))


def _picture(orthophoto: Path, corners: MapGrid) -> tuple[tuple[float, float], bytes]:
    """Return width and height, m, and JPEG of what an orthophoto shows between the corners; beyond its rim its mean
    colour, so that none of the rim's dark is smeared into it."""
    width_m, height_m = (corners.columns - 1) * corners.cell_m, (corners.rows - 1) * corners.cell_m
    west_map_m, north_map_m = corners.west_map_m + corners.cell_m / 2, corners.north_map_m - corners.cell_m / 2
    cell_m = max(pixel_m(orthophoto), max(width_m, height_m) / (MOST_PIXELS - 1))
    while True:
        columns, rows = (min(MOST_PIXELS, ceil(length / cell_m) + 1) for length in (width_m, height_m))
        grid = MapGrid(west_map_m, north_map_m, cell_m, rows, columns)
        shown = picture_on_grid(orthophoto, grid, grid.whole)
        colour, seen = shown[..., :3], shown[..., 3] >= _OPAQUE
        if seen.any() and not seen.all():
            colour[~seen] = colour[seen].mean(axis=0).round().astype(np.uint8)
        stream = BytesIO()
        Image.fromarray(colour).save(stream, "JPEG", quality=_JPEG_QUALITY)
        if stream.tell() <= MOST_PICTURE_BYTES or max(rows, columns) < 2 * _OPAQUE:
            return (columns * cell_m, rows * cell_m), stream.getvalue()
        cell_m *= _COARSER
