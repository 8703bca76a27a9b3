"""One survey in threads, in processes and on a local Dask cluster of one and two workers: seconds by stage, and bytes.

    python -m pip install "photogram[cluster]"
    python benchmarks/cluster.py [FOLDER] [--photographs 6] [--width 1600] [--keep DIRECTORY]

FOLDER is that of a survey with project.yaml, which is copied; without one a survey of twice so many photographs is
rendered, all products on. Runs, each anew from the photographs: threads (the reference), one thread, a cluster of one
and of two workers of one thread each, two processes (`--workers 2`), and the cluster of two again, of which one worker
is killed in every stage that works in pieces. Compiled kernels are there after the first, whose time does not count.
Every product and every intermediate file is compared, but for what a run says of its own time and memory.
"""

import argparse
import hashlib
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from photogram.machine import cores
from photogram.pipeline.pipeline import STAGES, load_project, run_pipeline
from photogram.pipeline.stage import Stage, Watcher
from photogram.pipeline.store.cluster import cluster
from photogram.pipeline.store.pools import Pool, ProcessPool
from photogram.pipeline.store.stage_summary import Summary
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.survey_plan import SurveyPlan

RUNS_DIFFER = ("stage.json", "report.json", "report.html", "checksums.sha256", "photogram.lock")
IN_PIECES = ("photographs", "features", "matches", "transfer", "dense", "surface", "orthophoto")
Kill = Callable[[], None]


@dataclass
class Seconds(Watcher):
    """A watcher that notes the seconds of every stage; ``kill`` is called once in each, at its first piece."""

    kill: Kill | None = None
    of_stage: dict[str, float] = field(default_factory=dict)
    killed: set[str] = field(default_factory=set)

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:  # noqa: ARG002
        """Have a worker killed when there is something left for it."""
        if self.kill is not None and stage.name in IN_PIECES and 0 < done < total and stage.name not in self.killed:
            self.killed.add(stage.name)
            self.kill()

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:  # noqa: ARG002
        """Note the seconds of a stage."""
        self.of_stage[stage.name] = seconds or 0.0

    def warn(self, text: str) -> None:
        """Say what is doubtful."""
        print(f"Warning: {text}", file=sys.stderr)


@dataclass(frozen=True)
class Outcome:
    """What one run took, by stage and in all, in s, what its processes computed, and the checksums of its files."""

    seconds: dict[str, float]
    processor_s: float
    files: dict[str, str]
    killed: int

    @property
    def total(self) -> float:
        """Return the seconds of all stages."""
        return sum(self.seconds.values())


def plan(photographs: int, width_px: int) -> SurveyPlan:
    """Return the plan of a rendered survey of two strips."""
    return SurveyPlan(
        width_px=width_px, height_px=width_px * 3 // 4, focal_px=1.5 * width_px, flying_height_m=60.0,
        forward_overlap=0.8, side_overlap=0.7, strips=2, photographs_per_strip=photographs, relief_m=6.0, buildings=6,
        trees=20, target_radius_m=0.3, control_points=6, check_points=6,
    )  # fmt: skip


@contextmanager
def workers(number: int) -> Iterator[tuple[Pool, Kill]]:
    """Give a local cluster, each worker a process of one thread, and what kills one of them."""
    import dask
    from distributed import LocalCluster

    with (
        # a local cluster closes for good what is being replaced a quarter of a minute after it was lost once
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1h"}),
        LocalCluster(
            n_workers=number, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=None
        ) as local,
        cluster(local.scheduler_address) as pool,
    ):

        def kill() -> None:
            pool.client.wait_for_workers(1)
            os.kill(min(pool.client.run(os.getpid).values()), signal.SIGKILL)

        yield pool, kill


def _processor_s() -> float:
    """Return the processor seconds of this process and of those it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def contents(folder: Path) -> dict[str, str]:
    """Return the checksums of all files that a run has written."""
    files = [p for part in ("work", "results") for p in sorted((folder / part).rglob("*")) if p.is_file()]
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in files
        if p.name not in RUNS_DIFFER
    }


def run(
    survey: Path, folder: Path, pool: Pool | None = None, executor: Executor | None = None, kill: Kill | None = None
) -> Outcome:
    """Run a copy of a survey from the beginning; ``kill`` is called in every stage."""
    shutil.copytree(survey, folder, ignore=shutil.ignore_patterns("work", "results"))
    watcher, began = Seconds(kill), _processor_s()
    run_pipeline(load_project(folder / "project.yaml"), watcher=watcher, pool=pool, executor=executor)
    return Outcome(watcher.of_stage, _processor_s() - began, contents(folder), len(watcher.killed))


def compare(survey: Path, room: Path) -> dict[str, Outcome]:
    """Run a survey in every way."""
    found = {"compiling": run(survey, room / "compiling"), "threads": run(survey, room / "threads")}
    with ThreadPoolExecutor(1) as one:
        found["one thread"] = run(survey, room / "one", executor=one)
    for number in (1, 2):
        with workers(number) as (pool, _):
            found[f"cluster of {number}"] = run(survey, room / f"cluster{number}", pool=pool)
    began = _processor_s()
    with ProcessPool(2) as pool:
        processes = run(survey, room / "processes", pool=pool)
    found["--workers 2"] = Outcome(processes.seconds, _processor_s() - began, processes.files, 0)
    with workers(2) as (pool, kill):
        found["2, killed"] = run(survey, room / "killed", pool=pool, kill=kill)
    return found


def show(found: dict[str, Outcome]) -> bool:
    """Print seconds by stage and whether all bytes are the same; returns whether they are."""
    names = [name for name in found if name != "compiling"]
    print(f"\n{'seconds':>14}" + "".join(f"{name:>14}" for name in names))
    for stage in STAGES:
        print(f"{stage.name:>14}" + "".join(f"{found[name].seconds.get(stage.name, 0.0):14.2f}" for name in names))
    print(f"{'all':>14}" + "".join(f"{found[name].total:14.2f}" for name in names))
    print(f"\nprocessor seconds: threads {found['threads'].processor_s:.1f}, --workers 2 "
          f"{found['--workers 2'].processor_s:.1f}")  # fmt: skip
    one, two = found["cluster of 1"], found["cluster of 2"]
    print(f"speed-up of two workers over one: {one.total / two.total:.2f}; of one over one thread: "
          f"{found['one thread'].total / one.total:.2f}")  # fmt: skip
    for name in IN_PIECES:
        if two.seconds.get(name, 0.0) > 0.5:
            print(f"  {name}: {one.seconds[name] / two.seconds[name]:.2f}")
    print(f"workers killed: {found['2, killed'].killed}")
    reference, same = found["compiling"].files, True
    for name in names:
        files = found[name].files
        differing = sorted(n for n in {**reference, **files} if reference.get(n) != files.get(n))
        print(f"{name}: {len(files)} files, {'the same bytes' if not differing else f'DIFFERENT: {differing[:5]}'}")
        same = same and not differing
    return same


def main() -> None:
    """Run the benchmark; exit with 1 where bytes differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--photographs", type=int, default=6, help="in each of two strips")
    parser.add_argument("--width", type=int, default=1600, help="of a photograph, px")
    parser.add_argument("--keep", type=Path, help="folder for the runs, which has to be new")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        room = chosen.keep or Path(temporary)
        survey = chosen.folder
        if survey is None:
            survey = room / "survey"
            write_demonstration(survey, 1, lambda *_: None, plan(chosen.photographs, chosen.width))
        began = time.monotonic()
        print(f"{cores()} cores; {survey}")
        same = show(compare(survey, room))
        print(f"{time.monotonic() - began:.0f} s in all")
    sys.exit(0 if same else 1)


if __name__ == "__main__":
    main()
