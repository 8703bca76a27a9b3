"""Tables of points that are known twice, by GNSS or in a map and in a local grid."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ControlPointError
from photogram.files.tables.table import Row, read_table
from photogram.files.text_lines import SIGMA_M, Errors, lines_of
from photogram.wording import shortened

Use = Literal["both", "plan", "height", "check"]
"""What a pair serves for: easting and northing, the height, both, or neither."""

USES: tuple[Use, ...] = get_args(Use)
MOST_PAIRS = 2000
LARGEST = 1e9

COLUMNS: Mapping[str, tuple[str, ...]] = {
    "name": ("name", "point", "id", "label"),
    "longitude": ("longitude", "lon"),
    "latitude": ("latitude", "lat"),
    "easting": ("easting", "east", "x"),
    "northing": ("northing", "north", "y"),
    "height": ("height", "ellipsoidal_height", "h", "z"),
    "local_easting": ("local_easting", "local_east", "local_e", "local_x"),
    "local_northing": ("local_northing", "local_north", "local_n", "local_y"),
    "local_height": ("local_height", "local_h", "local_z", "local_elevation"),
    "sigma_plan": ("sigma_plan", "sigma_xy"),
    "sigma_height": ("sigma_height", "sigma_h", "sigma_z"),
    "use": ("use",),
}
_FORM = "name,longitude,latitude,height,local_easting,local_northing,local_height"


@dataclass(frozen=True, eq=False)
class PairFile:
    """The pairs (N) of a table as it gives them, NaN where it gives nothing."""

    path: Path
    name: tuple[str, ...]
    """Names (N,)."""
    position: FloatArray
    """Longitude and latitude in degrees, or easting and northing, and ellipsoidal height (N, 3)."""
    geographic: bool
    """Whether ``position`` is longitude and latitude."""
    local: FloatArray
    """Easting, northing and height in the local grid, in its unit (N, 3)."""
    sigma_m: FloatArray
    """Standard deviations in plan and in height, m (N, 2)."""
    use: tuple[Use, ...]
    """What each serves for."""

    def __len__(self) -> int:
        return len(self.name)


def read_pairs(path: Path) -> PairFile:
    """Return the pairs of a table (CSV) whose first line names its columns, as COLUMNS has them.

    A height, or easting and northing in the local grid, may be empty. Raises ControlPointError with a line for each
    error.
    """
    lines = lines_of(path, ControlPointError, "pairs of geodetic and local coordinates", "#")
    needed = ("name", "local_easting", "local_northing")
    table = read_table(path, lines, ControlPointError, COLUMNS, needed, form=_FORM)
    rows, errors, head = list(table.rows), table.errors, table.line
    for name in table.unknown:
        errors.note(head, f"unknown column {shortened(name)!r}: rename or remove it")
    geographic = table.has("longitude", "latitude")
    if rows and geographic == table.has("easting", "northing"):
        both = "both longitude, latitude and easting, northing" if geographic else "no longitude and latitude"
        errors.note(head, f"{both}: name one pair of columns: longitude and latitude, or easting and northing of a map")
        errors.raise_all()
    if len(rows) > MOST_PAIRS:
        errors.note(head, f"{len(rows)} pairs, up to {MOST_PAIRS} are calibrated: thin them out")
        errors.raise_all()
    plan = ("longitude", "latitude") if geographic else ("easting", "northing")
    position = _numbers(rows, (*plan, "height"), errors, needed=2)
    local = _numbers(rows, ("local_easting", "local_northing", "local_height"), errors, needed=0)
    sigma = np.array(
        [[_sigma(row, column, line, errors) for column in ("sigma_plan", "sigma_height")] for line, row in rows]
    ).reshape(-1, 2)
    _check_globe(rows, position, geographic, errors)
    uses = [_use(row, line, errors) for line, row in rows]
    names = _names(rows, errors)
    errors.raise_all()
    return PairFile(path, tuple(names), position, geographic, local, sigma, tuple(uses))


def _names(rows: list[tuple[int, Row]], errors: Errors) -> list[str]:
    first: dict[str, int] = {}
    for line, row in rows:
        if not row["name"]:
            errors.note(line, "the pair has no name: give one")
        elif first.setdefault(row["name"], line) != line:
            errors.note(line, f"{row['name']!r} is there twice, first in line {first[row['name']]}: name it otherwise")
        errors.name(row["name"], "name", line)
    return [row["name"] for _, row in rows]


def _numbers(rows: list[tuple[int, Row]], columns: tuple[str, ...], errors: Errors, needed: int) -> FloatArray:
    """Return the numbers (N, C) of columns, NaN where a field is empty; the first ``needed`` may not be."""
    values = np.full((len(rows), len(columns)), np.nan)
    for i, (line, row) in enumerate(rows):
        for k, column in enumerate(columns):
            text = row.get(column, "")
            if not text:
                if k < needed:
                    errors.note(line, f"{column} is empty: give the coordinate")
                continue
            value = errors.number(text, column, line)
            if value is not None and abs(value) > LARGEST:
                errors.note(line, f"{column} must be within ±{LARGEST:g}, found {shortened(text)}")
            values[i, k] = np.nan if value is None else value
    return values


def _sigma(row: Row, column: str, line: int, errors: Errors) -> float:
    text = row.get(column, "")
    if not text:
        return float("nan")
    value = errors.number(text, column, line)
    low, high = SIGMA_M
    if value is not None and not low <= value <= high:
        errors.note(line, f"{column} must be from {low:g} to {high:g} m, found {shortened(text)}")
    return float("nan") if value is None else value


def _check_globe(rows: list[tuple[int, Row]], position: FloatArray, geographic: bool, errors: Errors) -> None:
    for (line, _), (longitude, latitude, _) in zip(rows, position.tolist(), strict=True):
        if geographic and not (abs(longitude) <= 180.0 and abs(latitude) < 90.0) and np.isfinite([longitude]).all():
            errors.note(
                line,
                f"longitude {longitude:.10g}, latitude {latitude:.10g} is no place on the globe: give decimal degrees, "
                "longitude and latitude in their columns",
            )


def _use(row: Row, line: int, errors: Errors) -> Use:
    text = row.get("use", "").lower() or "both"
    for use in USES:
        if text == use:
            return use
    errors.note(line, f"use must be one of {', '.join(USES)}, found {shortened(text)!r}")
    return "check"
