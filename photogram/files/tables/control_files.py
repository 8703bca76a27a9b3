"""Ground points and their image marks from text files: tables of surveyors' programs, and OpenDroneMap's gcp_list.txt.

Everything is returned as it stands in the file: positions in the file's own CRS, pixels with the file's own origin and
picture size.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

from photogram.errors import ControlPointError
from photogram.files.photographs.names import SUFFIXES
from photogram.files.tables.column_names import MARKS, POINTS, Names, plain
from photogram.files.tables.crs_lines import crs_of_line, crs_of_remarks, glued_crs, names_crs, without_crs
from photogram.files.tables.gcp_lists import read_gcp_list
from photogram.files.tables.layout import Lines, is_figure, layout_of, unnamed_columns
from photogram.files.tables.point_file import PointFile, check_marks, mark_of
from photogram.files.tables.solutions import solution_of
from photogram.files.tables.surveyed_points import (
    IMPORTED,
    RAW,
    Mark,
    MarkSource,
    PartialSigma3,
    SurveyedPoint,
)
from photogram.files.tables.table import Row, Table, read_table, without_column
from photogram.files.text_lines import MARK_KIND, NUMBER, SIGMA_M, SIGMA_PX, Errors, Note, lines_of_table
from photogram.survey import Role, Roles
from photogram.wording import shortened, some

PROPOSED = "proposed_point"
"""The first column of a table of proposals, which no reader takes for marks."""

_PROPOSALS = "holds proposals, which are no marks yet: confirm them, and give the table of marks"
_ROLES: tuple[Role, ...] = get_args(Role)
_HOLDING = "points"
_MARK_FORM = "name,photograph,u,v"


def _numbers(texts: Sequence[str], whats: Sequence[str], line: int, errors: Errors) -> tuple[float, ...] | None:
    values = [errors.number(text, what, line) for text, what in zip(texts, whats, strict=True)]
    known = tuple(v for v in values if v is not None)
    return known if len(known) == len(values) else None


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


def _sigmas(row: Row, line: int, errors: Errors, table: Table) -> PartialSigma3:
    """Return the sigma of each axis: its own column, else that of the plan, else the one of all axes."""
    whole, plan, x, y, z = (
        _sigma(row, column, line, errors, unit_m=table.unit_m(column))
        for column in ("sigma", "sigma_plan", "sigma_east", "sigma_north", "sigma_height")
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


def _plan(table: Table) -> tuple[str, str, bool | None]:
    """Return the columns of the plan, and whether they are degrees: easting and northing, which are in the CRS that
    the surveyor has chosen, before longitude and latitude, and before x and y, of which only the figures tell."""
    pairs: tuple[tuple[str, str, bool | None], ...] = (
        ("easting", "northing", False), ("longitude", "latitude", True), ("x", "y", None),
    )  # fmt: skip
    there = [pair for pair in pairs if table.has(*pair[:2])]
    filled = [pair for pair in there if table.fills(*pair[:2])]
    if there:
        return (filled or there)[0]
    words = "easting and northing, longitude and latitude, or x and y"
    table.errors.note(table.line, f"no columns for the position: the first line must name them, {words}")
    table.errors.raise_all()
    raise AssertionError


def _unpaired(table: Table) -> list[str]:
    """Return the coordinates in plan that a table has one of."""
    pairs = (("easting", "northing"), ("longitude", "latitude"), ("x", "y"))
    return [q for pair in pairs for q in pair if table.has(q) and not table.has(*pair)]


def _height(table: Table) -> str:
    """Return the quantity that the heights of a table are."""
    quantity = next((q for q in ("height", "ellipsoidal_height") if table.has(q)), None)
    if quantity is None:
        table.errors.note(table.line, without_column("height", POINTS))
        table.errors.raise_all()
    return str(quantity)


def _are_ellipsoidal(table: Table, height: str) -> bool | None:
    """Return whether heights are above the ellipsoid, None where neither their name nor a second column says it."""
    if height == "ellipsoidal_height":
        return True
    if not table.fills("ellipsoidal_height"):
        return None
    both = [(row[height], row["ellipsoidal_height"]) for _, row in table.rows]
    same = [NUMBER.fullmatch(a) and NUMBER.fullmatch(b) and float(a) == float(b) for a, b in both]
    return True if all(same) else None if any(same) else False


def _geodetic(table: Table) -> tuple[tuple[float, float], ...] | None:
    """Return longitude and latitude of points that have easting and northing too; None where they do not have them
    all."""
    if not table.fills("longitude", "latitude"):
        return None
    texts = [(row["longitude"], row["latitude"]) for _, row in table.rows]
    if not all(NUMBER.fullmatch(text) for row in texts for text in row):
        return None
    return tuple((float(longitude), float(latitude)) for longitude, latitude in texts)


def _read_point_table(path: Path, lines: Lines, columns: Sequence[str] | None) -> PointFile:
    table = read_table(path, lines, ControlPointError, POINTS, ("name",), columns=columns)
    first, second, geographic = _plan(table)
    quantities = (first, second, _height(table))
    errors, points, unfixed = table.errors, dict[str, SurveyedPoint](), []
    for line, row in table.rows:
        name = row["name"]
        if not name:
            errors.note(line, "the point has no name: give it one")
            continue
        if errors.name(name, "the name", line) is None:
            continue
        whats = [f"{table.columns[q]} of {name}" for q in quantities]
        position = _numbers([row[q] for q in quantities], whats, line, errors)
        sigma_m, role = _sigmas(row, line, errors, table), _role(row, line, errors)
        solution = solution_of(row.get("solution", ""))
        if name in points:
            errors.note(
                line, f"{name!r} is used twice, first in line {points[name].line}: give each point its own name"
            )
        elif position is not None:
            x, y, z = position
            points[name] = SurveyedPoint(name, (x, y, z), sigma_m, role, line=line)
            unfixed += [(name, solution)] if solution in ("float", "single") else []
    errors.raise_all()
    unused = [table.columns[q] for q in _unpaired(table)]
    text = f"passed over for want of a second coordinate: {some(unused)}"
    notes = (Note(text, "name the columns of both coordinates"),) if unused else ()
    systems = dict.fromkeys(row.get("cs_name", "") for _, row in table.rows)
    return PointFile(
        path,
        crs_of_remarks(table.remarks),
        geographic,
        False,
        tuple(points.values()),
        (),
        unit_m=table.units_m(quantities),
        geodetic=_geodetic(table) if geographic is False else None,
        cs_name=next(iter(systems)) if len(systems) == 1 else "",
        heights_ellipsoidal=_are_ellipsoidal(table, quantities[2]),
        is_order_open=geographic is None,
        is_named=table.is_named,
        columns=table.names,
        unfixed=tuple(unfixed),
        notes=(*notes, *table.notes),
    )


def _is_mark_row(text: str, *, is_headed: bool) -> bool:
    """Return whether a line is one of a gcp_list.txt: five figures and a photograph, where another line names columns;
    else one of the two, for it may lack the other."""
    bare = without_crs(text.strip())
    split = (bare.split(), bare.split("\t"), re.split("[,;]", bare))
    five = any(len(fields) > 5 and all(is_figure(field.strip()) for field in fields[:5]) for fields in split)
    named = any(field.strip().lower().endswith(SUFFIXES) for fields in split for field in fields)
    return (five and named) if is_headed else (five or named)


def _is_gcp_list(path: Path, lines: Lines, *, is_headed: bool) -> bool:
    """Return whether lines are those of a gcp_list.txt, not of a table, whose columns a line may name: they have rows
    of it, or are nothing else."""
    first = lines[0][1].strip()
    if glued_crs(first) is not None or any(_is_mark_row(text, is_headed=is_headed) for _, text in lines[:3]):
        return True
    rows = lines[1:] if names_crs(first) else lines
    if not rows or (not is_headed and "gcp_list" in path.name.lower()):
        return True
    layout = layout_of(rows, POINTS)
    return not (path.suffix.lower() == ".csv" or is_headed or unnamed_columns(layout, POINTS))


def read_points(path: Path, columns: Sequence[str] | None = None) -> PointFile:
    """Return the ground points of a gcp_list.txt or of a table, told by what is in it; ``columns`` name the columns of
    a table that does not.

    Raises ControlPointError with one line for each error, ``path:line: what is wrong: what to do``.
    """
    lines, notes = lines_of_table(path, ControlPointError, _HOLDING)
    said = [(n, text) for n, text in lines if not text.lstrip().startswith("#")]
    crs = crs_of_line(said[0][1].strip()) if said and names_crs(said[0][1]) else None
    is_headed = bool(layout_of(lines, POINTS).names)
    if not said and not is_headed:
        raise ControlPointError(f"{path}:1: the file is empty: give the file with the points")
    if said and _is_proposals(re.split("[,;\\t]", said[0][1])):
        raise ControlPointError(f"{path}:{said[0][0]}: {_PROPOSALS}")
    if said and columns is None and _is_gcp_list(path, said, is_headed=is_headed):
        errors = Errors(path, ControlPointError)
        points = read_gcp_list(path, said, errors)
        errors.raise_all()
        return replace(points, notes=notes)
    points = _read_point_table(path, lines if crs is None else said[1:], columns)
    return replace(points, crs=crs or points.crs, notes=(*notes, *points.notes))


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


def _is_proposals(names: Sequence[str]) -> bool:
    return bool(names) and plain(names[0]) == PROPOSED


def read_mark_rows(
    path: Path, lines: Lines, known: Names, *, proposed: bool = False, may_be_empty: bool = False
) -> Table:
    """Return the rows of a table of marks, or of proposals, by the quantities ``known``. Raises ControlPointError where
    a column is missing, and where the table holds proposals, or none, other than ``proposed`` says."""
    header = layout_of(lines, {**known, "name": (*known["name"], PROPOSED)})
    line = header.line or lines[0][0]
    if _is_proposals(header.names) and not proposed:
        raise ControlPointError(f"{path}:{line}: {_PROPOSALS}")
    if proposed and not _is_proposals(header.names):
        raise ControlPointError(f"{path}:{line}: holds marks, no proposals: give a table of proposals")
    if proposed:
        known = {**known, "name": (PROPOSED,)}
    needed = ("name", "photograph", "u", "v", *(("score",) if proposed else ()))
    return read_table(path, lines, ControlPointError, known, needed, form=_MARK_FORM, may_be_empty=may_be_empty)


def read_marks(path: Path) -> tuple[Mark, ...]:
    """Return the image marks of a table: columns name, photograph, u, v and, where given, kind, sigma_px for both
    coordinates or sigma_u and sigma_v, and their correlation rho.

    The columns raw_u and raw_v tell a table in which each mark is kept beside its click; its pixels are photogram's.
    Raises ControlPointError with one line for each error, as read_points does.
    """
    lines, _ = lines_of_table(path, ControlPointError, _HOLDING)
    table = read_mark_rows(path, lines, MARKS)
    errors = table.errors
    of_photogram = table.has("raw_u", "raw_v")
    read = []
    for line, row in table.rows:
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
