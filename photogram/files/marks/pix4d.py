"""Marks of PIX4Dmapper and PIX4Dmatic as text: ``photograph,point,x,y`` and perhaps a fifth figure, without a header.

PIX4D counts from the upper left of the picture (PIX4D documentation, "How to import and export Tie Points marks"), that
is from the corner of the pixel: its own converter of open projects copies pixels into COLMAP's files as they are
(Pix4D/pyopf, opf2colmap), where the centre of the top-left pixel is (0.5, 0.5). Half a pixel is taken off.

The fifth figure is the zoom level in PIX4Dmapper and the accuracy in pixels in PIX4Dmatic; since no file says which, it
is not read as a standard deviation.
"""

import csv
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from photogram.errors import ControlPointError
from photogram.files.atomic import replacing
from photogram.files.marks.corner_pixels import from_corner, to_corner
from photogram.files.tables.point_file import check_marks, mark_of
from photogram.files.tables.surveyed_points import Mark, MarkSource
from photogram.files.text_lines import NUMBER, Errors, lines_of_table
from photogram.wording import shortened, some

_PICTURE = re.compile(r".+\.(?:jpe?g|tiff?|png|dng|webp|heic)", re.IGNORECASE)
_SEPARATORS = (";", "\t", ",", " ")


def _fields(line: str) -> list[str]:
    separator = next((s for s in _SEPARATORS if s in line.strip()), ",")
    try:
        fields = next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True))
    except (csv.Error, StopIteration):
        return []
    return [field.strip() for field in fields]


def _is_picture(text: str) -> bool:
    return _PICTURE.fullmatch(text) is not None


def holds_pix4d_marks(lines: Sequence[tuple[int, str]]) -> bool:
    """Return whether the first line is a mark: two names, one of them that of a picture, and two to three numbers."""
    fields = _fields(lines[0][1]) if lines else []
    return (
        len(fields) in (4, 5)
        and any(map(_is_picture, fields[:2]))
        and all(NUMBER.fullmatch(field) for field in fields[2:])
    )


def read_pix4d_marks(path: Path) -> tuple[Mark, ...]:
    """Return the marks, in photogram's pixels; photographs are named as in the file, with folders where it has them.

    Which of the two names is the photograph's is told by the suffix of a picture, for all lines alike. Raises
    ControlPointError with a line for each error.
    """
    errors = Errors(path, ControlPointError)
    lines, _ = lines_of_table(path, ControlPointError, "marks")
    rows = [(line, _fields(content)) for line, content in lines if not content.lstrip().startswith("#")]
    picture = _column(rows)
    read = []
    for line, fields in rows:
        if len(fields) not in (4, 5):
            errors.note(line, f"{len(fields)} fields, expected photograph, point, x, y and perhaps one more")
            continue
        photograph, point = fields[picture].replace("\\", "/"), fields[1 - picture]
        if not _is_picture(photograph) or not point:
            text = shortened(fields[picture])
            errors.note(line, f"no photograph and point in the first two fields, found {text!r}: give both names")
            continue
        if errors.name(photograph, "the photograph", line) is None or errors.name(point, "the point", line) is None:
            continue
        numbers = [errors.number(text, what, line) for text, what in zip(fields[2:4], "xy", strict=True)]
        if None not in numbers:
            pixel = (from_corner(fields[2]), from_corner(fields[3]))
            source = MarkSource(line, is_of_photogram=True)
            read.append(mark_of((point, photograph), pixel, source, errors))
    marks = tuple(mark for mark in read if mark is not None)
    check_marks(marks, errors)
    errors.raise_all()
    return marks


def _column(rows: Sequence[tuple[int, list[str]]]) -> int:
    """Return 0 or 1, where most names of pictures are; 0, as PIX4D writes them, where both look alike."""
    first, second = (sum(len(fields) > i and _is_picture(fields[i]) for _, fields in rows) for i in (0, 1))
    return 0 if first >= second else 1


def write_pix4d_marks(path: Path, marks: Iterable[Mark]) -> None:
    """Write marks, sorted by point and photograph. Standard deviations, correlations, roles and coordinates of points
    have no place in it. Raises ControlPointError where the file cannot hold a name, and WorkspaceError where it cannot
    be written."""
    ordered = sorted(marks, key=lambda mark: mark.key)
    unfit = sorted({name for m in ordered for name in m.key if set(name) & set(',;"\t') or name[0] == "#"})
    if unfit:
        raise ControlPointError(f"{path}: PIX4D's marks cannot hold the names {some(unfit)}: rename them")
    strange = sorted({m.photograph for m in ordered if not _is_picture(m.photograph)})
    if strange:
        raise ControlPointError(
            f"{path}: {some(strange)} have no suffix of a picture, by which PIX4D finds them: add it"
        )
    rows = ((mark.photograph, mark.point, *map(to_corner, mark.pixel)) for mark in ordered)
    with replacing(path) as partial:
        partial.write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
