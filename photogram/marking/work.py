"""What `photogram mark` does."""

from __future__ import annotations

import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

from rich.markup import escape

from photogram.errors import WorkspaceError
from photogram.marking.marking_survey import MarkingSurvey, adjusted_block, open_marking
from photogram.marking.page.contact_sheet import write_contact_sheets
from photogram.marking.page.patches import PatchReader
from photogram.marking.page.proposing import proposed_marks
from photogram.marking.page.server import ADDRESS, MarkServer
from photogram.marking.page.session import MarkingSession, search_result
from photogram.marking.page.snapping import Snapper
from photogram.terminal.console import console, steps
from photogram.wording import things

CONTACT_SHEETS = "contact_sheets"
"""Folder of the pictures of proposals, in the folder of the journal."""


def run(project: Path, photographs: Path | None, browser: bool, port: int, propose: bool) -> None:
    """Serve the page of a project until Ctrl-C, and say where the marks are; targets are looked for before where
    ``propose`` says so."""
    survey = _opened(project, photographs)
    with _session(survey) as (session, patches):
        server = _server(session, patches, survey.project.path.absolute().parent.name, port)
        if propose:
            _look(session)
        session.start()
        Thread(target=Snapper(patches).prepare, daemon=True).start()
        points = things(len(survey.block.control_points), "point")
        console.print(
            f"Marking {points} in {things(len(survey.block.photographs), 'photograph')}: {server.url}", soft_wrap=True
        )
        console.print(f"Marks are kept in {escape(str(survey.marks))} as they are made; Ctrl-C ends.", soft_wrap=True)
        for line in survey.lines_to_add():
            console.print(line, soft_wrap=True, markup=False)
        if browser and not webbrowser.open(server.url):
            console.print("No browser found: open this address yourself.")
        _serve(server)
        state = session.snapshot().state
    console.print(
        f"Ended: {things(len(state.marks), 'mark')} in {escape(str(survey.marks))}. "
        f"Next: photogram adjust {escape(str(project))}",
        soft_wrap=True,
    )
    for name, role in sorted(state.roles.items()):
        console.print(f"Role of {name}: {role}; say so in {project}", soft_wrap=True, markup=False)


def detect(project: Path, photographs: Path | None) -> None:
    """Look for targets, and write proposals and a sheet of pictures for each point."""
    survey = _opened(project, photographs)
    with _session(survey) as (session, patches):
        _look(session)
        snapshot = session.snapshot()
        folder = survey.journal.parent / CONTACT_SHEETS
        sheets = write_contact_sheets(folder, snapshot.proposals.values(), session.numbers, patches)
    per_point = [sum(name == point for name, _ in snapshot.proposals) for point in snapshot.roles]
    for point, count in zip(snapshot.roles, per_point, strict=True):
        console.print(f"{point}: {things(count, 'proposal')}", soft_wrap=True, markup=False, highlight=False)
    if sheets:
        console.print(f"Pictures: {escape(str(folder))}", soft_wrap=True)
    console.print(
        f"Proposals: {escape(str(session.proposed_in))}. They count once they are confirmed: "
        f"photogram mark {escape(str(project))}",
        soft_wrap=True,
    )


def _opened(project: Path, photographs: Path | None) -> MarkingSurvey:
    with steps("Photographs") as progress:
        return open_marking(project, photographs, progress)


@contextmanager
def _session(survey: MarkingSurvey) -> Iterator[tuple[MarkingSession, PatchReader]]:
    """Open the session of a survey while the block runs, and say what was set aside."""
    block = survey.block
    sizes = [(block.cameras[p.camera].width_px, block.cameras[p.camera].height_px) for p in block.photographs]
    patches = PatchReader([p.path for p in survey.project.photographs], sizes, stretches=survey.stretches)
    session = MarkingSession(
        block,
        survey.journal,
        survey.marks,
        Snapper(patches).centre,
        better=lambda: adjusted_block(survey),
        propose=lambda known, hidden, progress: proposed_marks(known, patches, hidden, progress),
    )
    try:
        if session.set_aside is not None:
            text = f"{survey.marks} was not written here: it is kept as {session.set_aside.name}"
            console.print(f"[yellow]warning[/yellow] {escape(text)}", soft_wrap=True)
        yield session, patches
    finally:
        session.close()
        patches.close()


def _look(session: MarkingSession) -> None:
    with steps("Targets") as progress:
        session.ask_for_better()
        count = session.look(progress)
    console.print(f"{search_result(count).capitalize()}.")


def _server(session: MarkingSession, patches: PatchReader, title: str, port: int) -> MarkServer:
    try:
        return MarkServer(session, patches, title, port)
    except OSError as error:
        raise WorkspaceError(
            f"port {port} of {ADDRESS} cannot be used ({error.strerror}): give another with --port, or none"
        ) from error


def _serve(server: MarkServer) -> None:
    try:
        server.serve()
    except KeyboardInterrupt:
        return  # how it is meant to end: everything is on the disk
