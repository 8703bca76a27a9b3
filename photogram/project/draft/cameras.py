"""Cameras from the tags of their photographs: which there are, and the interior orientation that the tags give.

Four sources, the best first: the maker's calibration as DJI writes it (DewarpData), the maker's calibration in the
Camera name space (senseFly, Parrot Sequoia), EXIF's focal length in its 35 mm equivalent, and EXIF's focal length with
the resolution on the sensor. Each deserves its own prior standard deviations.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

from photogram.files.photographs.tags import Dewarp, PhotographTags
from photogram.project.draft.shutters import Shutter, shutter_of
from photogram.projection import CAMERA_PARAMETERS

DIAGONAL_35MM_MM = 43.2666
"""The diagonal of 36 × 24 mm; a 35 mm equivalent compares diagonals (CIPA DCG-001)."""

WIDTH_35MM_MM = 36.0
"""Its width, which some writers of tags compare instead."""

SENSOR_WIDTH_MM = {
    **dict.fromkeys(("FC300C", "FC300S", "FC300X", "FC330", "FC220", "FC7303"), 6.17),
    **dict.fromkeys(("FC6310", "FC6310S", "FC6310R", "FC6510", "L1D-20c", "FC3411"), 13.2),
    **dict.fromkeys(("FC6520", "L2D-20c", "M3E"), 17.3),
}
"""Widths of sensors by the models that their tags name, from the makers' data sheets."""

_UNKNOWN = {p.sigma_key: p.unknown for p in CAMERA_PARAMETERS if p.unknown > 0.0}

SIGMA_NAMES = tuple(_UNKNOWN)
"""What a drafted camera states sigmas of."""

_FORMATS = (4 / 3, 3 / 2, 16 / 9, 17 / 9)
_SAME = 0.01
_DISAGREEMENT = 1.25
_EXIF_FOCAL, _EXIF_CENTRE, *_EXIF_OTHERS = _UNKNOWN.values()
"""The affinity of a camera whose shutter is not known: a rolling one, read out in 30 ms at 5 m/s and 60 m above ground,
stretches the picture by 0.25 % along the flight."""

_ALIKE = 0.005
"""Readings of one tag that differ by less are one."""

CameraKey = tuple[str | float | None, ...]


@dataclass(frozen=True)
class TaggedCamera:
    """One camera of a project to be written; pixels in photogram's frame, ``sigmas`` in the order of SIGMA_NAMES.

    ``source`` says where the figures come from, ``reason`` why they deserve these sigmas. ``readings_px`` are focal
    lengths that the same tags would give read otherwise. ``shutter`` is what is known of it; b1 and b2 stand for one of
    which the photographs do not tell how they moved.
    """

    name: str
    width_px: int
    height_px: int
    focal_px: float
    principal_point_px: tuple[float, float]
    radial: tuple[float, float, float]
    tangential: tuple[float, float]
    sigmas: tuple[float, ...]
    source: str
    reason: str
    readings_px: tuple[float, ...] = ()
    shutter: Shutter | None = None


@dataclass(frozen=True, kw_only=True)
class _Interior:
    """An interior orientation as tags give it; ``sigmas`` of focal length and centre are shares."""

    focal_px: float
    centre_offset_px: tuple[float, float] = (0.0, 0.0)
    radial: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tangential: tuple[float, float] = (0.0, 0.0)
    sigmas: tuple[float, ...] = (_EXIF_FOCAL, _EXIF_CENTRE, *_EXIF_OTHERS)
    source: str
    reason: str
    readings_px: tuple[float, ...] = ()


def camera_key(tags: PhotographTags) -> CameraKey:
    """Return what photographs of one camera have in common: body, lens, band, focal length, size and depth."""
    focal_mm = None if tags.focal_mm is None else round(tags.focal_mm, 1)
    body = (tags.make, tags.model, tags.serial)
    return (*body, tags.lens, tags.lens_serial, tags.band, focal_mm, tags.width_px, tags.height_px, tags.bits)


def body_of(tags: PhotographTags) -> str:
    """Return the name of a camera's body, without the make that many makers repeat in the model."""
    make, model = (tags.make or "").strip(), (tags.model or "").strip()
    text = model if model.lower().startswith(make.lower()) else f"{make} {model}"
    return text.strip() or "camera"


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def camera_names(keys: Sequence[CameraKey], tags: Sequence[PhotographTags]) -> list[str]:
    """Return a name for each camera, of body and size, and of lens, focal length or band where these tell them
    apart."""
    short = [f"{_slug(body_of(t))}_{t.width_px}x{t.height_px}" for t in tags]
    names = []
    for key, t, name in zip(keys, tags, short, strict=True):
        if short.count(name) > 1:
            focal = f"{key[6]:g}mm" if isinstance(key[6], float) else ""
            name = "_".join(part for part in (_slug(t.band or ""), _slug(focal), name) if part)
        names.append(name)
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name] += 1
        if seen[name] > 1:
            names[i] = f"{name}_{seen[name]}"
    return names


def whole_diagonal_px(width_px: int, height_px: int, sensor_diagonal_mm: float | None) -> float:
    """Return the diagonal in pixels of the whole sensor, of which a 16:9 picture for example is a part.

    The 35 mm equivalent belongs to the whole sensor. One-inch, APS-C and 35 mm sensors are 3:2, all others 4:3; a
    picture of another shape that cameras offer keeps the sensor's width, or its height where it is narrower.
    """
    long, short = max(width_px, height_px), min(width_px, height_px)
    aspect = long / short
    if not any(abs(aspect / known - 1.0) < _SAME for known in _FORMATS):
        return hypot(long, short)
    d = sensor_diagonal_mm
    if d is None:
        sensor = 3 / 2 if abs(aspect / (3 / 2) - 1.0) < _SAME else 4 / 3
    else:
        sensor = 3 / 2 if 14.0 <= d <= 18.0 or 25.0 < d < 46.0 else 4 / 3
    if abs(aspect / sensor - 1.0) < _SAME:
        return hypot(long, short)
    return long * sqrt(1.0 + 1.0 / sensor**2) if aspect > sensor else short * sqrt(1.0 + sensor**2)


def _undistorted(focal_px: float, source: str, reason: str, readings_px: tuple[float, ...] = ()) -> _Interior:
    """Return a camera of which EXIF tells the focal length alone; its standard deviation covers half of what other
    readings differ by."""
    apart = max((abs(other / focal_px - 1.0) for other in readings_px), default=0.0)
    sigmas = (hypot(_EXIF_FOCAL, 0.5 * apart), _EXIF_CENTRE, *_EXIF_OTHERS)
    return _Interior(focal_px=focal_px, sigmas=sigmas, source=source, reason=reason, readings_px=readings_px)


def other_readings(tags: PhotographTags, focal_px: float, width: int, height: int) -> dict[str, float]:
    """Return by their names the focal lengths that a 35 mm equivalent and the sensor's width give read otherwise."""
    long = max(width, height)
    readings: dict[str, float] = {}
    if tags.focal_35mm_mm is not None:
        readings["by the width"] = tags.focal_35mm_mm / WIDTH_35MM_MM * long
        readings["by the picture's own diagonal"] = tags.focal_35mm_mm / DIAGONAL_35MM_MM * hypot(width, height)
    sensor_mm = SENSOR_WIDTH_MM.get((tags.model or "").strip())
    if sensor_mm is not None and tags.focal_mm is not None:
        readings[f"by the sensor's width of {sensor_mm:g} mm"] = tags.focal_mm / sensor_mm * long
    return {name: value for name, value in readings.items() if abs(value / focal_px - 1.0) > _ALIKE}


def _from_35mm(tags: PhotographTags, width: int, height: int) -> _Interior | None:
    equivalent = tags.focal_35mm_mm
    if equivalent is None:
        return None
    diagonal_mm = None if tags.focal_mm is None else tags.focal_mm / equivalent * DIAGONAL_35MM_MM
    diagonal = whole_diagonal_px(width, height, diagonal_mm)
    part = diagonal > 1.005 * hypot(width, height)
    of = "the whole sensor, of which the picture is a part," if part else "the picture"
    lens = "" if tags.focal_mm is None else f"EXIF focal length {tags.focal_mm:g} mm, "
    focal_px = equivalent / DIAGONAL_35MM_MM * diagonal
    others = other_readings(tags, focal_px, width, height)
    read = "; ".join(f"{value:.0f} px {name}" for name, value in others.items())
    covers = f" Read otherwise it is {read}: the sigma covers half of that too." if others else ""
    return _undistorted(
        focal_px,
        f"{lens}35 mm equivalent {equivalent:g} mm",
        f"{equivalent:g} / {DIAGONAL_35MM_MM:g} of the diagonal of {of} {diagonal:.0f} px; the equivalent is a whole "
        f"number, so 3 %.{covers} The distortion is unknown: its sigmas are typical of lenses.",
        tuple(others.values()),
    )


def _from_resolution(tags: PhotographTags) -> _Interior | None:
    if tags.focal_mm is None or tags.pixels_per_mm is None:
        return None
    return _undistorted(
        tags.focal_mm * tags.pixels_per_mm,
        f"EXIF focal length {tags.focal_mm:g} mm, {tags.pixels_per_mm:.1f} pixels per mm on the sensor",
        "correct for photographs of original size: resized copies often keep the resolution of the original. "
        "The distortion is unknown.",
    )


def _from_camera_tags(tags: PhotographTags) -> _Interior | None:
    if tags.calibrated_focal_mm is None or tags.pixels_per_mm is None:
        return None
    radial_sigmas = (0.05, 0.05, 0.05) if tags.calibrated_radial else _EXIF_OTHERS[:3]
    return _Interior(
        focal_px=tags.calibrated_focal_mm * tags.pixels_per_mm,
        radial=tags.calibrated_radial or (0.0, 0.0, 0.0),
        sigmas=(0.01, _EXIF_CENTRE, *radial_sigmas, *_EXIF_OTHERS[3:5]),
        source=f"the maker's calibration in the tags, {tags.calibrated_focal_mm:g} mm at {tags.pixels_per_mm:.1f} "
        "pixels per mm",
        reason="focal length and radial distortion of this camera; its principal point and tangential terms are not "
        "used, because their axes are not defined.",
    )


def _dewarp_scale(dewarp: Dewarp, width: int, height: int) -> float | None:
    """Return the size of the picture in that of the calibration's, None where it is another part of the sensor."""
    if dewarp.size_px is None:
        return 1.0
    scale = width / dewarp.size_px[0]
    if abs(scale * dewarp.size_px[1] / height - 1.0) > _SAME:
        return None
    return 1.0 if abs(scale - 1.0) < _SAME else scale


def _from_dewarp(tags: Sequence[PhotographTags], width: int, height: int) -> _Interior | None:
    calibrations = Counter(t.dewarp for t in tags if t.dewarp is not None)
    if not calibrations:
        return None
    dewarp, _ = calibrations.most_common(1)[0]
    scale = _dewarp_scale(dewarp, width, height)
    if scale is None:
        return None
    fx, fy = (scale * f for f in dewarp.focal_px)
    focal = 0.5 * (fx + fy)
    others = (
        f" The photographs carry {len(calibrations)} different ones, this is the most frequent."
        if len(calibrations) > 1
        else ""
    )
    scaled = "" if scale == 1.0 else f" scaled by {scale:.4g} to the size of the pictures,"
    source = f"DewarpData of {dewarp.date}"
    if dewarp.applied:
        return _Interior(
            focal_px=focal,
            sigmas=(0.01, 0.005, 0.01, 0.01, 0.01, 0.001, 0.001),
            source=f"{source}, distortion removed by the camera",
            reason=f"the camera has taken the distortion out of the pictures (DewarpFlag 1),{scaled} so only residual "
            f"distortion is left.{others}",
        )
    spread = 0.5 * abs(fx - fy) / focal
    apart = f" Focal length {fx:.1f} px across and {fy:.1f} px down: the mean is taken." if spread > 0.0005 else ""
    return _Interior(
        focal_px=focal,
        centre_offset_px=(scale * dewarp.centre_offset_px[0], scale * dewarp.centre_offset_px[1]),
        radial=dewarp.radial,
        tangential=dewarp.tangential,
        sigmas=(max(0.002, spread), 0.001, 0.01, 0.01, 0.01, 0.001, 0.001),
        source=source,
        reason=f"the maker's calibration of this lens,{scaled} which ages with time and shocks.{apart}{others}",
    )


def _given(focal_px: float) -> _Interior:
    return _Interior(
        focal_px=focal_px,
        source="focal length given on the command line",
        reason="3 % of the focal length; reduce it if you know it better.",
    )


def _checked(calibrated: _Interior | None, exif: _Interior | None) -> _Interior | None:
    """Return the calibration unless EXIF contradicts it: it then belongs to pictures of another size."""
    if calibrated is None or exif is None:
        return calibrated
    ratio = calibrated.focal_px / exif.focal_px
    return calibrated if 1.0 / _DISAGREEMENT < ratio < _DISAGREEMENT else None


def tagged_camera(name: str, tags: Sequence[PhotographTags], given_focal_px: float | None) -> TaggedCamera | None:
    """Return a camera from the tags of all its photographs, None where they do not give its focal length.

    ``given_focal_px`` comes before anything that the tags say.
    """
    first = tags[0]
    if first.width_px is None or first.height_px is None:
        raise ValueError(f"{name}: tags without the size of the photograph")
    width, height = first.width_px, first.height_px
    exif = _from_35mm(first, width, height)
    interior = (
        _given(given_focal_px)
        if given_focal_px is not None
        else _checked(_from_dewarp(tags, width, height), exif)
        or _checked(_from_camera_tags(first), exif)
        or exif
        or _from_resolution(first)
    )
    if interior is None:
        return None
    focal_sigma, centre_sigma, *others = interior.sigmas
    distortion, affinity = others[:5], [sigma * interior.focal_px for sigma in others[5:] or (0.0, 0.0)]
    shutter = shutter_of(tags)
    if shutter is not None:
        affinity = [0.0, 0.0]
    return TaggedCamera(
        name,
        width,
        height,
        interior.focal_px,
        ((width - 1) / 2 + interior.centre_offset_px[0], (height - 1) / 2 + interior.centre_offset_px[1]),
        interior.radial,
        interior.tangential,
        (focal_sigma * interior.focal_px, centre_sigma * width, *distortion, *affinity),
        interior.source,
        interior.reason,
        interior.readings_px,
        shutter,
    )
