"""photogram donate: what a survey measured, without what tells where it lies. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.terminal.arguments import Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file


def donate(
    project: ProjectFile,
    output: Annotated[
        Path | None,
        typer.Option(help="File to write; default: beside the project file.", show_default=False),
    ] = None,
    photographs: Photographs = None,
    yes: Annotated[bool, typer.Option("--yes", help="Save without asking.")] = False,
) -> None:
    """Write what a finished survey measured to one file that may be given away: no photographs, names, dates, place."""
    check_project_file(project)
    from photogram.donation.work import run

    run(project, output, photographs, confirmed=yes)
