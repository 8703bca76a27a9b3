"""Tables of surveyed points, written: what ``control_files.read_points`` reads, with every digit."""

from collections.abc import Iterable
from pathlib import Path

from photogram.files.atomic import replacing
from photogram.files.tables.surveyed_points import SurveyedPoint
from photogram.files.text_lines import quoted

COLUMNS = (
    "name", "easting", "northing", "height", "sigma_easting", "sigma_northing", "sigma_height", "role_plan",
    "role_height",
)  # fmt: skip


_PLAN, _DEGREES = COLUMNS[1:3], ("longitude", "latitude")


def write_point_table(path: Path, points: Iterable[SurveyedPoint], *, geographic: bool = False) -> None:
    """Write points of a map grid, or of longitude and latitude where they are ``geographic``, in their order; what a
    point does not say is empty. The CRS has no place in it.

    Raises WorkspaceError where the file cannot be written.
    """
    plan = _DEGREES if geographic else _PLAN
    rows = [",".join((COLUMNS[0], *plan, *COLUMNS[3:]))]
    for point in points:
        position = point.position or (None, None, None)
        numbers = ("" if value is None else repr(float(value)) for value in (*position, *point.sigma_m))
        rows.append(",".join((quoted(point.name), *numbers, *(point.role or ("", "")))))
    with replacing(path) as partial:
        partial.write_text("\n".join(rows) + "\n", encoding="utf-8")
