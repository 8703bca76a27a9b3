"""What `photogram mark` does."""

import webbrowser
from pathlib import Path
from threading import Thread

from rich.markup import escape

from photogram.errors import WorkspaceError
from photogram.files.marks.formats import MarkFormat
from photogram.loopback.server import ADDRESS, LoopbackServer
from photogram.marking.detection import detect_targets, marking_session
from photogram.marking.mark_export import export_marks
from photogram.marking.marking_survey import open_marking
from photogram.marking.page.addresses import POLICY, MarkingPage
from photogram.marking.page.session import MarkingSession
from photogram.marking.page.snapping import Snapper
from photogram.terminal.console import console, steps
from photogram.wording import things


def run(project: Path, photographs: Path | None, browser: bool, port: int, propose: bool) -> None:
    """Serve the page of a project until Ctrl-C, and say where the marks are; targets are looked for before where
    ``propose`` says so."""
    with steps("Photographs") as progress:
        survey = open_marking(project, photographs, progress)
    with marking_session(survey) as (session, patches):
        _warn_of(session.set_aside)
        page = MarkingPage(session, patches, survey.project.path.absolute().parent.name)
        server = _server(page, port)
        if propose:
            _look(session)
        session.start()
        page.begin()
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
        server.serve()
        state = session.snapshot().state
    console.print(
        f"Ended: {things(len(state.marks), 'mark')} in {escape(str(survey.marks))}. "
        f"Next: photogram adjust {escape(str(project))}",
        soft_wrap=True,
    )
    for name in sorted(state.points):
        console.print(f"{name} was added on the page: put it into a table of points for it to count", soft_wrap=True)


def detect(project: Path, photographs: Path | None) -> None:
    """Look for targets, and write proposals and a sheet of pictures for each point."""
    with steps("Targets") as progress:
        result = detect_targets(project, photographs=photographs, progress=progress)
    if not any(result.proposals.values()):
        console.print(f"{result.words[0].upper()}{result.words[1:]}.", soft_wrap=True, highlight=False)
        return
    for point, count in result.proposals.items():
        console.print(f"{point}: {things(count, 'proposal')}", soft_wrap=True, markup=False, highlight=False)
    if result.pictures is not None:
        console.print(f"Pictures: {escape(str(result.pictures))}", soft_wrap=True)
    console.print(
        f"Proposals: {escape(str(result.table))}. They count once they are confirmed: "
        f"photogram mark {escape(str(project))}",
        soft_wrap=True,
    )


def export(project: Path, photographs: Path | None, target: Path, form: MarkFormat | None, overwrite: bool) -> None:
    """Write points and marks for another program, and say what was left out."""
    written = export_marks(project, target, form, photographs=photographs, overwrite=overwrite)
    for note in written.notes:
        console.print(f"[yellow]warning[/yellow] {escape(note)}", soft_wrap=True, highlight=False)
    content = f"{things(written.points, 'point')} in {written.crs}, {things(written.marks, 'mark')}"
    console.print(f"Exported: {escape(content)}", soft_wrap=True, highlight=False)
    for file in written.files:
        console.print(escape(str(file)), soft_wrap=True, highlight=False)


def _warn_of(set_aside: Path | None) -> None:
    if set_aside is not None:
        text = f"a table of marks was not written here: it is kept as {set_aside.name}"
        console.print(f"[yellow]warning[/yellow] {escape(text)}", soft_wrap=True)


def _look(session: MarkingSession) -> None:
    with steps("Targets") as progress:
        session.ask_for_better()
        found = str(session.look(progress))
    console.print(f"{found[0].upper()}{found[1:]}.", soft_wrap=True, highlight=False)


def _server(page: MarkingPage, port: int) -> LoopbackServer:
    try:
        return LoopbackServer(page.routes(), POLICY, port)
    except OSError as error:
        raise WorkspaceError(
            f"port {port} of {ADDRESS} cannot be used ({error.strerror}): give another with --port, or none"
        ) from error
