"""A file system that refuses one thing once: the number-th change of files below a folder fails, no other does."""

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any
from unittest.mock import patch

CODES = (errno.ENOSPC, errno.EIO, errno.EACCES)
"""No space, a broken disk, no permission."""
_ON_A_PATH = ("mkdir", "unlink", "remove", "rmdir", "truncate")
_ON_TWO_PATHS = ("replace", "rename", "link", "symlink")
_WRITING = os.O_WRONLY | os.O_RDWR


@dataclass
class Changes:
    """The changes of files below ``root`` so far: what was done with which path. The ``failing``-th, from 1, fails with
    ``code``."""

    root: Path
    failing: int = 0
    code: int = errno.EIO
    seen: list[tuple[str, str]] = field(default_factory=list)
    _lock: Lock = field(default_factory=Lock)

    def count(self, kind: str, path: str) -> None:
        """Count a change that is about to be made. Raises OSError in place of the one that fails."""
        if not os.path.abspath(path).startswith(f"{self.root}{os.sep}"):
            return
        with self._lock:
            self.seen.append((kind, os.path.relpath(path, self.root)))
            fails = len(self.seen) == self.failing
        if fails:
            raise OSError(self.code, os.strerror(self.code), path)

    @property
    def failed(self) -> tuple[str, str] | None:
        """What was refused, None where it was never asked for."""
        return self.seen[self.failing - 1] if 0 < self.failing <= len(self.seen) else None


def _path(path: Any, folder: int | None = None) -> str | None:
    """Return a path as text, one within the folder of a descriptor too; None of what is no path."""
    if isinstance(path, int):
        return None
    text = os.fsdecode(path)
    return text if folder is None else os.path.join(os.readlink(f"/proc/self/fd/{folder}"), text)


@contextmanager
def failing(root: Path, number: int = 0, code: int = errno.EIO) -> Iterator[Changes]:
    """Count what Python changes below ``root`` while the block runs, and fail the ``number``-th time; with 0, never.

    Counted are files opened for writing and every buffer that is written to them, folders made, renamings, links,
    removals and fsync. What libraries in C write by themselves (GDAL, OpenCV) is not seen.
    """
    changes, opened = Changes(root.absolute(), number, code), io.open

    class Raw(io.FileIO):
        def write(self, data: Any, /) -> int:
            if (path := _path(self.name)) is not None:
                changes.count("write", path)
            return super().write(data)

    def open_counted(
        file: Any, mode: str = "r", buffering: int = -1, encoding: Any = None, errors: Any = None,
        newline: Any = None, closefd: bool = True, opener: Any = None,
    ) -> Any:  # fmt: skip
        if not set(mode) & set("wxa+") or (path := _path(file)) is None:
            return opened(file, mode, buffering, encoding, errors, newline, closefd, opener)
        changes.count("open", path)
        raw = Raw(file, mode.replace("b", "").replace("t", ""), closefd, opener)
        if buffering == 0:
            return raw
        size = io.DEFAULT_BUFFER_SIZE if buffering < 2 else buffering
        buffered = io.BufferedRandom(raw, size) if "+" in mode else io.BufferedWriter(raw, size)
        if "b" in mode:
            return buffered
        text = io.TextIOWrapper(buffered, encoding, errors, newline, line_buffering=buffering == 1)
        text.mode = mode  # type: ignore[misc]
        return text

    def counted(kind: str, real: Callable[..., Any], paths: int) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            place = _path(arguments[paths - 1], named.get("dir_fd"))
            if place is not None:
                changes.count(kind, place)
            return real(*arguments, **named)

        return call

    def open_descriptor(path: Any, flags: int, *arguments: Any, **named: Any) -> int:
        if flags & _WRITING and (place := _path(path, named.get("dir_fd"))) is not None:
            changes.count("open", place)
        return real_open(path, flags, *arguments, **named)

    def sync(descriptor: Any) -> None:
        number = descriptor if isinstance(descriptor, int) else descriptor.fileno()
        changes.count("fsync", os.readlink(f"/proc/self/fd/{number}"))
        real_sync(descriptor)

    real_open, real_sync = os.open, os.fsync
    stand_ins = [(os, name, counted(name, getattr(os, name), 1)) for name in _ON_A_PATH]
    stand_ins += [(os, name, counted(name, getattr(os, name), 2)) for name in _ON_TWO_PATHS]
    others = [(os, "open", open_descriptor), (os, "fsync", sync), (io, "open", open_counted)]
    patches = [patch.object(*p) for p in (*stand_ins, *others, (builtins, "open", open_counted))]
    for one in patches:
        one.start()
    try:
        yield changes
    finally:
        for one in reversed(patches):
            one.stop()
