"""Bytes of other programs' files as values: files read whole, numbers, names and paths checked.

Whatever is wrong becomes an ExchangeError that begins with ``where``: the place that the reader names, such as a file
and a line.
"""

import re
from array import array
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.errors import ExchangeError
from photogram.files.reading import read_whole
from photogram.files.text_lines import LONGEST_NAME, decoded
from photogram.wording import is_number, printable, shortened

MOST_BYTES = 8_000_000_000
"""Of one file of a solution."""

LARGEST_WHOLE = 2**53
"""Above it, a double no longer holds every whole number."""

_LONGEST_PATH = 4096
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""What a terminal would obey, and halves of surrogate pairs."""


def bytes_of(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Return the content of a file. Raises ExchangeError where it cannot be read or is larger."""
    try:
        return read_whole(path, most_bytes)
    except OSError as error:
        raise ExchangeError(f"{path}: cannot be read ({error.strerror}): check its name and folder") from error


def text_of(path: Path, most_bytes: int = MOST_BYTES) -> str:
    """Return the text of a file. Raises ExchangeError where it cannot be read, is larger, or is not UTF-8."""
    return decoded(path, bytes_of(path, most_bytes), ExchangeError)


# ---- names and paths -----------------------------------------------------------------------------------------------


def file_of(where: str, text: str) -> PurePosixPath:
    """Return the path by which a program names a photograph; backslashes become slashes, its last part is the name.

    It may lead anywhere, as paths of other machines do: nothing may be opened by it unchecked. Raises ExchangeError
    where its last part is no name of a file, it is too long, or it holds a character that cannot be printed.
    """
    file = PurePosixPath(text.replace("\\", "/"))
    named = repr(shortened(printable(text)))
    if file.name in ("", ".", ".."):
        raise ExchangeError(f"{where}: {named} is no name of a photograph: name its file in the other program")
    if len(file.name) > LONGEST_NAME or len(text) > _LONGEST_PATH:
        raise ExchangeError(f"{where}: the name {named} is longer than that of any file: check the file")
    if _CONTROL.search(text):
        raise ExchangeError(f"{where}: the name {named} holds a character that cannot be printed: rename the file")
    return file


def part_of(where: str, folder: Path, text: str) -> Path:
    """Return the path of a file that another names, within ``folder``.

    Raises ExchangeError where the name leads out of the folder, or through a link.
    """
    parts = PurePosixPath(text.replace("\\", "/"))
    if not text or "\0" in text or parts.is_absolute() or ".." in parts.parts or ":" in text:
        raise ExchangeError(
            f"{where}: {printable(shortened(text))!r} leads out of the folder of the project: "
            "only files within it are read"
        )
    path = folder
    for part in parts.parts:
        path = path / part
        if path.is_symlink():
            raise ExchangeError(f"{path}: is a link in a project of another program: put the file in its place")
    return path


# ---- numbers -------------------------------------------------------------------------------------------------------


def numbers(where: str, texts: Iterable[str]) -> FloatArray:
    """Return numbers (N,) as they are written; any may be infinite or NaN."""
    texts = list(texts)
    try:
        values = np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
    except ValueError as error:
        wrong = next((text for text in texts if not is_number(text)), "")
        raise ExchangeError(f"{where}: {shortened(printable(wrong))!r} is not a number: check the file") from error
    return values


def number_rows(path: Path, lines: Iterable[tuple[int, str]]) -> tuple[FloatArray, IntArray]:
    """Return the numbers (N,) of numbered lines that hold nothing else, and how many each line has."""
    flat, counts, before = array("d"), array("q"), 0
    for line, text in lines:
        try:
            flat.extend(map(float, text.split()))
        except ValueError:
            numbers(f"{path}:{line}", text.split())
        counts.append(len(flat) - before)
        before = len(flat)
    return np.frombuffer(flat, dtype=np.float64), np.frombuffer(counts, dtype=np.int64)


def split_rows(values: FloatArray, counts: IntArray, head: int) -> tuple[FloatArray, FloatArray]:
    """Return the first ``head`` numbers of rows (P, head), and what follows them in all rows (N,); ``counts`` (P,) are
    the numbers of each row, none fewer than ``head``."""
    heads = (np.cumsum(counts) - counts)[:, None] + np.arange(head)
    follows = np.ones(len(values), dtype=bool)
    follows[heads.ravel()] = False
    return values[heads], values[follows]


def counted_rows(
    where: str, what: str, values: FloatArray, counts: IntArray, head: int, width: int
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the heads (P, head) of rows, what follows them as (N, width), and the row of each of these (N,).

    The last number of a head says how many times ``width`` numbers follow. Raises ExchangeError where others do.
    """
    if (counts >= head).all():
        heads, rest = split_rows(values, counts, head)
        if (counts == head + width * heads[:, -1]).all():
            return heads, rest.reshape(-1, width), np.repeat(np.arange(len(counts)), (counts - head) // width)
    raise ExchangeError(f"{where}: {what} must have {head} numbers and {width} for each that it counts: it is damaged")


def numbers_of(where: str, what: str, text: str, count: int) -> FloatArray:
    """Return the ``count`` finite numbers (count,) of a text, between blanks. Raises ExchangeError where it has
    others."""
    words = text.split(maxsplit=count)
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.zeros(0)
    if len(words) != count or len(values) != count or not np.isfinite(values).all():
        kind = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ExchangeError(
            f"{where}: {what} must be {kind}, found {printable(shortened(text.strip()))!r}: "
            "export the file again, or correct it"
        )
    return values


def number_of(where: str, what: str, text: str) -> float:
    """Return the finite number of a text. Raises ExchangeError where it is none."""
    return float(numbers_of(where, what, text, 1)[0])


def check_finite(where: str, what: str, values: FloatArray) -> None:
    """Raise ExchangeError where a number is infinite or NaN."""
    if not np.isfinite(values).all():
        wrong = values[~np.isfinite(values)].ravel()[0]
        raise ExchangeError(f"{where}: {what}: found {wrong}, which is not finite: export the solution again")


def whole_numbers(where: str, what: str, values: FloatArray, low: int = 0, high: int = LARGEST_WHOLE) -> IntArray:
    """Return values (N,) as whole numbers. Raises ExchangeError unless they are that, and from low to high."""
    good: BoolArray = np.asarray((values >= low) & (values <= high) & (values == np.floor(values)))
    if not good.all():
        wrong = np.asarray(values)[~good].ravel()[0]
        raise ExchangeError(
            f"{where}: {what} must be a whole number from {low} to {high}, found {wrong:.17g}: export the solution "
            "again"
        )
    return np.asarray(values, dtype=np.int64)


def whole_number(where: str, what: str, text: str, low: int = 0, high: int = LARGEST_WHOLE) -> int:
    """Return the whole number that a text holds, as ``whole_numbers``."""
    return int(whole_numbers(where, what, numbers(where, [text]), low, high)[0])


def check_distinct(where: str, what: str, ids: NDArray[np.generic]) -> None:
    """Raise ExchangeError where a number comes twice."""
    values, count = np.unique(ids, return_counts=True)
    if (count > 1).any():
        raise ExchangeError(f"{where}: {what} {values[count > 1][0]} comes twice: export the solution again")
