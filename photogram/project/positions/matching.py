"""Which row of a file of positions belongs to which photograph: by name, by number in the name, or by order."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from photogram.files.photographs.names import joined_names
from photogram.files.tables.position_files import PositionFile, PositionRow

_AFTER_TIME = re.compile(r"_\d{14}_(\d{3,5})(?!\d)")
_COUNTER = re.compile(r"(?<!\d)(\d{3,5})(?!\d)")
_MRK_STEM = re.compile(r"(.+?)_?timestamp", re.IGNORECASE)


@dataclass(frozen=True)
class Matching:
    """The rows of a file by the names of their photographs, and the rows that belong to none of them.

    ``error`` says why they cannot be matched at all, empty where they can.
    """

    rows: Mapping[str, PositionRow]
    unmatched: tuple[PositionRow, ...] = ()
    error: str = ""


def sequence_number(name: str) -> int | None:
    """Return the number that DJI counts a flight's photographs by: 23 in 100_0001_0023.JPG, and 1 in
    DJI_20240501101500_0001_V.JPG; None where the name has none."""
    stem = PurePosixPath(name).stem
    after_time = _AFTER_TIME.search(stem)
    counters = [after_time[1]] if after_time else _COUNTER.findall(stem)
    return int(counters[-1]) if counters else None


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (" …" if len(names) > 3 else "")


def _by_number(file: PositionFile, names: Sequence[str]) -> Matching:
    """Match by number; where some photographs begin as the file does, 100_0001_ for example, only those are meant."""
    stem = _MRK_STEM.match(file.path.stem)
    prefix = f"{stem[1]}_".lower() if stem else ""
    own = [name for name in names if prefix and PurePosixPath(name).name.lower().startswith(prefix)]
    rows = {row.number: row for row in file.rows}
    matched = {n: rows[k] for n in own or names if (k := sequence_number(n)) is not None and k in rows}
    taken = {row.number for row in matched.values()}
    left = tuple(row for row in file.rows if row.number not in taken)
    if matched:
        return Matching(matched, left)
    numbers = sorted(k for k in rows if k is not None)
    text = f"its numbers {numbers[0]} to {numbers[-1]} match no file name of the project ({_some(names)})"
    return Matching({}, left, f"{text}: give the file of these photographs")


def _by_name(file: PositionFile, names: Sequence[str]) -> Matching:
    """Match by the names as other programs write them, where only one photograph fits."""
    joined = joined_names((str(row.photograph) for row in file.rows), names)
    matched: dict[str, PositionRow] = {}
    left, twice = [], []
    for row in file.rows:
        name = joined.of.get(str(row.photograph), "")
        if not name:
            left.append(row)
        elif matched.setdefault(name, row) is not row:
            twice.append(f"{name} is given twice, in lines {matched[name].line} and {row.line}: keep one of the two")
    if twice:
        return Matching(matched, tuple(left), "; ".join(twice[:5]))
    if matched:
        return Matching(matched, tuple(left))
    own = _some([str(row.photograph) for row in file.rows])
    text = f"none of its {len(file.rows)} photographs ({own}) is in the project ({_some(names)})"
    return Matching({}, tuple(left), f"{text}: give the file of these photographs, with their file names")


def _by_order(file: PositionFile, names: Sequence[str]) -> Matching:
    if len(file.rows) != len(names):
        text = f"it has {len(file.rows)} positions for {len(names)} photographs ({_some(names)}), and no file names"
        remedy = "give a table with the file names of the photographs, or limit it with flight"
        return Matching({}, file.rows, f"{text}: {remedy}")
    return Matching(dict(zip(sorted(names), file.rows, strict=True)))


def match_rows(file: PositionFile, names: Sequence[str]) -> Matching:
    """Return which row of a file belongs to which photograph; ``names`` are those that the file may be about.

    An MRK's rows by the number in the name, a table's by the name, those of RTKLIB in the order of the names.
    """
    if not names:
        return Matching({}, file.rows, "no photograph matches it")
    if file.format == "mrk":
        return _by_number(file, names)
    return _by_order(file, names) if file.format == "pos" else _by_name(file, names)
