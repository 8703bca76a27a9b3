"""What photogram has written to a folder of results, by name and checksum: nothing else is ever removed from it.

The record is ``checksums.sha256`` in each of its three folders, and in the folder itself for what lies there by itself;
``sha256sum --check`` reads it too.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock

from photogram.files.atomic import observed, replacing
from photogram.files.npz_json import file_fingerprint
from photogram.files.stage_folders import errors_of
from photogram.result_files import (
    FORMER_FOLDERS,
    TILES,
    TILES_FOLDER,
    WRITTEN_IN_RESULTS,
    ResultFolder,
    is_written_by_a_run,
)

CHECKSUMS = "checksums.sha256"
_PLACES = tuple(map(Path, ("", *WRITTEN_IN_RESULTS, *FORMER_FOLDERS, TILES_FOLDER)))
"""Those of the folder of results and of the folder that deliverables are written to, which may be another one."""

FOREIGN = "not written by photogram, and would be overwritten"
FOREIGN_REMEDY = "move such files elsewhere, or give another folder under results"

_LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def _place(name: str) -> str:
    """Return the folder, within that of the results, in which the checksum of a file stands, and a slash; nothing for
    the folder of the results itself."""
    folder = name.split("/", 1)[0]
    return f"{folder}/" if "/" in name and folder in tuple(ResultFolder) else ""


def read_record(results: Path) -> dict[str, str]:
    """Return the SHA-256, in hex, of what photogram has written to a folder of results, by name; lines that are damaged
    are left out. Raises WorkspaceError where the record cannot be read."""
    record: dict[str, str] = {}
    for place in ("", *(f"{folder}/" for folder in ResultFolder)):
        path = results / place / CHECKSUMS
        if not path.is_file() or (path.parent.is_symlink() and place):
            continue
        with errors_of(path, "cannot be read"):
            text = path.read_text(encoding="utf-8", errors="replace")
        matches = (_LINE.fullmatch(line) for line in text.splitlines())
        record |= {place + match[2]: match[1] for match in matches if match}
    return record


def foreign_products(results: Path) -> list[str]:
    """Return the names of files in a folder of results that a run would overwrite and that photogram has not written.
    Raises WorkspaceError where the record cannot be read."""
    known = read_record(results)
    there = [path.relative_to(results).as_posix() for place in _PLACES for path in (results / place).glob("*")]
    return sorted(name for name in there if name not in known and is_written_by_a_run(name))


def _write_record(results: Path, files: dict[str, str], place: str) -> None:
    """Write the record of one place, and none where nothing of photogram is left there."""
    path = results / place / CHECKSUMS
    own = sorted(name for name in files if _place(name) == place)
    if not own:
        path.unlink(missing_ok=True)
        return
    with replacing(path) as temporary:
        temporary.write_text("".join(f"{files[n]}  {n.removeprefix(place)}\n" for n in own), encoding="utf-8")


@contextmanager
def recorded(results: Path) -> Iterator[None]:
    """Record every result and every picture that is written to a folder of results while the block runs, each file
    before it is there; other folders in it may be anything, that of the intermediate results among them."""
    files, lock = read_record(results), Lock()

    def note(temporary: Path, path: Path) -> None:
        name = path.relative_to(results)
        if name.parent in _PLACES and name.name != CHECKSUMS:
            checksum = file_fingerprint(temporary)
            with lock:
                files[name.as_posix()] = checksum
                _write_record(results, files, _place(name.as_posix()))

    with observed(results, note):
        yield


def remove_made(results: Path, names: Iterable[str]) -> list[str]:
    """Remove files from a folder of results that photogram has written there and nobody has changed since; return
    their names. Raises WorkspaceError where one cannot be removed."""
    files, removed, places = read_record(results), list[str](), set[str]()
    for name in names:
        path = results / name
        known = files.pop(name, None)
        if known is not None:  # a record that does not hold it may be somebody else's
            places.add(_place(name))
        links = path.is_symlink() or any(p.is_symlink() for p in path.parents if p != results and results in p.parents)
        own = known is not None and Path(name).parent in _PLACES and not links
        if own and path.is_file() and file_fingerprint(path) == known:
            with errors_of(path, "cannot be removed"):
                path.unlink()
            removed.append(name)
    for place in sorted(places):
        _write_record(results, files, place)
    emptied = (*FORMER_FOLDERS, TILES, TILES_FOLDER)
    for folder in (results / name for name in emptied if f"{name}/" in "".join(removed)):
        with suppress(OSError):  # somebody else's files are in it
            folder.rmdir()
    return removed


def records(results: Path) -> list[str]:
    """Return the names of the files, their folders included, that hold the checksums of a folder of results."""
    return sorted({f"{_place(name)}{CHECKSUMS}" for name in read_record(results)})


def remove_outdated(results: Path, products: Iterable[str]) -> list[str]:
    """Remove what photogram has written to a folder of results but for ``products``, as ``remove_made``."""
    return remove_made(results, sorted(read_record(results).keys() - set(products)))
