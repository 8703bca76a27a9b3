"""False heights of the dense surface: cells far outside everything that is true around them.

    python benchmarks/false_specks.py [--seeds 1 2 3 4] [--whole 1 2] [--folders FOLDER …]

Each seed is the survey of `photogram demo --dense`, each of --whole one of simulation.whole_survey_plan with cells of 2
GSD. FOLDERs are such surveys with finished surfaces; nothing in them is changed.

A cell of dsm.tif that was measured at the finest level is false where it lies more than FALSE_M above the highest or
below the lowest of the true surface within AROUND_CELLS cells: what a wall or a crown may hold at most. `in small`:
those of them in connected patches (no steps) of fewer than SMALL_CELLS cells. Completeness: of the cells that three
photographs see.
"""

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from dense_sigma import make
from lib.dense_scores import score
from lib.dense_truth import simulated_survey, simulated_truth
from scipy.ndimage import maximum_filter, minimum_filter

from photogram.arrays import FloatArray
from photogram.files.maps.rasters import read_raster
from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_surface import StoredSurface
from photogram.pipeline.stages.surfaces.surface import surface_layers
from photogram.simulation.demonstration import write_demonstration
from photogram.surface.dsm import MEASURED, patch_cells
from photogram.survey import Raster

FALSE_M, AROUND_CELLS, SMALL_CELLS = 1.0, 2, 200


@dataclass(frozen=True)
class Specks:
    """``heights`` of a surface, how many of them are ``false`` and by how much at most, how many of these stand in
    small patches, how many two photographs tell alone, and the share of what can be seen that has a height."""

    heights: int
    false: int
    largest_m: float
    in_small: int
    of_two: int
    completeness: float


def range_around(truth: Raster, grid: MapGrid, cells: int) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest (rows, columns) of a fine true surface within ``cells`` of each cell of a grid,
    NaN beyond it."""
    values = truth.values.astype(np.float64)
    side = 2 * round((cells + 0.5) * grid.cell_m / truth.cell_m) + 1
    low = minimum_filter(np.where(np.isnan(values), np.inf, values), side, mode="constant", cval=np.inf)
    high = maximum_filter(np.where(np.isnan(values), -np.inf, values), side, mode="constant", cval=-np.inf)
    east, north = grid.centres_map_m(grid.whole)
    row = np.floor((truth.north_map_m - north) / truth.cell_m).astype(int)
    column = np.floor((east - truth.west_map_m) / truth.cell_m).astype(int)
    rows, columns = values.shape
    inside = np.outer((row >= 0) & (row < rows), (column >= 0) & (column < columns))
    at = np.ix_(np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1))
    none = ~inside | ~np.isfinite(low[at])
    return np.where(none, np.nan, low[at]), np.where(none, np.nan, high[at])


def specks(folder: Path) -> Specks:
    """Return what is false in the finished surface of a simulated survey."""
    with open_run(load_project(folder / "project.yaml")) as run:
        heights, layers = StoredSurface(run).heights(), surface_layers(run)
        rays, source = layers.read(layers.grid.whole, "rays", "source")
    heights = replace(heights, values=np.where(source == MEASURED, heights.values, np.float32(np.nan)))
    grid = MapGrid.of(heights)
    low, high = range_around(read_raster(folder / "truth_surface.tif")[0], grid, AROUND_CELLS)
    with np.errstate(invalid="ignore"):
        off = np.fmax(np.fmax(heights.values - high, low - heights.values), 0.0)
    false = off > FALSE_M
    small = patch_cells(heights.values, np.zeros_like(heights.values), rays, grid.cell_m, SMALL_CELLS) < SMALL_CELLS
    known = score(heights, simulated_truth(simulated_survey(folder), grid.cell_m))
    return Specks(
        int(np.isfinite(heights.values).sum()),
        int(false.sum()),
        float(np.nanmax(off, initial=0.0)),
        int((false & small).sum()),
        int((false & (rays == 2)).sum()),
        known.completeness,
    )


def make_demonstration(seed: int, folder: Path) -> None:
    """Make the survey of `photogram demo --dense` in a folder, up to its surface."""
    run_pipeline(load_project(write_demonstration(folder, seed, lambda *_: None)), until="surface")


def main() -> None:
    """Print a row for every survey."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", nargs="*", type=int, default=[1, 2, 3, 4])
    parser.add_argument("--whole", nargs="*", type=int, default=[])
    parser.add_argument("--folders", nargs="*", type=Path, default=[])
    arguments = parser.parse_args()
    titles = ("heights", "false", "up to m", "in small", "of two", "complete")
    print(f"{'simulated survey':>18}" + "".join(f"{title:>10}" for title in titles))
    made = [(f"demo, seed {n}", n, make_demonstration) for n in arguments.seeds]
    made += [(f"whole, seed {n}", n, make) for n in arguments.whole]
    for title, seed, maker in [] if arguments.folders else made:
        with tempfile.TemporaryDirectory() as name:
            maker(seed, Path(name))
            show(title, specks(Path(name)))
    for folder in arguments.folders:
        show(folder.name, specks(folder))


def show(title: str, found: Specks) -> None:
    """Print the row of a survey."""
    print(
        f"{title:>18}{found.heights:10}{found.false:10}{found.largest_m:10.2f}{found.in_small:10}{found.of_two:10}"
        f"{found.completeness:10.2%}",
        flush=True,
    )


if __name__ == "__main__":
    main()
