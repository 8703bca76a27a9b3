"""Which files of ground points a project file names, and where it takes their marks from.

An entry whose file holds marks of its own, as a gcp_list.txt does, may name the table that `photogram mark` writes.
What was marked or removed on the page then replaces the mark of the file, of the same point in the same photograph;
marks that the page took over and nobody has changed, of kind ``imported``, do not: the file may have been corrected.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from photogram.files.marks.formats import read_points
from photogram.files.marks.mark_table import MARKS
from photogram.files.portable import path_from
from photogram.files.tables.surveyed_points import IMPORTED, REMOVED, Mark
from photogram.project.document import Document


@dataclass(frozen=True)
class MarkEntry:
    """An entry of control_points.files."""

    path: str
    """The file of the points, as the project file has it."""
    marks: str | None
    """The file of their marks, None where it names none."""
    holds_marks: bool
    """Whether the file of the points has marks of its own."""
    names: tuple[str, ...] = ()
    """Of its points."""


def mark_entries(project: Path) -> tuple[tuple[MarkEntry, ...], bool]:
    """Return the entries of a project file that has been read, and whether it lists points itself. Raises ProjectError
    where the file cannot be read, ControlPointError where one of points cannot."""
    document = Document(project)
    files, listed = document.at(("control_points", "files")), document.at(("control_points", "list"))
    entries = []
    for value in files if isinstance(files, list) else ():
        if isinstance(value, dict) and isinstance(value.get("path"), str):
            marks, path = value.get("marks"), str(value["path"])
            columns = value.get("columns")
            points = read_points(document.base / path, columns if isinstance(columns, list) else None)
            names = tuple(point.name for point in points.points)
            entries.append(MarkEntry(path, marks if isinstance(marks, str) else None, points.holds_marks, names))
    return tuple(entries), bool(listed)


def of_page(path: Path, marks: Sequence[Mark]) -> tuple[Mark, ...] | None:
    """Return the marks of a table as those of the page, None where it is another table: one that is called otherwise,
    or that `photogram mark` has not written."""
    if path.name != MARKS or not all(mark.source.is_of_photogram for mark in marks):
        return None
    return tuple(replace(mark, source=replace(mark.source, is_of_page=True)) for mark in marks)


def as_marked(marks: Sequence[Mark]) -> list[Mark]:
    """Return the marks of a file and of the page, one of each point and photograph: that of the page where somebody has
    made or changed it there, none where it was removed."""
    of_file = {mark.key for mark in marks if not mark.source.is_of_page}
    made = [m for m in marks if m.source.is_of_page and not (m.kind == IMPORTED and m.key in of_file)]
    decided = {mark.key for mark in made}
    rest = [mark for mark in marks if not mark.source.is_of_page and mark.key not in decided]
    return [*rest, *(mark for mark in made if mark.kind != REMOVED)]


def lines_to_add(project: Path, marks: Path) -> tuple[str, ...]:
    """Return what a project file still needs in order to take its marks from a table, in lines; none where it names the
    table for all its points. Raises as ``mark_entries``."""
    entries, listed = mark_entries(project)
    name = path_from(project.parent, marks).as_posix()
    lines = list[str]()
    open_entries = [e for e in entries if not _is(project, e.marks, marks)]
    if open_entries:
        lines.append(f"Add to {project}, in control_points.files:")
        for entry in open_entries:
            lines += [f"  - path: {entry.path}", f"    marks: {name}"]
    if listed:
        lines.append(
            f"{project} takes marks from control_points.list: give those points in a table of name, easting, northing, "
            f"height instead, with marks: {name} beside it, and the marks made here count"
        )
    return tuple(lines)


def _is(project: Path, named: str | None, marks: Path) -> bool:
    return named is not None and (project.absolute().parent / named).resolve() == marks.resolve()
