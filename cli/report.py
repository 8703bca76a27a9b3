"""photogram report: the page of a finished survey, made again or printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from photogram.cli.app import app
from photogram.cli.terminal import console
from photogram.page_files import print_report, remake_report
from photogram.pipeline import load_project
from photogram.project import Project

ProjectFile = Annotated[Path, typer.Argument(help="The project file, project.yaml.", show_default=False)]
Pdf = Annotated[bool, typer.Option("--pdf", help="Print report.pdf too, by an installed Chromium, Chrome or Edge.")]


def say_printed(survey: Project) -> None:
    """Print the report as PDF and say where it is."""
    console.print(f"Printed: {print_report(survey)}", soft_wrap=True)


@app.command()
def report(project: ProjectFile, pdf: Pdf = False) -> None:
    """Make report.html again from report.json, with the names and targets that the project file now gives."""
    survey = load_project(project)
    console.print(f"Written: {remake_report(survey)}", soft_wrap=True)
    if pdf:
        say_printed(survey)
