"""Photographs in HEIF files (HEIC), which the extra ``heic`` decodes: their pixels as the sensor delivered them.

A HEIF file says how its picture is to be turned for looking at (``irot``, ``imir``; ISO/IEC 23008-12, 6.5.10 and
6.5.12), and decoders do so. Photographs of one camera held upright and level would then be of two sizes, so the boxes
are made to turn by nothing before anything is decoded, and the EXIF orientation is not applied, as elsewhere.
"""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from photogram.errors import ImageError

FORMAT = "HEIF"
"""As Pillow calls it."""

_BRANDS = frozenset((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"hevm", b"hevs", b"mif1", b"msf1"))
_TURNED = (b"irot", b"imir")
_META_HEADER = 4  # version and flags of a full box (ISO/IEC 14496-12, 4.2)


def is_heic(data: bytes) -> bool:
    """Return whether a file begins as a HEIF file of pictures compressed by HEVC."""
    return data[4:8] == b"ftyp" and data[8:12] in _BRANDS


def _boxes(data: bytes, begin: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield the boxes between two places (ISO/IEC 14496-12, 4.2): type, where the content begins, and where it ends."""
    while begin + 8 <= end:
        size, header = int.from_bytes(data[begin : begin + 4], "big"), 8
        if size == 1:
            size, header = int.from_bytes(data[begin + 8 : begin + 16], "big"), 16
        elif size == 0:
            size = end - begin
        if size < header or begin + size > end:
            return  # the decoder says what is damaged
        yield data[begin + 4 : begin + 8], begin + header, begin + size
        begin += size


def _content(data: bytes, place: tuple[int, int], kind: bytes) -> tuple[int, int]:
    """Return where the first box of a kind has its content, an empty place where there is none."""
    return next(((begin, end) for own, begin, end in _boxes(data, *place) if own == kind), (0, 0))


def unturned(data: bytes) -> bytes:
    """Return the content of a HEIF file whose pictures are not turned or mirrored when they are decoded."""
    begin, end = _content(data, (0, len(data)), b"meta")
    properties = _content(data, _content(data, (begin + _META_HEADER, end), b"iprp"), b"ipco")
    changed = bytearray(data)
    for kind, first, last in _boxes(data, *properties):
        if kind in _TURNED and last == first + 1:
            changed[first - 4 : last] = b"irot\0"  # a rotation by 0
    return bytes(changed)


def open_heic(path: Path, data: bytes) -> Image.Image:
    """Return the picture of a HEIF file, not decoded yet, with its EXIF and XMP. Raises ImageError where the extra is
    not installed, SyntaxError where the file is damaged."""
    try:
        from pillow_heif import HeifImageFile
    except ImportError as error:
        raise ImageError(
            f'photograph {path}: HEIC, which this installation does not decode: pip install "photogram[heic]", or '
            "convert all photographs alike to JPEG, with their tags"
        ) from error
    picture: Image.Image = HeifImageFile(io.BytesIO(unturned(data)))
    picture.info["thumbnails"] = []  # else a reduced picture is an embedded one, of whatever size
    return picture


def deep_values(data: bytes) -> NDArray[np.uint16]:
    """Return the values of a HEIF file of more than 8 bits a channel, (height, width) or (height, width, 3). Raises
    what DAMAGE holds where it cannot be decoded."""
    from pillow_heif import open_heif

    whole = np.asarray(open_heif(unturned(data), convert_hdr_to_8bit=False, hdr_to_16bit=False))
    return np.asarray(whole[..., :3] if whole.ndim == 3 else whole, dtype=np.uint16)
