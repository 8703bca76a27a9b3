"""Text that people write: its lines with their numbers, and every error in them at once."""

import re
from dataclasses import dataclass
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import NoReturn

from photogram.errors import PhotogramError
from photogram.files.reading import read_whole
from photogram.wording import printable, shortened

NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
MOST_ERRORS = 20
MOST_BYTES = 16_000_000
"""Of a table: some 200 000 rows."""

LONGEST_LINE = 10_000
"""In characters."""

LONGEST_NAME = 255
"""In characters, of a point or photograph; no file's name is longer."""

SIGMA_M = (1e-5, 1e4)
SIGMA_PX = (1e-4, 1e3)
"""What standard deviations may be, ends included."""

MARK_KIND = re.compile(r"[a-z][a-z0-9_-]{0,39}")
"""How a mark was measured, a word."""

_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_QUOTED = frozenset(',;"\t#')
_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


@dataclass(frozen=True)
class Note:
    """What is to be said of how a file was read, and what to do where that is wrong."""

    text: str
    remedy: str


class Errors:
    """The errors of one file, raised together as an ``error`` with a line for each."""

    def __init__(self, path: Path, error: type[PhotogramError]) -> None:
        self._path, self._error = path, error
        self._errors: list[tuple[int, str]] = []

    def note(self, line: int, text: str) -> None:
        """Note what is wrong with a line."""
        self._errors.append((line, text))

    def raise_all(self) -> None:
        """Raise every error noted; return if there is none."""
        ordered = sorted(self._errors)
        lines = [f"{self._path}:{line}: {text}" for line, text in ordered[:MOST_ERRORS]]
        if len(ordered) > MOST_ERRORS:
            line, more = ordered[MOST_ERRORS][0], len(ordered) - MOST_ERRORS
            lines.append(f"{self._path}:{line}: from this line on {more} more errors: fix those above first")
        if lines:
            raise self._error("\n".join(lines))

    def number(self, text: str, what: str, line: int) -> float | None:
        """Return the number that ``text`` holds, None with an error noted where it holds none."""
        value = float(text) if NUMBER.fullmatch(text) else float("nan")
        if isfinite(value):
            return value
        comma = re.fullmatch(r"[-+]?\d{1,20},\d{1,20}", text)
        remedy = (
            f"write {text.replace(',', '.')}, with a decimal point" if comma else "write a number with a decimal point"
        )
        self.note(line, f"{what} must be a number, found {shortened(text)!r}: {remedy}")
        return None

    def name(self, text: str, what: str, line: int) -> str | None:
        """Return a name as it stands, None with an error noted where it is too long."""
        if len(text) <= LONGEST_NAME:
            return text
        self.note(line, f"{what} has {len(text)} characters, at most {LONGEST_NAME} are read: check quotes")
        return None


def text_of(path: Path, error: type[PhotogramError]) -> str:
    """Return the text of a file. Raises ``error`` where it cannot be read, is far too large or is not UTF-8."""
    try:
        data = read_whole(path, MOST_BYTES)
    except OSError as cause:
        raise error(f"{path}:1: cannot be read ({cause.strerror}): check its name and folder") from cause
    return decoded(path, data, error)


def decoded(path: Path, data: bytes, error: type[PhotogramError]) -> str:
    """Return the text that the content of a file is: UTF-8, or UTF-16 where it begins with the mark of that. Raises
    ``error``, with the line, where it is neither."""
    try:
        return data.decode("utf-16" if data.startswith(_UTF16) else "utf-8-sig")
    except UnicodeDecodeError as cause:
        line = cause.object[: cause.start].count(b"\n") + 1
        raise error(
            f"{path}:{line}: byte {cause.object[cause.start]:#04x} is not UTF-8: save the file as text in UTF-8"
        ) from cause


def lines_of(
    path: Path, error: type[PhotogramError], holding: str, comment: str | None = None
) -> list[tuple[int, str]]:
    """Return the lines of a text that say something, with their numbers.

    Those that begin with ``comment`` are passed over. Raises ``error`` where the file cannot be read or is empty, and
    then says what it should be ``holding``.
    """
    lines = _checked(path, text_of(path, error), error, holding)
    return [(n, line) for n, line in lines if not (comment and line.lstrip().startswith(comment))] or _empty(
        path, error, holding
    )


def table_text_of(path: Path, error: type[PhotogramError]) -> str:
    """Return the text of a table, in Windows-1252 where it is in no encoding that can be told. Raises ``error`` as
    ``text_of`` does."""
    try:
        return text_of(path, error)
    except error:
        text = _in_windows_1252(path)
        if text is None:
            raise
        return text


def lines_of_table(
    path: Path, error: type[PhotogramError], holding: str
) -> tuple[list[tuple[int, str]], tuple[Note, ...]]:
    """Return the lines of a table that say something, with their numbers, and a note where it is in no encoding that
    can be told: it is read as Windows-1252, as older programs write. Raises ``error`` as ``lines_of`` does."""
    lines = _checked(path, table_text_of(path, error), error, holding)
    if _in_windows_1252(path) is None:
        return lines, ()
    said = (line for _, line in lines if not line.isascii() and not line.lstrip().startswith("#"))
    return lines, tuple(
        Note(f"read as Windows-1252: {shortened(line)!r}", "save it as text in UTF-8 if this is not what it says")
        for line in islice(said, 1)
    )


def _in_windows_1252(path: Path) -> str | None:
    """Return the text of a file in Windows-1252, None where it cannot be read or is UTF-8, UTF-16 or no text."""
    try:
        data = read_whole(path, MOST_BYTES)
    except OSError:
        return None
    try:
        data.decode("utf-16" if data.startswith(_UTF16) else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
        return None if "\ufffd" in text or _UNPRINTABLE.search(text) else text
    return None


def _empty(path: Path, error: type[PhotogramError], holding: str) -> NoReturn:
    raise error(f"{path}:1: the file is empty: give the file with the {holding}")


def _checked(path: Path, text: str, error: type[PhotogramError], holding: str) -> list[tuple[int, str]]:
    """Return the lines of a text that are not blank, with their numbers. Raises ``error`` where there are none, where
    one is far too long, or holds what cannot be printed."""
    kept = [(n, line) for n, line in enumerate(re.split(r"\r\n|\n|\r", text), 1) if line.strip()]
    if not kept:
        _empty(path, error, holding)
    errors = Errors(path, error)
    for number, content in kept:
        if len(content) > LONGEST_LINE:
            errors.note(number, f"is {len(content)} characters long: this is no file with the {holding}")
        elif match := _UNPRINTABLE.search(content):
            errors.note(number, f"holds the character {printable(match[0])}, which cannot be printed: remove it")
    errors.raise_all()
    return kept


def quoted(text: str) -> str:
    """Return a cell of a table as it is written, in quotes where it else would end, or begin a comment."""
    if not _QUOTED.intersection(text):
        return text
    return '"' + text.replace('"', '""') + '"'
