"""audit.html: another program's result and photogram's, side by side, in one file without a script.

Shows tables of words and figures that are finished; counts nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from jinja2 import StrictUndefined

from photogram.report.page import PAGE_FONT, templates


@dataclass(frozen=True)
class FigureRow:
    """A figure of theirs, of photogram with their weights, and of photogram with its own."""

    name: str
    theirs: str
    same: str
    ours: str


@dataclass(frozen=True)
class CalibrationRow:
    """A parameter of interior orientation: theirs, ours with its standard deviation, their difference over that, and
    the parameters it is hardly told from."""

    camera: str
    parameter: str
    theirs: str
    ours: str
    sigma: str
    off_sigmas: str
    correlated: str


@dataclass(frozen=True)
class PoseRow:
    """A photograph's exterior orientation, theirs minus ours: position, m, rotation about the camera's axes, degrees,
    and both over their predicted covariance."""

    photograph: str
    position: str
    rotation: str
    sigmas: str


@dataclass(frozen=True)
class AuditTables:
    """All that an audit shows."""

    program: str
    about: str
    figures: tuple[FigureRow, ...]
    calibrations: tuple[CalibrationRow, ...]
    poses: tuple[PoseRow, ...]
    """The one that differs most first."""
    contradictions: tuple[str, ...]
    """What contradicts the rest, or the result that was made of it."""
    left_out: tuple[str, ...]
    """What the program's figures do not say."""


MOST_POSES = 60
"""Photographs that the page shows; audit.json has all of them."""


def audit_page(found: AuditTables, version: str) -> str:
    """Return the page of an audit, made by photogram ``version``."""
    environment = templates(StrictUndefined)
    environment.globals.update(page_font=PAGE_FONT)
    template = environment.get_template("audit.html.jinja")
    return template.render(found=found, poses=found.poses[:MOST_POSES], version=version)
