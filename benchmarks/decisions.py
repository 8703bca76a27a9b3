"""What it takes to decide what is in the model and what is wrong: solutions, iterations over all rays, and time.

    python benchmarks/decisions.py [SURVEYS] [--kinds NAME,NAME] [--beside FOLDER] [--real]          default: 2 of each

Simulated observations without rendering: blocks of 12 to 300 photographs with errors that all photographs share, with
blunders, with a wrong focal length, a rolling shutter, a pattern of the lens, or control points whose accuracy nobody
states. `--real` adds brighton_beach, sheffield_cross (from photographs to transfer, by `photogram init`) and dbat_sxb
of the shared data, where they are there. `--beside` names another checkout of photogram, an earlier one as a rule: it
does the same in processes of its own, kind by kind in turn.

solutions    runs of Levenberg–Marquardt within the decisions: data snooping and lens fields, as the stage `adjustment`
             makes them
iterations   of these, each counted by the share of the block's observations of tie points that took part: thinned
             blocks count in part, those whose tie points are a summary not at all
decisions    seconds of all that, tests and covariances included
once         seconds of one adjustment of the block from its start, the best of three, without data snooping
ratio        of the two
right        blunders that were rejected, of those there are; a mark by itself, a control point as a whole
wrong        measurements that were rejected and are none; of real surveys what was rejected, since nobody knows

Each figure is the median over the surveys of a kind, blunders are sums. What is counted is counted in this script,
around the engine's function, the same in every version. One process at a time (`--workers`), of one thread.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from unittest.mock import patch

import assumed_control
import lens_field
import numpy as np
from lib import dbat, study
from lib.shared_data import SHARED_DATA

from photogram.adjustment import problem as problems
from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.errors import PhotogramError
from photogram.factors.elimination.levenberg_marquardt import Minimum
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.minimisation import minimise_problem
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages import adjustment as stage
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block
from photogram.wording import silent

SETTINGS = AdjustmentSettings()
Name = tuple[str, str]
"""Kind and name of a measurement; of a mark its point and its photograph."""
Simulated = tuple[Block, frozenset[Name]]
"""A block and its blunders."""

RTK_M, CONSUMER_M = (0.02, 0.02, 0.03), (2.0, 2.0, 3.0)
KNOWN = (5.0, 0.2, 0.2, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
RTK = SurveyPlan(
    strips=4, photographs_per_strip=8, focal_px=1500.0, forward_overlap=0.82, side_overlap=0.8, crossing=True,
    control_points=0, check_points=6, gnss_sigma_m=RTK_M, gnss_offset_sigma_m=(0.0, 0.0, 0.0), attitude_sigma_deg=2.0,
    speed_m_s=8.0, headwind_m_s=2.0, calibration_sigmas=KNOWN,
)  # fmt: skip
CONSUMER = replace(
    RTK, strips=6, photographs_per_strip=10, forward_overlap=0.75, side_overlap=0.65, crossing=False,
    gnss_sigma_m=CONSUMER_M, calibration_sigmas=SurveyPlan().calibration_sigmas,
)  # fmt: skip
SHARED = replace(RTK, lever_arm_m=(0.0, 0.05, 0.0), heading_error_deg=3.0)
CONTROL = replace(
    CONSUMER, strips=5, photographs_per_strip=8, gnss_tags=False, gnss_sigma_m=RTK_M, control_points=10, check_points=6
)
KITE = replace(
    CONTROL, strips=3, photographs_per_strip=8, control_points=5, position_noise_m=4.0, attitude_noise_deg=8.0,
    mark_sigma_px=1.0, control_sigma_m=(0.03, 0.03, 0.05),
)  # fmt: skip
MIXED = replace(CONTROL, gnss_tags=True, forward_overlap=0.8)
SHUTTER = replace(
    whole_survey_plan(1600), crossing=True, strips=4, photographs_per_strip=6, control_points=6, speed_m_s=8.0,
    gnss_sigma_m=RTK_M, gnss_offset_sigma_m=(0.0, 0.0, 0.0), readout_s=0.033, readout_sigma_s=0.03,
)  # fmt: skip
TAG = replace(whole_survey_plan(), focal_tag_factor=1.1)
STALE = 0.3
"""Share of the photographs whose position is that of the photograph before."""
FEW_MARKS = 3
"""Marks of each control point of the kite."""


# ---- surveys ---------------------------------------------------------------------------------------------------------


def simulated(plan: SurveyPlan, tie_points: int, seed: int) -> Simulated:
    """Simulate a survey without blunders."""
    made = simulate_block(
        plan, seed, tie_points=tie_points, sigma_px=0.4, mismatches=0.02, start_position_sigma_m=0.3,
        start_attitude_sigma_deg=0.3,
    )  # fmt: skip
    return made.block, frozenset()


def few_marks(seed: int) -> Simulated:
    """Simulate a kite's photographs, with few marks of few points."""
    block, none = simulated(KITE, 3000, seed)
    points, rng = block.control_points, np.random.default_rng([seed, 21])
    kept = np.zeros(len(points.mark_point), dtype=bool)
    for g in range(len(points)):
        own = np.flatnonzero(points.mark_point == g)
        kept[rng.choice(own, min(FEW_MARKS, len(own)), replace=False)] = True
    few = {
        name: getattr(points, name)[kept]
        for name, value in vars(points).items()
        if name.startswith("mark_") and isinstance(value, np.ndarray) and len(value) == len(kept)
    }
    return replace(block, control_points=replace(points, **few)), none


def with_blunders(count: int, seed: int) -> Simulated:
    """Simulate a survey with so many blunders: heights and plan coordinates of control points, marks, positions."""
    block, _ = simulated(MIXED, 4000, seed)
    rng, points, photographs = np.random.default_rng([seed, 22]), block.control_points, list(block.photographs)
    position, pixel, names = points.position_world_m.copy(), points.mark_pixel.copy(), set[Name]()
    own = rng.permutation(np.flatnonzero(np.array(points.role) == "control")).tolist()
    others = rng.permutation(len(photographs)).tolist()
    off_m = np.array([5.0, 3.0, 0.0])
    for n in range(count):
        kind = ("height", "mark", "position", "plan")[(n + seed) % 4]
        g, sign = own[n], float(rng.choice([-1.0, 1.0]))
        if kind == "mark":
            m = int(rng.choice(np.flatnonzero(points.mark_point == g)))
            pixel[m] += 30.0 * sign
            names.add(("mark", f"{points.name[g]} {photographs[points.mark_photograph[m]].name}"))
        elif kind == "position":
            photograph = photographs[others[n]]
            assert photograph.gnss_world_m is not None
            photographs[others[n]] = replace(photograph, gnss_world_m=photograph.gnss_world_m + off_m * sign)
            names.add(("GNSS position", photograph.name))
        else:
            position[g, 2 if kind == "height" else 0] += sign
            names.add(("control point", points.name[g]))
    points = replace(points, position_world_m=position, mark_pixel=pixel)
    return replace(block, control_points=points, photographs=tuple(photographs)), frozenset(names)


def stale_positions(seed: int) -> Simulated:
    """Simulate a survey whose receiver repeats the position before, in some photographs."""
    block, _ = simulated(MIXED, 4000, seed)
    rng, photographs = np.random.default_rng([seed, 23]), list(block.photographs)
    stale = rng.choice(np.arange(1, len(photographs)), round(STALE * len(photographs)), replace=False)
    for i in stale.tolist():
        photographs[i] = replace(photographs[i], gnss_world_m=block.photographs[i - 1].gnss_world_m)
    names = frozenset(("GNSS position", photographs[i].name) for i in stale.tolist())
    return replace(block, photographs=tuple(photographs)), names


def wrong_tag(seed: int) -> Simulated:
    """Simulate a survey whose tags give a focal length that is too long."""
    block, _ = simulated(TAG, 2000, seed)
    return block, frozenset({("focal length", block.cameras[0].name)})


def lens_pattern(seed: int) -> Simulated:
    """Simulate a survey whose lens no camera model describes."""
    return lens_field.survey("96", "lens", seed).block, frozenset()


def hand_held(seed: int) -> Simulated:
    """Simulate control points of a hand-held receiver, whose sigmas are assumed."""
    block, none = simulated(replace(assumed_control.PLAN, control_sigma_m=(2.0, 2.0, 2.0)), 1500, seed)
    points = block.control_points
    points = replace(points, sigma_m=np.tile(assumed_control.ASSUMED_M, (len(points), 1)))
    if hasattr(points, "sigma_assumed"):  # an earlier photogram takes them for stated
        points = replace(points, sigma_assumed=np.ones(len(points), dtype=bool))
    return replace(block, control_points=points), none


def grid(strips: int, per_strip: int, tie_points: int, seed: int) -> Simulated:
    """Simulate RTK with control points on so many photographs."""
    plan = replace(MIXED, strips=strips, photographs_per_strip=per_strip, gnss_offset_sigma_m=(0.3, 0.3, 0.5))
    return simulated(plan, tie_points, seed)


KINDS: dict[str, Callable[[int], Simulated]] = {
    "RTK, arm and compass": partial(simulated, SHARED, 35_000),
    "consumer GNSS": partial(simulated, CONSUMER, 5000),
    "control only": partial(simulated, CONTROL, 4000),
    "kite, few marks": few_marks,
    "1 blunder": partial(with_blunders, 1),
    "2 blunders": partial(with_blunders, 2),
    "3 blunders": partial(with_blunders, 3),
    "5 blunders": partial(with_blunders, 5),
    "stale positions": stale_positions,
    "wrong focal tag": wrong_tag,
    "rolling shutter": partial(simulated, SHUTTER, 2000),
    "lens pattern": lens_pattern,
    "hand-held control": hand_held,
    "12 photographs": partial(grid, 3, 4, 1500),
    "100 photographs": partial(grid, 10, 10, 10_000),
    "300 photographs": partial(grid, 15, 20, 30_000),
}


# ---- counting --------------------------------------------------------------------------------------------------------


@dataclass
class Count:
    """What the engine was called for, on a block of so many observations of tie points."""

    observations: int
    solutions: int = 0
    iterations: float = 0.0

    def add(self, problem: Problem, iterations: int) -> None:
        """Count a solution."""
        summarised = getattr(problem, "summary", None) is not None
        self.solutions += 1
        self.iterations += 0.0 if summarised else iterations * min(1.0, len(problem.tie) / max(1, self.observations))


@contextmanager
def counted(count: Count) -> Iterator[None]:
    """Count solutions, and the iterations of those that fail as far as they went."""

    def minimise(
        problem: Problem, state: State, most: int, tolerance: float, watch: Callable[[int, float], None], *rest: object
    ) -> Minimum:
        taken = 0

        def watched(iteration: int, cost: float) -> None:
            nonlocal taken
            taken = iteration
            watch(iteration, cost)

        try:
            minimum = minimise_problem(problem, state, most, tolerance, watched, *rest)  # type: ignore[arg-type]
        except ArithmeticError:
            count.add(problem, taken + 1)
            raise
        count.add(problem, minimum.iterations)
        return minimum

    with patch.object(problems, "minimise_problem", minimise):
        yield


@dataclass(frozen=True)
class Outcome:
    """What a survey took, and its blunders: those there are, None where nobody knows, and those rejected; a ``note`` is
    why it was not adjusted."""

    photographs: int = 0
    rays: int = 0
    solutions: int = 0
    iterations: float = 0.0
    decisions_s: float = float("nan")
    once_s: float = float("nan")
    blunders: int | None = None
    right: int = 0
    wrong: int = 0
    note: str = ""


def names_of(verdict: Verdict) -> set[Name]:
    """Return what a verdict rejects."""
    names = {(a.kind, f"{a.name} {a.photograph}" if a.kind == "mark" else a.name) for a in verdict.rejected}
    return names | {("focal length", name) for name in verdict.focal_lengths}


def once_s(block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray]) -> float:
    """Return the seconds of an adjustment without data snooping, the best of three; NaN where there is none."""
    took = []
    for _ in range(3):
        began = time.perf_counter()
        try:
            adjust(block, settings, start=start)
        except PhotogramError:
            return float("nan")
        took.append(time.perf_counter() - began)
    return min(took)


def decided(block: Block, truth: frozenset[Name] | None) -> Outcome:
    """Adjust a block as the stage does."""
    outcome = Outcome(len(block.photographs), len(block.tie_points.photograph))
    count = Count(outcome.rays)
    with counted(count):
        began = time.perf_counter()
        try:
            verdict = adjust_with_snooping(block, SETTINGS)
        except PhotogramError as error:
            return replace(outcome, note=f"not adjusted: {error}")
        except (ArithmeticError, ValueError) as error:  # a fault of photogram, which ends no table
            return replace(outcome, note=f"failed: {type(error).__name__}: {error}")
        seconds = time.perf_counter() - began
    names = names_of(verdict)
    return replace(
        outcome, solutions=count.solutions, iterations=count.iterations, decisions_s=seconds,
        once_s=once_s(block, SETTINGS, ()), blunders=None if truth is None else len(truth),
        right=len(names & (truth or frozenset())), wrong=len(names - (truth or frozenset())),
    )  # fmt: skip


@cache
def loaded() -> None:
    """Adjust a small survey, so that nothing is compiled or loaded later."""
    block = grid(3, 4, 300, 1)[0]
    decided(block, None)
    decided(with_blunders(2, 1)[0], None)


def trial(kind: str, seed: int) -> Outcome:
    """Simulate and adjust one survey."""
    loaded()
    return decided(*KINDS[kind](seed))


# ---- real surveys ----------------------------------------------------------------------------------------------------


def from_photographs(photographs: Path, *init: str) -> Outcome:
    """Adjust a survey from its photographs, and count in its stage `adjustment` what is decided there."""
    loaded()
    with tempfile.TemporaryDirectory() as name:
        folder, project = Path(name), Path(name) / "project.yaml"
        command = [sys.executable, "-m", "photogram.cli.main", "init", str(photographs), *init]
        subprocess.run([*command, "--project", str(project)], check=True, stdout=subprocess.DEVNULL)
        run_pipeline(load_project(project), until="transfer")
        with open_run(load_project(project)) as run:
            return in_stage(lambda: stage.adjust_block(run, folder, silent))


def in_stage(work: Callable[[], object]) -> Outcome:
    """Return what the stage decides while ``work`` runs."""
    outcomes, count = list[Outcome](), Count(0)

    def snooped(block: Block, settings: AdjustmentSettings, start: Sequence[FloatArray], *rest: object) -> Verdict:
        count.observations = len(block.tie_points.photograph)
        began = time.perf_counter()
        verdict = adjust_with_snooping(block, settings, start, *rest)  # type: ignore[arg-type]
        seconds = time.perf_counter() - began
        outcomes.append(
            Outcome(
                len(block.photographs), count.observations, count.solutions, count.iterations, seconds,
                once_s(block, settings, start), None, 0, len(names_of(verdict)),
            )
        )  # fmt: skip
        return verdict

    with counted(count), patch.object(stage, "adjust_with_snooping", snooped):
        work()
    return outcomes[0]


def brighton_beach(data: Path) -> Outcome:
    """Adjust the survey of a beach: consumer GNSS, no control."""
    return from_photographs(data / "images")


def sheffield_cross(data: Path) -> Outcome:
    """Adjust a survey with map-grade control."""
    control = ("--control", str(data / "gcp_file.txt"), "--picture-size", "4000x3000", "--control-sigma", "0.5")
    return from_photographs(data / "images", *control)


def dbat_sxb(data: Path) -> Outcome:
    """Adjust the tie points and marks of another program in five aerial frames."""
    loaded()
    return decided(dbat.dbat_block(data), None)


REAL: dict[str, Callable[[Path], Outcome]] = {
    "brighton_beach": brighton_beach,
    "sheffield_cross": sheffield_cross,
    "dbat_sxb": dbat_sxb,
}


def real(name: str, _seed: int) -> Outcome:
    """Adjust a real survey."""
    return REAL[name](SHARED_DATA / name)


# ---- table -----------------------------------------------------------------------------------------------------------


def outcomes_of(kind: str, seeds: Sequence[int], workers: int) -> list[Outcome]:
    """Return what the surveys of a kind take with the photogram that is imported here."""
    if kind in REAL:
        return study.run(partial(real, kind), [0], 1)
    return study.run(partial(trial, kind), seeds, workers)


def outcomes_beside(folder: Path, kind: str, seeds: Sequence[int], workers: int) -> list[Outcome]:
    """Return what they take with the photogram of another checkout."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "outcomes.json"
        options = ["--kinds", kind.replace(",", "+"), "--outcomes", str(path), "--workers", str(workers)]
        command = [sys.executable, __file__, str(len(seeds)), *options]
        environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
        return [Outcome(**row) for row in json.loads(path.read_text(encoding="utf-8"))]


def cells(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the figures of a row."""
    good = [o for o in outcomes if not o.note]

    def median(values: Sequence[float], digits: int) -> str:
        return f"{np.median(values):.{digits}f}" if values else ""

    figures = [
        median([o.solutions for o in good], 0),
        median([o.iterations for o in good], 0),
        median([o.decisions_s for o in good], 2),
        median([o.once_s for o in good], 2),
        median([o.decisions_s / o.once_s for o in good], 1),
    ]
    known = [o for o in good if o.blunders is not None]
    there = sum(o.blunders or 0 for o in known)
    right = f"{sum(o.right for o in known)} of {there}" if there else ""
    return [*figures, right, str(sum(o.wrong for o in good))]


def chosen(text: str, *, with_real: bool) -> list[str]:
    """Return the kinds that are asked for; ``+`` stands for a comma within a name. Exits where there is none such."""
    if not text:
        return [*KINDS, *(REAL if with_real else ())]
    kinds = [part.strip().replace("+", ",") for part in text.split(",")]
    unknown = [kind for kind in kinds if kind not in {*KINDS, *REAL}]
    if unknown:
        every = ", ".join(kind.replace(",", "+") for kind in (*KINDS, *REAL))
        raise SystemExit(f"no kinds of surveys: {', '.join(unknown)}; there are {every}")
    return [*kinds, *(name for name in REAL if with_real and name not in kinds)]


def main() -> None:
    """Print a row for each kind of survey, and for each version of photogram."""
    parser = study.parser(__doc__, 2, first=1, workers=1)
    parser.add_argument("--kinds", default="", help="names of the table, divided by commas, + for a comma within one")
    parser.add_argument("--beside", type=Path, metavar="FOLDER", help="another checkout that does the same")
    parser.add_argument("--real", action="store_true", help="the real surveys of the shared data as well")
    parser.add_argument("--outcomes", type=Path, metavar="FILE", help="write what each survey took here, as JSON")
    given = parser.parse_args()
    kinds, done, notes = chosen(given.kinds, with_real=given.real), list[Outcome](), list[str]()
    with study.recorded(given.json):
        width = max(map(len, kinds))
        titles = ("solutions", "iterations", "decisions, s", "once, s", "ratio", "right   ", "wrong")
        table = study.Table(f"{'survey':<{width}}", "of     ", "photographs", "observations", *titles)
        for kind in kinds:
            if kind in REAL and not (SHARED_DATA / kind).is_dir():
                notes.append(f"{kind}: left out, {SHARED_DATA} has no folder of this name")
                continue
            rows = {"this": outcomes_of(kind, given.seeds, given.workers)}
            if given.beside is not None:
                rows["beside"] = outcomes_beside(given.beside.resolve(), kind, given.seeds, given.workers)
            done += rows["this"]
            for version, outcomes in rows.items():
                first = outcomes[0]
                table.row(kind, version, first.photographs, first.rays, *cells(outcomes))
                notes += [f"{kind}, {version}: {o.note}" for o in outcomes if o.note]
        if notes:
            print("\n" + "\n".join(notes))
    if given.outcomes is not None:
        given.outcomes.write_text(json.dumps([asdict(o) for o in done]), encoding="utf-8")


if __name__ == "__main__":
    main()
