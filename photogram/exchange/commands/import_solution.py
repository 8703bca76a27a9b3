"""photogram import: a project from another program's solution. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.terminal.arguments import SolutionCrs


def import_solution(
    solution: Annotated[
        Path,
        typer.Argument(
            help="A finished project of another program, its file or folder; or a database of COLMAP.",
            show_default=False,
        ),
    ],
    photographs: Annotated[
        Path | None,
        typer.Option(help="Folder of the photographs, where it is not the one of the solution.", show_default=False),
    ] = None,
    crs: SolutionCrs = None,
    check: Annotated[
        list[str] | None,
        typer.Option(help="A ground point that is to be a check point; may be repeated.", show_default=False),
    ] = None,
    project: Annotated[Path, typer.Option(help="Project file to write.")] = Path("project.yaml"),
    force: Annotated[bool, typer.Option("--force", help="Overwrite the project file and those beside it.")] = False,
) -> None:
    """Write a project that starts from another program's solution: cameras, poses, tie points and marked points."""
    from photogram.exchange.work.import_solution import run

    run(solution, photographs, crs, check or [], project, force=force)
