"""The data flow: the stages of `photogram adjust`, their order, and how a run is resumed.

    photographs ─> features ─> matches ─> tie_points ─> orientation ─> transfer ─┐
    ┌────────────────────────────────────────────────────────────────────────────┘
    ├─> intersection ─┬─> comparison ──────────────────┐
    └─> adjustment ───┤                                │
                      └─> dense ─> surface ─┬─> relief ─────┼─> results
                                            └─> orthophoto ─┘

Each stage has a fingerprint made of its settings and of the fingerprints of what it reads. A stage whose folder
carries its present fingerprint is not run again, so changing a setting of the surface never repeats the adjustment.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from photogram import __version__
from photogram.dense_stages import match_surface
from photogram.errors import WorkspaceError
from photogram.files.atomic import make_folder
from photogram.files.matlab import read_camera
from photogram.memory import peak_memory
from photogram.orthophoto_stage import make_orthophoto
from photogram.preflight_heights import stop_at_contradictions
from photogram.project import Project, read_project
from photogram.publication import publish
from photogram.records import Run, control_of, height_marks, measured_photographs
from photogram.stages import (
    Stage,
    adjust_block,
    compare_clouds,
    detect_features,
    intersect_clouds,
    join_tie_points,
    match_photographs,
    orient_photographs,
    read_photographs,
    transfer_tie_points,
)
from photogram.surface_stages import model_surface, trace_relief
from photogram.workspace import Workspace, file_fingerprint, fingerprint, read_json

STAGES = (
    Stage(
        "photographs",
        "Photographs",
        (),
        lambda run: [
            run.photograph_fingerprints,
            run.project.cameras,
            measured_photographs(run.project),
            run.project.crs,
            height_marks(run.project),
        ],
        read_photographs,
    ),
    Stage(
        "features",
        "Features",
        (),
        lambda run: [run.photograph_fingerprints, run.project.features, run.project.quality],
        detect_features,
    ),
    Stage(
        "matches",
        "Matching",
        ("photographs", "features"),
        lambda run: [
            run.project.pairs,
            run.project.matching,
            run.project.cameras,
            run.project.world_kind,
            [p.control_map_m for p in run.project.control_points if p.role == "control"],
        ],
        match_photographs,
    ),
    Stage(
        "tie_points",
        "Tie points",
        ("features", "matches"),
        lambda run: run.project.adjustment.tie_point_sigma_px,
        join_tie_points,
    ),
    Stage(
        "orientation",
        "Orientation",
        ("photographs", "tie_points"),
        lambda run: [run.project.orientation, run.project.world_kind, control_of(run.project)],
        orient_photographs,
    ),
    Stage(
        "transfer",
        "Tie point transfer",
        ("photographs", "tie_points", "orientation"),
        lambda run: [run.project.transfer, run.project.adjustment.tie_point_sigma_px],
        transfer_tie_points,
    ),
    Stage("intersection", "Linear intersection", ("orientation", "transfer"), lambda _: None, intersect_clouds),
    Stage(
        "adjustment",
        "Joint adjustment",
        ("orientation", "transfer"),
        lambda run: [
            run.project.adjustment,
            run.project.gnss_offset_sigma_m,
            run.project.calibration,
            run.project.focal_readings_px,
        ],
        adjust_block,
    ),
    Stage(
        "dense",
        "Dense matching",
        ("adjustment",),
        lambda run: [run.photograph_fingerprints, run.project.dense, run.project.surface.cell_m],
        match_surface,
    ),
    Stage("surface", "Surface model", ("adjustment", "dense"), lambda run: run.project.surface, model_surface),
    Stage(
        "relief",
        "Terrain and contours",
        ("surface",),
        lambda run: [run.project.terrain, run.project.contours],
        trace_relief,
    ),
    Stage(
        "orthophoto",
        "Orthophoto",
        ("adjustment", "surface"),
        lambda run: [run.photograph_fingerprints, run.project.orthophoto],
        make_orthophoto,
    ),
    Stage(
        "comparison",
        "Comparison",
        ("intersection", "adjustment"),
        lambda run: (
            None
            if run.project.reference is None
            else [file_fingerprint(run.project.reference), run.project.heights.reference]
        ),
        compare_clouds,
    ),
    Stage(
        "results",
        "Report",
        ("orientation", "matches", "intersection", "adjustment", "surface", "relief", "orthophoto", "comparison"),
        lambda run: [str(run.project.results), run.project.report],
        publish,
    ),
)


class Watcher(Protocol):
    """Told by the pipeline what it does; the command line shows it."""

    def begin(self, stage: Stage) -> None:
        """Start a stage."""

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""

    def end(self, stage: Stage, seconds: float | None, summary: Mapping[str, Any]) -> None:
        """End a stage; ``seconds`` is None when its result was already there."""


@dataclass(frozen=True)
class Silent:
    """A watcher that says nothing."""

    def begin(self, stage: Stage) -> None:
        """Start a stage."""

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        """Report progress within a stage."""

    def end(self, stage: Stage, seconds: float | None, summary: Mapping[str, Any]) -> None:
        """End a stage."""


def load_project(path: Path, photographs: Path | None = None) -> Project:
    """Read and check a project file; ``photographs`` says where the pictures are, in place of the file's own folder.

    Raises ProjectError with every fault at once.
    """
    return read_project(path, photographs, read_matlab_camera=read_camera)


def stage_named(name: str) -> Stage:
    """Return the stage called ``name``. Raises WorkspaceError listing the names when there is none."""
    for stage in STAGES:
        if stage.name == name:
            return stage
    raise WorkspaceError(f"there is no stage {name!r}; the stages are {', '.join(s.name for s in STAGES)}")


def fingerprints(run: Run) -> dict[str, str]:
    """Return the fingerprint that every stage should have."""
    marks: dict[str, str] = {}
    for stage in STAGES:
        inputs = [marks[name] for name in stage.needs]
        marks[stage.name] = fingerprint(__version__, stage.name, stage.settings(run), inputs)
    return marks


def _present(run: Run, stage: Stage, mark: str) -> bool:
    if not run.workspace.is_complete(stage.name, mark):
        return False
    products = run.workspace.summary(stage.name).get("products", [])
    return all((run.project.results / name).is_file() for name in products)


@contextmanager
def open_run(project: Project, executor: Executor | None = None) -> Iterator[Run]:
    """Open a project's workspace, hold its lock, and give access to what its stages have written.

    Raises WorkspaceError when another process works there.
    """
    workspace = Workspace(project.work)
    with workspace.locked(), ThreadPoolExecutor(os.cpu_count()) as own:
        yield Run(project, workspace, executor or own)


def run_pipeline(
    project: Project,
    *,
    watcher: Watcher | None = None,
    start: str | None = None,
    until: str | None = None,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Bring a project to its results, doing only what is not done yet; returns report.json as a dictionary.

    ``start`` repeats that stage and all after it, ``until`` ends after that stage (and returns an empty dictionary
    unless it is the last). Raises a PhotogramError that says what the user can mend.
    """
    watcher = watcher or Silent()
    names = [stage.name for stage in STAGES]
    first = len(names) if start is None else names.index(stage_named(start).name)
    last = names.index(stage_named(until).name) if until else len(names) - 1
    with open_run(project, executor) as run:
        make_folder(project.results)  # a folder that cannot be made must show before hours of work
        marks = fingerprints(run)
        for number, stage in enumerate(STAGES[: last + 1]):
            watcher.begin(stage)
            if number < first and _present(run, stage, marks[stage.name]):
                watcher.end(stage, None, run.workspace.summary(stage.name))
            else:
                _run_stage(run, stage, marks[stage.name], watcher, fresh=number >= first)
            if number == 0 and last > 0:  # before hours of work, and in every run: control may have changed since
                stop_at_contradictions(project, run.block(), run.notes())
    report = project.results / "report.json"
    return dict(read_json(report)) if last == len(names) - 1 else {}


def _run_stage(run: Run, stage: Stage, mark: str, watcher: Watcher, *, fresh: bool) -> None:
    if fresh:
        run.workspace.discard(stage.name)
    began = time.monotonic()
    folder = run.workspace.begin(stage.name, mark)
    with peak_memory() as peak:
        summary = stage.work(run, folder, lambda done, total, text: watcher.advance(stage, done, total, text))
    seconds = time.monotonic() - began
    measured = {"seconds": round(seconds, 3), "peak_memory_bytes": peak.bytes}
    run.workspace.finish(stage.name, mark, {**measured, **summary})
    watcher.end(stage, seconds, summary)
