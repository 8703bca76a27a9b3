"""Moving water found in simulated surveys with a pond, against the truth; the surface with and without it.

    python benchmarks/water.py [--seeds 1,2,3]

The survey of a seed is simulation.canopy_plan: 24 photographs of crowns and hedges of leaves that move, high grass, and
a pond whose waves differ from one exposure to the next; cells of 2 GSD. It is matched once, and its surface made
without and with `masks: {auto: [water]}`. Judged are cells that three photographs see:

    pond         the area of the pond, m², and the share of it that was found
    land         what was taken for water beside it, m²
    level        of the water, less the truth, cm
    off          heights of `dsm.tif` over the pond that are 0.5 m or more off, without and with
    filled       RMS error of `dsm_filled.tif` over the pond, m, and how much of the pond has a height, without and with
"""

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from lib.canopy_scores import map_cover
from lib.dense_scores import on_grid
from lib.dense_truth import simulated_survey, simulated_truth
from lib.simulated.cover_truth import Kind

from photogram.arrays import ByteArray
from photogram.files.maps.rasters import read_codes, read_raster
from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.simulated_survey import canopy_plan
from photogram.surface.dsm import WATER
from photogram.survey import Raster

SEEN_BY, OFF_M = 3, 0.5


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What the stage `surface` wrote: heights that were measured, all heights, and codes of where they come from."""

    dsm: Raster
    filled: Raster
    code: ByteArray


def surfaces(project_path: Path, auto: list[str]) -> Surfaces:
    """Bring a project to its surface, with what is masked automatically, and read it."""
    document = yaml.safe_load(project_path.read_text(encoding="utf-8"))
    document["photographs"]["masks"] = {"auto": auto} if auto else None
    if not auto:
        del document["photographs"]["masks"]
    project_path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    project = load_project(project_path)
    run_pipeline(project, until="surface")
    with open_run(project) as run:
        folder = run.workspace.stage("surface")
        dsm, filled = (read_raster(folder / name)[0] for name in ("dsm.tif", "dsm_filled.tif"))
        return Surfaces(dsm, filled, read_codes(folder / "dsm_source.tif", MapGrid.of(dsm).whole))


def run(seed: int) -> str:
    """Return the line of one survey."""
    plan = canopy_plan()
    cell_m = round(2.0 * plan.gsd_m, 2)
    with tempfile.TemporaryDirectory() as name:
        project_path = write_demonstration(Path(name), seed, lambda *_: None, plan)
        document = yaml.safe_load(project_path.read_text(encoding="utf-8"))
        document["surface"] = {**(document.get("surface") or {}), "cell_m": cell_m}
        project_path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        without, found = surfaces(project_path, []), surfaces(project_path, ["water"])
        survey = simulated_survey(Path(name))
        truth = simulated_truth(survey, cell_m)
        cover = map_cover(survey, truth)
    pond = (cover.cover.kind == Kind.WATER) & (truth.seen >= SEEN_BY)
    level = cover.cover.ground_m + cover.lift_m
    grid = MapGrid.of(found.dsm)
    code = on_grid(grid.raster(found.code.astype(np.float32)), truth.grid) == WATER
    levels = [on_grid(one.filled, truth.grid) for one in (without, found)]
    measured = [on_grid(one.dsm, truth.grid) for one in (without, found)]
    off = [int(np.count_nonzero(np.abs(h - level)[pond] >= OFF_M)) for h in measured]
    errors = [(h - level)[pond & np.isfinite(h)] for h in levels]
    rms = [float(np.sqrt(np.mean(e**2))) for e in errors]
    share = [len(e) / np.count_nonzero(pond) for e in errors]
    lies = float(np.median((levels[1] - level)[pond & code])) if (pond & code).any() else float("nan")
    dry = code & (cover.cover.kind != Kind.WATER)
    area = int(np.count_nonzero(pond))
    return (
        f"{seed:>4}{area * cell_m**2:>7.0f}{np.count_nonzero(pond & code) / area:>7.0%}"
        f"{np.count_nonzero(dry) * cell_m**2:>8.1f}{100.0 * lies:>+8.1f}{off[0]:>8}{off[1]:>6}"
        f"{rms[0]:>9.2f} of{share[0]:>5.0%}{rms[1]:>7.2f} of{share[1]:>5.0%}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", default="1,2,3")
    print(f"{'seed':>4}{'pond':>7}{'found':>7}{'land':>8}{'level':>8}{'off':>8}{'with':>6}{'filled':>9}{'with':>17}")
    for seed in map(int, parser.parse_args().seeds.split(",")):
        print(run(seed), flush=True)


if __name__ == "__main__":
    main()
