"""What a command prints now and did not before: cell by cell of its tables, figures beside each other.

Both ran over the same seeds, so a figure that differs was moved by the change, not by chance; the last printed digit
may be rounding. Times and memory do scatter: of columns or rows that are called so a quarter is let pass.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lib.study import PrintedTable

OF_TIMES = 0.25
"""Share of itself that a time or an amount of memory may change by on a machine that does other things as well."""
_TIMES = re.compile(r"second|minute|\bs\b|time|memory|MB|GiB|ratio|speed", re.IGNORECASE)
_NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Moved:
    """A cell that says something else: where it stands, what stood there, and by how much of itself its first figure
    that differs changed; None where figures were added, lost, or words changed."""

    place: str
    before: str
    after: str
    change: float | None

    @property
    def sentence(self) -> str:
        """Return it in a line."""
        by = "" if self.change is None else f" ({100.0 * self.change:+.0f} %)"
        return f"{self.place}: {self.before} → {self.after}{by}"


def numbers(text: str) -> list[tuple[float, float]]:
    """Return the numbers of a text, each with one unit of its last digit."""
    found = []
    for match in _NUMBER.finditer(text):
        word = match[0].replace("−", "-")
        mantissa, _, exponent = word.partition("e")
        digits = len(mantissa.partition(".")[2])
        found.append((float(word), 10.0 ** (int(exponent or 0) - digits)))
    return found


def _cell(place: str, before: str, after: str) -> Moved | None:
    """Return a cell that was moved, None where it says the same."""
    one, other = numbers(before), numbers(after)
    if len(one) != len(other) or _NUMBER.sub("", before) != _NUMBER.sub("", after):
        return Moved(place, before, after, None)
    for (a, step), (b, other_step) in zip(one, other, strict=True):
        room = max(step, other_step) * (1.0 + 1e-9)
        if _TIMES.search(place):
            room = max(room, OF_TIMES * max(abs(a), abs(b)))
        if abs(a - b) > room:
            return Moved(place, before, after, (b - a) / abs(a) if a else None)
    return None


def _rows(table: PrintedTable) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows of a table with a name each: their first cell, numbered where that comes again."""
    seen: dict[str, int] = {}
    for cells in table["rows"]:
        name = cells[0] if cells else ""
        seen[name] = seen.get(name, 0) + 1
        yield (name if seen[name] == 1 else f"{name} ({seen[name]})"), cells


def moved(before: Sequence[PrintedTable], after: Sequence[PrintedTable]) -> list[Moved]:
    """Return the cells of tables that were moved, the largest changes first, and what stands in one of them alone."""
    found = list[Moved]()
    for number, (old, new) in enumerate(zip(before, after, strict=False), start=1):
        rows, title = dict(_rows(old)), f"table {number}"
        columns = {name: k for k, name in enumerate(old["columns"])}
        for name, cells in _rows(new):
            if name not in rows:
                found.append(Moved(f"{title}, {name}", "no such row", "a new one", None))
                continue
            for column, cell in zip(new["columns"], cells, strict=False):
                if column not in columns or columns[column] >= len(rows[name]):
                    found.append(Moved(f"{title}, {name}, {column}", "no such column", cell, None))
                elif (change := _cell(f"{title}, {name}, {column}", rows[name][columns[column]], cell)) is not None:
                    found.append(change)
        gone = rows.keys() - dict(_rows(new)).keys()
        found += [Moved(f"{title}, {name}", "a row", "none", None) for name in sorted(gone)]
    if len(before) != len(after):
        found.append(Moved("tables", str(len(before)), str(len(after)), None))
    return sorted(found, key=lambda m: -abs(m.change) if m.change is not None else float("-inf"))
