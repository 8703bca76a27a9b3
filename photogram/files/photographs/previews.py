"""Small pictures of photographs, as many as fit into so many bytes, for pages."""

import io
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from PIL import Image

from photogram.arrays import ByteArray
from photogram.errors import ImageError
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.images import read_small
from photogram.wording import Progress

MAXIMUM_BYTES = 3_000_000
"""Of all previews of a page together: four million characters in base64."""

_STEPS = ((320, 72), (256, 68), (208, 64), (160, 58), (128, 52), (96, 46), (72, 40))
_BYTES_PER_PIXEL = 0.2  # of a JPEG at these qualities, about


def _jpeg(pixels: ByteArray, longest_px: int, quality: int) -> bytes:
    picture = Image.fromarray(pixels)
    picture.thumbnail((longest_px, longest_px), Image.Resampling.LANCZOS, reducing_gap=None)
    stream = io.BytesIO()
    picture.save(stream, "JPEG", quality=quality, optimize=True, subsampling="4:2:0")
    return stream.getvalue()


def previews(
    paths: Mapping[str, Path],
    progress: Progress,
    maximum_bytes: int = MAXIMUM_BYTES,
    stretches: Mapping[str, Stretch] = MappingProxyType({}),
) -> tuple[dict[str, bytes], dict[str, str]]:
    """Return small JPEGs of photographs by their names, and why others have none.

    ``stretches`` are those of photographs of more than 8 bits.

    All are of one size, at most 320 px along the longer side, the largest with which they fit into ``maximum_bytes``;
    where even 72 px are too much there are none, and the second mapping says so of all. Pixels lie as the sensor
    delivered them.
    """
    count = max(len(paths), 1)
    start = next(
        (k for k, (px, _) in enumerate(_STEPS) if count * 0.75 * px**2 * _BYTES_PER_PIXEL <= maximum_bytes),
        len(_STEPS) - 1,
    )
    pixels: dict[str, ByteArray] = {}
    absent: dict[str, str] = {}
    for done, (name, path) in enumerate(paths.items()):
        progress(done, len(paths), "")
        try:
            pixels[name] = read_small(path, _STEPS[start][0], stretches.get(name))
        except ImageError as error:
            absent[name] = str(error)
    for longest_px, quality in _STEPS[start:]:
        made = {name: _jpeg(values, longest_px, quality) for name, values in pixels.items()}
        if sum(map(len, made.values())) <= maximum_bytes:
            return made, absent
    return {}, absent | dict.fromkeys(pixels, f"{len(pixels)} photographs are too many for one page")
