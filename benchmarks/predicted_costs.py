"""Predicted beside measured time, disk and memory of whole surveys, stage by stage.

    python benchmarks/predicted_costs.py [--sizes small,medium,large,whole] [--seed 1] [--workers N]
    python benchmarks/predicted_costs.py --project PROJECT

Each survey is simulated and rendered (SIZES: photographs, their size, default settings with dense surface and
orthophoto), predicted as `photogram check` predicts what is worth a test of the machine, and then processed in a
process of its own; PROJECT is processed into folders that are removed again. `factor`: measured over predicted. The
last lines are those of the whole command; time without what kernels took to compile, which is predicted and printed
apart, memory the most of any stage, disk what is left in the folders of work and results.

Nothing is kept between the surveys, so that no prediction rests on a measurement of the same survey. `processor`: time
of all threads, on a machine as fast as the one where the rates were measured and on this one, whatever else it does.
`disk` by stage is what the stage left in the working folder, for the report what lies among the results.
"""

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path

from photogram.files.npz_json import write_json
from photogram.machine import cores
from photogram.pipeline.costs.forecast import forecast
from photogram.pipeline.costs.rates import predicted_seconds
from photogram.pipeline.costs.self_test import Speed, measured_speed
from photogram.pipeline.costs.workload import workload
from photogram.pipeline.input_validation import tags_of
from photogram.pipeline.pipeline import STAGES, load_project, run_pipeline
from photogram.pipeline.stage import Stage, Watcher
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.pipeline.store.stage_summary import StageNote, Summary
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.simulated_survey import whole_survey_plan

SIZES = {
    "small": (2, 3, 800, 600),
    "medium": (3, 5, 1200, 900),
    "large": (4, 8, 1800, 1350),
    "whole": (10, 20, 2592, 1944),
}
"""Strips, photographs in each, width and height of a photograph in px."""

USUAL = "small,medium,large"
"""What runs where nothing else is asked for: `whole` takes a quarter of an hour."""

AIM = 1.5
"""The factor that a prediction of the whole command is meant to keep."""


class ProcessorTime(Watcher):
    """Notes the processor time of each stage, all threads together."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def begin(self, stage: Stage) -> None:
        """Start a stage."""
        self.seconds[stage.name] = -time.process_time()

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:  # noqa: ARG002
        """End a stage."""
        self.seconds[stage.name] += time.process_time()


def _project(path: Path, folder: Path) -> Project:
    return replace(load_project(path), work=folder / "work", results=folder / "results")


def _measure(path: Path, folder: Path, workers: int) -> None:
    """Predict a survey, process it, and write both figures beside it; in a process of its own."""
    project = _project(path, folder)
    tags, speed = tags_of(project), measured_speed(workers)
    predicted = forecast(STAGES, project, tags, speed, workers)
    watcher = ProcessorTime()
    with ThreadPoolExecutor(workers) as executor:
        run_pipeline(project, watcher=watcher, executor=executor)
    plain = predicted_seconds(STAGES, workload(project, tags), Speed(), 1)
    note = {
        "processor": {stage: (plain[stage], watcher.seconds[stage]) for stage in STAGE_NAMES},
        "speed": asdict(speed),
        "work": asdict(workload(project, tags)),
        "stages": [asdict(cost) for cost in predicted.stages],
        "disk_bytes": predicted.disk_bytes,
    }
    write_json(folder / "predicted.json", note)


def _bytes(folder: Path) -> int:
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file())


def _row(name: str, *pairs: tuple[float, float]) -> str:
    """Return a line of predicted and measured figures with their ratio, none where both are small."""
    cells = []
    for predicted, measured in pairs:
        factor = f"{measured / predicted:7.2f}" if predicted > 0 and max(predicted, measured) >= 1.0 else "      –"
        cells.append(f"{predicted:9.1f}{measured:9.1f}{factor}")
    return f"{name:14}" + "  ".join(cells)


def show(title: str, folder: Path) -> float:
    """Print predicted beside measured figures of a processed survey; returns the factor of its time."""
    note = json.loads((folder / "predicted.json").read_text(encoding="utf-8"))
    predicted, workspace = {c["stage"]: c for c in note["stages"]}, Workspace(folder / "work")
    print(f"\n{title}")
    for part in ("work", "speed"):
        print("  " + ", ".join(f"{name} {value:.4g}" for name, value in note[part].items()))
    headings = ("time, s", "disk, MB", "memory, MB", "processor, s")
    print(" " * 14 + "  ".join(f"{heading:>18}{'factor':>7}" for heading in headings))
    rows = []
    for stage in STAGE_NAMES:
        said, told = workspace.summary(stage, StageNote), predicted[stage]
        compiling = said.get("compilation_seconds", 0.0)
        place = folder / "results" if stage == "results" else workspace.stage(stage)
        seconds = (told["seconds"] - told["compilation_seconds"], said["seconds"] - compiling)
        disk = (told["disk_bytes"] / 1e6, _bytes(place) / 1e6)
        memory = (told["memory_bytes"] / 1e6, (said["peak_memory_bytes"] or 0) / 1e6)
        rows.append((seconds, disk, memory, (told["compilation_seconds"], compiling)))
        processor = note["processor"][stage]
        print(
            _row(stage, *rows[-1][:3], (processor[0], processor[1] - compiling))
            + (f"  compiled for {compiling:.1f} s" if compiling > 0 else "")
        )
    whole, compilation = ((sum(row[k][0] for row in rows), sum(row[k][1] for row in rows)) for k in (0, 3))
    left = (note["disk_bytes"] / 1e6, (_bytes(folder / "work") + _bytes(folder / "results")) / 1e6)
    most = (max(row[2][0] for row in rows), max(row[2][1] for row in rows))
    print(_row("whole", whole, left, most))
    print(_row("compilation", compilation))
    return float(whole[1] / whole[0])


def main() -> int:
    """Measure every size, or a project, and print the tables; returns 1 where a time is off by more than AIM."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", default=USUAL, help="of the simulated surveys, by commas")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated surveys")
    parser.add_argument("--workers", type=int, default=cores(), help="threads at once")
    parser.add_argument("--project", type=Path, help="a project file, in place of simulated surveys")
    arguments = parser.parse_args()
    factors = []
    for name in [str(arguments.project)] if arguments.project else arguments.sizes.split(","):
        with tempfile.TemporaryDirectory() as temporary:
            folder, path, title = Path(temporary), arguments.project, name
            if path is None:
                strips, each, width, height = SIZES[name]
                focal_px = 1.5 * width
                plan = replace(
                    whole_survey_plan(), strips=strips, photographs_per_strip=each, width_px=width, height_px=height,
                    focal_px=focal_px,
                )  # fmt: skip
                path = write_demonstration(folder / "survey", arguments.seed, lambda *_: None, plan)
                title = f"{name}: {strips * each} photographs of {width} × {height} px"
            work = (path.absolute(), folder, arguments.workers)
            process = multiprocessing.get_context("spawn").Process(target=_measure, args=work)
            process.start()
            process.join()
            if process.exitcode != 0:
                raise SystemExit(f"{name}: ended with exit code {process.exitcode}")
            factors.append(show(title, folder))
    return int(any(not 1 / AIM <= factor <= AIM for factor in factors))


if __name__ == "__main__":
    sys.exit(main())
