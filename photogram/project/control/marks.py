"""Marks of ground points from files: joined to the project's photographs, and brought to these photographs' own pixels.

Errors are noted in the document under the entry that names the file, and carry that file's own line.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray
from photogram.files.photographs.names import joined_names
from photogram.files.tables.surveyed_points import Mark
from photogram.project.control.sources import Source
from photogram.project.cross_checks import camera_of
from photogram.project.document import Document, suggestion
from photogram.project.schema import PIXEL_ORIGIN_PX, PhotographEntry, ProjectFile
from photogram.wording import some, things

SHAPE_TOLERANCE = 0.005
"""How much width and height may differ in scale between the picture of the marks and the photograph."""

_MOST_NAMES = 5
_SMALLEST_ENLARGEMENT, _LARGEST_ENLARGEMENT = 1.2, 20.0


def own_marks(
    document: Document, source: Source, sources: Sequence[Source], listed: set[str], whole: bool
) -> list[Mark]:
    """Return the marks of the source's own points; those of other files' points are left to entries that share them.

    Marks of no point are noted where the points are known as a ``whole``; the page has those of ``listed`` points too,
    and of points that were added there.
    """
    names = {point.name for point in source.points.points}
    shared = {
        point.name
        for other in sources
        if other is not source and other.entry.marks is not None and other.entry.marks == source.entry.marks
        for point in other.points.points
    }
    strange = [mark for mark in source.marks if whole and mark.point not in names | shared]
    added = list(dict.fromkeys(mark.point for mark in strange if mark.source.is_of_page and mark.point not in listed))
    if added and source is next(other for other in sources if other.entry.marks == source.entry.marks):
        text = f"{source.entry.marks}: marks of {things(len(added), 'point')} ({some(added)}) that no table has"
        document.warn(source.key, f"{text} are left out", f"add them to {source.entry.path}, with coordinates")
    strange = [mark for mark in strange if not mark.source.is_of_page]
    for name in list(dict.fromkeys(mark.point for mark in strange))[:_MOST_NAMES]:
        mark = next(mark for mark in strange if mark.point == name)
        text = f"no point {name!r} in {source.entry.path}: {suggestion(name, names)}"
        source.note(document, source.path_of(mark), mark.source.line, text)
    return [mark for mark in source.marks if mark.point in names]


def pixels(
    document: Document,
    file: ProjectFile,
    source: Source,
    marks: Sequence[Mark],
    photographs: Sequence[PhotographEntry],
) -> FloatArray | None:
    """Return the pixels (M, 2) of marks in photogram's frame and the photographs' own size, None where one is wrong."""
    before = document.errors
    by_name = {p.name: p for p in photographs if p.name is not None}
    pixel = np.array([mark.pixel for mark in marks]).reshape(-1, 2)
    of_photogram = np.array([mark.source.is_of_photogram for mark in marks], dtype=bool)
    pixel[~of_photogram] -= PIXEL_ORIGIN_PX[file.control_points.pixel_origin]
    from_page = np.array([mark.source.is_of_page for mark in marks], dtype=bool)
    size_px = np.full(pixel.shape, np.nan)
    cameras = [camera_of(file, by_name[mark.photograph]) for mark in marks]
    for name in dict.fromkeys(cameras):
        camera = file.cameras.get(name or "")
        if camera is None or camera.width_px is None or camera.height_px is None:
            continue
        own = np.flatnonzero([c == name for c in cameras])
        size = (camera.width_px, camera.height_px)
        if source.entry.picture_size_px is not None:
            scale = _scale(document, source, str(name), source.entry.picture_size_px, size)
            if scale is None:
                continue
            # the corner of the top-left pixel, at -0.5, is the same place in both pictures
            other = own[~from_page[own]]
            pixel[other] = (pixel[other] + 0.5) * scale - 0.5
        size_px[own] = size
    outside = np.any((pixel < -0.5) | (pixel > size_px - 0.5), axis=1)
    if outside.any():
        _refuse(document, source, marks, outside, pixel, size_px)
    return pixel if document.errors == before else None


def marks_in_photographs(
    document: Document,
    sources: Sequence[Source],
    marks: Sequence[list[Mark]],
    photographs: Sequence[PhotographEntry],
    marks_listed: bool,
) -> list[list[Mark]]:
    """Return the marks of each source in photographs that take part in the project.

    The others are noted as a warning, with the photographs' names; as an error where no mark of any source is left and
    the project file lists none itself (``marks_listed``).
    """
    names = [p.name for p in photographs if p.name is not None]
    taking_part = set(names)
    joined = [joined_names((mark.photograph for mark in own), names) for own in marks]
    marks = [
        [replace(mark, photograph=join.of.get(mark.photograph, mark.photograph)) for mark in own]
        for own, join in zip(marks, joined, strict=True)
    ]
    kept = [[mark for mark in own if mark.photograph in taking_part] for own in marks]
    nothing_left = not any(kept) and not marks_listed
    for source, own, join in zip(sources, marks, joined, strict=True):
        missing = [mark for mark in own if mark.photograph not in taking_part]
        if not missing:
            continue
        counts = Counter(mark.photograph for mark in missing)
        listed = ", ".join(f"{name} ({count})" for name, count in list(counts.items())[:_MOST_NAMES])
        more = f" and {len(counts) - _MOST_NAMES} more" if len(counts) > _MOST_NAMES else ""
        near = suggestion(missing[0].photograph, names)
        several = join.ambiguous.get(missing[0].photograph)
        if several is not None:
            near = f"did you mean {' or '.join(several[:3])}? Write the folder too"
        hint = near if near.startswith("did you mean") else "add the photographs to the project, or remove their marks"
        text, left_out = _missing_words(len(missing), len(own))
        where = f"{source.path_of(missing[0])}:{missing[0].source.line}: "
        if nothing_left:
            document.add_error(source.key, f"{where}{text}: {listed}{more}: {hint}")
        else:
            document.warn(source.key, f"{where}{text} and {left_out}: {listed}{more}", hint)
    return kept


def _missing_words(missing: int, of: int) -> tuple[str, str]:
    """Return what is said of so many marks of a list whose photographs are missing, and that they are left out."""
    share = f"{missing} of {of} marks"
    if missing == of:
        share = {1: "its only mark", 2: "both marks"}.get(of, f"all {of} marks")
    if missing == 1:
        return f"{share} is in a photograph that is not in the project", "is left out"
    return f"{share} are in photographs that are not in the project", "are left out"


def _scale(
    document: Document, source: Source, camera: str, picture_px: tuple[int, int], size_px: tuple[int, int]
) -> float | None:
    across, down = size_px[0] / picture_px[0], size_px[1] / picture_px[1]
    if abs(down / across - 1.0) <= SHAPE_TOLERANCE:
        return across
    document.add_error(
        (*source.key, "picture_size_px"),
        f"a picture of {picture_px[0]} × {picture_px[1]} px has another aspect ratio than the photographs of "
        f"camera {camera}, "
        f"{size_px[0]} × {size_px[1]} px: give the size of the pictures in which the points were marked",
    )
    return None


def _refuse(
    document: Document,
    source: Source,
    marks: Sequence[Mark],
    outside: NDArray[np.bool_],
    pixel: FloatArray,
    size_px: FloatArray,
) -> None:
    """Note marks outside their photographs; where most are, they will be those of another picture size."""
    picture = source.entry.picture_size_px
    wrong = np.flatnonzero(outside)
    enlargement = np.nanmax((pixel + 0.5) / size_px)
    if (
        picture is None
        and len(wrong) * 2 >= len(marks)
        and _SMALLEST_ENLARGEMENT < enlargement <= _LARGEST_ENLARGEMENT
        and pixel.min() >= -0.5
    ):
        width, height = (int(n) for n in size_px[wrong[0]])
        w, h = (int(np.ceil(enlargement)) * n for n in (width, height))
        source.note(
            document,
            source.path_of(marks[wrong[0]]),
            marks[wrong[0]].source.line,
            f"{len(wrong)} of {len(marks)} marks are outside their photographs, which are {width} × {height} px: "
            f"they would fit pictures of {w} × {h} px: give picture_size_px: [{w}, {h}]",
        )
        return
    for number, i in enumerate(wrong[: _MOST_NAMES + 1]):
        mark = marks[i]
        (u, v), (width, height) = mark.pixel, size_px[i].astype(int)
        of = f"the photograph, which is {width} × {height} px"
        if picture is not None:
            of = f"a picture of {picture[0]} × {picture[1]} px"
        text = f"the mark of {mark.point} in {mark.photograph} at pixel ({u:.10g}, {v:.10g}) is outside {of}"
        if number == _MOST_NAMES and len(wrong) > _MOST_NAMES + 1:
            text = f"{len(wrong) - number} more marks from here on are outside"
        source.note(document, source.path_of(mark), mark.source.line, f"{text}: check the order (u right, v down)")
