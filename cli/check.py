"""photogram check: validates a project before processing."""

from __future__ import annotations

import typer

from photogram.cli.adjust import Photographs, ProjectFile
from photogram.cli.app import app
from photogram.cli.findings_table import findings_table, has_errors, verdict
from photogram.cli.terminal import console
from photogram.input_validation import validate_project_file


@app.command()
def check(project: ProjectFile, photographs: Photographs = None) -> None:
    """Validate a project before processing (takes seconds)."""
    findings = validate_project_file(project, photographs)
    console.print(findings_table(findings, f"Check of {project}"))
    console.print(verdict(findings))
    if has_errors(findings):
        raise typer.Exit(1)
