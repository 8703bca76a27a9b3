"""What `photogram audit` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from photogram import __version__
from photogram.exchange.audit.audit import audited
from photogram.exchange.audit.beside import check_shared, checks_of
from photogram.exchange.audit.foreign_block import foreign_block
from photogram.exchange.audit.page import AuditTables, FigureRow, audit_page
from photogram.exchange.audit.tables import tables
from photogram.exchange.formats.recognition import read_solution
from photogram.files.atomic import make_folder, replacing
from photogram.files.npz_json import write_json
from photogram.files.solutions.solution import with_checks
from photogram.terminal.console import console, steps


def run(path: Path, crs: str | None, checks: list[str], beside: list[Path], output: Path) -> None:
    """Audit a solution, further ones beside it; show its figures and write the page and all figures."""
    with steps("Audit") as progress:
        solutions = []
        for each in (path, *beside):
            progress(0, 0, f"reading {each.name}")
            solutions.append(read_solution(each))
        for other in solutions[1:]:
            check_shared(solutions[0], other)
        named = checks_of(solutions, checks, crs)
        solutions = [with_checks(solution, names) for solution, names in zip(solutions, named, strict=True)]
        starts = [(solution, foreign_block(solution, crs)) for solution in solutions]
        found = tables(audited(*starts[0], progress, starts[1:]))
    _show(found)
    make_folder(output)
    write_json(output / "audit.json", {"photogram": __version__, **asdict(found)})
    with replacing(output / "audit.html") as temporary:
        temporary.write_text(audit_page(found, __version__), encoding="utf-8")
    console.print(f"Audit: {escape(str(output / 'audit.html'))}", soft_wrap=True)


def _show(found: AuditTables) -> None:
    console.print(found.about, markup=False, highlight=False)
    _print("Their figures and ours", "figure", found, found.figures)
    if found.checks:
        _print("Check points: adjusted minus surveyed, m", "check point", found, found.checks)
    for title, sentences in (("Contradicts", found.contradictions), ("Left out", found.left_out)):
        for sentence in sentences:
            console.print(f"{title}: {sentence}", markup=False, highlight=False)
    if not found.contradictions:
        console.print("Nothing contradicts the result.")


def _print(title: str, first: str, found: AuditTables, rows: Sequence[FigureRow]) -> None:
    table = Table(title=title)
    table.add_column(first)
    for column in (*found.columns[:-1], "photogram"):
        table.add_column(escape(column), justify="right")
    for row in rows:
        table.add_row(escape(row.name), *(escape(cell) for cell in row.cells))
    console.print(table)
