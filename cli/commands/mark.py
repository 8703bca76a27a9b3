"""photogram mark: ground points marked in photographs, in the browser. Arguments only; the work is in
`photogram.cli.work`."""

from __future__ import annotations

from typing import Annotated

import typer

from photogram.cli.app import app
from photogram.cli.arguments import Photographs, ProjectFile
from photogram.cli.beforehand import check_project_file


@app.command()
def mark(
    project: ProjectFile,
    photographs: Photographs = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser, or only print its address.")
    ] = True,
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="N", help="Port of the page; 0 takes any that is free.")
    ] = 0,
    propose: Annotated[
        bool, typer.Option("--propose", help="Look for targets first; what is found counts once it is confirmed.")
    ] = False,
    detect_only: Annotated[
        bool, typer.Option("--detect-only", help="Look for targets, write proposals and pictures of them, and end.")
    ] = False,
) -> None:
    """Mark ground points in photographs, on a page in the browser of this machine; writes marks.csv beside the project.

    Works before anything is processed, and better after photogram adjust. Every mark is saved when it is made;
    Ctrl-C ends.
    """
    check_project_file(project)
    from photogram.cli.work.mark import detect, run

    if detect_only:
        detect(project, photographs)
    else:
        run(project, photographs, browser, port, propose)
