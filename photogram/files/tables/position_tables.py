"""Positions of photographs from tables: CSV as PPK programs write it, and RTKLIB's .pos of events.

A table names its columns in a line, or the project does; what they may be called stands in ``column_names``.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.files.atomic import replacing
from photogram.files.tables.column_names import POSITIONS
from photogram.files.tables.crs_lines import crs_of_line, crs_of_remarks, names_crs
from photogram.files.tables.layout import cells_of, layout_of
from photogram.files.tables.position_files import (
    HOLDING,
    Format,
    PositionFile,
    PositionRow,
    Triple,
    check_on_globe,
    check_sigmas,
    format_of,
    gps_time,
    read_mrk,
)
from photogram.files.tables.solutions import solution_of
from photogram.files.tables.table import Row, Table, read_table, without_column
from photogram.files.text_lines import Errors, lines_of, lines_of_table, quoted
from photogram.gnss import Sigma3, Solution
from photogram.wording import shortened

_ODM_COLUMNS = (
    "image_name", "geo_x", "geo_y", "geo_z", "yaw", "pitch", "roll", "accuracy_horizontal", "accuracy_vertical",
)  # fmt: skip
"""Of OpenDroneMap's geo.txt, which names none."""

_FORM = "photograph,easting,northing,height"

_TIME = re.compile(r"(\d{4})[-/](\d\d)[-/](\d\d)[T ]+(\d\d):(\d\d):(\d\d(?:\.\d+)?)Z?")


def _plan(table: Table) -> tuple[str, str, bool | None]:
    """Return the two columns of the plan position, and whether they are degrees, None where only the figures tell."""
    for first, second, geographic in (
        ("longitude", "latitude", True), ("easting", "northing", False), ("x", "y", None),
    ):  # fmt: skip
        if table.has(first, second):
            return first, second, geographic
    words = "longitude and latitude, or easting and northing"
    table.errors.note(table.line, f"no columns for the position: the first line must name them, {words}")
    return "", "", None


def _solution(text: str, line: int, errors: Errors) -> Solution:
    solution = solution_of(text)
    if solution is None:
        errors.note(
            line,
            f"the solution {shortened(text)!r} is not known: write fix, float or single, RTKLIB's Q (1 fix, 2 float, 5 "
            "single) or DJI's RtkFlag (50, 34, 16)",
        )
    return solution or "unknown"


def _sigma(row: Row, line: int, errors: Errors, table: Table) -> Sigma3 | None:
    """Return the sigma of each axis, m: its own column, else that of the plan, else the one of all axes."""
    stated: dict[str, float] = {}
    for column in ("sigma", "sigma_plan", "sigma_east", "sigma_north", "sigma_height"):
        text = row.get(column, "")
        value = errors.number(text, column, line) if text else None
        value = value if value is None else value * (table.unit_m(column) or 1.0)
        if value is not None and value < 0.0:
            errors.note(line, f"{column} must not be below 0, found {text}: give the standard deviation in metres")
        elif value is not None:
            check_sigmas(line, [value], errors)
        if value:  # zero stands for not known
            stated[column] = value
    of_all = stated.get("sigma")
    of_plan = stated.get("sigma_plan", of_all)
    east, north = stated.get("sigma_east", of_plan), stated.get("sigma_north", of_plan)
    up = stated.get("sigma_height", of_all)
    return None if east is None or north is None or up is None else (east, north, up)


def _triple(row: Row, columns: Sequence[str], line: int, errors: Errors) -> Triple | None:
    values = [errors.number(row.get(column, ""), column, line) for column in columns]
    first, second, third = values
    return None if first is None or second is None or third is None else (first, second, third)


def _attitude(row: Row, line: int, errors: Errors) -> Triple | None:
    given = [column for column in ("yaw", "pitch", "roll") if row.get(column)]
    return _triple(row, given, line, errors) if len(given) == 3 else None


def _time(text: str) -> datetime | None:
    fields = _TIME.fullmatch(text.strip())
    if fields is None:
        return None
    year, month, day, hour, minute = (int(fields[k]) for k in range(1, 6))
    second = float(fields[6])
    try:
        return datetime(year, month, day, hour, minute, int(second), round(second % 1 * 1e6) % 1_000_000)
    except ValueError:
        return None


def _rows(table: Table, quantities: Sequence[str], gps_times: Mapping[int, datetime]) -> list[PositionRow]:
    rows, errors, is_named = [], table.errors, table.has("photograph")
    for line, row in table.rows:
        if is_named and not row["photograph"]:
            errors.note(line, "has no photograph: give its file name")
        errors.name(row.get("photograph", ""), "the photograph", line)
        position = _triple(row, quantities, line, errors)
        sigma, solution = _sigma(row, line, errors, table), _solution(row.get("solution", ""), line, errors)
        attitude = _attitude(row, line, errors)
        if position is not None:
            time = gps_times.get(line) or _time(row.get("time", ""))
            rows.append(
                PositionRow(line, position, row.get("photograph") or None, None, time, sigma, solution, attitude)
            )
    return rows


def _file(table: Table, kind: Format, gps_times: Mapping[int, datetime]) -> PositionFile:
    """Return the positions of a table. Raises ProjectError with every error."""
    errors = table.errors
    first, second, geographic = _plan(table)
    height = next((quantity for quantity in ("ellipsoidal_height", "height") if table.has(quantity)), "")
    missing = [] if height else ["height"]
    missing += ["photograph"] if kind == "csv" and not table.has("photograph") else []
    for quantity in missing:
        errors.note(table.line, without_column(quantity, POSITIONS))
    if missing or not first:
        # Without its columns no row means anything.
        errors.raise_all()
    quantities = (first, second, height)
    rows = _rows(table, quantities, gps_times)
    if geographic is None:
        geographic = bool(rows) and all(abs(r.position[0]) <= 180.0 and abs(r.position[1]) <= 180.0 for r in rows)
    if geographic:
        for row in rows:
            check_on_globe(row, errors)
    errors.raise_all()
    return PositionFile(
        table.path,
        kind,
        geographic,
        tuple(rows),
        table.units_m(quantities),
        crs_of_remarks(table.remarks),
        True if height == "ellipsoidal_height" and kind == "csv" else None,
        table.notes,
    )


def read_positions_table(path: Path, columns: Sequence[str] | None = None) -> PositionFile:
    """Read a table of positions, or OpenDroneMap's geo.txt; ``columns`` name the columns of a table that does not.
    Raises ProjectError with every error."""
    lines, notes = lines_of_table(path, ProjectError, HOLDING)
    said = [(n, text) for n, text in lines if not text.lstrip().startswith("#")]
    crs = crs_of_line(said[0][1].strip()) if len(said) > 1 and names_crs(said[0][1]) else None
    if crs is not None:
        lines = said[1:]
        layout = layout_of(lines, POSITIONS)
        if columns is None and not layout.names:
            columns = _ODM_COLUMNS[: max(len(cells_of(text, layout.separator)) for _, text in layout.body)]
    table = read_table(path, lines, ProjectError, POSITIONS, (), columns=columns, form=_FORM, strict=False)
    file = _file(table, "csv", {})
    return replace(file, crs=crs or file.crs, notes=(*notes, *file.notes))


def read_pos(path: Path) -> PositionFile:
    """Read the solution that RTKLIB and the programs built on it write for the moments of exposure (``_events.pos``).

    It names no photographs: they are matched in their order. Raises ProjectError with every error.
    """
    lines = lines_of(path, ProjectError, HOLDING)
    headers = [(n, text) for n, text in lines if text.lstrip().startswith("%") and "latitude" in text.lower()]
    body = [(n, text) for n, text in lines if not text.lstrip().startswith("%")]
    if not headers or "'" in headers[-1][1]:
        raise ProjectError(
            f"{path}:{lines[0][0]}: no header line with latitude(deg) longitude(deg) height(m): choose "
            "latitude, longitude and height in decimal degrees as RTKLIB's output"
        )
    header = headers[-1][1]
    names = re.split(r"[\s,;]+", header.lstrip("% \t").strip())
    names[:1] = ["date", "clock"]
    split = [(n, [f for f in re.split(r"[\s,;]+", text.strip()) if f]) for n, text in body]
    errors = Errors(path, ProjectError)
    times = {}
    for n, fields in split:
        time = _pos_time(fields)
        if time is not None:
            times[n] = time
        elif fields:
            text = shortened(" ".join(fields[:2]))
            errors.note(n, f"{text!r} is not a time: expected date and clock, or GPS week and seconds")
    errors.raise_all()
    rows = [(n, "\t".join(fields)) for n, fields in split]
    table = read_table(path, rows, ProjectError, POSITIONS, (), columns=names, strict=False)
    return _file(table, "pos", times)


def _pos_time(fields: Sequence[str]) -> datetime | None:
    """Return GPS time of the first two fields: date and clock, or week and seconds of the week."""
    if len(fields) < 2:
        return None
    if fields[0].isdecimal():
        try:
            return gps_time(int(fields[0]), float(fields[1])) if len(fields[0]) < 10 else None
        except ValueError:
            return None
    return _time(f"{fields[0]} {fields[1]}")


def read_positions(path: Path, kind: Format | None = None, columns: Sequence[str] | None = None) -> PositionFile:
    """Read a file of positions, its format told by ``kind`` or by its name; ``columns`` name those of a table that does
    not. Raises ProjectError with every error."""
    form = kind or format_of(path)
    if form == "csv":
        return read_positions_table(path, columns)
    return read_mrk(path) if form == "mrk" else read_pos(path)


# ---- writing ---------------------------------------------------------------------------------------------------------


def write_positions(
    path: Path, positions: Mapping[str, tuple[FloatArray, FloatArray | None]], *, geographic: bool
) -> None:
    """Write positions (3,) and their sigmas (3,), None where there are none, by the names of photographs: easting or
    longitude first, with every digit. Raises WorkspaceError where the file cannot be written."""
    plan = ("longitude", "latitude") if geographic else ("easting", "northing")
    rows = [",".join(("photograph", *plan, "height", "sigma_east", "sigma_north", "sigma_height"))]
    for name, (position, sigma) in positions.items():
        stated = ("", "", "") if sigma is None else (repr(s) for s in sigma.tolist())
        rows.append(",".join((quoted(name), *(repr(x) for x in position.tolist()), *stated)))
    with replacing(path) as partial:
        partial.write_text("\n".join(rows) + "\n", encoding="utf-8")
