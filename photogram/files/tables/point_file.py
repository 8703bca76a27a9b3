"""What a file of ground points holds, whatever its form, and marks as they are read from one."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from photogram.errors import ControlPointError
from photogram.files.tables.column_names import POINTS, quantity_of
from photogram.files.tables.column_units import NO_UNITS, UnitsM
from photogram.files.tables.surveyed_points import IMPORTED, Mark, MarkSource, SurveyedPoint
from photogram.files.text_lines import Errors, Note
from photogram.gnss import Solution
from photogram.wording import some


@dataclass(frozen=True)
class PointFile:
    """The points of one file, and the marks where it holds them too.

    ``crs`` is what the file itself says; ``geographic`` whether its columns are called longitude and latitude (True),
    easting and northing (False), or neither (None); ``holds_marks`` is true of gcp_list.txt and of Metashape's markers.
    ``unit_m`` are the units of the three coordinates that its columns state, m; None counts as the CRS does.
    ``without_position`` names points whose marks are left out because the file has no coordinates of them. ``geodetic``
    are longitude and latitude of the same points where the file has these beside easting and northing, None otherwise;
    ``cs_name`` is what it calls the system of the latter. ``heights_ellipsoidal`` is what it says of its heights, None
    where it says nothing. ``is_order_open`` where nothing says which of the first two coordinates is the easting,
    ``is_named`` where a line or the project names its ``columns``. ``unfixed`` are points whose GNSS solution has no
    fixed ambiguities. ``notes`` are what is to be said of how it was read.
    """

    path: Path
    crs: str | None
    geographic: bool | None
    holds_marks: bool
    points: tuple[SurveyedPoint, ...]
    marks: tuple[Mark, ...]
    format: Literal["gcp_list", "table", "metashape"] = "table"
    without_position: tuple[str, ...] = ()
    unit_m: UnitsM = NO_UNITS
    geodetic: tuple[tuple[float, float], ...] | None = None
    cs_name: str = ""
    heights_ellipsoidal: bool | None = None
    is_order_open: bool = False
    is_named: bool = True
    columns: tuple[str, ...] = ()
    unfixed: tuple[tuple[str, Solution], ...] = ()
    notes: tuple[Note, ...] = ()

    @property
    def turned_columns(self) -> tuple[str, ...]:
        """Return the names of the columns with northing before easting, of a file whose order is open; none else."""
        turned = {"x": "northing", "y": "easting"}
        names = self.columns if self.is_order_open else ()
        return tuple(turned.get(str(quantity_of(name, POINTS)), name) for name in names)


def mark_of(
    place: tuple[str, str],
    pixel: tuple[float, float],
    source: MarkSource,
    errors: Errors,
    sigma_px: tuple[float, float] | None = None,
    rho: float = 0.0,
    kind: str = IMPORTED,
) -> Mark | None:
    """Return the mark of a point in a photograph, None with an error noted where it is none."""
    try:
        return Mark(*place, pixel, sigma_px, rho, kind, source=source)
    except ControlPointError as error:
        errors.note(source.line, str(error))
        return None


def check_marks(marks: Iterable[Mark], errors: Errors) -> None:
    """Note what is marked twice in a photograph, in one sentence."""
    first: dict[tuple[str, str], int] = {}
    twice: list[tuple[Mark, int]] = []
    for mark in marks:
        line = mark.source.line
        if (before := first.setdefault(mark.key, line)) != line:
            twice.append((mark, before))
    if not twice:
        return
    mark, before = twice[0]
    text = f"point {mark.point} is marked twice in {mark.photograph}, first in line {before}"
    others = some([f"{m.point} in {m.photograph} ({n} and {m.source.line})" for m, n in twice[1:]])
    text += f", and so are {others}" if others else ""
    remedy = "write their folders if two photographs are called so, else remove one of the marks"
    errors.note(mark.source.line, f"{text}: {remedy}")
