"""The rows of a table by the quantities of its columns, whatever program has written it; figures with a decimal point.

How it is written is found out by ``layout``; what its columns are called stands in ``column_names``.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from photogram.errors import PhotogramError
from photogram.files.tables.column_names import WORDS, Names, all_names, plain, quantity_of, says_nothing
from photogram.files.tables.column_units import UnitsM, length_unit_m, unread_unit
from photogram.files.tables.figures import decimal_mark, degrees_of, in_plain_form
from photogram.files.tables.layout import Lines, cells_or_error, layout_of, unnamed_columns
from photogram.files.text_lines import Errors, Note
from photogram.wording import shortened, some

Row = Mapping[str, str]
"""The cells of a row by their quantity, figures with a decimal point; empty where there is none."""

_ALIKE = 0.85
"""How alike a column's name and a known one are at least where it will be a slip of the pen."""

_ANGLES = ("longitude", "latitude", "x", "y")
_COORDINATES = ("longitude", "latitude", "easting", "northing", "x", "y", "height", "ellipsoidal_height", "u", "v")
FORM = "name,easting,northing,height"


@dataclass(frozen=True)
class Table:
    """The rows of a file with the numbers of their lines.

    ``columns`` are the names of the columns that count, by their quantity; ``line`` is that in which they stand, the
    first one where none names them, which is then not ``is_named``. ``names`` are those of all columns, ``unknown`` the
    names of the columns that are not known, ``remarks`` the lines above the rows, ``errors`` what is wrong with rows so
    far, for their reader to raise.
    """

    path: Path
    columns: Mapping[str, str]
    line: int
    is_named: bool
    rows: Sequence[tuple[int, Row]]
    errors: Errors
    names: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def unit_m(self, quantity: str) -> float | None:
        """Return the unit of a quantity that its column's name states, m, None where it states none."""
        return length_unit_m(self.columns.get(quantity, ""))

    def units_m(self, quantities: Sequence[str]) -> UnitsM:
        """Return the units of three quantities, as ``unit_m`` does."""
        first, second, third = map(self.unit_m, quantities)
        return first, second, third

    def fills(self, *quantities: str) -> bool:
        """Return whether each of the quantities has a column, and a cell in every row."""
        return all(q in self.columns and all(row[q] for _, row in self.rows) for q in quantities)

    def has(self, *quantities: str) -> bool:
        """Return whether each of the quantities has a column."""
        return all(q in self.columns for q in quantities)

    @property
    def notes(self) -> tuple[Note, ...]:
        """Return what is to be said of columns that are not known."""
        text = f"columns that are not known are passed over: {some(self.unknown)}"
        return (Note(text, "rename those that should count"),) if self.unknown else ()


def _places(names: Sequence[str], known: Names, strict: bool, line: int, errors: Errors) -> dict[str, int]:
    """Return where the column of each quantity stands; of several, the one whose name comes first."""
    places: dict[str, int] = {}
    for quantity, accepted in known.items():
        of_quantity = [i for i, name in enumerate(names) if quantity_of(name, known) == quantity]
        own = [plain(names[i]) for i in of_quantity]
        first = next((name for name in (*accepted, *own) if name in own), None)
        if first is None:
            continue
        places[quantity] = of_quantity[own.index(first)]
        called = names[places[quantity]]
        if own.count(first) > 1:
            errors.note(line, f"the column {called!r} is there twice: keep one of the two")
        unit = unread_unit(called)
        if unit is not None:
            errors.note(line, f"the unit {unit!r} of {called!r} is not read: write the column in metres or feet")
    for name in _unknown(names, known) if strict else ():
        near = difflib.get_close_matches(plain(name), list(all_names(known)), n=1, cutoff=_ALIKE)
        if near:
            errors.note(line, f"unknown column {shortened(name)!r}: did you mean {near[0]!r}?")
    return places


def _unknown(names: Sequence[str], known: Names) -> tuple[str, ...]:
    return tuple(name for name in names if quantity_of(name, known) is None and not says_nothing(name))


def _note_rivals(names: Sequence[str], cells: Sequence[tuple[int, list[str]]], known: Names, errors: Errors) -> None:
    """Note coordinates that two columns give differently: an antenna's height is no height of a point."""
    columns: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        quantity = quantity_of(name, known)
        if quantity in _COORDINATES:
            columns.setdefault(str(quantity), []).append(i)
    for quantity, own in columns.items():
        differing = (n for n, row in cells if len({row[i] for i in own if i < len(row) and row[i]}) > 1)
        line = next(differing, None)
        if line is not None:
            both = " and ".join(repr(shortened(names[i])) for i in own[:2])
            text = f"the columns {both} differ, and both are names of the {quantity.replace('_', ' ')}"
            errors.note(line, f"{text}: remove one of the two, or rename it")


def _in_plain_form(rows: Sequence[tuple[int, dict[str, str]]], errors: Errors) -> list[tuple[int, Row]]:
    """Return rows whose figures have a decimal point; note the first that may mean two things."""
    figures = [(n, cell) for n, row in rows for quantity, cell in row.items() if quantity not in WORDS]
    mark = decimal_mark(cell for _, cell in figures)
    if mark == "unclear":
        line, cell = next((n, cell) for n, cell in figures if "," in cell)
        text = f"{shortened(cell)} may be {cell.replace(',', '.')} or {cell.replace(',', '')}"
        errors.note(line, f"{text}: write the figures of this file with a decimal point")
        errors.raise_all()
    plain_rows = list[tuple[int, Row]]()
    for line, row in rows:
        own = {q: cell if q in WORDS else in_plain_form(cell, mark) for q, cell in row.items()}
        plain_rows.append((line, own | {q: degrees_of(own[q]) for q in _ANGLES if q in own}))
    return plain_rows


def _too_many(cells: Sequence[str], names: Sequence[str], separator: str) -> str:
    """Return the error of a row with more cells than there are columns."""
    text = f"{len(cells)} fields, but the first line names {len(names)}: "
    digits = [cell for cell in cells if cell.lstrip("+-").isdecimal()]
    if separator == "," and len(cells) >= len(names) + 2 and len(digits) > len(cells) // 2:
        return text + "decimal commas cannot be told from those between columns: separate columns by semicolons"
    return text + "check separators, quotes"


def _unnamed(body: Lines, form: str) -> str:
    """Return the error of a table whose columns nothing names, with the form that would be right."""
    if not body:
        return f"no line names its columns, and there are no rows: write a first line, {form} for example"
    return (
        f"no line names its columns, and {shortened(body[0][1])!r} does not tell them: write a first line, {form} for "
        "example, or give columns in the project file"
    )


def without_column(quantity: str, known: Names) -> str:
    """Return the error of a table in which no column is a quantity."""
    words = ", ".join(known[quantity][:8])
    return f"no column for {quantity}: the first line, or columns in the project file, must name it, as {words}"


def read_table(
    path: Path,
    lines: Lines,
    error: type[PhotogramError],
    known: Names,
    needed: Sequence[str],
    *,
    columns: Sequence[str] | None = None,
    form: str = FORM,
    strict: bool = True,
    may_be_empty: bool = False,
) -> Table:
    """Return the table that ``lines`` of a file are, by the quantities ``known``.

    ``columns`` name the columns where the file does not, or wrongly; where nothing names them, rows of a name, three
    figures and words have the plan as x and y. ``strict`` takes names that are nearly known for slips of the pen,
    ``form`` is a first line as it may be. Raises ``error`` where a column that is ``needed`` is missing.
    """
    errors = Errors(path, error)
    layout = layout_of(lines, known, columns)
    line = layout.line or lines[0][0]
    names = layout.names or unnamed_columns(layout, known)
    if not names:
        errors.note(line, _unnamed(layout.body, form))
    places = _places(names, known, strict and columns is None, line, errors)
    for quantity in needed if names else ():
        if quantity not in places:
            errors.note(line, without_column(quantity, known))
    # Without its columns no row means anything.
    errors.raise_all()
    read = [(n, cells_or_error(n, text, layout.separator, errors)) for n, text in layout.body]
    cells = [(n, own) for n, own in read if any(own)]
    rows = []
    for n, own in cells:
        if any(own[len(names) :]):
            errors.note(n, _too_many(own, names, layout.separator))
        else:
            rows.append((n, {q: own[i] if i < len(own) else "" for q, i in places.items()}))
    if not may_be_empty and all(own and not any(own) for _, own in read):
        errors.note(line, "no rows after the first line")
    _note_rivals(names, cells, known, errors)
    called = {quantity: names[i] for quantity, i in places.items()}
    is_named = bool(layout.names)
    plain_rows = _in_plain_form(rows, errors)
    unknown = _unknown(names, known)
    return Table(path, called, line, is_named, plain_rows, errors, tuple(names), unknown, layout.remarks)
