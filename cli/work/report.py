"""What `photogram report` does."""

from pathlib import Path

from rich.markup import escape

from photogram.pipeline.finished_report import labels_of_before, report_of
from photogram.pipeline.pipeline import load_project
from photogram.terminal.console import console


def run(project: Path, photographs: Path | None, pdf: bool) -> None:
    """Regenerate the page of a finished survey, and print it if asked for."""
    survey = load_project(project, photographs)
    page, *printed = report_of(survey, pdf=pdf)
    console.print(f"Written: {escape(str(page))}", soft_wrap=True)
    for path in printed:
        console.print(f"Printed: {escape(str(path))}", soft_wrap=True)
    for sentence in labels_of_before(survey):
        console.print(sentence, soft_wrap=True)
