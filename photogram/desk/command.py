"""photogram desk: a whole survey on one page in the browser. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer


def desk(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER",
            help="Folder of a survey, or of its photographs.",
            show_default=False,
            exists=True,
            file_okay=False,
        ),
    ] = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser, or only print its address.")
    ] = True,
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="N", help="Port of the page; 0 picks a free port.")
    ] = 0,
    basemap: Annotated[
        str | None,
        typer.Option(
            "--basemap",
            metavar="URL",
            help="Tiles under the map: https://tile.example.org/{z}/{x}/{y}.png. The browser asks their server.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Work on a survey on one page in the browser of this machine: photographs, points, run, results, deliverables.

    Nothing leaves this machine. What the page does is in project.yaml and in the folders beside it, as the other
    commands write them; a run goes on when the page or this command ends.
    """
    from photogram.desk import work

    work.run(folder, browser, port, basemap)
