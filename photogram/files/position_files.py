"""Positions of photographs from files beside them: DJI's *_Timestamp.MRK, RTKLIB's .pos, tables (CSV) of PPK programs.

Everything is returned as it stands in the file, in metres and degrees: positions in the file's own CRS, whether they
are those of the camera or of the antenna being for others to say.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import isfinite
from pathlib import Path
from typing import Literal

from photogram.errors import ProjectError
from photogram.gnss_solutions import Sigma3, Solution, solution_of_rtk_flag

Format = Literal["mrk", "pos", "csv"]
Triple = tuple[float, float, float]

GPS_EPOCH = datetime(1980, 1, 6)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MOST_FAULTS = 20

_F = r"\s*([-+]?[\d.]+)\s*"
_MRK_LINE = re.compile(
    rf"\s*(\d+)\s+{_F}\s*\[\s*(\d+)\s*\]\s*{_F},\s*N\s*{_F},\s*E\s*{_F},\s*V\s*{_F},\s*Lat\s*{_F},\s*Lon\s*{_F},\s*Ellh"
    rf"\s*{_F},{_F},{_F}\s+(\d+)\s*,\s*Q\s*"
)
_MRK_FORM = (
    "number, seconds, [week], north,N east,E down,V latitude,Lat longitude,Lon height,Ellh, three standard deviations "
    "and flag,Q"
)


@dataclass(frozen=True)
class PositionRow:
    """One position as its file gives it.

    ``photograph`` is the name that the file gives, ``number`` the sequence number in the photograph's name, None where
    the file has none. ``gps_time`` is GPS time, without zone. ``position`` is longitude, latitude or easting, northing,
    and height; ``sigma_m`` along easting, northing and height; ``attitude_deg`` yaw, pitch and roll of the aircraft;
    ``lever_arm_m`` from the antenna to the camera along east, north and up.
    """

    line: int
    position: Triple
    photograph: str | None = None
    number: int | None = None
    gps_time: datetime | None = None
    sigma_m: Sigma3 | None = None
    solution: Solution = "unknown"
    attitude_deg: Triple | None = None
    lever_arm_m: Triple | None = None


@dataclass(frozen=True)
class PositionFile:
    """The positions of one file; ``geographic`` says whether they are longitude and latitude."""

    path: Path
    format: Format
    geographic: bool
    rows: tuple[PositionRow, ...]


class Faults:
    """The faults of one file, raised together as a ProjectError with a line for each."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._faults: list[tuple[int, str]] = []

    def note(self, line: int, text: str) -> None:
        """Note what is wrong with a line."""
        self._faults.append((line, text))

    def raise_all(self) -> None:
        """Raise a ProjectError with every fault noted; return if there is none."""
        found = sorted(self._faults)
        shown = [f"{self._path}:{line}: {text}" for line, text in found[:MOST_FAULTS]]
        if len(found) > MOST_FAULTS:
            line, more = found[MOST_FAULTS][0], len(found) - MOST_FAULTS
            shown.append(f"{self._path}:{line}: from this line on {more} more faults: mend the ones above first")
        if shown:
            raise ProjectError("\n".join(shown))

    def number(self, text: str, what: str, line: int) -> float | None:
        """Return the number that ``text`` holds, None with a fault noted where it holds none."""
        value = float(text) if NUMBER.fullmatch(text) else float("nan")
        if isfinite(value):
            return value
        comma = re.fullmatch(r"[-+]?\d+,\d+", text)
        remedy = (
            f"write {text.replace(',', '.')}, with a decimal point" if comma else "write a number with a decimal point"
        )
        self.note(line, f"{what} must be a number, found {text!r}: {remedy}")
        return None


def lines_of(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a text that say something, with their numbers. Raises ProjectError where it cannot be read or
    is empty."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as fault:
        raise ProjectError(f"{path}:1: cannot be read ({fault.strerror}): check its name and folder") from fault
    except UnicodeDecodeError as fault:
        line = fault.object[: fault.start].count(b"\n") + 1
        raise ProjectError(
            f"{path}:{line}: byte {fault.object[fault.start]:#04x} is not UTF-8: save the file as text in UTF-8"
        ) from fault
    kept = [(n, line) for n, line in enumerate(re.split(r"\r\n|\n|\r", text), 1) if line.strip()]
    if not kept:
        raise ProjectError(f"{path}:1: the file is empty: give the file with the positions")
    return kept


def check_on_globe(row: PositionRow, faults: Faults) -> None:
    """Note a fault where longitude and latitude lie on no globe."""
    longitude, latitude, _ = row.position
    if abs(longitude) > 180.0 or abs(latitude) > 90.0:
        faults.note(
            row.line,
            f"longitude {longitude:.10g}, latitude {latitude:.10g} lie on no globe: check the order of the columns",
        )


def gps_time(week: int, seconds: float) -> datetime:
    """Return GPS time from the week and the seconds of the week; the leap seconds to UTC are not taken off."""
    return GPS_EPOCH + timedelta(weeks=week, seconds=seconds)


def _mrk_row(line: int, text: str, faults: Faults) -> PositionRow | None:
    found = _MRK_LINE.fullmatch(text)
    numbers = [] if found is None else [faults.number(found[k], "each value", line) for k in (2, *range(4, 13))]
    if found is None:
        faults.note(line, f"is no line of a DJI MRK file: expected {_MRK_FORM}")
        return None
    known = [n for n in numbers if n is not None]
    if len(known) < len(numbers):
        return None
    seconds, north_mm, east_mm, down_mm, latitude, longitude, height, *sigma = known
    row = PositionRow(
        line,
        (longitude, latitude, height),
        number=int(found[1]),
        gps_time=gps_time(int(found[3]), seconds),
        # zero stands for not known
        sigma_m=(sigma[1], sigma[0], sigma[2]) if min(sigma) > 0 else None,
        solution=solution_of_rtk_flag(int(found[13])),
        lever_arm_m=(east_mm / 1000.0, north_mm / 1000.0, -down_mm / 1000.0),
    )
    check_on_globe(row, faults)
    return row


def read_mrk(path: Path) -> PositionFile:
    """Read the file that DJI's RTK aircraft write for each flight, one line a photograph.

    Its position is that of the camera, "after compensation"; the compensation itself, from the antenna to the camera,
    is north and east in mm, and down (DJI, Zenmuse P1 User Manual v1.4, "Image Log File"; Matrice 4 Series User Manual,
    the same). Standard deviations are along north, east and up. Raises ProjectError with every fault.
    """
    faults = Faults(path)
    rows = [row for line, text in lines_of(path) if (row := _mrk_row(line, text, faults)) is not None]
    first: dict[int | None, int] = {}
    for row in rows:
        if first.setdefault(row.number, row.line) != row.line:
            faults.note(
                row.line, f"number {row.number} is there twice, first in line {first[row.number]}: keep one of the two"
            )
    faults.raise_all()
    return PositionFile(path, "mrk", True, tuple(rows))


def format_of(path: Path) -> Format:
    """Return the format that the name of a file tells: DJI's MRK, RTKLIB's pos, or a table."""
    suffix = path.suffix.lower()
    return "mrk" if suffix == ".mrk" else "pos" if suffix == ".pos" else "csv"
