"""Folders made, and files written whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from photogram.errors import WorkspaceError


def make_folder(path: Path) -> None:
    """Make a folder and those above it, unless it is there. Raises WorkspaceError where that cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise WorkspaceError(
            f"{path}: the folder cannot be made ({fault.strerror}): choose another, or free the name"
        ) from fault


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name beside ``path`` to write to; it takes the place of ``path`` only when all went well.

    Raises WorkspaceError where the folder cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        yield partial
        os.replace(partial, path)
    except WorkspaceError:
        raise
    except OSError as fault:
        reason = fault.strerror or str(fault)
        raise WorkspaceError(
            f"{path}: cannot be written ({reason}): check that the folder exists, may be written to and has free space"
        ) from fault
    finally:
        # where the name cannot even be looked for, the fault above says so
        with suppress(OSError):
            partial.unlink()


@contextmanager
def scratch_folder(partial: Path) -> Iterator[Path]:
    """Give an empty folder beside the partial file of ``replacing`` for what is only needed on the way.

    Libraries that write several files, or leave some where they are stopped, do it there. Raises OSError where the
    folder cannot be made.
    """
    folder = partial.with_name(f"{partial.name}.parts")
    shutil.rmtree(folder, ignore_errors=True)  # of a run that was killed
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
