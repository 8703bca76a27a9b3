"""A surveyed point and a mark, the same in every file, on the page and in a project.

Pixels are u right, v down; those of photogram count the centre of the top-left pixel as (0, 0), in the photograph's own
size.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, get_args

from photogram.errors import ControlPointError
from photogram.files.text_lines import LONGEST_NAME, MARK_KIND, SIGMA_M, SIGMA_PX
from photogram.survey import Roles
from photogram.wording import printable, shortened

Position = tuple[float, float, float]
PartialSigma3 = tuple[float | None, float | None, float | None]
"""Standard deviations of three coordinates, None where a file does not state them."""
UNSTATED: PartialSigma3 = (None, None, None)
PointRole = Literal["control", "check", "tie"]
ROLES: tuple[PointRole, ...] = get_args(PointRole)
MarkKey = tuple[str, str]
"""A point and a photograph, by their names."""

IMPORTED, RAW, REMOVED = "imported", "raw", "removed"
"""Kinds of a mark whose file does not say how it was measured, of a click as it is, and of a mark that the project had
and somebody removed."""

FORMER_KINDS = {"quartered": "checker"}
"""Kinds as earlier versions wrote them, and what they are called now."""

_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?Z")
_LOW, _HIGH = -1e9, 1e9


@lru_cache(maxsize=65536)
def _is_name(name: str) -> bool:
    return bool(name) and name == name.strip() and name.isprintable() and len(name) <= LONGEST_NAME


def check_name(what: str, name: str) -> None:
    """Raise ControlPointError where a name cannot be written in every file."""
    if not _is_name(name):
        raise ControlPointError(
            f"{what} {shortened(printable(name))!r}: must be 1 to {LONGEST_NAME} printable characters without blanks "
            "around them: choose another name"
        )


@lru_cache(maxsize=1024)
def _is_kind(kind: str) -> bool:
    return MARK_KIND.fullmatch(kind) is not None


def check_key(point: str, photograph: str) -> None:
    """Raise ControlPointError where the name of a point or photograph cannot be written in every file."""
    check_name("point", point)
    check_name("photograph", photograph)


def check_numbers(what: str, values: Iterable[float], low: float, high: float) -> None:
    """Raise ControlPointError where a value is not from ``low`` to ``high``."""
    for value in values:
        if not low <= value <= high:  # nor is NaN
            raise ControlPointError(f"{what} must be from {low:g} to {high:g}, found {value!r}: correct it")


@dataclass(frozen=True, slots=True)
class SurveyedPoint:
    """A point that somebody has surveyed, or that is only named so far."""

    name: str
    """Name."""
    position: Position | None = None
    """Easting or longitude, northing or latitude, and height, in ``crs``; None for a point without coordinates."""
    sigma_m: PartialSigma3 = UNSTATED
    """Standard deviations along easting, northing and height, None where nothing says them."""
    role: Roles | None = None
    """Role in plan and in height, None where nothing says it."""
    crs: str | None = None
    """CRS of the position, None for that of the file or of the project."""
    line: int = 0
    """Line of its file, 0 for none."""

    def check(self) -> None:
        """Raise ControlPointError where a field is out of its range."""
        check_name("point", self.name)
        if self.position is not None:
            check_numbers(f"position of {self.name}", self.position, -1e12, 1e12)
        if self.crs is not None and not self.crs.isprintable():
            raise ControlPointError(f"CRS of {self.name} {shortened(printable(self.crs))!r}: must be printable")
        stated = [value for value in self.sigma_m if value is not None]
        check_numbers(f"standard deviations of {self.name} (m)", stated, *SIGMA_M)


@dataclass(frozen=True, slots=True)
class MarkSource:
    """Where a mark was read, and what its format says of it."""

    line: int
    """Line of the file."""
    is_of_photogram: bool = False
    """Whether the pixel counts as photogram's whatever the project says, because the format defines it."""
    is_of_page: bool = False
    """Whether it stands in the table that `photogram mark` writes, in the photograph's own size."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A point measured in a photograph. Raises ControlPointError where a field is out of its range."""

    point: str
    """Name of the point."""
    photograph: str
    """Name of the photograph, as the project has it."""
    pixel: tuple[float, float]
    """u, v of the point."""
    sigma_px: tuple[float, float] | None = None
    """Standard deviations of u and v, None where nothing says them."""
    rho: float = 0.0
    """Correlation of u and v."""
    kind: str = RAW
    """How it was measured, a word: raw for a click as it is, else checker, circle, matched, coded, imported …"""
    time: str = ""
    """When, UTC as 2026-05-01T10:20:30Z; empty where it is not known."""
    raw_pixel: tuple[float, float] | None = None
    """u, v of the click that the measurement began with, None where there was none."""
    is_doubtful: bool = False
    """Whether somebody should look at it again."""
    source: MarkSource = field(default=MarkSource(0), compare=False)
    """Where it was read."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", FORMER_KINDS.get(self.kind, self.kind))
        check_key(self.point, self.photograph)
        try:
            self._check()
        except ControlPointError as error:
            raise ControlPointError(f"mark of {self.point} in {self.photograph}: {error}") from None

    def _check(self) -> None:
        if not (_LOW < self.pixel[0] < _HIGH and _LOW < self.pixel[1] < _HIGH):
            raise ControlPointError(f"u and v must be from {_LOW:g} to {_HIGH:g}, found {self.pixel!r}: correct them")
        if self.raw_pixel is not None and not all(_LOW < value < _HIGH for value in self.raw_pixel):
            text = f"raw_u and raw_v must be from {_LOW:g} to {_HIGH:g}, found {self.raw_pixel!r}"
            raise ControlPointError(f"{text}: correct them")
        if self.sigma_px is not None:
            check_numbers("standard deviations (px)", self.sigma_px, *SIGMA_PX)
        if not -1.0 < self.rho < 1.0:
            raise ControlPointError(f"rho must lie between -1 and 1, found {self.rho!r}: correct it")
        if not _is_kind(self.kind):
            raise ControlPointError(f"kind must be a word in lower case, found {shortened(self.kind)!r}: correct it")
        if self.time and not _TIME.fullmatch(self.time):
            raise ControlPointError(
                f"time must be UTC as 2026-05-01T10:20:30Z, found {shortened(self.time)!r}: correct it"
            )

    @property
    def key(self) -> MarkKey:
        """The point and the photograph."""
        return self.point, self.photograph


@dataclass(frozen=True, slots=True)
class Proposal:
    """A mark that somebody has to confirm."""

    mark: Mark
    """Where the point is expected, or was found by itself."""
    score: float
    """How well it was found: larger is better, 0 for a mere prediction."""

    def __post_init__(self) -> None:
        check_numbers(f"proposal of {self.mark.point} in {self.mark.photograph}: score", (self.score,), -1e9, 1e9)
