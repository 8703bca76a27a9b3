"""The result file of DBAT: what it says of an adjustment.

Text with an entry a line, indented below its heading: of each photograph omega, phi, kappa in degrees and the
projection centre, each with the standard deviation where it was estimated; tables of the adjusted control and check
points; of each camera its parameters, in DBAT's camera unit. Standard deviations have three digits and are multiplied
by sigma0.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ExchangeError
from photogram.files.solutions.parsing import number_of, text_of, whole_number
from photogram.wording import printable, shortened

FIRST_LINE = "Damped Bundle Adjustment Toolbox result file"
ELEMENTS = ("Omega", "Phi", "Kappa", "Xc", "Yc", "Zc")
"""Of an exterior orientation, as the file has them."""
REMEDY = "write the result file again with DBAT"

_LAST_LINE = "End of result file"
_MOST_BYTES = 500_000_000
_METRES = "m"
_PHOTO = re.compile(r"Photo \d+: (.+)")
_CAMERA = re.compile(r"Camera(\d+) \((?:simple|mixed)\)")
_PARAMETERS = {"Camera Constant": "cc", "px": "px", "py": "py", "as": "as", "sk": "sk"}
_DISTORTION = re.compile(r"([KP]\d+) - ")
_POINTS_COLUMNS = ("id", "x", "y", "z", "stdx", "stdy", "stdz")


@dataclass(frozen=True)
class Stated:
    """A value with its standard deviation; NaN where it was held."""

    value: float
    sigma: float


@dataclass(frozen=True, eq=False)
class ReportedPhotograph:
    """The exterior orientation of a photograph."""

    name: str
    """As the file has it, a name or a path."""
    place: str
    values: FloatArray
    """Omega, phi, kappa in degrees, and the projection centre (6,)."""
    sigmas: FloatArray
    """Their standard deviations (6,), NaN for what was held."""


@dataclass(frozen=True, eq=False)
class Report:
    """What a result file says."""

    program: str
    """DBAT with its version."""
    script: str | None
    """Path of the script that was run, on the machine that DBAT ran on."""
    sigma0: float
    redundancy: int
    cameras: tuple[dict[str, Stated], ...]
    """Parameters of each camera by their names in DBAT: cc, px, py, as, sk, K1 …, P1 …"""
    photographs: tuple[ReportedPhotograph, ...]
    ground: dict[int, tuple[FloatArray, FloatArray]]
    """Adjusted control and check points by their ids: coordinates (3,) and standard deviations (3,)."""


@dataclass(frozen=True)
class _Line:
    place: str
    text: str


def read_report(path: Path) -> Report:
    """Return what a result file says. Raises ExchangeError with the line where it is damaged, ends early, tells of an
    adjustment that failed, or counts in another unit than metres."""
    lines = [
        _Line(f"{path}:{number}", text.strip())
        for number, text in enumerate(text_of(path, _MOST_BYTES).splitlines(), 1)
        if text.strip()
    ]
    if not lines or lines[0].text != FIRST_LINE:
        raise ExchangeError(f"{path}:1: is no result file of DBAT: its first line is not {FIRST_LINE!r}")
    if lines[-1].text != _LAST_LINE:
        raise ExchangeError(f"{path}: ends early, without the line {_LAST_LINE!r}: {REMEDY}")
    entries = _entries(lines)
    status = _entry(path, entries, "Status")
    if status.text != "OK":
        raise ExchangeError(
            f"{status.place}: the adjustment failed ({printable(shortened(status.text))}): there is no solution to read"
        )
    unit = _entry(path, entries, "Object space unit (ou)")
    if unit.text != _METRES:
        raise ExchangeError(
            f"{unit.place}: coordinates are in {printable(shortened(unit.text))!r}, photogram counts in metres: give "
            "DBAT control points in metres"
        )
    version, sigma0 = _entry(path, entries, "DBAT version"), _entry(path, entries, "Sigma0")
    redundancy, script = _entry(path, entries, "Redundancy"), entries.get("Input file name")
    return Report(
        program=f"DBAT {printable(shortened(version.text.split()[0] if version.text else ''))}".strip(),
        script=None if script is None else script.text,
        sigma0=number_of(sigma0.place, "Sigma0", sigma0.text),
        redundancy=whole_number(redundancy.place, "Redundancy", redundancy.text),
        cameras=_cameras(lines),
        photographs=_photographs(path, lines),
        ground=_ground(lines),
    )


def _entries(lines: list[_Line]) -> dict[str, _Line]:
    """Return what stands behind names, in the order of the file: the first of each name counts."""
    entries: dict[str, _Line] = {}
    for line in lines:
        name, colon, value = line.text.partition(":")
        if line.text.startswith("Redundancy"):  # the one entry without a colon
            name, value, colon = "Redundancy", line.text.removeprefix("Redundancy").lstrip(":"), ":"
        if colon:
            entries.setdefault(name.strip(), _Line(line.place, value.strip()))
    return entries


def _entry(path: Path, entries: dict[str, _Line], name: str) -> _Line:
    if name not in entries:
        raise ExchangeError(f"{path}: has no entry {name!r}: {REMEDY}")
    return entries[name]


def _stated(block: list[_Line]) -> dict[str, Stated]:
    """Return values and standard deviations of the lines below a photograph or camera, by their headings."""
    stated: dict[str, Stated] = {}
    heading = ""
    for line in block:
        name, _, value = line.text.partition(":")
        if name == "Value":
            number = number_of(line.place, heading or name, value.split()[0] if value.split() else "")
            stated[heading] = Stated(number, float("nan"))
        elif name == "Deviation" and heading in stated:
            sigma = number_of(line.place, f"the deviation of {heading}", value.split()[0] if value.split() else "")
            if not sigma > 0.0:
                raise ExchangeError(f"{line.place}: the deviation of {printable(shortened(heading))} is not positive")
            stated[heading] = Stated(stated[heading].value, sigma)
        elif not value.strip():
            heading = name
    return stated


def _blocks(lines: list[_Line], pattern: re.Pattern[str], start: str, end: str) -> list[tuple[_Line, list[_Line]]]:
    """Return the lines that match a pattern between two headings, each with those up to the next of them."""
    texts = [line.text for line in lines]
    if start not in texts or end not in texts[texts.index(start) :]:
        return []
    first = texts.index(start) + 1
    part = lines[first : texts.index(end, first)]
    at = [i for i, line in enumerate(part) if pattern.fullmatch(line.text)]
    return [(part[i], part[i + 1 : j]) for i, j in zip(at, [*at[1:], len(part)], strict=True)]


def _cameras(lines: list[_Line]) -> tuple[dict[str, Stated], ...]:
    cameras = []
    for _, block in _blocks(lines, _CAMERA, "Cameras:", "Precisions / Standard Deviations:"):
        named = {}
        for heading, stated in _stated(block).items():
            distortion = _DISTORTION.match(heading)
            name = distortion.group(1) if distortion else _PARAMETERS.get(heading.split(" - ")[0])
            if name is not None:
                named[name] = stated
        cameras.append(named)
    return tuple(cameras)


def _photographs(path: Path, lines: list[_Line]) -> tuple[ReportedPhotograph, ...]:
    photographs = []
    for head, block in _blocks(lines, _PHOTO, "Photograph Standard Deviations:", "Quality"):
        stated = _stated(block)
        missing = [element for element in ELEMENTS if element not in stated]
        if missing:
            raise ExchangeError(f"{head.place}: the photograph has no {missing[0]}: {REMEDY}")
        values = np.array([stated[element].value for element in ELEMENTS])
        sigmas = np.array([stated[element].sigma for element in ELEMENTS])
        name = _PHOTO.fullmatch(head.text)
        photographs.append(ReportedPhotograph(name.group(1) if name else "", head.place, values, sigmas))
    if not photographs:
        raise ExchangeError(f"{path}: lists no photograph with its exterior orientation: {REMEDY}")
    return tuple(photographs)


def _ground(lines: list[_Line]) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Return the rows of the tables headed Posterior."""
    points: dict[int, tuple[FloatArray, FloatArray]] = {}
    heads = [i for i, line in enumerate(lines) if line.text == "Posterior"]
    for head in heads:
        columns = [name.strip() for name in lines[head + 1].text.split(",")] if head + 1 < len(lines) else []
        if tuple(columns[: len(_POINTS_COLUMNS)]) != _POINTS_COLUMNS:
            raise ExchangeError(f"{lines[head].place}: the columns of the table are others than DBAT's: {REMEDY}")
        for line in lines[head + 2 :]:
            cells = [cell.strip() for cell in line.text.split(",")]
            if len(cells) < len(columns):
                break
            key = whole_number(line.place, "id", cells[0])
            named = zip(columns[1:7], cells[1:7], strict=True)
            row = np.array([number_of(line.place, name, cell) for name, cell in named])
            points[key] = row[:3], row[3:]
    return points
