"""Words of messages: texts of others made fit for a terminal or a table, lists of names, counts with their noun, shares
in per cent, and how far work is."""

import math
import re
from collections.abc import Callable, Sequence
from html import escape

MOST_SHOWN = 60

NO_FIGURE = "–"
THIN_SPACE = "\u202f"
MORE_DECIMALS = 2
"""Of a share that rounding would make whole or nothing, at most."""

Progress = Callable[[int, int, str], None]
"""Takes how far work is: pieces done, of how many, 0 while that is not known, and what is worked on."""


def silent(_done: int, _total: int, _text: str) -> None:
    """Take progress and say nothing."""


def printable(text: str) -> str:
    """Return ``text`` with whatever a terminal would obey written out: ``\\x1b`` for an escape, ``\\udcff`` for a byte
    that is no UTF-8. Line breaks and thin spaces are kept."""
    if text.isprintable():
        return text
    kept = ("\n", THIN_SPACE)
    return "".join(c if c.isprintable() or c in kept else c.encode("unicode_escape").decode("ascii") for c in text)


def shortened(text: str, most: int = MOST_SHOWN) -> str:
    """Return at most so many characters of ``text``, and how many there are where that is not all."""
    return text if len(text) <= most else f"{text[:most]}… ({len(text)} characters)"


def file_stem(number: int, name: str) -> str:
    """Return a short name for a file about the thing ``name``, unlike that of any other ``number``.

    Plain letters, digits, - and _ alone, whatever the name holds: a path, a device's name or 200 characters.
    """
    stem = name.rpartition("/")[2].rpartition(".")[0] or name.rpartition("/")[2]
    return f"{number:04d}_{re.sub(r'[^A-Za-z0-9_-]+', '_', stem)[:40]}"


def table_cell(text: str) -> str:
    """Return ``text`` as a cell that no spreadsheet takes for a formula: with an apostrophe before ``=`` and its like.

    Spreadsheets reckon what begins with =, +, -, @, a tab or a carriage return (OWASP, CSV Injection). Plain numbers
    are left as they are.
    """
    if text[:1] in tuple("=+-@\t\r") and text and not is_number(text):
        return f"'{text}"
    return text


def is_number(text: str) -> bool:
    """Return whether Python reads ``text`` as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def uncapitalised(title: str) -> str:
    """Return a title within a sentence: its first letter small, unless it begins with an abbreviation."""
    return title if title[1:2].isupper() else title[:1].lower() + title[1:]


def some(names: Sequence[str], most: int = 5) -> str:
    """Return the first names of a list, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def things(count: int, one: str, several: str = "") -> str:
    """Return a count with its noun, ``several`` where adding an s will not do."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def percent(share: float, digits: int = 0) -> str:
    """Return a share in per cent with so many decimals, and with more where a part would be written as all or as
    nothing: below 1 it is never 100 %, above 0 never 0 %. An en dash where it is not finite."""
    if not math.isfinite(share):
        return NO_FIGURE
    for decimals in range(digits, digits + MORE_DECIMALS + 1):
        text = f"{100 * share:.{decimals}f}"
        if float(text) not in (0.0, 100.0) or share in (0.0, 1.0):
            return f"{text.replace('-', '−')}{THIN_SPACE}%"
    end, least = 10.0**-decimals, share < 0.5
    return f"{'<' if least else '>'}{THIN_SPACE}{end if least else 100.0 - end:.{decimals}f}{THIN_SPACE}%"


def html_table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as HTML, for a notebook: whatever the texts hold is shown, none of it is obeyed."""

    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(printable(cell))}</{tag}>" for cell in cells) + "</tr>"

    lines = [row(head, "th")] if any(head) else []
    lines += [row(cells, "td") for cells in rows]
    return f"<table><caption>{escape(printable(caption))}</caption>" + "".join(lines) + "</table>"


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table as text, its columns side by side."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(printable(line.rstrip()) for line in lines)
