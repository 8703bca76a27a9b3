"""What `photogram check` does."""

from pathlib import Path

import typer

from photogram.errors import ProjectError
from photogram.machine import cores
from photogram.pipeline.costs.forecast import Forecast
from photogram.pipeline.input_validation import check_project, checked_project, predicted_costs
from photogram.pipeline.pipeline import load_project
from photogram.project.findings import Findings
from photogram.terminal.console import console
from photogram.terminal.cost_table import cost_table
from photogram.terminal.findings_table import findings_table, has_errors, verdict


def _checked(project: Path, photographs: Path | None) -> tuple[Findings, Forecast | None]:
    """Return what is found wrong with a project, and what it will take where nothing stops it."""
    try:
        survey = load_project(project, photographs)
    except ProjectError:  # its errors are found again, and all others with them
        return check_project(project, photographs), None
    checked = checked_project(survey)
    if has_errors(checked.findings):
        return checked.findings, None
    return checked.findings, predicted_costs(survey, checked.tags)


def run(project: Path, photographs: Path | None) -> None:
    """Validate a project and show what was found; leave with exit code 1 where there are errors."""
    findings, predicted = _checked(project, photographs)
    console.print(findings_table(findings, f"Validation of {project}"))
    if predicted is not None:
        console.print(cost_table(predicted, cores()) if predicted.stages else "All results are up to date.")
    console.print(verdict(findings))
    if has_errors(findings):
        raise typer.Exit(1)
