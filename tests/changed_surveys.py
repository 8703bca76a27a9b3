"""Two simulated epochs on disk, as photogram's results are, with heaps and polygons between them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from lib.simulated_changes import CORNER, CRS, Errors, Heap, epoch, grid_at, uneven

from photogram.files.clouds.dense_points import points_of_cells, write_dense_laz
from photogram.files.maps.cogs import write_cog_codes
from photogram.files.maps.rasters import write_raster
from photogram.pipeline.stages.surfaces.surface import SOURCES
from photogram.result_files import ResultFolder, within_results
from photogram.survey import Raster
from photogram.volumes.surfaces import SurfaceFiles

HEAP, PIT = Heap(-6.0, 3.0, 4.0, 0.6), Heap(7.0, -4.0, 3.0, -0.5)
OUTLINES = [shapely.Point(CORNER[0] + h.east_m, CORNER[1] + h.north_m).buffer(h.radius_m + 1.0) for h in (HEAP, PIT)]
STABLE = shapely.box(CORNER[0] - 14, CORNER[1] - 14, CORNER[0] + 14, CORNER[1] - 9)


def changed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the later ground."""
    return uneven(x, y) + HEAP.height(x, y) + PIT.height(x, y)


def write_polygons(path: Path, polygons: Sequence[Any], names: Sequence[str], crs: str | None = CRS) -> Path:
    """Write polygons with names, as GeoPackage or GeoJSON by the suffix."""
    pyogrio.raw.write(
        path, geometry=shapely.to_wkb(np.array(polygons, dtype=object)), field_data=[np.array(names, dtype=object)],
        fields=["name"], driver="GPKG" if path.suffix == ".gpkg" else "GeoJSON", geometry_type="Polygon", crs=crs,
    )  # fmt: skip
    return path


def write_results(folder: Path, survey: SurfaceFiles, hole: tuple[slice, slice] | None = None, crs: str = CRS) -> Path:
    """Write an epoch's surface, sigmas, codes and cloud in the units of ``crs``; a hole has no height."""
    for place in ResultFolder:
        (folder / place).mkdir(parents=True, exist_ok=True)
    grid = survey.heights.grid
    assert survey.sigma is not None
    assert survey.own is not None
    for part, raster in (("", survey.heights), ("_sigma", survey.sigma), ("_sigma_own", survey.own)):
        values = raster.read(grid.whole)
        if hole is not None:
            values[hole] = np.nan
        write_raster(
            folder / within_results(f"dsm{part}.tif"),
            Raster(values, grid.west_map_m, grid.north_map_m, grid.cell_m),
            crs,
        )
    codes = np.where(np.isnan(values), 0, 1).astype(np.uint8)
    write_cog_codes(folder / within_results("dsm_source.tif"), grid, crs, [(grid.whole, codes)], categories=SOURCES)
    height, sigma = survey.heights.read(grid.whole), survey.sigma.read(grid.whole)
    height[np.isnan(values)] = np.nan
    one = np.ones(height.shape, np.uint8)
    points = points_of_cells(
        grid, grid.whole, height, np.zeros((*height.shape, 3), np.uint8), sigma, one.astype(np.float32), 3 * one, one,
        0 * one,
    )  # fmt: skip
    write_dense_laz(folder / within_results("dense.laz"), grid, crs, [points], coloured=False)
    return folder


def write_epochs(folder: Path, seed: int = 1, errors: Errors | None = None, crs: str = CRS) -> tuple[Path, Path]:
    """Write an earlier and a later survey, the later one on a grid that lies off by whole cells, with a hole in it."""
    rng, errors = np.random.default_rng(seed), errors or Errors()
    first, second = grid_at(0.0, 0.0, 30.0, 0.2), grid_at(1.0, -0.4, 32.0, 0.2)
    earlier = write_results(folder / "earlier" / "results", epoch(uneven, first, errors, rng), crs=crs)
    hole = (slice(62, 66), slice(42, 47))
    later = write_results(folder / "later" / "results", epoch(changed, second, errors, rng), hole, crs)
    return earlier, later
