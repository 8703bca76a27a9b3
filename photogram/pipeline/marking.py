"""A survey opened for marking: its photographs and ground points as tags and project give them, or as they were
adjusted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from photogram.errors import DamagedStageError, ProjectError, WorkspaceError
from photogram.files.atomic import make_folder, make_folder_within
from photogram.files.marks.mark_table import MARKS
from photogram.marking.representative_points import representative_points
from photogram.marking.tagged_block import tagged_block
from photogram.pipeline.pipeline import is_up_to_date, load_project, open_run, run_pipeline
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage import Stage
from photogram.pipeline.store.stage_summary import StageSummary
from photogram.project.mark_entries import lines_to_add
from photogram.project.project import Project
from photogram.survey import Block

FOLDER, JOURNAL = "marking", "journal.jsonl"

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class _Told:
    """A watcher that tells how many photographs were read."""

    progress: Progress

    def begin(self, stage: Stage) -> None:
        """Start a stage."""

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:  # noqa: ARG002
        """Report progress within a stage."""
        self.progress(done, total, text)

    def end(self, stage: Stage, seconds: float | None, summary: StageSummary) -> None:
        """End a stage."""

    def warn(self, text: str) -> None:
        """Say what is doubtful."""


@dataclass(frozen=True, eq=False)
class MarkingSurvey:
    """A survey whose ground points are to be marked."""

    project: Project
    """The project."""
    block: Block
    """Photographs with the poses of their tags, ground points with the marks that the project has; no tie points."""

    @property
    def journal(self) -> Path:
        """The journal of marking."""
        return self.project.work / FOLDER / JOURNAL

    @property
    def marks(self) -> Path:
        """The table of marks, beside the project file."""
        return self.project.path.parent / MARKS

    def lines_to_add(self) -> tuple[str, ...]:
        """Return what the project file needs in order to take the marks made here, in lines; none where it does."""
        return lines_to_add(self.project.path, self.marks)


def open_marking(
    project: Path | str, photographs: Path | str | None = None, progress: Progress = lambda *_: None
) -> MarkingSurvey:
    """Open a project for marking: reads its photographs' tags once, and what was stored of them from then on.

    ``photographs`` is the folder of the photographs in place of the file's own. Raises ProjectError with every fault of
    the file, and where it has no ground points; WorkspaceError while another photogram works on the survey.
    """
    survey = load_project(Path(project), None if photographs is None else Path(photographs))
    if not survey.control_points:
        raise ProjectError(
            f"{survey.path}: no ground points, so there is nothing to mark: "
            "give their coordinates under control_points, as photogram init --control TABLE does"
        )
    with open_run(survey) as run:
        block = _stored_block(run)
    if block is None:
        run_pipeline(survey, watcher=_Told(progress), until="photographs")
        with open_run(survey) as run:
            block = run.block()
    make_folder(survey.work)
    make_folder_within(survey.work / FOLDER)
    return MarkingSurvey(survey, tagged_block(block))


def _stored_block(run: Run) -> Block | None:
    """Return the block of what is stored of these photographs, without looking at them again: it serves to predict
    places, and nothing else is made of it."""
    try:
        if run.workspace.mark("photographs") is None:
            return None
        same = [note["name"] for note in run.notes()] == [p.name for p in run.project.photographs]
        return run.block() if same else None
    except DamagedStageError:
        return None  # it is made again


def adjusted_block(survey: MarkingSurvey) -> Block | None:
    """Return the block as it was adjusted with the present project and photographs, None where it was not; with as many
    of its tie points as hold its photographs together (``representative_points``).

    Reads all photographs for their checksums, which takes a while. Raises WorkspaceError while another photogram works
    on the survey.
    """
    with open_run(survey.project) as run:
        try:
            if run.workspace.mark("adjustment") is None or not is_up_to_date(run, "adjustment"):
                return None
            block = run.adjusted_block()
        except DamagedStageError as fault:
            raise WorkspaceError(f"{fault.path}: {fault.what}: photogram adjust makes it again") from fault
    return replace(block, tie_points=representative_points(block))
