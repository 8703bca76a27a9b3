"""The formats of other programs: how each is recognised and read, and how each form is written. One row each."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from photogram.exchange.formats.angle_tables import write_omega_phi_kappa, write_yaw_pitch_roll
from photogram.exchange.formats.blocks_exchange import read_blocks_exchange
from photogram.exchange.formats.bundler import read_bundler, write_bundler
from photogram.exchange.formats.colmap.sparse_models import read_colmap, write_colmap
from photogram.exchange.formats.dbat.dbat import read_dbat
from photogram.exchange.formats.dbat.dbat_report import FIRST_LINE
from photogram.exchange.formats.meshroom.meshroom import read_meshroom
from photogram.exchange.formats.meshroom.meshroom_baf import read_meshroom_baf
from photogram.exchange.formats.metashape.metashape_cameras import read_metashape_cameras, write_metashape_cameras
from photogram.exchange.formats.metashape.metashape_project import read_metashape_project
from photogram.exchange.formats.micmac import read_micmac
from photogram.exchange.formats.names import SolutionFormat
from photogram.exchange.formats.opensfm.reconstructions import read_opensfm, write_opensfm
from photogram.exchange.formats.pix4d.opf import read_opf, write_opf
from photogram.exchange.formats.pix4d.pix4d_params import PARAMETERS, read_pix4d_params
from photogram.exchange.formats.undistorted import write_pinholes
from photogram.exchange.formats.visualsfm import read_visualsfm
from photogram.files.solutions.solution import ForeignSolution, Frame
from photogram.files.solutions.stored_solutions import is_stored, read_stored
from photogram.projection import PARAMETER_NAMES, Model


@dataclass(frozen=True)
class Format:
    """A format of solutions: what it is called, how it is told, and how it is read."""

    name: str
    is_file: Callable[[Path, bytes], bool]
    """Whether a file, with its first bytes, holds one."""
    is_folder: Callable[[Path], bool]
    """Whether a folder itself is one."""
    read: Callable[[Path], ForeignSolution]


@dataclass(frozen=True)
class Writer:
    """How a form of solutions is written, and what it can hold."""

    write: Callable[[Path, ForeignSolution], tuple[str, ...]]
    """Writes a file or into a folder; returns sentences on what has no place there."""
    frame: Frame = "local"
    """What its coordinates are: east, north and up of the survey, unless the form has its own."""
    terms: Mapping[Model, frozenset[str]] = field(default_factory=dict)
    """What its camera models hold of photogram's parameters; all of a model that is not named."""
    is_folder: bool = False
    """Whether it is a folder of files."""


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


def _has_any(pattern: str) -> Callable[[Path], bool]:
    return lambda folder: any(folder.glob(pattern))


def _is_metashape_project(path: Path, head: bytes) -> bool:
    return (path.suffix.lower() == ".psz" and head.startswith(b"PK")) or (
        path.suffix.lower() == ".psx" and b"<document" in head
    )


def _is_reconstruction(_path: Path, head: bytes) -> bool:
    return head.lstrip().startswith(b"[") and b'"cameras"' in head


def _is_baf(path: Path, head: bytes) -> bool:
    first = head.split(b"\n", 3)[:3]
    return path.suffix.lower() == ".baf" and len(first) == 3 and all(line.strip().isdigit() for line in first)


FORMATS = (
    Format("photogram's own", lambda _path, head: is_stored(head), _never, read_stored),
    Format("COLMAP", _never, _is_colmap, read_colmap),
    Format("OpenSfM and OpenDroneMap", _is_reconstruction, _has("reconstruction.json"), read_opensfm),
    Format("Metashape (project)", _is_metashape_project, _never, read_metashape_project),
    Format("BlocksExchange", _holds(b"<BlocksExchange"), _never, read_blocks_exchange),
    Format("Metashape (cameras)", _holds(b"<document", b"<chunk"), _never, read_metashape_cameras),
    Format("Bundler", _starts(b"# Bundle file"), _never, read_bundler),
    Format("VisualSFM", _starts(b"NVM_V3"), _never, read_visualsfm),
    Format("DBAT", _starts(FIRST_LINE.encode()), _never, read_dbat),
    Format("OPF", _holds(b"application/opf-project+json"), _has("project.opf"), read_opf),
    Format("PIX4Dmapper", _starts(b"fileName imageWidth imageHeight"), _has_any(f"*{PARAMETERS}"), read_pix4d_params),
    Format("MicMac", _never, _has_any("Orientation-*.xml"), read_micmac),
    Format("Meshroom", _holds(b'"intrinsics"', b'"version"'), _never, read_meshroom),
    Format("Meshroom (bundle adjustment)", _is_baf, _never, read_meshroom_baf),
)
"""In the order in which they are tried."""

_BROWN = frozenset(PARAMETER_NAMES) - {"k4", "b1", "b2"}
_FISHEYE = frozenset(PARAMETER_NAMES) - {"p1", "p2", "b2"}
_COLMAP: Mapping[Model, frozenset[str]] = {"brown": _BROWN | {"b1"}, "fisheye": _FISHEYE}

WRITERS: dict[SolutionFormat, Writer] = {
    "colmap": Writer(write_colmap, terms=_COLMAP, is_folder=True),
    "colmap-text": Writer(partial(write_colmap, form="text"), terms=_COLMAP, is_folder=True),
    "opensfm": Writer(write_opensfm, "topocentric", _COLMAP, is_folder=True),
    "bundler": Writer(write_bundler, terms={"brown": frozenset({"focal_px", "k1", "k2"})}),
    "metashape": Writer(write_metashape_cameras, "geocentric"),
    "opf": Writer(write_opf, "map", {"brown": _BROWN}, is_folder=True),
    "omega-phi-kappa": Writer(write_omega_phi_kappa, "map"),
    "yaw-pitch-roll": Writer(write_yaw_pitch_roll, "map"),
    "undistorted": Writer(write_pinholes, is_folder=True),
}
"""By the name that `photogram export --to` takes."""
