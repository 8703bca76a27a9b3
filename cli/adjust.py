"""photogram adjust: the whole survey."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from photogram.cli.app import app
from photogram.cli.findings_table import findings_table, has_errors, verdict
from photogram.cli.terminal import Terminal, bars, console, show_report
from photogram.input_validation import validate_project
from photogram.page_files import print_report
from photogram.pipeline import STAGES, load_project, run_pipeline
from photogram.project import Project

ProjectFile = Annotated[Path, typer.Argument(help="The project file, project.yaml.", show_default=False)]
Photographs = Annotated[
    Path | None,
    typer.Option("--photographs", help="Folder of the photographs, in place of the one in the project file."),
]


Pdf = Annotated[bool, typer.Option("--pdf", help="Print report.pdf too, by an installed Chromium, Chrome or Edge.")]


def say_printed(survey: Project) -> None:
    """Print the report as PDF and say where it is."""
    console.print(f"Printed: {print_report(survey)}", soft_wrap=True)


def _stop_at_errors(survey: Project) -> None:
    """Validate the project and print errors and warnings; leave with exit code 1 where there are errors."""
    findings = [finding for finding in validate_project(survey) if finding.severity != "note"]
    if findings:
        console.print(findings_table(findings, f"Check of {survey.path}"))
    if has_errors(findings):
        console.print(verdict(findings))
        console.print("Nothing was processed; --no-check goes on in spite of errors.")
        raise typer.Exit(1)


def _stage(name: str | None) -> str | None:
    names = [stage.name for stage in STAGES]
    if name is not None and name not in names:
        raise typer.BadParameter(f"there is no stage {name!r}; the stages are {', '.join(names)}")
    return name


@app.command()
def adjust(
    project: ProjectFile,
    photographs: Photographs = None,
    start: Annotated[
        str | None, typer.Option("--from", callback=_stage, help="Repeat this stage and all after it.")
    ] = None,
    until: Annotated[str | None, typer.Option("--until", callback=_stage, help="End after this stage.")] = None,
    pdf: Pdf = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit with 1 where a measurement was left out because others contradict it."),
    ] = False,
    check: Annotated[
        bool, typer.Option("--check/--no-check", help="Validate the project first, as photogram check does.")
    ] = True,
) -> None:
    """Process a survey: match, orient and adjust its photographs, then make point clouds, surface and orthophoto."""
    survey = load_project(project, photographs)
    if check:
        _stop_at_errors(survey)
    with bars() as progress:
        report = run_pipeline(survey, watcher=Terminal(progress), start=start, until=until)
    if report:
        show_report(report)
        console.print(f"Results: {survey.results}")
        if pdf:
            say_printed(survey)
        if strict and report["blunders"]:
            raise typer.Exit(1)
