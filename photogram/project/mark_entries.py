"""Which files of ground points a project file names, and where it takes their marks from."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from photogram.files.marks.formats import read_points
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


def mark_entries(project: Path) -> tuple[tuple[MarkEntry, ...], bool]:
    """Return the entries of a project file that has been read, and whether it lists points itself. Raises ProjectError
    where the file cannot be read, ControlPointError where one of points cannot."""
    document = Document(project)
    files, listed = document.at(("control_points", "files")), document.at(("control_points", "list"))
    entries = []
    for value in files if isinstance(files, list) else ():
        if isinstance(value, dict) and isinstance(value.get("path"), str):
            marks, path = value.get("marks"), str(value["path"])
            points = read_points(document.base / path)
            entries.append(MarkEntry(path, marks if isinstance(marks, str) else None, points.holds_marks))
    return tuple(entries), bool(listed)


def lines_to_add(project: Path, marks: Path) -> tuple[str, ...]:
    """Return what a project file still needs in order to take its marks from a table, in lines; none where it names the
    table for all its points. Raises as ``mark_entries``."""
    entries, listed = mark_entries(project)
    name = Path(os.path.relpath(marks.absolute(), project.absolute().parent)).as_posix()
    lines = list[str]()
    open_entries = [e for e in entries if not e.holds_marks and not _is(project, e.marks, marks)]
    if open_entries:
        lines.append(f"Add to {project}, in control_points.files:")
        for entry in open_entries:
            lines += [f"  - path: {entry.path}", f"    marks: {name}"]
    with_marks = [e.path for e in entries if e.holds_marks]
    if with_marks or listed:
        lines.append(_in_place(project, with_marks, listed, name))
    return tuple(lines)


def _is(project: Path, named: str | None, marks: Path) -> bool:
    return named is not None and (project.absolute().parent / named).resolve() == marks.resolve()


def _in_place(project: Path, with_marks: Sequence[str], listed: bool, name: str) -> str:
    places = [*(["control_points.list"] if listed else []), *with_marks]
    return (
        f"{project} takes marks from {', '.join(places)}: give those points in a table of name, easting, northing, "
        f"height instead, with marks: {name} beside it, and the marks made here count"
    )
