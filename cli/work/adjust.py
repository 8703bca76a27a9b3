"""What `photogram adjust` does."""

from __future__ import annotations

import os
import shlex
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import typer
from rich.markup import escape

from photogram.cli.screen.findings_table import findings_table, has_errors, verdict
from photogram.cli.screen.report_tables import show_report
from photogram.cli.screen.terminal import bars, console
from photogram.cli.screen.watching import Terminal, stage_weights
from photogram.pipeline.input_validation import validate_project
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.stages.report_files import PAGE, print_report
from photogram.pipeline.store.cluster import cluster
from photogram.pipeline.store.pools import Pool, ProcessPool
from photogram.project.project import Project


def say_printed(survey: Project) -> None:
    """Print the report as PDF and say where it is."""
    console.print(f"Printed: {escape(str(print_report(survey)))}", soft_wrap=True)


def say_results(survey: Project) -> None:
    """Say where the report is, and how to see the survey in 3-D."""
    results = os.path.relpath(survey.results)
    shown = results if not results.startswith("..") else str(survey.results)
    console.print(f"Report: {escape(os.path.join(shown, PAGE))}", soft_wrap=True)
    console.print(f"3-D view: photogram view {escape(shlex.quote(shown))} --open", soft_wrap=True)


def _stop_at_errors(survey: Project) -> None:
    """Validate the project and print errors and warnings; leave with exit code 1 where there are errors."""
    findings = [finding for finding in validate_project(survey) if finding.severity != "note"]
    if findings:
        console.print(findings_table(findings, f"Validation of {survey.path}"))
    if has_errors(findings):
        console.print(verdict(findings))
        console.print("Nothing was processed; --no-check processes in spite of errors.")
        raise typer.Exit(1)


def _pool(workers: int | None, scheduler: str | None) -> AbstractContextManager[Pool | None]:
    """Return the processes that are asked for, None where the work is done in threads."""
    if scheduler is not None:
        return cluster(scheduler)
    return nullcontext() if workers is None else ProcessPool(workers)


def run(
    project: Path,
    photographs: Path | None,
    *,
    start: str | None,
    until: str | None,
    pdf: bool,
    strict: bool,
    check: bool,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Process a survey and show the essentials of its report."""
    survey = load_project(project, photographs)
    if check:
        _stop_at_errors(survey)
    with _pool(workers, scheduler) as pool, bars() as progress:
        watcher = Terminal(progress, stage_weights(survey, until))
        report = run_pipeline(survey, watcher=watcher, start=start, until=until, pool=pool)
    if report:
        show_report(report)
        say_results(survey)
        if pdf:
            say_printed(survey)
        if strict and report["blunders"]:
            raise typer.Exit(1)
