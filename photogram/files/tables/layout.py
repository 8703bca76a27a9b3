"""How a table is written: the line that names its columns, what separates them, a line of units, remarks.

Found out from the text alone: programs separate columns by commas, semicolons, tabs, vertical bars or blanks, name them
behind ``#`` or below remarks, or not at all.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from photogram.files.tables.column_names import Names, quantity_of
from photogram.files.tables.column_units import is_unit
from photogram.files.tables.figures import degrees_of, in_plain_form
from photogram.files.text_lines import NUMBER, Errors

Lines = Sequence[tuple[int, str]]
"""Lines with their numbers."""

SEPARATORS = (";", "\t", ",", "|", " ")
_REMARK = re.compile(r"^\s*(?:#|%|//)+")
LONGEST_FIGURE = 200
_LATEST_HEADER = 60
"""How many lines may stand above the one that names the columns."""

_SAMPLE = 20
"""Rows from which the separator is told."""


@dataclass(frozen=True)
class Layout:
    """The names of the columns, empty where nothing names them, the number of their line, 0 for none, what separates
    the cells of the ``body``, and the ``remarks`` above it."""

    names: tuple[str, ...]
    line: int
    separator: str
    body: Lines
    remarks: tuple[str, ...]


def cells_of(text: str, separator: str) -> list[str]:
    """Return the cells of a line. Raises csv.Error where quotes do not fit."""
    if separator == " ":
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=separator, skipinitialspace=True))]


def cells_or_error(line: int, text: str, separator: str, errors: Errors) -> list[str]:
    """Return the cells of a line, none with an error noted where quotes do not fit."""
    try:
        return cells_of(text, separator)
    except csv.Error as cause:
        errors.note(line, f"is not a table row ({cause}): check separators and quotes")
        return []


def _tried(text: str, separator: str) -> list[str]:
    try:
        return cells_of(text, separator)
    except csv.Error:
        return []  # not separated so


def is_figure(cell: str) -> bool:
    """Return whether a cell is a figure in any of the forms that are read."""
    if len(cell) > LONGEST_FIGURE:
        return False
    return NUMBER.fullmatch(in_plain_form(in_plain_form(degrees_of(cell), "point"), "comma")) is not None


def _is_remark(text: str) -> bool:
    return _REMARK.match(text) is not None


def separator_of(body: Lines) -> str:
    """Return what separates the cells of rows: that which gives most rows of figures, blanks where no other does, for
    names may hold them."""

    def score(separator: str) -> tuple[int, bool, int, int]:
        figures = [sum(map(is_figure, _tried(text, separator))) for _, text in body[:_SAMPLE]]
        return sum(n > 1 for n in figures), separator != " ", sum(figures), -SEPARATORS.index(separator)

    return max(SEPARATORS, key=score)


def _header(lines: Lines, known: Names) -> tuple[int, list[str], str] | None:
    """Return the index of the line that names most quantities, two at least and three behind ``#``, its cells and what
    separates them; None where there is none."""
    best, most = None, 1
    for i, (_, text) in enumerate(lines[:_LATEST_HEADER]):
        least = max(most, 2) if _is_remark(text) else most
        for separator in SEPARATORS:
            names = _tried(_REMARK.sub("", text, count=1), separator)
            quantities = {quantity_of(name, known) for name in names} - {None}
            if len(quantities) > least and not any(map(is_figure, names)):
                best, most = (i, names, separator), len(quantities)
                least = most
    return best


def _units(body: Lines, separator: str) -> list[str] | None:
    """Return the cells of a line of units at the beginning of the body, None where there is none."""
    cells = [cell.strip("[]() ") for cell in _tried(body[0][1], separator)] if body else []
    stated = [cell for cell in cells if cell]
    return cells if len(stated) > 1 and all(map(is_unit, stated)) else None


def layout_of(lines: Lines, known: Names, columns: Sequence[str] | None = None) -> Layout:
    """Return how a table of ``lines``, at least one, is written, its columns named by ``columns`` where these are
    given."""
    head = _header(lines, known)
    index, names, separator = (-1, [], "") if head is None else head
    remarks = tuple(text for _, text in lines[: max(index, 0)] if _is_remark(text))
    body = [(n, text) for n, text in lines[index + 1 :] if not _is_remark(text)]
    units = None if separator in ("", " ") else _units(body, separator)
    if units is not None:
        units += [""] * (len(names) - len(units))
        names = [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=False)]
        body = body[1:]
    if separator in ("", " "):
        separator = separator_of(body)
    line = lines[index][0] if head is not None else 0
    if columns is not None:
        names = list(columns)
        # a first line that names the columns otherwise, in words of no list
        if head is None and body and not any(map(is_figure, _tried(body[0][1], separator))):
            body = body[1:]
    return Layout(tuple(names), line, separator, body, remarks)


def unnamed_columns(layout: Layout, known: Names) -> tuple[str, ...]:
    """Return the columns of rows that nothing names: a name, a place whose order is open, a height, words; none where
    the rows are of another form."""
    cells = _tried(layout.body[0][1], layout.separator) if layout.body else []
    figures = [is_figure(cell) for cell in cells]
    if layout.names or "height" not in known or len(cells) < 4 or not all(figures[1:4]) or any(figures[4:]):
        return ()
    return (next(iter(known)), "x", "y", "height", *("description" for _ in cells[4:]))
