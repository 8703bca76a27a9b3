"""Photographs on disk: pixels, and what their EXIF and XMP tags say.

Pixels are returned as the sensor delivered them: the EXIF orientation is never applied, so that pixel coordinates and
the calibration stay those of the camera. Those of 9 to 16 bits a channel are stretched to 8 bits where they are read.
"""

from collections.abc import Sequence
from math import isqrt
from pathlib import Path
from xml.sax.saxutils import quoteattr

import cv2
import numpy as np
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from photogram.arrays import ByteArray, FloatArray
from photogram.errors import ImageError
from photogram.files.atomic import replacing
from photogram.files.photographs.depth import Stretch, Values, damaged, sampled_values, stretched_picture
from photogram.files.photographs.identification import (
    JPEGS,
    START_OF_SCAN,
    Identified,
    check_pixels,
    identify,
    open_picture,
    read_content,
    read_ends,
    read_leading,
    segments_of,
    usable,
)
from photogram.files.photographs.tag_packets import DAMAGE
from photogram.files.photographs.tags import DJI_NUMBERS, Dewarp, PhotographTags

_SEQUENTIAL_FRAMES = (0xC0, 0xC1)
_SAMPLED_PIXELS = 500_000  # at least, of a photograph that has so many
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


def _cut_below(data: bytes, rows: int, height: int) -> bytes | None:
    """Return a JPEG file of ``height`` rows that ends after ``rows`` of them by what its frame header says (ITU-T T.81,
    annex B.2), None where its rows do not follow each other in one scan.

    A decoder goes no farther down, and takes that share of the time. A row needs what is above it, and where colours
    are at half the resolution the next one: up to 32 rows at the end may differ.
    """
    place, components = 0, 0
    for marker, begin, _ in segments_of(data):
        if marker in _SEQUENTIAL_FRAMES:
            place, components = begin + 3, data[begin + 7]  # after the segment's length and the precision
        elif marker == START_OF_SCAN:
            if not place or data[begin + 2] != components or data[place : place + 2] != height.to_bytes(2, "big"):
                return None
            return data[:place] + rows.to_bytes(2, "big") + data[place + 2 :]
    return None


def _open(
    path: Path, size_px: tuple[int, int] | None, sha256: str | None = None, stretch: Stretch | None = None
) -> Image.Image:
    """Return the photograph, of the wanted size, content and kind: 8-bit, and not decoded yet where its file is."""
    return _opened(path, usable(path, read_content(path), size_px, sha256), stretch)


def _decoded_jpeg(file: Identified, kind: int) -> ByteArray | None:
    """Return the pixels of a JPEG of 8 bits in the colours of ``kind``, a flag of OpenCV: those that Pillow gives, in
    half of its time and a fourth of its memory. None of any other file, and of one with damage, which Pillow names."""
    width, height = file.picture.size
    if file.layout.is_deep or file.picture.format not in JPEGS:
        return None
    pixels = cv2.imdecode(np.frombuffer(file.data, dtype=np.uint8), kind | cv2.IMREAD_IGNORE_ORIENTATION)
    return None if pixels is None or pixels.shape[:2] != (height, width) else np.asarray(pixels, dtype=np.uint8)


def _opened(path: Path, file: Identified, stretch: Stretch | None) -> Image.Image:
    """Return the 8-bit picture of a photograph: itself, not decoded yet, or what a stretch makes of it."""
    if not file.layout.is_deep:
        return file.picture
    if stretch is None:
        raise ImageError(
            f"photograph {path}: {file.layout.bits} bits a channel, and nothing says how they are stretched to 8: the "
            "stage photographs finds it (photogram adjust), in Python find_stretch"
        )
    return stretched_picture(path, file.data, file.layout, file.picture.size, stretch)


def _decode(path: Path, picture: Image.Image) -> None:
    try:
        picture.load()
    except DAMAGE as error:
        raise damaged(path, error) from error


def read_photograph(
    path: Path | str,
    size_px: tuple[int, int] | None = None,
    sha256: str | None = None,
    stretch: Stretch | None = None,
) -> ByteArray:
    """Return the photograph as red, green, blue (height, width, 3) uint8, pixels as the sensor delivered them.

    ``stretch`` makes 8 bits of a photograph that has more (``find_stretch``), and leaves any other as it is. Raises
    ImageError where the file is missing or damaged, its width and height are not ``size_px``, the SHA-256 of the
    content that is decoded is not ``sha256``, in hex, or it has more than 8 bits and there is no ``stretch``.
    """
    path = Path(path)
    file = usable(path, read_content(path), size_px, sha256)
    pixels = _decoded_jpeg(file, cv2.IMREAD_COLOR)
    if pixels is not None:
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB, dst=pixels), dtype=np.uint8)
    picture = _opened(path, file, stretch)
    _decode(path, picture)
    return np.array(picture if picture.mode == "RGB" else picture.convert("RGB"))


def read_grey(
    path: Path,
    size_px: tuple[int, int] | None = None,
    sha256: str | None = None,
    stretch: Stretch | None = None,
) -> ByteArray:
    """Return the photograph's luminance (height, width); a JPEG's own, without the detour over colour.

    Raises ImageError as read_photograph does.
    """
    file = usable(path, read_content(path), size_px, sha256)
    pixels = _decoded_jpeg(file, cv2.IMREAD_GRAYSCALE)
    if pixels is not None:
        return pixels
    picture = _opened(path, file, stretch)
    picture.draft("L", None)
    _decode(path, picture)
    return np.array(picture.convert("L"))


def check_photograph(path: Path, size_px: tuple[int, int] | None = None, sha256: str | None = None) -> tuple[int, int]:
    """Decode the whole photograph, JPEG at an eighth of its size, and return its width and height.

    At an eighth every coefficient is still read, so the same damage is found in half the time or less. What libjpeg
    passes over in silence inside a picture that has its end marker is not found. Raises ImageError as read_photograph
    does; more than 8 bits need no stretch here.
    """
    file = usable(path, read_content(path), size_px, sha256)
    picture, size = file.picture, file.picture.size
    if file.layout.is_deep:
        sampled_values(path, file.data, file.layout, max(size))
        return size
    picture.draft("L", (1, 1))
    _decode(path, picture)
    return size


def read_tags(path: Path) -> PhotographTags:
    """Return what the photograph's EXIF and XMP say; XMP comes first where both give the position, it has more digits.

    A sigma of zero counts as not given. XMP that is not valid XML is left out, which ``damage`` of the tags says.
    Damaged pixels go unnoticed. Raises ImageError where the file is missing or is no picture, or a tag holds nonsense.
    """
    return identify(path, read_content(path)).tags(path)


def read_leading_tags(path: Path, size_px: tuple[int, int]) -> PhotographTags:
    """Return what read_tags returns, of a JPEG file from what stands before its pixels: a twentieth of the time.

    Raises ImageError as read_tags does, and where the photograph is not of ``size_px``.
    """
    file = identify(path, read_leading(path))
    check_pixels(path, file.picture.size, size_px)
    return file.tags(path)


def inspect_photograph(path: Path) -> PhotographTags:
    """Return what read_tags returns of a photograph that photogram can use, without decoding it; of most JPEG files the
    beginning and the end are read alone.

    Raises ImageError as read_tags does, and where the pixels are of another kind or the file has no end.
    """
    return usable(path, read_ends(path), None).tags(path)


def sample_values(path: Path) -> Values:
    """Return the values (n,) of every few pixels of a photograph of 9 to 16 bits a channel, all channels together.

    Raises ImageError where it has 8 bits, is missing or damaged, or has pixels of another kind.
    """
    file = usable(path, read_content(path), None)
    if not file.layout.is_deep:
        raise ImageError(f"photograph {path}: 8 bits a channel, which need no stretch")
    width, height = file.picture.size
    return sampled_values(path, file.data, file.layout, max(1, isqrt(width * height // _SAMPLED_PIXELS)))


def thumbnail(path: Path, stretch: Stretch | None = None) -> FloatArray:
    """Return the photograph's luminance (48, 64) as grey values from 0 to 255, JPEG decoded at an eighth of its size.

    Enough to tell one photograph from the next one of a flight. Raises ImageError as read_photograph does.
    """
    picture = _open(path, None, None, stretch)
    picture.draft("L", (64, 48))
    _decode(path, picture)
    return np.asarray(picture.convert("L").resize((64, 48), Image.Resampling.BOX), dtype=np.float64)


def read_small(path: Path, longest_px: int, stretch: Stretch | None = None) -> ByteArray:
    """Return the photograph as red, green, blue (height, width, 3), reduced to ``longest_px`` along its longer side
    unless it is smaller; JPEG is decoded at an eighth of its size or more.

    Raises ImageError as read_photograph does.
    """
    picture = _open(path, None, None, stretch)
    scale = min(longest_px / max(picture.size), 1.0)
    size = max(round(picture.width * scale), 1), max(round(picture.height * scale), 1)
    picture.draft("RGB", size)
    _decode(path, picture)
    return np.array(picture.convert("RGB").resize(size, Image.Resampling.BOX))


def read_window(
    path: Path,
    box: tuple[int, int, int, int],
    reduction: int = 1,
    size_px: tuple[int, int] | None = None,
    stretch: Stretch | None = None,
) -> ByteArray:
    """Return a part of the photograph as red, green, blue (height, width, 3), reduced 1, 2, 4 or 8 times; each pixel of
    a reduced one is the mean of a square of so many, as far as the photograph reaches.

    ``box`` is left, upper, right, lower in reduced pixels, within ceil(width / reduction) and ceil(height / reduction).
    JPEG is decoded at the reduced size, and no farther down than the box. Raises ImageError as read_photograph does.
    """
    file = usable(path, read_content(path), size_px)
    picture = _opened(path, file, stretch)
    width, height = picture.size
    left, upper, right, lower = box
    rows = (lower * reduction // _ROWS_TOGETHER + 2) * _ROWS_TOGETHER
    if picture.format in JPEGS and rows < height and (short := _cut_below(file.data, rows, height)) is not None:
        picture = open_picture(path, short, {})
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
    stretch: Stretch | None = None,
) -> list[ByteArray]:
    """Return parts of the photograph as red, green, blue (height, width, 3) from decoding it once; a ``box`` is left,
    upper, right, lower in its pixels, within it. Raises ImageError as read_photograph does."""
    picture = _open(path, size_px, sha256, stretch)
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
    if tags.capture is not None:
        values["drone-dji:CaptureUUID"] = tags.capture
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


def write_photograph(path: Path, pixels: ByteArray, tags: PhotographTags) -> None:
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
            partial, "JPEG", quality=95, subsampling="4:2:2", exif=_exif_of(tags, width, height), xmp=_xmp_of(tags)
        )
