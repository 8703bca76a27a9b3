"""OpenDroneMap's gcp_list.txt: a CRS, then a line for each mark with the place of its point.

Fields are separated by blanks, tabs, commas or semicolons; rows without a name of their point are joined by its place.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from photogram.files.photographs.names import SUFFIXES
from photogram.files.tables.crs_lines import crs_of_line, glued_crs, row_crs, without_crs
from photogram.files.tables.layout import Lines, is_figure
from photogram.files.tables.point_file import PointFile, check_marks, mark_of
from photogram.files.tables.surveyed_points import MarkSource, SurveyedPoint
from photogram.files.text_lines import NUMBER, Errors

_COMMENT = re.compile(r"(?:^|\s)#(?:\s.*)?$")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
NO_CODE = "EPSG:0"
"""What a program writes before a row whose CRS it does not know."""

_FORM = "x y z u v photograph [name]"


@dataclass(frozen=True)
class _Observation:
    line: int
    position: tuple[float, float, float]
    pixel: tuple[float, float]
    photograph: str
    name: str | None


def _numbers(texts: Sequence[str], line: int, errors: Errors) -> tuple[float, ...] | None:
    values = [errors.number(text, what, line) for text, what in zip(texts, ("x", "y", "z", "u", "v"), strict=True)]
    known = tuple(v for v in values if v is not None)
    return known if len(known) == len(values) else None


def _with_blanks_in_name(fields: list[str]) -> list[str]:
    """Return the fields of a row with those joined that are one photograph, up to its suffix."""
    if len(fields) < 6:
        return fields
    end = next((i for i, field in enumerate(fields) if i >= 5 and field.lower().endswith(SUFFIXES)), 5)
    return [*fields[:5], " ".join(fields[5 : end + 1]), *fields[end + 1 :]]


def _observation(line: int, text: str, errors: Errors) -> _Observation | None:
    text = without_crs(_COMMENT.sub("", text).strip())
    fields = [field.strip() for field in text.split("\t")]
    by_comma = [field.strip() for field in re.split("[,;]", text)]
    if len(fields) < 6 and len(by_comma) >= 6 and sum(map(is_figure, by_comma[:5])) > 3:  # one may be no number
        fields = by_comma
    if len(fields) < 6:
        fields = _with_blanks_in_name(text.split())
    if len(fields) >= 6 and all(map(_DECIMAL_COMMA.fullmatch, fields[:2])):
        fields[:5] = [field.replace(",", ".") for field in fields[:5]]
    if len(fields) < 6:
        errors.note(line, f"{len(fields)} fields, expected {_FORM}, separated by spaces, tabs or commas")
        return None
    numbers = _numbers(fields[:5], line, errors)
    if numbers is None:
        return None
    x, y, z, u, v = numbers
    if (
        errors.name(fields[5], "the photograph", line) is None
        or errors.name(" ".join(fields[6:]), "name", line) is None
    ):
        return None
    return _Observation(line, (x, y, z), (u, v), fields[5], " ".join(fields[6:]).strip() or None)


def _named(rows: Sequence[_Observation], errors: Errors) -> list[tuple[str, _Observation]]:
    """Return the rows with the name of their point; those without one are joined by their position."""
    place: dict[str, _Observation] = {}
    names: dict[tuple[float, float, float], list[str]] = {}
    for row in rows:
        if row.name is None:
            continue
        first = place.setdefault(row.name, row)
        if first.position != row.position:
            errors.note(
                row.line,
                f"point {row.name} has another position than in line {first.line}: correct it, or give another name",
            )
        elif row.name not in names.setdefault(row.position, []):
            names[row.position].append(row.name)
    number = 0
    for row in rows:
        if row.name is None and row.position not in names:
            number += 1
            while f"p{number}" in place:
                number += 1
            names[row.position] = [f"p{number}"]
    named = []
    for row in rows:
        known = names.get(row.position, [])
        if row.name is None and len(known) > 1:
            errors.note(row.line, f"has no name, and its position is that of {' and '.join(known)}: name the point")
        else:
            named.append((row.name or known[0], row))
    return named


def _row_crs(lines: Lines, errors: Errors) -> str | None:
    """Return the CRS that every row names, None where none does."""
    codes = {crs: n for n, text in lines if (crs := row_crs(text)) not in (None, NO_CODE)}
    for code, line in list(codes.items())[1:]:
        errors.note(line, f"is in {code}, and others in {next(iter(codes))}: give each CRS a file of its own")
    return next(iter(codes), None)


def read_gcp_list(path: Path, lines: Lines, errors: Errors) -> PointFile:
    """Return the points and marks of a gcp_list.txt, its lines without comments; what is wrong is noted."""
    first, header = lines[0]
    text = _COMMENT.sub("", header).strip()
    glued = glued_crs(text)
    if glued is not None:
        errors.note(first, f"{glued} and the first row stand in one line: begin a new line behind {glued}")
        errors.raise_all()
    of_rows = row_crs(text) is not None
    headed = not of_rows and not NUMBER.fullmatch(re.split(r"[\s,;]", text)[0].replace(",", "."))
    crs = _row_crs(lines, errors) if of_rows else crs_of_line(text) if headed else None
    observations = [_observation(n, line, errors) for n, line in lines[1 if headed else 0 :]]
    rows = [row for row in observations if row is not None]
    if not observations:
        errors.note(first, f"no points after the first line: each line after it is {_FORM}")
    points: dict[str, SurveyedPoint] = {}
    read = []
    for name, row in _named(rows, errors):
        points.setdefault(name, SurveyedPoint(name, row.position, line=row.line))
        read.append(mark_of((name, row.photograph), row.pixel, MarkSource(row.line), errors))
    marks = [mark for mark in read if mark is not None]
    check_marks(marks, errors)
    return PointFile(path, crs, None, True, tuple(points.values()), tuple(marks), format="gcp_list")
