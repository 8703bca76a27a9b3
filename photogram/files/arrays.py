"""Arrays in npz files, read after their headers have been compared with the file."""

import struct
import threading
import tokenize
import zipfile
import zlib
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from photogram.files.reading import regular_file_size

DAMAGE = (
    OSError,
    ValueError,
    LookupError,
    TypeError,
    EOFError,
    SyntaxError,
    RuntimeError,
    OverflowError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy and zipfile raise where a file is damaged."""


_HEADERS = threading.Lock()
"""Python's parser, which reads headers, may fail where two threads use it at once (CPython issue 106905)."""


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an uncompressed npz file.

    Raises OSError where it cannot be read or is damaged: an array that its own part of the file does not hold, for
    example, which a decoder would find memory for first.
    """
    try:
        size = regular_file_size(path)
        with zipfile.ZipFile(path) as archive:
            return {part.filename.removesuffix(".npy"): _array(archive, part, size) for part in archive.infolist()}
    except OSError:
        raise
    except DAMAGE as error:
        words = " ".join(str(error).split())[:200]
        raise OSError(f"damaged, {type(error).__name__}: {words}") from error


def _array(archive: zipfile.ZipFile, part: zipfile.ZipInfo, size: int) -> NDArray[Any]:
    """Return the array of a part of the archive. Raises ValueError where it has no room in it."""
    if part.compress_type != zipfile.ZIP_STORED or part.file_size > size:
        raise ValueError(f"{part.filename} is compressed, or larger than the file")
    with archive.open(part) as stream:
        version = npy.read_magic(stream)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"{part.filename} has format {version}")
        read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        with _HEADERS:
            shape, by_columns, kind = read_header(stream)
        count = prod(shape)
        needed = stream.tell() + count * kind.itemsize
        if kind.hasobject or min(shape, default=0) < 0 or needed != part.file_size:
            raise ValueError(f"{part.filename} is an array {shape} of {kind}, which is not what the file holds")
        data = bytearray(stream.read())  # to the end, where its checksum is compared
    flat = np.frombuffer(data, kind, count) if data else np.empty(count, kind)
    return flat.reshape(shape, order="F" if by_columns else "C")
