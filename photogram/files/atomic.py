"""Folders made, and files written whole or not at all."""

from __future__ import annotations

import os
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
