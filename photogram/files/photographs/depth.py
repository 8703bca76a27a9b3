"""Photographs of 9 to 16 bits a channel, TIFF, PNG and HEIF: their values, and the stretch that makes 8 bits of them.

Pillow keeps the upper 8 bits of a colour picture without a word, and has no 16-bit colour of its own; GDAL decodes
TIFF and PNG whole. A stretch is linear and the same for all photographs and channels of a camera, so neither colours
nor the differences between photographs change.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.TiffImagePlugin import TiffImageFile
from rasterio._err import CPLE_BaseError
from rasterio.errors import RasterioError
from rasterio.io import DatasetReader, MemoryFile
from rasterio.windows import Window

from photogram.arrays import ByteArray
from photogram.errors import ImageError
from photogram.files.photographs.heic import FORMAT, deep_values, is_heic
from photogram.files.photographs.tag_packets import DAMAGE, recorded_warnings

Values = NDArray[np.uint16]

MOST_BITS = 16
LARGEST_VALUE = 2**MOST_BITS - 1

_BITS, _SAMPLES, _SAMPLE_FORMAT, _PHOTOMETRIC = 258, 277, 339, 262  # tags of TIFF 6.0, sections 8 and 19
_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB = 0, 1, 2
_UNSIGNED, _SIGNED, _FLOATING = 1, 2, 3
_PNG_DEPTH_AT, _PNG_COLOUR_AT = 24, 25  # in the first chunk's data (ISO/IEC 15948, 11.2.2)
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_ROWS = 256  # decoded at a time: what is not stretched yet takes twice the memory
_DECODING = (RasterioError, CPLE_BaseError, *DAMAGE)


@dataclass(frozen=True)
class Stretch:
    """Which pixel values become 0 and 255: those between follow linearly, those beyond are as these."""

    low: int
    """Value that becomes 0."""
    high: int
    """Value that becomes 255."""

    def __post_init__(self) -> None:
        if not 0 <= self.low < self.high <= LARGEST_VALUE:
            raise ImageError(f"a stretch from {self.low} to {self.high}: it must rise within 0 to {LARGEST_VALUE}")

    @cached_property
    def _table(self) -> ByteArray:
        share = (np.arange(LARGEST_VALUE + 1) - self.low) / (self.high - self.low)
        return np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)

    def applied(self, values: Values) -> ByteArray:
        """Return 8-bit pixels of pixel values, in their shape."""
        return self._table[values]


@dataclass(frozen=True)
class Layout:
    """How the pixels of a picture are stored."""

    bits: int
    """Of a channel."""
    channels: int
    """Of a pixel, transparency among them."""
    inverted: bool = False
    """Whether 0 is white."""
    error: str = ""
    """Why photogram cannot use such pixels, or empty."""

    @property
    def is_deep(self) -> bool:
        """Return whether a channel has more than 8 bits."""
        return self.bits > 8


def _numbers(tags: Mapping[int, Any], tag: int, default: int) -> tuple[int, ...]:
    value = tags.get(tag, default)
    return tuple(int(v) for v in value) if isinstance(value, tuple) else (int(value),)


def tiff_layout(tags: Mapping[int, Any]) -> Layout:
    """Return how the pixels of a TIFF are stored, from its tags (TIFF 6.0, sections 4 to 6 and 19). Raises TypeError or
    ValueError where a tag holds nonsense."""
    bits, formats = _numbers(tags, _BITS, 1), _numbers(tags, _SAMPLE_FORMAT, _UNSIGNED)
    channels, photometric = _numbers(tags, _SAMPLES, 1)[0], _numbers(tags, _PHOTOMETRIC, _BLACK_IS_ZERO)[0]
    depth, error = max(bits), ""
    if set(formats) & {_SIGNED, _FLOATING}:
        error = f"{depth}-bit {'floating-point' if _FLOATING in formats else 'signed'} pixels"
    elif depth > MOST_BITS or len(set(bits)) > 1:
        error = f"{', '.join(map(str, sorted(set(bits))))} bits a channel"
    elif channels not in ((1,) if photometric in (_WHITE_IS_ZERO, _BLACK_IS_ZERO) else (3, 4)):
        error = f"{channels} channels of {depth} bits"
    elif photometric not in (_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB):
        error = f"{depth}-bit pixels that are neither grey nor red, green, blue"
    return Layout(depth, channels, photometric == _WHITE_IS_ZERO, error)


def layout_of(picture: Image.Image, data: bytes) -> Layout:
    """Return how the pixels of an identified picture, the content of whose file is ``data``, are stored."""
    if isinstance(picture, TiffImageFile):
        return tiff_layout(picture.tag_v2)
    bits, channels = 8, len(picture.getbands())
    if picture.format == FORMAT:
        bits = picture.info["bit_depth"]
    elif picture.format == "PNG":
        bits, channels = data[_PNG_DEPTH_AT], _PNG_CHANNELS.get(data[_PNG_COLOUR_AT], 0)
    return Layout(bits, channels, error=f"{channels} channels of {bits} bits" if bits > 8 and channels == 2 else "")


def _strips(data: bytes, layout: Layout) -> Iterator[tuple[int, Values]]:
    """Yield the first row of each strip of a picture and its values (rows, width) or (rows, width, 3)."""
    if is_heic(data):
        yield 0, deep_values(data)
        return
    bands = 1 if layout.channels == 1 else [1, 2, 3]  # transparency is left out
    with MemoryFile(data) as memory:
        with recorded_warnings():  # of a picture without a place on Earth
            opened = memory.open(driver=_driver(data))
        with opened as dataset:
            if set(dataset.dtypes) != {"uint16"} or dataset.count != layout.channels:
                raise ValueError(f"{dataset.count} channels of {dataset.dtypes[0]}")
            for top in range(0, dataset.height, _ROWS):
                yield top, _strip(dataset, bands, top, layout.inverted, 2**layout.bits - 1)


def _driver(data: bytes) -> str:
    return "PNG" if data.startswith(b"\x89PNG") else "GTiff"


def _strip(dataset: DatasetReader, bands: int | list[int], top: int, inverted: bool, white: int) -> Values:
    window = Window(0, top, dataset.width, min(_ROWS, dataset.height - top))
    values: Values = dataset.read(bands, window=window)
    if inverted:
        values = (white - values).astype(np.uint16)
    return values if values.ndim == 2 else np.moveaxis(values, 0, 2)


def damaged(path: Path, reason: object) -> ImageError:
    """Return the error of a photograph that cannot be decoded, with the reason in the words of the decoder."""
    words = " ".join(str(reason).split())
    return ImageError(
        f"photograph {path}: cannot be decoded ({words}), the file is truncated or damaged: "
        "copy it again from the camera's card, or leave the photograph out"
    )


@contextmanager
def _damage_of(path: Path) -> Iterator[None]:
    """Raise what decoding a photograph within the block raises as an ImageError."""
    try:
        yield
    except _DECODING as error:
        raise damaged(path, error.__cause__ or error) from error  # rasterio keeps what GDAL said as the cause


def sampled_values(path: Path, data: bytes, layout: Layout, step: int) -> Values:
    """Return every ``step``-th pixel value along rows and columns of a photograph, all channels, (n,), while all of it
    is decoded. Raises ImageError where that is not possible."""
    with _damage_of(path):
        return np.concatenate([values[-top % step :: step, ::step].ravel() for top, values in _strips(data, layout)])


def stretched_picture(
    path: Path, data: bytes, layout: Layout, size_px: tuple[int, int], stretch: Stretch
) -> Image.Image:
    """Return the 8-bit picture, grey or red, green, blue, that a stretch makes of a photograph of ``size_px``. Raises
    ImageError where it cannot be decoded."""
    width, height = size_px
    pixels = np.empty((height, width) if layout.channels == 1 else (height, width, 3), np.uint8)
    with _damage_of(path):
        for top, values in _strips(data, layout):
            pixels[top : top + len(values)] = stretch.applied(values)
    return Image.fromarray(pixels)
