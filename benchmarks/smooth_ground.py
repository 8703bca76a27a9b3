"""A finished dense surface beside another program's cloud where the ground is smooth, and what lies within the rim.

    python benchmarks/smooth_ground.py PROJECT CLOUD [--spread 0.15] [--within 1.1]

PROJECT is a project.yaml that `photogram adjust` has finished, with its orthophoto. Cells of 0.1 m whose points of the
CLOUD, and those around them, scatter by less than --spread within --within metres are smooth; of these the heights of
`dsm.tif` are compared with the median of the cloud, after a quadratic over the site, fitted without outliers, is taken
out. The cloud is photogrammetric itself: what both have wrong is not seen, and what differs may be wrong in either.

`cells`: heights of the surface on smooth ground, by the level that found them (`dsm_source.tif`); `off`: the shares of
them by more than 0.5 and 1 m. `rim`: cells of the surface within the rim of the orthophoto (`outline.gpkg`) with a
measured height, by level; below it the share within that the cloud covers, of all cells and of those that the surface
leaves open (squares of SQUARE_CELLS cells with a point in them), and the transparent share of the orthophoto.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from lib.dense_scores import gridded_median, unbent
from rasterio.features import rasterize
from rasterio.transform import from_origin
from scipy.ndimage import uniform_filter

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.files.clouds.points import read_cloud
from photogram.files.maps.rasters import read_codes, read_raster
from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project

LATTICE_M = 0.1
LEVELS = {1: "finest", 3: "2 cells", 4: "4 cells", 5: "8 cells"}
OFF_M = (0.5, 1.0)
SQUARE_CELLS = 8
FEWEST = 30  # points of the cloud around a smooth cell


def smooth_ground(position_map_m: FloatArray, spread_m: float, within_m: float) -> tuple[MapGrid, FloatArray]:
    """Return a lattice over a cloud (N, 3) and the median height (rows, columns) of its smooth cells, NaN elsewhere.

    The scatter is the standard deviation of all points in the square with half the side ``within_m``.
    """
    low, high = position_map_m[:, :2].min(axis=0), position_map_m[:, :2].max(axis=0)
    columns, rows = np.ceil((high - low) / LATTICE_M).astype(int) + 1
    grid = MapGrid(float(low[0]), float(low[1] + rows * LATTICE_M), LATTICE_M, int(rows), int(columns))
    column, row = np.floor((position_map_m[:, :2] - [grid.west_map_m, grid.north_map_m]) / [LATTICE_M, -LATTICE_M]).T
    cell = np.clip(row, 0, rows - 1).astype(int) * columns + np.clip(column, 0, columns - 1).astype(int)
    z = position_map_m[:, 2] - position_map_m[:, 2].mean()
    size = 2 * round(within_m / LATTICE_M) + 1
    count, first, second = (
        uniform_filter(np.bincount(cell, weights, rows * columns).reshape(rows, columns), size, mode="constant")
        * size**2
        for weights in (np.ones(len(z)), z, z * z)
    )
    count = np.round(count)
    variance = second / np.maximum(count, 1) - (first / np.maximum(count, 1)) ** 2
    smooth = (count >= FEWEST) & (variance < spread_m**2)
    return grid, np.where(smooth, gridded_median(position_map_m, grid), np.nan)


def differences(heights: Float32Array, grid: MapGrid, lattice: MapGrid, ground_m: FloatArray) -> FloatArray:
    """Return the heights (rows, columns) minus the smooth ground of the lattice, less a quadratic; NaN elsewhere."""
    east = grid.west_map_m + (np.arange(grid.columns) + 0.5) * grid.cell_m
    north = grid.north_map_m - (np.arange(grid.rows) + 0.5) * grid.cell_m
    column = np.floor((east - lattice.west_map_m) / lattice.cell_m).astype(int)
    row = np.floor((lattice.north_map_m - north) / lattice.cell_m).astype(int)
    difference = np.full(heights.shape, np.nan)
    at_row, at_column = ((n >= 0) & (n < most) for n, most in ((row, lattice.rows), (column, lattice.columns)))
    there = np.ix_(at_row, at_column)
    difference[there] = heights[there] - ground_m[np.ix_(row[at_row], column[at_column])]
    known = np.isfinite(difference)
    place = np.argwhere(known).astype(np.float64)
    difference[known] = unbent(difference[known], place * grid.cell_m)
    return difference


def covered(position_map_m: FloatArray, grid: MapGrid) -> BoolArray:
    """Return the cells (rows, columns) of a grid in whose square of SQUARE_CELLS cells points of a cloud (N, 3) lie."""
    squares = grid.coarser(SQUARE_CELLS)
    inside = np.array([grid.west_map_m, grid.north_map_m])
    column, row = np.floor((position_map_m[:, :2] - inside) / [squares.cell_m, -squares.cell_m]).astype(int).T
    on_grid = (row >= 0) & (row < squares.rows) & (column >= 0) & (column < squares.columns)
    there = np.zeros((squares.rows, squares.columns), bool)
    there[row[on_grid], column[on_grid]] = True
    return there.repeat(SQUARE_CELLS, axis=0).repeat(SQUARE_CELLS, axis=1)[: grid.rows, : grid.columns]


def main() -> None:
    """Print the shares on smooth ground, and what lies within the rim."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("project", type=Path)
    parser.add_argument("cloud", type=Path)
    parser.add_argument("--spread", type=float, default=0.15, help="m")
    parser.add_argument("--within", type=float, default=1.1, help="m")
    given = parser.parse_args()
    results = load_project(given.project).results
    if not (results / "deliverables/outline.gpkg").is_file():
        raise SystemExit(f"{results}: there is no outline.gpkg: adjust the project with its orthophoto")
    surface, _ = read_raster(results / "deliverables/dsm.tif")
    grid = MapGrid.of(surface)
    source = read_codes(results / "quality/dsm_source.tif", grid.whole)
    cloud = read_cloud(given.cloud).position_map_m
    lattice, ground_m = smooth_ground(cloud, given.spread, given.within)
    off = differences(surface.values, grid, lattice, ground_m)
    outline = shapely.from_wkb(pyogrio.raw.read(results / "deliverables/outline.gpkg", layer="outline")[2])
    transform = from_origin(grid.west_map_m, grid.north_map_m, grid.cell_m, grid.cell_m)
    inside = rasterize(list(outline), out_shape=source.shape, transform=transform).astype(bool)
    print(f"{'level':10}{'cells':>12}{'off 0.5 m':>12}{'off 1 m':>12}{'rim':>10}")
    measured = np.isfinite(surface.values)
    for name, cells in [*((n, source == code) for code, n in LEVELS.items()), ("any", measured)]:
        own = np.abs(off[cells & np.isfinite(off)])
        shares = "".join(f"{np.mean(own > limit) if len(own) else np.nan:12.3%}" for limit in OFF_M)
        print(f"{name:10}{len(own):12,}{shares}{(cells & inside).sum() / inside.sum():10.1%}")
    there = covered(cloud, grid)
    print(
        f"cloud: in squares of {SQUARE_CELLS * grid.cell_m:g} m it covers {there[inside].mean():.1%} of the rim, "
        f"{there[inside & ~measured].mean():.1%} of what the surface leaves open there"
    )
    rim = json.loads((results / "quality/report.json").read_text(encoding="utf-8"))["orthophoto"]["rim"]
    print(f"orthophoto: {rim['area_m2']:.0f} m² within the rim, {rim['transparent']:.3%} of it transparent")


if __name__ == "__main__":
    main()
