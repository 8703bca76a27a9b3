"""Marks, and what is known of the points they show, as tables of marks and the page of marking have them.

Pixels are photogram's: u right, v down, the centre of the top-left pixel is (0, 0), of the photograph's own size.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

from photogram.errors import ControlPointError
from photogram.files.text_lines import LONGEST_NAME, MARK_KIND, SIGMA_M, SIGMA_PX
from photogram.wording import printable, shortened

PointRole = Literal["control", "check", "tie"]
ROLES: tuple[PointRole, ...] = get_args(PointRole)
Place = tuple[str, str]
"""A point and a photograph, by their names."""

_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?Z")
_LOW, _HIGH = -1e9, 1e9


@lru_cache(maxsize=65536)
def _is_name(name: str) -> bool:
    return bool(name) and name == name.strip() and name.isprintable() and len(name) <= LONGEST_NAME


def check_name(what: str, name: str) -> None:
    """Raise ControlPointError where a name is empty, too long or not printable."""
    if not _is_name(name):
        raise ControlPointError(
            f"{what} {shortened(printable(name))!r}: must be 1 to {LONGEST_NAME} printable characters without blanks "
            "around them: choose another name"
        )


@lru_cache(maxsize=1024)
def _is_kind(kind: str) -> bool:
    return MARK_KIND.fullmatch(kind) is not None


def check_place(point: str, photograph: str) -> None:
    """Raise ControlPointError where the name of the point or of the photograph is none."""
    check_name("point", point)
    check_name("photograph", photograph)


def _check_numbers(what: str, values: Iterable[float], low: float, high: float) -> None:
    for value in values:
        if not low <= value <= high:  # nor is NaN
            raise ControlPointError(f"{what} must be from {low:g} to {high:g}, found {value!r}: correct it")


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
    kind: str = "raw"
    """How it was measured, a word: raw for a click as it is, else quartered, circle, matched, coded, imported …"""
    time: str = ""
    """When, UTC as 2026-05-01T10:20:30Z; empty where it is not known."""
    raw_pixel: tuple[float, float] | None = None
    """u, v of the click that the measurement began with, None where there was none."""
    is_doubtful: bool = False
    """Whether somebody should look at it again."""

    def __post_init__(self) -> None:
        check_place(self.point, self.photograph)
        try:
            if not (_LOW < self.pixel[0] < _HIGH and _LOW < self.pixel[1] < _HIGH):
                raise ControlPointError(
                    f"u and v must be from {_LOW:g} to {_HIGH:g}, found {self.pixel!r}: correct them"
                )
            if self.raw_pixel is not None and not all(_LOW < value < _HIGH for value in self.raw_pixel):
                found = self.raw_pixel
                raise ControlPointError(
                    f"raw_u and raw_v must be from {_LOW:g} to {_HIGH:g}, found {found!r}: correct them"
                )
            if self.sigma_px is not None:
                _check_numbers("standard deviations (px)", self.sigma_px, *SIGMA_PX)
            if not -1.0 < self.rho < 1.0:
                raise ControlPointError(f"rho must lie between -1 and 1, found {self.rho!r}: correct it")
            if not _is_kind(self.kind):
                raise ControlPointError(
                    f"kind must be a word in lower case, found {shortened(self.kind)!r}: correct it"
                )
            if self.time and not _TIME.fullmatch(self.time):
                raise ControlPointError(
                    f"time must be UTC as 2026-05-01T10:20:30Z, found {shortened(self.time)!r}: correct it"
                )
        except ControlPointError as fault:
            raise ControlPointError(f"mark of {self.point} in {self.photograph}: {fault}") from None

    @property
    def place(self) -> Place:
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
        _check_numbers(f"proposal of {self.mark.point} in {self.mark.photograph}: score", (self.score,), -1e9, 1e9)


@dataclass(frozen=True, slots=True)
class NewPoint:
    """A point that was added while marking."""

    name: str
    """Name."""
    position: tuple[float, float, float] | None = None
    """Easting or longitude, northing or latitude, and height, in ``crs``; None for a point without coordinates."""
    sigma_m: tuple[float, float, float] | None = None
    """Standard deviations along easting, northing and height."""
    crs: str | None = None
    """CRS of the position, None for the project's."""

    def __post_init__(self) -> None:
        check_name("point", self.name)
        if self.position is not None:
            _check_numbers(f"position of {self.name}", self.position, -1e12, 1e12)
        if self.crs is not None and not self.crs.isprintable():
            raise ControlPointError(f"CRS of {self.name} {shortened(printable(self.crs))!r}: must be printable")
        if self.sigma_m is not None:
            _check_numbers(f"standard deviations of {self.name} (m)", self.sigma_m, *SIGMA_M)
