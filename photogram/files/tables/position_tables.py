"""Positions of photographs from tables: CSV as PPK programs write it, and RTKLIB's .pos of events.

A table names its columns in its first line; columns that say nothing here are passed over. Accepted names are in
COLUMNS, without units and in any spelling: ``Sigma Height [m]``, ``sdu(m)``.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.files.atomic import replacing
from photogram.files.tables.column_units import length_unit_m, without_unit
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
from photogram.files.text_lines import Errors, lines_of, quoted
from photogram.gnss import Sigma3, Solution, solution_of_rtk_flag
from photogram.wording import shortened

Row = Mapping[str, str]

COLUMNS: Mapping[str, tuple[str, ...]] = {
    "photograph": (
        "photograph", "photo", "photo_name", "photoname", "image", "image_name", "imagename", "picture", "file",
        "filename", "file_name", "sourcefile", "name", "label",
    ),
    "longitude": ("longitude", "lon", "long", "lng", "gpslongitude", "gps_longitude"),
    "latitude": ("latitude", "lat", "gpslatitude", "gps_latitude"),
    "easting": ("easting", "east", "e"),
    "northing": ("northing", "north", "n"),
    "x": ("x", "x_longitude", "x_easting", "x_east"),
    "y": ("y", "y_latitude", "y_northing", "y_north"),
    "height": (
        "ellipsoidal_height", "height_ellipsoidal", "ellipsoid_height", "height_ell", "h_ell", "ellh", "hell", "height",
        "h", "altitude", "alt", "elevation", "z", "z_altitude", "z_height", "gpsaltitude", "gps_altitude", "up",
    ),
    "sigma": ("sigma", "accuracy"),
    "sigma_plan": (
        "sigma_plan", "sigma_xy", "accuracy_horz", "accuracy_horizontal", "horizontal_accuracy", "horz_accuracy",
        "accuracy_xy", "xy_accuracy", "h_accuracy", "acc_xy", "std_xy", "hacc", "h_acc", "sigmahoriz", "sigma_horiz",
        "lateral_rms",
    ),
    "sigma_east": (
        "sigma_east", "sigma_easting", "sigma_e", "sigma_x", "sigma_lon", "sigma_longitude", "sde", "sd_e", "sd_east",
        "sdeast", "sdlon", "std_e", "std_east", "std_x", "std_lon", "stdlon", "rtkstdlon", "x_acc", "x_accuracy",
        "x_std", "xstd", "easting_rms", "accuracy_x", "longitude_rms", "stddev_e", "stdev_e", "stddev_east",
    ),
    "sigma_north": (
        "sigma_north", "sigma_northing", "sigma_n", "sigma_y", "sigma_lat", "sigma_latitude", "sdn", "sd_n", "sd_north",
        "sdnorth", "sdlat", "std_n", "std_north", "std_y", "std_lat", "stdlat", "rtkstdlat", "y_acc", "y_accuracy",
        "y_std", "ystd", "northing_rms", "accuracy_y", "latitude_rms", "stddev_n", "stdev_n", "stddev_north",
    ),
    "sigma_height": (
        "sigma_height", "sigma_h", "sigma_z", "sigma_u", "sigma_up", "sigma_alt", "sdu", "sd_u", "sd_up", "sdheight",
        "sd_height", "sdhgt", "std_u", "std_up", "std_z", "std_h", "std_height", "std_hgt", "stdhgt", "rtkstdhgt",
        "z_acc", "z_accuracy", "z_std", "zstd", "elevation_rms", "height_rms", "ellipsoidal_height_rms",
        "accuracy_z", "accuracy_vert", "accuracy_vertical", "vertical_accuracy", "vert_accuracy", "v_accuracy",
        "vacc", "v_acc", "sigmavert", "sigma_vert", "stddev_u", "stdev_u", "stddev_up",
    ),
    "solution": (
        "solution", "solution_status", "solution_type", "q", "quality", "quality_flag", "fix", "fix_type",
        "fix_status", "status", "ambiguity_status", "gnss_status", "rtk_flag", "rtkflag", "flag",
    ),
    "yaw": ("yaw", "heading", "flight_yaw", "flightyawdegree"),
    "pitch": ("pitch", "flight_pitch", "flightpitchdegree"),
    "roll": ("roll", "flight_roll", "flightrolldegree"),
    "time": ("gps_time", "gpst", "gpstime", "gps_date_time", "time_gps"),
}  # fmt: skip

_RTKLIB_Q: Mapping[int, Solution] = {
    1: "fix", 2: "float", 3: "single", 4: "single", 5: "single", 6: "float",
}  # fmt: skip
"""RTKLIB's Q (manual 2.4.2, B.1): fix, float, SBAS, DGPS, single, PPP, which converges like a float."""

_WORDS: tuple[tuple[str, Solution], ...] = (
    ("fix", "fix"), ("float", "float"), ("single", "single"), ("auto", "single"), ("dgps", "single"),
    ("dgnss", "single"), ("sbas", "single"), ("ppp", "float"),
)  # fmt: skip
_UNFIXED = ("no fix", "nofix", "not fixed", "unfixed", "none")
_TIME = re.compile(r"(\d{4})[-/](\d\d)[-/](\d\d)[T ]+(\d\d):(\d\d):(\d\d(?:\.\d+)?)Z?")


def _plain(column: str) -> str:
    """Return a column's name without its unit and in one spelling: ``Sigma Height [m]`` is sigma_height."""
    words = without_unit(column).lstrip("#%").strip().lower()
    return re.sub(r"[\s./-]+", "_", words).strip("_")


def _columns(header: Sequence[str], line: int, errors: Errors) -> dict[str, int]:
    """Return where each meaning stands; of several columns the one whose name comes first in COLUMNS counts."""
    names = [_plain(column) for column in header]
    places: dict[str, int] = {}
    for meaning, known in COLUMNS.items():
        there = [name for name in known if name in names]
        if there:
            places[meaning] = names.index(there[0])
            if names.count(there[0]) > 1:
                errors.note(line, f"the column {there[0]!r} is there twice: keep one of the two")
    return places


def _plan(places: Mapping[str, int], line: int, errors: Errors) -> tuple[str, str, bool | None]:
    """Return the two columns of the plan position, and whether they are degrees, None where only the figures tell."""
    for first, second, geographic in (
        ("longitude", "latitude", True), ("easting", "northing", False), ("x", "y", None),
    ):  # fmt: skip
        if first in places and second in places:
            return first, second, geographic
    errors.note(
        line,
        "no columns for the position: the first line must name them, longitude and latitude, or easting and northing",
    )
    return "", "", None


def _solution(text: str, line: int, errors: Errors) -> Solution:
    """Return the solution of RTKLIB's Q, of DJI's RtkFlag, or of words such as FIX and "float"."""
    word = text.strip().lower()
    if not word:
        return "unknown"
    if word.isdecimal() and len(word) < 10:
        number = int(word)
        return _RTKLIB_Q.get(number) or solution_of_rtk_flag(number)
    if any(unfixed in word for unfixed in _UNFIXED):
        return "single"
    for part, solution in _WORDS:
        if part in word:
            return solution
    errors.note(
        line,
        f"the solution {shortened(text)!r} is not known: write fix, float or single, RTKLIB's Q (1 fix, 2 float, 5 "
        "single) or DJI's RtkFlag (50, 34, 16)",
    )
    return "unknown"


def _sigma(row: Row, line: int, errors: Errors, units_m: Mapping[str, float]) -> Sigma3 | None:
    """Return the sigma of each axis, m: its own column, else that of the plan, else the one of all axes."""
    stated: dict[str, float] = {}
    for column in ("sigma", "sigma_plan", "sigma_east", "sigma_north", "sigma_height"):
        text = row.get(column, "")
        value = errors.number(text, column, line) if text else None
        value = value if value is None else value * units_m.get(column, 1.0)
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


def _rows(
    table: Sequence[tuple[int, Row]],
    plan: tuple[str, str],
    errors: Errors,
    gps_times: Mapping[int, datetime],
    units_m: Mapping[str, float],
) -> list[PositionRow]:
    rows = []
    for line, row in table:
        position = _triple(row, (*plan, "height"), line, errors)
        sigma, solution = _sigma(row, line, errors, units_m), _solution(row.get("solution", ""), line, errors)
        attitude = _attitude(row, line, errors)
        if position is not None:
            time = gps_times.get(line) or _time(row.get("time", ""))
            rows.append(
                PositionRow(line, position, row.get("photograph") or None, None, time, sigma, solution, attitude)
            )
    return rows


def _file(
    path: Path,
    kind: Format,
    header: tuple[int, Sequence[str]],
    lines: Sequence[tuple[int, Sequence[str]]],
    gps_times: Mapping[int, datetime],
) -> PositionFile:
    """Return the positions of a table that has been taken to pieces. Raises ProjectError with every error."""
    errors = Errors(path, ProjectError)
    number, names = header
    places = _columns(names, number, errors)
    first, second, geographic = _plan(places, number, errors)
    for meaning in ("height", *(() if kind == "pos" else ("photograph",))):
        if meaning not in places:
            words = ", ".join(COLUMNS[meaning][:8])
            errors.note(number, f"no column for {meaning}: the first line must name the columns, this one as {words}")
    # Without its columns no row means anything.
    errors.raise_all()
    table = []
    for line, fields in lines:
        if any(fields[len(names) :]):
            errors.note(line, f"{len(fields)} fields, but the first line names {len(names)}: check separators, quotes")
        elif any(fields):
            cells = {meaning: fields[i] if i < len(fields) else "" for meaning, i in places.items()}
            table.append((line, cells))
            if "photograph" in places and not cells["photograph"]:
                errors.note(line, "has no photograph: give its file name")
            errors.name(cells.get("photograph", ""), "the photograph", line)
    if not lines:
        errors.note(number, "no rows after the first line")
    units_m = {meaning: unit for meaning, i in places.items() if (unit := length_unit_m(names[i])) is not None}
    rows = _rows(table, (first, second), errors, gps_times, units_m)
    if geographic is None:
        geographic = bool(rows) and all(abs(r.position[0]) <= 180.0 and abs(r.position[1]) <= 90.0 for r in rows)
    if geographic:
        for row in rows:
            check_on_globe(row, errors)
    errors.raise_all()
    unit_m = units_m.get(first), units_m.get(second), units_m.get("height")
    return PositionFile(path, kind, geographic, tuple(rows), unit_m)


def read_table(path: Path) -> PositionFile:
    """Read a table with a header, columns separated by commas, semicolons or tabs. Raises ProjectError with every
    error."""
    lines = lines_of(path, ProjectError, HOLDING)
    while len(lines) > 1 and lines[0][1].lstrip().startswith("#") and not re.search(r"[,;\t]", lines[0][1]):
        lines = lines[1:]  # a remark above the header
    separator = next((s for s in (";", "\t", ",") if s in lines[0][1]), ",")
    split = []
    for line, text in lines:
        try:
            split.append((line, [f.strip() for f in next(csv.reader([text], delimiter=separator))]))
        except csv.Error as error:
            raise ProjectError(f"{path}:{line}: is not a table row ({error}): check separators and quotes") from error
    return _file(path, "csv", split[0], [row for row in split[1:] if not row[1][0].startswith("#")], {})


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
    number, header = headers[-1]
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
    return _file(path, "pos", (number, names), split, times)


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


def read_positions(path: Path, kind: Format | None = None) -> PositionFile:
    """Read a file of positions, its format told by ``kind`` or by its name. Raises ProjectError with every error."""
    return {"mrk": read_mrk, "pos": read_pos, "csv": read_table}[kind or format_of(path)](path)


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
