"""photogram report: the page of a finished survey, made again or printed."""

from __future__ import annotations

from photogram.cli.adjust import Pdf, Photographs, ProjectFile, say_printed
from photogram.cli.app import app
from photogram.cli.terminal import console
from photogram.page_files import remake_report
from photogram.pipeline import load_project


@app.command()
def report(project: ProjectFile, photographs: Photographs = None, pdf: Pdf = False) -> None:
    """Make report.html again from report.json, with the names and targets that the project file now gives."""
    survey = load_project(project, photographs)
    console.print(f"Written: {remake_report(survey)}", soft_wrap=True)
    if pdf:
        say_printed(survey)
