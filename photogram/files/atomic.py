"""Folders made, and files written whole or not at all, through no link."""

import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from photogram.errors import PhotogramError, WorkspaceError

Observer = Callable[[Path, Path], None]
"""Told of a file that is about to be in place: its temporary name, which holds all of it, and its name."""

_observers: dict[Path, Observer] = {}
_at_work: set[Path] = set()
_ATTEMPTS = 2
_TEMPORARY = re.compile(r"\.photogram-[0-9a-f]{16}\.partial(\.parts)?")


def make_folder(path: Path) -> None:
    """Make a folder and those above it, unless it is there. Raises WorkspaceError where that cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkspaceError(
            f"{path}: the folder cannot be created ({error.strerror}): choose another, or remove what has its name"
        ) from error


def make_folder_within(path: Path) -> None:
    """Make a folder within one that is there, as ``make_folder``. Raises WorkspaceError where a link has its place:
    what is written would go elsewhere."""
    if path.is_symlink():
        raise WorkspaceError(f"{path}: is a link in place of a folder that photogram writes to: remove the link")
    make_folder(path)


def unwritable(folder: Path) -> str:
    """Return why nothing can be written to a folder, or to the one it would be made in; empty where it can be."""
    for place in (folder, *folder.parents):
        if place.is_dir():
            return "" if os.access(place, os.W_OK | os.X_OK) else f"{place} is not writable"
        if place.is_symlink() or place.exists():
            return f"{place} is not a folder"
    return f"{folder} has no parent folder"


@contextmanager
def observed(folder: Path, observer: Observer) -> Iterator[None]:
    """Tell ``observer`` of every file that ``replacing`` puts below ``folder`` while the block runs, whichever thread
    writes it. What it raises keeps the file from its place."""
    _observers[folder] = observer
    try:
        yield
    finally:
        del _observers[folder]


def temporary_name(folder: Path) -> Path:
    """Return a name in a folder that nobody can foresee, and that ``remove_leftovers`` knows."""
    return folder / f".photogram-{secrets.token_hex(8)}.partial"


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name beside ``path`` to write to; it takes the place of ``path`` only when all went well.

    The temporary file is made here, under a name that nobody can foresee, so that a link that somebody has put there is
    never written through; a link called ``path`` is replaced itself. Raises WorkspaceError where the folder cannot be
    written.
    """
    partial = temporary_name(path.parent)
    _at_work.add(partial)
    try:
        open(partial, "xb").close()
        yield partial
        for folder, observer in tuple(_observers.items()):
            if path.is_relative_to(folder):
                observer(partial, path)
        os.replace(partial, path)
    except PhotogramError:  # of an OSError of ours the reason is said already
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise WorkspaceError(
            f"{path}: cannot be written ({reason}): check that the folder exists, may be written to and has free space"
        ) from error
    finally:
        # where the name cannot even be looked for, the error above says so
        with suppress(OSError):
            partial.unlink()
        _at_work.discard(partial)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, a text in UTF-8, by ``replacing``: it holds all of the content or is as it was."""
    with replacing(path) as partial:
        partial.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


@contextmanager
def scratch_folder(partial: Path) -> Iterator[Path]:
    """Give an empty folder beside the partial file of ``replacing``, or a ``temporary_name``, for what is only needed
    on the way.

    Libraries that write several files, or leave some where they are stopped, do it there. Raises OSError where the
    folder cannot be made.
    """
    folder = partial.with_name(f"{partial.name}.parts")
    _at_work.add(folder)
    try:
        folder.mkdir()
        yield folder
    finally:
        _remove_tree(folder)
        _at_work.discard(folder)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Give a folder to write files to that stand in ``path``, which is absent or empty, when all went well; else it is
    as it was. Raises WorkspaceError where it cannot be written."""
    is_there = path.is_dir()
    make_folder(path if is_there else path.parent)
    partial, moved = temporary_name(path if is_there else path.parent), list[Path]()
    _at_work.add(partial)
    try:
        partial.mkdir()
        yield partial
        if is_there:
            for entry in sorted(partial.iterdir()):
                moved.append(path / entry.name)
                os.replace(entry, moved[-1])
            moved.clear()
        else:
            os.replace(partial, path)
    except PhotogramError:
        raise
    except OSError as error:
        raise WorkspaceError(
            f"{path}: cannot be written ({error.strerror or error}): check that it may be written to and has free space"
        ) from error
    finally:
        for place in (*moved, partial):
            _remove_tree(place)
        _at_work.discard(partial)


def _remove_tree(path: Path) -> None:
    """Remove a folder or a file, if it is there; what cannot be removed stays."""
    for _ in range(_ATTEMPTS):
        shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            path.unlink(missing_ok=True)
        if not path.exists():
            break


def remove_leftovers(folder: Path) -> None:
    """Remove from a folder what processes that were killed have left half written. Raises WorkspaceError where that
    cannot be."""
    try:
        for entry in tuple(os.scandir(folder)):
            path = folder / entry.name
            if _TEMPORARY.fullmatch(entry.name) and path not in _at_work:
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(path)
                else:
                    path.unlink()
    except OSError as error:
        raise WorkspaceError(f"{folder}: cannot be cleaned up ({error.strerror}): check the permissions") from error
