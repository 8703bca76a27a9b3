"""Triangulated surfaces by the ending of their file."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from photogram.errors import ProjectError
from photogram.files.triangulations.drawing import read_drawing
from photogram.files.triangulations.land_xml import read_land_xml
from photogram.files.triangulations.triangulation import Triangulation

READERS: Mapping[str, Callable[[Path, Sequence[str]], Triangulation]] = {
    ".xml": read_land_xml,
    ".landxml": read_land_xml,
    ".dxf": read_drawing,
}


def read_triangulation(path: Path, parts: Sequence[str] = ()) -> Triangulation:
    """Return the triangles of a LandXML file or a drawing; of several surfaces, or layers, those named. Raises
    ProjectError as the reader of its format, and for another one."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ProjectError(f"surface {path}: {', '.join(READERS)} are read as triangulations: export it as one of them")
    return reader(path, parts)
