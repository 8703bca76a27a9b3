"""Files of others read whole: regular files only, and no more of them than they may sensibly hold."""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

MEGABYTE = 1_000_000
_KINDS = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def regular_file_size(path: Path) -> int:
    """Return the size of a regular file in bytes. Raises OSError, its ``strerror`` in words, where it is something
    else or cannot be looked at.

    A pipe would be waited for, a device such as /dev/zero has no end.
    """
    try:
        status = path.stat()
    except ValueError as error:  # a null character in its name
        raise OSError(errno.EINVAL, "its name contains a null character") from error
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    for is_kind, words in _KINDS:
        if is_kind(status.st_mode):
            raise OSError(errno.EINVAL, f"it is {words}, not a file")
    return status.st_size


def check_size(path: Path, most_bytes: int) -> int:
    """Return the size of a regular file of at most so many bytes. Raises OSError as regular_file_size does, and where
    it is larger."""
    size = regular_file_size(path)
    if size > most_bytes:
        raise OSError(
            errno.EFBIG, f"it has {size / MEGABYTE:.0f} MB, at most {most_bytes / MEGABYTE:.0f} MB are read here"
        )
    return size


def read_rest(stream: BinaryIO, most_bytes: int) -> bytes:
    """Return what is left of an open file, at most so many bytes. Python sets aside as much memory as it is asked to
    read: that is the size of the file, unless there turns out to be more."""
    left = max(os.fstat(stream.fileno()).st_size - stream.tell(), 0)
    data = stream.read(min(left, most_bytes))
    more = stream.read(1) if len(data) < most_bytes else b""
    return data + more + stream.read(most_bytes - len(data) - 1) if more else data


def read_whole(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file of at most so many bytes. Raises OSError as check_size does."""
    check_size(path, most_bytes)
    with path.open("rb") as stream:
        data = read_rest(stream, most_bytes + 1)
    if len(data) > most_bytes:  # it has grown, or its file system does not say how large it is
        raise OSError(errno.EFBIG, f"it has more than the {most_bytes / MEGABYTE:.0f} MB that are read here")
    return data
