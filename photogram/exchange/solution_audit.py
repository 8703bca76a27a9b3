"""Another program's solution read, adjusted again, and written as tables and a page."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from photogram import __version__
from photogram.exchange.audit.audit import audited
from photogram.exchange.audit.foreign_block import foreign_block
from photogram.exchange.audit.further_solutions import check_shared, checks_of
from photogram.exchange.audit.page import AuditTables, audit_page
from photogram.exchange.audit.tables import tables
from photogram.exchange.formats.recognition import read_solution
from photogram.files.atomic import make_folder, write_whole
from photogram.files.npz_json import write_json
from photogram.files.solutions.solution import with_checks
from photogram.wording import Progress, silent

PAGE, FIGURES = "audit.html", "audit.json"


def audit(
    solution: Path | str,
    *,
    crs: str | None = None,
    check: Sequence[str] = (),
    others: Sequence[Path | str] = (),
    progress: Progress = silent,
) -> AuditTables:
    """Adjust the measurements of another program's solution again, and return both results side by side.

    ``crs`` is that of its ground points where its files do not say it, ``check`` are the names of ground points that
    are to test both, ``others`` further programs' solutions of the same photographs. Raises ExchangeError where
    nothing is recognised, files are damaged, or solutions share no photograph; AdjustmentError where the measurements
    do not determine the block.
    """
    solutions = []
    for each in map(Path, (solution, *others)):
        progress(0, 0, f"reading {each.name}")
        solutions.append(read_solution(each))
    for other in solutions[1:]:
        check_shared(solutions[0], other)
    named = checks_of(solutions, check, crs)
    solutions = [with_checks(each, names) for each, names in zip(solutions, named, strict=True)]
    starts = [(each, foreign_block(each, crs)) for each in solutions]
    return tables(audited(*starts[0], progress, starts[1:]))


def write_audit(folder: Path | str, result: AuditTables) -> tuple[Path, Path]:
    """Write the page and all figures of an audit into a folder; returns their paths. Raises WorkspaceError where they
    cannot be written."""
    page, figures = Path(folder) / PAGE, Path(folder) / FIGURES
    make_folder(Path(folder))
    write_json(figures, {"photogram": __version__, **asdict(result)})
    write_whole(page, audit_page(result, __version__))
    return page, figures
