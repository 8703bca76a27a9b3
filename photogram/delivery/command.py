"""photogram deliver: a finished survey for CAD and GIS. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.delivery.names import FILES, USUAL, Product
from photogram.terminal.arguments import Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file

_FILES = ", ".join(f"{product} ({files[0]})" for product, files in FILES.items())


def deliver(
    project: ProjectFile,
    products: Annotated[
        list[Product] | None,
        typer.Option("--to", help=f"{_FILES}; may be repeated; default: all but 3dtiles.", show_default=False),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(help="Folder to write to; default: that of the deliverables.", show_default=False),
    ] = None,
    tolerance_m: Annotated[
        float | None,
        typer.Option(
            "--tolerance-m",
            help="By how much a simplified contour line may leave the traced one, m; default: half a cell.",
            show_default=False,
        ),
    ] = None,
    surface_error_m: Annotated[
        float | None,
        typer.Option(
            "--surface-error-m",
            help="By how much the triangulated surface may be off, m; default: a tenth of the contour interval.",
            show_default=False,
        ),
    ] = None,
    photographs: Photographs = None,
    package: Annotated[
        bool,
        typer.Option("--zip", help="Pack all results into survey.zip too, with a record of what they were made of."),
    ] = False,
) -> None:
    """Hand a finished survey over to CAD and GIS."""
    check_project_file(project)
    from photogram.delivery.work import run

    run(project, products or USUAL, output, tolerance_m, surface_error_m, photographs, package=package)
