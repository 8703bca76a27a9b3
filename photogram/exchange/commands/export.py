"""photogram export: an adjusted survey for other programs. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.exchange.formats.names import SolutionFormat
from photogram.terminal.arguments import Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file


def export(
    project: ProjectFile,
    form: Annotated[SolutionFormat, typer.Option("--to", help="Target format.", show_default=False)],
    output: Annotated[Path, typer.Option(help="A new folder or file to write.", show_default=False)],
    photographs: Photographs = None,
) -> None:
    """Write an adjusted survey for another program: cameras, poses, tie points, and what else its files hold."""
    check_project_file(project)
    from photogram.exchange.work.export import run

    run(project, form, output, photographs)
