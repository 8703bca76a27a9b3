"""Targets looked for in the photographs of a survey, as proposals that somebody confirms."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from photogram.marking.marking_survey import MarkingSurvey, adjusted_block, open_marking
from photogram.marking.page.contact_sheet import write_contact_sheets
from photogram.marking.page.patches import PatchReader
from photogram.marking.page.proposing import proposed_marks
from photogram.marking.page.session import MarkingSession
from photogram.marking.page.snapping import Snapper
from photogram.pipeline.pipeline import load_project
from photogram.project.draft.roles import write_roles
from photogram.wording import Progress, silent

CONTACT_SHEETS = "contact_sheets"
"""Folder of the pictures of proposals, in the folder of the journal."""


@dataclass(frozen=True)
class DetectedTargets:
    """Proposals of marks, and where they were written."""

    proposals: Mapping[str, int]
    """How many there are, by the names of the points."""
    words: str
    """What was found, in a sentence: where there are none, why."""
    table: Path
    """The table of proposals."""
    pictures: Path | None
    """The folder of their pictures, None where there are none."""


@contextmanager
def marking_session(survey: MarkingSurvey, *, only_looks: bool = False) -> Iterator[tuple[MarkingSession, PatchReader]]:
    """Open the session of a survey, and the reader of its patches, while the block runs; one that ``only_looks``
    changes nothing but the proposals."""
    block = survey.block
    sizes = [(block.cameras[p.camera].width_px, block.cameras[p.camera].height_px) for p in block.photographs]
    patches = PatchReader([p.path for p in survey.project.photographs], sizes, stretches=survey.stretches)
    session = MarkingSession(
        block,
        survey.journal,
        None if only_looks else survey.marks,
        Snapper(patches).centre,
        better=lambda: adjusted_block(survey),
        propose=lambda known, hidden, progress: proposed_marks(known, patches, hidden, progress),
        keep_roles=lambda roles: write_roles(survey.project.path, roles, load_project),
    )
    try:
        yield session, patches
    finally:
        session.close()
        patches.close()


def detect_targets(
    project: Path | str, *, photographs: Path | str | None = None, progress: Progress = silent
) -> DetectedTargets:
    """Look for targets in the photographs of a project, and write proposals and a sheet of pictures for each point.

    Nothing else is written: journal and table of marks stay as they are. Proposals count once they are confirmed, on
    the page of `photogram mark`. ``photographs`` is the folder of the photographs in place of the project's. Raises
    ProjectError where the project file is wrong, ImageError where a photograph cannot be read.
    """
    survey = open_marking(project, photographs, progress)
    with marking_session(survey, only_looks=True) as (session, patches):
        session.ask_for_better()
        words = str(session.look(progress))
        snapshot = session.snapshot()
        folder = survey.journal.parent / CONTACT_SHEETS
        sheets = write_contact_sheets(folder, snapshot.proposals.values(), session.numbers, patches)
        counts = {point: sum(name == point for name, _ in snapshot.proposals) for point in snapshot.roles}
        return DetectedTargets(counts, words, session.proposed_in, folder if sheets else None)
