"""photogram's adjustment beside Ceres (pycolmap's bundle adjuster) on the same simulated blocks: seconds and memory.

    python -m pip install "photogram[bench]"
    python benchmarks/bundle_adjustment.py [PHOTOGRAPHS …] [--repeat 5] [--threads 1 2]

Observations are simulated, with 0.5 px noise and without mismatches, which would give the loss several minima, on 20
photographs with 10 000 tie points, 100 with 50 000 and 500 with 200 000, five to seven photographs a point. Both
engines minimise the same cost, image residuals under Huber's loss from 1.5 px on, over poses and points, once with
the calibration held and once with f, k1 and k2 free, from the same start: projection centres off by 0.5 m, attitudes
by 0.5°, points by 1 m, the focal length by 0.5 %.

Nothing in it fixes the datum. photogram leaves it to the damping. Ceres runs twice: `two held` is pycolmap's own gauge
(TWO_CAMS_FROM_WORLD), one photograph and a coordinate of another held where they start, so that the whole block has to
move to where these two put it; in `free gauge` nothing is held and the damping decides, as in photogram. `--settings`
tries other settings of Ceres with the free gauge; the table has those that were fastest, see CERES.

Every run has a process of its own that may use one processor or two, and the engines take turns. `seconds` are those,
from the call on, to the first cost within 1e-5 of the least that any engine reached: the best of the repetitions, and
their median. `steps` are those accepted until then, `refused` the others; `a step` is the best time over both. `ratio`
is that to the first row. `memory` is the peak above what the process held with the block's arrays loaded. `photogram`
solves the reduced system by a banded factor, `photogram (gtsam)` by GTSAM. Before anything is printed, costs must agree
to 1e-4 and projection centres, after a similarity, to a twentieth of the GSD. What compilation costs a first run is
measured apart.
"""

import argparse
import json
import multiprocessing
import os
import pickle
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.camera import oriented_by
from photogram.factors.covariance import covariances
from photogram.factors.elimination.bundle import BundleState, adjust_bundle
from photogram.factors.elimination.levenberg_marquardt import Damping
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.elimination.solvers import SolverName
from photogram.sfm.similarity import fit_similarity
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan
from photogram.survey import Block

BLOCKS = {20: (4, 5, 10_000), 100: (5, 20, 50_000), 500: (10, 50, 200_000)}
SIGMA_PX, THRESHOLD = 0.5, 3.0
WITHIN, AGREEMENT = 1e-5, 1e-4
NEAR_GSD = 0.05  # large self-calibrated blocks bend by more than that before their cost says so
TWO_HELD, FREE_GAUGE = "TWO_CAMS_FROM_WORLD", "UNSPECIFIED"


@dataclass(frozen=True, eq=False)
class Task:
    """A block to adjust: observations, where to start, and whether f, k1 and k2 are free."""

    observations: Observations
    start: BundleState
    block: Block
    gsd_m: float
    free: bool


@dataclass(frozen=True)
class CeresSettings:
    """How Ceres is run: pycolmap's gauge, its linear solver (None: as pycolmap chooses it) and the first radius of its
    trust region, whose inverse damps the first step."""

    gauge: str
    linear_solver: str | None = None
    radius: float = 1e4


@dataclass(frozen=True)
class Run:
    """What one engine did: seconds, cost (as photogram counts it) and refused attempts until every step accepted, and
    the result's centres."""

    seconds: list[float]
    costs: list[float]
    refused: list[int]
    memory_gb: float
    centres: list[list[float]]
    focal_px: float


def make_task(photographs: int, seed: int, *, free: bool) -> Task:
    """Simulate a block, and where to start."""
    strips, length, points = BLOCKS[photographs]
    plan = replace(
        whole_survey_plan(), strips=strips, photographs_per_strip=length, control_points=0, check_points=0,
        radial=(-0.08, 0.06, 0.0, 0.0), tangential=(0.0, 0.0),
    )  # fmt: skip  # what Ceres' model, COLMAP's RADIAL, has too: f, cx, cy, k1, k2
    made = simulate_block(
        plan, seed, tie_points=points, detection=0.6, sigma_px=SIGMA_PX,
        start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5,
    )  # fmt: skip
    tie, block = made.block.tie_points, made.block
    rng = np.random.default_rng(seed)
    camera = made.truth.camera
    approximate = replace(camera, focal_px=camera.focal_px * (1.005 if free else 1.0))
    start = BundleState(
        oriented_by([approximate], np.zeros(len(block.poses), np.int64), block.poses),
        made.tie_point_position_world_m + rng.standard_normal((len(tie), 3)),
    )
    observations = Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px)
    return Task(observations, start, block, plan.gsd_m, free)


def _memory_gb(kind: str) -> float:
    """Return VmRSS, what the process holds, or VmHWM, the most that it held since it began or since _forget_peak."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.startswith(kind)).split()[1]) * 1024 / 1e9


def _forget_peak() -> float:
    """Forget the peak so far and return what the process holds, GB."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _memory_gb("VmRSS")


class Clock:
    """Seconds since the start, the cost, and the attempts refused so far, of every step accepted."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self.costs: list[float] = []
        self.refused: list[int] = []
        self.refusals = 0
        self._began = time.perf_counter()

    def watch(self, _iteration: int, cost: float) -> None:
        """Note a step."""
        self.seconds.append(time.perf_counter() - self._began)
        self.costs.append(cost)
        self.refused.append(self.refusals)


def photogram(task: Task, solver: SolverName) -> Run:
    """Adjust with photogram."""
    q = task.start.parameters
    free = np.zeros(q.shape, dtype=bool)
    free[:, [0, 3, 4]] = task.free

    def solve(start: BundleState, observations: Observations, clock: Clock) -> BundleState:
        return adjust_bundle(
            observations, start, fixed_poses=np.zeros(len(start.position), dtype=bool), free=free,
            prior_sigma=np.full(q.shape, np.inf), prior_parameters=q, loss="huber", threshold=THRESHOLD,
            maximum_iterations=200, relative_tolerance=1e-7, watch=clock.watch, solver=solver,
        )  # fmt: skip

    few = task.observations.select(task.observations.point < 50)
    solve(task.start, few, Clock())  # loads what is compiled
    before, clock = _forget_peak(), Clock()
    with _refusals(clock):
        found = solve(task.start, task.observations, clock)
    memory, focal_px = _memory_gb("VmHWM") - before, float(found.parameters[0, 0])
    return Run(clock.seconds, clock.costs, clock.refused, memory, found.position.tolist(), focal_px)


@contextmanager
def _refusals(clock: Clock) -> Iterator[None]:
    """Count the steps that photogram's Levenberg–Marquardt refuses."""
    refuse = Damping.refuse

    def counted(damping: Damping) -> bool:
        clock.refusals += 1
        return refuse(damping)

    with mock.patch.object(Damping, "refuse", counted):
        yield


def _adjuster(task: Task, reconstruction: Any, settings: CeresSettings) -> tuple[Any, Any]:  # noqa: ANN401 - pycolmap has no types
    """Return pycolmap's bundle adjuster of a reconstruction, and options for Ceres."""
    import pyceres
    import pycolmap

    config = pycolmap.BundleAdjustmentConfig()
    for image in reconstruction.images:
        config.add_image(image)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.__members__[settings.gauge])
    if not task.free:
        config.set_constant_cam_intrinsics(1)
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.HUBER
    options.ceres.loss_function_scale = THRESHOLD * SIGMA_PX
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, reconstruction)
    chosen = options.ceres.create_solver_options(config, adjuster.problem)
    solving = pyceres.SolverOptions()
    for name in ("linear_solver_type", "sparse_linear_algebra_library_type", "dense_linear_algebra_library_type"):
        value = getattr(chosen, name)  # pycolmap's own types, of the same names
        setattr(solving, name, getattr(pyceres, type(value).__name__).__members__[value.name])
    if settings.linear_solver is not None:
        solving.linear_solver_type = pyceres.LinearSolverType.__members__[settings.linear_solver]
    if "ITERATIVE" in solving.linear_solver_type.name:
        solving.preconditioner_type = pyceres.PreconditionerType.SCHUR_JACOBI  # as pycolmap sets it
    solving.initial_trust_region_radius = settings.radius
    solving.max_num_iterations, solving.function_tolerance, solving.num_threads = 200, 1e-7, _processors()
    solving.gradient_tolerance, solving.parameter_tolerance = 0.0, 0.0
    solving.logging_type = pyceres.LoggingType.SILENT
    return adjuster, solving


def ceres(task: Task, settings: CeresSettings) -> Run:
    """Adjust with pycolmap's bundle adjuster, solved by Ceres."""
    import pyceres
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)  # and it is loaded before memory is measured

    class Watch(pyceres.IterationCallback):  # type: ignore[misc]
        def __init__(self, clock: Clock) -> None:
            super().__init__()
            self.clock = clock

        def __call__(self, summary: Any) -> Any:  # noqa: ANN401 - pyceres has no types
            if summary.iteration > 0 and summary.step_is_successful:
                self.clock.watch(summary.iteration, summary.cost / SIGMA_PX**2)
            elif summary.iteration > 0:
                self.clock.refusals += 1
            return pyceres.CallbackReturnType.SOLVER_CONTINUE

    before, reconstruction = _forget_peak(), _reconstruction(task)
    adjuster, solving = _adjuster(task, reconstruction, settings)
    summary, clock = pyceres.SolverSummary(), Clock()
    watch = Watch(clock)
    solving.callbacks = [watch]
    pyceres.solve(solving, adjuster.problem, summary)
    images = [reconstruction.images[i] for i in sorted(reconstruction.images)]
    centres = [image.projection_center().tolist() for image in images]
    focal_px = float(reconstruction.cameras[1].params[0])
    return Run(clock.seconds, clock.costs, clock.refused, _memory_gb("VmHWM") - before, centres, focal_px)


def photogram_covariances(task: Task) -> dict[str, float]:
    """Return the seconds of five iterations, and of the covariances of all poses, the calibration and all points."""
    block = replace(task.block, tie_points=replace(task.block.tie_points, position_world_m=task.start.point))
    problem = make_problem(block, AdjustmentSettings())
    state = start_state(problem)
    covariances(problem, minimise(problem, state, AdjustmentSettings(maximum_iterations=2)).state)
    began = time.perf_counter()
    found = minimise(problem, state, AdjustmentSettings(maximum_iterations=5))
    middle = time.perf_counter()
    covariances(problem, found.state)
    return {"five iterations": middle - began, "covariances": time.perf_counter() - middle}


def ceres_covariances(task: Task) -> dict[str, float]:
    """Return the seconds of pycolmap's covariances of all poses and all points."""
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    reconstruction = _reconstruction(task)
    adjuster, _ = _adjuster(task, reconstruction, CeresSettings(TWO_HELD))
    options = pycolmap.BACovarianceOptions()
    options.params = pycolmap.BACovarianceOptionsParams.POSES_AND_POINTS
    began = time.perf_counter()
    if pycolmap.estimate_ba_covariance(options, reconstruction, adjuster) is None:
        raise SystemExit("pycolmap could not compute covariances")
    return {"covariances": time.perf_counter() - began}


def _reconstruction(task: Task) -> Any:  # noqa: ANN401 - pycolmap has no types
    import pycolmap

    o, s = task.observations, task.start
    q, reconstruction = s.parameters[0], pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="RADIAL", width=task.block.cameras[0].width_px, height=task.block.cameras[0].height_px,
        params=[q[0], q[1] + 0.5, q[2] + 0.5, q[3], q[4]], camera_id=1,
    )  # fmt: skip
    reconstruction.add_camera_with_trivial_rig(camera)
    order = np.argsort(o.photograph, kind="stable")
    edges = np.searchsorted(o.photograph[order], np.arange(len(s.position) + 1))
    place = np.empty(len(o), np.int64)
    for i in range(len(s.position)):
        rays = order[edges[i] : edges[i + 1]]
        place[rays] = np.arange(len(rays))
        rotation = s.rotation[i].T
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ s.position[i])
        image = pycolmap.Image(f"{i}", o.pixel[rays] + 0.5, 1, i + 1)
        reconstruction.add_image_with_trivial_frame(image, pose)
    first = np.searchsorted(o.point, np.arange(len(s.point) + 1))
    for p, position in enumerate(s.point):
        track = pycolmap.Track()
        for k in range(first[p], first[p + 1]):
            track.add_element(int(o.photograph[k]) + 1, int(place[k]))
        reconstruction.add_point3D(position, track)
    return reconstruction


CERES = {
    "Ceres, two held": CeresSettings(TWO_HELD),
    "Ceres, free gauge": CeresSettings(FREE_GAUGE),
}
"""Ceres as the table has it: pycolmap's choice of the linear solver and Ceres' own first radius."""

TRIED = {
    f"{solver or 'as pycolmap'}, {radius:.0e}": CeresSettings(FREE_GAUGE, solver, radius)
    for solver in (None, "DENSE_SCHUR", "SPARSE_SCHUR", "ITERATIVE_SCHUR")
    for radius in (1e4, 1e6)
}
"""What `--settings` compares: linear solvers, and first radii."""

ENGINES: dict[str, Callable[[Task], Run]] = {
    "photogram": lambda task: photogram(task, "banded"),
    "photogram (gtsam)": lambda task: photogram(task, "gtsam"),
    **{name: partial(ceres, settings=settings) for name, settings in (CERES | TRIED).items()},
}
SHOWN = [name for name in ENGINES if name not in TRIED]


def _processors() -> int:
    return len(os.sched_getaffinity(0))


def _work(path: str, engine: str, task_path: str, processors: int) -> None:
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:processors])
    run = ENGINES[engine](pickle.loads(Path(task_path).read_bytes()))
    Path(path).write_text(json.dumps(run.__dict__), encoding="utf-8")


def _in_a_process_of_its_own(target: Callable[..., None], *arguments: object) -> None:
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments)
    process.start()
    process.join()
    if process.exitcode != 0:
        raise SystemExit(f"{target.__name__}{arguments} ended with exit code {process.exitcode}")


def _seconds(path: str, engine: str, task_path: str) -> None:
    work = photogram_covariances if engine == "photogram" else ceres_covariances
    Path(path).write_text(json.dumps(work(pickle.loads(Path(task_path).read_bytes()))), encoding="utf-8")


def compare_covariances(folder: Path, photographs: int) -> None:
    """Print how long the covariances of all poses, the calibration and all points take."""
    path, result = folder / "task.pickle", folder / "seconds"
    path.write_bytes(pickle.dumps(make_task(photographs, 1, free=True)))
    print(f"\ncovariances of {photographs} photographs and {BLOCKS[photographs][2]} points, {_processors()} threads")
    for engine in ("photogram", "Ceres"):
        _in_a_process_of_its_own(_seconds, str(result), engine, str(path))
        seconds = json.loads(result.read_text(encoding="utf-8"))
        print(f"{engine:<18}" + ", ".join(f"{name} {value:.2f} s" for name, value in seconds.items()), flush=True)


def run_engine(folder: Path, engine: str, task: Path, processors: int) -> Run:
    """Run one engine on one task, in a process of its own."""
    result = folder / "run.json"
    _in_a_process_of_its_own(_work, str(result), engine, str(task), processors)
    return Run(**json.loads(result.read_text(encoding="utf-8")))


def _first_run(path: str) -> None:
    task = make_task(20, 1, free=True)
    few, q = task.observations.select(task.observations.point < 50), task.start.parameters
    began = time.perf_counter()
    adjust_bundle(
        few, task.start, fixed_poses=np.zeros(20, dtype=bool), free=np.zeros(q.shape, dtype=bool),
        prior_sigma=np.full(q.shape, np.inf), prior_parameters=q, maximum_iterations=2,
    )  # fmt: skip
    Path(path).write_text(str(time.perf_counter() - began), encoding="utf-8")


def compilation(folder: Path) -> tuple[float, float]:
    """Return the seconds of the first adjustment of a process, without and with compiled kernels on disk."""
    result, seconds = folder / "seconds", []
    os.environ["NUMBA_CACHE_DIR"] = str(folder / "cache")
    for _ in range(2):
        _in_a_process_of_its_own(_first_run, str(result))
        seconds.append(float(result.read_text(encoding="utf-8")))
    del os.environ["NUMBA_CACHE_DIR"]
    return seconds[0], seconds[1]


def reached(run: Run, least: float) -> tuple[float, int, int]:
    """Return the seconds, the steps and the refused attempts to the first cost within WITHIN of ``least``."""
    rows = zip(run.seconds, run.costs, run.refused, strict=True)
    for step, (seconds, cost, refused) in enumerate(rows, start=1):
        if cost <= least * (1.0 + WITHIN):
            return seconds, step, refused
    return float("nan"), len(run.costs), run.refused[-1] if run.refused else 0


def check_same_answer(task: Task, runs: dict[str, Run]) -> None:
    """End the benchmark unless all engines reached one minimum."""
    costs = {engine: run.costs[-1] for engine, run in runs.items()}
    if max(costs.values()) > min(costs.values()) * (1.0 + AGREEMENT):
        raise SystemExit(f"the engines do not agree on the cost: {costs}")
    reference = np.array(next(iter(runs.values())).centres)
    for engine, run in runs.items():
        found = np.array(run.centres)
        rms = float(np.sqrt(np.mean(np.sum((fit_similarity(found, reference).points(found) - reference) ** 2, axis=1))))
        if rms > NEAR_GSD * task.gsd_m:
            raise SystemExit(f"{engine}: projection centres differ by {rms:.4f} m")


def compare(
    folder: Path,
    photographs: int,
    *,
    free: bool,
    repeat: int,
    threads: list[int],
    engines: list[str],
) -> None:
    """Run all engines on one block, in turn, and print their rows."""
    path = folder / "task.pickle"
    path.write_bytes(pickle.dumps(make_task(photographs, 1, free=free)))
    task: Task = pickle.loads(path.read_bytes())
    for processors in threads:
        runs: dict[str, list[Run]] = {engine: [] for engine in engines}
        for _ in range(repeat):
            for engine in engines:  # in turn, so that none has the quiet minutes alone
                runs[engine].append(run_engine(folder, engine, path, processors))
        check_same_answer(task, {engine: found[0] for engine, found in runs.items()})
        least = min(run.costs[-1] for found in runs.values() for run in found)
        first = min(reached(run, least)[0] for run in runs[engines[0]])
        for engine, found in runs.items():
            seconds = [reached(run, least)[0] for run in found]
            _, steps, refused = reached(found[0], least)
            print(
                f"{photographs:11d}{len(task.observations):14d}  {'free' if free else 'held':<12}{processors:7d}  "
                f"{engine:<24}{min(seconds):8.2f}{np.median(seconds):8.2f}{min(seconds) / first:7.1f}{steps:7d}"
                f"{refused:9d}{1e3 * min(seconds) / (steps + refused):12.0f}{found[0].memory_gb:13.2f}"
                f"{found[0].costs[-1]:14.2f}",
                flush=True,
            )


def main() -> None:
    """Compare all blocks and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("photographs", nargs="*", type=int, default=list(BLOCKS), choices=list(BLOCKS))
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--engines", nargs="+", default=SHOWN, choices=list(ENGINES))
    parser.add_argument("--settings", action="store_true", help="compare settings of Ceres with the free gauge")
    arguments = parser.parse_args()
    engines = ["photogram", *TRIED] if arguments.settings else arguments.engines
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, cached = compilation(folder)
        print(
            f"first adjustment of a machine, compiling: {first:.1f} s; of a process, from the cache: {cached:.2f} s\n"
        )
        print(
            f"{'photographs':>11}{'observations':>14}  {'calibration':<12}{'threads':>7}  {'engine':<24}{'seconds':>8}"
            f"{'median':>8}{'ratio':>7}{'steps':>7}{'refused':>9}{'a step, ms':>12}{'memory, GB':>13}{'final cost':>14}"
        )
        for photographs in arguments.photographs:
            for free in (False, True):
                compare(
                    folder, photographs, free=free, repeat=arguments.repeat,
                    threads=arguments.threads, engines=engines,
                )  # fmt: skip
        if not arguments.settings:
            compare_covariances(folder, max(arguments.photographs))


if __name__ == "__main__":
    main()
