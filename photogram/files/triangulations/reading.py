"""Triangulated surfaces by the ending of their file."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from photogram.errors import ProjectError
from photogram.files.triangulations.drawing import layers_of, read_drawing
from photogram.files.triangulations.land_xml import read_land_xml, surfaces_of
from photogram.files.triangulations.triangulation import Triangulation


@dataclass(frozen=True)
class Reader:
    """How a format is read."""

    read: Callable[[Path, Sequence[str]], Triangulation]
    """Reads a file, of several parts those named."""
    parts: Callable[[Path], dict[str, int]]
    """Returns the parts of a file with their numbers of triangles."""
    part: str
    """What a part is called."""


_LAND_XML = Reader(read_land_xml, surfaces_of, "surface")
READERS: Mapping[str, Reader] = {
    ".xml": _LAND_XML,
    ".landxml": _LAND_XML,
    ".dxf": Reader(read_drawing, layers_of, "layer"),
}


def reader_of(path: Path) -> Reader:
    """Return how a file is read. Raises ProjectError for another format."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ProjectError(f"surface {path}: {', '.join(READERS)} are read as triangulations: export it as one of them")
    return reader


def read_triangulation(path: Path, parts: Sequence[str] = ()) -> Triangulation:
    """Return the triangles of a LandXML file or a drawing; of several surfaces, or layers, those named. Raises
    ProjectError as the reader of its format, and for another one."""
    return reader_of(path).read(path, parts)
