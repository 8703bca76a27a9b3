"""The files of ground points that a project names, each with what it holds and where its points lie in the map."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from photogram.errors import ControlPointError
from photogram.files.marks.formats import read_marks, read_points
from photogram.files.marks.mark_table import MARKS, has_rows
from photogram.files.tables.point_file import PointFile
from photogram.files.tables.surveyed_points import Mark
from photogram.project.control.mark_entries import of_page
from photogram.project.control.places import crs_of, in_map
from photogram.project.document import Document, Key
from photogram.project.heights import Placed, ProjectMap, is_grid
from photogram.project.schema import ControlFileEntry, ProjectFile
from photogram.wording import some, things

ReadT = TypeVar("ReadT")


@dataclass(frozen=True, eq=False)
class Source:
    """One entry of control_points.files and what its files hold, ``marks`` those of the file and of the page;
    ``placed`` are its positions, None where unknown, ``columns`` what the first two figures of a point are, ``crs``
    theirs, empty where unknown."""

    key: Key
    entry: ControlFileEntry
    points: PointFile
    marks: tuple[Mark, ...]
    placed: Placed | None
    columns: tuple[str, str]
    crs: str

    def path_of(self, mark: Mark) -> str:
        """Return the file that a mark stands in."""
        own = self.points.holds_marks and not mark.source.is_of_page
        return str(self.entry.path) if own else str(self.entry.marks)

    def note(self, document: Document, path: str, line: int, text: str) -> None:
        """Note what is wrong with a line of one of the files."""
        document.add_error(self.key, f"{path}:{line}: {text}")


def _read(document: Document, key: Key, written: str, reader: Callable[[Path], ReadT]) -> ReadT | None:
    """Return what ``reader`` reads, None where it cannot; its errors name the file as the project does."""
    path = document.base / written
    try:
        return reader(path)
    except ControlPointError as error:
        document.add_errors_of(key, error, path, written)
        return None


def read_source(
    document: Document, file: ProjectFile, key: Key, entry: ControlFileEntry, target: ProjectMap | None
) -> Source | None:
    """Return what an entry of control_points.files names, None where it cannot be read; what is wrong is noted."""
    columns = entry.columns
    read = _read(document, key, str(entry.path), lambda path: read_points(path, columns))
    if read is None:
        return None
    marks = read.marks if entry.marks is None else _marks(document, key, entry, read)
    if read.without_position:
        bare = f"{things(len(read.without_position), 'point')} ({some(read.without_position)})"
        text = f"{entry.path}: marks of {bare} without coordinates are left out"
        document.warn(key, text, "give coordinates, where they are to be control or check points")
    crs = crs_of(document, file, key, entry, read)
    points, placed = (read, None) if crs is None else in_map(document, key, entry, read, crs, target)
    called = ("easting", "northing") if crs is None or is_grid(crs) else ("longitude", "latitude")
    return Source(key, entry, points, marks, placed, called, crs or "")


def _marks(document: Document, key: Key, entry: ControlFileEntry, points: PointFile) -> tuple[Mark, ...]:
    """Return the marks of a file of points and of the table that its entry names, which need not be there before
    somebody has marked points on the page."""
    written = str(entry.marks)
    path = document.base / written
    rows = _read(document, key, written, has_rows) if path.name == MARKS else True
    if rows is None:
        return ()
    if not rows:
        return points.marks
    table = _read(document, key, written, read_marks) or ()
    made = of_page(path, table)
    if made is None and points.holds_marks:
        text = f"{entry.path} contains its own marks: name the {MARKS} that photogram mark writes, or remove this key"
        document.add_error((*key, "marks"), text)
    return (*points.marks, *(table if made is None else made))
