"""Photographs on disk: pixels, and what their EXIF and XMP tags say.

Pixels are returned as the sensor delivered them: the EXIF orientation is never applied, so that pixel coordinates and
the calibration stay those of the camera.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from math import isfinite
from pathlib import Path
from xml.etree.ElementTree import ParseError
from xml.sax.saxutils import quoteattr

import numpy as np
from defusedxml import DefusedXmlException
from numpy.typing import NDArray
from PIL import ExifTags, Image, UnidentifiedImageError
from PIL.TiffImagePlugin import IFDRational

from photogram.errors import ImageError
from photogram.files.atomic import replacing

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

_MODES = ("RGB", "L", "RGBA")
_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
_START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9
_DJI_NAMESPACE = "http://www.dji.com/drone-dji/1.0/"
_ZONE = re.compile(r"[+-][01]\d:[0-5]\d")


@dataclass(frozen=True)
class Dewarp:
    """The maker's calibration of one lens as DJI writes it (Brown–Conrady).

    ``centre_offset_px`` is the principal point from the picture's centre, right and down.
    """

    date: str
    focal_px: tuple[float, float]
    centre_offset_px: tuple[float, float]
    radial: tuple[float, float, float]
    tangential: tuple[float, float]


@dataclass(frozen=True)
class PhotographTags:
    """What a photograph's EXIF and XMP say; None where they say nothing.

    ``time`` is the camera's clock, with a zone only where the tags give one. ``height_m`` is above the ellipsoid where
    an RTK drone wrote it (``rtk_flag`` 16 or more), else near sea level. ``gnss_sigma_m`` is east, north, up.
    ``rtk_flag``: 0 none, 16 single, 32–49 float, 50 fixed. Gimbal and flight angles as in camera.rotation_from_gimbal.
    """

    make: str | None = None
    model: str | None = None
    width_px: int | None = None
    height_px: int | None = None
    focal_mm: float | None = None
    focal_35mm_mm: float | None = None
    time: datetime | None = None
    longitude_deg: float | None = None
    latitude_deg: float | None = None
    height_m: float | None = None
    height_above_take_off_m: float | None = None
    gnss_sigma_m: tuple[float, float, float] | None = None
    rtk_flag: int | None = None
    gimbal_yaw_deg: float | None = None
    gimbal_pitch_deg: float | None = None
    gimbal_roll_deg: float | None = None
    flight_yaw_deg: float | None = None
    flight_pitch_deg: float | None = None
    flight_roll_deg: float | None = None
    dewarp: Dewarp | None = None


_XMP_NUMBERS = {
    "height_above_take_off_m": "RelativeAltitude",
    "gimbal_yaw_deg": "GimbalYawDegree",
    "gimbal_pitch_deg": "GimbalPitchDegree",
    "gimbal_roll_deg": "GimbalRollDegree",
    "flight_yaw_deg": "FlightYawDegree",
    "flight_pitch_deg": "FlightPitchDegree",
    "flight_roll_deg": "FlightRollDegree",
}


def _jpeg_is_whole(data: bytes) -> bool:
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


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError as fault:
        raise ImageError(
            f"photograph {path}: there is no such file: check the folder of photographs and the name"
        ) from fault
    except OSError as fault:
        raise ImageError(f"photograph {path}: cannot be read ({fault.strerror}): check its permissions") from fault


def _identify(path: Path, data: bytes) -> Image.Image:
    try:
        return Image.open(io.BytesIO(data))
    except UnidentifiedImageError as fault:
        raise _damaged(path, f"{len(data)} bytes in no known picture format") from fault
    except Image.DecompressionBombError as fault:
        raise ImageError(f"photograph {path}: {fault}: make the photograph smaller, and its calibration") from fault
    except (OSError, SyntaxError, ValueError) as fault:
        raise _damaged(path, fault) from fault


def _open(path: Path, size_px: tuple[int, int] | None) -> Image.Image:
    """Return the photograph, of the wanted size and a known kind, not decoded yet."""
    data = _read(path)
    picture = _identify(path, data)
    if size_px is not None and picture.size != size_px:
        raise ImageError(
            f"photograph {path}: {picture.width} × {picture.height} px, but its camera has "
            f"{size_px[0]} × {size_px[1]} px: use the photograph as taken, or the camera that took it"
        )
    if picture.mode not in _MODES:
        raise ImageError(
            f"photograph {path}: pixels of kind {picture.mode}, photogram reads 8-bit colour or grey: "
            "export it as an 8-bit JPEG or TIFF"
        )
    if picture.format in ("JPEG", "MPO") and not _jpeg_is_whole(data):
        raise _damaged(path, "its picture has no end")
    return picture


def _decode(path: Path, picture: Image.Image) -> None:
    try:
        picture.load()
    except (OSError, SyntaxError, ValueError, EOFError) as fault:
        raise _damaged(path, fault) from fault


def read_pixels(path: Path, size_px: tuple[int, int] | None = None) -> ByteArray:
    """Return the photograph as red, green, blue (height, width, 3).

    Raises ImageError where the file is missing or damaged, or its width and height are not ``size_px``.
    """
    picture = _open(path, size_px)
    _decode(path, picture)
    return np.array(picture.convert("RGB"))


def read_grey(path: Path, size_px: tuple[int, int] | None = None) -> ByteArray:
    """Return the photograph's luminance (height, width); a JPEG's own, without the detour over colour.

    Raises ImageError as read_pixels does.
    """
    picture = _open(path, size_px)
    picture.draft("L", None)
    _decode(path, picture)
    return np.array(picture.convert("L"))


def check_photograph(path: Path, size_px: tuple[int, int] | None = None) -> tuple[int, int]:
    """Decode the whole photograph, JPEG at an eighth of its size, and return its width and height.

    At an eighth every coefficient is still read, so the same damage is found in half the time or less. What libjpeg
    passes over in silence inside a picture that has its end marker is not found. Raises ImageError as read_pixels does.
    """
    picture = _open(path, size_px)
    size = picture.size
    picture.draft("L", (1, 1))
    _decode(path, picture)
    return size


def _text(value: object) -> str | None:
    text = value.decode("latin-1") if isinstance(value, bytes) else str(value or "")
    return text.split("\0")[0].strip() or None


def _finite(value: object) -> float | None:
    if not isinstance(value, (int, float, IFDRational)):
        return None
    number = float(value)
    return number if isfinite(number) else None


def _exif_time(exif: Mapping[int, object]) -> datetime | None:
    """Return the time of exposure, None where there is none or the camera's clock was never set."""
    try:
        time = datetime.strptime(_text(exif.get(ExifTags.Base.DateTimeOriginal)) or "", "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    fraction = _text(exif.get(ExifTags.Base.SubsecTimeOriginal)) or ""
    if fraction.isdecimal():
        time = time.replace(microsecond=int(fraction[:6].ljust(6, "0")))
    zone = _text(exif.get(ExifTags.Base.OffsetTimeOriginal)) or ""
    if _ZONE.fullmatch(zone):
        time = time.replace(tzinfo=datetime.strptime(zone, "%z").tzinfo)
    return time


def _exif_degrees(gps: Mapping[int, object], tag: int, reference: int, negative: str) -> float | None:
    value = gps.get(tag)
    if not isinstance(value, tuple) or len(value) != 3:
        return None
    parts = [_finite(part) for part in value]
    if parts[0] is None:
        return None
    degrees = parts[0] + (parts[1] or 0.0) / 60.0 + (parts[2] or 0.0) / 3600.0
    return -degrees if _text(gps.get(reference)) == negative else degrees


def _exif_height(gps: Mapping[int, object]) -> float | None:
    height = _finite(gps.get(ExifTags.GPS.GPSAltitude))
    reference = gps.get(ExifTags.GPS.GPSAltitudeRef)
    below = reference in (b"\x01", b"\x03", 1, 3)
    return -height if height is not None and below else height


def _leaves(tree: object) -> Iterator[tuple[str, str]]:
    if isinstance(tree, list):
        for branch in tree:
            yield from _leaves(branch)
    elif isinstance(tree, dict):
        for name, value in tree.items():
            if isinstance(value, str):
                yield name, value
            else:
                yield from _leaves(value)


def _xmp(picture: Image.Image, path: Path) -> dict[str, str]:
    try:
        return dict(_leaves(picture.getxmp()))
    except (ParseError, DefusedXmlException) as fault:
        raise ImageError(
            f"photograph {path}: its XMP tags are no valid XML ({fault}): take the photograph as it left the camera, "
            "or remove the XMP (exiftool -xmp:all= FILE)"
        ) from fault


def _xmp_number(xmp: Mapping[str, str], name: str, path: Path) -> float | None:
    text = xmp.get(name, "").strip()
    if not text:
        return None
    try:
        number = float(text)
    except ValueError as fault:
        raise ImageError(
            f"photograph {path}: XMP tag {name} is {text!r}, no number: correct or remove the tag"
        ) from fault
    return number if isfinite(number) else None


def _dewarp(xmp: Mapping[str, str], path: Path) -> Dewarp | None:
    text = xmp.get("DewarpData", "").strip()
    if not text:
        return None
    date, _, rest = text.partition(";")
    try:
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = (float(part) for part in rest.split(","))
    except ValueError as fault:
        raise ImageError(
            f"photograph {path}: XMP tag DewarpData is {text!r}, expected 'date;fx,fy,cx,cy,k1,k2,p1,p2,k3': "
            "correct or remove the tag"
        ) from fault
    return Dewarp(date, (fx, fy), (cx, cy), (k1, k2, k3), (p1, p2))


def _position(xmp: Mapping[str, str], gps: Mapping[int, object], path: Path) -> dict[str, float | None]:
    """Return longitude, latitude and height, XMP before EXIF; longitude and latitude of exactly zero mean no fix."""
    longitude = _xmp_number(xmp, "GpsLongitude", path)
    if longitude is None:
        # DJI's older firmware spells it so.
        longitude = _xmp_number(xmp, "GpsLongtitude", path)
    latitude, height = _xmp_number(xmp, "GpsLatitude", path), _xmp_number(xmp, "AbsoluteAltitude", path)
    if longitude is None or latitude is None:
        longitude = _exif_degrees(gps, ExifTags.GPS.GPSLongitude, ExifTags.GPS.GPSLongitudeRef, "W")
        latitude = _exif_degrees(gps, ExifTags.GPS.GPSLatitude, ExifTags.GPS.GPSLatitudeRef, "S")
    if height is None:
        height = _exif_height(gps)
    if longitude is None or latitude is None or (longitude == 0.0 and latitude == 0.0):
        longitude = latitude = height = None
    elif abs(longitude) > 180.0 or abs(latitude) > 90.0:
        raise ImageError(
            f"photograph {path}: its tags give longitude {longitude}, latitude {latitude}, which lie on no globe: "
            "correct or remove the tags"
        )
    return {"longitude_deg": longitude, "latitude_deg": latitude, "height_m": height}


def read_tags(path: Path) -> PhotographTags:
    """Return what the photograph's EXIF and XMP say; XMP comes first where both give the position, it has more digits.

    A sigma of zero counts as not given. Damaged pixels go unnoticed. Raises ImageError where the file is missing or
    is no picture, or a tag holds nonsense.
    """
    picture = _identify(path, _read(path))
    main = picture.getexif()
    exif, gps = main.get_ifd(ExifTags.IFD.Exif), main.get_ifd(ExifTags.IFD.GPSInfo)
    xmp = _xmp(picture, path)
    sigmas = [_xmp_number(xmp, name, path) for name in ("RtkStdLon", "RtkStdLat", "RtkStdHgt")]
    east, north, up = sigmas
    flag = _xmp_number(xmp, "RtkFlag", path)
    return PhotographTags(
        make=_text(main.get(ExifTags.Base.Make)),
        model=_text(main.get(ExifTags.Base.Model)),
        width_px=picture.width,
        height_px=picture.height,
        focal_mm=_finite(exif.get(ExifTags.Base.FocalLength)) or None,
        focal_35mm_mm=_finite(exif.get(ExifTags.Base.FocalLengthIn35mmFilm)) or None,
        time=_exif_time(exif),
        gnss_sigma_m=(east, north, up) if east and north and up else None,
        rtk_flag=None if flag is None else int(flag),
        dewarp=_dewarp(xmp, path),
        **_position(xmp, gps, path),
        **{field: _xmp_number(xmp, name, path) for field, name in _XMP_NUMBERS.items()},
    )


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
    exif[ExifTags.Base.ExifImageWidth], exif[ExifTags.Base.ExifImageHeight] = width, height
    if tags.focal_mm is not None:
        exif[ExifTags.Base.FocalLength] = _rational(tags.focal_mm, 1000)
    if tags.focal_35mm_mm is not None:
        exif[ExifTags.Base.FocalLengthIn35mmFilm] = round(tags.focal_35mm_mm)
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
    return main


def _xmp_of(tags: PhotographTags) -> bytes:
    values: dict[str, str] = {}

    def put(name: str, value: float | None, form: str) -> None:
        if value is not None:
            values[name] = format(value, form)

    put("AbsoluteAltitude", tags.height_m, "+.3f")
    put("GpsLatitude", tags.latitude_deg, ".10f")
    put("GpsLongitude", tags.longitude_deg, ".10f")
    for field, name in _XMP_NUMBERS.items():
        put(name, getattr(tags, field), "+.3f")
    put("RtkFlag", tags.rtk_flag, "d")
    for name, sigma in zip(("RtkStdLon", "RtkStdLat", "RtkStdHgt"), tags.gnss_sigma_m or (), strict=False):
        put(name, sigma, ".5f")
    if (lens := tags.dewarp) is not None:
        k1, k2, k3 = lens.radial
        numbers = (*lens.focal_px, *lens.centre_offset_px, k1, k2, *lens.tangential, k3)
        values["DewarpData"] = f"{lens.date};" + ",".join(repr(float(number)) for number in numbers)
    attributes = "".join(f"\n   drone-dji:{name}={quoteattr(value)}" for name, value in values.items())
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        f'  <rdf:Description rdf:about="DJI Meta Data"\n   xmlns:drone-dji="{_DJI_NAMESPACE}"{attributes}/>\n'
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
