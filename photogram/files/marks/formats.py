"""Ground points and marks from a file of any known format, told by what is in it, and written in each.

A project names such files in ``control_points.files``.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from photogram.errors import ControlPointError
from photogram.files.marks.gcp_list import write_gcp_list
from photogram.files.marks.mark_table import write_marks
from photogram.files.marks.metashape import holds_metashape_markers, read_markers, write_markers
from photogram.files.marks.pix4d import holds_pix4d_marks, read_pix4d_marks, write_pix4d_marks
from photogram.files.tables import control_files
from photogram.files.tables.point_file import PointFile
from photogram.files.tables.point_tables import write_point_table
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint
from photogram.files.text_lines import lines_of_table, table_text_of

MarkFormat = Literal["gcp_list", "metashape", "pix4d", "csv"]
"""What points and marks are written as: OpenDroneMap's gcp_list.txt, Metashape's markers, PIX4D's marks, or the table
of marks; the last two with a table of the points beside them."""

MARK_FORMATS: tuple[MarkFormat, ...] = get_args(MarkFormat)


def _is_xml(path: Path) -> bool:
    return holds_metashape_markers(table_text_of(path, ControlPointError)[:200])


def _is_pix4d(path: Path) -> bool:
    lines, _ = lines_of_table(path, ControlPointError, "points")
    return holds_pix4d_marks([(n, text) for n, text in lines if not text.lstrip().startswith("#")])


def read_points(path: Path, columns: Sequence[str] | None = None) -> PointFile:
    """Return the ground points of a gcp_list.txt, a table, or Metashape's markers; marks too where the file holds them.
    ``columns`` name the columns of a table that does not.

    Marks of Metashape's markers without coordinates are left out, ``without_position`` names these markers. Raises
    ControlPointError with a line for each error.
    """
    if _is_xml(path):
        markers = read_markers(path)
        bare = set(markers.without_position)
        marks = tuple(mark for mark in markers.points.marks if mark.point not in bare)
        return replace(markers.points, marks=marks, without_position=markers.without_position)
    if _is_pix4d(path):
        raise ControlPointError(
            f"{path}:1: holds PIX4D's marks without coordinates of their points: name it under marks, "
            "and the file with the points under path"
        )
    return control_files.read_points(path, columns)


def read_marks(path: Path) -> tuple[Mark, ...]:
    """Return the marks of a table, of PIX4D's marks, or the pinned ones of Metashape's markers.

    Raises ControlPointError with a line for each error.
    """
    if _is_xml(path):
        return read_markers(path).points.marks
    if _is_pix4d(path):
        return read_pix4d_marks(path)
    return control_files.read_marks(path)


# ---- writing -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MapCrs:
    """The CRS of points that are written: its name in plan, and it as WKT of the first edition, None where the points
    lie in a local frame."""

    name: str
    wkt: str | None


def format_of(path: Path) -> MarkFormat:
    """Return the format that a file's name tells. Raises ControlPointError where it tells none."""
    name = path.name.lower()
    if path.suffix.lower() == ".txt" and "gcp_list" in name:
        return "gcp_list"
    by_suffix: dict[str, MarkFormat] = {".xml": "metashape", ".csv": "csv"}
    if path.suffix.lower() in by_suffix:
        return by_suffix[path.suffix.lower()]
    raise ControlPointError(
        f"{path}: its name does not tell the format: give --format {', '.join(MARK_FORMATS[:-1])} or {MARK_FORMATS[-1]}"
    )


def written_files(path: Path, form: MarkFormat) -> tuple[Path, ...]:
    """Return the files that a format makes: ``path``, and the table of points where it has one."""
    if form in ("pix4d", "csv"):
        return path, path.with_name(f"{path.stem}_points.csv")
    return (path,)


def write_points_and_marks(
    path: Path, form: MarkFormat, points: Sequence[SurveyedPoint], marks: Iterable[Mark], crs: MapCrs
) -> tuple[Path, ...]:
    """Write points and marks in a format, and return the files that hold them, ``written_files`` but for a table of no
    points. Marks may be of points that are not in ``points``, but not in a gcp_list.txt.

    Raises ControlPointError where the format cannot hold them, WorkspaceError where a file cannot be written.
    """
    if form == "gcp_list":
        write_gcp_list(path, crs.name, points, marks)
    elif form == "metashape":
        write_markers(path, points, marks, crs.wkt)
    elif form == "pix4d":
        write_pix4d_marks(path, marks)
    else:
        write_marks(path, marks)
    files = written_files(path, form)
    if len(files) > 1 and points:
        write_point_table(files[1], points)
        return files
    return (path,)
