"""photogram audit: another program's solution, adjusted again. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.terminal.arguments import SolutionCrs


def audit(
    solution: Annotated[
        Path,
        typer.Argument(help="A finished project of another program: its file or folder.", show_default=False),
    ],
    crs: SolutionCrs = None,
    check: Annotated[
        list[str] | None,
        typer.Option(help="A ground point that is taken as a check point here; may be repeated.", show_default=False),
    ] = None,
    beside: Annotated[
        list[Path] | None,
        typer.Option(
            help="A solution of the same photographs by another program, as a further column; may be repeated.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[Path, typer.Option(help="Folder for audit.html and audit.json.")] = Path("audit"),
) -> None:
    """Re-adjust another program's solution and compare both results side by side."""
    from photogram.exchange.work.audit import run

    run(solution, crs, check or [], beside or [], output)
