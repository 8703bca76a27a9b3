"""Raw photographs in DNG files: the JPEG of full size that a camera or converter has put beside the raw pixels.

A DNG file is a TIFF whose first directory holds the tags and a small preview, and its sub-directories the raw pixels
and further previews (Adobe, Digital Negative Specification 1.7, chapter 2). Raw pixels are not developed here.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from photogram.errors import ImageError
from photogram.files.photographs.tag_packets import recorded_warnings

Directory = Mapping[int, Any]

MOST_DIRECTORIES = 32
"""Sub-directories that are looked at; cameras write up to five."""

_VERSION, _SUB_DIRECTORIES, _CROP_SIZE, _XMP = 50706, 330, 50720, 700
_WIDTH, _HEIGHT, _COMPRESSION, _PHOTOMETRIC, _OFFSETS, _COUNTS = 256, 257, 259, 262, 273, 279
_LAYOUT = (258, 277, 339)
_TAGS = (
    *(_VERSION, _SUB_DIRECTORIES, _CROP_SIZE, _XMP, _WIDTH, _HEIGHT),
    *(_COMPRESSION, _PHOTOMETRIC, _OFFSETS, _COUNTS, *_LAYOUT),
)
_JPEG = 7
_RAW = (32803, 34892)  # photometric interpretation: a colour filter array, linear raw
_RENDERED = (2, 6)  # red, green, blue, or luminance and colour differences
_TIFF = (b"II*\0", b"MM\0*")
_REMEDY = (
    "convert all photographs alike with a raw converter, to 16-bit TIFF or JPEG, without correction of the lens, "
    "rotation or crop"
)


def is_tiff(data: bytes) -> bool:
    """Return whether a file begins as a TIFF."""
    return data.startswith(_TIFF)


def first_directory(data: bytes) -> Directory:
    """Return the tags of the first directory of a TIFF. Raises what DAMAGE holds where they cannot be read."""
    return _directory(data, int.from_bytes(data[4:8], "little" if data.startswith(b"II") else "big"))


def _directory(data: bytes, offset: int) -> Directory:
    if not 8 <= offset < len(data):
        raise ValueError(f"a directory at byte {offset} of {len(data)}")
    directory = ImageFileDirectory_v2(data[:8])
    stream = io.BytesIO(data)
    stream.seek(offset)
    with recorded_warnings():
        directory.load(stream)
        return {tag: directory[tag] for tag in _TAGS if tag in directory}


def is_dng(directory: Directory) -> bool:
    """Return whether a TIFF with this first directory is a DNG file."""
    return _VERSION in directory


def _size(directory: Directory) -> tuple[int, int]:
    return int(directory.get(_WIDTH, 0)), int(directory.get(_HEIGHT, 0))


def _whole_sizes(directories: list[Directory]) -> list[tuple[int, int]]:
    """Return the sizes that a picture of the whole photograph may have: what the raw pixels are cropped to by default,
    first, and all of them."""
    sizes = list[tuple[int, int]]()
    for directory in directories:
        if directory.get(_PHOTOMETRIC) in _RAW:
            crop = directory.get(_CROP_SIZE)
            cropped = [(round(float(crop[0])), round(float(crop[1])))] if isinstance(crop, tuple) else []
            sizes += [*cropped, _size(directory)]
    return sizes


def _jpeg_of(data: bytes, directory: Directory) -> bytes | None:
    """Return the JPEG file that a directory holds in one strip, None where it holds anything else."""
    if directory.get(_COMPRESSION) != _JPEG or directory.get(_PHOTOMETRIC) not in _RENDERED:
        return None
    offset, count = directory.get(_OFFSETS), directory.get(_COUNTS)
    if not isinstance(offset, tuple) or not isinstance(count, tuple) or len(offset) != 1 or len(count) != 1:
        return None
    return data[offset[0] : offset[0] + count[0]]


def preview_of(path: Path, data: bytes, first: Directory) -> bytes:
    """Return the JPEG of full size in a DNG file with the content ``data`` and the first directory ``first``.

    Raises ImageError where it has none, and what DAMAGE holds where its directories cannot be read.
    """
    offsets = first.get(_SUB_DIRECTORIES, ())
    listed = offsets if isinstance(offsets, tuple) else (offsets,)
    directories = [first, *(_directory(data, int(offset)) for offset in listed[:MOST_DIRECTORIES])]
    sizes, previews = _whole_sizes(directories), list[tuple[int, int]]()
    if not sizes:
        raise ValueError("no raw pixels among its directories")
    for directory in directories:
        jpeg = _jpeg_of(data, directory)
        if jpeg is not None:
            previews.append(_size(directory))
            if previews[-1] in sizes:
                return jpeg
    width, height = sizes[0]
    largest = max(previews, key=lambda size: size[0] * size[1], default=None)
    has = "no preview in it" if largest is None else f"its largest preview has {largest[0]} × {largest[1]} px"
    raise ImageError(
        f"photograph {path}: DNG of {width} × {height} px, {has}, and photogram develops no raw: {_REMEDY}"
    )


def with_tags(preview: Image.Image, data: bytes, first: Directory) -> Image.Image:
    """Give an opened preview the EXIF and XMP of its DNG file, in place of its own."""
    preview.info = {"exif": data}
    if isinstance(first.get(_XMP), bytes):
        preview.info["xmp"] = first[_XMP]
    return preview
