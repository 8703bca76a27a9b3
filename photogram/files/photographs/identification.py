"""The file of a photograph: read, recognised by its content, and checked to be one that photogram can use.

Nothing is decoded here. Of a DNG file the picture is the JPEG of full size in it.
"""

import hashlib
import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from PIL import Image, UnidentifiedImageError

from photogram.errors import ImageError, PhotogramError
from photogram.files.photographs.depth import Layout, damaged, layout_of, tiff_layout
from photogram.files.photographs.dng import Directory, first_directory, is_dng, is_tiff, preview_of, with_tags
from photogram.files.photographs.heic import is_heic, open_heic
from photogram.files.photographs.tag_packets import DAMAGE, recorded_warnings
from photogram.files.photographs.tags import PhotographTags, tags_of
from photogram.files.reading import check_size, read_rest

LARGEST_PIXELS = 1_000_000_000
"""Of one photograph: three times the largest aerial camera's, and 3 GB of memory when decoded."""

MOST_BYTES = 4_000_000_000
"""Of a photograph's file: that of LARGEST_PIXELS without any compression."""

FORMATS = ("JPEG", "TIFF", "PNG")
"""The only ones that are opened, whatever a file is called: Pillow starts Ghostscript for an EPS, for example. MPO,
JPEG with further pictures, is opened as JPEG; HEIF by its own library."""

_SIGNATURES = (b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"\x89PNG\r\n\x1a\n")

# Pillow warns of pictures above 89 megapixels, as web sites need it; open_picture has the limit that photographs need.
Image.MAX_IMAGE_PIXELS = None

_MODES = ("RGB", "L", "RGBA")
_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9
_LEADING_BYTES = 1 << 17  # more than most cameras write before the pixels
_END = bytes((0xFF, _END_OF_IMAGE))
_FURTHER_PICTURES = b"MPF\0"  # CIPA DC-007, Multi-Picture Format
JPEGS = ("JPEG", "MPO")


def segments_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the segments of a JPEG file (ITU-T T.81, annex B.1.1): the marker of each, where it begins behind that, and
    where it ends by the length that it states, which may be beyond the file."""
    end = 2
    while (match := _MARKER.search(data, end)) is not None:
        begin = match.end()
        end = begin + int.from_bytes(data[begin : begin + 2], "big")
        yield match[1][0], begin, end


def jpeg_is_whole(data: bytes) -> bool:
    """Tell whether the first picture of a JPEG file reaches its end marker.

    libjpeg fills what a card's lost clusters left as zeros with grey, and says nothing.
    """
    for marker, _, end in segments_of(data):
        if marker == _END_OF_IMAGE:
            return True
        if marker != START_OF_SCAN and end > len(data):
            return False
    return False


@contextmanager
def _opened_file(path: Path) -> Iterator[tuple[bytes, BinaryIO]]:
    """Open a picture's file after its first 16 bytes, and give these too."""
    try:
        size = check_size(path, MOST_BYTES)
        with path.open("rb") as stream:
            head = stream.read(16)
            if not (head.startswith(_SIGNATURES) or is_heic(head)):
                raise damaged(path, f"{size} bytes in no known image format")
            yield head, stream
    except FileNotFoundError as error:
        raise ImageError(f"photograph {path}: file not found: check the folder of photographs and the name") from error
    except OSError as error:
        raise ImageError(f"photograph {path}: cannot be read ({error.strerror}): check its permissions") from error


def read_content(path: Path) -> bytes:
    """Return the content of a photograph's file. Raises ImageError where it is missing, or no picture."""
    with _opened_file(path) as (head, stream):
        return head + read_rest(stream, MOST_BYTES)


def read_leading(path: Path) -> bytes:
    """Return what stands before the pixels of a JPEG file, the whole file of another format. Raises ImageError as
    read_content does."""
    with _opened_file(path) as (data, stream):
        if not data.startswith(_SIGNATURES[0]):
            return data + read_rest(stream, MOST_BYTES)
        wanted = _LEADING_BYTES
        while True:
            more = stream.read(wanted)
            data += more
            end = _end_of_headers(data)
            if end is not None or len(more) < wanted:
                return data[:end]
            wanted *= 4


def read_ends(path: Path) -> bytes:
    """Return a JPEG file without its pixels: what stands before them, and the marker of its end; the whole file of
    another format, of several pictures, and where the file does not end with that marker. Raises ImageError as
    read_content does."""
    leading = read_leading(path)
    if not leading.startswith(_SIGNATURES[0]):
        return leading
    with _opened_file(path) as (_, stream):
        size = stream.seek(-len(_END), os.SEEK_END)
        if size >= len(leading) and _FURTHER_PICTURES not in leading and stream.read() == _END:
            return leading + _END
    return read_content(path)


def _end_of_headers(data: bytes) -> int | None:
    """Return where the first scan of a JPEG file begins (ITU-T T.81, annex B.1), None where it has not begun."""
    for marker, _, end in segments_of(data):
        if marker == START_OF_SCAN:
            return end if end <= len(data) else None
    return None


@dataclass(frozen=True, eq=False)
class Identified:
    """A photograph whose format is known."""

    picture: Image.Image
    """Not decoded yet; of a DNG file its preview, with the tags of the file."""
    data: bytes
    """Content of the picture's file; of a DNG file the preview alone."""
    layout: Layout
    """How its pixels are stored."""

    def tags(self, path: Path) -> PhotographTags:
        """Return what its tags say. Raises ImageError where one holds nonsense; ``path`` is for its message."""
        return replace(tags_of(self.picture, path), bits=self.layout.bits)


def identify(path: Path, data: bytes) -> Identified:
    """Return the photograph that the content of a file is. Raises ImageError where it is damaged, has too many pixels,
    or is a DNG file without a picture of full size."""
    first = _first_directory(data)
    try:
        if is_dng(first):
            preview = preview_of(path, data, first)
            picture = with_tags(open_picture(path, preview, {}), data, first)
            if picture.format not in JPEGS:
                raise damaged(path, f"its preview is a {picture.format}")
            return Identified(picture, preview, layout_of(picture, preview))
        picture = open_picture(path, data, first)
        return Identified(picture, data, layout_of(picture, data))
    except PhotogramError:
        raise
    except DAMAGE as error:
        raise damaged(path, error) from error


def _first_directory(data: bytes) -> Directory:
    """Return the tags of the first directory of a TIFF, none of another file or where they cannot be read."""
    try:
        return first_directory(data) if is_tiff(data) else {}
    except DAMAGE:
        return {}  # Pillow says what is wrong


def open_picture(path: Path, data: bytes, first: Directory) -> Image.Image:
    """Return a picture of at most LARGEST_PIXELS, not decoded; ``first`` is the first directory of a TIFF. Raises
    ImageError where it has more, or is damaged."""
    try:
        with recorded_warnings():  # of a file whose further pictures are damaged, which are not read
            picture = open_heic(path, data) if is_heic(data) else Image.open(io.BytesIO(data), formats=FORMATS)
    except UnidentifiedImageError as error:
        unfit = tiff_layout(first).error if first else ""
        if unfit:
            raise _unfit(path, unfit) from error
        raise damaged(path, f"{len(data)} bytes in no known image format") from error
    except PhotogramError:
        raise
    except DAMAGE as error:
        raise damaged(path, error) from error
    if picture.width * picture.height > LARGEST_PIXELS:
        raise ImageError(
            f"photograph {path}: {picture.width} × {picture.height} px are {picture.width * picture.height / 1e6:.0f} "
            f"megapixels, photogram reads up to {LARGEST_PIXELS / 1e6:.0f}: give single photographs as taken, "
            "not a mosaic, or downsample them and scale their calibration"
        )
    return picture


def _unfit(path: Path, kind: str) -> ImageError:
    return ImageError(
        f"photograph {path}: {kind}, photogram reads grey or colour of 8 to 16 bits a channel, whole numbers from 0: "
        "convert all photographs alike, and export them as JPEG, or as 16-bit TIFF"
    )


def check_pixels(path: Path, size: tuple[int, int], size_px: tuple[int, int]) -> None:
    """Raise ImageError where a photograph's width and height are not those of its camera, ``size_px``."""
    if size != size_px:
        raise ImageError(
            f"photograph {path}: {size[0]} × {size[1]} px, but its camera has "
            f"{size_px[0]} × {size_px[1]} px: use the original photograph, or the camera that took it"
        )


def usable(path: Path, data: bytes, size_px: tuple[int, int] | None, sha256: str | None = None) -> Identified:
    """Return the photograph that the content of a file is, not decoded yet, one that photogram can use.

    Raises ImageError as ``identify``, and where its pixels are of another kind, width and height are not ``size_px``,
    the file has no end, or the SHA-256 of its content is not ``sha256``, in hex.
    """
    if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
        raise ImageError(
            f"photograph {path}: was modified since the run began: do not change photographs during a run, "
            "and run again"
        )
    file = identify(path, data)
    picture, layout = file.picture, file.layout
    if size_px is not None:
        check_pixels(path, picture.size, size_px)
    if layout.error if layout.is_deep else picture.mode not in _MODES:
        raise _unfit(path, layout.error or f"pixel type {picture.mode}")
    if picture.format in JPEGS and not jpeg_is_whole(file.data):
        raise damaged(path, "its image data is truncated")
    return file
