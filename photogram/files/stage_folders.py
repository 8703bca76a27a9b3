"""The folders of stages in a workspace: how they are called, which of them photogram made, and how they are removed.

A stage has the folder ``<stage>.stage``, and ``<stage>.stage.partial`` while it works. Every folder that photogram
makes holds the file MARKER from its first moment to its last; a folder without it is somebody's own and never touched.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from photogram.errors import WorkspaceError

COMPLETE, PARTIAL, REMOVED = ".stage", ".stage.partial", ".stage.removed"
NOTE, MARKER, LOCK = "stage.json", "made-by-photogram.txt", "photogram.lock"
_MARKER_TEXT = (
    "photogram made this folder and all that is in it, and removes it when it is out of date.\n"
    "Keep nothing of your own here. Delete the folder at any time: the next run makes it again.\n"
)


def stage_folder_around(work: Path, path: Path) -> Path | None:
    """Return the folder of a stage in ``work`` that ``path`` is or lies in, None where there is none; links count as
    what they lead to."""
    work, path = work.resolve(), path.resolve()
    if not path.is_relative_to(work) or path == work:
        return None
    first = path.relative_to(work).parts[0]
    # some file systems do not tell a from A
    return work / first if first.casefold().endswith((COMPLETE, PARTIAL, REMOVED)) else None


def earlier_folders(work: Path, stages: tuple[str, ...]) -> list[Path]:
    """Return the folders in ``work`` that a version of photogram made which called them by the stage alone; they are
    not read any more."""
    return [work / name for name in stages if _is_earlier(work / name, name)]


def _is_earlier(folder: Path, name: str) -> bool:
    try:
        text = (folder / NOTE).read_text(encoding="utf-8", errors="replace")[:500]
    except OSError:
        return False
    return f'"stage": "{name}"' in text and '"fingerprint": "' in text


@contextmanager
def errors_of(path: Path, what: str = "cannot be used for intermediate results") -> Iterator[None]:
    """Raise what the file system refuses within the block as a WorkspaceError about ``path``."""
    try:
        yield
    except WorkspaceError:
        raise
    except OSError as error:
        raise WorkspaceError(
            f"{path}: {what} ({error.strerror or error}): check the disk and the permissions"
        ) from error


def is_made_here(folder: Path) -> bool:
    """Return whether there is a folder at this place, one that photogram made, or an empty one.

    Raises WorkspaceError where something else is there: a link, a file, or a folder of somebody's own.
    """
    remedy = "move it away, or give another folder under work"
    with errors_of(folder):
        if folder.is_symlink():
            raise WorkspaceError(f"{folder}: is a link where photogram needs a folder of its own: {remedy}")
        if not folder.exists():
            return False
        if not folder.is_dir():
            raise WorkspaceError(f"{folder}: is not a folder, and photogram needs the name for one: {remedy}")
        if not any((folder / name).is_file() for name in (MARKER, NOTE)) and any(folder.iterdir()):
            raise WorkspaceError(f"{folder}: photogram did not make this folder ({MARKER} is not in it): {remedy}")
    return True


def make_stage_folder(folder: Path) -> None:
    """Make the folder of a stage, with its marker. Raises WorkspaceError where that cannot be."""
    with errors_of(folder, "the folder cannot be created"):
        folder.mkdir(parents=True, exist_ok=True)
        with open(folder / MARKER, "x", encoding="utf-8") as stream:
            stream.write(_MARKER_TEXT)


def remove_stage_folder(folder: Path) -> None:
    """Remove a folder that photogram made, if it is there; one that is removed half way is removed the next time.

    Raises WorkspaceError where photogram did not make it, or it cannot be removed.
    """
    doomed = folder.with_name(folder.name.removesuffix(PARTIAL).removesuffix(COMPLETE) + REMOVED)
    if is_made_here(doomed):
        _delete(doomed)
    if is_made_here(folder):
        with errors_of(folder, "cannot be removed"):
            folder.rename(doomed)
        _delete(doomed)


def _delete(folder: Path) -> None:
    with errors_of(folder, "cannot be removed"):
        for entry in tuple(os.scandir(folder)):
            if entry.name == MARKER:
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path)
            else:
                os.unlink(entry.path)
        # the last, so that what is left of a removal that was stopped is known to be photogram's
        (folder / MARKER).unlink(missing_ok=True)
        folder.rmdir()
