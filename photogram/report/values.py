"""Values of records of report.json from those of results: null where there is no figure."""

from collections.abc import Sequence
from typing import TypeVar, cast

import numpy as np

from photogram.arrays import FloatArray

RecordT = TypeVar("RecordT")


def finite(value: float | np.floating) -> float | None:
    """Return a figure, None where it is not finite."""
    return float(value) if np.isfinite(value) else None


def finites(values: FloatArray | Sequence[float]) -> list[float | None]:
    """Return figures (N,), None for those that are not finite."""
    return [finite(value) for value in values]


def all_finite(values: FloatArray) -> list[float] | None:
    """Return figures (N,), None unless all of them are finite."""
    return [float(value) for value in values] if np.isfinite(values).all() else None


def record_of(kind: type[RecordT], source: object, /, **others: object) -> RecordT:
    """Return a record, its keys in the order of its type: ``others``, and what ``source`` has under the same names;
    arrays and tuples as lists, None for a float that is not finite. Raises TypeError for others that the type has
    not."""
    names = kind.__annotations__
    if not others.keys() <= names.keys():
        raise TypeError(f"{kind.__name__} has no {', '.join(sorted(others.keys() - names.keys()))}")
    return cast(RecordT, {name: others[name] if name in others else _value(getattr(source, name)) for name in names})


def _value(value: object) -> object:
    if isinstance(value, np.ndarray | tuple):
        return [_value(item) for item in value]
    return finite(value) if isinstance(value, float | np.floating) else value
