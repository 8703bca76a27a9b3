"""Whose solution a file or folder is, by what it holds and not by what it is called."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from photogram.errors import ExchangeError
from photogram.exchange.formats.blocks_exchange import read_blocks_exchange
from photogram.exchange.formats.bundler import read_bundler
from photogram.exchange.formats.colmap.sparse_models import read_colmap
from photogram.exchange.formats.dbat.dbat import read_dbat
from photogram.exchange.formats.dbat.dbat_report import FIRST_LINE
from photogram.exchange.formats.meshroom.meshroom import read_meshroom
from photogram.exchange.formats.meshroom.meshroom_baf import read_meshroom_baf
from photogram.exchange.formats.metashape.metashape_cameras import read_metashape_cameras
from photogram.exchange.formats.metashape.metashape_project import read_metashape_project
from photogram.exchange.formats.micmac import read_micmac
from photogram.exchange.formats.opensfm.reconstructions import read_opensfm
from photogram.exchange.formats.pix4d.opf import read_opf
from photogram.exchange.formats.pix4d.pix4d_params import PARAMETERS, read_pix4d_params
from photogram.exchange.formats.visualsfm import read_visualsfm
from photogram.files.solutions.solution import ForeignSolution
from photogram.files.solutions.stored_solutions import is_stored, read_stored

Read = Callable[[Path], ForeignSolution]

_HEAD_BYTES = 4096
_DEPTH = 3
"""Folders below the one that is named in which a solution is looked for: sparse/0, opensfm."""


@dataclass(frozen=True)
class Format:
    """A format of solutions: what it is called, how it is told, and how it is read."""

    name: str
    is_file: Callable[[Path, bytes], bool]
    """Whether a file, with its first bytes, holds one."""
    is_folder: Callable[[Path], bool]
    """Whether a folder itself is one."""
    read: Read


def _never(_path: Path, _head: bytes = b"") -> bool:
    return False


def _starts(*beginnings: bytes) -> Callable[[Path, bytes], bool]:
    return lambda _path, head: head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(beginnings)


def _holds(*words: bytes) -> Callable[[Path, bytes], bool]:
    return lambda _path, head: all(word in head for word in words)


def _has(*names: str) -> Callable[[Path], bool]:
    return lambda folder: all((folder / name).is_file() for name in names)


def _is_colmap(folder: Path) -> bool:
    names = ("cameras", "images", "points3D")
    return any(all((folder / f"{name}.{suffix}").is_file() for name in names) for suffix in ("bin", "txt"))


def _is_micmac(folder: Path) -> bool:
    return any(folder.glob("Orientation-*.xml"))


def _is_pix4d(folder: Path) -> bool:
    return any(folder.glob(f"*{PARAMETERS}"))


def _is_metashape_project(path: Path, head: bytes) -> bool:
    return (path.suffix.lower() == ".psz" and head.startswith(b"PK")) or (
        path.suffix.lower() == ".psx" and b"<document" in head
    )


def _is_reconstruction(_path: Path, head: bytes) -> bool:
    return head.lstrip().startswith(b"[") and b'"cameras"' in head


def _is_opf(_path: Path, head: bytes) -> bool:
    return b"application/opf-project+json" in head


def _is_baf(path: Path, head: bytes) -> bool:
    first = head.split(b"\n", 3)[:3]
    return path.suffix.lower() == ".baf" and len(first) == 3 and all(line.strip().isdigit() for line in first)


def _is_stored(_path: Path, head: bytes) -> bool:
    return is_stored(head)


FORMATS = (
    Format("photogram's own", _is_stored, _never, read_stored),
    Format("COLMAP", _never, _is_colmap, read_colmap),
    Format("OpenSfM and OpenDroneMap", _is_reconstruction, _has("reconstruction.json"), read_opensfm),
    Format("Metashape (project)", _is_metashape_project, _never, read_metashape_project),
    Format("BlocksExchange", _holds(b"<BlocksExchange"), _never, read_blocks_exchange),
    Format("Metashape (cameras)", _holds(b"<document", b"<chunk"), _never, read_metashape_cameras),
    Format("Bundler", _starts(b"# Bundle file"), _never, read_bundler),
    Format("VisualSFM", _starts(b"NVM_V3"), _never, read_visualsfm),
    Format("DBAT", _starts(FIRST_LINE.encode()), _never, read_dbat),
    Format("OPF", _is_opf, _has("project.opf"), read_opf),
    Format("PIX4Dmapper", _starts(b"fileName imageWidth imageHeight"), _is_pix4d, read_pix4d_params),
    Format("MicMac", _never, _is_micmac, read_micmac),
    Format("Meshroom", _holds(b'"intrinsics"', b'"version"'), _never, read_meshroom),
    Format("Meshroom (bundle adjustment)", _is_baf, _never, read_meshroom_baf),
)
"""In the order in which they are tried."""


def read_solution(path: Path) -> ForeignSolution:
    """Return the solution that a file or folder holds, whosever it is.

    A folder that is none itself may have one in a folder below it. Raises ExchangeError where nothing is recognised or
    several solutions are there, and as the readers do.
    """
    found = recognised(path)
    if not found:
        names = ", ".join(each.name for each in FORMATS)
        raise ExchangeError(
            f"{path}: holds no solution that photogram knows: name the file or folder of one of {names}"
        )
    if len(found) > 1:
        places = ", ".join(f"{place} ({each.name})" for each, place in found)
        raise ExchangeError(f"{path}: holds several solutions: name one of {places}")
    (each, place) = found[0]
    return each.read(place)


def recognised(path: Path) -> list[tuple[Format, Path]]:
    """Return the solutions that a file or folder holds, with their places: those of the uppermost folder that has any.

    Raises ExchangeError where the path cannot be looked at.
    """
    try:
        if not path.is_dir():
            return _of_file(path)
        level = [path]
        for _ in range(_DEPTH):
            found = [one for folder in level for one in _of_folder(folder)]
            if found:
                return found
            level = [below for folder in level for below in sorted(folder.iterdir()) if below.is_dir()]
    except (OSError, ValueError) as fault:
        raise ExchangeError(f"{path}: cannot be read ({fault}): check the name and its permissions") from fault
    return []


def _of_file(path: Path) -> list[tuple[Format, Path]]:
    if not path.is_file():
        raise ExchangeError(f"{path}: file not found, or no ordinary file: check the name")
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    return [(each, path) for each in FORMATS if each.is_file(path, head)][:1]


def _of_folder(folder: Path) -> list[tuple[Format, Path]]:
    own = [(each, folder) for each in FORMATS if each.is_folder(folder)]
    if own:
        return own[:1]
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    return [one for path in files for one in _of_file(path)]
