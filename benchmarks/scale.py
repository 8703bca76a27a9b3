"""Seconds and peak memory of orientation and adjustment against the number of photographs.

    python benchmarks/scale.py [PHOTOGRAPHS …] [--observations 2000] [--seed 1]       default: 100 300 1000

Simulated observations without rendering, consumer GNSS (2 m), EXIF focal length, 80/70 % overlap, about 2000 image
points a photograph, 0.5 px noise, 2 % mismatches. Three tasks, each in a process of its own:

    growth      orientation from tie points alone: neither position nor attitude helps it find a pose
    direct      orientation from GNSS position and attitude, verified by the tie points
    adjustment  the joint adjustment with outlier rounds and covariances, from poses off by 0.3 m and 0.3°

The exponent is the slope of log seconds, or log memory, over log photographs: 1 is linear. Memory is the peak of the
process, that before the task (program and block alone) in the column before it. `centres` is the RMS error of the
projection centres after a similarity: of a start in the first two tasks, of the result in the third.
"""

import argparse
import json
import multiprocessing
import pickle
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.camera import Pose
from photogram.sfm.orientation import OrientationSettings, orient
from photogram.sfm.similarity import fit_similarity
from photogram.simulation.simulated_survey import SimulatedBlock, simulate_block, whole_survey_plan
from photogram.survey import Block

SIDES = {100: (5, 20), 300: (10, 30), 1000: (20, 50), 2000: (8, 250)}
DETECTION = 0.4
WARM_UP = 12


@dataclass(frozen=True)
class Measurement:
    """One task on one block; ``centre_rms_m`` is that of the registered projection centres after a similarity."""

    photographs: int
    observations: int
    seconds: float
    block_memory_gb: float
    peak_memory_gb: float
    registered: int
    centre_rms_m: float


def _peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def _block(photographs: int, observations: int, seed: int) -> SimulatedBlock:
    """Simulate a block of about ``observations`` image points a photograph."""
    strips, length = SIDES.get(photographs) or (max(2, round((photographs / 2.5) ** 0.5)), 0)
    plan = replace(
        whole_survey_plan(),
        strips=strips,
        photographs_per_strip=length or -(-photographs // strips),
        control_points=0,
        check_points=0,
    )
    # the fewer photographs, the more of them lie at the edge, where points are seen less often
    rays = float(simulate_block(plan, seed, tie_points=2000, detection=DETECTION).block.tie_points.rays.mean())
    return simulate_block(
        plan, seed, tie_points=round(photographs * observations / rays), detection=DETECTION, mismatches=0.02,
        start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3,
    )  # fmt: skip


def _without_attitude(block: Block) -> Block:
    bare = (replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None) for p in block.photographs)
    return replace(block, photographs=tuple(bare))


def _growth(block: Block) -> tuple[Pose | None, ...]:
    return orient(replace(_without_attitude(block), poses=(None,) * len(block.poses)), OrientationSettings()).poses


def _direct(block: Block) -> tuple[Pose | None, ...]:
    bare = replace(block, poses=(None,) * len(block.poses))
    return orient(bare, OrientationSettings(method="attitude")).poses


def _adjustment(block: Block) -> tuple[Pose | None, ...]:
    return adjust(block, AdjustmentSettings()).block.poses


TASKS: dict[str, Callable[[Block], tuple[Pose | None, ...]]] = {
    "growth": _growth,
    "direct": _direct,
    "adjustment": _adjustment,
}


def _simulate(path: Path, photographs: int, observations: int, seed: int) -> None:
    path.write_bytes(pickle.dumps(_block(photographs, observations, seed)))


def _measure(path: Path, task: str, simulated_path: Path, warm_up_path: Path) -> None:
    TASKS[task](pickle.loads(warm_up_path.read_bytes()).block)  # compiles what is compiled
    simulated: SimulatedBlock = pickle.loads(simulated_path.read_bytes())
    block, before = simulated.block, _peak_gb()
    began = time.perf_counter()
    poses = TASKS[task](block)
    seconds = time.perf_counter() - began
    pairs = [(p, t) for p, t in zip(poses, simulated.truth.poses, strict=True) if p is not None]
    found, true = (np.array([pair[k].position_world_m for pair in pairs]) for k in (0, 1))
    error = fit_similarity(found, true).points(found) - true
    rms = float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    count = len(block.tie_points.photograph)
    value = Measurement(len(poses), count, seconds, before, _peak_gb(), len(pairs), rms)
    path.write_text(json.dumps(value.__dict__), encoding="utf-8")


def _in_a_process_of_its_own(work: Callable[..., None], *arguments: object) -> None:
    process = multiprocessing.get_context("spawn").Process(target=work, args=arguments)
    process.start()
    process.join()
    if process.exitcode != 0:
        raise SystemExit(f"{work.__name__}{arguments} ended with exit code {process.exitcode}")


def measure(folder: Path, task: str, photographs: int, observations: int, seed: int) -> Measurement:
    """Run one task in a process of its own; blocks are simulated in another, once, and kept in ``folder``."""
    paths = []
    for count in (photographs, WARM_UP):
        paths.append(folder / f"{count}.pickle")
        if not paths[-1].is_file():
            _in_a_process_of_its_own(_simulate, paths[-1], count, observations, seed)
    result = folder / "measurement.json"
    _in_a_process_of_its_own(_measure, result, task, *paths)
    return Measurement(**json.loads(result.read_text(encoding="utf-8")))


def exponent(photographs: list[int], values: list[float]) -> float:
    """Return the least-squares slope of log values over log photographs."""
    return float(np.polyfit(np.log(photographs), np.log(values), 1)[0])


def main() -> None:
    """Measure every task on every block and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("photographs", nargs="*", type=int, default=list(SIDES))
    parser.add_argument("--observations", type=int, default=2000, help="image points of a photograph, about")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=list(TASKS), help="measure this task alone")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        table(Path(folder), arguments)


def table(folder: Path, arguments: argparse.Namespace) -> None:
    """Measure what the arguments ask for, and print it."""
    print("task        photographs  observations  seconds  block (GB)  peak (GB)  registered  centres (m)")
    for task in [arguments.only] if arguments.only else TASKS:
        rows = []
        for photographs in arguments.photographs:
            m = measure(folder, task, photographs, arguments.observations, arguments.seed)
            rows.append(m)
            print(
                f"{task:<12}{m.photographs:11d}{m.observations:14d}{m.seconds:9.1f}{m.block_memory_gb:12.2f}"
                f"{m.peak_memory_gb:11.2f}{m.registered:12d}{m.centre_rms_m:13.3f}",
                flush=True,
            )
        if len(rows) > 1:
            sizes = [m.photographs for m in rows]
            seconds = exponent(sizes, [m.seconds for m in rows])
            memory = exponent(sizes, [m.peak_memory_gb for m in rows])
            print(f"{task:<12}exponent: seconds {seconds:.2f}, peak memory {memory:.2f}", flush=True)


if __name__ == "__main__":
    main()
