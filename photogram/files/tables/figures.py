"""Figures as people and their programs write them: decimal commas, groups of thousands, degrees with minutes and
seconds."""

import re
from collections.abc import Iterable
from typing import Literal

Mark = Literal["point", "comma", "unclear"]
"""What separates the decimals of a table's figures; unclear where they may be decimals or thousands."""

_COMMA = re.compile(r"[-+]?\d+,\d+")
_POINT = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?")
_THOUSANDS_BY_COMMA = re.compile(r"[-+]?\d{1,3}(?:,\d{3})+(?:\.\d+)?")
_THOUSANDS_BY_POINT = re.compile(r"[-+]?\d{1,3}(?:\.\d{3})+,\d+|[-+]?\d{1,3}(?:\.\d{3}){2,}")
_THOUSANDS_BY_BLANK = re.compile(r"[-+]?\d{1,3}(?:[ \u00a0\u2009\u202f'’]\d{3})+(?:[.,]\d+)?")
_BLANK = re.compile(r"[ \u00a0\u2009\u202f'’]")

_ANGLE = re.compile(
    r"(?P<before>[NSEWO])?\s*(?P<sign>[-+])?(?P<degrees>\d{1,3})(?:°|º|\s|d|:)\s*"
    r"(?P<minutes>\d{1,2}(?:[.,]\d+)?)(?:(?:\s*['′’:m]\s*|\s+)(?P<seconds>\d{1,2}(?:[.,]\d+)?)\s*(?:\"|″|''|’’|s)?"
    r"|\s*['′’m])?"
    r"\s*(?P<after>[NSEWO])?",
    re.IGNORECASE,
)
_HEMISPHERE = re.compile(r"(?P<before>[NSEWO])?\s*(?P<figure>[-+]?\d+(?:[.,]\d+)?)\s*[°º]?\s*(?P<after>[NSEWO])?", re.I)


def _ungrouped(text: str) -> str:
    """Return a figure without blanks or apostrophes between its thousands."""
    return _BLANK.sub("", text) if _THOUSANDS_BY_BLANK.fullmatch(text) else text


def decimal_mark(cells: Iterable[str]) -> Mark:
    """Return what separates the decimals of figures that belong together: a comma where one of them cannot be read
    otherwise and none has a point there."""
    has_point = has_comma = is_open = False
    for cell in map(_ungrouped, cells):
        if _ANGLE.fullmatch(cell.strip()):
            has_point |= "." in cell
            has_comma |= "," in cell
        elif _THOUSANDS_BY_POINT.fullmatch(cell):
            has_comma = True
        elif _COMMA.fullmatch(cell):
            thousands = _THOUSANDS_BY_COMMA.fullmatch(cell) is not None
            is_open |= thousands
            has_comma |= not thousands
        elif _POINT.fullmatch(cell) or _THOUSANDS_BY_COMMA.fullmatch(cell):
            has_point = True
    if has_comma and not has_point:
        return "comma"
    return "unclear" if is_open and not has_point else "point"


def in_plain_form(cell: str, mark: Mark) -> str:
    """Return a figure with a decimal point and without groups of thousands; a text that is none as it is."""
    text = _ungrouped(cell)
    if mark == "comma":
        if _THOUSANDS_BY_POINT.fullmatch(text):
            return text.replace(".", "").replace(",", ".")
        return text.replace(",", ".") if _COMMA.fullmatch(text) else cell if text == cell else text
    grouped = _THOUSANDS_BY_COMMA.fullmatch(text) and ("." in text or text.count(",") > 1)
    return text.replace(",", "") if grouped else text


def _sign(before: str | None, after: str | None, sign: str | None) -> float | None:
    """Return the sign of an angle by its hemisphere, else by itself; None where both are said."""
    letter = (before or after or "").upper()
    if (before and after) or (letter and sign == "-"):
        return None
    return -1.0 if letter in ("S", "W") or sign == "-" else 1.0


def degrees_of(cell: str) -> str:
    """Return an angle with hemisphere, or of degrees, minutes and seconds, as a figure in degrees; a text that is
    neither, or means none, as it is. ``O`` is east in German and west in Latin languages, and is left as it is."""
    text = cell.strip()
    if match := _HEMISPHERE.fullmatch(text):
        letters = (match["before"], match["after"])
        sign = _sign(*letters, "-" if match["figure"].startswith("-") else None)
        said = any(letters) or "°" in text or "º" in text
        if not said or sign is None or "O" in "".join(filter(None, letters)).upper():
            return cell
        figure = match["figure"].replace(",", ".")
        return ("-" if sign < 0 and not figure.startswith("-") else "") + figure
    if (match := _ANGLE.fullmatch(text)) is None:
        return cell
    sign = _sign(match["before"], match["after"], match["sign"])
    minutes, seconds = (float((match[k] or "0").replace(",", ".")) for k in ("minutes", "seconds"))
    is_open = "O" in ((match["before"] or "") + (match["after"] or "")).upper()
    if sign is None or is_open or minutes >= 60.0 or seconds >= 60.0:
        return cell
    return repr(sign * (float(match["degrees"]) + minutes / 60.0 + seconds / 3600.0))
