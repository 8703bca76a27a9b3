"""What `photogram report` does."""

from pathlib import Path

from rich.markup import escape

from photogram.pipeline.finished_report import write_report
from photogram.terminal.console import console


def run(project: Path, photographs: Path | None, pdf: bool) -> None:
    """Regenerate the page of a finished survey, and print it if asked for."""
    page, *printed = write_report(project, photographs=photographs, pdf=pdf)
    console.print(f"Written: {escape(str(page))}", soft_wrap=True)
    for path in printed:
        console.print(f"Printed: {escape(str(path))}", soft_wrap=True)
