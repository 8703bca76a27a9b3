"""The files of a stage and their checksums: taken when a file is written, compared when it is read.

While a stage works, its checksums stand in JOURNAL, a line for each file, written before the file takes its name; so
what a run that was killed has left can be told from what is damaged. Every process of a pool keeps a journal of its
own, since two machines cannot append to one file. When the stage is complete the checksums go to its note.
"""

import hashlib
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

from photogram.files.atomic import observed, remove_leftovers
from photogram.files.portable import through_no_link
from photogram.files.stage_folders import MARKER, NOTE, errors_of

JOURNAL = "files.sha256"
_JOURNALS = re.compile(r"files(-.+)?\.sha256")


@dataclass(frozen=True)
class Checksum:
    """What a file of a stage holds: its length, and the SHA-256 of its content in hex."""

    bytes: int
    sha256: str


@dataclass(frozen=True)
class StageFile:
    """A file of a complete stage: what it holds, and when it was last written to, in ns, by its file system."""

    bytes: int
    sha256: str
    mtime_ns: int


def checksum(path: Path) -> Checksum:
    """Return the checksum of a file. Raises OSError where it cannot be read."""
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
        return Checksum(stream.tell(), digest)


def is_unchanged(path: Path, known: StageFile) -> bool:
    """Return whether a file is there that holds what it should, by its content. Raises OSError where it cannot be
    read."""
    try:
        return not path.is_symlink() and checksum(path) == Checksum(known.bytes, known.sha256)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        return False


def looks_unchanged(path: Path, known: StageFile) -> bool:
    """Return whether a file is there that holds what it should: by length and time where nobody wrote to it since, else
    by its content. Raises OSError where it cannot be read."""
    try:
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    if (status.st_size, status.st_mtime_ns) == (known.bytes, known.mtime_ns):
        return not path.is_symlink()
    return status.st_size == known.bytes and is_unchanged(path, known)


def files_below(folder: Path) -> Iterator[str]:
    """Yield the names of everything but folders below ``folder``, with ``/``, without note and journals at its top.
    Links are not followed."""
    for place, folders, names in os.walk(folder):
        inner = Path(place).relative_to(folder)
        links = [name for name in folders if (Path(place) / name).is_symlink()]
        for name in sorted([*names, *links]):
            written = (inner / name).as_posix()
            if written != NOTE and not (inner == Path() and _JOURNALS.fullmatch(name)):
                yield written


def own_journal(process: str) -> str:
    """Return the name of the journal of one process of a pool."""
    return f"files-{process}.sha256"


def journals(folder: Path) -> list[Path]:
    """Return the journals of a partial folder."""
    return sorted(path for path in folder.iterdir() if _JOURNALS.fullmatch(path.name))


@contextmanager
def journalled(folder: Path, journal: str = JOURNAL, before: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Note the checksum of every file that is written below the partial folder of a stage while the block runs.

    ``before`` is called before a file takes its name, and keeps it from its place by what it raises.
    """
    lock = Lock()

    def note(temporary: Path, path: Path) -> None:
        before()
        known = checksum(temporary)
        line = f"{known.sha256} {known.bytes} {path.relative_to(folder).as_posix()}\n".encode()
        with lock, open(folder / journal, "ab", buffering=0, opener=through_no_link) as stream:
            if stream.write(line) != len(line):
                raise OSError(f"the line of {path.name} was not written completely: is the disk full?")

    with observed(folder, note):
        yield


def read_journal(folder: Path) -> dict[str, set[Checksum]]:
    """Return the checksums that the journals of a partial folder note, of each file the last of each; what is half a
    line is none. Raises OSError where one cannot be read."""
    noted: dict[str, set[Checksum]] = {}
    for journal in journals(folder):
        own: dict[str, Checksum] = {}
        for line in journal.read_bytes().split(b"\n")[:-1]:
            parts = line.decode(errors="replace").split(" ", 2)
            if len(parts) == 3 and parts[1].isdecimal():
                own[parts[2]] = Checksum(int(parts[1]), parts[0])
        for name, known in own.items():
            noted.setdefault(name, set()).add(known)
    return noted


def remove_all_leftovers(folder: Path) -> None:
    """Remove from a folder and those below it what processes that were killed have left half written."""
    for place in [place for place, _, _ in os.walk(folder)]:
        if os.path.isdir(place):  # else it was a leftover itself
            remove_leftovers(Path(place))


def keep_whole_files(folder: Path) -> list[Path]:
    """Remove from the partial folder of a stage what a killed run left half written and what has been damaged since;
    return the latter."""
    known, damaged = read_journal(folder), []
    with errors_of(folder):
        remove_all_leftovers(folder)
        for name in files_below(folder):
            path = folder / name
            whole = not path.is_symlink() and path.is_file() and checksum(path) in known.get(name, ())
            if not whole and name != MARKER:
                damaged.append(path)
        for path in damaged:
            path.unlink()
    return damaged


def files_of(folder: Path) -> dict[str, StageFile]:
    """Return the files of a partial folder that is about to be complete, by name; a checksum on which the journals
    agree is not taken again. Raises OSError where a file cannot be read."""
    known, files = read_journal(folder), {}
    for name in files_below(folder):
        path = folder / name
        status = os.lstat(path)
        agreed = known.get(name, set())
        noted = next(iter(agreed)) if len(agreed) == 1 else None
        if noted is None or noted.bytes != status.st_size:
            noted = checksum(path)
        files[name] = StageFile(noted.bytes, noted.sha256, status.st_mtime_ns)
    return files
