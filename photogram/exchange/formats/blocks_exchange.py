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
from photogram.exchange.formats.assembly import camera_of, check_names, index_in, no_tie_points, pose_of, tie_points_of
from photogram.files.solutions.parsing import bytes_of, check_finite, file_of, number_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution, Frame
from photogram.files.xml_elements import Element, elements_of
from photogram.geodesy.crs import crs_of_wkt, metric_only
from photogram.measures.mark_covariances import isotropic_px2
from photogram.survey import ControlPoints, Role, TiePoints
from photogram.wording import printable, shortened, things

_REMEDY = "export the block again"
_MOST_BYTES = 2_000_000_000  # 20 million observations
_START, _END = b"<TiePoints>", b"</TiePoints>"
_NUMBER = rb"\s*([^<\s]{1,40})\s*"
_MEASUREMENT = re.compile(
    rb"<Measurement>\s*<PhotoId>\s*(\d{1,15})\s*</PhotoId>\s*<x>" + _NUMBER + rb"</x>\s*<y>" + _NUMBER
    + rb"</y>\s*</Measurement>"
)  # fmt: skip
_POSITION = re.compile(
    rb"<Position>\s*<x>" + _NUMBER + rb"</x>\s*<y>" + _NUMBER + rb"</y>\s*<z>" + _NUMBER + rb"</z>\s*</Position>"
)
_COLOUR = re.compile(
    rb"<Color>\s*<Red>" + _NUMBER + rb"</Red>\s*<Green>" + _NUMBER + rb"</Green>\s*<Blue>" + _NUMBER
    + rb"</Blue>\s*</Color>"
)  # fmt: skip
_POINTS_AT_ONCE = 20_000
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
        raise ExchangeError(f"{path}:1: holds {things(len(blocks), 'block')}: export one block at a time")
    block = blocks[0]
    definitions = {
        _text(path, srs, "Id"): _text(path, srs, "Definition")
        for srs in root.all("BlocksExchange", "SpatialReferenceSystems", "SRS")
    }
    number = block.first("SRSId")
    system_id = None if number is None else number.text
    if system_id is not None and system_id not in definitions:
        raise ExchangeError(f"{path}:{block.line}: the block's SRSId {printable(shortened(system_id))} is not there")
    system = _System("local", None, None) if system_id is None else _system(path, block, definitions[system_id])
    left_out: list[str] = []
    cameras, photographs, index = _photographs(path, block, system_id, left_out)
    check_names(str(path), (photograph.file for photograph in photographs))
    ground = _ground_points(path, block, system_id, index, left_out)
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


def _text(path: Path, element: Element, *tags: str) -> str:
    found = element.first(*tags)
    if found is None:
        raise ExchangeError(f"{path}:{element.line}: has no {' / '.join(tags)}: {_REMEDY}")
    return found.text


def _number(path: Path, element: Element, *tags: str) -> float:
    found = element.first(*tags)
    place = f"{path}:{element.line if found is None else found.line}"
    return number_of(place, " / ".join(tags), "" if found is None else found.text)


def _system(path: Path, block: Element, definition: str) -> _System:
    place = f"{path}:{block.line}"
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
    path: Path, block: Element, system: str | None, left_out: list[str]
) -> tuple[tuple[Camera, ...], tuple[ForeignPhotograph, ...], dict[int, int]]:
    """Return cameras, photographs, and their numbers by their Id."""
    cameras: list[Camera] = []
    photographs: list[ForeignPhotograph] = []
    index: dict[int, int] = {}
    elsewhere = 0
    for group in block.all("Photogroups", "Photogroup"):
        cameras.append(_camera(path, group))
        name = group.first("CameraOrientation")
        orientation = _ORIENTATIONS.get("XRightYDown" if name is None else name.text)
        if orientation is None:
            raise ExchangeError(f"{path}:{group.line}: has an unknown CameraOrientation: {_REMEDY}")
        for photo in group.all("Photo"):
            key = _id(path, photo, "Id")
            if key in index:
                raise ExchangeError(f"{path}:{photo.line}: the photograph {key} comes twice: {_REMEDY}")
            index[key] = len(photographs)
            file = file_of(f"{path}:{photo.line}", _text(path, photo, "ImagePath"))
            pose = _pose(path, photo, np.array(orientation, dtype=np.float64))
            measured, other = _measured(path, photo, system)
            elsewhere += other
            photographs.append(ForeignPhotograph(file.name, len(cameras) - 1, pose, file, measured))
    if elsewhere:
        left_out.append(f"{things(elsewhere, 'measured position')} in another CRS.")
    return tuple(cameras), tuple(photographs), index


def _id(path: Path, element: Element, tag: str) -> int:
    text = _text(path, element, tag)
    if not re.fullmatch(r"\d{1,15}", text, re.ASCII):
        raise ExchangeError(f"{path}:{element.line}: {tag} {printable(shortened(text))!r} is no number: {_REMEDY}")
    return int(text)


def _camera(path: Path, group: Element) -> Camera:
    place = f"{path}:{group.line}"
    kind = group.first("CameraModelType")
    if kind is not None and kind.text != "Perspective":
        raise ExchangeError(
            f"{place}: has the camera model {printable(shortened(kind.text))}, which photogram has not: only "
            "perspective cameras are read"
        )
    width, height = (_number(path, group, "ImageDimensions", side) for side in ("Width", "Height"))
    if group.first("FocalLengthPixels") is not None:
        focal = _number(path, group, "FocalLengthPixels")
    else:
        sensor = _number(path, group, "SensorSize")
        if not sensor > 0:
            raise ExchangeError(f"{place}: the size of the sensor is {sensor:g}: it must be positive")
        focal = _number(path, group, "FocalLength") / sensor * max(width, height)
    ratio = _number(path, group, "AspectRatio") if group.first("AspectRatio") is not None else 1.0
    if group.first("Skew") is not None and _number(path, group, "Skew") != 0:
        raise ExchangeError(f"{place}: has a skew, whose unit the format leaves open: adjust the block without it")
    centre = (width - 1) / 2, (height - 1) / 2
    if group.first("PrincipalPoint") is not None:
        centre = _number(path, group, "PrincipalPoint", "x"), _number(path, group, "PrincipalPoint", "y")
    q = {"K1": 0.0, "K2": 0.0, "K3": 0.0, "P1": 0.0, "P2": 0.0}
    for child in (child for held in group.all("Distortion") for child in held.children):
        value = number_of(f"{path}:{child.line}", child.tag, child.text)
        if child.tag not in q and value != 0:
            raise ExchangeError(
                f"{path}:{child.line}: has the distortion {printable(child.tag)}, which photogram has not: {_REMEDY}"
            )
        q[child.tag] = value
    label = group.first("Name")
    return camera_of(
        place, "camera" if label is None else label.text, (width, height), focal * ratio, centre,
        (q["K1"], q["K2"], q["K3"]), (q["P2"], q["P1"]), (focal - focal * ratio, 0.0),
    )  # fmt: skip


def _pose(path: Path, photo: Element, orientation: FloatArray) -> Pose | None:
    """Return the pose of a photograph, None without a rotation or a centre."""
    rotation, centre = photo.first("Pose", "Rotation"), photo.first("Pose", "Center")
    if rotation is None or centre is None:
        return None
    place = f"{path}:{rotation.line}"
    if rotation.first("M_00") is not None:
        M = np.array([[_number(path, rotation, f"M_{i}{j}") for j in range(3)] for i in range(3)])
    elif rotation.first("Omega") is not None:
        angles = [_number(path, rotation, name) for name in ("Omega", "Phi", "Kappa")]
        M = (rotation_from_omega_phi_kappa(angles) @ np.diag([1.0, -1.0, -1.0])).T
    else:
        raise ExchangeError(f"{place}: has neither a matrix nor omega, phi and kappa: export the block with them")
    position = np.array([_number(path, centre, axis) for axis in "xyz"])
    return pose_of(place, (orientation @ M).T, position)


def _measured(path: Path, photo: Element, system: str | None) -> tuple[FloatArray | None, bool]:
    """Return the position that was given (3,), and whether it is in another system."""
    metadata = photo.first("Pose", "Metadata")
    if metadata is None or metadata.first("Center") is None:
        return None, False
    number = metadata.first("SRSId")
    if (None if number is None else number.text) != system:
        return None, True
    return np.array([_number(path, metadata, "Center", axis) for axis in "xyz"]), False


def _ground_points(
    path: Path, block: Element, system: str | None, index: dict[int, int], left_out: list[str]
) -> ControlPoints | None:
    names: list[str] = []
    roles: list[Role] = []
    positions, sigmas, marks = [], [], []
    elsewhere = unknown = 0
    for point in block.all("ControlPoints", "ControlPoint"):
        name = _text(path, point, "Name")
        if not name or not name.isprintable() or name in names:
            raise ExchangeError(
                f"{path}:{point.line}: {printable(shortened(name))!r} is no name of its own: rename the point"
            )
        number, check = point.first("SRSId"), point.first("CheckPoint")
        same = (None if number is None else number.text) == system
        elsewhere += not same
        place = np.array([_number(path, point, "Position", axis) for axis in "xyz"])
        accuracy = [_number(path, point, tag) if point.first(tag) is not None else np.nan
                    for tag in ("HorizontalAccuracy", "HorizontalAccuracy", "VerticalAccuracy")]  # fmt: skip
        for measurement in point.all("Measurement"):
            photograph = index.get(_id(path, measurement, "PhotoId"))
            if photograph is None:
                unknown += 1
                continue
            u, v = (_number(path, measurement, axis) for axis in "xy")
            marks.append((photograph, len(names), u, v))
        names.append(name)
        roles.append("check" if not same or (check is not None and check.text == "true") else "control")
        positions.append(place if same else np.full(3, np.nan))
        sigmas.append(accuracy)
    if elsewhere:
        left_out.append(f"The positions of {things(elsewhere, 'ground point')} in another CRS.")
    if unknown:
        left_out.append(f"{things(unknown, 'mark')} in photographs that are not read.")
    if not names:
        return None
    M = np.array(marks, dtype=np.float64).reshape(-1, 4)
    return ControlPoints(
        tuple(names), tuple(roles), np.array(positions), np.array(sigmas), M[:, 0].astype(np.int64),
        M[:, 1].astype(np.int64), M[:, 2:], isotropic_px2(np.ones(len(M))),
    )  # fmt: skip


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
    found = photograph >= 0
    if not found.all():
        left_out.append(f"{things(int((~found).sum()), 'measurement')} in photographs that are not there.")
    point = np.repeat(np.arange(len(points)), count)
    rgb = np.round(255 * colour).astype(np.uint8)
    return tie_points_of(str(path), photograph[found], point[found], measurement[found, 1:], position, colour=rgb)


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
