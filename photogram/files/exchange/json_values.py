"""Values of JSON files that other programs wrote: each of the kind it must be, or an ExchangeError that says where."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ExchangeError
from photogram.files.exchange.assembly import check_finite, text_of
from photogram.wording import printable, shortened

Object = Mapping[str, object]


def read_json(path: Path) -> object:
    """Return what a JSON file holds. Raises ExchangeError where it cannot be read, is no JSON, or lies too deep in
    itself."""
    try:
        value: object = json.loads(text_of(path))
    except json.JSONDecodeError as fault:
        raise ExchangeError(f"{path}:{fault.lineno}: is no JSON ({fault.msg}): it is cut off or damaged") from fault
    except RecursionError as fault:
        raise ExchangeError(f"{path}: its lists lie too deep in one another: it is damaged") from fault
    except ValueError as fault:
        raise ExchangeError(f"{path}: holds a number with too many digits: it is damaged") from fault
    return value


def _wrong(where: str, kind: str, value: object) -> ExchangeError:
    return ExchangeError(f"{where}: must be {kind}, found {shortened(printable(repr(value)))}: export it again")


def as_object(where: str, value: object) -> Object:
    """Return a value that is an object."""
    if not isinstance(value, dict):
        raise _wrong(where, "an object", value)
    return value


def as_list(where: str, value: object) -> Sequence[object]:
    """Return a value that is a list."""
    if not isinstance(value, list):
        raise _wrong(where, "a list", value)
    return value


def as_text(where: str, value: object) -> str:
    """Return a value that is a text."""
    if not isinstance(value, str):
        raise _wrong(where, "a text", value)
    return value


def as_number(where: str, value: object) -> float:
    """Return a value that is a finite number, or a text that holds one."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise _wrong(where, "a number", value)
    try:
        number = float(value)
    except (ValueError, OverflowError) as fault:
        raise _wrong(where, "a number", value) from fault
    check_finite(where, "a number", np.array([number]))
    return number


def as_whole(where: str, value: object) -> int:
    """Return a value that is a whole number, or a text that holds one."""
    number = as_number(where, value)
    if number != int(number):
        raise _wrong(where, "a whole number", value)
    return int(number)


def as_vector(where: str, value: object, size: int) -> FloatArray:
    """Return a value that is a list of so many finite numbers, as an array (size,)."""
    numbers = as_list(where, value)
    if len(numbers) != size:
        raise _wrong(where, f"a list of {size} numbers", value)
    return np.array([as_number(where, number) for number in numbers])


def as_rows(where: str, values: Iterable[object], size: int) -> FloatArray:
    """Return many lists of so many finite numbers each as an array (N, size)."""
    rows = list(values)
    try:
        table = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as fault:
        raise ExchangeError(f"{where}: must be lists of {size} numbers: export it again") from fault
    if rows and table.shape != (len(rows), size):
        raise ExchangeError(f"{where}: must be lists of {size} numbers: export it again")
    check_finite(where, "a number", table)
    return table.reshape(-1, size)


def member(where: str, owner: Object, key: str) -> object:
    """Return a member that an object must have."""
    if key not in owner:
        raise ExchangeError(f"{where}: has no {key!r}: it is damaged, or of another kind")
    return owner[key]
