"""Ground points and marks from a file of any known format, told by what is in it.

A project names such files in ``control_points.files``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from photogram.errors import ControlPointError
from photogram.files.marks.metashape import holds_metashape_markers, read_markers
from photogram.files.marks.pix4d import holds_pix4d_marks, read_pix4d_marks
from photogram.files.tables import control_files
from photogram.files.tables.control_files import FileMark, PointFile
from photogram.files.text_lines import lines_of, text_of


def _is_xml(path: Path) -> bool:
    return holds_metashape_markers(text_of(path, ControlPointError)[:200])


def _is_pix4d(path: Path) -> bool:
    return holds_pix4d_marks(lines_of(path, ControlPointError, "points", "#"))


def read_points(path: Path) -> PointFile:
    """Return the ground points of a gcp_list.txt, a table, or Metashape's markers; marks too where the file holds them.

    Marks of Metashape's markers without coordinates are left out, ``without_position`` names these markers. Raises
    ControlPointError with a line for each fault.
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
    return control_files.read_points(path)


def read_marks(path: Path) -> tuple[FileMark, ...]:
    """Return the marks of a table, of PIX4D's marks, or the pinned ones of Metashape's markers.

    Raises ControlPointError with a line for each fault.
    """
    if _is_xml(path):
        return read_markers(path).points.marks
    if _is_pix4d(path):
        return read_pix4d_marks(path)
    return control_files.read_marks(path)
