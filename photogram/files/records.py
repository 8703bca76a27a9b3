"""Frozen dataclasses as npz files, by their annotations.

Fields are arrays, numbers, texts, paths, times, members of an Enum or a Literal, tuples, dictionaries and dataclasses
of such, and None where an annotation allows it. Each array is an entry that is called as its field, after the
dataclasses around it and a dot: ``deformation.radius_m``. Tuples of dataclasses are stored by columns:
``poses.position_world_m`` (n, 3) holds the positions of all; dictionaries are tuples of pairs. What an entry needs
besides has a hyphen, which no field has: ``-known`` where a value may be None (a column then holds the known ones),
``-count`` and ``-items`` of tuples in a column, ``-shape`` of arrays of different shapes, which then stand one after
the other.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import datetime
from enum import Enum
from functools import cache, reduce
from itertools import chain
from math import prod
from operator import or_
from pathlib import Path, PurePath
from types import MappingProxyType, NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from photogram.errors import WorkspaceError
from photogram.files.npz_json import read_arrays, write_arrays

RecordT = TypeVar("RecordT")
Arrays = dict[str, NDArray[Any]]
NOTHING: Mapping[str, object] = MappingProxyType({})
Kind = Any
"""An annotation as ``get_type_hints`` returns it: a type, or a form of ``typing`` that has no type of its own."""

_NUMBERS: dict[Kind, tuple[type[np.generic], tuple[type, ...]]] = {
    bool: (np.bool_, (bool, np.bool_)),
    int: (np.int64, (int, np.integer)),
    float: (np.float64, (float, int, np.floating, np.integer)),
}
"""Of each kind of number the type in an array, and the types of the values that are taken for it."""


class _DamageError(ValueError):
    """What is wrong with a stored value: its place, and why."""

    def __init__(self, place: str, reason: str) -> None:
        super().__init__(f"{place or 'its content'} is damaged: {' '.join(reason.split())[:200]}")


# ---- annotations -----------------------------------------------------------------------------------------------------


@cache
def _written_out(kind: Kind) -> Kind:
    """Return what an alias stands for, any other annotation itself: from NumPy 2.5 on ``NDArray`` is one."""
    origin: Kind = get_origin(kind)
    value = getattr(origin or kind, "__value__", None)
    return kind if value is None else value[get_args(kind)] if get_args(kind) else value


def _form(kind: Kind) -> Kind:
    """Return what an annotation with arguments is a form of, any other itself."""
    kind = _written_out(kind)
    origin: Kind = get_origin(kind)
    return origin or kind


@cache
def _split(kind: Kind) -> tuple[Kind, bool]:
    """Return an annotation without None, and whether it allows None."""
    if _form(kind) not in (Union, UnionType):
        return kind, False
    rest = [part for part in get_args(kind) if part is not NoneType]
    return reduce(or_, rest), len(rest) < len(get_args(kind))


@cache
def _parts(kind: Kind) -> dict[str, Kind]:
    """Return the annotations of the fields of a dataclass, or of a tuple of fixed length, by name; {} of others."""
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return {f.name: hints[f.name] for f in fields(kind) if f.init}
    is_fixed = _form(kind) is tuple and _item(kind) is None
    return {str(i): part for i, part in enumerate(get_args(kind))} if is_fixed else {}


@cache
def _item(kind: Kind) -> Kind | None:
    """Return the annotation of the items of a tuple of any length, or of a dictionary: pairs; None of others."""
    if _form(kind) is dict:
        return tuple[get_args(kind)]  # type: ignore[misc]
    return get_args(kind)[0] if _form(kind) is tuple and get_args(kind)[-1:] == (Ellipsis,) else None


@cache
def _element_type(kind: Kind) -> type[np.generic]:
    """Return the type of the elements of an array by its annotation, np.generic where any will do; of an array that
    holds single values where the annotation is theirs. Raises TypeError where nothing can be stored."""
    if _form(kind) is np.ndarray:
        arguments = get_args(_written_out(kind))
        element = get_args(arguments[1])[0] if arguments else np.generic
        return element if isinstance(element, type) and issubclass(element, np.generic) else np.generic
    if kind in _NUMBERS:
        return _NUMBERS[kind][0]
    is_text = isinstance(kind, type) and issubclass(kind, str | PurePath | datetime | Enum)
    if is_text or (_form(kind) is Literal and all(isinstance(value, str) for value in get_args(kind))):
        return np.str_
    raise TypeError(f"values of the type {kind} cannot be stored")


# ---- single values ---------------------------------------------------------------------------------------------------


def _checked(kind: Kind, value: Any) -> Any:  # noqa: ANN401 - any single value
    """Return a single value. Raises TypeError where it is not of its kind."""
    if kind in _NUMBERS:
        fits = isinstance(value, _NUMBERS[kind][1]) and isinstance(value, bool | np.bool_) == (kind is bool)
    else:
        fits = value in get_args(kind) if _form(kind) is Literal else isinstance(value, kind)
    if not fits:
        raise TypeError(f"{value!r} is not of the type {kind}")
    return value


def _stored(kind: Kind, value: object) -> object:
    """Return the number or text that stands for a single value. Raises TypeError where it is not of its kind,
    ValueError where an array would not keep it."""
    value = _checked(kind, value)
    if isinstance(value, Enum):
        return value.name
    value = value.isoformat() if isinstance(value, datetime) else value
    value = value.as_posix() if isinstance(value, PurePath) else value
    if isinstance(value, str) and value.endswith("\0"):
        raise ValueError(f"{value!r} ends in a zero character, which an array does not keep")
    return value


def _value(kind: Kind, stored: Any) -> Any:  # noqa: ANN401 - any single value
    """Return what ``_stored`` was given. Raises TypeError, ValueError or LookupError where it is something else."""
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind[stored]
    if isinstance(kind, type) and issubclass(kind, datetime):
        return kind.fromisoformat(stored)
    return kind(stored) if isinstance(kind, type) and issubclass(kind, PurePath) else _checked(kind, stored)


# ---- many values -----------------------------------------------------------------------------------------------------


def _array(kind: Kind, value: object) -> NDArray[Any]:
    """Return an array as it is stored. Raises TypeError where its elements are others than its annotation says."""
    array, wanted = np.asarray(value), _element_type(kind)
    if np.issubdtype(array.dtype, wanted) and not array.dtype.hasobject:
        return array
    if array.dtype.kind in "biuf" and np.can_cast(array.dtype, wanted, "safe"):
        return array.astype(wanted)
    raise TypeError(f"an array of {array.dtype} is not of the type {kind}")


def _put(place: str, kind: Kind, values: Sequence[Any], arrays: Arrays, *, one: bool) -> None:
    """Add values of a kind to ``arrays``: ``one``, or a column of many."""
    kind, may_lack = _split(kind)
    if may_lack:
        known = np.array([value is not None for value in values], dtype=np.bool_)
        arrays[f"{place}-known"] = known.reshape(() if one else -1)
        values = [value for value in values if value is not None]
        if one and not values:
            return
    if (item := _item(kind)) is not None:
        rows = [tuple(value.items()) if isinstance(value, dict) else value for value in values]
        if not one:
            arrays[f"{place}-count"] = np.array([len(row) for row in rows], dtype=np.int64)
        _put(place if one else f"{place}-items", item, list(chain.from_iterable(rows)), arrays, one=False)
    elif parts := _parts(kind):
        for i, (name, part) in enumerate(parts.items()):
            own = [value[i] if _form(kind) is tuple else getattr(value, name) for value in values]
            _put(f"{place}.{name}", part, own, arrays, one=one)
    elif _form(kind) is np.ndarray:
        _put_arrays(place, [_array(kind, value) for value in values], _element_type(kind), arrays, one=one)
    else:
        dtype = _element_type(kind)
        column = np.array([_stored(kind, value) for value in values], dtype=dtype)
        arrays[place] = column.reshape(() if one else -1)


def _put_arrays(
    place: str, values: Sequence[NDArray[Any]], wanted: type[np.generic], arrays: Arrays, *, one: bool
) -> None:
    """Add one array, or a column: (n, ...) where all have one shape, else one after the other."""
    shapes = [value.shape for value in values]
    if one:
        arrays[place] = values[0]
    elif len(set(shapes)) == 1:
        arrays[place] = np.stack(values)
    else:
        nothing = np.zeros(0, dtype=np.bool_ if wanted is np.generic else wanted)
        arrays[place] = np.concatenate([value.ravel() for value in values]) if values else nothing
        _put(f"{place}-shape", tuple[int, ...], shapes, arrays, one=False)


def _take(place: str, arrays: Arrays, wanted: type[np.generic], axes: int | None = None) -> NDArray[Any]:
    """Take an array out of ``arrays``. Raises _DamageError where it is missing, or of another type or dimension."""
    array = arrays.pop(place, None)
    if array is None:
        raise _DamageError(place, "it is missing")
    if not np.issubdtype(array.dtype, wanted) or axes not in (None, array.ndim):
        raise _DamageError(place, f"it is an array {array.shape} of {array.dtype}")
    return array


def _cut(place: str, values: Sequence[Any] | NDArray[Any], counts: Sequence[int]) -> list[Any]:
    """Return values cut into rows of so many. Raises _DamageError where these are not as many as there are."""
    if min(counts, default=0) < 0 or sum(counts) != len(values):
        raise _DamageError(place, f"it has {len(values)} values for rows of {sum(counts)}")
    ends = np.cumsum(counts).tolist()
    return [values[end - count : end] for end, count in zip(ends, counts, strict=True)]


def _get(place: str, kind: Kind, arrays: Arrays, *, one: bool) -> list[Any]:
    """Return the values that ``_put`` added, and take their entries out of ``arrays``."""
    kind, may_lack = _split(kind)
    if may_lack:
        known = _take(f"{place}-known", arrays, np.bool_, 0 if one else 1).reshape(-1).tolist()
        values = _get(place, kind, arrays, one=one) if not one or known[0] else []
        return [row[0] if row else None for row in _cut(place, values, known)]
    if (item := _item(kind)) is not None:
        counts = None if one else _take(f"{place}-count", arrays, np.int64, 1).tolist()
        items = _get(place if one else f"{place}-items", item, arrays, one=False)
        rows = [items] if counts is None else _cut(place, items, counts)
        return [dict(row) if _form(kind) is dict else tuple(row) for row in rows]
    if parts := _parts(kind):
        columns = [_get(f"{place}.{name}", part, arrays, one=one) for name, part in parts.items()]
        if len({len(column) for column in columns}) > 1:
            raise _DamageError(place, "its columns have different lengths")
        return [_made(place, kind, dict(zip(parts, row, strict=True))) for row in zip(*columns, strict=True)]
    if _form(kind) is np.ndarray:
        return _get_arrays(place, _element_type(kind), arrays, one=one)
    try:
        column = _take(place, arrays, _element_type(kind), 0 if one else 1)
        return [_value(kind, value) for value in column.reshape(-1).tolist()]
    except (ValueError, TypeError, LookupError) as error:
        raise error if isinstance(error, _DamageError) else _DamageError(place, str(error)) from error


def _get_arrays(place: str, wanted: type[np.generic], arrays: Arrays, *, one: bool) -> list[NDArray[Any]]:
    """Return what ``_put_arrays`` added."""
    array = _take(place, arrays, wanted)
    if one:
        return [array]
    if f"{place}-shape-count" in arrays:
        shapes = _get(f"{place}-shape", tuple[int, ...], arrays, one=False)
        flat = _cut(place, array.reshape(-1), [prod(shape) for shape in shapes])
        if min(chain.from_iterable(shapes), default=0) < 0:
            raise _DamageError(place, "a shape is negative")
        return [part.reshape(shape) for part, shape in zip(flat, shapes, strict=True)]
    if not array.ndim:
        raise _DamageError(place, "it is a single number")
    return [array[i, ...] for i in range(len(array))]


def _made(place: str, kind: Kind, parts: Mapping[str, object]) -> object:
    """Return a dataclass, or a tuple, of its parts. Raises _DamageError where they do not fit each other."""
    if _form(kind) is tuple:
        return tuple(parts.values())
    try:
        return kind(**parts)
    except (ValueError, TypeError) as error:
        raise _DamageError(place, str(error)) from error


def write_record(path: Path, record: object, left_out: Collection[str] = ()) -> None:
    """Write a dataclass, but for the fields ``left_out``, as uncompressed npz, whole or not at all, the same bytes for
    the same record. Raises TypeError where a field is not of its annotation, or of one that cannot be stored."""
    arrays: Arrays = {}
    whole: Kind = type(record)
    for name, kind in _parts(whole).items():
        if name not in left_out:
            _put(name, kind, [getattr(record, name)], arrays, one=True)
    write_arrays(path, arrays)


def read_record(path: Path, kind: type[RecordT], given: Mapping[str, object] = NOTHING) -> RecordT:
    """Return the dataclass that ``write_record`` wrote, bit for bit, with the fields ``given`` that it left out. Raises
    WorkspaceError where the file is missing or damaged, or holds something else."""
    arrays = read_arrays(path)
    try:
        whole: Kind = kind
        own = {n: _get(n, part, arrays, one=True)[0] for n, part in _parts(whole).items() if n not in given}
        record = _made("", whole, {**own, **given})
        if arrays:
            raise _DamageError(min(arrays), "nothing of this name is expected")
    except _DamageError as error:
        raise WorkspaceError(f"{path}: cannot be read ({error}): delete it and run again") from error
    assert isinstance(record, kind)
    return record
