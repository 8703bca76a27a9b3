"""Files of photographs as cameras and converters write them: TIFF of any layout with tags, DNG, and HEIC."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pillow_heif
from numpy.typing import NDArray
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2
from PIL.TiffTags import BYTE, LONG, SHORT

FORMATS = {"u": 1, "i": 2, "f": 3}
Tags = Mapping[int, Any]


def tags_of_jpeg(path: Path) -> dict[int, Any]:
    """The tags of a JPEG with which a TIFF can be written."""
    with Image.open(path) as picture:
        exif = picture.getexif()
        tags: dict[int, Any] = {int(tag): exif[tag] for tag in (ExifTags.Base.Make, ExifTags.Base.Model) if tag in exif}
        for part in (ExifTags.IFD.Exif, ExifTags.IFD.GPSInfo):
            if own := dict(exif.get_ifd(part)):
                tags[int(part)] = own
        if "xmp" in picture.info:
            tags[700] = picture.info["xmp"]
    return tags


def write_heic(
    path: Path, pixels: NDArray[Any], jpeg: Path | None = None, orientation: int = 1, **options: Any
) -> Path:
    """Write pixels (height, width, 3) of 8 bits, or of 10 in 16, with the tags of a JPEG, and boxes that turn or mirror
    them as an EXIF orientation does; ``options`` of the encoder, without loss where there are none."""
    height, width = pixels.shape[:2]
    mode = "RGB" if pixels.dtype == np.uint8 else "RGB;10"
    heif = pillow_heif.from_bytes(mode, (width, height), pixels.tobytes(), bit_depth=8 * pixels.dtype.itemsize)
    exif, stream = Image.Exif(), io.BytesIO()
    if jpeg is not None:
        with Image.open(jpeg) as picture:
            exif, options = picture.getexif(), {"xmp": picture.info.get("xmp"), **options}
    exif[ExifTags.Base.Orientation] = orientation
    depth = {} if mode == "RGB" else {"bit_depth": 10}
    heif.save(
        stream, exif=exif.tobytes(), **{"quality": -1, "chroma": 444, "matrix_coefficients": 0, **depth, **options}
    )
    path.write_bytes(stream.getvalue())
    return path


def _directory(tags: Tags, at: int) -> bytes:
    """A directory at a place in its file, whose strip follows it."""
    directory = ImageFileDirectory_v2(prefix=b"II")
    for tag, value in {**tags, 273: (0,)}.items():
        if tag in (258, 339):
            directory.tagtype[tag] = SHORT
        elif tag == 700:
            directory.tagtype[tag] = BYTE
        elif tag in (330, 50720):
            directory.tagtype[tag] = LONG
        elif tag == 50706:
            directory.tagtype[tag] = BYTE
        directory[tag] = value
    return directory.tobytes(at)


def _pixel_tags(pixels: NDArray[Any], bits: int | None) -> dict[int, Any]:
    height, width, *rest = pixels.shape
    channels = rest[0] if rest else 1
    tags: dict[int, Any] = {
        256: width,
        257: height,
        258: (bits or 8 * pixels.dtype.itemsize,) * channels,
        259: 1,
        262: 2 if channels in (3, 4) else 1,
        277: channels,
        278: height,
        279: (pixels.nbytes,),
        339: (FORMATS[pixels.dtype.kind],) * channels,
    }
    return tags | ({338: (2,) * (channels - 3)} if channels > 3 else {})


def write_tiff(path: Path, pixels: NDArray[Any], tags: Tags | None = None, **changed: Any) -> Path:
    """Write pixels (height, width) or (height, width, channels) of any type as an uncompressed TIFF, with ``tags``;
    ``changed`` are tags in place of what the pixels ask for, ``t262`` for example."""
    own = _pixel_tags(pixels, None) | dict(tags or {}) | {int(name[1:]): value for name, value in changed.items()}
    begin = b"II*\0" + (8).to_bytes(4, "little")
    path.write_bytes(begin + _directory(own, 8) + pixels.astype(pixels.dtype.newbyteorder("<")).tobytes())
    return path


def write_dng(
    path: Path,
    raw: NDArray[np.uint16],
    previews: Sequence[Path],
    tags: Tags | None = None,
    crop: tuple[int, int] | None = None,
) -> Path:
    """Write a DNG: a thumbnail with the tags, the raw pixels of a colour filter array, and JPEG files as previews."""
    content, places = bytearray(8), []

    def add(own: Tags, pixels: bytes) -> None:
        places.append(len(content))
        content.extend(_directory(own, len(content)))
        content.extend(pixels)
        content.extend(b"\0" * (len(content) % 2))

    array = _pixel_tags(raw, None) | {254: 0, 262: 32803} | ({} if crop is None else {50720: crop})
    add(array, raw.astype("<u2").tobytes())
    for preview in previews:
        with Image.open(preview) as picture:
            width, height = picture.size
        data = preview.read_bytes()
        add(
            {254: 1, 256: width, 257: height, 258: (8, 8, 8), 259: 7, 262: 6, 277: 3, 278: height, 279: (len(data),)},
            data,
        )
    thumbnail = np.zeros((4, 6, 3), np.uint8)
    first = _pixel_tags(thumbnail, None) | {254: 1} | dict(tags or {})
    add(first | {330: tuple(places), 50706: bytes((1, 4, 0, 0))}, thumbnail.tobytes())
    content[:8] = b"II*\0" + places[-1].to_bytes(4, "little")
    path.write_bytes(bytes(content))
    return path
