"""The options of a task, as NodeODM names them: which there are, what each may be, and what each sets in photogram.

One table, OPTIONS. Each option is a setting of the project file, an argument of `photogram init`, or a choice of what
is handed back. The names are ODM's where the meaning is the same; what ODM has and photogram has not is not in the
table, so that WebODM does not offer it, and refused where it comes all the same.
"""

import difflib
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from typing_extensions import TypedDict

from photogram.node.refusals import RequestError
from photogram.project.draft.edits import Value
from photogram.settings.settings import Within
from photogram.wording import printable, shortened

OptionType = Literal["int", "float", "string", "bool", "enum"]
OptionValue: TypeAlias = bool | int | float | str
Options = Mapping[str, OptionValue]
"""Of a task, by their names: those that were given."""

Lines = Mapping[tuple[str | int, ...], Value | None]
"""Of the project file: key and value, None where there shall be none."""

_CM = 0.01
_RASTER_CM = Within(0.1, 100_000, "cm", or_zero=True)
_LONGEST = 200


def _nothing(_: OptionValue) -> Lines:
    return {}


@dataclass(frozen=True)
class NodeOption:
    """An option of a task. ``sets`` gives what its value writes into the project file."""

    name: str
    type: OptionType
    default: OptionValue
    help: str
    within: Within | None = None
    choices: tuple[str, ...] = ()
    pattern: str = ""
    """That a text must have; an empty one is always allowed."""
    expected: str = ""
    """What that pattern stands for, in words."""
    always: bool = False
    """Whether photogram does it in any case, so that it cannot be switched off."""
    sets: Callable[[OptionValue], Lines] = _nothing

    @property
    def domain(self) -> str | list[str]:
        """What the option may be, as NodeODM says it."""
        if self.choices:
            return list(self.choices)
        if self.within is None:
            return "string" if self.type == "string" else ""
        kind = "integer" if self.type == "int" else "float"
        low, high = f"{self.within.low:.15g}", f"{self.within.high:.15g}"
        return f"{kind} >= 0" if self.within.or_zero else f"{kind}: {low} <= x <= {high}"


def _quality(value: OptionValue) -> Lines:
    return {("quality",): {"ultra": "high", "high": "medium", "medium": "low"}[str(value)]}


def _length(*key: str) -> Callable[[OptionValue], Lines]:
    return lambda value: {key: round(float(value) * _CM, 6) or None}


def _partners(value: OptionValue) -> Lines:
    number = int(value) or None
    return {("pairs", "maximum"): number, ("pairs", "neighbours"): number}


OPTIONS: tuple[NodeOption, ...] = (
    NodeOption("dsm", "bool", True, "Hand back the surface model. It is made in any case."),
    NodeOption(
        "dtm", "bool", False, "Make a terrain model: the ground without houses and trees.",
        sets=lambda value: {("terrain", "enabled"): bool(value)},
    ),
    NodeOption(
        "orthophoto-resolution", "float", 0.0,
        "Cell of the orthophoto in cm; 0: as the photographs resolve the ground. Not finer than that, see ignore-gsd.",
        within=_RASTER_CM, sets=_length("orthophoto", "cell_m"),
    ),
    NodeOption(
        "dem-resolution", "float", 0.0,
        "Cell of surface, terrain and dense point cloud in cm; 0: twice what the photographs resolve. Not finer than "
        "they resolve, see ignore-gsd.",
        within=_RASTER_CM, sets=_length("surface", "cell_m"),
    ),
    NodeOption("ignore-gsd", "bool", False, "Make cells as small as asked for, finer than the photographs resolve."),
    NodeOption(
        "fast-orthophoto", "bool", False,
        "Skip dense matching: surface and orthophoto are made on the tie points. Quick and coarse.",
        sets=lambda value: {("dense", "enabled"): False if value else None},
    ),
    NodeOption(
        "skip-orthophoto", "bool", False, "Make no orthophoto.",
        sets=lambda value: {("orthophoto", "enabled"): False if value else None},
    ),
    NodeOption(
        "feature-quality", "enum", "ultra",
        "Size of the pictures in which key points are found: ultra is the whole, high half and medium a quarter of it.",
        choices=("ultra", "high", "medium"), sets=_quality,
    ),
    NodeOption(
        "min-num-features", "int", 10_000, "Key points kept per photograph, those that are clearest.",
        within=Within(8, 200_000), sets=lambda value: {("features", "maximum"): int(value)},
    ),
    NodeOption(
        "matcher-neighbors", "int", 0,
        "Photographs that each one is matched with; 0: 16 by predicted footprints, 12 where these are not known.",
        within=Within(1, 1000, or_zero=True), sets=_partners,
    ),
    NodeOption("skip-report", "bool", False, "Do not print the report as PDF; report.html and report.json stay."),
    NodeOption("pc-copc", "bool", False, "Hand back the point cloud as Cloud Optimized Point Cloud (COPC) too."),
    NodeOption(
        "pc-ept", "bool", True,
        "Hand back the point cloud as Entwine Point Tiles (EPT) too, which WebODM shows in 3-D.",
    ),
    NodeOption("auto-boundary", "bool", True, "Map only ground that the photographs show well, always.", always=True),
    NodeOption("cog", "bool", True, "Rasters are Cloud Optimized GeoTIFFs, always.", always=True),
    NodeOption(
        "crs", "string", "",
        "photogram's own: map grid of the results, EPSG:25832 for example; empty: that of the ground points, or "
        "the UTM zone of the photographs.",
        pattern=r"EPSG:\d{4,6}(\+\d{4,6})?", expected="EPSG:25832, for example",
    ),
    NodeOption(
        "heights", "enum", "auto",
        "photogram's own: what the heights of the ground points are above; orthometric ones need a geoid.",
        choices=("auto", "ellipsoidal", "orthometric"),
    ),
    NodeOption(
        "geoid", "string", "", "photogram's own: geoid of orthometric heights: EGM96, EGM2008, or a code as EPSG:5799.",
        pattern=r"EGM84|EGM96|EGM2008|EPSG:\d{4,6}", expected="EGM84, EGM96, EGM2008 or EPSG:5799, for example",
    ),
    NodeOption(
        "focal-px", "float", 0.0,
        "photogram's own: focal length in pixels where the tags of the photographs do not give it; 0: as the tags say.",
        within=Within(1, 1e6, "px", or_zero=True),
    ),
)  # fmt: skip
_BY_NAME = {option.name: option for option in OPTIONS}


class OptionView(TypedDict):
    """An option as `/options` lists it."""

    name: str
    type: OptionType
    value: str
    domain: str | list[str]
    help: str


class GivenOption(TypedDict):
    """An option of a task, as its information lists it."""

    name: str
    value: OptionValue


def option_views() -> list[OptionView]:
    """Return all options, as `/options` lists them."""
    return [
        {"name": o.name, "type": o.type, "value": _written(o.default), "domain": o.domain, "help": o.help}
        for o in OPTIONS
    ]


def _written(value: OptionValue) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def given_options(options: Options) -> list[GivenOption]:
    """Return the options of a task as its information lists them."""
    return [{"name": name, "value": value} for name, value in options.items()]


def checked_options(text: str) -> dict[str, OptionValue]:
    """Return the options of a JSON list of objects with ``name`` and ``value``; an empty text gives none. Raises
    RequestError with all that is wrong with them: a name that is none, or twice there, and a value that cannot be."""
    if not text.strip():
        return {}
    try:
        listed = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RequestError(f"options: this is not JSON ({shortened(str(error))})") from error
    if not isinstance(listed, list) or not all(isinstance(o, dict) and isinstance(o.get("name"), str) for o in listed):
        raise RequestError('options: a list is expected, of objects as {"name": "dsm", "value": true}')
    options, errors = dict[str, OptionValue](), list[str]()
    for given in listed:
        name = given["name"]
        try:
            if name in options:
                raise ValueError("is given twice")
            options[name] = _value(name, given.get("value"))
        except ValueError as error:
            errors.append(f"{shortened(printable(name))}: {error}")
    if errors:
        raise RequestError("; ".join(errors))
    return options


def _value(name: str, given: object) -> OptionValue:
    option = _BY_NAME.get(name)
    if option is None:
        near = difflib.get_close_matches(name, _BY_NAME, 1)
        raise ValueError("this node has no such option" + (f": did you mean {near[0]}?" if near else ""))
    value = _READ[option.type](given)
    if value is None:
        raise ValueError(f"{_found(given)} is not of type {option.type}")
    if option.always and value is not True:
        raise ValueError("cannot be switched off on this node")
    if option.choices and value not in option.choices:
        raise ValueError(f"{_found(given)} is none of {', '.join(option.choices)}")
    if option.within is not None and not option.within.holds(float(value)):
        raise ValueError(f"must be {option.within}, found {_found(given)}")
    if option.pattern and value and not re.fullmatch(option.pattern, str(value)):
        raise ValueError(f"{_found(given)} is not understood: {option.expected}")
    return value


def _found(given: object) -> str:
    return shortened(printable(str(given)))


def _as_float(given: object) -> float | None:
    if isinstance(given, bool) or not isinstance(given, int | float | str):
        return None
    try:
        number = float(given)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _as_int(given: object) -> int | None:
    number = _as_float(given)
    return int(number) if number is not None and number.is_integer() else None


def _as_bool(given: object) -> bool | None:
    return {"true": True, "1": True, "false": False, "0": False}.get(str(given).strip().lower())


def _as_text(given: object) -> str | None:
    return given if isinstance(given, str) and len(given) <= _LONGEST and given.isprintable() else None


_READ: Mapping[OptionType, Callable[[object], OptionValue | None]] = {
    "int": _as_int, "float": _as_float, "bool": _as_bool, "string": _as_text, "enum": _as_text,
}  # fmt: skip


def value_of(options: Options, name: str) -> OptionValue:
    """Return the value of an option, its default where it is not given."""
    return options.get(name, _BY_NAME[name].default)


def is_on(options: Options, name: str) -> bool:
    """Return whether an option of type bool is switched on."""
    return bool(value_of(options, name))


def project_lines(options: Options) -> dict[tuple[str | int, ...], Value | None]:
    """Return what the options write into the project file, those that are not given too."""
    return {key: value for o in OPTIONS for key, value in o.sets(value_of(options, o.name)).items()}


@dataclass(frozen=True)
class InitArguments:
    """What the options say of a project that its photographs do not: None where nothing is said."""

    crs: str | None
    heights: Literal["ellipsoidal", "orthometric"] | None
    geoid: str | None
    focal_px: float | None


def init_arguments(options: Options) -> InitArguments:
    """Return what the options say to `photogram init`."""
    heights = value_of(options, "heights")
    return InitArguments(
        str(value_of(options, "crs")) or None,
        "ellipsoidal" if heights == "ellipsoidal" else "orthometric" if heights == "orthometric" else None,
        str(value_of(options, "geoid")) or None,
        float(value_of(options, "focal-px")) or None,
    )
