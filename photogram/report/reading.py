"""report.json read back: photogram's own, whole, and its figures figures."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jinja2 import TemplateError

from photogram.errors import PhotogramError, ReportError
from photogram.files.reading import read_whole
from photogram.wording import printable, shortened

Json = dict[str, Any]

MOST_BYTES = 500_000_000
"""Of report.json: some 100 000 photographs."""

NEEDED: Mapping[str, type] = {
    "photogram": str,
    "crs": str,
    "cameras": dict,
    "photographs": dict,
    "control_points": list,
}
"""Keys of report.json without which there is no page, and what they hold."""

LARGEST = 1e15
"""Of any figure with a unit, without sign."""

_UNITS = ("_m", "_px", "_deg", "_m2", "_px2", "_gsd", "_bytes", "_seconds")
_IN_WORDS = ("held",)
"""Blocks that say in words why a parameter was not estimated."""

_REMEDY = "run photogram adjust again"


def read_report(path: Path) -> Json:
    """Return what report.json holds. Raises ReportError where it cannot be read, is damaged or is something else."""
    try:
        report = json.loads(read_whole(path, MOST_BYTES).decode("utf-8"), parse_constant=_no_number)
    except OSError as fault:
        raise ReportError(f"{path}: cannot be read ({fault.strerror}): {_REMEDY}") from fault
    except (ValueError, RecursionError) as fault:
        raise ReportError(f"{path}: damaged ({fault}): {_REMEDY}") from fault
    if not isinstance(report, dict):
        raise ReportError(f"{path}: no report of photogram, it is no block of keys: {_REMEDY}")
    for key, kind in NEEDED.items():
        if key not in report:
            raise ReportError(f"{path}: no report of photogram, {key} is not in it: {_REMEDY}")
        if not isinstance(report[key], kind):
            raise ReportError(f"{path}: damaged, {key} is {_shown(report[key])}: {_REMEDY}")
    damage = _first_fault(report, "") or _fault_of_points(report["control_points"])
    if damage:
        raise ReportError(f"{path}: damaged, {damage}: {_REMEDY}")
    return report


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number that JSON knows")


def _shown(value: object) -> str:
    return printable(shortened(repr(value), 40))


def _first_fault(value: object, where: str, figures: bool = False) -> str:
    """Return what is no figure under a key that ends in a unit, empty where there is nothing."""
    if isinstance(value, dict):
        # names of photographs are keys too, and may end in anything
        parts = [
            (v, f"{where}.{k}" if where else k, k.endswith(_UNITS) and not isinstance(v, dict))
            for k, v in value.items()
            if k not in _IN_WORDS
        ]
    elif isinstance(value, list):
        parts = [(v, f"{where}[{i}]", figures) for i, v in enumerate(value)]
    else:
        figure = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
        return f"{shortened(where, 100)} is {_shown(value)}" if figures and not figure and value is not None else ""
    return next((fault for part in parts if (fault := _first_fault(*part))), "")


def _fault_of_points(points: list[Any]) -> str:
    for i, point in enumerate(points):
        if not isinstance(point, dict):
            return f"control_points[{i}] is {_shown(point)}"
        for key, kind in (("name", str), ("role", str), ("surveyed_map_m", list)):
            if not isinstance(point.get(key), kind):
                return f"control_points[{i}].{key} is {_shown(point.get(key))}"
        for key in ("surveyed_map_m", "residual_m", "sigma_m", "surveyed_sigma_m"):
            figures = point.get(key)
            if figures is not None and not (isinstance(figures, list) and len(figures) == 3):
                return f"control_points[{i}].{key} is {_shown(figures)}"
    return ""


_TRIPS = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError)


@contextmanager
def making_of(path: Path) -> Iterator[None]:
    """Turn whatever the making of a page trips over into a ReportError that names the report ``path``.

    read_report cannot know every figure that a page wants; a page is made of nothing but the report.
    """
    try:
        yield
    except PhotogramError:
        raise
    except (
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        ArithmeticError,
        RecursionError,
        TemplateError,
    ) as fault:
        words = printable(shortened(f"{type(fault).__name__}: {fault}", 200))
        raise ReportError(f"{path}: damaged, or not of this version of photogram ({words}): {_REMEDY}") from fault
