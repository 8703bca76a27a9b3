"""What `photogram check` does."""

from __future__ import annotations

from pathlib import Path

import typer

from photogram.cli.screen.findings_table import findings_table, has_errors, verdict
from photogram.cli.screen.terminal import console
from photogram.pipeline.input_validation import validate_project_file


def run(project: Path, photographs: Path | None) -> None:
    """Validate a project and show what was found; leave with exit code 1 where there are errors."""
    findings = validate_project_file(project, photographs)
    console.print(findings_table(findings, f"Validation of {project}"))
    console.print(verdict(findings))
    if has_errors(findings):
        raise typer.Exit(1)
