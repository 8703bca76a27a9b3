"""Arrays in npz files, read after their headers have been held against the file."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from photogram.files.reading import ordinary_size

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


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an uncompressed npz file.

    Raises OSError where it cannot be read or is damaged: an array that its own part of the file does not hold, for
    example, which a decoder would find memory for first.
    """
    try:
        size = ordinary_size(path)
        with zipfile.ZipFile(path) as archive:
            for part in archive.infolist():
                _check(archive, part, size)
        with np.load(path, allow_pickle=False) as loaded:
            return {name: loaded[name] for name in loaded.files}
    except OSError:
        raise
    except DAMAGE as fault:
        words = " ".join(str(fault).split())[:200]
        raise OSError(f"damaged, {type(fault).__name__}: {words}") from fault


def _check(archive: zipfile.ZipFile, part: zipfile.ZipInfo, size: int) -> None:
    """Raise ValueError unless a part of the archive is an array that has room in it."""
    if part.compress_type != zipfile.ZIP_STORED or part.file_size > size:
        raise ValueError(f"{part.filename} is compressed, or larger than the file")
    with archive.open(part) as stream:
        version = npy.read_magic(stream)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"{part.filename} has format {version}")
        read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = read_header(stream)
        needed = stream.tell() + prod(shape) * kind.itemsize
    if kind.hasobject or min(shape, default=0) < 0 or needed != part.file_size:
        raise ValueError(f"{part.filename} is an array {shape} of {kind}, which is not what the file holds")
