"""photogram mark: ground points marked in photographs, in the browser. Arguments only."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from photogram.terminal.arguments import Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file

FormatName = Literal["gcp_list", "metashape", "pix4d", "csv"]


def _check_export(export: Path | None, form: FormatName | None, overwrite: bool, others: bool) -> None:
    """Raise BadParameter where options contradict each other."""
    if export is None and (form is not None or overwrite):
        raise typer.BadParameter("--format and --overwrite belong to --export: give the file to write with --export")
    if export is not None and others:
        raise typer.BadParameter("--export writes what is marked and ends: leave out --propose and --detect-only")


def mark(
    project: ProjectFile,
    photographs: Photographs = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser, or only print its address.")
    ] = True,
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="N", help="Port of the page; 0 picks a free port.")
    ] = 0,
    propose: Annotated[
        bool, typer.Option("--propose", help="Detect targets first; detections are used only after confirmation.")
    ] = False,
    detect_only: Annotated[
        bool, typer.Option("--detect-only", help="Detect targets, write proposals and pictures of them, and end.")
    ] = False,
    export: Annotated[
        Path | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="Write points and marks for another program, and end; doubtful marks are left out.",
            show_default=False,
        ),
    ] = None,
    form: Annotated[
        FormatName | None,
        typer.Option(
            "--format",
            help="Format of the export; by default, that of the file's name: gcp_list.txt, .xml, .csv.",
            show_default=False,
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Export even where the file exists.")] = False,
) -> None:
    """Mark ground points in photographs, on a page in the browser of this machine; writes marks.csv beside the project.

    Works before anything is processed, and better after photogram adjust. Every mark is saved when it is made;
    Ctrl-C ends.
    """
    _check_export(export, form, overwrite, propose or detect_only)
    check_project_file(project)
    from photogram.marking import work

    if export is not None:
        work.export(project, photographs, export, form, overwrite)
    elif detect_only:
        work.detect(project, photographs)
    else:
        work.run(project, photographs, browser, port, propose)
