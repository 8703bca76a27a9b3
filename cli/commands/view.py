"""photogram view: the results in 3-D, as one page for a browser. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer


def view(
    results: Annotated[
        Path,
        typer.Argument(
            help="Folder of results, or the project or folder of its survey.",
            default_factory=lambda: Path("."),
            show_default="the working folder",
        ),
    ],
    points: Annotated[
        int,
        typer.Option(min=1000, max=20_000_000, metavar="N", help="Maximum number of points shown (thinned evenly)."),
    ] = 1_500_000,
    cloud: Annotated[
        Path | None, typer.Option(help="Another cloud of the survey, LAS or LAZ in its map grid.", show_default=False)
    ] = None,
    photographs: Annotated[
        Path | None,
        typer.Option(
            help="Image folder, for thumbnails; default: that of project.yaml above the results.", show_default=False
        ),
    ] = None,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Write view.html: point cloud, photographs, control and check points in 3-D, one file that works offline."""
    from photogram.cli.work.view import run

    run(results, points, cloud, photographs, show)
