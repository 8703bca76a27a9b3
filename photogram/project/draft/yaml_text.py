"""Pieces of YAML as a draft writes them: scalars, short lists, mappings over several lines, and comments."""

import json
import re
import textwrap
from collections.abc import Sequence
from math import isfinite

from photogram.gnss import Sigma3

_WIDTH = 116
_PLAIN = re.compile(r"[\w./][\w./()+-]*(?:[: ][\w./()+-]+)*", re.ASCII)
_WORDS = re.compile(r"true|false|null|yes|no|on|off|[yn]|\.?nan|\.?inf|0[xob].*|[^A-Za-z]*", re.IGNORECASE)


def scalar(text: str) -> str:
    """Return a text as YAML reads it back, in quotes where some reader might take it for anything else."""
    try:
        is_number = isfinite(float(text))
    except ValueError:
        is_number = False
    if _PLAIN.fullmatch(text) and not _WORDS.fullmatch(text) and not is_number:
        return text
    return json.dumps(text, ensure_ascii=False)


def numbers(values: Sequence[float], form: str) -> str:
    """Return numbers, each in a format, as a list."""
    return "[" + ", ".join(format(value, form) for value in values) + "]"


def sigma3(sigma_m: Sigma3) -> str:
    """Return three standard deviations, to the millimetre, as a list."""
    return "[" + ", ".join(f"{round(s, 3):g}" for s in sigma_m) + "]"


def comment(text: str, indent: int = 0) -> list[str]:
    """Return a text as the lines of a comment."""
    margin = " " * indent + "# "
    return textwrap.wrap(text, _WIDTH, initial_indent=margin, subsequent_indent=margin, break_on_hyphens=False)


def flow(key: str, entries: Sequence[str]) -> list[str]:
    """Return a mapping in YAML's flow style after its indented ``key``, on as many lines as it needs."""
    together = (entry.replace(" ", "\0") for entry in entries)  # an entry is not broken over lines
    lines = textwrap.wrap(
        ", ".join(together), _WIDTH, initial_indent=f"{key}: {{", subsequent_indent=" " * (len(key) + 3)
    )
    return [line.replace("\0", " ") for line in (*lines[:-1], f"{lines[-1]}}}")]
