"""Epochs of one site adjusted together, and each for itself: how well is their difference known, and is that true?

    python benchmarks/epochs.py [SEEDS]                 default: 5

Rendered sites of 15 photographs an epoch, flown anew with RTK (base station off by 2, 2, 3 cm in each epoch), no
control; between the epochs a heap of 1.5 m and a pit of 1 m. Each survey goes through `photogram epochs`, and through
`photogram adjust` twice and `photogram compare`. `level`: 1.96 sigma of the difference, the median over unchanged
ground; `off`: median of the difference there, root mean square over the surveys; `false`: share of unchanged cells
beyond the level of detection, expectation 5 %; `found`: share of the cells that truly changed by more than twice the
level that are told with the right sign; `volumes`: heap and pit over the true ones, mean and scatter. Simulated.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rasterio
from lib import study
from lib.simulated.epochs import Mound, change_m, simulate_epochs

from photogram.simulation.simulated_survey import render_photographs, whole_survey_plan
from photogram.simulation.survey_files import write_survey

PLAN = replace(
    whole_survey_plan(800), strips=3, photographs_per_strip=5, control_points=4, check_points=0, side_overlap=0.65,
    gnss_sigma_m=(0.015, 0.015, 0.02), gnss_offset_sigma_m=(0.02, 0.02, 0.03),
)  # fmt: skip
MOUNDS = (Mound(-20.0, 5.0, 12.0, 1.5), Mound(25.0, -10.0, 9.0, -1.0))
EPOCHS = ("may", "june")
LEVEL = 1.96
NO_PICTURES = "\northophoto: {enabled: false}\nterrain: {enabled: false}\n"


def command(*arguments: object) -> None:
    """Run `photogram` and keep what it says to itself."""
    called = [sys.executable, "-m", "photogram.cli.main", *map(str, arguments)]
    subprocess.run(called, check=True, capture_output=True, env=os.environ | {"MPLBACKEND": "agg"})


@dataclass(frozen=True)
class Scores:
    """What a difference is worth: figures of ``level``, ``off``, ``false``, ``found`` and ``volumes``."""

    level_m: float
    off_m: float
    false: float
    found: float
    volumes: tuple[float, ...]


def scored(folder: Path) -> Scores:
    """Return the scores of a comparison."""
    with rasterio.open(folder / "difference.tif") as raster:
        difference = raster.read(1, masked=True).filled(np.nan).astype(np.float64)
        rows, columns = np.mgrid[0 : raster.height, 0 : raster.width]
        east, north = rasterio.transform.xy(raster.transform, rows.ravel(), columns.ravel())
        area_m2 = abs(raster.transform.a * raster.transform.e)
    with rasterio.open(folder / "difference_sigma.tif") as raster:
        sigma = raster.read(1, masked=True).filled(np.nan).astype(np.float64)
    world = PLAN.frame.world_from_map(np.column_stack([east, north, np.full(len(east), PLAN.origin_map_m[2])]))
    x, y = (world[:, axis].reshape(difference.shape) for axis in (0, 1))
    true, known = change_m(MOUNDS, x, y), np.isfinite(sigma)
    unchanged = known & np.all([np.hypot(x - m.east_m, y - m.north_m) > m.radius_m + 2.0 for m in MOUNDS], axis=0)
    changed = known & (np.abs(true) > 2.0 * LEVEL * np.nan_to_num(sigma)) & ~unchanged
    told = np.sign(difference) * (np.abs(difference) > LEVEL * sigma)
    volumes = []
    for mound in MOUNDS:
        own = known & (np.hypot(x - mound.east_m, y - mound.north_m) < mound.radius_m)
        volumes.append(float(difference[own].sum() * area_m2 / (true[own].sum() * area_m2)))
    return Scores(
        LEVEL * float(np.median(sigma[unchanged])),
        float(np.median(difference[unchanged])),
        float(np.mean(told[unchanged] != 0)),
        float(np.mean(told[changed] == np.sign(true[changed]))),
        tuple(volumes),
    )


def compared_together(folder: Path, seed: int) -> Path:
    """Render the epochs of a site, adjust them together, and return the folder of their difference."""
    (folder / "photographs").mkdir()
    for name, survey in zip(EPOCHS, simulate_epochs(PLAN, seed + 1, MOUNDS), strict=True):
        write_survey(folder / f"flown_{name}", survey, render_photographs(survey))
        (folder / f"flown_{name}" / "photographs").rename(folder / "photographs" / name)
    project = folder / "project.yaml"
    command("init", folder / "photographs", "--recursive", "--project", project)
    epochs = "\n".join(f"  - {{name: {name}, photographs: [{name}/*]}}" for name in EPOCHS)
    project.write_text(f"{project.read_text(encoding='utf-8')}{NO_PICTURES}epochs:\n{epochs}\n", encoding="utf-8")
    command("epochs", project)
    return folder / "results_june_minus_may"


def trial(seed: int) -> tuple[Scores, Scores]:
    """Return the scores of a survey's epochs adjusted together, and each for itself."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        together = compared_together(folder, seed)
        for name in EPOCHS:
            alone = folder / name / "project.yaml"
            alone.parent.mkdir()
            command("init", folder / "photographs" / name, "--project", alone)
            alone.write_text(alone.read_text(encoding="utf-8") + NO_PICTURES, encoding="utf-8")
            command("adjust", alone, "--quiet")
        command("compare", folder / "june", "--reference", folder / "may", "--output", folder / "apart")
        return scored(together), scored(folder / "apart")


def main() -> None:
    """Print the table."""
    given = study.parser(__doc__, 5, workers=1).parse_args()
    with study.recorded(given.json):
        print(f"{len(given.seeds)} rendered sites, two epochs of 15 photographs, GSD {PLAN.gsd_m:.3f} m; simulated")
        table = study.Table("epochs are adjusted", "level", "off", "false", "found", "volumes")
        rows = study.run(trial, list(given.seeds), given.workers)
        for name, scores in zip(("together", "each for itself"), zip(*rows, strict=True), strict=True):
            volumes = np.array([s.volumes for s in scores])
            table.row(
                name,
                f"{np.median([s.level_m for s in scores]):.3f} m",
                f"{study.rms([s.off_m for s in scores]):.4f} m",
                f"{np.mean([s.false for s in scores]):.1%}",
                f"{np.mean([s.found for s in scores]):.1%}",
                f"{volumes.mean():.3f} ± {volumes.std():.3f}",
            )


if __name__ == "__main__":
    main()
