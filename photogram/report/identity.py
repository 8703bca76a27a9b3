"""What ties the page, its print, the view and report.json of one survey together: an identifier of their contents."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence

DIGITS = 16
VOLATILE = frozenset({"seconds", "peak_memory_bytes", "processed", "report_id"})
"""Keys, wherever they stand, that may differ between two runs over the same input."""


def _content(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(k): _content(v) for k, v in value.items() if k not in VOLATILE}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_content(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None  # as report.json has it
    return value


def report_id(report: Mapping[str, object]) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of everything in a report but times, memory and the date.

    Two runs over the same input have the same one; another measurement, setting, target or name gives another.
    """
    text = json.dumps(_content(report), sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:DIGITS]


def grouped(identifier: str | None) -> str:
    """Return an identifier in groups of four, as it is read aloud."""
    text = identifier or ""
    return "-".join(text[i : i + 4] for i in range(0, len(text), 4))
