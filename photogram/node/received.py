"""Files of a task as they arrive: which there may be, where each has its place, and that it is what its name says."""

import filecmp
import os
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path, PurePosixPath

from PIL import Image

from photogram.errors import ImageError
from photogram.files.atomic import make_folder
from photogram.files.photographs.images import inspect_photograph
from photogram.files.photographs.masks import is_called_mask
from photogram.files.photographs.names import SUFFIXES
from photogram.node.refusals import RequestError
from photogram.node.tasks import GROUPS, IMAGES, MASKS, TABLES
from photogram.pipeline.project_file import GEO_TXT
from photogram.wording import printable, shortened

MOST_ENTRIES, MOST_RATIO = 20_000, 100.0
"""Of an archive: files in it, and how much larger than packed one of them may be; photographs are hardly packed."""

_LONGEST_NAME, _PIECE_BYTES = 200, 1 << 20
_CHECK, _CONTROL = ("check",), ("gcp", "control")
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


class FileKind(Enum):
    """What a file of a task is, with the folder that it lies in within that of the task."""

    PHOTOGRAPH = IMAGES
    MASK = f"{IMAGES}/{MASKS}"
    POSITIONS = f"{IMAGES}/"
    GROUND_POINTS = TABLES
    BESIDE = ""
    ARCHIVE = "archive"


@dataclass(frozen=True)
class Room:
    """Bytes that a task may still take."""

    bytes: int

    def check(self, wanted: int) -> None:
        """Raise RequestError where so many are too many."""
        if wanted > self.bytes:
            raise RequestError(
                f"there is no room for {wanted} bytes more: this node has {max(self.bytes, 0)} left for this task"
            )


def checked_name(given: str) -> str:
    """Return the name of a file that was sent. Raises RequestError where it is none: a path, or what a file system may
    take for something else."""
    shown = shortened(printable(given))
    if not given or given.startswith(".") or "/" in given or "\\" in given or ":" in given or not given.isprintable():
        raise RequestError(f"{shown!r}: this is not the name of a file: send names without folders")
    if len(given.encode()) > _LONGEST_NAME:
        raise RequestError(f"{shown}: the name is too long: up to {_LONGEST_NAME} bytes are taken")
    return given


def kind_of(name: str) -> FileKind:
    """Return what a file is by its name. Raises RequestError where a task has no use for such a file."""
    low = name.lower()
    stem, suffix = os.path.splitext(low)
    if suffix in SUFFIXES:
        return FileKind.MASK if is_called_mask(name) else FileKind.PHOTOGRAPH
    if low in (GEO_TXT, GROUPS):
        return FileKind.BESIDE
    if suffix == ".txt" or (suffix == ".csv" and stem.startswith((*_CHECK, *_CONTROL))):
        return FileKind.GROUND_POINTS
    if suffix == ".mrk":
        return FileKind.POSITIONS
    if suffix == ".zip" and low != "seed.zip":
        return FileKind.ARCHIVE
    raise RequestError(
        f"{name}: a task takes photographs (JPEG, TIFF, PNG, DNG, HEIC), masks (NAME_mask.png), ground points "
        f"(gcp_list.txt, gcp*.csv, check*.csv), geo.txt, DJI's .MRK and archives of them (.zip): leave this file out"
    )


def is_check(name: str) -> bool:
    """Return whether a table holds check points, by its name."""
    return name.lower().startswith(_CHECK)


def keep(file: Path, task: Path, room: Room) -> int:
    """Put a file that has arrived under its own name into its place in the folder of a task, or what an archive holds;
    return how many photographs came with it.

    A file that is there already with the same content, as after a request that was repeated, is left. Raises
    RequestError where its name is none, it is of no use, not what its name says, or another file has its name.
    """
    name = checked_name(file.name)
    kind = kind_of(name)
    if kind is FileKind.ARCHIVE:
        return sum(keep(entry, task, room) for entry in _unpacked(file, room))
    _check_content(file, kind)
    target = task / kind.value / name
    make_folder(target.parent)
    try:
        _put(file, target)
    except FileExistsError:
        if not filecmp.cmp(file, target, shallow=False):
            raise RequestError(f"{name}: another file of this name was sent before: rename one of them") from None
        return 0
    return int(kind is FileKind.PHOTOGRAPH)


def _check_content(file: Path, kind: FileKind) -> None:
    if file.stat().st_size == 0:
        raise RequestError(f"{file.name}: is empty: send it again")
    if kind is FileKind.PHOTOGRAPH:
        try:
            inspect_photograph(file)
        except ImageError as error:
            raise RequestError(str(error).replace(str(file), file.name)) from error
    elif kind is FileKind.MASK:
        try:
            with Image.open(file) as picture:
                picture.verify()
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise RequestError(f"{file.name}: cannot be read as a picture: send it again") from error
    elif kind is not FileKind.ARCHIVE:
        with file.open("rb") as stream:
            beginning = stream.read(_PIECE_BYTES)
        if b"\0" in beginning and not beginning.startswith(_UTF_16):
            raise RequestError(f"{file.name}: a text is expected, this is none")


def _put(file: Path, target: Path) -> None:
    """Put a file where there is none. Raises FileExistsError where there is one."""
    try:
        os.link(file, target)  # fails where there is one, unlike a renaming
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        with file.open("rb") as source, target.open("xb") as stream:
            shutil.copyfileobj(source, stream, _PIECE_BYTES)


def _unpacked(archive: Path, room: Room) -> Iterator[Path]:
    """Unpack an archive beside itself, one file at a time, each gone once the next is asked for."""
    name, left = archive.name, room.bytes
    try:
        with zipfile.ZipFile(archive) as packed:
            entries = [entry for entry in packed.infolist() if not entry.is_dir()]
            if len(entries) > MOST_ENTRIES:
                raise RequestError(f"{name}: holds {len(entries)} files, up to {MOST_ENTRIES} are taken")
            for entry in entries:
                path = PurePosixPath(entry.filename.replace("\\", "/"))
                if path.is_absolute() or ".." in path.parts or ":" in entry.filename:
                    raise RequestError(f"{name}: {shortened(printable(entry.filename))} leads out of the archive")
                if path.name.startswith(".") or "__MACOSX" in path.parts:
                    continue
                own = checked_name(path.name)
                if kind_of(own) is FileKind.ARCHIVE:
                    raise RequestError(f"{name}: {own} is an archive within an archive: send its files")
                if entry.file_size > MOST_RATIO * max(entry.compress_size, 1 << 16):
                    raise RequestError(f"{name}: {own} is packed too tightly for a photograph")
                Room(left).check(entry.file_size)
                left -= entry.file_size
                file = archive.parent / "unpacked" / own
                make_folder(file.parent)
                with packed.open(entry) as source, file.open("xb") as target:
                    while piece := source.read(_PIECE_BYTES):  # never more than the entry says, or it is no archive
                        target.write(piece)
                yield file
                file.unlink()
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error) as error:
        raise RequestError(f"{name}: cannot be unpacked ({error}): send it again") from error
