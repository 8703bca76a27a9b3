"""Pix4D's Open Photogrammetry Format 1.0: a project.opf, and the files that it names.

Poses are angles, R = Rx(ω) Ry(φ) Rz(κ) from an image frame with x right, y up, z backward, and positions in the
processing CRS: the base CRS of the scene reference frame, x to the right of y, moved by a shift. Principal points and
pixels of tracks have the centre of the top-left pixel at (0.5, 0.5), marks have it at (0, 0). The perspective model has
photogram's formulas, R1 R2 R3 for k1 k2 k3 and T1 T2 for p1 p2 (opf-spec, Calibrated cameras; pyopf, opf2colmap).
"""

import json
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote, unquote

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, omega_phi_kappa_deg, rotation_from_omega_phi_kappa
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import (
    HALF_PIXEL,
    camera_of,
    check_names,
    ground_points_of,
    no_tie_points,
    pose_of,
    sentences,
)
from photogram.exchange.formats.json_nodes import Node, read_json
from photogram.exchange.formats.pix4d.opf_tracks import MOST_JSON_BYTES, read_tracks, write_tracks
from photogram.exchange.formats.writing import check_writable
from photogram.files.atomic import make_folder, write_whole
from photogram.files.solutions.parsing import file_of, part_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution, Frame
from photogram.geodesy.crs import crs_of_wkt
from photogram.measures.mark_covariances import is_isotropic
from photogram.survey import ControlPoints, Role
from photogram.wording import printable, shortened, things

PROJECT = "project.opf"
_VERSION = "1.0"
_TRACKS = "model/gltf+json"
_BUFFER = "application/gltf-buffer+bin"
_LOCAL = (
    'ENGCRS["Local",EDATUM["Local"],CS[Cartesian,3],AXIS["easting (X)",east,ORDER[1]],'
    'AXIS["northing (Y)",north,ORDER[2]],AXIS["up (Z)",up,ORDER[3]],LENGTHUNIT["metre",1.0]]'
)
_BANDS = [{"name": "Red", "weight": 0.2126}, {"name": "Green", "weight": 0.7152}, {"name": "Blue", "weight": 0.0722}]
_UNKNOWN_TIME = "1970-01-01T00:00:00"
_NAMESPACE = uuid.UUID("6f1b1a52-6a53-5a0e-9d0c-6a2f1f0f7c11")


def _format(name: str) -> str:
    return f"application/opf-{name}+json"


# ---- reading -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Scene:
    """The frame of the processing CRS."""

    frame: Frame
    crs: str | None
    shift: FloatArray
    left_out: tuple[str, ...]


def read_opf(path: Path) -> ForeignSolution:
    """Return the solution of a project, given its project.opf or the folder that holds it.

    Measured positions and ground points are those that the project has in the processing CRS. Raises ExchangeError
    where a file is missing, damaged or leads out of the folder, a camera is no perspective one, or the project has no
    calibration.
    """
    file = path / PROJECT if path.is_dir() else path
    root = read_json(file, MOST_JSON_BYTES)
    if root.get("format").text() != _format("project"):
        raise ExchangeError(f"{file}: is no OPF project: give its project.opf")
    resources = dict(_resources(file, root))
    for name in ("camera-list", "input-cameras", "calibrated-cameras"):
        if _format(name) not in resources:
            raise ExchangeError(f"{file}: names no {_format(name)}: export a project that is calibrated")
    files = {
        kind.removeprefix("application/opf-").removesuffix("+json"): read_json(where[0], MOST_JSON_BYTES)
        for kind, where in resources.items()
        if kind.endswith("+json") and kind.startswith("application/opf-")
    }
    scene = _scene(files.get("scene-reference-frame"))
    cameras, photographs, number = _photographs(files, scene)
    check_names(str(file), (photograph.file for photograph in photographs))
    tracks = [read_tracks(where, number) for where in resources.get(_TRACKS, [])[:1]]
    tie_points, of_tracks = tracks[0] if tracks else (no_tie_points(), ())
    tie_points = replace(tie_points, position_world_m=tie_points.position_world_m - scene.shift)
    ground, of_ground = _ground_points(files, scene, number)
    generator = root.find("generator")
    program = "OPF" if generator is None else f"{generator.get('name').text()} {generator.get('version').text()}"
    return ForeignSolution(
        program=printable(shortened(program)),
        cameras=cameras,
        photographs=photographs,
        tie_points=tie_points,
        ground_points=ground,
        frame=scene.frame,
        crs=scene.crs,
        left_out=(*scene.left_out, *of_tracks, *of_ground, *_left_out(files)),
    )


def _resources(file: Path, root: Node) -> Iterator[tuple[str, list[Path]]]:
    """Give the files of each format; those of items but the sparse ones, such as dense clouds, are not among them."""
    files: dict[str, list[Path]] = {}
    for item in root.get("items").items():
        if item.get("type").text() == "point_cloud":
            continue
        for resource in item.get("resources").items():
            format_, uri = resource.get("format").text(), resource.get("uri")
            if format_.startswith("application/opf-") or format_ == _TRACKS:
                files.setdefault(format_, []).append(part_of(uri.place, file.parent, unquote(uri.text())))
    yield from files.items()


def _scene(root: Node | None) -> _Scene:
    if root is None:
        return _Scene("local", None, np.zeros(3), ())
    change, definition = root.get("base_to_canonical"), root.get("crs")
    scale = change.get("scale").numbers(3)
    if np.any(scale != 1.0):
        raise ExchangeError(
            f"{change.place}: scales the axes of the CRS by {scale.tolist()}: project in a CRS with one unit of 1 m"
        )
    crs = crs_of_wkt(definition.get("definition").text())
    left_out = ["The constant height of the geoid."] if definition.find("geoid_height") is not None else []
    if change.get("swap_xy").flag():
        left_out.append(
            "The order of the axes of the CRS, northing first, which is left-handed: coordinates have easting first."
        )
    return _Scene("local" if crs is None else "map", crs, change.get("shift").numbers(3), tuple(left_out))


def _internals(node: Node, name: str, size: FloatArray) -> Camera:
    kind = node.get("type").text()
    if kind != "perspective":
        raise ExchangeError(
            f"{node.place}: has the camera model {printable(shortened(kind))} of Pix4D, which photogram has not: only "
            "perspective cameras are read"
        )
    cx, cy = node.get("principal_point_px").numbers(2) - HALF_PIXEL
    return camera_of(
        node.place,
        name,
        (float(size[0]), float(size[1])),
        node.get("focal_length_px").number(),
        (float(cx), float(cy)),
        tuple(node.get("radial_distortion").numbers(3).tolist()),
        tuple(node.get("tangential_distortion").numbers(2).tolist()),
    )


def _photographs(
    files: Mapping[str, Node], scene: _Scene
) -> tuple[tuple[Camera, ...], tuple[ForeignPhotograph, ...], dict[int, int]]:
    """Return cameras, photographs, and their numbers by those of OPF's cameras."""
    inputs, calibrated = files["input-cameras"], files["calibrated-cameras"]
    estimated = {s.get("id").whole(): s.get("internals") for s in calibrated.get("sensors").items()}
    cameras: list[Camera] = []
    sensor_of: dict[int, int] = {}
    for sensor in inputs.get("sensors").items():
        key = sensor.get("id").whole()
        sensor_of[key] = len(cameras)
        internals = estimated.get(key, sensor.get("internals"))
        cameras.append(_internals(internals, sensor.get("name").text(), sensor.get("image_size_px").numbers(2)))
    uris = {c.get("id").whole(): c.get("uri") for c in files["camera-list"].get("cameras").items()}
    oriented = {c.get("id").whole(): c for c in calibrated.get("cameras").items()}
    projected = files.get("projected-input-cameras")
    captures = () if projected is None else projected.get("captures").items()
    places = {capture.get("id").whole(): capture.find("geolocation") for capture in captures}
    photographs: list[ForeignPhotograph] = []
    number: dict[int, int] = {}
    for capture in inputs.get("captures").items():
        measured = places.get(capture.get("id").whole())
        reference = capture.get("reference_camera_id").whole()
        for camera in capture.get("cameras").items():
            key = camera.get("id").whole()
            sensor_key = oriented.get(key, camera).get("sensor_id").whole()
            if key not in uris or sensor_key not in sensor_of or key in number:
                raise ExchangeError(f"{camera.place}: camera {key} or its sensor is not there, or comes twice")
            place = None if measured is None or key != reference else measured
            number[key] = len(photographs)
            photographs.append(_photograph(uris[key], sensor_of[sensor_key], oriented.get(key), place, scene.shift))
    return tuple(cameras), tuple(photographs), number


def _photograph(
    uri: Node, camera: int, oriented: Node | None, measured: Node | None, shift: FloatArray
) -> ForeignPhotograph:
    file = file_of(uri.place, unquote(uri.text().split("#")[0]))
    pose = None
    if oriented is not None:
        rotation = rotation_from_omega_phi_kappa(oriented.get("orientation_deg").numbers(3))
        pose = pose_of(oriented.place, rotation, oriented.get("position").numbers(3) - shift)
    if measured is None:
        return ForeignPhotograph(file.name, camera, pose, file)
    position = measured.get("position").numbers(3) - shift
    return ForeignPhotograph(file.name, camera, pose, file, position, measured.get("sigmas").numbers(3))


def _ground_points(
    files: Mapping[str, Node], scene: _Scene, number: Mapping[int, int]
) -> tuple[ControlPoints | None, list[str]]:
    """Return ground points and manual tie points, these without a position, and sentences on what is left out."""
    root = files.get("input-control-points")
    if root is None:
        return None, []
    projected = files.get("projected-control-points")
    known = {} if projected is None else {g.get("id").text(): g for g in projected.get("projected_gcps").items()}
    names: list[str] = []
    roles: list[Role] = []
    positions, sigmas, marks = [], [], []
    unplaced = elsewhere = 0
    for kind in ("gcps", "mtps"):
        for point in root.get(kind).items():
            name, check = point.get("id").text(), point.get("is_checkpoint").flag()
            if name in names or not name.isprintable():
                raise ExchangeError(f"{point.place}: {printable(shortened(name))!r} is no name of its own: rename it")
            place = known.get(name) if kind == "gcps" else None
            unplaced += kind == "gcps" and place is None
            for mark in point.get("marks").items():
                photograph = number.get(mark.get("camera_id").whole())
                if photograph is None:
                    elsewhere += 1
                    continue
                pixel, accuracy = mark.get("position_px").numbers(2), mark.get("accuracy").number()
                marks.append((photograph, len(names), *pixel, accuracy))
            names.append(name)
            roles.append("check" if check or place is None else "control")
            positions.append(np.full(3, np.nan) if place is None else place.get("coordinates").numbers(3) - scene.shift)
            sigmas.append(np.full(3, np.nan) if place is None else place.get("sigmas").numbers(3))
    ground = ground_points_of(names, roles, positions, sigmas, marks)
    return ground, sentences(
        (unplaced, f"The positions of {things(unplaced, 'ground point')} in another CRS."),
        (elsewhere, f"{things(elsewhere, 'mark')} in photographs that are not read."),
    )


def _left_out(files: Mapping[str, Node]) -> Iterator[str]:
    """Give sentences about what the project holds and the form has no place for."""
    inputs, calibrated = files["input-cameras"], files["calibrated-cameras"]
    captures = list(inputs.get("captures").items())
    attitudes = sum(capture.find("orientation") is not None for capture in captures)
    rolling = sum(camera.find("rolling_shutter") is not None for camera in calibrated.get("cameras").items())
    if "projected-input-cameras" not in files and any(c.find("geolocation") for c in captures):
        yield "Measured positions in the CRS of the photographs."
    if attitudes:
        yield f"{things(attitudes, 'measured attitude')}."
    if rolling:
        yield f"The rolling shutter of {things(rolling, 'photograph')}."
    words = {
        "gps-bias": "The bias of GNSS",
        "constraints": "Constraints",
        "calibrated-control-points": "Adjusted positions of ground points",
    }
    for name, what in words.items():
        if name in files:
            yield f"{what}."


# ---- writing -------------------------------------------------------------------------------------------------------


def write_opf(folder: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write a project into a folder, which is made: project.opf and the files that it names; returns sentences about
    what they cannot hold.

    Raises ExchangeError where the result would be wrong: a fisheye, k4 or affinity, geocentric coordinates. Raises
    WorkspaceError where a file cannot be written.
    """
    check_writable(folder, solution)
    for camera in solution.cameras:
        _check_camera(folder, camera)
    if solution.frame == "geocentric":
        raise ExchangeError(
            f"{folder}: OPF has no geocentric frame: transform the solution into a map or a local frame"
        )
    centres = [p.pose.position_world_m for p in solution.photographs if p.pose is not None]
    shift: FloatArray = np.zeros(3)
    if centres and solution.frame == "map":
        shift = np.asarray(-np.round(np.mean(centres, axis=0)), dtype=np.float64)
    left_out = list(_not_written(solution))
    make_folder(folder)
    writer = _Writer(folder)
    # cameras and captures of OPF are the photographs, counted from 1
    cameras = [{"id": uid, "uri": quote(str(p.file))} for uid, p in enumerate(solution.photographs, 1)]
    writer.put("camera-list", {"cameras": cameras})
    writer.put("input-cameras", _input_cameras(solution), "camera-list")
    definition = _LOCAL if solution.crs is None or solution.frame != "map" else solution.crs
    canonical = {"scale": [1.0, 1.0, 1.0], "shift": shift.tolist(), "swap_xy": False}
    writer.put("scene-reference-frame", {"crs": {"definition": definition}, "base_to_canonical": canonical})
    measured = _projected_cameras(solution, shift)
    if solution.frame != "topocentric":
        sources = "input-cameras", "scene-reference-frame"
        writer.put("projected-input-cameras", {"captures": measured, "sensors": []}, *sources)
    if solution.ground_points is not None:
        control, projected = _control_points(solution.ground_points, shift, definition)
        writer.put("input-control-points", control, "camera-list")
        writer.put("projected-control-points", projected, "input-control-points", "scene-reference-frame")
    calibrated = _calibrated_cameras(solution, shift)
    resources = [writer.file("calibrated-cameras", calibrated)]
    if len(solution.tie_points):
        make_folder(folder / "tracks")
        moved = replace(solution.tie_points, position_world_m=solution.tie_points.position_world_m + shift)
        names, more = write_tracks(folder / "tracks" / "tracks.gltf", moved, len(solution.photographs))
        left_out += more
        resources.append({"format": _TRACKS, "uri": "tracks/tracks.gltf"})
        resources += [{"format": _BUFFER, "uri": f"tracks/{name}"} for name in names]
    writer.item("calibration", resources, "input-cameras", "scene-reference-frame")
    writer.finish(solution.program)
    return tuple(left_out)


class _Writer:
    """Writes the files of a project, and the project itself at the end."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._items: list[dict[str, object]] = []

    def _write(self, name: str, value: Mapping[str, object]) -> None:
        write_whole(self._folder / name, json.dumps(value, indent=1, allow_nan=False) + "\n")

    def file(self, name: str, value: Mapping[str, object]) -> dict[str, str]:
        """Write a file of one of OPF's formats; returns it as a resource."""
        self._write(f"{name}.json", {"format": _format(name), "version": _VERSION, **value})
        return {"format": _format(name), "uri": f"{name}.json"}

    def put(self, name: str, value: Mapping[str, object], *sources: str) -> None:
        """Write a file that is an item of its own."""
        self.item(name, [self.file(name, value)], *sources)

    def item(self, name: str, resources: list[dict[str, str]], *sources: str) -> None:
        """Note an item of these resources and sources."""
        item = _reference(name)
        self._items.append({**item, "resources": resources, "sources": [_reference(source) for source in sources]})

    def finish(self, program: str) -> None:
        """Write the project."""
        value = {
            "format": _format("project"),
            "version": _VERSION,
            "id": _id("project"),
            "name": self._folder.resolve().name,
            "description": f"Solution of {program}, written by photogram",
            "generator": {"name": "photogram", "version": _VERSION},
            "items": self._items,
        }
        self._write(PROJECT, value)


def _reference(name: str) -> dict[str, str]:
    """Return an item of a project by its id and type, as others name it among their sources."""
    return {"id": _id(name), "type": name.replace("-", "_")}


def _id(name: str) -> str:
    return str(uuid.uuid5(_NAMESPACE, name))


def _check_camera(folder: Path, camera: Camera) -> None:
    terms = {"k4": camera.radial[3], "b1": camera.affinity[0], "b2": camera.affinity[1]}
    more = [name for name, value in terms.items() if value != 0]
    if camera.model != "brown" or more:
        what = "a fisheye" if camera.model != "brown" else f"with {' and '.join(more)}"
        raise ExchangeError(f"{folder}: camera {camera.name} is {what}, which OPF's perspective model has not")


def _internals_of(camera: Camera) -> dict[str, object]:
    return {
        "type": "perspective",
        "principal_point_px": (camera.principal_point_px + HALF_PIXEL).tolist(),
        "focal_length_px": float(camera.focal_px),
        "radial_distortion": camera.radial[:3].tolist(),
        "tangential_distortion": camera.tangential.tolist(),
    }


def _input_cameras(solution: ForeignSolution) -> dict[str, object]:
    sensors = [
        {
            "id": i + 1,
            "name": camera.name,
            "bands": _BANDS,
            "image_size_px": [camera.width_px, camera.height_px],
            "pixel_size_um": 1.0,
            "internals": _internals_of(camera),
            "shutter_type": "global",
        }
        for i, camera in enumerate(solution.cameras)
    ]
    captures = [
        {
            "id": uid,
            "reference_camera_id": uid,
            "rig_model_source": "not_applicable",
            "cameras": [
                {
                    "id": uid,
                    "sensor_id": photograph.camera + 1,
                    "model_source": "generic",
                    "pixel_type": "uint8",
                    "pixel_range": {"min": 0, "max": 255},
                }
            ],
            "time": _UNKNOWN_TIME,
        }
        for uid, photograph in enumerate(solution.photographs, 1)
    ]
    return {"sensors": sensors, "captures": captures}


def _projected_cameras(solution: ForeignSolution, shift: FloatArray) -> list[dict[str, object]]:
    return [
        {
            "id": uid,
            "geolocation": {
                "position": (photograph.measured + shift).tolist(),
                "sigmas": photograph.measured_sigma_m.tolist(),
            },
        }
        for uid, photograph in enumerate(solution.photographs, 1)
        if photograph.measured is not None
        and photograph.measured_sigma_m is not None
        and np.isfinite([photograph.measured, photograph.measured_sigma_m]).all()
    ]


def _calibrated_cameras(solution: ForeignSolution, shift: FloatArray) -> dict[str, object]:
    sensors = [{"id": i + 1, "internals": _internals_of(camera)} for i, camera in enumerate(solution.cameras)]
    cameras = [
        {
            "id": uid,
            "sensor_id": photograph.camera + 1,
            "orientation_deg": omega_phi_kappa_deg(photograph.pose.rotation_world_from_camera).tolist(),
            "position": (photograph.pose.position_world_m + shift).tolist(),
        }
        for uid, photograph in enumerate(solution.photographs, 1)
        if photograph.pose is not None
    ]
    return {"sensors": sensors, "cameras": cameras}


def _control_points(
    ground: ControlPoints, shift: FloatArray, definition: str
) -> tuple[dict[str, object], dict[str, object]]:
    """Return the ground points as they were given, and in the processing CRS; those without a position as manual tie
    points."""
    gcps, mtps, projected = [], [], []
    for g, name in enumerate(ground.name):
        marks = [
            {
                "camera_id": int(ground.mark_photograph[m]) + 1,
                "position_px": ground.mark_pixel[m].tolist(),
                "accuracy": float(ground.mark_sigma_px[m]),
            }
            for m in np.flatnonzero((ground.mark_point == g) & _usable_marks(ground))
        ]
        point = {"id": name, "is_checkpoint": ground.role[g] == "check", "marks": marks}
        position, sigma = ground.position_world_m[g], ground.sigma_m[g]
        if not np.isfinite([position, sigma]).all():
            mtps.append(point)
            continue
        place = {"crs": {"definition": definition}, "coordinates": position.tolist(), "sigmas": sigma.tolist()}
        gcps.append({**point, "geolocation": place})
        projected.append({"id": name, "coordinates": (position + shift).tolist(), "sigmas": sigma.tolist()})
    return {"gcps": gcps, "mtps": mtps}, {"projected_gcps": projected}


def _usable_marks(ground: ControlPoints) -> BoolArray:
    return np.asarray(np.isfinite(ground.mark_pixel).all(axis=1) & np.isfinite(ground.mark_sigma_px))


def _not_written(solution: ForeignSolution) -> Iterator[str]:
    yield (
        "Times of exposure, sizes of pixels and bands: 1970-01-01, 1 µm and those of an RGB picture stand in their "
        "place."
    )
    if solution.frame == "topocentric":
        yield "The origin of the topocentric frame: the project is in a local frame."
        if any(photograph.measured is not None for photograph in solution.photographs):
            yield "Measured positions: they are in another frame than the poses."
    ground = solution.ground_points
    if ground is not None and not is_isotropic(ground.mark_covariance_px2).all():
        yield "Covariances of marks: each has the root mean square of its two standard deviations."
    rejected = 0 if ground is None else int((~_usable_marks(ground)).sum())
    if rejected:
        yield f"{things(rejected, 'mark')} with an infinite standard deviation, rejected ones."
    if len(solution.tie_points):
        yield "The double precision of tie points and their pixels, and their standard deviations."
