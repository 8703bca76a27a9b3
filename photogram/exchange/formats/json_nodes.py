"""JSON of others with the place of every value, so that an error says which one is wrong."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ExchangeError
from photogram.files.solutions.parsing import MOST_BYTES, text_of
from photogram.wording import printable, shortened

_LARGEST_WHOLE = 2**64 - 1


@dataclass(frozen=True)
class Node:
    """A value of JSON. Every method raises ExchangeError where it is of another type."""

    value: object
    place: str
    """Its file and its keys."""
    is_text: bool = False
    """Whether its numbers may be texts that hold one, as some programs write them."""

    def _refuse(self, expected: str) -> ExchangeError:
        return ExchangeError(
            f"{self.place}: must be {expected}, found {printable(shortened(repr(self.value)))}: export the file again"
        )

    def _child(self, value: object, key: str) -> Node:
        return Node(value, f"{self.place}{key}", self.is_text)

    def _object(self) -> Mapping[str, object]:
        if not isinstance(self.value, dict):
            raise self._refuse("an object")
        return self.value

    def find(self, key: str) -> Node | None:
        """Return the value of a key of an object, None where it is not there or null."""
        value = self._object().get(key)
        return None if value is None else self._child(value, f": {key}")

    def get(self, key: str, otherwise: object = None) -> Node:
        """Return the value of a key of an object, ``otherwise`` where it is not there or null; it must be there if that
        is None."""
        value = self._object().get(key)
        value = otherwise if value is None else value
        if value is None:
            raise ExchangeError(f"{self.place}: has no {key}: export the file again")
        return self._child(value, f": {key}")

    def keys(self) -> list[str]:
        """Return the keys of an object."""
        return list(self._object())

    def entries(self) -> Iterator[tuple[str, Node]]:
        """Give the keys and values of an object."""
        for key, value in self._object().items():
            yield key, self._child(value, f": {shortened(printable(key))}")

    def elements(self) -> list[object]:
        """Return a list as it is, for what is counted in millions."""
        if not isinstance(self.value, list):
            raise self._refuse("a list")
        return self.value

    def items(self) -> Iterator[Node]:
        """Give the values of a list."""
        for i, value in enumerate(self.elements()):
            yield self._child(value, f"[{i}]")

    def item(self, number: int) -> Node:
        """Return one value of a list."""
        values = self.elements()
        if not number < len(values):
            raise self._refuse(f"a list of more than {number}")
        return self._child(values[number], f"[{number}]")

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self.value, str):
            raise self._refuse("a text")
        return self.value

    def flag(self) -> bool:
        """Return a truth value."""
        if self.is_text and str(self.value).lower() in ("0", "1", "false", "true"):
            return str(self.value).lower() in ("1", "true")
        if not isinstance(self.value, bool):
            raise self._refuse("true or false")
        return self.value

    def whole(self, most: int = _LARGEST_WHOLE) -> int:
        """Return a whole number from 0 to ``most``."""
        value = self.value
        if self.is_text and isinstance(value, str) and value.isdecimal() and len(value) <= len(str(most)):
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
            raise self._refuse(f"a whole number from 0 to {most}")
        return value

    def number(self) -> float:
        """Return a finite number."""
        numbers = self._numbers([self.value])
        if numbers is None:
            raise self._refuse("a finite number")
        return float(numbers[0])

    def numbers(self, count: int) -> FloatArray:
        """Return the finite numbers (count,) of a list."""
        values = self.elements()
        numbers = self._numbers(values) if len(values) == count else None
        if numbers is None:
            raise self._refuse(f"{count} finite numbers")
        return numbers

    def _numbers(self, values: list[object]) -> FloatArray | None:
        """Return finite numbers (N,), None where one is none."""
        if any(isinstance(value, bool) or (isinstance(value, str) and not self.is_text) for value in values):
            return None
        try:
            numbers = np.array([float(value) for value in values])  # type: ignore[arg-type]  # refused below
        except (TypeError, ValueError, OverflowError):
            return None
        return numbers if np.isfinite(numbers).all() else None

    def table(self, key: str, count: int, otherwise: object = None) -> FloatArray:
        """Return the finite numbers (N, count) of one key of all the objects that a list or an object holds, millions
        of them at once; ``otherwise`` where it is not there, None if it must be there."""
        owners: list[Any] = list(self.value.values()) if isinstance(self.value, dict) else self.elements()
        try:
            rows = [owner.get(key, otherwise) for owner in owners]
            numbers = np.array(rows, dtype=np.float64).reshape(len(rows), count)
        except (AttributeError, TypeError, ValueError, OverflowError):
            numbers = np.full((1, count), np.nan)
        if not np.isfinite(numbers).all():
            what = "a finite number" if count == 1 else f"lists of {count} finite numbers"
            raise ExchangeError(f"{self.place}: must be objects whose {key} are {what}: export the file again")
        return numbers


def read_json(path: Path, most_bytes: int = MOST_BYTES, *, numbers_are_text: bool = False) -> Node:
    """Return the root of a file of JSON; ``numbers_are_text`` where its program writes numbers as texts.

    Raises ExchangeError where the file cannot be read, is larger, is no JSON, or lies too deep in itself.
    """
    try:
        return Node(json.loads(text_of(path, most_bytes)), str(path), numbers_are_text)
    except json.JSONDecodeError as error:
        raise ExchangeError(f"{path}:{error.lineno}: is not JSON ({error.msg}): it is cut off or damaged") from error
    except RecursionError as error:
        raise ExchangeError(f"{path}: its lists lie too deep in one another: it is damaged") from error
    except ValueError as error:
        if isinstance(error, ExchangeError):
            raise
        raise ExchangeError(f"{path}: holds a number with too many digits: it is damaged") from error
