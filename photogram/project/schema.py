"""The keys of project.yaml and what may stand there: one class for each block of the file.

A field that the file must give is None until it is given and carries `Required`, so that one reading finds every error
of a file; after Document.raise_errors none of them is None.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainValidator, WithJsonSchema, create_model

from photogram.files.tables.position_files import Format
from photogram.geodesy.height_systems import HeightSystem
from photogram.project.document import Entry, Required, described, suggestion
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
from photogram.settings.settings import Default, Within
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

DEFAULT_FLIGHT = "1"
"""Flight of the photographs of which nobody says one."""
COLUMNS = "What its columns are, where it does not name them, such as [name, northing, easting, height, code]."
_FEWEST_COLUMNS = 4
SIGMA_ASSUMED = "Whether nobody has stated it: it is estimated."
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


def _read_by(read: Callable[[Any], object], schema: Mapping[str, object]) -> PlainValidator:
    """Return what validates a value by a function, and the JSON Schema of what that accepts."""
    return PlainValidator(read, json_schema_input_type=Annotated[Any, WithJsonSchema(dict(schema))])


def _vector(*names: str, within: Within, fewest: int | None = None) -> PlainValidator:
    """Validate a list of one number in its range per name, or of the first ``fewest`` names and more."""
    least = len(names) if fewest is None else fewest
    count = f"{len(names)}" if least == len(names) else f"{least} to {len(names)}"

    def read(value: object) -> tuple[float, ...]:
        if not isinstance(value, list) or not least <= len(value) <= len(names):
            raise ValueError(f"needs {count} numbers [{', '.join(names)}], found {described(value)}")
        numbers = [_number(v) for v in value]
        wrong = []
        for name, raw, number in zip(names, value, numbers, strict=False):
            if number is None:
                wrong.append(f"{name} must be a finite number, found {described(raw)}")
            elif not within.holds(number):
                wrong.append(f"{name} must be {within}, found {described(raw)}")
        if wrong:
            raise ValueError("; ".join(wrong))
        return tuple(n for n in numbers if n is not None)

    items = {"type": "number", **within.limits}
    return _read_by(read, {"type": "array", "items": items, "minItems": least, "maxItems": len(names)})


def _text(value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    if not isinstance(value, str):
        quotes = ': write it in quotes, "1.10" for example' if isinstance(value, float | bool) else ""
        raise ValueError(f"must be text, found {described(value)}{quotes}")
    if not value.strip():
        raise ValueError("must not be empty")
    return value


def _two_names(of: str) -> PlainValidator:
    """Validate a list of two names of what ``of`` says."""

    def read(value: object) -> tuple[str, str]:
        if not isinstance(value, list) or len(value) != 2:
            raise ValueError(f"needs the names of two {of}, found {described(value)}")
        return _text(value[0]), _text(value[1])

    return _read_by(read, {**_TWO, "items": _TEXT})


def _columns(value: object) -> tuple[str, ...]:
    """Validate the names of a table's columns."""
    if not isinstance(value, list) or len(value) < _FEWEST_COLUMNS:
        raise ValueError(f"needs a name for each column, [name, easting, northing, height], found {described(value)}")
    return tuple(map(_text, value))


def _freedom(value: object) -> float:
    if value == "free":
        return math.inf
    number = _number(value)
    if number is None or not (number == 0 or FREEDOM.holds(number)):
        raise ValueError(f"must be 0 (held fixed), a prior sigma {FREEDOM}, or free, found {described(value)}")
    return number


def _role(value: object) -> Role:
    for role in _ROLES:
        if value == role:
            return role
    near = f": {suggestion(value, _ROLES)}" if isinstance(value, str) else ""
    raise ValueError(f"must be control or check, found {described(value)}{near}")


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
        raise ValueError(f"needs 2 whole numbers [width, height] {PIXELS}, found {described(value)}")
    return whole[0], whole[1]


_TEXT = {"type": ["string", "integer"], "pattern": r"\S"}
_ROLE = {"enum": [*_ROLES]}
_TWO = {"type": "array", "minItems": 2, "maxItems": 2}

Text = Annotated[str, _read_by(_text, _TEXT)]
Columns = Annotated[tuple[str, ...], _read_by(_columns, {"type": "array", "items": _TEXT, "minItems": _FEWEST_COLUMNS})]
Freedom = Annotated[
    float,
    _read_by(_freedom, {"anyOf": [{"const": "free"}, {"type": "number", **replace(FREEDOM, or_zero=True).limits}]}),
]
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
PositionSigma = Annotated[tuple[float, float, float], _vector(*_MAP, within=SIGMA_M)]
OffsetSigma = Annotated[tuple[float, float, float], _vector(*_MAP, within=OFFSET_SIGMA_M)]
OneRole = Annotated[Role, _read_by(_role, _ROLE)]
_BOTH_ROLES = {
    "type": "object",
    "properties": {"plan": _ROLE, "height": _ROLE},
    "required": ["plan", "height"],
    "additionalProperties": False,
}
RolesOf = Annotated[Roles, _read_by(_roles, {"anyOf": [_ROLE, _BOTH_ROLES]})]
LeverArm = Annotated[tuple[float, float, float], _vector("forward", "right", "down", within=LEVER_ARM_M)]
Offset = Annotated[tuple[float, float, float], _vector("right", "down", "forward", within=LEVER_ARM_M)]
Rotation3 = Annotated[tuple[float, float, float], _vector("x", "y", "z", within=ANGLE_DEG)]
_ENDS = _two_names("ground points or two photographs")
_POINTS = _two_names("ground points")
PictureSize = Annotated[
    tuple[int, int], _read_by(_picture_size, {**_TWO, "items": {"type": "integer", **PIXELS.limits}})
]
Pixel = Annotated[tuple[float, float], _vector("u", "v", within=PLACE_PX)]
Place = Annotated[tuple[float, float], _vector("east", "north", within=POSITION_M)]

_MOVES = "How far it may move: 0 fixed, a prior sigma, or free."
_SIGMAS = dict.fromkeys(SIGMA_KEYS, (Annotated[Freedom, _MOVES], 0.0))
_Sigmas: type[Entry] = create_model("_Sigmas", __base__=Entry, **_SIGMAS)  # type: ignore[call-overload]


class CameraSigmas(_Sigmas):  # type: ignore[misc, valid-type]
    """How far each parameter of a camera may move; 0 holds it fixed, infinity leaves it free."""

    @property
    def of_parameters(self) -> tuple[float, ...]:
        """Return the sigmas in the order of PARAMETER_NAMES."""
        return tuple(float(getattr(self, p.sigma_key)) for p in CAMERA_PARAMETERS)


def _values_of(key: str, within: Within, fewest: int | None = None) -> PlainValidator:
    """Validate the list of the parameters of a camera that stand at a key; messages call them by their names."""
    names = [p.name.removesuffix("_px") for p in CAMERA_PARAMETERS if p.key == key]
    return _vector(*names, within=within, fewest=fewest)


PrincipalPoint = Annotated[tuple[float, float], _values_of("principal_point_px", PLACE_PX)]
Radial = Annotated[tuple[float, ...], _values_of("radial", DISTORTION, fewest=2)]
Tangential = Annotated[tuple[float, float], _values_of("tangential", DISTORTION)]
Affinity = Annotated[tuple[float, float], _values_of("affinity", PLACE_PX)]


class CameraEntry(Entry):
    """One camera."""

    width_px: Annotated[Size | None, Required("the width of its photographs in pixels")] = None
    height_px: Annotated[Size | None, Required("the height of its photographs in pixels")] = None
    matlab: Annotated[Text | None, "A .mat with its calibration, instead of the figures."] = None
    model: Annotated[Model | None, "`brown` for frame cameras (default), `fisheye` equidistant."] = None
    focal_px: Annotated[FocalLength | None, "Focal length in pixels."] = None
    focal_readings_px: Annotated[tuple[FocalLength, ...], "Other focal lengths that its source may mean."] = ()
    principal_point_px: Annotated[PrincipalPoint | None, "Principal point."] = None
    radial: Annotated[Radial | None, "k1, k2, and k3, k4 where there are; default 0."] = None
    tangential: Annotated[Tangential | None, "p1, p2; default 0."] = None
    affinity: Annotated[Affinity | None, "b1, b2 in px; default 0."] = None
    readout_s: Annotated[ReadoutTime | None, "Rolling shutter: from the first row to the last, s."] = None
    pixel_origin: Annotated[PixelOrigin | None, "Where the centre of the top-left pixel is."] = None
    sigmas: Annotated[CameraSigmas, "How far each parameter may move; default: all fixed."] = CameraSigmas()
    calibration: Annotated[Calibration, "`given`: estimate as the sigmas say; `auto`: where the block supports it."] = (
        "given"
    )
    per_flight: Annotated[bool, "Whether each flight has a calibration of its own."] = False
    source: Annotated[Text | None, "Where the figures come from, for the report."] = None
    mask: Annotated[Text | None, "A mask for all its photographs."] = None


class Attitude(Entry):
    """A gimbal's angles, DJI's convention."""

    yaw: Annotated[Angle | None, Required("the heading in degrees, clockwise from north")] = None
    pitch: Annotated[Angle | None, Required("the pitch in degrees, -90 straight down")] = None
    roll: Annotated[Angle | None, Required("the roll in degrees, 0 for a level gimbal")] = None


class PhotographEntry(Entry):
    """One photograph."""

    name: Annotated[Text | None, Required("the photograph's file name")] = None
    camera: Annotated[Text | None, "Its name under cameras."] = None
    gnss_m: Annotated[Position | None, "Easting, northing and height in the crs, m."] = None
    gnss: Annotated[MapPosition | None, "The same in the units of the crs, instead."] = None
    gnss_sigma_m: Annotated[PositionSigma | None, "Standard deviations of its position, m."] = None
    attitude_deg: Annotated[Attitude | None, "The gimbal's angles."] = None
    attitude_sigma_deg: Annotated[AngleSigma | None, "Standard deviation of the attitude."] = None
    height_above_ground_m: Annotated[FlyingHeight | None, "Flying height."] = None
    flight: Annotated[Text, "Photographs of one flight share one GNSS offset."] = DEFAULT_FLIGHT


class PositionFileEntry(Entry):
    """A file of positions of photographs, and what it does not say itself."""

    path: Annotated[Text | None, Required("the file with the positions, relative to this file")] = None
    format: Annotated[Format | None, "Its format, where its name does not tell."] = None
    columns: Annotated[Columns | None, COLUMNS] = None
    position_of: Annotated[PositionOf | None, "Whose positions they are; needed for a table."] = None
    crs: Annotated[Text | None, "CRS of a table, where that is not the project's."] = None
    heights: Annotated[HeightSystem | None, "What its heights are counted from."] = None
    flight: Annotated[Text | None, "The only flight that is meant."] = None
    lever_arms: Annotated[Text | None, "An MRK with the way from the antenna to the camera at each exposure."] = None


class MasksEntry(Entry):
    """The folder of the photographs' masks, and what is masked automatically."""

    folder: Annotated[Text | None, "Folder of masks; black is left out."] = None
    auto: Annotated[Sequence[AutomaticMask], "What is masked without a file."] = ()


def _masks(value: object) -> object:
    """Read the short form: the folder alone."""
    if value is not None and not isinstance(value, dict):
        return {"folder": _text(value)}
    return value


class PhotographsEntry(Entry):
    """The photographs and what holds for all of them."""

    folder: Annotated[Text | None, Required("the folder of the photographs, relative to this file")] = None
    masks: Annotated[
        MasksEntry | None,
        BeforeValidator(_masks, json_schema_input_type=MasksEntry | Text | None),
        "Folder of masks, or a block.",
    ] = None
    camera: Annotated[Text | None, "The camera of all that name none."] = None
    positions: Annotated[Sequence[PositionFileEntry], "Positions in other files."] = ()
    gnss_sigma_m: Annotated[PositionSigma | None, "Standard deviations of all positions that have none, m."] = None
    gnss_sigma_assumed: Annotated[bool, SIGMA_ASSUMED] = False
    attitude_sigma_deg: Annotated[AngleSigma, "Standard deviation of attitudes that have none."] = 2.0
    height_above_ground_m: Annotated[FlyingHeight | None, "Flying height, where tags do not say it."] = None
    list: Annotated[Sequence[PhotographEntry] | None, "The photographs.", Default("all of the folder")] = None


class GnssEntry(Entry):
    """The offset between GNSS and ground control, and the lever arm from the antenna to the camera."""

    offset_sigma_m: Annotated[
        OffsetSigma, "Prior of the offset between GNSS and control, one per flight; default 0, none."
    ] = (0.0, 0.0, 0.0)
    lever_arm_m: Annotated[LeverArm | None, "From the antenna to the camera: forward, right, down."] = None
    lever_arm_axes: Annotated[LeverArmAxes, "Axes of the aircraft, or of the camera."] = "body"
    lever_arm_per_flight_m: Annotated[dict[str, LeverArm], "Instead of it, by flight."] = Field(default_factory=dict)


class HeightsEntry(Entry):
    """What heights are counted from: those of all results, and of what comes in."""

    output: Annotated[HeightSystem | None, "Of all results; needed unless the crs is compound."] = None
    gnss: Annotated[HeightSystem | None, "Of GNSS positions.", Default("as the tags say")] = None
    control_points: Annotated[HeightSystem | None, "Of ground points."] = None
    geoid: Annotated[Text | None, "EGM84, EGM96, EGM2008, a vertical CRS, or the path of a grid."] = None
    grid: Annotated[Text | None, "File of that geoid, where PROJ has none."] = None


def _heights(value: object) -> object:
    """Read the short form: one word for all heights."""
    if value == "ellipsoidal":
        return {"output": value, "gnss": value, "control_points": value}
    if value is not None and not isinstance(value, dict):
        text = "ellipsoidal, or a mapping of keys: output, gnss, control_points, geoid, grid"
        if value == "orthometric":
            text = "a mapping of keys, output: orthometric and geoid: EGM96 for example"
        raise ValueError(f"needs {text}, found {described(value)}")
    return value


class ControlPointEntry(Entry):
    """One ground point."""

    name: Annotated[Text | None, Required("the point's name")] = None
    role: Annotated[RolesOf, "A check point is never used in the adjustment; default control."] = ("control", "control")
    position_m: Annotated[Position | None, "Easting, northing and height in the crs, m."] = None
    position: Annotated[MapPosition | None, "The same in the units of the crs, instead."] = None
    sigma_m: Annotated[PositionSigma | None, "Standard deviations of its position, m."] = None
    mark_sigma_px: Annotated[MarkSigma | None, "Standard deviation of its marks."] = None
    marks: Annotated[dict[str, Pixel], "u right and v down, by photograph."] = Field(default_factory=dict)


class ControlFileEntry(Entry):
    """A file of ground points, and what it does not say itself."""

    path: Annotated[Text | None, Required("the file with the points, relative to this file")] = None
    role: Annotated[RolesOf, "Of points whose file says nothing; default control."] = ("control", "control")
    roles: Annotated[dict[str, RolesOf], "Of single points, in place of what the file says."] = Field(
        default_factory=dict
    )
    marks: Annotated[Text | None, "The file with their marks."] = None
    columns: Annotated[Columns | None, COLUMNS] = None
    crs: Annotated[Text | None, "CRS of the points.", Default("what the file says, else the project's")] = None
    heights: Annotated[HeightSystem | None, "What its heights are counted from."] = None
    picture_size_px: Annotated[
        PictureSize | None, "Of the pictures with the marks.", Default("the photographs' own")
    ] = None
    sigma_m: Annotated[PositionSigma | None, "Standard deviations of points that have none, m."] = None
    sigma_assumed: Annotated[bool, SIGMA_ASSUMED] = False
    mark_sigma_px: Annotated[MarkSigma | None, "Standard deviation of marks that have none."] = None
    mark_sigma_assumed: Annotated[bool, SIGMA_ASSUMED] = False


class ControlPointsEntry(Entry):
    """The ground points and what holds for all of them."""

    sigma_m: Annotated[PositionSigma | None, "Standard deviations of points that have none, m."] = None
    sigma_assumed: Annotated[bool, SIGMA_ASSUMED] = False
    mark_sigma_px: Annotated[MarkSigma | None, "Standard deviation of marks that have none."] = None
    mark_sigma_assumed: Annotated[bool, SIGMA_ASSUMED] = False
    pixel_origin: Annotated[PixelOrigin, "Where the centre of the top-left pixel is, for all marks."] = "photogram"
    files: Annotated[Sequence[ControlFileEntry], "Ground points in other files."] = ()
    list: Annotated[Sequence[ControlPointEntry], "The ground points."] = ()


class _ConstraintEntry(Entry):
    """What holds for every observation between points."""

    name: Annotated[Text | None, "What the report calls it."] = None
    role: Annotated[OneRole, "`check` tests the result and touches nothing of it."] = "control"


class DistanceEntry(_ConstraintEntry):
    """A measured distance between two ground points or two photographs."""

    between: Annotated[tuple[str, str] | None, _ENDS, Required("the names of its two ends")] = None
    length_m: Annotated[float | None, LENGTH_M, Required("the measured length in metres")] = None
    sigma_m: Annotated[float | None, SIGMA_M, Required("its standard deviation in metres")] = None


class HeightDifferenceEntry(_ConstraintEntry):
    """A levelled height difference between two ground points."""

    between: Annotated[tuple[str, str] | None, _POINTS, Required("the names of its two points, from and to")] = None
    difference_m: Annotated[float | None, RISE_M, Required("height of the second minus height of the first, m")] = None
    sigma_m: Annotated[float | None, SIGMA_M, Required("its standard deviation in metres")] = None


class SurfaceEntry(_ConstraintEntry):
    """Ground points of one level surface, or of one plane."""

    points: Annotated[tuple[Text, ...] | None, Required("the names of its points")] = None
    sigma_m: Annotated[float | None, SIGMA_M, Required("the standard deviation of a point from it in metres")] = None


class CompanionEntry(Entry):
    """A camera on the body of a rig's master, and what is given of where it sits; without, that is free."""

    camera: Annotated[Text | None, Required("the companion's name under cameras")] = None
    offset_m: Annotated[Offset | None, "Right, down, forward of the master's projection centre."] = None
    offset_sigma_m: Annotated[float | None, SIGMA_M, "Standard deviation of the offset."] = None
    rotation_deg: Annotated[Rotation3 | None, "About x, y, z, from its axes to the master's."] = None
    rotation_sigma_deg: Annotated[AngleSigma | None, "Standard deviation of the rotation."] = None
    products: Annotated[bool, "Whether surface and orthophoto use its photographs."] = True


class RigEntry(Entry):
    """Cameras on one body: a master, its companions, and how photographs are grouped to exposures."""

    master: Annotated[Text | None, Required("the master's name under cameras")] = None
    companions: Annotated[Sequence[CompanionEntry] | None, Required("the other cameras of the body")] = None
    exposures: Annotated[ExposureGrouping | None, Required("how photographs are grouped: capture, name or time")] = None
    name_pattern: Annotated[Text | None, "Regular expression; its groups are the same for one exposure."] = None
    tolerance_s: Annotated[float | None, TOLERANCE_S, "Longest time between photographs of one exposure."] = None
    sigma_m: Annotated[float | None, SIGMA_M, Required("by how much the offset of an exposure scatters, m")] = None
    sigma_deg: Annotated[float | None, ANGLE_SIGMA_DEG, Required("by how much its rotation scatters, degrees")] = None


class FlightEntry(Entry):
    """One flight: its name, and which photographs were taken on it."""

    name: Annotated[Text | None, Required("what the flight is called")] = None
    photographs: Annotated[
        Sequence[Text] | None, Required("patterns of the names of its photographs, [battery1/*.JPG] for example")
    ] = None


class EpochEntry(Entry):
    """One epoch: its name, and which photographs were taken in it."""

    name: Annotated[Text | None, Required("what its results are called, may for example")] = None
    photographs: Annotated[
        Sequence[Text] | None, Required("patterns of the names of its photographs, [may/*.JPG] for example")
    ] = None


class StartEntry(Entry):
    """What another program has determined, and what of it the project starts from."""

    solution: Annotated[Text | None, Required("the file that photogram import has written")] = None
    tie_points: Annotated[Whose, "Its tie points, or own key points and matches."] = "theirs"
    poses: Annotated[Whose, "Its poses, or an own orientation."] = "theirs"


class ComparisonEntry(Entry):
    """What the results are compared with."""

    reference: Annotated[Text | None, "A surface or a cloud, relative to this file."] = None
    heights: Annotated[HeightSystem | None, "What its heights are counted from.", Default("as the results")] = None


class ProjectFile(Entry):
    """A survey of photogram; the settings are read by read_settings."""

    photogram: Annotated[
        int | None, WithJsonSchema({"const": 1}), Required("write photogram: 1, the format of this file")
    ] = None
    crs: Annotated[Text | None, Required("the map grid, crs: EPSG:25832 for example, or none")] = None
    heights: Annotated[
        HeightsEntry | None,
        BeforeValidator(_heights, json_schema_input_type=HeightsEntry | Literal["ellipsoidal"] | None),
        "What heights are counted from: one word, or a block.",
    ] = None
    datum_accuracy_m: Annotated[float | None, SIGMA_M, "What is accepted where PROJ lacks a grid."] = None
    datum_grid: Annotated[Text | None, "The file of the grid between the datums."] = None
    world: Annotated[Literal["tangent", "grid"], "`grid` takes the map as Cartesian: exercises only."] = "tangent"
    quality: Annotated[Quality, "Size of the pictures in which key points are found: full, half, quarter."] = "high"
    cameras: Annotated[dict[str, CameraEntry], Required("a block for each camera, under its name")] = Field(
        default_factory=dict
    )
    photographs: Annotated[PhotographsEntry, "The photographs."] = PhotographsEntry()
    gnss: Annotated[GnssEntry, "Offset and lever arm of GNSS."] = GnssEntry()
    control_points: Annotated[ControlPointsEntry, "The ground points."] = ControlPointsEntry()
    distances: Annotated[Sequence[DistanceEntry], "Measured lengths."] = ()
    height_differences: Annotated[Sequence[HeightDifferenceEntry], "Levelled height differences."] = ()
    level_surfaces: Annotated[Sequence[SurfaceEntry], "Points of one unknown height, three or more."] = ()
    planes: Annotated[Sequence[SurfaceEntry], "Points of one unknown plane, four or more."] = ()
    rigs: Annotated[Sequence[RigEntry], "Cameras on one body."] = ()
    flights: Annotated[Sequence[FlightEntry], "Flights by the names of their photographs."] = ()
    epochs: Annotated[Sequence[EpochEntry], "Epochs of one site, oldest first, adjusted together."] = ()
    start: Annotated[StartEntry | None, "The solution of another program to start from."] = None
    features: Any = None
    pairs: Any = None
    matching: Any = None
    orientation: Any = None
    transfer: Any = None
    known_surface: Any = None
    adjustment: Any = None
    dense: Any = None
    surface: Any = None
    terrain: Any = None
    contours: Any = None
    volumes: Any = None
    orthophoto: Any = None
    comparison: Annotated[ComparisonEntry, "What the results are compared with."] = ComparisonEntry()
    report: Any = None
    results: Annotated[Text, "Folder of the deliverables."] = "results"
    work: Annotated[Text, "Folder of intermediate results."] = "work"
