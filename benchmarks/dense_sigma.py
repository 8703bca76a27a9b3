"""Errors of dense heights beside their predicted standard deviations, over several simulated surveys.

    python benchmarks/dense_sigma.py [--seeds 1 2 3 4 5 6 7] [--folders FOLDER …]

Each seed is a survey of simulation.whole_survey_plan: 24 photographs, overlap 80/70, buildings and trees, rendered,
adjusted, matched with cells of 2 GSD. FOLDERs are such surveys with finished surfaces; nothing in them is changed.

Judged are cells of smooth ground that three photographs see, of the finest level. `all`: heights against the truth,
over dsm_sigma.tif. Most of that error is the block's, one smooth bend for all cells of a survey, so a single survey
scatters about 1 widely and only several tell whether the sigmas are right. `matching`: against the surface where the
adjusted block must find it, over the standard deviation of the matching alone. RMS is over what lies within 4 sigma;
the share beyond stands beside.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from lib.dense_scores import PHOTOGRAPHS, on_grid
from lib.dense_truth import as_adjusted, simulated_survey, simulated_truth

from photogram.arrays import FloatArray
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.stages.stored_surface import StoredSurface
from photogram.pipeline.stages.surfaces.surface import surface_layers
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.simulated_survey import whole_survey_plan
from photogram.surface.dsm import MEASURED
from photogram.survey import Raster

BLUNDER_SIGMAS = 4.0


def make(seed: int, folder: Path) -> None:
    """Simulate a survey in a folder and take it to its surface, with cells of 2 GSD."""
    plan = whole_survey_plan()
    path = write_demonstration(folder, seed, lambda *_: None, plan)
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    document["surface"] = {"cell_m": round(2 * plan.gsd_m, 2)}
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    run_pipeline(load_project(path), until="surface")


def normalised_errors(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Return the errors over their standard deviations of cells of smooth ground: of all (N,), of the matching (N,)."""
    survey = simulated_survey(folder)
    with open_run(load_project(folder / "project.yaml")) as run:
        heights, sigma, block = StoredSurface(run).heights(), StoredSurface(run).sigma(), block_as_adjusted(run)
        layers = surface_layers(run)
        own, source = layers.read(layers.grid.whole, "own", "source")
    truth = simulated_truth(survey, heights.cell_m)
    adjusted = as_adjusted(truth, survey, block)
    heights = replace(heights, values=np.where(source == MEASURED, heights.values, np.float32(np.nan)))
    place = (layers.grid.west_map_m, layers.grid.north_map_m, layers.grid.cell_m)
    h, total, alone = (on_grid(r, truth.grid) for r in (heights, sigma, Raster(own, *place)))
    counted = np.isfinite(h) & np.isfinite(truth.height_map_m) & (truth.seen >= PHOTOGRAPHS) & truth.smooth
    of_all, of_matching = (h - truth.height_map_m) / total, (h - adjusted.height_map_m) / alone
    return of_all[counted], of_matching[counted]


def rms(z: FloatArray) -> float:
    """Return the root of the mean square of what lies within BLUNDER_SIGMAS."""
    return float(np.sqrt(np.mean(z[np.abs(z) < BLUNDER_SIGMAS] ** 2)))


def main() -> None:
    """Print a row for every survey, and the root mean square over all of them, each with the same weight."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", nargs="*", type=int, default=list(range(1, 8)))
    parser.add_argument("--folders", nargs="*", type=Path)
    arguments = parser.parse_args()
    print(
        f"{'simulated survey':>18}{'cells':>9}{'all: RMS':>10}{'beyond':>9}{'median':>8}{'matching':>15}{'beyond':>9}"
    )
    found = []
    for source in arguments.folders or arguments.seeds:
        with tempfile.TemporaryDirectory() as name:
            if isinstance(source, int):
                make(source, Path(name))
            z, own = normalised_errors(Path(name) if isinstance(source, int) else source)
        far, own_far = (float(np.mean(np.abs(v) >= BLUNDER_SIGMAS)) for v in (z, own))
        found.append((rms(z), rms(own), far, own_far))
        title = source if isinstance(source, int) else source.name
        print(
            f"{title:>18}{len(z):9}{rms(z):10.2f}{far:9.3%}{np.median(z):+8.2f}{rms(own):15.2f}{own_far:9.3%}",
            flush=True,
        )
    both = np.sqrt(np.mean(np.square(found), axis=0))
    share = np.mean(found, axis=0)
    print(f"{'pooled':>18}{'':9}{both[0]:10.2f}{share[2]:9.3%}{'':8}{both[1]:15.2f}{share[3]:9.3%}")


if __name__ == "__main__":
    main()
