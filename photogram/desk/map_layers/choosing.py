"""Files and folders that a survey can be compared with, for choosing one."""

from pathlib import Path

from typing_extensions import TypedDict

from photogram.errors import WorkspaceError
from photogram.files.triangulations.reading import READERS, reader_of
from photogram.languages.said import Said
from photogram.volumes.surfaces import SURFACE_SUFFIXES, surface_path

MOST_LISTED = 500


class SurfaceEntry(TypedDict):
    """A folder, or a file that may hold a surface."""

    name: str
    path: str
    is_folder: bool
    is_survey: bool
    """Whether it is a folder with a surface among its results."""


class SurfaceListing(TypedDict):
    """What lies in a folder."""

    path: str
    above: str | None
    entries: list[SurfaceEntry]


class PartsListing(TypedDict):
    """The surfaces of a LandXML file, or the layers of a drawing, that have triangles."""

    what: str
    """What one is called."""
    triangles: dict[str, int]


def parts_of(path: Path) -> PartsListing:
    """Return the parts of a triangulation. Raises ProjectError where it is none, or cannot be read."""
    path = path.expanduser().absolute()
    reader = reader_of(path)
    return {"what": reader.part, "triangles": {name: count for name, count in reader.parts(path).items() if count}}


def surfaces_in(folder: Path) -> SurfaceListing:
    """Return the folders and the surfaces in a folder by their names. Raises WorkspaceError where it cannot be read."""
    folder = folder.expanduser().absolute()
    try:
        within = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError as error:
        said = Said("{folder}: cannot be read ({reason}): choose another folder", folder=folder, reason=error.strerror)
        raise WorkspaceError(said) from error
    shown = [path for path in within if path.is_dir() or path.suffix.lower() in (*SURFACE_SUFFIXES, *READERS)]
    return {
        "path": str(folder),
        "above": str(folder.parent) if folder.parent != folder else None,
        "entries": [
            {
                "name": path.name,
                "path": str(path),
                "is_folder": path.is_dir(),
                "is_survey": path.is_dir() and surface_path(path).is_file(),
            }
            for path in shown[:MOST_LISTED]
        ],
    }
