"""What `photogram audit` does."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from photogram import __version__
from photogram.audit.audit import audited
from photogram.audit.foreign_block import foreign_block, with_checks
from photogram.audit.tables import tables
from photogram.cli.screen.terminal import console, steps
from photogram.files.atomic import make_folder, replacing
from photogram.files.exchange.recognition import read_solution
from photogram.files.npz_json import write_json
from photogram.report.audit_page import AuditTables, audit_page


def run(path: Path, crs: str | None, checks: list[str], output: Path) -> None:
    """Audit a solution; show its figures and write the page and all figures."""
    with steps("Audit") as progress:
        progress(0, 0, f"reading {path.name}")
        solution = read_solution(path)
        solution = with_checks(solution, checks)
        start = foreign_block(solution, crs)
        found = tables(audited(solution, start, lambda text: progress(0, 0, text)))
    _show(found)
    make_folder(output)
    write_json(output / "audit.json", {"photogram": __version__, **asdict(found)})
    with replacing(output / "audit.html") as temporary:
        temporary.write_text(audit_page(found, __version__), encoding="utf-8")
    console.print(f"Audit: {escape(str(output / 'audit.html'))}", soft_wrap=True)


def _show(found: AuditTables) -> None:
    console.print(found.about, markup=False, highlight=False)
    table = Table(title="Their figures and ours")
    for title in ("figure", found.program, "photogram, their weights", "photogram"):
        table.add_column(escape(title), justify="left" if title == "figure" else "right")
    for row in found.figures:
        table.add_row(escape(row.name), row.theirs, row.same, row.ours)
    console.print(table)
    for title, sentences in (("Contradicts", found.contradictions), ("Left out", found.left_out)):
        for sentence in sentences:
            console.print(f"{title}: {sentence}", markup=False, highlight=False)
    if not found.contradictions:
        console.print("Nothing contradicts the result.")
