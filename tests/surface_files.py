"""Files of a surface as a survey hands it over: heights of a formula, a house, colours, which cells are measured."""

from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import from_origin

from photogram.files.maps.rasters import write_raster
from photogram.grid import MapGrid
from photogram.surface.dsm import INTERPOLATED, MEASURED
from photogram.survey import Raster

CELL_M, ROWS, COLUMNS, HOUSE_M = 0.25, 121, 161, 6.0
HOUSE = slice(40, 70), slice(50, 90)
"""Cells of a house with upright walls."""
FILLED = slice(0, 121), slice(120, 140)
"""Cells that nobody has measured."""
UNSEEN_COLUMNS = 10
"""Of the east, which the orthophoto does not show."""
COLOUR, DIFFERENCE = (200, 120, 60), 12
"""Of the orthophoto, the same all over, and by how much JPEG and sampling may change it."""


def surface_on(west_map_m: float, north_map_m: float, base_map_m: float) -> Raster:
    """Return a slope with bumps and a house on it, without heights in the north-west corner."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS] * CELL_M
    heights = base_map_m + 0.1 * x - 0.05 * y + 0.3 * np.sin(x / 3.0) * np.cos(y / 4.0)
    heights[HOUSE] += HOUSE_M
    heights[:12, :12] = np.nan
    return Raster(heights.astype(np.float32), west_map_m, north_map_m, CELL_M)


def write_surface(folder: Path, surface: Raster, crs: str) -> tuple[Path, Path, Path]:
    """Write heights, orthophoto and sources to a folder; return their paths."""
    paths = (folder / "dsm_filled.tif", folder / "orthophoto.tif", folder / "dsm_source.tif")
    write_raster(paths[0], surface, crs)
    grid = MapGrid.of(surface)
    shown = np.zeros((4, grid.rows, grid.columns), dtype=np.uint8)
    shown[:3] = np.array(COLOUR)[:, None, None]
    shown[3, :, :-UNSEEN_COLUMNS] = 255
    sources = np.full((1, grid.rows, grid.columns), MEASURED, dtype=np.uint8)
    sources[0][FILLED] = INTERPOLATED
    place = from_origin(grid.west_map_m, grid.north_map_m, grid.cell_m, grid.cell_m)
    for path, bands in ((paths[1], shown), (paths[2], sources)):
        size = {"count": len(bands), "height": grid.rows, "width": grid.columns}
        with rasterio.open(path, "w", driver="GTiff", dtype="uint8", crs=crs, transform=place, **size) as file:
            file.write(bands)
    return paths
