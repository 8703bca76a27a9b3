"""The data flow: the stages of `photogram adjust`, their order, and how a run is resumed.

    photographs ─> features ─> pairs ─> matches ─> tie_points ─> orientation ─> transfer ─┐
    ┌─────────────────────────────────────────────────────────────────────────────────────┘
    ├─> intersection ─┬─> comparison ──────────────────┐
    └─> adjustment ───┤                                │
                      └─> dense ─> surface ─┬─> relief ─────┼─> results
                                            └─> orthophoto ─┘

Each stage has a fingerprint made of its settings and of the fingerprints of what it reads. A stage whose folder
carries its present fingerprint is not run again, so changing a setting of the surface never repeats the adjustment.
Matching depends on which pairs were chosen, not on why: other positions that lead to the same pairs do not repeat it.
A block that was oriented from its tie points keeps its orientation whatever becomes of the control points: the
adjustment places it again (``Stage.as_made``).
"""

import logging
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import overload

from photogram import __version__
from photogram.compilation import compile_time
from photogram.errors import DamagedStageError, PhotogramError, WorkspaceError
from photogram.files.atomic import make_folder, unwritable
from photogram.files.matlab import read_camera
from photogram.files.npz_json import fingerprint
from photogram.machine import cores
from photogram.pipeline.project_file import project_file
from photogram.pipeline.stage import Stage, Watcher
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.pipeline.stages.publishing.report_files import NUMBERS
from photogram.pipeline.stages.publishing.results import RESULTS
from photogram.pipeline.store.memory import check_room, give_back_free_memory, peak_memory
from photogram.pipeline.store.pools import Pool
from photogram.pipeline.store.results_record import FOREIGN, FOREIGN_REMEDY, foreign_products
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage_files import journalled
from photogram.pipeline.store.stage_summary import StageNote
from photogram.pipeline.store.work_orders import check_pool, open_order
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project, read_project
from photogram.project.validation.heights import stop_at_contradictions
from photogram.report.reading import read_report
from photogram.report.record.report import Report
from photogram.result_files import within_results
from photogram.wording import some

_LOG = logging.getLogger(__name__)


STAGES: tuple[Stage, ...] = (*BEFORE_RESULTS, RESULTS)
"""In their order."""


def load_project(path: Path, photographs: Path | None = None) -> Project:
    """Read and check a project file, or the project.yaml of a folder; ``photographs`` says where the pictures are, in
    place of the file's own folder.

    Raises ProjectError with every error at once.
    """
    return read_project(project_file(path), photographs, read_matlab_camera=read_camera)


def stage_named(name: str) -> Stage:
    """Return the stage called ``name``. Raises WorkspaceError listing the names when there is none."""
    for stage in STAGES:
        if stage.name == name:
            return stage
    raise WorkspaceError(f"there is no stage {name!r}; the stages are {', '.join(s.name for s in STAGES)}")


def _first_and_last(start: str | None, until: str | None) -> tuple[int, int]:
    """Return the numbers of the first stage that is repeated and of the last that is done. Raises WorkspaceError as
    ``stage_named``."""
    first = len(STAGES) if start is None else STAGES.index(stage_named(start))
    return first, len(STAGES) - 1 if until is None else STAGES.index(stage_named(until))


def _fingerprint(run: Run, stage: Stage, marks: Mapping[str, str], *, anew: bool = False) -> str:
    """Return the fingerprint that a stage should have, by those of the stages before it, which are complete.

    A result that holds although it was made under other settings keeps its own, unless it is made ``anew``.
    """

    def under(settings: object) -> str:
        return fingerprint(__version__, stage.name, settings, [marks[name] for name in stage.needs])

    made = None if stage.as_made is None or anew else stage.as_made(run)
    if made is not None and run.workspace.mark(stage.name) == under(made):
        return under(made)
    return under(stage.settings(run))


def fingerprints(run: Run) -> Iterator[tuple[Stage, str]]:
    """Yield every stage, in their order, with the fingerprint that it should have. Those from `matches` on need the
    stages before it."""
    marks: dict[str, str] = {}
    for stage in STAGES:
        marks[stage.name] = _fingerprint(run, stage, marks)
        yield stage, marks[stage.name]


def _present(run: Run, stage: Stage, mark: str) -> bool:
    if not run.workspace.is_complete(stage.name, mark):
        return False
    products = run.workspace.summary(stage.name, StageNote).get("products", [])
    return all((run.project.results / name).is_file() for name in products)


def is_up_to_date(run: Run, name: str) -> bool:
    """Return whether a stage and all before it are there as the project and its photographs now ask for them.

    Reads the photographs whole, once in a run, for their checksums. Raises WorkspaceError where there is no such stage,
    DamagedStageError where a file of one is missing or was changed.
    """
    last = stage_named(name)
    for stage, mark in fingerprints(run):
        if not _present(run, stage, mark):
            return False
        if stage is last:
            break
    return True


def remaining_stages(project: Project, start: str | None = None, until: str | None = None) -> tuple[str, ...]:
    """Return the names of the stages that ``run_pipeline`` would run, in their order.

    Reads the photographs whole where an earlier run has left anything, for their checksums. A stage counts as to be run
    where one that it needs is, even if that should come to the same result. Raises WorkspaceError where there is no
    such stage.
    """
    first, last = _first_and_last(start, until)
    workspace = Workspace(project.work)
    marks, remaining = dict[str, str](), list[str]()
    with ThreadPoolExecutor(1) as unused:
        run = Run(project, workspace, unused)
        for number, stage in enumerate(STAGES[: last + 1]):
            mark = _mark_if_present(run, stage, marks) if number < first else None
            if mark is None:
                remaining.append(stage.name)
            else:
                marks[stage.name] = mark
    return tuple(remaining)


def _mark_if_present(run: Run, stage: Stage, marks: Mapping[str, str]) -> str | None:
    """Return the fingerprint of a stage whose result is there as it should be, None of any other."""
    try:
        if not marks.keys() >= set(stage.needs) or run.workspace.mark(stage.name) is None:
            return None
        mark = _fingerprint(run, stage, marks)
        return mark if _present(run, stage, mark) else None
    except (PhotogramError, OSError):
        return None  # the run says so, and what to do


@contextmanager
def open_run(project: Project, executor: Executor | None = None, pool: Pool | None = None) -> Iterator[Run]:
    """Open a project's workspace, hold its lock, and give access to what its stages have written.

    ``executor`` runs threads, ``pool`` processes that do pieces of stages. Raises WorkspaceError when another process
    works there, or one of the pool cannot.
    """
    workspace = Workspace(project.work)
    with workspace.locked(), ThreadPoolExecutor(cores()) as own:
        run = Run(project, workspace, executor or own, pool)
        check_pool(run)
        yield run


@overload
def run_pipeline(
    project: Project,
    *,
    watcher: Watcher | None = ...,
    start: str | None = ...,
    until: None = ...,
    executor: Executor | None = ...,
    pool: Pool | None = ...,
) -> Report: ...


@overload
def run_pipeline(
    project: Project,
    *,
    watcher: Watcher | None = ...,
    start: str | None = ...,
    until: str | None,
    executor: Executor | None = ...,
    pool: Pool | None = ...,
) -> Report | None: ...


def run_pipeline(
    project: Project,
    *,
    watcher: Watcher | None = None,
    start: str | None = None,
    until: str | None = None,
    executor: Executor | None = None,
    pool: Pool | None = None,
) -> Report | None:
    """Bring a project to its results, doing only what is not done yet; returns what report.json holds.

    ``start`` repeats that stage and all after it, ``until`` ends after that stage (and returns None unless it is the
    last). ``pool`` are processes that do pieces of the stages, on this machine or others, in place of threads. Raises a
    PhotogramError that says what the user can fix.
    """
    first, last = _first_and_last(start, until)
    check_room()
    with open_run(project, executor, pool) as run:
        make_folder(project.results)  # what cannot be written must show before hours of work
        reason = unwritable(project.results)
        if reason:
            raise WorkspaceError(f"{project.results}: {reason}: allow it, or give another folder under results")
        foreign = foreign_products(project.results)
        if foreign:
            raise WorkspaceError(f"{project.results}: {some(foreign)}: {FOREIGN}: {FOREIGN_REMEDY}")
        _Progress(run, watcher or Watcher(), first, last).go_on()
    return read_report(project.results / within_results(NUMBERS)) if last == len(STAGES) - 1 else None


@dataclass(frozen=True)
class _Progress:
    """How far a run is: stages from number ``first`` are repeated, ``last`` is the last to be done.

    ``marks`` are the fingerprints of stages that are done, ``damaged`` those of them that have to be made again, and
    ``repaired`` all that ever had to be.
    """

    run: Run
    watcher: Watcher
    first: int
    last: int
    marks: dict[str, str] = field(default_factory=dict)
    damaged: set[str] = field(default_factory=set)
    repaired: set[str] = field(default_factory=set)

    def go_on(self) -> None:
        """Do what is not done. A stage that is found damaged is made again; those after it stay, since what is made
        again is what it was."""
        while (number := self._next()) <= self.last:
            try:
                self._do(number, STAGES[number])
            except DamagedStageError as error:
                self._note_damage(error)
            except OSError as error:
                if isinstance(error, PhotogramError):
                    raise
                raise WorkspaceError(
                    f"{error.filename or self.run.workspace.folder}: {error.strerror or error}, in the stage "
                    f"{STAGES[number].name}: check the disks and their permissions"
                ) from error

    def _next(self) -> int:
        again = [number for number, stage in enumerate(STAGES) if stage.name in self.damaged]
        return min([*again, len(self.marks)])

    def _do(self, number: int, stage: Stage) -> None:
        done = stage.name in self.marks
        mark = _fingerprint(self.run, stage, self.marks, anew=number >= self.first and not done)
        if done and mark != self.marks[stage.name]:
            # what is made again is not what it was, since it was made under other settings: what follows is not done
            for later in STAGES[number + 1 :]:
                self.marks.pop(later.name, None)
        _LOG.debug("stage %s: %.12s, there is %.12s", stage.name, mark, self.run.workspace.mark(stage.name))
        self.watcher.begin(stage)
        if number < self.first and _present(self.run, stage, mark):
            self.watcher.end(stage, None, self.run.workspace.stored(stage.name))
        else:
            _run_stage(self.run, stage, mark, self.watcher, fresh=number >= self.first and not done)
        if number == 0 and self.last > 0:  # before hours of work, and in every run: control may have changed since
            stop_at_contradictions(self.run.project, self.run.block(), self.run.notes())
        self.marks[stage.name] = mark
        self.damaged.discard(stage.name)

    def _note_damage(self, error: DamagedStageError) -> None:
        if error.stage in self.repaired:
            raise WorkspaceError(
                f"{error.path}: {error.what}, again after it was recomputed: check the disk, or give another "
                "folder under work"
            ) from error
        self.repaired.add(error.stage)
        if error.stage in self.marks:
            self.damaged.add(error.stage)
        self.watcher.warn(f"{error.path}: {error.what}: the stage {error.stage} is run again")
        self.run.workspace.discard(error.stage)


def _run_stage(run: Run, stage: Stage, mark: str, watcher: Watcher, *, fresh: bool) -> None:
    if fresh:
        run.workspace.discard(stage.name)
    give_back_free_memory()
    check_room()
    began = time.monotonic()
    folder = run.workspace.begin(stage.name, mark, watcher.warn)
    with journalled(folder), peak_memory() as peak, compile_time() as compiled, open_order(run, folder):
        summary = stage.work(run, folder, lambda done, total, text: watcher.advance(stage, done, total, text))
    seconds = time.monotonic() - began
    highest = None if peak.bytes is None else max(peak.bytes, run.taken_memory())
    measured: StageNote = {
        "seconds": round(seconds, 3),
        "compilation_seconds": round(compiled.seconds, 3),
        "peak_memory_bytes": highest,
    }
    run.workspace.finish(stage.name, mark, {**measured, **summary})
    watcher.end(stage, seconds, summary)
