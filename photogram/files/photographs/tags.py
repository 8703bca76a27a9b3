"""What EXIF and XMP say of a photograph, in the conventions of the makers of drones and cameras.

- DJI, and Autel since it follows DJI: XMP tags of their own (``GimbalYawDegree``, ``RtkFlag``, ``DewarpData`` …).
- Parrot (``CameraYawDegree`` … of ``drone-parrot``), Skydio (``CameraOrientationNED``) and Yuneec (``GimbalYaw`` …):
  a gimbal's angles as DJI's, under names of their own, which are read as DJI's.
- senseFly, Parrot Sequoia, older Autel, MicaSense, Sentera: the name space ``Camera`` that Pix4D defined
  (``Camera:Yaw`` …), where pitch 0 looks straight down; Autel writes a gimbal's angles there too.
- Everything else, a Sony with geotags for example: EXIF alone.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from photogram.camera import gimbal_from_rotation, rotation_from_gimbal
from photogram.errors import ImageError, PhotogramError
from photogram.files.photographs.tag_packets import DAMAGE, Properties, exif_of, xmp_of
from photogram.files.photographs.velocities import velocity_of
from photogram.wording import printable, shortened

Kind = Literal["frame", "thermal", "panorama", "fisheye"]

MILLIMETRES_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""EXIF FocalPlaneResolutionUnit: inch, centimetre, millimetre, micrometre."""

HIGHEST_M = 50_000.0
"""No camera's height is farther from the ellipsoid or the sea."""

RANGES: Mapping[str, tuple[float, float]] = {
    "height_above_take_off_m": (-HIGHEST_M, HIGHEST_M),
    "focal_mm": (0.01, 100_000.0),
    "focal_35mm_mm": (0.1, 100_000.0),
    "pixels_per_mm": (0.01, 1e6),
    "calibrated_focal_mm": (0.01, 100_000.0),
    "gnss_horizontal_error_m": (1e-5, 1e6),
    "gimbal_yaw_deg": (-720.0, 720.0),
    "gimbal_pitch_deg": (-720.0, 720.0),
    "gimbal_roll_deg": (-720.0, 720.0),
    "flight_yaw_deg": (-720.0, 720.0),
    "flight_pitch_deg": (-720.0, 720.0),
    "flight_roll_deg": (-720.0, 720.0),
    "rtk_flag": (0, 255),
}
"""What the figures of PhotographTags may be, ends included."""

AUTEL_GIMBAL_DEG = -10.0
"""Camera:Pitch of Autel below which it is a gimbal's, −90 straight down: no gimbal of theirs looks so far backwards."""

LARGEST_FIGURE = 1e9
"""Of a maker's calibration, without sign."""

SMALLEST_SIGMA_M, LARGEST_SIGMA_M = 1e-5, 1e6
LONGEST_TEXT = 100
"""In characters, of a name in the tags; the rest is cut off."""

DJI_NUMBERS = {
    "height_above_take_off_m": "RelativeAltitude",
    "gimbal_yaw_deg": "GimbalYawDegree",
    "gimbal_pitch_deg": "GimbalPitchDegree",
    "gimbal_roll_deg": "GimbalRollDegree",
    "flight_yaw_deg": "FlightYawDegree",
    "flight_pitch_deg": "FlightPitchDegree",
    "flight_roll_deg": "FlightRollDegree",
}
"""Fields of PhotographTags and the names that DJI gives them."""

_GIMBAL = ("gimbal_yaw_deg", "gimbal_pitch_deg", "gimbal_roll_deg")
_ZONE = re.compile(r"[+-][01][0-9]:[0-5][0-9]")
_FIRST_YEAR, _LAST_YEAR = 1980, 2200
_FRACTION = re.compile(r"\s*([-+]?[\d.]+)\s*/\s*(\d+)\s*")


@dataclass(frozen=True)
class Dewarp:
    """The maker's calibration of one lens as DJI writes it (Brown–Conrady).

    ``centre_offset_px`` is the principal point from the picture's centre, right and down; ``size_px`` the width and
    height of the pictures that it belongs to, where the tags say so; ``applied`` that the camera has taken the
    distortion out of the picture already.
    """

    date: str
    focal_px: tuple[float, float]
    centre_offset_px: tuple[float, float]
    radial: tuple[float, float, float]
    tangential: tuple[float, float]
    size_px: tuple[float, float] | None = None
    applied: bool = False


@dataclass(frozen=True)
class PhotographTags:
    """EXIF and XMP of a photograph; None for absent tags."""

    make: str | None = None
    """Maker of the camera."""
    model: str | None = None
    """Camera model."""
    serial: str | None = None
    """Serial number of the camera."""
    lens: str | None = None
    """Lens model."""
    lens_serial: str | None = None
    """Serial number of the lens."""
    kind: Kind = "frame"
    """Frame photograph, or another kind of picture."""
    band: str | None = None
    """Spectral band of a multispectral picture."""
    width_px: int | None = None
    """Width."""
    height_px: int | None = None
    """Height."""
    bits: int = 8
    """Bits of a channel."""
    focal_mm: float | None = None
    """Focal length."""
    focal_35mm_mm: float | None = None
    """35 mm equivalent focal length."""
    pixels_per_mm: float | None = None
    """Resolution on the sensor."""
    calibrated_focal_mm: float | None = None
    """The maker's calibrated focal length (Camera name space)."""
    calibrated_radial: tuple[float, float, float] | None = None
    """The maker's radial distortion (Camera name space)."""
    time: datetime | None = None
    """The camera's clock, with a zone only where the tags give one."""
    longitude_deg: float | None = None
    """Longitude."""
    latitude_deg: float | None = None
    """Latitude."""
    height_m: float | None = None
    """Height of the GNSS position."""
    height_is_ellipsoidal: bool | None = None
    """True: above the ellipsoid; False: near sea level, often barometric."""
    height_above_take_off_m: float | None = None
    """Height above take-off."""
    gnss_sigma_m: tuple[float, float, float] | None = None
    """Standard deviations: east, north, up."""
    gnss_horizontal_error_m: float | None = None
    """EXIF's horizontal positioning error."""
    rtk_flag: int | None = None
    """0 none, 16 single, 32–49 float, 50 fixed."""
    gimbal_yaw_deg: float | None = None
    """Gimbal yaw, converted to the convention of rotation_from_gimbal."""
    gimbal_pitch_deg: float | None = None
    """Gimbal pitch."""
    gimbal_roll_deg: float | None = None
    """Gimbal roll."""
    flight_yaw_deg: float | None = None
    """Yaw of the aircraft."""
    flight_pitch_deg: float | None = None
    """Pitch of the aircraft."""
    flight_roll_deg: float | None = None
    """Roll of the aircraft."""
    velocity_m_s: tuple[float, float, float] | None = None
    """Velocity over ground at the exposure: north, east, down."""
    dewarp: Dewarp | None = None
    """DJI's DewarpData."""
    capture: str | None = None
    """Identifier of the exposure, which the cameras on one body share: CaptureUUID of DJI and Pix4D's name space,
    CaptureId of MicaSense."""
    damage: tuple[str, ...] = ()
    """Tags that could not be read, in words."""
    passed_over: tuple[str, ...] = ()
    """Names of XMP tags that seem to give a position, an attitude or an accuracy, and that nothing reads."""


def damage_by_kind(damaged: Sequence[tuple[str, Sequence[str]]]) -> list[tuple[str, list[str]]]:
    """Return each kind of damage, in the words of the first photograph that has it, and the names of all that have it;
    ``damaged`` are the names of photographs and the ``damage`` of their tags."""
    kinds: dict[str, tuple[str, list[str]]] = {}
    for name, texts in damaged:
        for text in texts:
            kinds.setdefault(text.split(" (")[0], (text, []))[1].append(name)
    return list(kinds.values())


# ---- EXIF ----------------------------------------------------------------------------------------------------------


def _text(value: object) -> str | None:
    text = value.decode("latin-1") if isinstance(value, bytes) else str(value) if isinstance(value, str | int) else ""
    return printable(text.split("\0")[0].strip()[:LONGEST_TEXT]) or None


def _finite(value: object) -> float | None:
    if not isinstance(value, (int, float, IFDRational)):
        return None
    try:
        number = float(value)
    except (OverflowError, ZeroDivisionError):
        return None
    return number if isfinite(number) else None


def _positive(value: object) -> float | None:
    number = _finite(value)
    return number if number is not None and number > 0 else None


def _exif_time(exif: Mapping[int, object]) -> datetime | None:
    """Return the time of exposure, None where there is none or the camera's clock was never set."""
    try:
        time = datetime.strptime(_text(exif.get(ExifTags.Base.DateTimeOriginal)) or "", "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    if not _FIRST_YEAR <= time.year <= _LAST_YEAR:
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
    angle = parts[0] + (parts[1] or 0.0) / 60.0 + (parts[2] or 0.0) / 3600.0
    return -angle if _text(gps.get(reference)) == negative else angle


def _height_reference(gps: Mapping[int, object]) -> int | None:
    """Return EXIF's GPSAltitudeRef: 0 above and 1 below the sea level, 2 above and 3 below the ellipsoid."""
    reference = gps.get(ExifTags.GPS.GPSAltitudeRef)
    if isinstance(reference, str):
        reference = reference.encode("latin-1", "replace")
    if isinstance(reference, bytes):
        # some write the digit as text, 48 to 51
        number = reference[0] if reference else None
        return number - 48 if number is not None and 48 <= number <= 51 else number
    return reference if isinstance(reference, int) else None


def _exif_height(gps: Mapping[int, object]) -> float | None:
    height = _finite(gps.get(ExifTags.GPS.GPSAltitude))
    return -height if height is not None and _height_reference(gps) in (1, 3) else height


def _pixels_per_mm(exif: Mapping[int, object]) -> float | None:
    resolution = _positive(exif.get(ExifTags.Base.FocalPlaneXResolution))
    unit = exif.get(ExifTags.Base.FocalPlaneResolutionUnit, 2)
    if resolution is None or unit not in MILLIMETRES_PER_UNIT:
        return None
    return resolution / MILLIMETRES_PER_UNIT[int(str(unit))]


# ---- XMP -----------------------------------------------------------------------------------------------------------

_OTHER_NUMBERS = (
    "AbsoluteAltitude",
    "CalibratedOpticalCenterX",
    "CalibratedOpticalCenterY",
    "Camera:AboveGroundAltitude",
    "Camera:GPSXYAccuracy",
    "Camera:GPSZAccuracy",
    "Camera:PerspectiveFocalLength",
    "Camera:Pitch",
    "Camera:Roll",
    "Camera:Yaw",
    "DewarpFlag",
    "GpsLatitude",
    "GpsLongitude",
    "RtkFlag",
    "RtkStdHgt",
    "RtkStdLat",
    "RtkStdLon",
)
"""Tags that are numbers, beside DJI_NUMBERS."""


_MEASURED = re.compile(r"yaw|pitch|roll(?!ing)|heading|altitude|latitude|longitude|accuracy")


def _passed_over(xmp: Properties) -> tuple[str, ...]:
    known = {name.casefold() for name in (*DJI_NUMBERS.values(), *_OTHER_NUMBERS, "AltitudeType")}
    names = [name for name in xmp if _MEASURED.search(name) and name not in known]
    return tuple(xmp.written(name) for name in names if not name.startswith("exif:"))  # copies of EXIF's own


def _xmp_number(xmp: Mapping[str, str], name: str, path: Path) -> float | None:
    text = xmp.get(name, "")
    if not text:
        return None
    fraction = _FRACTION.fullmatch(text)
    try:
        number = float(fraction[1]) / float(fraction[2]) if fraction else float(text)
    except ZeroDivisionError:
        return None  # as EXIF writes a value that is not known
    except ValueError as error:
        raise _unusable(path, name, text, "not a number") from error
    return number


def _unusable(path: Path, name: str, text: str, why: str) -> ImageError:
    return ImageError(f"photograph {path}: the XMP tag {name} is {shortened(text)!r}, {why}")


def _readable(xmp: Properties, path: Path) -> tuple[Properties, tuple[str, ...]]:
    """Return the tags without those that cannot be read, which are others' of the same name, and in words which."""
    kept, damage = xmp, list[str]()
    readers: list[tuple[str, Callable[[str], object]]] = [
        *((name, lambda name: _xmp_number(kept, name, path)) for name in (*DJI_NUMBERS.values(), *_OTHER_NUMBERS)),
        ("DewarpData", lambda _: _dewarp(kept, path)),
        ("Camera:PerspectiveDistortion", lambda _: _camera_calibration(kept, path)),
    ]
    for name, read in readers:
        try:
            read(name)
        except ImageError as error:
            kept = kept.without(name)
            damage.append(f"{str(error).removeprefix(f'photograph {path}: ')}; it is not used")
    return kept, tuple(damage)


def _dewarp(xmp: Mapping[str, str], path: Path) -> Dewarp | None:
    text = xmp.get("DewarpData", "")
    if not text:
        return None
    date, _, rest = text.partition(";")
    try:
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = (float(part) for part in rest.split(","))
    except ValueError as error:
        expected = "expected 'date;fx,fy,cx,cy,k1,k2,p1,p2,k3'"
        raise _unusable(path, "DewarpData", text, expected) from error
    if not all(abs(figure) <= LARGEST_FIGURE for figure in (fx, fy, cx, cy, k1, k2, p1, p2, k3)):
        raise _unusable(path, "DewarpData", text, "not a calibration")
    centre_x, centre_y = (_xmp_number(xmp, f"CalibratedOpticalCenter{axis}", path) for axis in "XY")
    size = (2.0 * centre_x, 2.0 * centre_y) if centre_x and centre_y else None
    applied = _xmp_number(xmp, "DewarpFlag", path) == 1
    return Dewarp(date, (fx, fy), (cx, cy), (k1, k2, k3), (p1, p2), size, applied)


def _camera_calibration(xmp: Mapping[str, str], path: Path) -> dict[str, object]:
    """Return focal length and radial distortion of the Camera name space.

    Its principal point and tangential terms are not read: Pix4D's page leaves open which way their axes point.
    """
    focal_mm = _xmp_number(xmp, "Camera:PerspectiveFocalLength", path) or None
    name = "Camera:PerspectiveDistortion"
    text = xmp.get(name, "")
    if focal_mm is None or not text:
        return {"calibrated_focal_mm": focal_mm}
    try:
        r1, r2, r3, _, _ = (float(part) for part in text.split(","))
    except ValueError as error:
        raise _unusable(path, name, text, "expected 'R1,R2,R3,T1,T2'") from error
    if not all(abs(figure) <= LARGEST_FIGURE for figure in (r1, r2, r3)):
        raise _unusable(path, name, text, "not a distortion")
    return {"calibrated_focal_mm": focal_mm, "calibrated_radial": (r1, r2, r3)}


def _capture(xmp: Mapping[str, str]) -> str | None:
    texts = (xmp.get(name, "")[:LONGEST_TEXT] for name in ("CaptureUUID", "Camera:CaptureUUID", "CaptureId"))
    return next((text for text in texts if text), None)


def _kind(xmp: Mapping[str, str]) -> Kind:
    source = xmp.get("ImageSource", "").lower()
    if "infrared" in source or "thermal" in source or xmp.get("Camera:BandName", "").upper() == "LWIR":
        return "thermal"
    if xmp.get("ProjectionType", "").lower() in ("equirectangular", "cylindrical"):
        return "panorama"
    return "fisheye" if xmp.get("Camera:ModelType", "").lower() == "fisheye" else "frame"


# ---- attitude ------------------------------------------------------------------------------------------------------


def gimbal_from_camera_angles(yaw_deg: float, pitch_deg: float, roll_deg: float) -> tuple[float, float, float]:
    """Return a gimbal's yaw, pitch and roll in degrees from ``Camera:Yaw``, ``Pitch`` and ``Roll``.

    There the angles turn a camera that looks down, its top to the body's front, where a gimbal's turn one that looks
    ahead: R = Rz(yaw) Ry(pitch) Rx(roll) C instead of B (Pix4D, "Yaw, Pitch, Roll and Omega, Phi, Kappa angles"; its
    C_b^B). So pitch 0 is −90 of a gimbal, and 90 the horizon.
    """
    down_from_ahead = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return gimbal_from_rotation(rotation_from_gimbal(yaw_deg, pitch_deg, roll_deg) @ down_from_ahead)


def _attitude(xmp: Mapping[str, str], path: Path, *, is_autel: bool) -> dict[str, float | None]:
    angles = [_xmp_number(xmp, DJI_NUMBERS[field], path) for field in _GIMBAL]
    if any(angle is not None for angle in angles):
        return dict(zip(_GIMBAL, angles, strict=True))
    yaw, pitch, roll = (_xmp_number(xmp, f"Camera:{name}", path) for name in ("Yaw", "Pitch", "Roll"))
    # Cameras without an attitude sensor write zeros.
    if yaw is not None and pitch is not None and roll is not None and (yaw, pitch, roll) != (0.0, 0.0, 0.0):
        if is_autel and pitch < AUTEL_GIMBAL_DEG:
            return dict(zip(_GIMBAL, (yaw, pitch, roll), strict=True))
        return dict(zip(_GIMBAL, gimbal_from_camera_angles(yaw, pitch, roll), strict=True))
    return {}


# ---- position ------------------------------------------------------------------------------------------------------


def _position(
    xmp: Mapping[str, str], gps: Mapping[int, object], path: Path
) -> tuple[dict[str, float | None], tuple[str, ...]]:
    """Return longitude, latitude and height, XMP before EXIF, and in words why they are not used where the height is
    none; longitude and latitude of exactly zero mean no fix."""
    damage: tuple[str, ...] = ()
    longitude, latitude, height = (
        _xmp_number(xmp, name, path) for name in ("GpsLongitude", "GpsLatitude", "AbsoluteAltitude")
    )
    if longitude is None or latitude is None:
        longitude = _exif_degrees(gps, ExifTags.GPS.GPSLongitude, ExifTags.GPS.GPSLongitudeRef, "W")
        latitude = _exif_degrees(gps, ExifTags.GPS.GPSLatitude, ExifTags.GPS.GPSLatitudeRef, "S")
    if height is None:
        height = _exif_height(gps)
    if longitude is None or latitude is None or (longitude == 0.0 and latitude == 0.0):
        longitude = latitude = height = None
    elif not (abs(longitude) <= 180.0 and abs(latitude) <= 90.0):
        raise ImageError(
            f"photograph {path}: its tags give longitude {longitude}, latitude {latitude}, which are "
            "impossible: correct or remove the tags"
        )
    elif height is not None and not abs(height) <= HIGHEST_M:
        damage = (f"the tags give a height of {height:.6g} m (above any aircraft), the position is not used",)
        longitude = latitude = height = None
    return {"longitude_deg": longitude, "latitude_deg": latitude, "height_m": height}, damage


def _gnss_sigma(xmp: Mapping[str, str], path: Path) -> tuple[tuple[float, float, float] | None, tuple[str, ...]]:
    """Return the sigmas of the position, None where they are not known, and in words why they are not used."""
    east, north, up = (_xmp_number(xmp, name, path) for name in ("RtkStdLon", "RtkStdLat", "RtkStdHgt"))
    if east and north and up:
        sigma = east, north, up
    else:
        plan, height = (_xmp_number(xmp, f"Camera:GPS{axes}Accuracy", path) for axes in ("XY", "Z"))
        if not (plan and height and plan > 0 and height > 0):
            return None, ()
        sigma = plan, plan, height
    if all(SMALLEST_SIGMA_M <= s <= LARGEST_SIGMA_M for s in sigma):
        return sigma, ()
    text = ", ".join(f"{s:.6g}" for s in sigma)
    return None, (f"the tags give standard deviations ({text} m) that no receiver achieves; they are not used",)


def _whole(value: object) -> int | None:
    return int(value) if isinstance(value, int | float) else None


def _is_ellipsoidal(
    xmp: Mapping[str, str], gps: Mapping[int, object], rtk_flag: int | None, *, is_autel: bool
) -> bool | None:
    written = xmp.get("AltitudeType", "").lower()
    if written:
        return written == "rtkalt"
    system = (xmp.get("Camera:VertCS") or xmp.get("Camera:VerticCS", "")).lower()
    if system and not is_autel:  # whose older firmware calls heights above the sea ellipsoidal
        return system == "ellipsoidal"
    if _height_reference(gps) in (2, 3):
        return True
    return True if rtk_flag is not None and rtk_flag >= 16 else None


def tags_of(picture: Image.Image, path: Path) -> PhotographTags:
    """Return what the EXIF and XMP of an opened photograph say; XMP comes first where both give the position.

    A sigma of zero counts as not given. XMP that is not valid XML, and figures that cannot be, are left out, and
    ``damage`` of the tags says so. Raises ImageError where a tag holds nonsense; ``path`` is for its message.
    """
    try:
        return _tags_of(picture, path)
    except PhotogramError:
        raise
    except DAMAGE as error:
        words = printable(shortened(str(error)))
        raise ImageError(
            f"photograph {path}: its tags are damaged ({type(error).__name__}: {words}): copy it again "
            "from the camera's card, or leave the photograph out"
        ) from error


def _believed(values: dict[str, object]) -> tuple[dict[str, object], tuple[str, ...]]:
    """Return the figures without those out of RANGES, and in words which these are."""
    damage = []
    for name, (low, high) in RANGES.items():
        value = values.get(name)
        if isinstance(value, int | float) and not low <= value <= high:
            values[name] = None
            words = re.sub(r"_(?:deg|m|mm)$", "", name).replace("_", " ")
            damage.append(f"the tags give an impossible {words} ({value:.6g}); it is not used")
    return values, tuple(damage)


def _tags_of(picture: Image.Image, path: Path) -> PhotographTags:
    main, exif, gps, damage = exif_of(picture)
    written, xmp_damage = xmp_of(picture)
    xmp, unreadable = _readable(written, path)
    position, position_damage = _position(xmp, gps, path)
    sigma, sigma_damage = _gnss_sigma(xmp, path)
    make, xmp_make = _text(main.get(ExifTags.Base.Make)), xmp.get("Make")
    is_autel = any("autel" in (name or "").casefold() for name in (make, xmp_make))
    values: dict[str, object] = {
        **{field: _xmp_number(xmp, name, path) for field, name in DJI_NUMBERS.items() if field not in _GIMBAL},
        **position,
        **_attitude(xmp, path, is_autel=is_autel),
        **_camera_calibration(xmp, path),
    }
    if values["height_above_take_off_m"] is None:
        values["height_above_take_off_m"] = _xmp_number(xmp, "Camera:AboveGroundAltitude", path)
    values |= {
        "focal_mm": _positive(exif.get(ExifTags.Base.FocalLength)),
        "focal_35mm_mm": _positive(exif.get(ExifTags.Base.FocalLengthIn35mmFilm)),
        "pixels_per_mm": _pixels_per_mm(exif),
        "gnss_horizontal_error_m": _positive(gps.get(ExifTags.GPS.GPSHPositioningError)),
        "rtk_flag": _xmp_number(xmp, "RtkFlag", path),
    }
    values, value_damage = _believed(values)
    flag = values["rtk_flag"] = _whole(values["rtk_flag"])
    has_position = values["longitude_deg"] is not None
    return PhotographTags(
        make=make or xmp_make,
        model=_text(main.get(ExifTags.Base.Model)) or xmp.get("Model"),
        serial=_text(exif.get(ExifTags.Base.BodySerialNumber)) or _text(main.get(ExifTags.Base.CameraSerialNumber)),
        lens=_text(exif.get(ExifTags.Base.LensModel)),
        lens_serial=_text(exif.get(ExifTags.Base.LensSerialNumber)),
        kind=_kind(xmp),
        band=xmp.get("Camera:BandName"),
        width_px=picture.width,
        height_px=picture.height,
        time=_exif_time(exif),
        height_is_ellipsoidal=_is_ellipsoidal(xmp, gps, flag, is_autel=is_autel) if has_position else None,
        gnss_sigma_m=sigma,
        velocity_m_s=velocity_of(xmp, exif.get(ExifTags.Base.MakerNote)),
        dewarp=_dewarp(xmp, path),
        capture=_capture(xmp),
        damage=(*damage, *filter(None, (xmp_damage,)), *unreadable, *position_damage, *sigma_damage, *value_damage),
        passed_over=_passed_over(written),
        **values,  # type: ignore[arg-type]
    )
