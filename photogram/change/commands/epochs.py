"""photogram epochs: several epochs of one site adjusted together, a surface of each, and what has changed. Arguments
only."""

from pathlib import Path
from typing import Annotated

import typer


def epochs(
    project: Annotated[Path, typer.Argument(help="Project file with epochs, or its folder.", show_default=False)],
    polygons: Annotated[
        Path | None, typer.Option(help="Volumes of change are asked for within these: .gpkg, .geojson.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; default: threads.", min=1)] = None,
) -> None:
    """Adjust all epochs of a site together; make a surface of each, and their differences with standard deviations."""
    from photogram.change.work.epochs import run

    run(project, polygons, workers)
