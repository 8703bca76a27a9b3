"""photogram report: the page of a finished survey, made again or printed. Arguments only, see `photogram.cli.work`."""

from __future__ import annotations

from photogram.cli.app import app
from photogram.cli.arguments import Pdf, Photographs, ProjectFile


@app.command()
def report(project: ProjectFile, photographs: Photographs = None, pdf: Pdf = False) -> None:
    """Regenerate report.html from report.json with the current names and targets of the project file."""
    from photogram.cli.work.report import run

    run(project, photographs, pdf)
