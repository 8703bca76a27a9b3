"""A survey opened for marking: its photographs and ground points as tags and project give them, or as they were
adjusted."""

from dataclasses import dataclass, replace
from pathlib import Path

from photogram.errors import DamagedStageError, ImageError, PhotogramError, ProjectError, WorkspaceError
from photogram.files.atomic import make_folder, make_folder_within
from photogram.files.marks.mark_table import MARKS
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.images import read_leading_tags
from photogram.files.photographs.tags import PhotographTags
from photogram.marking.ground_level import levelled
from photogram.marking.representative_points import representative_points
from photogram.marking.tagged_block import tagged_block
from photogram.pipeline.pipeline import is_up_to_date, load_project, open_run
from photogram.pipeline.stages.photographs import find_stretches, leave_out
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.store.run import Run
from photogram.project.control.mark_entries import lines_to_add
from photogram.project.measured.measured_block import PhotographNote, block_of, measured_photographs, photograph_note
from photogram.project.measured.measured_positions import measured_position
from photogram.project.project import Project, ProjectPhotograph
from photogram.survey import Block
from photogram.wording import Progress, silent

FOLDER, JOURNAL = "marking", "journal.sqlite"


@dataclass(frozen=True, eq=False)
class MarkingSurvey:
    """A survey whose ground points are to be marked."""

    project: Project
    """The project."""
    block: Block
    """Photographs with the poses of their tags, ground points with the marks that the project has; no tie points."""
    stretches: tuple[Stretch | None, ...]
    """Of each photograph, to 8 bits; None for one that has no more."""

    @property
    def journal(self) -> Path:
        """The journal of marking."""
        return self.project.work / FOLDER / JOURNAL

    @property
    def marks(self) -> Path:
        """The table of marks, in the folder of the project file."""
        return self.project.path.parent / MARKS

    def lines_to_add(self) -> tuple[str, ...]:
        """Return what the project file needs in order to take the marks made here, in lines; none where it does."""
        return lines_to_add(self.project.path, self.marks)


def open_marking(
    project: Path | str, photographs: Path | str | None = None, progress: Progress = silent
) -> MarkingSurvey:
    """Open a project for marking: from what is stored of its photographs, or from their tags alone, whose pixels are
    left to `photogram adjust`.

    ``photographs`` is the folder of the photographs in place of the file's own. Raises ProjectError with every error of
    the file, and where it has no ground points; ImageError with every photograph that cannot be read; WorkspaceError
    while another photogram works on the survey.
    """
    survey = load_project(Path(project), None if photographs is None else Path(photographs))
    if not survey.control_points:
        raise ProjectError(
            f"{survey.path}: no ground points, so there is nothing to mark: "
            "give their coordinates under control_points, as photogram init --control TABLE does"
        )
    with open_run(survey) as run:
        stored = _stored_block(run)
        block, stretches = _block_of_tags(run, progress) if stored is None else (stored, run.stretches)
    make_folder(survey.work)
    make_folder_within(survey.work / FOLDER)
    own = tuple(stretches.get(survey.cameras[photograph.camera].name) for photograph in survey.photographs)
    return MarkingSurvey(survey, levelled(tagged_block(block)), own)


def _stored_block(run: Run) -> Block | None:
    """Return the block of what is stored of these photographs, without looking at them again: it serves to predict
    places, and nothing else is made of it."""
    try:
        if run.workspace.mark("photographs") is None:
            return None
        same = [note["name"] for note in run.notes()] == [p.name for p in run.project.photographs]
        return run.block() if same else None
    except DamagedStageError:
        return None  # the tags are read again


def _block_of_tags(run: Run, progress: Progress) -> tuple[Block, dict[str, Stretch]]:
    """Return the block of what project and tags say of the photographs, and the stretches of cameras of more than 8
    bits, as the stage `photographs` makes both."""
    project = run.project
    notes: list[PhotographNote] = []
    tags: list[PhotographTags] = []
    errors: list[str] = []

    def described(photograph: ProjectPhotograph) -> tuple[PhotographNote, PhotographTags] | str:
        camera = project.cameras[photograph.camera]
        try:
            own = read_leading_tags(photograph.path, (camera.width_px, camera.height_px))
            return photograph_note(photograph, own, measured_position(project, photograph, own)), own
        except PhotogramError as error:
            return str(error)

    for done, outcome in enumerate(run.executor.map(described, project.photographs), 1):
        if isinstance(outcome, str):
            errors.append(outcome)
        else:
            notes.append(outcome[0])
            tags.append(outcome[1])
        progress(done, len(project.photographs), project.photographs[done - 1].name)
    if errors:
        raise ImageError("\n".join(errors))
    leave_out(project, notes, tags, run.executor)
    stretches = find_stretches(project, tags, run.executor)
    return block_of(project, measured_photographs(project, notes)), stretches


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
            block = block_as_adjusted(run)
        except DamagedStageError as error:
            raise WorkspaceError(f"{error.path}: {error.what}: photogram adjust makes it again") from error
    return levelled(replace(block, tie_points=representative_points(block)))
