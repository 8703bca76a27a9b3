"""Positions of photographs from files beside them: DJI's *_Timestamp.MRK, RTKLIB's .pos, tables (CSV) of PPK programs.

Everything is returned as it stands in the file, in metres and degrees: positions in the file's own CRS, whether they
are those of the camera or of the antenna being for others to say.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal

from photogram.errors import ProjectError
from photogram.files.tables.column_units import NO_UNITS, UnitsM
from photogram.files.text_lines import SIGMA_M, Errors, Note, lines_of
from photogram.gnss import Sigma3, Solution, solution_of_rtk_flag

Format = Literal["mrk", "pos", "csv"]
Triple = tuple[float, float, float]

GPS_EPOCH = datetime(1980, 1, 6)
LAST_WEEK = 9999
SECONDS_A_WEEK = 604_800
HOLDING = "positions"

_F = r"\s*([-+]?[\d.]+)\s*"
_MRK_LINE = re.compile(
    rf"\s*(\d{{1,9}})\s+{_F}\s*\[\s*(\d{{1,9}})\s*\]\s*{_F},\s*N\s*{_F},\s*E\s*{_F},\s*V\s*{_F},\s*Lat\s*{_F},\s*Lon\s*{_F},\s*Ellh"
    rf"\s*{_F},{_F},{_F}\s+(\d{{1,9}})\s*,\s*Q\s*"
)
_MRK_FORM = (
    "number, seconds, [week], north,N east,E down,V latitude,Lat longitude,Lon height,Ellh, three standard deviations "
    "and flag,Q"
)


@dataclass(frozen=True)
class PositionRow:
    """One position of a position file; None for what the file does not give."""

    line: int
    """Line in the file."""
    position: Triple
    """Longitude, latitude or easting, northing; height."""
    photograph: str | None = None
    """Name of the photograph."""
    number: int | None = None
    """Sequence number in the photograph's name."""
    gps_time: datetime | None = None
    """GPS time, without zone."""
    sigma_m: Sigma3 | None = None
    """Standard deviations along easting, northing and height."""
    solution: Solution = "unknown"
    """Kind of the GNSS solution."""
    attitude_deg: Triple | None = None
    """Yaw, pitch and roll of the aircraft."""
    lever_arm_m: Triple | None = None
    """Lever arm from antenna to camera along east, north and up."""


@dataclass(frozen=True)
class PositionFile:
    """The positions of one file; ``geographic`` says whether they are longitude and latitude, ``unit_m`` the units of
    the three coordinates that its columns state, m; None counts as the CRS does.

    ``crs`` is what the file itself says; ``heights_ellipsoidal`` what it says of its heights, None where it says
    nothing; ``notes`` are what is to be said of how it was read."""

    path: Path
    format: Format
    geographic: bool
    rows: tuple[PositionRow, ...]
    unit_m: UnitsM = NO_UNITS
    crs: str | None = None
    heights_ellipsoidal: bool | None = None
    notes: tuple[Note, ...] = ()


def check_on_globe(row: PositionRow, errors: Errors) -> None:
    """Note an error where longitude and latitude lie on no globe."""
    longitude, latitude, _ = row.position
    if abs(longitude) > 180.0 or abs(latitude) > 90.0:
        errors.note(
            row.line,
            f"longitude {longitude:.10g}, latitude {latitude:.10g} are impossible: check the order of the columns",
        )


def check_sigmas(line: int, sigmas_m: Iterable[float], errors: Errors) -> None:
    """Note an error where a standard deviation, m, cannot be one; zero stands for not known."""
    low, high = SIGMA_M
    for sigma in sigmas_m:
        if sigma != 0 and not low <= sigma <= high:
            errors.note(
                line, f"a standard deviation of {sigma:.10g} m must be 0 (not known), or from {low:g} to {high:g}"
            )


def gps_time(week: int, seconds: float) -> datetime | None:
    """Return GPS time from the week and the seconds of the week, None where there is no such time; the leap seconds to
    UTC are not taken off."""
    if not (0 <= week <= LAST_WEEK and 0 <= seconds <= SECONDS_A_WEEK):
        return None
    return GPS_EPOCH + timedelta(weeks=week, seconds=seconds)


def _mrk_row(line: int, text: str, errors: Errors) -> PositionRow | None:
    fields = _MRK_LINE.fullmatch(" ".join(text.split()))
    if fields is None:
        errors.note(line, f"is not a line of a DJI MRK file: expected {_MRK_FORM}")
        return None
    numbers = [errors.number(fields[k], "each value", line) for k in (2, *range(4, 13))]
    known = [n for n in numbers if n is not None]
    if len(known) < len(numbers):
        return None
    seconds, north_mm, east_mm, down_mm, latitude, longitude, height, *sigma = known
    time = gps_time(int(fields[3]), seconds)
    if time is None:
        errors.note(line, f"week {fields[3]} and {seconds:.10g} s is not a GPS time: correct the line")
        return None
    check_sigmas(line, sigma, errors)
    row = PositionRow(
        line,
        (longitude, latitude, height),
        number=int(fields[1]),
        gps_time=time,
        # zero stands for not known
        sigma_m=(sigma[1], sigma[0], sigma[2]) if min(sigma) > 0 else None,
        solution=solution_of_rtk_flag(int(fields[13])),
        lever_arm_m=(east_mm / 1000.0, north_mm / 1000.0, -down_mm / 1000.0),
    )
    check_on_globe(row, errors)
    return row


def read_mrk(path: Path) -> PositionFile:
    """Read the file that DJI's RTK aircraft write for each flight, one line a photograph.

    Its position is that of the camera, "after compensation"; the compensation itself, from the antenna to the camera,
    is north and east in mm, and down (DJI, Zenmuse P1 User Manual v1.4, "Image Log File"; Matrice 4 Series User Manual,
    the same). Standard deviations are along north, east and up. Raises ProjectError with every error.
    """
    errors = Errors(path, ProjectError)
    rows = [
        row for line, text in lines_of(path, ProjectError, HOLDING) if (row := _mrk_row(line, text, errors)) is not None
    ]
    first: dict[int | None, int] = {}
    for row in rows:
        if first.setdefault(row.number, row.line) != row.line:
            errors.note(
                row.line, f"number {row.number} is given twice, first in line {first[row.number]}: keep one of the two"
            )
    errors.raise_all()
    return PositionFile(path, "mrk", True, tuple(rows))


def format_of(path: Path) -> Format:
    """Return the format that the name of a file tells: DJI's MRK, RTKLIB's pos, or a table."""
    suffix = path.suffix.lower()
    return "mrk" if suffix == ".mrk" else "pos" if suffix == ".pos" else "csv"
