"""JSON of others with the place of every value, so that an error says which one is wrong."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ExchangeError
from photogram.files.exchange.parsing import text_of
from photogram.wording import printable, shortened

_LARGEST_WHOLE = 2**64 - 1
_MOST_BYTES = 100_000_000


@dataclass(frozen=True)
class Node:
    """A value of JSON; ``place`` is its file and its keys. Every method raises ExchangeError where it is of another
    type."""

    value: object
    place: str

    def _refuse(self, expected: str) -> ExchangeError:
        return ExchangeError(
            f"{self.place}: must be {expected}, found {printable(shortened(repr(self.value)))}: export the file again"
        )

    def find(self, key: str) -> Node | None:
        """Return the value of a key of an object, None where it is not there or null."""
        if not isinstance(self.value, dict):
            raise self._refuse("an object")
        value = self.value.get(key)
        return None if value is None else Node(value, f"{self.place}: {key}")

    def get(self, key: str) -> Node:
        """Return the value of a key that must be there."""
        node = self.find(key)
        if node is None:
            raise ExchangeError(f"{self.place}: has no {key}: export the file again")
        return node

    def items(self) -> Iterator[Node]:
        """Give the values of a list."""
        if not isinstance(self.value, list):
            raise self._refuse("a list")
        for i, value in enumerate(self.value):
            yield Node(value, f"{self.place}[{i}]")

    def item(self, number: int) -> Node:
        """Return one value of a list."""
        if not isinstance(self.value, list) or not number < len(self.value):
            raise self._refuse(f"a list of more than {number}")
        return Node(self.value[number], f"{self.place}[{number}]")

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self.value, str):
            raise self._refuse("a text")
        return self.value

    def flag(self) -> bool:
        """Return a truth value."""
        if not isinstance(self.value, bool):
            raise self._refuse("true or false")
        return self.value

    def whole(self) -> int:
        """Return a whole number of 64 bits that is not negative."""
        if isinstance(self.value, bool) or not isinstance(self.value, int) or not 0 <= self.value <= _LARGEST_WHOLE:
            raise self._refuse("a whole number from 0 to 2⁶⁴ − 1")
        return self.value

    def number(self) -> float:
        """Return a finite number."""
        return float(self.numbers(1, [self.value])[0])

    def numbers(self, count: int, values: list[object] | None = None) -> FloatArray:
        """Return the finite numbers (count,) of a list."""
        held = values if values is not None else self.value
        if isinstance(held, list) and len(held) == count and not any(isinstance(v, bool | str) for v in held):
            try:
                array = np.array([float(v) for v in held])
            except (TypeError, ValueError, OverflowError):
                array = np.full(count, np.nan)
            if np.isfinite(array).all():
                return array
        raise self._refuse(f"{count} finite numbers" if values is None else "a finite number")


def _constant(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def read_json(path: Path) -> Node:
    """Return the root of a file of JSON. Raises ExchangeError where it is none, or holds NaN or infinity."""
    try:
        return Node(json.loads(text_of(path, _MOST_BYTES), parse_constant=_constant), str(path))
    except json.JSONDecodeError as fault:
        raise ExchangeError(f"{path}:{fault.lineno}: is not JSON ({fault.msg}): export the file again") from fault
    except (ValueError, RecursionError) as fault:
        if isinstance(fault, ExchangeError):
            raise
        raise ExchangeError(f"{path}: is JSON that is not read ({shortened(str(fault))})") from fault
