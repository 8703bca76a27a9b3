"""Text that people write: its lines with their numbers, and every fault in them at once."""

from __future__ import annotations

import re
from math import isfinite
from pathlib import Path

from photogram.errors import PhotogramError

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MOST_FAULTS = 20


class Faults:
    """The faults of one file, raised together as an ``error`` with a line for each."""

    def __init__(self, path: Path, error: type[PhotogramError]) -> None:
        self._path, self._error = path, error
        self._faults: list[tuple[int, str]] = []

    def note(self, line: int, text: str) -> None:
        """Note what is wrong with a line."""
        self._faults.append((line, text))

    def raise_all(self) -> None:
        """Raise every fault noted; return if there is none."""
        found = sorted(self._faults)
        shown = [f"{self._path}:{line}: {text}" for line, text in found[:MOST_FAULTS]]
        if len(found) > MOST_FAULTS:
            line, more = found[MOST_FAULTS][0], len(found) - MOST_FAULTS
            shown.append(f"{self._path}:{line}: from this line on {more} more faults: mend the ones above first")
        if shown:
            raise self._error("\n".join(shown))

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


def lines_of(
    path: Path, error: type[PhotogramError], holding: str, comment: str | None = None
) -> list[tuple[int, str]]:
    """Return the lines of a text that say something, with their numbers.

    Those that begin with ``comment`` are passed over. Raises ``error`` where the file cannot be read or is empty, and
    then says what it should be ``holding``.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as fault:
        raise error(f"{path}:1: cannot be read ({fault.strerror}): check its name and folder") from fault
    except UnicodeDecodeError as fault:
        line = fault.object[: fault.start].count(b"\n") + 1
        raise error(
            f"{path}:{line}: byte {fault.object[fault.start]:#04x} is not UTF-8: save the file as text in UTF-8"
        ) from fault
    kept = [
        (n, line)
        for n, line in enumerate(re.split(r"\r\n|\n|\r", text), 1)
        if line.strip() and not (comment and line.lstrip().startswith(comment))
    ]
    if not kept:
        raise error(f"{path}:1: the file is empty: give the file with the {holding}")
    return kept
