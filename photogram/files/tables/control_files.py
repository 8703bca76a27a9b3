"""Ground points and their image marks from text files: OpenDroneMap's gcp_list.txt, and tables (CSV).

Everything is returned as it stands in the file: positions in the file's own CRS, pixels with the file's own origin and
picture size.
"""

import csv
import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from photogram.errors import ControlPointError
from photogram.files.tables.column_units import NO_UNITS, UnitsM, length_unit_m, without_unit
from photogram.files.tables.surveyed_points import (
    IMPORTED,
    RAW,
    Mark,
    MarkSource,
    PartialSigma3,
    SurveyedPoint,
)
from photogram.files.text_lines import MARK_KIND, NUMBER, SIGMA_M, SIGMA_PX, Errors, lines_of
from photogram.survey import Role, Roles
from photogram.wording import shortened

Row = dict[str, str]

_SEPARATORS = (";", "\t", ",")
_ROLES: tuple[Role, ...] = get_args(Role)
_COMMENT = re.compile(r"(?:^|\s)#(?:\s.*)?$")
_UTM = re.compile(r"'?WGS ?84\s*/?\s*UTM\s*(?:zone\s*)?(\d{1,2})\s*([C-HJ-NP-X])'?", re.IGNORECASE)
"""A zone with N or S of its half of the globe, or with the letter of a latitude band; S is taken for south."""
_WGS84 = re.compile(r"'?WGS ?84'?", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
_GCP_LIST = "x y z u v photograph [name]"

_POINT_COLUMNS: Mapping[str, tuple[str, ...]] = {
    "name": ("name", "point", "id", "label"),
    "x": ("x", "easting", "east", "e", "lon", "longitude"),
    "y": ("y", "northing", "north", "n", "lat", "latitude"),
    "z": ("z", "height", "h", "elevation", "altitude"),
    "sigma": ("sigma",),
    "sigma_plan": ("sigma_plan", "sigma_xy"),
    "sigma_x": ("sigma_x", "sigma_easting", "sigma_east", "sigma_e"),
    "sigma_y": ("sigma_y", "sigma_northing", "sigma_north", "sigma_n"),
    "sigma_z": ("sigma_z", "sigma_height", "sigma_h"),
    "role": ("role",),
    "role_plan": ("role_plan",),
    "role_height": ("role_height",),
}
MARK_COLUMNS: Mapping[str, tuple[str, ...]] = {
    "name": ("name", "point", "id", "label"),
    "photograph": ("photograph", "photo", "image", "picture", "file", "filename"),
    "u": ("u", "x", "px", "column"),
    "v": ("v", "y", "py", "row"),
    "sigma": ("sigma",),
    "sigma_u": ("sigma_u",),
    "sigma_v": ("sigma_v",),
    "rho": ("rho",),
    "kind": ("kind",),
}
PROPOSED = "proposed_point"
"""The first column of a table of proposals, which no reader takes for marks."""

_OF_MARKS = ("doubtful", "raw_u", "raw_v")
_PASSED_OVER = ("code", "comment", "date", "description", "note", "remark", "remarks", "time")


@dataclass(frozen=True)
class PointFile:
    """The points of one file, and the marks where it holds them too.

    ``crs`` is what the file itself says; ``geographic`` whether its columns are called longitude and latitude (True),
    easting and northing (False), or neither (None); ``holds_marks`` is true of gcp_list.txt and of Metashape's markers.
    ``unit_m`` are the units of the three coordinates that its columns state, m; None counts as the CRS does.
    ``without_position`` names points whose marks are left out because the file has no coordinates of them.
    """

    path: Path
    crs: str | None
    geographic: bool | None
    holds_marks: bool
    points: tuple[SurveyedPoint, ...]
    marks: tuple[Mark, ...]
    format: Literal["gcp_list", "table", "metashape"] = "table"
    without_position: tuple[str, ...] = ()
    unit_m: UnitsM = NO_UNITS


def _numbers(texts: Sequence[str], whats: Sequence[str], line: int, errors: Errors) -> tuple[float, ...] | None:
    values = [errors.number(text, what, line) for text, what in zip(texts, whats, strict=True)]
    known = tuple(v for v in values if v is not None)
    return known if len(known) == len(values) else None


def mark_of(
    place: tuple[str, str],
    pixel: tuple[float, float],
    source: MarkSource,
    errors: Errors,
    sigma_px: tuple[float, float] | None = None,
    rho: float = 0.0,
    kind: str = IMPORTED,
) -> Mark | None:
    """Return the mark of a point in a photograph, None with an error noted where it is none."""
    try:
        return Mark(*place, pixel, sigma_px, rho, kind, source=source)
    except ControlPointError as error:
        errors.note(source.line, str(error))
        return None


def check_marks(marks: Iterable[Mark], errors: Errors) -> None:
    """Note every second mark of a point in a photograph."""
    first: dict[tuple[str, str], int] = {}
    for mark in marks:
        line = mark.source.line
        if (before := first.setdefault(mark.key, line)) != line:
            text = f"point {mark.point} is marked twice in {mark.photograph}, first in line {before}"
            errors.note(line, f"{text}: keep one of the two, or write the folders of two photographs of this name")


# ---- gcp_list.txt --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Observation:
    line: int
    position: tuple[float, float, float]
    pixel: tuple[float, float]
    photograph: str
    name: str | None


def _header_crs(header: str) -> str:
    utm = _UTM.fullmatch(header)
    if utm and 1 <= int(utm[1]) <= 60:
        north = utm[2].upper() >= "N" and utm[2].upper() != "S"
        return f"EPSG:{326 if north else 327}{int(utm[1]):02d}"
    if _WGS84.fullmatch(header):
        return "EPSG:4326"
    text = header.strip("'\"")
    return text.upper() if text.lower().startswith("epsg:") else text


def _observation(line: int, text: str, errors: Errors) -> _Observation | None:
    text = _COMMENT.sub("", text).strip()
    fields = [field.strip() for field in text.split("\t")]
    by_comma = [field.strip() for field in re.split("[,;]", text)]
    if len(fields) < 6 and len(by_comma) >= 6 and all(NUMBER.fullmatch(field) for field in by_comma[:5]):
        fields = by_comma
    if len(fields) < 6:
        fields = text.split()
    if len(fields) >= 6 and all(map(_DECIMAL_COMMA.fullmatch, fields[:2])):
        fields[:5] = [field.replace(",", ".") for field in fields[:5]]
    if len(fields) < 6:
        errors.note(line, f"{len(fields)} fields, expected {_GCP_LIST}, separated by spaces, tabs or commas")
        return None
    numbers = _numbers(fields[:5], ("x", "y", "z", "u", "v"), line, errors)
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


def _read_gcp_list(path: Path, lines: Sequence[tuple[int, str]], errors: Errors) -> PointFile:
    first, header = lines[0]
    text = _COMMENT.sub("", header).strip()
    headed = not NUMBER.fullmatch(text.split()[0])
    crs = _header_crs(text) if headed else None
    observations = [_observation(n, line, errors) for n, line in lines[1 if headed else 0 :]]
    rows = [row for row in observations if row is not None]
    if not observations:
        errors.note(first, f"no points after the first line: each line after it is {_GCP_LIST}")
    points: dict[str, SurveyedPoint] = {}
    read = []
    for name, row in _named(rows, errors):
        points.setdefault(name, SurveyedPoint(name, row.position, line=row.line))
        read.append(mark_of((name, row.photograph), row.pixel, MarkSource(row.line), errors))
    marks = [mark for mark in read if mark is not None]
    check_marks(marks, errors)
    return PointFile(path, crs, None, True, tuple(points.values()), tuple(marks), format="gcp_list")


# ---- tables --------------------------------------------------------------------------------------------------------


def _separator(header: str) -> str:
    return next((s for s in _SEPARATORS if s in header), ",")


def _plain(column: str) -> str:
    """Return a column's name without its unit and in one spelling: ``Sigma Height [m]`` is sigma_height."""
    return re.sub(r"[\s.-]+", "_", without_unit(column).lower()).strip("_")


def _meaning(column: str, known: Mapping[str, tuple[str, ...]]) -> str | None:
    return next((key for key, words in known.items() if _plain(column) in words), None)


def _columns(
    header: Sequence[str], line: int, known: Mapping[str, tuple[str, ...]], needed: Sequence[str], errors: Errors
) -> dict[str, int]:
    places: dict[str, int] = {}
    for i, column in enumerate(header):
        meaning = _meaning(column, known)
        if meaning is None:
            passed_over = _PASSED_OVER + (_OF_MARKS if "photograph" in known else ())
            if column and not column.startswith("#") and _plain(column) not in passed_over:
                near = difflib.get_close_matches(_plain(column), [w for words in known.values() for w in words], n=1)
                hint = f"did you mean {near[0]!r}?" if near else "remove it, or begin its name with # to skip it"
                errors.note(line, f"unknown column {shortened(column)!r}: {hint}")
        elif meaning in places:
            errors.note(line, f"columns {header[places[meaning]]!r} and {column!r} are the same: keep one of the two")
        else:
            places[meaning] = i
    for meaning in needed:
        if meaning not in places:
            words = ", ".join(known[meaning])
            errors.note(line, f"no column for {meaning}: the first line must name the columns, this one as {words}")
    return places


def rows_of(
    path: Path,
    lines: Sequence[tuple[int, str]],
    known: Mapping[str, tuple[str, ...]],
    needed: Sequence[str],
    *,
    proposed: bool = False,
    may_be_empty: bool = False,
) -> tuple[list[str], list[tuple[int, Row]], Errors]:
    """Return the header of a table, its rows with their line numbers by the meaning of their columns, and the errors of
    the rows so far, for the caller to raise.

    Raises ControlPointError where the first line does not name the columns that are ``needed``, and where the table
    holds proposals, or none, other than ``proposed`` says.
    """
    errors = Errors(path, ControlPointError)
    number, text = lines[0]
    separator = _separator(text)
    header = _fields(text, separator, number, errors)
    if (bool(header) and _plain(header[0]) == PROPOSED) != proposed:
        content = "holds marks, no proposals" if proposed else "holds proposals, which are no marks yet"
        remedy = "give a table of proposals" if proposed else "confirm them, and give the table of marks"
        raise ControlPointError(f"{path}:{number}: {content}: {remedy}")
    if proposed:
        header = ["point", *header[1:]]
    places = _columns(header, number, known, needed, errors)
    # Without its columns no row means anything.
    errors.raise_all()
    rows = []
    has_bad_rows = False
    for line, content in lines[1:]:
        fields = _fields(content, separator, line, errors)
        if any(fields[len(header) :]):
            has_bad_rows = True
            errors.note(line, f"{len(fields)} fields, but the first line names {len(header)}: check separators, quotes")
        elif any(fields):
            rows.append((line, {m: fields[i] if i < len(fields) else "" for m, i in places.items()}))
    if not rows and not has_bad_rows and not may_be_empty:
        errors.note(number, "no rows after the first line")
    return header, rows, errors


def _fields(text: str, separator: str, line: int, errors: Errors) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([text], delimiter=separator, skipinitialspace=True))]
    except csv.Error as error:
        errors.note(line, f"is not a table row ({error}): check separators and quotes")
        return []


def _sigma(
    row: Row, column: str, line: int, errors: Errors, within: tuple[float, float] = SIGMA_M, unit_m: float | None = None
) -> float | None:
    text = row.get(column, "")
    if not text:
        return None
    value = errors.number(text, column, line)
    value = value if value is None or unit_m is None else value * unit_m
    low, high = within
    if value is not None and not low <= value <= high:
        allowed = f"from {low:g} to {high:g}"
        errors.note(line, f"{column} must be {allowed}, found {shortened(text)}: give the standard deviation")
        return None
    return value


def _sigmas(row: Row, line: int, errors: Errors, units_m: Mapping[str, float | None]) -> PartialSigma3:
    """Return the sigma of each axis: its own column, else that of the plan, else the one of all axes."""
    whole, plan, x, y, z = (
        _sigma(row, column, line, errors, unit_m=units_m.get(column))
        for column in ("sigma", "sigma_plan", "sigma_x", "sigma_y", "sigma_z")
    )
    plan = whole if plan is None else plan
    return plan if x is None else x, plan if y is None else y, whole if z is None else z


def _role(row: Row, line: int, errors: Errors) -> Roles | None:
    given: dict[str, Role] = {}
    for column in ("role", "role_plan", "role_height"):
        if not row.get(column):
            continue
        role = next((r for r in _ROLES if r == row[column].lower()), None)
        if role is None:
            errors.note(line, f"{column} must be control or check, found {shortened(row[column])!r}")
            return None
        given[column] = role
    if not given:
        return None
    plan, height = (given.get(column, given.get("role")) for column in ("role_plan", "role_height"))
    if plan is None or height is None:
        missing = "role_plan" if plan is None else "role_height"
        errors.note(line, f"{missing} is empty: give both, or one column role")
        return None
    return plan, height


def _read_point_table(path: Path, lines: Sequence[tuple[int, str]]) -> PointFile:
    header, rows, errors = rows_of(path, lines, _POINT_COLUMNS, ("name", "x", "y", "z"))
    called = {_meaning(column, _POINT_COLUMNS): _plain(column)[:3] for column in header}
    geographic = {("lon", "lat"): True, ("eas", "nor"): False}.get((called["x"], called["y"]))
    units_m = {_meaning(column, _POINT_COLUMNS) or "": length_unit_m(column) for column in header}
    points: dict[str, SurveyedPoint] = {}
    for line, row in rows:
        name = row["name"]
        if not name:
            errors.note(line, "the point has no name: give it one")
            continue
        if errors.name(name, "the name", line) is None:
            continue
        position = _numbers([row[axis] for axis in "xyz"], [f"{axis} of {name}" for axis in "xyz"], line, errors)
        sigma_m, role = _sigmas(row, line, errors, units_m), _role(row, line, errors)
        if name in points:
            errors.note(
                line, f"{name!r} is used twice, first in line {points[name].line}: give each point its own name"
            )
        elif position is not None:
            x, y, z = position
            points[name] = SurveyedPoint(name, (x, y, z), sigma_m, role, line=line)
    errors.raise_all()
    unit_m = units_m["x"], units_m["y"], units_m["z"]
    return PointFile(path, None, geographic, False, tuple(points.values()), (), unit_m=unit_m)


def read_points(path: Path) -> PointFile:
    """Return the ground points of a gcp_list.txt or of a table.

    A table is told by its name, which ends in .csv, or by a first line that names its columns. Raises ControlPointError
    with one line for each error, ``path:line: what is wrong: what to do``.
    """
    lines = lines_of(path, ControlPointError, "points", "#")
    header = lines[0][1]
    meanings = {_meaning(column, _POINT_COLUMNS) for column in header.split(_separator(header))}
    if path.suffix.lower() == ".csv" or {"x", "y"} <= meanings:
        return _read_point_table(path, lines)
    errors = Errors(path, ControlPointError)
    points = _read_gcp_list(path, lines, errors)
    errors.raise_all()
    return points


def _mark_sigmas_px(row: Row, line: int, errors: Errors) -> tuple[float, float] | None:
    """Return sigma_u and sigma_v, else sigma for both."""
    whole, u, v = (_sigma(row, column, line, errors, SIGMA_PX) for column in ("sigma", "sigma_u", "sigma_v"))
    if bool(row.get("sigma_u")) != bool(row.get("sigma_v")):
        missing = "sigma_v" if row.get("sigma_u") else "sigma_u"
        errors.note(line, f"{missing} is empty: give both, or one column sigma_px")
    if u is not None and v is not None:
        return u, v
    return None if whole is None else (whole, whole)


def _kind(row: Row, unstated: str, line: int, errors: Errors) -> str | None:
    """Return how a mark was measured, ``unstated`` where its row does not say, None with an error noted where it is no
    word."""
    kind = row.get("kind", "")
    if kind and not MARK_KIND.fullmatch(kind):
        text = f"kind must be a word in lower case, found {shortened(kind)!r}: correct it"
        errors.note(line, f"{text}, or begin the name of the column with # to skip it")
        return None
    return kind or unstated


def read_marks(path: Path) -> tuple[Mark, ...]:
    """Return the image marks of a table: columns name, photograph, u, v and, where given, kind, sigma_px for both
    coordinates or sigma_u and sigma_v, and their correlation rho.

    The columns raw_u and raw_v tell a table in which each mark is kept beside its click; its pixels are photogram's.
    Raises ControlPointError with one line for each error, as read_points does.
    """
    header, rows, errors = rows_of(
        path, lines_of(path, ControlPointError, "points", "#"), MARK_COLUMNS, ("name", "photograph", "u", "v")
    )
    of_photogram = {"raw_u", "raw_v"} <= {_plain(column) for column in header}
    read = []
    for line, row in rows:
        empty = [what for what in ("name", "photograph") if not row[what]]
        if empty:
            errors.note(line, f"{' and '.join(empty)} is empty: say which point is marked, and in which photograph")
            continue
        if any(errors.name(row[what], f"the {what}", line) is None for what in ("name", "photograph")):
            continue
        pixel = _numbers([row["u"], row["v"]], ("u", "v"), line, errors)
        sigma_px = _mark_sigmas_px(row, line, errors)
        rho = errors.number(row.get("rho") or "0", "rho", line)
        kind = _kind(row, RAW if of_photogram else IMPORTED, line, errors)
        if pixel is not None and rho is not None and kind is not None:
            place, source = (row["name"], row["photograph"]), MarkSource(line, of_photogram)
            read.append(mark_of(place, (pixel[0], pixel[1]), source, errors, sigma_px, rho, kind))
    marks = tuple(mark for mark in read if mark is not None)
    check_marks(marks, errors)
    errors.raise_all()
    return marks
