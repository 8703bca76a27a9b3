"""What `photogram export` does."""

from pathlib import Path

from rich.markup import escape

from photogram.exchange.formats.names import SolutionFormat
from photogram.exchange.solution_export import export_solution
from photogram.terminal.console import console


def run(project: Path, form: SolutionFormat, output: Path, photographs: Path | None) -> None:
    """Write an adjusted survey for another program, and say what its files do not hold."""
    for sentence in export_solution(project, form, output, photographs=photographs):
        console.print(f"Not in it: {escape(sentence)}", soft_wrap=True, highlight=False)
    console.print(f"Exported: {escape(str(output))}", soft_wrap=True, highlight=False)
