"""What `photogram report` does."""

from __future__ import annotations

from pathlib import Path

from rich.markup import escape

from photogram.cli.work.adjust import say_printed
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.report_files import remake_report
from photogram.terminal.console import console


def run(project: Path, photographs: Path | None, pdf: bool) -> None:
    """Regenerate the page of a finished survey, and print it if asked for."""
    survey = load_project(project, photographs)
    console.print(f"Written: {escape(str(remake_report(survey)))}", soft_wrap=True)
    if pdf:
        say_printed(survey)
