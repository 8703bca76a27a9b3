"""Files written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from photogram.errors import WorkspaceError


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
        partial.unlink(missing_ok=True)
