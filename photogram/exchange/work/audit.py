"""What `photogram audit` does."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from photogram.exchange.audit.page import AuditTables, FigureRow
from photogram.exchange.solution_audit import audit, write_audit
from photogram.terminal.console import console, steps


def run(path: Path, crs: str | None, checks: list[str], others: list[Path], output: Path) -> None:
    """Audit a solution, and further ones; show its figures and write the page and all figures."""
    with steps("Audit") as progress:
        result = audit(path, crs=crs, check=checks, others=others, progress=progress)
    _show(result)
    page, _ = write_audit(output, result)
    console.print(f"Audit: {escape(str(page))}", soft_wrap=True)


def _show(result: AuditTables) -> None:
    console.print(result.about, markup=False, highlight=False)
    _print("Their figures and ours", "figure", result, result.figures)
    if result.checks:
        _print("Check points: adjusted minus surveyed, m", "check point", result, result.checks)
    for title, sentences in (("Contradicts", result.contradictions), ("Left out", result.left_out)):
        for sentence in sentences:
            console.print(f"{title}: {sentence}", markup=False, highlight=False)
    if not result.contradictions:
        console.print("Nothing contradicts the result.")


def _print(title: str, first: str, result: AuditTables, rows: Sequence[FigureRow]) -> None:
    table = Table(title=title)
    table.add_column(first)
    for column in (*result.columns[:-1], "photogram"):
        table.add_column(escape(column), justify="right")
    for row in rows:
        table.add_row(escape(row.name), *(escape(cell) for cell in row.cells))
    console.print(table)
