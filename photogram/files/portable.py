"""What systems do differently: links, locks of files, and paths from one drive to another.

POSIX locks a file as a whole. Windows locks bytes of it: one that lies far behind the end of every file that is locked
here, so that others can read the file. Either lock goes with the process, however it ends.
"""

import errno
import os
from importlib import import_module
from pathlib import Path

_LOCKED_BYTE = 2**30


def through_no_link(path: str, flags: int) -> int:
    """Open a file as the ``opener`` of ``open``. Raises OSError where ``path`` is a link."""
    if not hasattr(os, "O_NOFOLLOW") and os.path.islink(path):
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), path)
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def try_lock(descriptor: int, *, shared: bool = False) -> bool:
    """Lock a file that is open, by itself or ``shared`` with others that only look, and return whether nobody else has
    locked it; Windows shares no lock. Raises OSError where its file system has no locks."""
    try:
        fcntl = import_module("fcntl")
    except ImportError:
        return _try_lock_byte(descriptor)
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _try_lock_byte(descriptor: int) -> bool:
    msvcrt = import_module("msvcrt")
    os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EDEADLK):
            raise
        return False
    finally:
        os.lseek(descriptor, 0, os.SEEK_SET)
    return True


def path_from(folder: Path, path: Path) -> Path:
    """Return the way from a folder to ``path``; ``path`` itself, absolute, where it lies on another drive."""
    try:
        return Path(os.path.relpath(path.absolute(), folder.absolute()))
    except ValueError:  # Windows alone has drives
        return path.absolute()
