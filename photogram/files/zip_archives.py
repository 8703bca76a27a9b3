"""Archives (ZIP) of results: files of any size in pieces, and the same bytes for the same files."""

import shutil
import zipfile
from pathlib import Path

from photogram.files.stage_folders import errors_of

_PIECE_BYTES = 1 << 20
_NO_TIME = (1980, 1, 1, 0, 0, 0)
_COMPRESSED = frozenset({".tif", ".laz", ".zip", ".kmz", ".qgz", ".glb", ".png", ".pdf"})


def zip_entry(name: str) -> zipfile.ZipInfo:
    """Return the entry of a file in an archive: compressed, unless its kind is."""
    entry = zipfile.ZipInfo(name, _NO_TIME)
    entry.compress_type = zipfile.ZIP_STORED if Path(name).suffix in _COMPRESSED else zipfile.ZIP_DEFLATED
    return entry


def add_file(archive: zipfile.ZipFile, path: Path, name: str) -> None:
    """Add a file under a name in pieces, so that a large one is never in memory whole. Raises WorkspaceError where it
    cannot be read."""
    with errors_of(path, "cannot be read"), path.open("rb") as source:
        entry = zip_entry(name)
        entry.file_size = path.stat().st_size  # tells whether its length needs more than 32 bits
        with archive.open(entry, "w") as target:
            shutil.copyfileobj(source, target, _PIECE_BYTES)
