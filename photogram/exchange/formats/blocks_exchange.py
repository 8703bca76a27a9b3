"""BlocksExchange XML of Bentley's ContextCapture and iTwin Capture Modeler: cameras, poses, control and tie points.

    m = F D(Π(O M (X − C))) + c,  F = [[f, 0], [0, ρ f]]

M maps the axes of the world to those of the camera, O these, by CameraOrientation, to x right, y down, z forward; Π is
the perspective projection, D has photogram's formulas with P1 and P2 exchanged, ρ is the aspect ratio; the centre of
the top-left pixel is (0, 0) (ContextCapture User Guide, Perspective camera model).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, rotation_from_omega_phi_kappa
from photogram.errors import ExchangeError, FrameError
from photogram.exchange.formats.assembly import (
    camera_of,
    check_names,
    ground_points_of,
    index_in,
    no_tie_points,
    pose_of,
    sentences,
    tie_points_of,
)
from photogram.files.solutions.parsing import bytes_of, check_finite, file_of, number_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution, Frame
from photogram.files.xml_elements import Element, elements_of
from photogram.geodesy.crs import crs_of_wkt, metric_only
from photogram.survey import ControlPoints, Role, TiePoints
from photogram.wording import printable, shortened, things

_REMEDY = "export the block again"
_MOST_BYTES = 2_000_000_000  # 20 million observations
_START, _END = b"<TiePoints>", b"</TiePoints>"
_NUMBER = rb"[^<\s]{1,40}"


def _pattern(tag: bytes, **values: bytes) -> re.Pattern[bytes]:
    """Return the pattern of an element whose children are these, in this order, with the pattern of each one's text."""
    children = (rb"<%b>\s*(%b)\s*</%b>" % (name.encode(), value, name.encode()) for name, value in values.items())
    return re.compile(rb"<%b>\s*%b\s*</%b>" % (tag, rb"\s*".join(children), tag))


_MEASUREMENT = _pattern(b"Measurement", PhotoId=rb"\d{1,15}", x=_NUMBER, y=_NUMBER)
_POSITION = _pattern(b"Position", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_COLOUR = _pattern(b"Color", Red=_NUMBER, Green=_NUMBER, Blue=_NUMBER)
_POINTS_AT_ONCE = 20_000
_UNKNOWN_SIGMA_PX = 1.0
_ORIENTATIONS = {
    "XRightYDown": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "XLeftYDown": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    "XLeftYUp": [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    "XRightYUp": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "XDownYRight": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    "XDownYLeft": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "XUpYLeft": [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
    "XUpYRight": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}


@dataclass(frozen=True)
class _System:
    """The spatial reference system of a block."""

    frame: Frame
    crs: str | None
    origin_lla: tuple[float, float, float] | None


def read_blocks_exchange(path: Path) -> ForeignSolution:
    """Return the solution of a file of one block.

    Raises ExchangeError with the line where the file is damaged, has several blocks or none, geographic coordinates, a
    skew, or a camera model that photogram has not.
    """
    data = bytes_of(path, _MOST_BYTES)
    section, rest = _without_tie_points(path, data)
    root = elements_of(rest, path, ExchangeError, _REMEDY)
    blocks = list(root.all("BlocksExchange", "Block"))
    if len(blocks) != 1:
        raise ExchangeError(f"{root.place}: holds {things(len(blocks), 'block')}: export one block at a time")
    block = blocks[0]
    definitions = {
        _text(srs, "Id"): _text(srs, "Definition")
        for srs in root.all("BlocksExchange", "SpatialReferenceSystems", "SRS")
    }
    system_id = _system_id(block)
    if system_id is not None and system_id not in definitions:
        raise ExchangeError(f"{block.place}: the block's SRSId {printable(shortened(system_id))} is not there")
    system = _System("local", None, None) if system_id is None else _system(block, definitions[system_id])
    left_out: list[str] = []
    cameras, photographs, index = _photographs(block, system_id, left_out)
    check_names(str(path), (photograph.file for photograph in photographs))
    ground = _ground_points(block, system_id, index, left_out)
    return ForeignSolution(
        program="ContextCapture",
        cameras=cameras,
        photographs=photographs,
        tie_points=_tie_points(path, section, index, left_out),
        ground_points=ground,
        frame=system.frame,
        origin_lla=system.origin_lla,
        crs=system.crs,
        left_out=tuple(left_out),
    )


def _without_tie_points(path: Path, data: bytes) -> tuple[bytes, bytes]:
    """Return the tie points, millions of elements of one kind, and the file without them, its lines in place."""
    start = data.find(_START)
    if start < 0:
        return b"", data
    end = data.find(_END, start)
    if end < 0:
        raise ExchangeError(f"{path}: ends within its tie points: {_REMEDY}")
    section = data[start + len(_START) : end]
    return section, b"".join([data[:start], b"\n" * section.count(b"\n"), data[end + len(_END) :]])


def _text(element: Element, *tags: str) -> str:
    child = element.first(*tags)
    if child is None:
        raise ExchangeError(f"{element.place}: has no {' / '.join(tags)}: {_REMEDY}")
    return child.text


def _text_or(element: Element, tag: str, otherwise: str) -> str:
    child = element.first(tag)
    return otherwise if child is None else child.text


def _system_id(element: Element) -> str | None:
    """Return the number of the spatial reference system that an element names."""
    number = element.first("SRSId")
    return None if number is None else number.text


def _number(element: Element, *tags: str) -> float:
    child = element.first(*tags)
    return number_of((child or element).place, " / ".join(tags), "" if child is None else child.text)


def _number_or(element: Element, tag: str, otherwise: float) -> float:
    return otherwise if element.first(tag) is None else _number(element, tag)


def _vector(element: Element, *tags: str) -> FloatArray:
    """Return x, y and z (3,) of the element at the end of a path of tags."""
    return np.array([_number(element, *tags, axis) for axis in "xyz"])


def _system(block: Element, definition: str) -> _System:
    place = block.place
    if definition.startswith("ENU:"):
        parts = definition[4:].split(",")
        if len(parts) not in (2, 3):
            raise ExchangeError(f"{place}: the origin {printable(shortened(definition))} is not read: {_REMEDY}")
        values = [number_of(place, "the origin of the block", part) for part in parts]
        return _System("topocentric", None, (values[0], values[1], values[2] if len(values) == 3 else 0.0))
    crs = crs_of_wkt(definition)
    if crs is None:
        return _System("local", None, None)
    if crs == "EPSG:4978":
        return _System("geocentric", crs, None)
    try:
        metric_only(crs)
    except FrameError as error:
        raise ExchangeError(
            f"{place}: poses are in {printable(shortened(crs))}, which is no map in metres: export the block in one"
        ) from error
    return _System("map", crs, None)


def _photographs(
    block: Element, system: str | None, left_out: list[str]
) -> tuple[tuple[Camera, ...], tuple[ForeignPhotograph, ...], dict[int, int]]:
    """Return cameras, photographs, and their numbers by their Id."""
    cameras: list[Camera] = []
    photographs: list[ForeignPhotograph] = []
    index: dict[int, int] = {}
    elsewhere = 0
    for group in block.all("Photogroups", "Photogroup"):
        cameras.append(_camera(group))
        orientation = _ORIENTATIONS.get(_text_or(group, "CameraOrientation", "XRightYDown"))
        if orientation is None:
            raise ExchangeError(f"{group.place}: has an unknown CameraOrientation: {_REMEDY}")
        for photo in group.all("Photo"):
            key = _id(photo, "Id")
            if key in index:
                raise ExchangeError(f"{photo.place}: the photograph {key} comes twice: {_REMEDY}")
            index[key] = len(photographs)
            file = file_of(photo.place, _text(photo, "ImagePath"))
            pose = _pose(photo, np.array(orientation, dtype=np.float64))
            measured, other = _measured(photo, system)
            elsewhere += other
            photographs.append(ForeignPhotograph(file.name, len(cameras) - 1, pose, file, measured))
    left_out += sentences((elsewhere, f"{things(elsewhere, 'measured position')} in another CRS."))
    return tuple(cameras), tuple(photographs), index


def _id(element: Element, tag: str) -> int:
    text = _text(element, tag)
    if not re.fullmatch(r"\d{1,15}", text, re.ASCII):
        raise ExchangeError(f"{element.place}: {tag} {printable(shortened(text))!r} is no number: {_REMEDY}")
    return int(text)


def _camera(group: Element) -> Camera:
    place = group.place
    kind = _text_or(group, "CameraModelType", "Perspective")
    if kind != "Perspective":
        raise ExchangeError(
            f"{place}: has the camera model {printable(shortened(kind))}, which photogram has not: only "
            "perspective cameras are read"
        )
    width, height = (_number(group, "ImageDimensions", side) for side in ("Width", "Height"))
    if group.first("FocalLengthPixels") is not None:
        focal = _number(group, "FocalLengthPixels")
    else:
        sensor = _number(group, "SensorSize")
        if not sensor > 0:
            raise ExchangeError(f"{place}: the size of the sensor is {sensor:g}: it must be positive")
        focal = _number(group, "FocalLength") / sensor * max(width, height)
    ratio = _number_or(group, "AspectRatio", 1.0)
    if _number_or(group, "Skew", 0.0) != 0:
        raise ExchangeError(f"{place}: has a skew, whose unit the format leaves open: adjust the block without it")
    centre = (width - 1) / 2, (height - 1) / 2
    if group.first("PrincipalPoint") is not None:
        centre = _number(group, "PrincipalPoint", "x"), _number(group, "PrincipalPoint", "y")
    q = {"K1": 0.0, "K2": 0.0, "K3": 0.0, "P1": 0.0, "P2": 0.0}
    for child in (child for distortion in group.all("Distortion") for child in distortion.children):
        value = number_of(child.place, child.tag, child.text)
        if child.tag not in q and value != 0:
            raise ExchangeError(
                f"{child.place}: has the distortion {printable(child.tag)}, which photogram has not: {_REMEDY}"
            )
        q[child.tag] = value
    return camera_of(
        place,
        _text_or(group, "Name", "camera"),
        (width, height),
        focal * ratio,
        centre,
        (q["K1"], q["K2"], q["K3"]),
        (q["P2"], q["P1"]),
        (focal - focal * ratio, 0.0),
    )


def _pose(photo: Element, orientation: FloatArray) -> Pose | None:
    """Return the pose of a photograph, None without a rotation or a centre."""
    rotation, centre = photo.first("Pose", "Rotation"), photo.first("Pose", "Center")
    if rotation is None or centre is None:
        return None
    if rotation.first("M_00") is not None:
        M = np.array([[_number(rotation, f"M_{i}{j}") for j in range(3)] for i in range(3)])
    elif rotation.first("Omega") is not None:
        angles = [_number(rotation, name) for name in ("Omega", "Phi", "Kappa")]
        M = (rotation_from_omega_phi_kappa(angles) @ np.diag([1.0, -1.0, -1.0])).T
    else:
        raise ExchangeError(
            f"{rotation.place}: has neither a matrix nor omega, phi and kappa: export the block with them"
        )
    return pose_of(rotation.place, (orientation @ M).T, _vector(centre))


def _measured(photo: Element, system: str | None) -> tuple[FloatArray | None, bool]:
    """Return the position that was given (3,), and whether it is in another system."""
    metadata = photo.first("Pose", "Metadata")
    if metadata is None or metadata.first("Center") is None:
        return None, False
    if _system_id(metadata) != system:
        return None, True
    return _vector(metadata, "Center"), False


def _ground_points(
    block: Element, system: str | None, index: dict[int, int], left_out: list[str]
) -> ControlPoints | None:
    names: list[str] = []
    roles: list[Role] = []
    positions, sigmas, marks = [], [], []
    elsewhere = unknown = 0
    for point in block.all("ControlPoints", "ControlPoint"):
        name = _text(point, "Name")
        if not name or not name.isprintable() or name in names:
            raise ExchangeError(
                f"{point.place}: {printable(shortened(name))!r} is no name of its own: rename the point"
            )
        is_here = _system_id(point) == system
        elsewhere += not is_here
        position = _vector(point, "Position")
        plan, height = (_number_or(point, tag, np.nan) for tag in ("HorizontalAccuracy", "VerticalAccuracy"))
        for measurement in point.all("Measurement"):
            photograph = index.get(_id(measurement, "PhotoId"))
            if photograph is None:
                unknown += 1
                continue
            u, v = (_number(measurement, axis) for axis in "xy")
            marks.append((photograph, len(names), u, v, _UNKNOWN_SIGMA_PX))
        names.append(name)
        roles.append("check" if not is_here or _text_or(point, "CheckPoint", "false") == "true" else "control")
        positions.append(position if is_here else np.full(3, np.nan))
        sigmas.append((plan, plan, height))
    left_out += sentences(
        (elsewhere, f"The positions of {things(elsewhere, 'ground point')} in another CRS."),
        (unknown, f"{things(unknown, 'mark')} in photographs that are not read."),
    )
    return ground_points_of(names, roles, positions, sigmas, marks) if names else None


def _tie_points(path: Path, section: bytes, index: dict[int, int], left_out: list[str]) -> TiePoints:
    """Return the tie points of their section of the file, which is read as text: a few patterns, millions of times."""
    if not section.strip():
        return no_tie_points()
    if b"<!" in section or b"&" in section or b"<?" in section:
        raise ExchangeError(f"{path}: has comments or entities among its tie points: {_REMEDY}")
    head, *points = section.split(b"<TiePoint>")
    if head.strip() or any(not point.rstrip().endswith(b"</TiePoint>") for point in points):
        raise ExchangeError(f"{path}: something else stands among its tie points: {_REMEDY}")
    parts = list(_parts(path, points))
    position, colour, count, measurement = (np.concatenate([part[k] for part in parts]) for k in range(4))
    if not np.all((colour >= 0) & (colour <= 1)):
        raise ExchangeError(f"{path}: tie points have colours that are not from 0 to 1: {_REMEDY}")
    check_finite(str(path), "measurement of a tie point", measurement)
    ids = np.array(list(index), dtype=np.int64)  # in the order of the photographs
    photograph = index_in(np.argsort(ids), ids, measurement[:, 0].astype(np.int64))
    known = photograph >= 0
    unknown = int((~known).sum())
    left_out += sentences((unknown, f"{things(unknown, 'measurement')} in photographs that are not there."))
    point = np.repeat(np.arange(len(points)), count)
    rgb = np.round(255 * colour).astype(np.uint8)
    return tie_points_of(str(path), photograph[known], point[known], measurement[known, 1:], position, colour=rgb)


def _parts(path: Path, points: list[bytes]) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Give positions (P, 3), colours (P, 3), numbers of measurements (P,), and measurements (N, 3) of some points."""
    for start in range(0, len(points), _POINTS_AT_ONCE):
        some = points[start : start + _POINTS_AT_ONCE]
        text = b"".join(some)
        count = np.array([point.count(b"<Measurement>") for point in some])
        coloured = np.array([point.count(b"<Color>") for point in some])
        placed = np.array([point.count(b"<Position>") for point in some])
        try:
            measurement = _values(_MEASUREMENT, text)
            position, colour = _values(_POSITION, text), np.zeros((len(some), 3))
            known = _values(_COLOUR, text)
        except ValueError as error:
            raise ExchangeError(f"{path}: a tie point has a value that is no number: {_REMEDY}") from error
        if (
            np.any(placed != 1)
            or np.any(coloured > 1)
            or (len(position), len(measurement), len(known)) != (len(some), count.sum(), coloured.sum())
        ):
            raise ExchangeError(f"{path}: a tie point has not one position and measurements of three values: {_REMEDY}")
        colour[coloured == 1] = known
        yield position, colour, count, measurement


def _values(pattern: re.Pattern[bytes], text: bytes) -> FloatArray:
    return np.array(pattern.findall(text), dtype="S40").reshape(-1, 3).astype(np.float64)
