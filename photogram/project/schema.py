"""The keys of project.yaml and what may stand there: one class for each block of the file.

A field that the file must give is None until it is given and carries `Needed`, so that one reading finds every fault of
a file; after Document.raise_faults none of them is None.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainValidator, create_model

from photogram.files.tables.position_files import Format
from photogram.height_systems import HeightSystem
from photogram.project.document import Entry, Needed, found, suggestion
from photogram.project.ranges import (
    ANGLE_DEG,
    ANGLE_SIGMA_DEG,
    DISTORTION,
    FLYING_HEIGHT_M,
    FOCAL_PX,
    FREEDOM,
    LENGTH_M,
    LEVER_ARM_M,
    OFFSET_SIGMA_M,
    PIXELS,
    PLACE_PX,
    POSITION,
    POSITION_M,
    READOUT_S,
    RISE_M,
    SIGMA_M,
    SIGMA_PX,
    TOLERANCE_S,
)
from photogram.projection import CAMERA_PARAMETERS, SIGMA_KEYS, Model
from photogram.settings.settings import Within
from photogram.survey import Role, Roles

PixelOrigin = Literal["photogram", "matlab", "colmap"]

Quality = Literal["high", "medium", "low"]
REDUCTIONS: Mapping[Quality, int] = MappingProxyType({"high": 1, "medium": 2, "low": 4})
"""How many times less wide the picture is in which key points are found."""
Calibration = Literal["given", "auto"]
PositionOf = Literal["camera", "antenna"]
LeverArmAxes = Literal["body", "camera"]
Whose = Literal["theirs", "own"]
AutomaticMask = Literal["sky", "water"]
ExposureGrouping = Literal["capture", "name", "time"]

_ROLES: tuple[Role, ...] = ("control", "check")

PIXEL_ORIGIN_PX: dict[PixelOrigin, float] = {"photogram": 0.0, "matlab": 1.0, "colmap": 0.5}
"""Coordinate of the centre of the top-left pixel, in both directions, in each convention."""


def _number(value: object) -> float | None:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        return float(value) if math.isfinite(value) else None
    except OverflowError:
        return None  # a whole number of hundreds of digits


def _vector(*names: str, within: Within, fewest: int | None = None) -> PlainValidator:
    """Validate a list of one number in its range per name, or of the first ``fewest`` names and more."""
    least = len(names) if fewest is None else fewest
    count = f"{len(names)}" if least == len(names) else f"{least} to {len(names)}"

    def read(value: object) -> tuple[float, ...]:
        if not isinstance(value, list) or not least <= len(value) <= len(names):
            raise ValueError(f"needs {count} numbers [{', '.join(names)}], found {found(value)}")
        numbers = [_number(v) for v in value]
        wrong = []
        for name, raw, number in zip(names, value, numbers, strict=False):
            if number is None:
                wrong.append(f"{name} must be a finite number, found {found(raw)}")
            elif not within.holds(number):
                wrong.append(f"{name} must be {within}, found {found(raw)}")
        if wrong:
            raise ValueError("; ".join(wrong))
        return tuple(n for n in numbers if n is not None)

    return PlainValidator(read)


def _text(value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    if not isinstance(value, str):
        quotes = ': write it in quotes, "1.10" for example' if isinstance(value, float | bool) else ""
        raise ValueError(f"must be text, found {found(value)}{quotes}")
    if not value.strip():
        raise ValueError("must not be empty")
    return value


def _ends(value: object) -> tuple[str, str]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"needs the names of two ground points or two photographs, found {found(value)}")
    first, second = (_text(name) for name in value)
    return first, second


def _two_points(value: object) -> tuple[str, str]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"needs the names of two ground points, found {found(value)}")
    first, second = (_text(name) for name in value)
    return first, second


def _freedom(value: object) -> float:
    if value == "free":
        return math.inf
    number = _number(value)
    if number is None or not (number == 0 or FREEDOM.holds(number)):
        raise ValueError(f"must be 0 (held fixed), a prior sigma {FREEDOM}, or free, found {found(value)}")
    return number


def _role(value: object) -> Role:
    for role in _ROLES:
        if value == role:
            return role
    near = f": {suggestion(value, _ROLES)}" if isinstance(value, str) else ""
    raise ValueError(f"must be control or check, found {found(value)}{near}")


def _roles(value: object) -> Roles:
    if not isinstance(value, dict):
        role = _role(value)
        return role, role
    if set(value) != {"plan", "height"}:
        raise ValueError("needs both, {plan: control, height: check} for example")
    return _role(value["plan"]), _role(value["height"])


def _picture_size(value: object) -> tuple[int, int]:
    items = value if isinstance(value, list) else []
    whole = [v for v in items if isinstance(v, int) and not isinstance(v, bool) and PIXELS.holds(v)]
    if len(items) != 2 or len(whole) != 2:
        raise ValueError(f"needs 2 whole numbers [width, height] {PIXELS}, found {found(value)}")
    return whole[0], whole[1]


Text = Annotated[str, PlainValidator(_text)]
Freedom = Annotated[float, PlainValidator(_freedom)]
Size = Annotated[int, PIXELS]
Angle = Annotated[float, ANGLE_DEG]
AngleSigma = Annotated[float, ANGLE_SIGMA_DEG]
FocalLength = Annotated[float, FOCAL_PX]
ReadoutTime = Annotated[float, READOUT_S]
FlyingHeight = Annotated[float, FLYING_HEIGHT_M]
MarkSigma = Annotated[float, SIGMA_PX]
_MAP = ("easting", "northing", "height")
Position = Annotated[tuple[float, float, float], _vector(*_MAP, within=POSITION_M)]
MapPosition = Annotated[tuple[float, float, float], _vector(*_MAP, within=POSITION)]
Sigma3 = Annotated[tuple[float, float, float], _vector(*_MAP, within=SIGMA_M)]
OffsetSigma = Annotated[tuple[float, float, float], _vector(*_MAP, within=OFFSET_SIGMA_M)]
RolesOf = Annotated[Roles, PlainValidator(_roles)]
OneRole = Annotated[Role, PlainValidator(_role)]
LeverArm = Annotated[tuple[float, float, float], _vector("forward", "right", "down", within=LEVER_ARM_M)]
Offset = Annotated[tuple[float, float, float], _vector("right", "down", "forward", within=LEVER_ARM_M)]
Rotation3 = Annotated[tuple[float, float, float], _vector("x", "y", "z", within=ANGLE_DEG)]
_ENDS = PlainValidator(_ends)
_POINTS = PlainValidator(_two_points)
PictureSize = Annotated[tuple[int, int], PlainValidator(_picture_size)]
Pixel = Annotated[tuple[float, float], _vector("u", "v", within=PLACE_PX)]
Place = Annotated[tuple[float, float], _vector("east", "north", within=POSITION_M)]


_Sigmas: type[Entry] = create_model("_Sigmas", __base__=Entry, **dict.fromkeys(SIGMA_KEYS, (Freedom, 0.0)))  # type: ignore[call-overload]


class CameraSigmas(_Sigmas):  # type: ignore[misc, valid-type]
    """How far each parameter of a camera may move; 0 holds it fixed, infinity leaves it free."""

    @property
    def of_parameters(self) -> tuple[float, ...]:
        """Return the sigmas in the order of PARAMETER_NAMES."""
        return tuple(float(getattr(self, p.sigma_key)) for p in CAMERA_PARAMETERS)


def _names_in(key: str) -> list[str]:
    """Return the parameters of a camera whose values stand at a key, as messages call them."""
    return [p.name.removesuffix("_px") for p in CAMERA_PARAMETERS if p.key == key]


_CENTRE = _vector(*_names_in("principal_point_px"), within=PLACE_PX)


class CameraEntry(Entry):
    """One camera; ``matlab`` stands instead of the figures. ``per_flight`` calibrates it in each flight anew.
    ``focal_readings_px`` are other focal lengths that its source may mean; ``mask`` is that of all its photographs."""

    width_px: Annotated[Size | None, Needed("the width of its photographs in pixels")] = None
    height_px: Annotated[Size | None, Needed("the height of its photographs in pixels")] = None
    matlab: Text | None = None
    model: Model | None = None
    focal_px: FocalLength | None = None
    focal_readings_px: tuple[FocalLength, ...] = ()
    principal_point_px: (
        Annotated[tuple[float, float], _vector(*_names_in("principal_point_px"), within=PLACE_PX)] | None
    ) = None
    radial: Annotated[tuple[float, ...], _vector(*_names_in("radial"), within=DISTORTION, fewest=2)] | None = None
    tangential: Annotated[tuple[float, float], _vector(*_names_in("tangential"), within=DISTORTION)] | None = None
    affinity: Annotated[tuple[float, float], _vector(*_names_in("affinity"), within=PLACE_PX)] | None = None
    readout_s: ReadoutTime | None = None
    pixel_origin: PixelOrigin | None = None
    sigmas: CameraSigmas = CameraSigmas()
    calibration: Calibration = "given"
    per_flight: bool = False
    source: Text | None = None
    mask: Text | None = None


class Attitude(Entry):
    """A gimbal's angles, DJI's convention."""

    yaw: Annotated[Angle | None, Needed("the heading in degrees, clockwise from north")] = None
    pitch: Annotated[Angle | None, Needed("the pitch in degrees, -90 straight down")] = None
    roll: Annotated[Angle | None, Needed("the roll in degrees, 0 for a level gimbal")] = None


class PhotographEntry(Entry):
    """One photograph."""

    name: Annotated[Text | None, Needed("the photograph's file name")] = None
    camera: Text | None = None
    gnss_m: Position | None = None
    gnss: MapPosition | None = None
    gnss_sigma_m: Sigma3 | None = None
    attitude_deg: Attitude | None = None
    attitude_sigma_deg: AngleSigma | None = None
    height_above_ground_m: FlyingHeight | None = None
    flight: Text = "1"


class PositionFileEntry(Entry):
    """A file of positions of photographs, and what it does not say itself."""

    path: Annotated[Text | None, Needed("the file with the positions, relative to this file")] = None
    format: Format | None = None
    position_of: PositionOf | None = None
    crs: Text | None = None
    heights: HeightSystem | None = None
    flight: Text | None = None
    lever_arms: Text | None = None


class MasksEntry(Entry):
    """The folder of the photographs' masks, and what is masked automatically."""

    folder: Text | None = None
    auto: Sequence[AutomaticMask] = ()


def _masks(value: object) -> object:
    """Read the short form: the folder alone."""
    if value is not None and not isinstance(value, dict):
        return {"folder": _text(value)}
    return value


class PhotographsEntry(Entry):
    """The photographs and what holds for all of them."""

    folder: Annotated[Text | None, Needed("the folder of the photographs, relative to this file")] = None
    masks: Annotated[MasksEntry | None, BeforeValidator(_masks)] = None
    camera: Text | None = None
    positions: Sequence[PositionFileEntry] = ()
    gnss_sigma_m: Sigma3 | None = None
    gnss_sigma_assumed: bool = False
    attitude_sigma_deg: AngleSigma = 2.0
    height_above_ground_m: FlyingHeight | None = None
    list: Sequence[PhotographEntry] | None = None


class GnssEntry(Entry):
    """The offset between GNSS and ground control, and the lever arm from the antenna to the camera."""

    offset_sigma_m: OffsetSigma = (0.0, 0.0, 0.0)
    lever_arm_m: LeverArm | None = None
    lever_arm_axes: LeverArmAxes = "body"
    lever_arm_per_flight_m: dict[str, LeverArm] = Field(default_factory=dict)


class HeightsEntry(Entry):
    """What heights are counted from: those of all results, and of what comes in."""

    output: HeightSystem | None = None
    gnss: HeightSystem | None = None
    control_points: HeightSystem | None = None
    geoid: Text | None = None
    grid: Text | None = None


def _heights(value: object) -> object:
    """Read the short form: one word for all heights."""
    if value == "ellipsoidal":
        return {"output": value, "gnss": value, "control_points": value}
    if value is not None and not isinstance(value, dict):
        text = (
            "a mapping of keys, output: orthometric and geoid: EGM96 for example"
            if value == "orthometric"
            else ("ellipsoidal, or a mapping of keys: output, gnss, control_points, geoid, grid")
        )
        raise ValueError(f"needs {text}, found {found(value)}")
    return value


class ControlPointEntry(Entry):
    """One ground point."""

    name: Annotated[Text | None, Needed("the point's name")] = None
    role: RolesOf = ("control", "control")
    position_m: Position | None = None
    position: MapPosition | None = None
    sigma_m: Sigma3 | None = None
    mark_sigma_px: MarkSigma | None = None
    marks: dict[str, Pixel] = Field(default_factory=dict)


class ControlFileEntry(Entry):
    """A file of ground points, and what it does not say itself."""

    path: Annotated[Text | None, Needed("the file with the points, relative to this file")] = None
    role: RolesOf = ("control", "control")
    marks: Text | None = None
    crs: Text | None = None
    heights: HeightSystem | None = None
    picture_size_px: PictureSize | None = None
    sigma_m: Sigma3 | None = None
    mark_sigma_px: MarkSigma | None = None


class ControlPointsEntry(Entry):
    """The ground points and what holds for all of them."""

    sigma_m: Sigma3 | None = None
    mark_sigma_px: MarkSigma | None = None
    pixel_origin: PixelOrigin = "photogram"
    files: Sequence[ControlFileEntry] = ()
    list: Sequence[ControlPointEntry] = ()


class DistanceEntry(Entry):
    """A measured distance between two ground points or two photographs."""

    name: Text | None = None
    between: Annotated[tuple[str, str] | None, _ENDS, Needed("the names of its two ends")] = None
    length_m: Annotated[float | None, LENGTH_M, Needed("the measured length in metres")] = None
    sigma_m: Annotated[float | None, SIGMA_M, Needed("its standard deviation in metres")] = None
    role: OneRole = "control"


class HeightDifferenceEntry(Entry):
    """A levelled height difference between two ground points."""

    name: Text | None = None
    between: Annotated[tuple[str, str] | None, _POINTS, Needed("the names of its two points, from and to")] = None
    difference_m: Annotated[float | None, RISE_M, Needed("height of the second minus height of the first, m")] = None
    sigma_m: Annotated[float | None, SIGMA_M, Needed("its standard deviation in metres")] = None
    role: OneRole = "control"


class SurfaceEntry(Entry):
    """Ground points of one level surface, or of one plane."""

    name: Text | None = None
    points: Annotated[tuple[Text, ...] | None, Needed("the names of its points")] = None
    sigma_m: Annotated[float | None, SIGMA_M, Needed("the standard deviation of a point from it in metres")] = None
    role: OneRole = "control"


class CompanionEntry(Entry):
    """A camera on the body of a rig's master, and what is given of where it sits; without, that is free."""

    camera: Annotated[Text | None, Needed("the companion's name under cameras")] = None
    offset_m: Offset | None = None
    offset_sigma_m: Annotated[float, SIGMA_M] | None = None
    rotation_deg: Rotation3 | None = None
    rotation_sigma_deg: AngleSigma | None = None
    products: bool = True


class RigEntry(Entry):
    """Cameras on one body: a master, its companions, and how photographs are grouped to exposures."""

    master: Annotated[Text | None, Needed("the master's name under cameras")] = None
    companions: Annotated[Sequence[CompanionEntry] | None, Needed("the other cameras of the body")] = None
    exposures: Annotated[ExposureGrouping | None, Needed("how photographs are grouped: capture, name or time")] = None
    name_pattern: Text | None = None
    tolerance_s: Annotated[float, TOLERANCE_S] | None = None
    sigma_m: Annotated[float | None, SIGMA_M, Needed("by how much the offset of an exposure scatters, m")] = None
    sigma_deg: Annotated[float | None, ANGLE_SIGMA_DEG, Needed("by how much its rotation scatters, degrees")] = None


class StartEntry(Entry):
    """What another program has found, and what of it the project starts from."""

    solution: Annotated[Text | None, Needed("the file that photogram import has written")] = None
    tie_points: Whose = "theirs"
    poses: Whose = "theirs"


class ComparisonEntry(Entry):
    """What the results are compared with."""

    reference: Text | None = None
    heights: HeightSystem | None = None


class ProjectFile(Entry):
    """The whole file; the settings are read by read_settings."""

    photogram: Annotated[int | None, Needed("write photogram: 1, the format of this file")] = None
    crs: Annotated[Text | None, Needed("the map grid, crs: EPSG:25832 for example, or none")] = None
    heights: Annotated[HeightsEntry | None, BeforeValidator(_heights)] = None
    datum_accuracy_m: Annotated[float, SIGMA_M] | None = None
    datum_grid: Text | None = None
    world: Literal["tangent", "grid"] = "tangent"
    quality: Quality = "high"
    cameras: Annotated[dict[str, CameraEntry], Needed("a block for each camera, under its name")] = Field(
        default_factory=dict
    )
    photographs: PhotographsEntry = PhotographsEntry()
    gnss: GnssEntry = GnssEntry()
    control_points: ControlPointsEntry = ControlPointsEntry()
    distances: Sequence[DistanceEntry] = ()
    height_differences: Sequence[HeightDifferenceEntry] = ()
    level_surfaces: Sequence[SurfaceEntry] = ()
    planes: Sequence[SurfaceEntry] = ()
    rigs: Sequence[RigEntry] = ()
    start: StartEntry | None = None
    features: Any = None
    pairs: Any = None
    matching: Any = None
    orientation: Any = None
    transfer: Any = None
    adjustment: Any = None
    dense: Any = None
    surface: Any = None
    terrain: Any = None
    contours: Any = None
    orthophoto: Any = None
    comparison: ComparisonEntry = ComparisonEntry()
    report: Any = None
    results: Text = "results"
    work: Text = "work"
