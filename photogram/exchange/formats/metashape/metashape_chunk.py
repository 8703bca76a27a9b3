"""A chunk of Agisoft Metashape and PhotoScan as XML: sensors, cameras, markers, and where they are.

Metashape's pixels have the centre of the top-left one at (0.5, 0.5), its cameras look along +z with x to the right and
y down, and its formulas are photogram's with p1 and p2 exchanged (Agisoft Metashape User Manual, Professional Edition,
appendix Camera models). ``f`` comes with cx and cy from the middle of the photograph; ``fx`` and ``fy`` of PhotoScan up
to 1.2 come with cx and cy from its corner and, for b2, a skew. The transform of a chunk leads to geocentric coordinates
where the chunk has a CRS, else to the local ones of its markers.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, Pose, Similarity
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import HALF_PIXEL, camera_of, check_names, ground_points_of, pose_of, sentences
from photogram.files.solutions.parsing import file_of, number_of, numbers_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution, Frame, StatedAdjustment
from photogram.files.xml_elements import Element
from photogram.geodesy.crs import crs_of_wkt
from photogram.projection import PARAMETERS, Model
from photogram.survey import ControlPoints, Role, TiePoints
from photogram.wording import printable, shortened, things

MOST_XML_BYTES = 200_000_000
MODELS: dict[str, Model] = {"frame": "brown", "fisheye": "fisheye"}
_TERMS = ("f", "fx", "fy", "cx", "cy", "b1", "b2", "skew", "k1", "k2", "k3", "k4", "p1", "p2")
_FOREIGN_TERMS = ("p3", "p4", "k5", "k6")
_TRUE = ("true", "1")
_UNKNOWN_SIGMA_PX = 1.0
_REMEDY = "export the cameras from Metashape again"


@dataclass(frozen=True)
class Chunk:
    """What the XML of a chunk says: everything but tie points."""

    cameras: tuple[Camera, ...]
    fixed: BoolArray
    """Parameters of interior orientation (cameras, 12) that were fixed: all of a sensor with a fixed calibration."""
    photographs: tuple[ForeignPhotograph, ...]
    photograph_of: dict[str, int]
    """Number of the photograph by Metashape's number of the camera."""
    world: Similarity
    """From the chunk's own coordinates to those of the solution."""
    frame: Frame
    crs: str | None
    ground_points: ControlPoints
    tie_sigma_px: float | None
    left_out: tuple[str, ...]

    def solution(self, program: str, tie_points: TiePoints, left_out: tuple[str, ...] = ()) -> ForeignSolution:
        """Return the solution of a program, with what else is ``left_out`` of its files."""
        return ForeignSolution(
            program=program,
            cameras=self.cameras,
            photographs=self.photographs,
            tie_points=tie_points,
            ground_points=self.ground_points if len(self.ground_points) else None,
            frame=self.frame,
            crs=self.crs,
            stated_tie_sigma_px=self.tie_sigma_px,
            left_out=(*self.left_out, *left_out),
            stated=StatedAdjustment(held=self.fixed),
        )


def read_chunk(chunk: Element, frame: Element | None) -> Chunk:
    """Return what the element ``chunk`` says, and of marks and files its element ``frame``.

    Raises ExchangeError with the line of what is wrong.
    """
    sensors, cameras, fixed = _sensors(chunk)
    wkt = next((element.text for element in chunk.all("reference")), "")
    crs, world = crs_of_wkt(wkt), _transform(chunk)
    geocentric = crs is not None and world is not None
    covariances = len(list(chunk.all("sensors", "sensor", "covariance")))
    left_out = sentences(
        (covariances, f"{things(covariances, 'covariance of a calibration', 'covariances of calibrations')}."),
        (
            geocentric and "1984" not in wkt and "WGS" not in wkt,
            f"The datum of the geocentric coordinates, that of {crs}: they are taken for WGS 84's.",
        ),
    )
    settings = {p.attributes.get("name", ""): p for p in chunk.all("settings", "property")}
    to_world = world or Similarity(1.0, np.eye(3), np.zeros(3))
    photographs, number = _photographs(chunk, frame, sensors, to_world, settings, left_out)
    left_out += _other_elements(chunk)
    return Chunk(
        cameras=cameras,
        fixed=np.repeat(np.array(fixed, dtype=bool)[:, None], PARAMETERS, axis=1),
        photographs=photographs,
        photograph_of=number,
        world=to_world,
        frame="geocentric" if geocentric else "local",
        crs=crs,
        ground_points=_markers(chunk, frame, number, settings, left_out),
        tie_sigma_px=_setting(settings, "accuracy_tiepoints"),
        left_out=tuple(left_out),
    )


def _setting(settings: dict[str, Element], name: str) -> float | None:
    """Return a standard deviation of the chunk's settings, None where they have none above 0."""
    element = settings.get(name)
    text = "" if element is None else element.attributes.get("value", "")
    if element is None or not text:
        return None
    value = number_of(element.place, name, text.replace("/", " ").split()[0] if text.split() else "")
    return value if value > 0 else None


def _sensors(chunk: Element) -> tuple[dict[str, int], tuple[Camera, ...], list[bool]]:
    """Return the cameras, their index by Metashape's number, those without a calibration have none, and whether the
    calibration of each was fixed."""
    index: dict[str, int] = {}
    cameras: list[Camera] = []
    fixed: list[bool] = []
    for sensor in chunk.all("sensors", "sensor"):
        by_class = {c.attributes.get("class", ""): c for c in sensor.all("calibration")}
        calibration = by_class.get("adjusted") or next(iter(by_class.values()), None)
        if calibration is None:
            continue
        index[sensor.attributes.get("id", "")] = len(cameras)
        cameras.append(_camera(sensor, calibration))
        properties = {p.attributes.get("name", ""): p.attributes.get("value", "") for p in sensor.all("property")}
        fixed.append(properties.get("fixed", "").lower() in _TRUE)
    return index, tuple(cameras), fixed


def _camera(sensor: Element, calibration: Element) -> Camera:
    label = sensor.attributes.get("label", "") or "unknown"
    place = f"{calibration.place}: sensor {printable(shortened(label))}"
    kind = calibration.attributes.get("type") or sensor.attributes.get("type") or "frame"
    if kind not in MODELS:
        raise ExchangeError(
            f"{place}: has the camera model {printable(shortened(kind))}, which photogram has not: only frame and "
            "fisheye cameras are read"
        )
    resolution = calibration.first("resolution") or sensor.first("resolution")
    if resolution is None:
        raise ExchangeError(f"{place}: says no width and height of its photographs: {_REMEDY}")
    width, height = (number_of(place, side, resolution.attributes.get(side, "")) for side in ("width", "height"))
    q = {c.tag: number_of(place, c.tag, c.text) for c in calibration.children if c.tag in (*_TERMS, *_FOREIGN_TERMS)}
    further = [name for name in _FOREIGN_TERMS if q.get(name)]
    if further:
        raise ExchangeError(
            f"{place}: its calibration has {' and '.join(further)}, which photogram's models have not: optimise the "
            "cameras in Metashape without them"
        )
    if "f" in q:
        focal, b1, b2 = q["f"], q.get("b1", 0.0), q.get("b2", 0.0)
        centre = width / 2 + q.get("cx", 0.0), height / 2 + q.get("cy", 0.0)
    elif "fx" in q and "fy" in q:
        if q.get("p1") or q.get("p2"):
            raise ExchangeError(
                f"{place}: has fx and fy with p1 and p2, whose order the manuals of that version of PhotoScan leave "
                "open: open the project in Metashape and save it again"
            )
        focal, b1, b2 = q["fy"], q["fx"] - q["fy"], q.get("skew", 0.0)
        centre = q.get("cx", width / 2), q.get("cy", height / 2)
    else:
        raise ExchangeError(f"{place}: its calibration has no focal length f, or fx and fy: {_REMEDY}")
    return camera_of(
        calibration.place,
        label,
        (width, height),
        focal,
        (centre[0] - HALF_PIXEL, centre[1] - HALF_PIXEL),
        tuple(q.get(name, 0.0) for name in ("k1", "k2", "k3", "k4")),
        (q.get("p2", 0.0), q.get("p1", 0.0)),
        (b1, b2),
        MODELS[kind],
    )


def _transform(chunk: Element) -> Similarity | None:
    """Return the transform of a chunk, None where it has none: its coordinates are then of no unit."""
    element = chunk.first("transform")
    if element is None:
        return None
    place = f"{element.place}: the transform of the chunk"
    rotation, translation, scale = (element.first(tag) for tag in ("rotation", "translation", "scale"))
    if rotation is not None and translation is not None:
        R = numbers_of(place, "its rotation", rotation.text, 9).reshape(3, 3)
        s = 1.0 if scale is None else number_of(place, "its scale", scale.text)
        t = numbers_of(place, "its translation", translation.text, 3)
    elif element.text:
        M = numbers_of(place, "its matrix", element.text, 16).reshape(4, 4)
        with np.errstate(over="ignore", invalid="ignore"):
            s = float(np.cbrt(np.linalg.det(M[:3, :3])))
            R, t = M[:3, :3] / s if s else M[:3, :3], M[:3, 3]
    else:
        return None
    if not 0 < s < np.inf:
        raise ExchangeError(f"{place} has the scale {s:g}: it must be positive")
    pose = pose_of(place, R, t)
    return Similarity(s, pose.rotation_world_from_camera, pose.position_world_m)


def _photographs(
    chunk: Element,
    frame: Element | None,
    sensors: dict[str, int],
    world: Similarity,
    settings: dict[str, Element],
    left_out: list[str],
) -> tuple[tuple[ForeignPhotograph, ...], dict[str, int]]:
    files = {
        camera.attributes.get("camera_id", ""): photo.attributes.get("path", "")
        for camera in (frame.all("cameras", "camera") if frame else ())
        for photo in camera.all("photo")
    }
    sigma = _setting(settings, "accuracy_cameras")
    photographs: list[ForeignPhotograph] = []
    number: dict[str, int] = {}
    uncalibrated = secondary = disabled = angles = 0
    for element in (camera for cameras in chunk.all("cameras") for camera in cameras.below("camera")):
        place, key = element.place, element.attributes.get("id", "")
        file = file_of(place, files.get(key) or element.attributes.get("label", ""))
        sensor = sensors.get(element.attributes.get("sensor_id", ""))
        if sensor is None:
            if element.first("transform") is not None:
                raise ExchangeError(f"{place}: {file.name} is oriented, but its sensor has no calibration: {_REMEDY}")
            uncalibrated += 1
            continue
        secondary += "master_id" in element.attributes
        disabled += element.attributes.get("enabled", "true").lower() not in _TRUE
        matrix, reference = element.first("transform"), element.first("reference")
        measured, measured_sigma = None, None
        if reference is not None:
            measured = _position(reference)
            measured_sigma = _sigmas(reference, sigma) if measured is not None else None
            angles += "yaw" in reference.attributes
        pose = None if matrix is None else _pose(matrix.place, matrix.text, world)
        if key in number:
            raise ExchangeError(f"{place}: the camera number {printable(shortened(key))} comes twice: {_REMEDY}")
        number[key] = len(photographs)
        photographs.append(ForeignPhotograph(file.name, sensor, pose, file, measured, measured_sigma))
    check_names(str(chunk.file), (photograph.file for photograph in photographs))
    plural = "photographs of sensors without a calibration"
    left_out += sentences(
        (uncalibrated, f"{things(uncalibrated, 'photograph of a sensor without a calibration', plural)}."),
        (
            secondary,
            f"The orientation of {things(secondary, 'photograph')} of secondary sensors of a rig: it follows from that "
            "of the primary sensor, which is not applied.",
        ),
        (disabled, f"That Metashape has switched off {things(disabled, 'photograph')}: read like the others."),
        (angles, f"{things(angles, 'measured attitude')}."),
    )
    return tuple(photographs), number


def _pose(place: str, text: str, world: Similarity) -> Pose:
    M = numbers_of(place, "the transform of a camera", text, 16).reshape(4, 4)
    return world.pose(pose_of(place, M[:3, :3], M[:3, 3]))


def _position(reference: Element) -> FloatArray | None:
    """Return the coordinates of a reference (3,), None where it has not all of them."""
    texts = [reference.attributes.get(axis, "") for axis in "xyz"]
    if not all(texts):
        return None
    return np.array([number_of(reference.place, axis, text) for text, axis in zip(texts, "xyz", strict=True)])


def _sigmas(reference: Element, otherwise: float | None) -> FloatArray:
    """Return the accuracies (3,) of a reference: sx, sy and sz, or sxy and sz as before version 1.3, or sxyz."""
    sigmas, attributes = [], reference.attributes
    for column in ("sx", "sy", "sz"):
        text = attributes.get(column) or (attributes.get("sxy") if column != "sz" else None) or attributes.get("sxyz")
        value = number_of(reference.place, column, text) if text else otherwise
        if value is not None and value < 0:
            raise ExchangeError(f"{reference.place}: {column} is {value:g}: it must be positive")
        sigmas.append(np.nan if value is None else value)
    return np.array(sigmas)


def _markers(
    chunk: Element,
    frame: Element | None,
    photograph_of: dict[str, int],
    settings: dict[str, Element],
    left_out: list[str],
) -> ControlPoints:
    """Return the markers; those that are switched off are check points, as are those without coordinates."""
    names: list[str] = []
    index: dict[str, int] = {}
    roles: list[Role] = []
    positions, sigmas = [], []
    sigma_m = _setting(settings, "accuracy_markers")
    for marker in (marker for markers in chunk.all("markers") for marker in markers.below("marker")):
        label, place = marker.attributes.get("label", ""), marker.place
        if not label or not label.isprintable() or label in names:
            raise ExchangeError(
                f"{place}: marker {printable(shortened(label))!r} has no name of its own: rename it in Metashape"
            )
        reference = marker.first("reference")
        position = None if reference is None else _position(reference)
        index[marker.attributes.get("id", "")] = len(names)
        names.append(label)
        if reference is None or position is None:
            roles.append("check")
            positions.append(np.full(3, np.nan))
            sigmas.append(np.full(3, np.nan))
            continue
        roles.append("control" if reference.attributes.get("enabled", "true").lower() in _TRUE else "check")
        positions.append(position)
        sigmas.append(_sigmas(reference, sigma_m))
    sigma_px = _setting(settings, "accuracy_projections") or _UNKNOWN_SIGMA_PX
    marks = [(*mark, sigma_px) for mark in _marks(frame, photograph_of, index, left_out)]
    return ground_points_of(names, roles, positions, sigmas, marks)


def _marks(
    frame: Element | None, photograph_of: dict[str, int], index: dict[str, int], left_out: list[str]
) -> list[tuple[int, int, float, float]]:
    """Return photograph, point, u and v of the pinned projections: those that people placed."""
    marks = []
    unpinned = elsewhere = 0
    for marker in frame.all("markers", "marker") if frame else ():
        number = marker.attributes.get("marker_id", "")
        for location in marker.all("location"):
            place, camera = location.place, location.attributes.get("camera_id", "")
            if number not in index:
                raise ExchangeError(f"{place}: marker_id {printable(shortened(number))!r} is no marker: {_REMEDY}")
            if location.attributes.get("pinned", "").lower() not in _TRUE:
                unpinned += 1
            elif camera not in photograph_of:
                elsewhere += 1
            else:
                u, v = (number_of(place, axis, location.attributes.get(axis, "")) for axis in "xy")
                marks.append((photograph_of[camera], index[number], u - HALF_PIXEL, v - HALF_PIXEL))
    plural = "projections of markers that nobody pinned"
    left_out += sentences(
        (unpinned, f"{things(unpinned, 'projection of a marker that nobody pinned', plural)}."),
        (
            elsewhere,
            f"{things(elsewhere, 'mark in a photograph that is not read', 'marks in photographs that are not read')}.",
        ),
    )
    return marks


def _other_elements(chunk: Element) -> Iterator[str]:
    """Give sentences on what a chunk holds and the form has no place for."""
    read = {"sensors", "cameras", "markers", "frames", "reference", "transform", "settings", "meta"}
    words = {"scalebars": "scale bars", "region": "the region of interest", "camera_tracks": "camera tracks"}
    words |= {tag: tag for tag in ("components", "masks", "shapes", "images")}
    for child in chunk.children:
        if child.tag not in read and (child.children or child.text):
            name = words.get(child.tag, f"the element {printable(shortened(child.tag))}")
            yield f"{name[:1].upper()}{name[1:]}."
