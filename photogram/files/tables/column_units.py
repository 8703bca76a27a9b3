"""Units in the names of columns, exactly: ``Elevation (ft)``, ``sigma_plan [mm]``, ``height_m``."""

import re
from collections.abc import Mapping

UnitsM = tuple[float | None, float | None, float | None]
"""Units of three coordinates in metres, None where nothing states one."""
NO_UNITS: UnitsM = (None, None, None)

FOOT_M, SURVEY_FOOT_M = 0.3048, 1200.0 / 3937.0

LENGTHS_M: Mapping[str, float] = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), 0.001),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), 0.01),
    **dict.fromkeys(("km", "kilometer", "kilometers", "kilometre", "kilometres"), 1000.0),
    **dict.fromkeys(("ft", "foot", "feet", "ift", "intft", "internationalfeet", "internationalfoot"), FOOT_M),
    **dict.fromkeys(
        ("usft", "ftus", "sft", "usfeet", "usfoot", "ussurveyfeet", "ussurveyfoot", "surveyfeet", "surveyfoot"),
        SURVEY_FOOT_M,
    ),
    **dict.fromkeys(("in", "inch", "inches"), 0.0254),
    **dict.fromkeys(("yd", "yard", "yards"), 0.9144),
}
"""Units of length by the words that people write, letters alone. A foot that does not say of which kind is the
international one; over a height of 1000 m both differ by 2 mm."""

OTHERS = ("px", "pixel", "pixels", "deg", "degree", "degrees", "dd", "°", "decimaldegrees", "s", "sec", "seconds")
"""Units in which nothing has to be converted."""

_UNREAD = frozenset((
    "dm", "decimeter", "decimeters", "decimetre", "decimetres", "hm", "mi", "mile", "miles", "nmi", "nauticalmiles",
    "ch", "chain", "chains", "link", "links", "rod", "rods", "perch", "perches", "pole", "poles", "fathom", "fathoms",
    "furlong", "furlongs", "cubit", "cubits", "vara", "varas", "toise", "toises", "klafter", "rute", "ruten", "shaku",
    "ken", "cun", "chi", "gon", "gons", "grad", "grads", "rad", "radian", "radians", "mil", "mils",
))  # fmt: skip
"""Units that people have, and that are not read."""

LONGEST_NAME = 200
"""Of a column, in characters: what is longer states no unit."""

_BRACKET = re.compile(r"[(\[]([^)\]]*)[)\]]")
_ENDING = re.compile(r"(?<=[a-z0-9])[\s_,-]+(m|mm|cm|ft|feet|foot|usft|ftus|sft|px|deg)$", re.IGNORECASE)


def _word(text: str) -> str:
    """Return the letters of a unit alone: ``in US feet`` is usfeet."""
    word = re.sub(r"[^a-z°]", "", text.lower())
    return word.removeprefix("in") if word not in LENGTHS_M else word


def without_unit(column: str) -> str:
    """Return the name of a column without what stands in brackets, and without a unit at its end."""
    if len(column) > LONGEST_NAME:
        return column
    return _ENDING.sub("", _BRACKET.sub("", column).strip()).strip()


def unit_of(column: str) -> str | None:
    """Return the unit that the name of a column states, as one of LENGTHS_M or OTHERS; None where it states none."""
    if len(column) > LONGEST_NAME:
        return None
    ending = _ENDING.search(_BRACKET.sub("", column).strip())
    stated = [*_BRACKET.findall(column), *([ending[1]] if ending else [])]
    return next((word for word in map(_word, stated) if word in LENGTHS_M or word in OTHERS), None)


def unread_unit(column: str) -> str | None:
    """Return the unit that the name of a column states and that is not read, None where there is none."""
    return next((text for text in _BRACKET.findall(column[:LONGEST_NAME]) if _word(text) in _UNREAD), None)


def is_unit(text: str) -> bool:
    """Return whether a text is the name of a unit, alone."""
    word = _word(text)
    return word in LENGTHS_M or word in OTHERS


def unit_m(text: str) -> float | None:
    """Return a unit of length by its name alone, in metres, None where it is not known."""
    return LENGTHS_M.get(_word(text))


def length_unit_m(column: str) -> float | None:
    """Return the unit of length that the name of a column states, in metres, None where it states none."""
    unit = unit_of(column)
    return None if unit is None else LENGTHS_M.get(unit)


_WORDS = {
    1.0: "metres", 0.001: "millimetres", 0.01: "centimetres", 1000.0: "kilometres", FOOT_M: "feet",
    SURVEY_FOOT_M: "US survey feet", 0.0254: "inches", 0.9144: "yards",
}  # fmt: skip


def in_words(units_m: UnitsM) -> str:
    """Return what the units of easting, northing and height are called, as far as they are stated."""
    stated = (("easting and northing", units_m[0]), ("heights", units_m[2]))
    return " and ".join(f"{what} in {_WORDS[unit]}" for what, unit in stated if unit is not None)
