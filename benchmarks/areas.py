"""Seconds and memory of the whole command by stage, on surveys of one, four and sixteen times the photographs.

    python benchmarks/areas.py [--photographs 24,96,384] [--seed 1] [--keep DIRECTORY]

Simulated and rendered: photographs of 1200 × 900 px, overlap 80/70, default settings with dense surface and orthophoto,
each survey in a process of its own. Seconds are those without the compilation of kernels. `exponent`: slope of log
seconds over log photographs from one survey to the next; 1 is linear, and what does not depend on the survey brings it
down. Memory is the most that the process holds in a stage; `cells` are those of the surface and of the orthophoto, of
which more photographs show each the larger the survey: the last line has the exponents over cells of the orthophoto.
"""

import argparse
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.pipeline.stages.surface_frame import GridSummary
from photogram.pipeline.store.stage_summary import StageNote
from photogram.pipeline.store.workspace import Workspace
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.simulated_survey import whole_survey_plan

LONGER = 8 / 3
"""Photographs of a strip over the number of strips: surveys of any size have one shape."""


class AreaSummary(StageNote, GridSummary, total=False):
    """What is read of a stage: its costs, and its cells where it has any."""


Summaries = dict[str, AreaSummary]


def survey(folder: Path, photographs: int, seed: int) -> Path:
    """Simulate and render a survey of about so many photographs, unless it is there; returns its project file."""
    path = folder / "project.yaml"
    if not path.is_file():
        strips = max(1, round((photographs / LONGER) ** 0.5))
        plan = replace(whole_survey_plan(), strips=strips, photographs_per_strip=round(photographs / strips))
        write_demonstration(folder, seed, lambda *_: None, plan)
    return path


def _process(path: Path) -> None:
    run_pipeline(load_project(path), start=STAGE_NAMES[0])


def processed(path: Path) -> Summaries:
    """Process a survey in a process of its own, all of it anew, and return what its stages say."""
    process = multiprocessing.get_context("spawn").Process(target=_process, args=(path,))
    process.start()
    process.join()
    if process.exitcode != 0:
        raise SystemExit(f"{path}: ended with exit code {process.exitcode}")
    workspace = Workspace(load_project(path).work)
    return {name: workspace.summary(name, AreaSummary) for name in STAGE_NAMES}


def seconds(summary: AreaSummary) -> float:
    """Return the seconds of a stage without compilation."""
    return float(summary["seconds"] - summary["compilation_seconds"])


def _exponents(values: list[float], counts: Sequence[float]) -> str:
    pairs = pairwise(zip(values, counts, strict=True))
    slopes = [np.log(b / a) / np.log(n / m) if min(a, b) >= 1.0 else np.nan for (a, m), (b, n) in pairs]
    return "".join(f"{slope:8.2f}" if np.isfinite(slope) else f"{'–':>8}" for slope in slopes)


def _row(name: str, took: list[float], held: list[float], counts: list[int]) -> str:
    cells = "".join(f"{s:9.1f} s{m:5.2f} GiB" for s, m in zip(took, held, strict=True))
    return f"{name:14}{cells}{_exponents(took, counts)}"


def table(counts: list[int], runs: list[Summaries]) -> str:
    """Return the table of surveys of so many photographs as text."""
    lines = [f"{'photographs':14}" + "".join(f"{count:18}" for count in counts) + "    exponents"]
    took = {name: [seconds(run[name]) for run in runs] for name in STAGE_NAMES}
    held = {name: [(run[name]["peak_memory_bytes"] or 0) / 2**30 for run in runs] for name in STAGE_NAMES}
    lines += [_row(name, took[name], held[name], counts) for name in STAGE_NAMES]
    whole, most = ([f(of) for of in zip(*by.values(), strict=True)] for f, by in ((sum, took), (max, held)))
    lines.append(_row("whole", whole, most, counts))
    cells = {
        name: [run[name]["rows"] * run[name]["columns"] / 1e6 for run in runs] for name in ("surface", "orthophoto")
    }
    for name, sizes in cells.items():
        lines.append(f"{name + ', cells':20}" + "".join(f"{size:10.2f} million" for size in sizes)[6:])
    over = (
        f"{name} {_exponents(of, cells['orthophoto'])}"
        for name, of in (("whole", whole), ("orthophoto", took["orthophoto"]))
    )
    lines.append("exponents over cells of the orthophoto: " + ", ".join(over))
    return "\n".join(lines)


def main() -> int:
    """Measure every size and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--photographs", default="24,96,384", help="of the surveys, by commas")
    parser.add_argument("--seed", type=int, default=1, help="of the surveys")
    parser.add_argument("--keep", type=Path, help="keep the surveys here, and use those that are there")
    arguments = parser.parse_args()
    counts = [int(count) for count in arguments.photographs.split(",")]
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        runs = [processed(survey(folder / f"s{count}", count, arguments.seed)) for count in counts]
    print(table(counts, runs))
    return 0


if __name__ == "__main__":
    sys.exit(main())
