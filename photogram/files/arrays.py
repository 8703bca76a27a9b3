"""Arrays in npz files, read after their headers have been compared with the file."""

import os
import struct
import threading
import tokenize
import zipfile
import zlib
from functools import lru_cache
from io import BufferedReader, BytesIO
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

_LOCAL_HEADER_BYTES, _LOCAL_SIGNATURE = 30, b"PK\3\4"
"""What stands before each part of a zip file, in front of its name."""


def read_npz(path: Path, *names: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of an uncompressed npz file, those of some ``names`` or all.

    Raises OSError where it cannot be read or is damaged: an array that its own part of the file does not hold, for
    example, which a decoder would find memory for first.
    """
    try:
        size = regular_file_size(path)
        with path.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            parts = {part.filename.removesuffix(".npy"): part for part in archive.infolist()}
            return {name: _array(stream, part, size) for name, part in parts.items() if name in names or not names}
    except OSError:
        raise
    except DAMAGE as error:
        words = " ".join(str(error).split())[:200]
        raise OSError(f"damaged, {type(error).__name__}: {words}") from error


def _array(stream: BufferedReader, part: zipfile.ZipInfo, size: int) -> NDArray[Any]:
    """Return the array of a part of the archive, which is read at once. Raises ValueError where it has no room in it,
    or is not what its checksum says."""
    if part.compress_type != zipfile.ZIP_STORED or part.file_size > size:
        raise ValueError(f"{part.filename} is compressed, or larger than the file")
    stream.seek(part.header_offset)
    signature, *lengths = struct.unpack("<4s22xHH", stream.read(_LOCAL_HEADER_BYTES))
    stream.seek(sum(lengths), os.SEEK_CUR)  # its name once more, and what was added to it
    data = bytearray(part.file_size)
    if signature != _LOCAL_SIGNATURE or stream.readinto(data) != len(data) or zlib.crc32(data) != part.CRC:
        raise ValueError(f"{part.filename} is not what its checksum says")
    version = npy.read_magic(BytesIO(data[: npy.MAGIC_LEN]))
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"{part.filename} has format {version}")
    length = struct.Struct("<H" if version == (1, 0) else "<I")
    start = npy.MAGIC_LEN + length.size + length.unpack_from(data, npy.MAGIC_LEN)[0]
    shape, by_columns, kind = _header(version, bytes(data[npy.MAGIC_LEN : start]))
    count = prod(shape)
    if kind.hasobject or min(shape, default=0) < 0 or start + count * kind.itemsize != len(data):
        raise ValueError(f"{part.filename} is an array {shape} of {kind}, which is not what the file holds")
    flat = np.frombuffer(data, kind, count, start) if count else np.empty(count, kind)
    return flat.reshape(shape, order="F" if by_columns else "C")


@lru_cache(maxsize=256)
def _header(version: tuple[int, int], text: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, order by columns and type from the header of an array; those of blocks are alike."""
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    with _HEADERS:
        shape, by_columns, kind = read(BytesIO(text))
    return shape, by_columns, kind
