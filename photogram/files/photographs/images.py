"""Photographs on disk: pixels, and what their EXIF and XMP tags say.

Pixels are returned as the sensor delivered them: the EXIF orientation is never applied, so that pixel coordinates and
the calibration stay those of the camera.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from xml.sax.saxutils import quoteattr

import numpy as np
from PIL import ExifTags, Image, UnidentifiedImageError
from PIL.TiffImagePlugin import IFDRational, TiffImageFile

from photogram.arrays import ByteArray, FloatArray
from photogram.errors import ImageError
from photogram.files.atomic import replacing
from photogram.files.photographs.tag_packets import DAMAGE, recorded_warnings
from photogram.files.photographs.tags import DJI_NUMBERS, Dewarp, PhotographTags, tags_of
from photogram.files.reading import check_size

__all__ = [
    "Dewarp",
    "PhotographTags",
    "check_photograph",
    "inspect_photograph",
    "jpeg_is_whole",
    "read_grey",
    "read_leading_tags",
    "read_patches",
    "read_pixels",
    "read_small",
    "read_tags",
    "read_window",
    "thumbnail",
    "write_photograph",
]


LARGEST_PIXELS = 1_000_000_000
"""Of one photograph: three times the largest aerial camera's, and 3 GB of memory when decoded."""

MOST_BYTES = 4_000_000_000
"""Of a photograph's file: that of LARGEST_PIXELS without any compression."""

FORMATS = ("JPEG", "TIFF", "PNG")
"""The only ones that are opened, whatever a file is called: Pillow starts Ghostscript for an EPS, for example. MPO,
JPEG with further pictures, is opened as JPEG."""

_SIGNATURES = (b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"\x89PNG\r\n\x1a\n")

# Pillow warns of pictures above 89 megapixels, as web sites need it; _identify has the limit that photographs need.
Image.MAX_IMAGE_PIXELS = None

_MODES = ("RGB", "L", "RGBA")
_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
_START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9
_SEQUENTIAL_FRAMES = (0xC0, 0xC1)
_LEADING_BYTES = 1 << 17  # more than most cameras write before the pixels
_PNG_DEPTH_AT = 24  # the ninth byte of the first chunk's data (ISO/IEC 15948, 11.2.2)
_ROWS_TOGETHER = 64  # a multiple of the rows of any decoder's unit: 8 times a sampling factor of 1, 2 or 4
_NAMESPACES = {
    "drone-dji": "http://www.dji.com/drone-dji/1.0/",
    "Camera": "http://pix4d.com/camera/1.0",
    "GPano": "http://ns.google.com/photos/1.0/panorama/",
}
_KINDS = {
    "thermal": ("drone-dji:ImageSource", "InfraredCamera"),
    "panorama": ("GPano:ProjectionType", "equirectangular"),
    "fisheye": ("Camera:ModelType", "fisheye"),
}


def jpeg_is_whole(data: bytes) -> bool:
    """Tell whether the first picture of a JPEG file reaches its end marker (ITU-T T.81, annex B.1.1).

    libjpeg fills what a card's lost clusters left as zeros with grey, and says nothing.
    """
    position = 2
    while (found := _MARKER.search(data, position)) is not None:
        marker = found[1][0]
        if marker == _END_OF_IMAGE:
            return True
        length = int.from_bytes(data[found.end() : found.end() + 2], "big")
        position = found.end() + length
        if marker != _START_OF_SCAN and position > len(data):
            return False
    return False


def _damaged(path: Path, reason: object) -> ImageError:
    return ImageError(
        f"photograph {path}: cannot be decoded ({reason}), the file is truncated or damaged: "
        "copy it again from the camera's card, or leave the photograph out"
    )


@contextmanager
def _opened_file(path: Path) -> Iterator[tuple[bytes, BinaryIO]]:
    """Open a picture's file after its first 16 bytes, and give these too."""
    try:
        size = check_size(path, MOST_BYTES)
        with path.open("rb") as stream:
            head = stream.read(16)
            if not head.startswith(_SIGNATURES):
                raise _damaged(path, f"{size} bytes in no known image format")
            yield head, stream
    except FileNotFoundError as fault:
        raise ImageError(f"photograph {path}: file not found: check the folder of photographs and the name") from fault
    except OSError as fault:
        raise ImageError(f"photograph {path}: cannot be read ({fault.strerror}): check its permissions") from fault


def _read(path: Path) -> bytes:
    with _opened_file(path) as (head, stream):
        return head + stream.read(MOST_BYTES)


def _read_leading(path: Path) -> bytes:
    """Return what stands before the pixels of a JPEG file, the whole file of another format."""
    with _opened_file(path) as (data, stream):
        if not data.startswith(_SIGNATURES[0]):
            return data + stream.read(MOST_BYTES)
        wanted = _LEADING_BYTES
        while True:
            more = stream.read(wanted)
            data += more
            end = _end_of_headers(data)
            if end is not None or len(more) < wanted:
                return data[:end]
            wanted *= 4


def _end_of_headers(data: bytes) -> int | None:
    """Return where the first scan of a JPEG file begins (ITU-T T.81, annex B.1), None where it has not begun."""
    position = 2
    while (found := _MARKER.search(data, position)) is not None:
        position = found.end() + int.from_bytes(data[found.end() : found.end() + 2], "big")
        if found[1][0] == _START_OF_SCAN:
            return position if position <= len(data) else None
    return None


def _identify(path: Path, data: bytes) -> Image.Image:
    try:
        with recorded_warnings():  # of a file whose further pictures are damaged, which are not read
            picture = Image.open(io.BytesIO(data), formats=FORMATS)
    except UnidentifiedImageError as fault:
        raise _damaged(path, f"{len(data)} bytes in no known image format") from fault
    except DAMAGE as fault:
        raise _damaged(path, fault) from fault
    if picture.width * picture.height > LARGEST_PIXELS:
        raise ImageError(
            f"photograph {path}: {picture.width} × {picture.height} px are {picture.width * picture.height / 1e6:.0f} "
            f"megapixels, photogram reads up to {LARGEST_PIXELS / 1e6:.0f}: give single photographs as taken, "
            "not a mosaic, or downsample them and scale their calibration"
        )
    return picture


def _check_pixels(path: Path, size: tuple[int, int], size_px: tuple[int, int]) -> None:
    if size != size_px:
        raise ImageError(
            f"photograph {path}: {size[0]} × {size[1]} px, but its camera has "
            f"{size_px[0]} × {size_px[1]} px: use the original photograph, or the camera that took it"
        )


def _cut_below(data: bytes, rows: int, height: int) -> bytes | None:
    """Return a JPEG file of ``height`` rows that ends after ``rows`` of them by what its frame header says (ITU-T T.81,
    annex B.2), None where its rows do not follow each other in one scan.

    A decoder goes no farther down, and takes that share of the time. A row needs what is above it, and where colours
    are at half the resolution the next one: up to 32 rows at the end may differ.
    """
    position, place, components = 2, 0, 0
    while (found := _MARKER.search(data, position)) is not None:
        marker, begin = found[1][0], found.end()
        if marker in _SEQUENTIAL_FRAMES:
            place, components = begin + 3, data[begin + 7]  # after the segment's length and the precision
        elif marker == _START_OF_SCAN:
            if not place or data[begin + 2] != components or data[place : place + 2] != height.to_bytes(2, "big"):
                return None
            return data[:place] + rows.to_bytes(2, "big") + data[place + 2 :]
        position = begin + int.from_bytes(data[begin : begin + 2], "big")
    return None


def _bits(picture: Image.Image, data: bytes) -> int:
    """Return the bits of a channel: of 16, Pillow keeps the upper 8 of a colour picture without a word."""
    if isinstance(picture, TiffImageFile):
        return int(max(picture.tag_v2.get(ExifTags.Base.BitsPerSample, (8,))))
    return data[_PNG_DEPTH_AT] if picture.format == "PNG" else 8


def _open(path: Path, size_px: tuple[int, int] | None, sha256: str | None = None) -> Image.Image:
    """Return the photograph, of the wanted size, content and kind, not decoded yet."""
    return _opened(path, _read(path), size_px, sha256)


def _opened(path: Path, data: bytes, size_px: tuple[int, int] | None, sha256: str | None = None) -> Image.Image:
    """Return the photograph of a file's content, as ``_open``."""
    if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
        raise ImageError(
            f"photograph {path}: was modified since the run began: do not change photographs during a run, "
            "and run again"
        )
    picture = _identify(path, data)
    if size_px is not None:
        _check_pixels(path, picture.size, size_px)
    bits = _bits(picture, data)
    if picture.mode not in _MODES or bits > 8:
        kind = f"{bits} bits a channel" if bits > 8 else f"pixel type {picture.mode}"
        raise ImageError(
            f"photograph {path}: {kind}, photogram reads 8-bit colour or grey: "
            "stretch all photographs alike to 8 bits, and export them as JPEG or TIFF"
        )
    if picture.format in ("JPEG", "MPO") and not jpeg_is_whole(data):
        raise _damaged(path, "its image data is truncated")
    return picture


def _decode(path: Path, picture: Image.Image) -> None:
    try:
        picture.load()
    except DAMAGE as fault:
        raise _damaged(path, fault) from fault


def read_pixels(path: Path | str, size_px: tuple[int, int] | None = None, sha256: str | None = None) -> ByteArray:
    """Return the photograph as red, green, blue (height, width, 3) uint8, pixels as the sensor delivered them.

    Raises ImageError where the file is missing or damaged, its width and height are not ``size_px``, or the SHA-256 of
    the content that is decoded is not ``sha256``, in hex.
    """
    path = Path(path)
    picture = _open(path, size_px, sha256)
    _decode(path, picture)
    return np.array(picture if picture.mode == "RGB" else picture.convert("RGB"))


def read_grey(path: Path, size_px: tuple[int, int] | None = None, sha256: str | None = None) -> ByteArray:
    """Return the photograph's luminance (height, width); a JPEG's own, without the detour over colour.

    Raises ImageError as read_pixels does.
    """
    picture = _open(path, size_px, sha256)
    picture.draft("L", None)
    _decode(path, picture)
    return np.array(picture.convert("L"))


def check_photograph(path: Path, size_px: tuple[int, int] | None = None, sha256: str | None = None) -> tuple[int, int]:
    """Decode the whole photograph, JPEG at an eighth of its size, and return its width and height.

    At an eighth every coefficient is still read, so the same damage is found in half the time or less. What libjpeg
    passes over in silence inside a picture that has its end marker is not found. Raises ImageError as read_pixels does.
    """
    picture = _open(path, size_px, sha256)
    size = picture.size
    picture.draft("L", (1, 1))
    _decode(path, picture)
    return size


def read_tags(path: Path) -> PhotographTags:
    """Return what the photograph's EXIF and XMP say; XMP comes first where both give the position, it has more digits.

    A sigma of zero counts as not given. XMP that is not valid XML is left out, which ``damage`` of the tags says.
    Damaged pixels go unnoticed. Raises ImageError where the file is missing or is no picture, or a tag holds nonsense.
    """
    return tags_of(_identify(path, _read(path)), path)


def read_leading_tags(path: Path, size_px: tuple[int, int]) -> PhotographTags:
    """Return what read_tags returns, of a JPEG file from what stands before its pixels: a twentieth of the time.

    Raises ImageError as read_tags does, and where the photograph is not of ``size_px``.
    """
    picture = _identify(path, _read_leading(path))
    _check_pixels(path, picture.size, size_px)
    return tags_of(picture, path)


def inspect_photograph(path: Path) -> PhotographTags:
    """Return what read_tags returns of a photograph that photogram can use, in one reading and without decoding it.

    Raises ImageError as read_tags does, and where the pixels are of another kind or the file has no end.
    """
    return tags_of(_open(path, None), path)


def thumbnail(path: Path) -> FloatArray:
    """Return the photograph's luminance (48, 64) as grey values from 0 to 255, JPEG decoded at an eighth of its size.

    Enough to tell one photograph from the next one of a flight. Raises ImageError as read_pixels does.
    """
    picture = _open(path, None)
    picture.draft("L", (64, 48))
    _decode(path, picture)
    return np.asarray(picture.convert("L").resize((64, 48), Image.Resampling.BOX), dtype=np.float64)


def read_small(path: Path, longest_px: int) -> ByteArray:
    """Return the photograph as red, green, blue (height, width, 3), reduced to ``longest_px`` along its longer side
    unless it is smaller; JPEG is decoded at an eighth of its size or more.

    Raises ImageError as read_pixels does.
    """
    picture = _open(path, None)
    scale = min(longest_px / max(picture.size), 1.0)
    size = max(round(picture.width * scale), 1), max(round(picture.height * scale), 1)
    picture.draft("RGB", size)
    _decode(path, picture)
    return np.array(picture.convert("RGB").resize(size, Image.Resampling.BOX))


def read_window(
    path: Path, box: tuple[int, int, int, int], reduction: int = 1, size_px: tuple[int, int] | None = None
) -> ByteArray:
    """Return a part of the photograph as red, green, blue (height, width, 3), reduced 1, 2, 4 or 8 times; each pixel of
    a reduced one is the mean of a square of so many, as far as the photograph reaches.

    ``box`` is left, upper, right, lower in reduced pixels, within ceil(width / reduction) and ceil(height / reduction).
    JPEG is decoded at the reduced size, and no farther down than the box. Raises ImageError as read_pixels does.
    """
    data = _read(path)
    picture = _opened(path, data, size_px)
    width, height = picture.size
    left, upper, right, lower = box
    rows = (lower * reduction // _ROWS_TOGETHER + 2) * _ROWS_TOGETHER
    if picture.format in ("JPEG", "MPO") and rows < height and (short := _cut_below(data, rows, height)) is not None:
        picture = _identify(path, short)
    if reduction > 1 and min(width, height) >= reduction:
        picture.draft("RGB", (width // reduction, picture.height // reduction))
    _decode(path, picture)
    if reduction == 1 or picture.width != width:
        return np.array(picture.crop(box).convert("RGB"))
    # the decoder has reduced nothing: all but JPEG
    whole = min(right * reduction, width), min(lower * reduction, height)
    part = picture.crop((left * reduction, upper * reduction, *whole)).convert("RGB")
    return np.array(part.reduce(reduction))


def read_patches(
    path: Path,
    boxes: Sequence[tuple[int, int, int, int]],
    size_px: tuple[int, int] | None = None,
    sha256: str | None = None,
) -> list[ByteArray]:
    """Return parts of the photograph as red, green, blue (height, width, 3) from decoding it once; a ``box`` is left,
    upper, right, lower in its pixels, within it. Raises ImageError as read_pixels does."""
    picture = _open(path, size_px, sha256)
    _decode(path, picture)
    return [np.array(picture.crop(box).convert("RGB")) for box in boxes]


def _rational(value: float, denominator: int) -> IFDRational:
    return IFDRational(round(value * denominator), denominator)


def _sexagesimal(degrees: float) -> tuple[IFDRational, IFDRational, IFDRational]:
    whole, minutes = divmod(abs(degrees) * 60.0, 60.0)
    return IFDRational(int(whole)), IFDRational(int(minutes)), _rational(minutes % 1.0 * 60.0, 1_000_000)


def _exif_of(tags: PhotographTags, width: int, height: int) -> Image.Exif:
    main = Image.Exif()
    exif, gps = main.get_ifd(ExifTags.IFD.Exif), main.get_ifd(ExifTags.IFD.GPSInfo)
    for tag, text in ((ExifTags.Base.Make, tags.make), (ExifTags.Base.Model, tags.model)):
        if text is not None:
            main[tag] = text
    for tag, text in (
        (ExifTags.Base.BodySerialNumber, tags.serial),
        (ExifTags.Base.LensModel, tags.lens),
        (ExifTags.Base.LensSerialNumber, tags.lens_serial),
    ):
        if text is not None:
            exif[tag] = text
    exif[ExifTags.Base.ExifImageWidth], exif[ExifTags.Base.ExifImageHeight] = width, height
    if tags.focal_mm is not None:
        exif[ExifTags.Base.FocalLength] = _rational(tags.focal_mm, 1000)
    if tags.focal_35mm_mm is not None:
        exif[ExifTags.Base.FocalLengthIn35mmFilm] = round(tags.focal_35mm_mm)
    if tags.pixels_per_mm is not None:
        exif[ExifTags.Base.FocalPlaneXResolution] = _rational(tags.pixels_per_mm, 1_000_000)
        exif[ExifTags.Base.FocalPlaneYResolution] = _rational(tags.pixels_per_mm, 1_000_000)
        exif[ExifTags.Base.FocalPlaneResolutionUnit] = 4
    if tags.time is not None:
        main[ExifTags.Base.DateTime] = exif[ExifTags.Base.DateTimeOriginal] = tags.time.strftime("%Y:%m:%d %H:%M:%S")
        exif[ExifTags.Base.SubsecTimeOriginal] = f"{tags.time.microsecond:06d}"
        if tags.time.utcoffset() is not None:
            zone = tags.time.strftime("%z")
            exif[ExifTags.Base.OffsetTimeOriginal] = f"{zone[:3]}:{zone[3:5]}"
    if tags.longitude_deg is not None and tags.latitude_deg is not None:
        gps[ExifTags.GPS.GPSLatitudeRef] = "N" if tags.latitude_deg >= 0 else "S"
        gps[ExifTags.GPS.GPSLatitude] = _sexagesimal(tags.latitude_deg)
        gps[ExifTags.GPS.GPSLongitudeRef] = "E" if tags.longitude_deg >= 0 else "W"
        gps[ExifTags.GPS.GPSLongitude] = _sexagesimal(tags.longitude_deg)
    if tags.height_m is not None:
        gps[ExifTags.GPS.GPSAltitudeRef] = b"\x01" if tags.height_m < 0 else b"\x00"
        gps[ExifTags.GPS.GPSAltitude] = _rational(abs(tags.height_m), 1000)
    if tags.gnss_horizontal_error_m is not None:
        gps[ExifTags.GPS.GPSHPositioningError] = _rational(tags.gnss_horizontal_error_m, 1000)
    return main


def _dewarp_of(lens: Dewarp) -> dict[str, str]:
    k1, k2, k3 = lens.radial
    numbers = (*lens.focal_px, *lens.centre_offset_px, k1, k2, *lens.tangential, k3)
    values = {"drone-dji:DewarpData": f"{lens.date};" + ",".join(repr(float(number)) for number in numbers)}
    if lens.size_px is not None:
        for axis, size in zip("XY", lens.size_px, strict=True):
            values[f"drone-dji:CalibratedOpticalCenter{axis}"] = f"{size / 2.0:.6f}"
    values["drone-dji:DewarpFlag"] = f"{lens.applied:d}"
    return values


def _xmp_of(tags: PhotographTags) -> bytes:
    values: dict[str, str] = {}

    def put(name: str, value: float | None, form: str) -> None:
        if value is not None:
            values[f"drone-dji:{name}"] = format(value, form)

    put("AbsoluteAltitude", tags.height_m, "+.3f")
    put("GpsLatitude", tags.latitude_deg, ".10f")
    put("GpsLongitude", tags.longitude_deg, ".10f")
    for field, name in DJI_NUMBERS.items():
        put(name, getattr(tags, field), "+.3f")
    for axis, speed in zip("XYZ", tags.velocity_m_s or (), strict=False):
        put(f"Flight{axis}Speed", speed, "+.2f")
    put("RtkFlag", tags.rtk_flag, "d")
    for name, sigma in zip(("RtkStdLon", "RtkStdLat", "RtkStdHgt"), tags.gnss_sigma_m or (), strict=False):
        put(name, sigma, ".5f")
    if tags.height_is_ellipsoidal is not None:
        values["drone-dji:AltitudeType"] = "RtkAlt" if tags.height_is_ellipsoidal else "PressureAlt"
    if tags.dewarp is not None:
        values |= _dewarp_of(tags.dewarp)
    if tags.calibrated_focal_mm is not None:
        values["Camera:PerspectiveFocalLength"] = repr(float(tags.calibrated_focal_mm))
    if tags.calibrated_radial is not None:
        numbers = (*tags.calibrated_radial, 0.0, 0.0)
        values["Camera:PerspectiveDistortion"] = ",".join(repr(float(number)) for number in numbers)
    if tags.band is not None:
        values["Camera:BandName"] = tags.band
    if tags.kind in _KINDS:
        name, value = _KINDS[tags.kind]
        values[name] = value
    used = [prefix for prefix in _NAMESPACES if any(name.startswith(f"{prefix}:") for name in values)] or ["drone-dji"]
    attributes = "".join(f'\n   xmlns:{prefix}="{_NAMESPACES[prefix]}"' for prefix in used)
    attributes += "".join(f"\n   {name}={quoteattr(value)}" for name, value in values.items())
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        f'  <rdf:Description rdf:about="DJI Meta Data"{attributes}/>\n'
        " </rdf:RDF>\n</x:xmpmeta>\n"
    ).encode()


def write_photograph(path: Path, pixels: ByteArray, tags: PhotographTags, quality: int = 95) -> None:
    """Write ``pixels`` (height, width, 3) as a JPEG with EXIF and XMP as a DJI drone writes them; whole or not at all.

    Positions keep 1e-10 degrees and 1 mm, angles 0.001 degrees. Raises ValueError where ``tags`` give another size, and
    WorkspaceError where the file cannot be written.
    """
    height, width = pixels.shape[:2]
    if (tags.width_px or width, tags.height_px or height) != (width, height):
        raise ValueError(f"{path}: pixels of {width} × {height}, tags of {tags.width_px} × {tags.height_px}")
    picture = Image.fromarray(np.ascontiguousarray(pixels, dtype=np.uint8))

    with replacing(path) as partial:
        picture.save(
            partial, "JPEG", quality=quality, subsampling="4:2:2", exif=_exif_of(tags, width, height), xmp=_xmp_of(tags)
        )
