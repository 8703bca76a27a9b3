"""Tables of marks and of proposals, ``marks.csv`` and ``proposals.csv``: written whole, and read back as they were.

The same marks give the same bytes: sorted by point and photograph, numbers with the digits that give them back.
``tables.control_files.read_marks`` reads the marks for a project, and refuses proposals.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from photogram.errors import ControlPointError
from photogram.files.atomic import replacing
from photogram.files.tables.column_names import MARKS as QUANTITIES
from photogram.files.tables.control_files import PROPOSED, read_mark_rows
from photogram.files.tables.point_file import check_marks
from photogram.files.tables.surveyed_points import Mark, MarkSource, Proposal
from photogram.files.tables.table import Row
from photogram.files.text_lines import Errors, lines_of, quoted, text_of

MARKS, PROPOSALS = "marks.csv", "proposals.csv"
"""What the tables are called."""

COLUMNS = ("point", "photograph", "u", "v", "sigma_u", "sigma_v", "rho", "kind", "time", "raw_u", "raw_v", "doubtful")
_DOUBTFUL = {"": False, "no": False, "yes": True}


# ---- writing -------------------------------------------------------------------------------------------------------


def _pair(pair: tuple[float, float] | None) -> tuple[str, str]:
    return ("", "") if pair is None else (repr(float(pair[0])), repr(float(pair[1])))


def _cells(mark: Mark) -> list[str]:
    rho = "" if mark.sigma_px is None and not mark.rho else repr(float(mark.rho))
    return [
        quoted(mark.point),
        quoted(mark.photograph),
        *_pair(mark.pixel),
        *_pair(mark.sigma_px),
        rho,
        mark.kind,
        mark.time,
        *_pair(mark.raw_pixel),
        "yes" if mark.is_doubtful else "",
    ]


def _text(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "".join(",".join(row) + "\n" for row in (header, *rows))


def _write(path: Path, text: str) -> None:
    with replacing(path) as partial, partial.open("wb") as stream:
        stream.write(text.encode())
        stream.flush()
        os.fsync(stream.fileno())


def text_of_marks(marks: Iterable[Mark]) -> str:
    """Return the table of marks, as ``write_marks`` writes it."""
    return _text(COLUMNS, map(_cells, sorted(marks, key=lambda mark: mark.key)))


def write_marks(path: Path, marks: Iterable[Mark]) -> None:
    """Write a table of marks. Raises WorkspaceError where it cannot be written."""
    _write(path, text_of_marks(marks))


def write_proposals(path: Path, proposals: Iterable[Proposal]) -> None:
    """Write a table of proposals, whose first column says what they are. Raises WorkspaceError where it cannot be
    written."""
    ordered = sorted(proposals, key=lambda proposal: proposal.mark.key)
    rows = ([*_cells(p.mark), repr(float(p.score))] for p in ordered)
    _write(path, _text((PROPOSED, *COLUMNS[1:], "score"), rows))


# ---- reading -------------------------------------------------------------------------------------------------------


def _two(row: Row, columns: tuple[str, str], line: int, errors: Errors) -> tuple[float, float] | None:
    texts = [row.get(column, "") for column in columns]
    if not any(texts):
        return None
    first, second = (errors.number(text, column, line) for text, column in zip(texts, columns, strict=True))
    return None if first is None or second is None else (first, second)


def _mark(row: Row, line: int, errors: Errors) -> Mark | None:
    pixel = _two(row, ("u", "v"), line, errors)
    sigma_px = _two(row, ("sigma_u", "sigma_v"), line, errors)
    raw_pixel = _two(row, ("raw_u", "raw_v"), line, errors)
    rho = errors.number(row.get("rho") or "0", "rho", line)
    doubtful = _DOUBTFUL.get(row.get("doubtful", "").lower())
    if doubtful is None:
        errors.note(line, f"doubtful must be yes, no or empty, found {row['doubtful']!r}: correct it")
    if pixel is None:
        if not row["u"] and not row["v"]:
            errors.note(line, "u and v are empty: remove the line, or give the mark")
        return None
    if rho is None or doubtful is None:
        return None
    kind, time = row.get("kind") or "raw", row.get("time", "")
    try:
        place, source = (row["name"], row["photograph"]), MarkSource(line, is_of_photogram=True)
        return Mark(*place, pixel, sigma_px, rho, kind, time, raw_pixel, doubtful, source)
    except ControlPointError as error:
        errors.note(line, str(error))
        return None


def _read(path: Path, proposed: bool) -> list[tuple[Mark, Row]]:
    lines = lines_of(path, ControlPointError, "marks", "#")
    known = {**QUANTITIES, **{column: (column,) for column in (*COLUMNS[7:], "score")}}
    table = read_mark_rows(path, lines, known, proposed=proposed, may_be_empty=True)
    errors = table.errors
    marks = []
    for line, row in table.rows:
        mark = _mark(row, line, errors)
        if mark is not None:
            marks.append((mark, row))
    check_marks([mark for mark, _ in marks], errors)
    errors.raise_all()
    return marks


def has_rows(path: Path) -> bool:
    """Return whether a table is there and says something below its first line, which it does not while nobody has
    marked anything. Raises ControlPointError where it cannot be read."""
    if not path.exists():
        return False
    lines = (line.strip() for line in text_of(path, ControlPointError).splitlines())
    return sum(bool(line) and not line.startswith("#") for line in lines) > 1


def read_marks(path: Path) -> tuple[Mark, ...]:
    """Return the marks of a table in its order, as ``write_marks`` was given them.

    People may edit it: an empty kind is raw, and what else is empty is not known. Raises ControlPointError with a line
    for each error.
    """
    return tuple(mark for mark, _ in _read(path, proposed=False))


def read_proposals(path: Path) -> tuple[Proposal, ...]:
    """Return the proposals of a table in its order. Raises ControlPointError with a line for each error."""
    errors = Errors(path, ControlPointError)
    proposals: list[Proposal] = []
    for mark, row in _read(path, proposed=True):
        line = mark.source.line
        score = errors.number(row["score"], "score", line)
        try:
            proposals += [] if score is None else [Proposal(replace(mark, source=MarkSource(0)), score)]
        except ControlPointError as error:
            errors.note(line, str(error))
    errors.raise_all()
    return tuple(proposals)
