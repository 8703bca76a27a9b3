"""OpenDroneMap's gcp_list.txt, written; ``tables.control_files.read_points`` reads it.

OpenDroneMap hands the pixels to OpenSfM, which counts as photogram does: the centre of the top-left pixel is (0, 0)
(opensfm/features.py, ``normalized_image_coordinates`` adds the half pixel itself). Nothing is converted.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from photogram.errors import ControlPointError
from photogram.files.atomic import replacing
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint
from photogram.wording import some

_HEADER = re.compile(r"EPSG:\d+|\+proj=[^\r\n]+|WGS84 UTM \d{1,2}[NS]")


def _fits(name: str, inner_blanks: bool) -> bool:
    """Return whether a name is read again as it is: fields are cut at blanks, and a lone # begins a comment."""
    words = name.split()
    return " ".join(words) == name and "#" not in words and (inner_blanks or len(words) == 1)


def write_gcp_list(path: Path, crs: str, points: Sequence[SurveyedPoint], marks: Iterable[Mark]) -> None:
    """Write points with their marks, sorted by point and photograph; points without marks have no line.

    ``crs`` is that of the points, EPSG:32617, a PROJ string or WGS84 UTM 17N. Standard deviations, roles and kinds of
    marks have no place in it. Raises ControlPointError where the file cannot hold the CRS, a name, or a mark of a point
    that is not in ``points``, and WorkspaceError where it cannot be written.
    """
    if not _HEADER.fullmatch(crs):
        raise ControlPointError(
            f"{path}: a gcp_list.txt cannot name the CRS {crs!r}: give an EPSG code or a PROJ string"
        )
    position = {point.name: point.position for point in points if point.position is not None}
    ordered = sorted(marks, key=lambda mark: mark.key)
    bare = sorted({mark.point for mark in ordered} - set(position))
    if bare:
        raise ControlPointError(f"{path}: no coordinates of {some(bare)}, which a gcp_list.txt needs: leave them out")
    unfit = sorted({m.photograph for m in ordered if not _fits(m.photograph, False)})
    unfit += sorted({m.point for m in ordered if not _fits(m.point, True)})
    if unfit:
        raise ControlPointError(
            f"{path}: a gcp_list.txt cannot hold the names {some(unfit)}: rename them, without blanks"
        )
    lines = [crs]
    for mark in ordered:
        numbers = " ".join(repr(float(value)) for value in (*position[mark.point], *mark.pixel))
        lines.append(f"{numbers} {mark.photograph} {mark.point}")
    with replacing(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
