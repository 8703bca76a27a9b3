"""Reconstructions of OpenSfM and OpenDroneMap: reconstruction.json, tracks.csv, reference_lla.json, gcp_list.txt.

OpenSfM's camera frame is photogram's; a shot holds the rotation vector and the translation camera from world, a camera
its focal length and principal point in normalised image coordinates, see ``tracks`` (OpenSfM documentation,
Geometric Models). Perspective, simple_radial, radial and brown are Brown's model, fisheye and fisheye_opencv the
equidistant one, all in photogram's direction. The world is east, north, up at ``reference_lla``, which OpenSfM sets to
zeros where no photograph has a position: then it is the frame of a free network.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import camera_of, check_names, pose_of, sentences, sizes_of, tie_points_of
from photogram.exchange.formats.json_nodes import Node, read_json
from photogram.exchange.formats.opensfm.ground_control import FILE as CONTROL
from photogram.exchange.formats.opensfm.ground_control import (
    in_crs_of_control,
    read_ground_control,
    write_ground_control,
)
from photogram.exchange.formats.opensfm.tracks import (
    Tracks,
    normalised_of_pixel,
    pixel_of_normalised,
    read_tracks,
    tracks_text,
)
from photogram.exchange.formats.writing import (
    check_writable,
    oriented_tie_points,
    unoriented_photographs,
    without_place,
)
from photogram.files.atomic import make_folder, write_whole
from photogram.files.solutions.parsing import file_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.geodesy.frames import geodetic_from_topocentric, topocentric_from_geodetic
from photogram.projection import Model
from photogram.survey import TiePoints
from photogram.wording import printable, shortened, things

GEODETIC = "EPSG:4979"
"""CRS of measured positions: longitude, latitude, ellipsoidal height."""

_KINDS: dict[str, Model] = {
    "perspective": "brown",
    "simple_radial": "brown",
    "radial": "brown",
    "brown": "brown",
    "fisheye": "fisheye",
    "fisheye_opencv": "fisheye",
}
_USUAL_ACCURACY_M = 15.0
"""What OpenSfM takes where nothing is known."""

_NO_ACCURACY_M = 1e5
"""OpenSfM gives positions that are none an accuracy of 999999."""


def read_opensfm(path: Path) -> ForeignSolution:
    """Return the reconstruction in a folder of OpenSfM, or of a reconstruction.json; the one with the most photographs.

    tracks.csv, reference_lla.json and gcp_list.txt are read where they lie beside it. Measured positions have the CRS
    of the ground points, without such EPSG:4979, longitude before latitude. Raises ExchangeError where a file is
    damaged, or a camera model is none of photogram's.
    """
    path = path / "reconstruction.json" if path.is_dir() else path
    parts = list(read_json(path).items())
    if not parts:
        raise ExchangeError(f"{path}: holds no reconstruction: run OpenSfM's reconstruct first")
    largest = max(parts, key=lambda part: len(part.get("shots").keys()))
    others = len(parts) - 1
    return _solution(path, largest, sentences((others, f"{things(others, 'smaller reconstruction')} of the file.")))


def _solution(path: Path, part: Node, left_out: list[str]) -> ForeignSolution:
    shots = part.get("shots")
    index = {key: i for i, key in enumerate(part.get("cameras").keys())}
    cameras = tuple(_camera(key, node) for key, node in part.get("cameras").entries())
    lla = _origin(path, part)
    origin = lla if lla != (0.0, 0.0, 0.0) else None
    photographs = tuple(_photograph(key, shot, index, origin) for key, shot in shots.entries())
    check_names(shots.place, (photograph.file for photograph in photographs))
    has_tracks = path.with_name("tracks.csv").exists()
    tie_points, others = _tie_points(path, photographs, cameras, shots.keys(), part.get("points", {}))
    unseen = int(np.count_nonzero(tie_points.rays == 0)) if has_tracks else 0
    has_rigs = any(part.find(key) is not None for key in ("rig_cameras", "rig_instances"))
    left_out += sentences(
        (
            not has_tracks,
            "The observations of tie points: there is no tracks.csv beside the reconstruction.",
        ),
        (
            unseen,
            f"The observations of {things(unseen, 'tie point')}: tracks.csv has none of them; export it again if it "
            "was cut off.",
        ),
        (others, f"{things(others, 'observation')} of tie points or photographs without a position."),
        (has_rigs, "Rigs: their photographs stand on their own."),
        (any(shot.find("vertices") is not None for _, shot in shots.entries()), "Meshes of the photographs."),
        (part.get("pano_shots", {}).keys(), "Panoramas."),
    )
    crs = GEODETIC if any(photograph.measured is not None for photograph in photographs) else None
    ground, control = None, path.with_name(CONTROL)
    if control.exists():
        ground, named, strange = read_ground_control(control, photographs)
        photographs, crs = in_crs_of_control(control, photographs, GEODETIC, named), named
        left_out += strange
    return ForeignSolution(
        "OpenSfM",
        cameras,
        photographs,
        tie_points,
        ground,
        frame="local" if origin is None else "topocentric",
        origin_lla=origin,
        crs=crs,
        left_out=tuple(left_out),
    )


def _origin(path: Path, part: Node) -> tuple[float, float, float] | None:
    origin, file = part.find("reference_lla"), path.with_name("reference_lla.json")
    if origin is None:
        if not file.exists():
            return None
        origin = read_json(file)
    latitude, longitude, height = (origin.get(key).number() for key in ("latitude", "longitude", "altitude"))
    if not (abs(latitude) <= 90 and abs(longitude) <= 360 and abs(height) < 1e6):
        raise ExchangeError(
            f"{origin.place}: the origin ({latitude:g}, {longitude:g}, {height:g}) is no place on Earth"
        )
    return latitude, longitude, height


def _camera(key: str, node: Node) -> Camera:
    kind = node.get("projection_type", "perspective").text()
    if kind not in _KINDS:
        raise ExchangeError(
            f"{node.place}: photogram has no camera model {shortened(printable(kind))!r}: set camera_projection_type "
            "of OpenSfM to BROWN or FISHEYE_OPENCV"
        )

    def number(name: str) -> float:
        return node.get(name, 0.0).number()

    width, height = (node.get(name).number() for name in ("width", "height"))
    size = max(width, height)
    names = ("focal_x", "focal_y") if node.find("focal") is None else ("focal", "focal")
    focal_x, focal_y = (node.get(name).number() for name in names)
    return camera_of(
        node.place,
        key,
        (width, height),
        focal_y * size,
        (number("c_x") * size + (width - 1) / 2, number("c_y") * size + (height - 1) / 2),
        [number(name) for name in ("k1", "k2", "k3", "k4")],
        (number("p1"), number("p2")) if kind == "brown" else (0.0, 0.0),
        ((focal_x - focal_y) * size, 0.0),
        _KINDS[kind],
    )


def _photograph(
    key: str, shot: Node, index: Mapping[str, int], origin: tuple[float, float, float] | None
) -> ForeignPhotograph:
    file = file_of(shot.place, key)
    camera = shot.get("camera").text()
    if camera not in index:
        raise ExchangeError(f"{shot.place}: there is no camera {shortened(printable(camera))!r}: it is damaged")
    vector = shot.get("rotation").numbers(3)
    if np.abs(vector).max() > 1e3:
        raise ExchangeError(f"{shot.place}: its rotation vector is none: export it again")
    R = Rotation.from_rotvec(vector).as_matrix().T
    pose = pose_of(shot.place, R, -R @ shot.get("translation").numbers(3))
    measured = sigma = None
    position, accuracy = shot.find("gps_position"), shot.find("gps_dop")
    if origin is not None and position is not None and accuracy is not None:
        accuracy_m = accuracy.number()
        if 0 < accuracy_m < _NO_ACCURACY_M:
            measured = geodetic_from_topocentric(origin, position.numbers(3)[None])[0]
            sigma = np.full(3, accuracy_m)
    return ForeignPhotograph(file.name, index[camera], pose, file, measured, sigma)


def _tie_points(
    path: Path, photographs: Sequence[ForeignPhotograph], cameras: Sequence[Camera], keys: Sequence[str], points: Node
) -> tuple[TiePoints, int]:
    """Return the tie points, and the number of observations of others; ``keys`` are the photographs' in the files."""
    position, colour = points.table("coordinates", 3), points.table("color", 3, [0, 0, 0])
    if ((colour < 0) | (colour > 255)).any():
        raise ExchangeError(f"{points.place}: a color lies outside of 0 to 255: it is damaged")
    none = np.zeros(0, dtype=np.int64)
    tracks = Tracks(none, none, none, np.zeros((0, 2)), 0)
    file = path.with_name("tracks.csv")
    if file.exists():
        tracks = read_tracks(
            file, {key: i for i, key in enumerate(keys)}, {key: i for i, key in enumerate(points.keys())}
        )
    pixel = pixel_of_normalised(sizes_of(cameras, photographs)[tracks.photograph], tracks.normalised)
    tie = tie_points_of(
        str(file),
        tracks.photograph,
        tracks.point,
        pixel,
        position,
        feature=tracks.feature,
        colour=np.rint(colour).astype(np.uint8),
    )
    return tie, tracks.others


# ---- writing -------------------------------------------------------------------------------------------------------


def write_opensfm(folder: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write reconstruction.json and tracks.csv, reference_lla.json where the frame has an origin, and gcp_list.txt of
    ground points with a CRS; returns sentences on what has no place in them.

    Raises ExchangeError where a camera has b2, k4 in the model brown or p1 or p2 in the model fisheye, which no camera
    model of OpenSfM holds, or a name has a tab; WorkspaceError where the folder cannot be written.
    """
    check_writable(folder, solution)
    names = [camera.name for camera in solution.cameras]
    keys = [name if names.count(name) == 1 else f"{name} {i}" for i, name in enumerate(names)]
    cameras = {key: _camera_written(folder, camera) for key, camera in zip(keys, solution.cameras, strict=True)}
    enu = _measured_enu(solution)
    shots = {
        photograph.name: _shot_written(photograph, photograph.pose, keys[photograph.camera], enu.get(i))
        for i, photograph in enumerate(solution.photographs)
        if photograph.pose is not None
    }
    chosen, others = oriented_tie_points(solution)
    points = {
        str(i): {"color": colour, "coordinates": place}
        for i, (colour, place) in enumerate(
            zip(chosen.colour.astype(float).tolist(), chosen.position_world_m.tolist(), strict=True)
        )
    }
    part: dict[str, object] = {"cameras": cameras, "shots": shots, "points": points}
    files = {}
    if solution.origin_lla is not None:
        lla = dict(zip(("latitude", "longitude", "altitude"), solution.origin_lla, strict=True))
        part["reference_lla"] = lla
        files["reference_lla.json"] = json.dumps(lla)
    sizes = sizes_of(solution.cameras, solution.photographs)
    normalised = normalised_of_pixel(sizes[chosen.photograph], chosen.pixel)
    feature = np.where(chosen.feature < 0, 0, chosen.feature)
    tracks = Tracks(chosen.photograph, chosen.point, feature, normalised, 0)
    files["reconstruction.json"] = json.dumps([part], allow_nan=False, ensure_ascii=False)
    files["tracks.csv"] = tracks_text([p.name for p in solution.photographs], tracks, chosen.colour[chosen.point])
    make_folder(folder)
    for name, text in files.items():
        write_whole(folder / name, text)
    control = write_ground_control(folder, solution)
    return (*unoriented_photographs(solution), *others, *control, *_not_written(solution, bool(enu)))


def _camera_written(folder: Path, camera: Camera) -> dict[str, object]:
    k4, (p1, p2) = float(camera.radial[3]), camera.tangential.tolist()
    is_fisheye = camera.model == "fisheye"
    for name, is_beyond in (
        ("b2", camera.affinity[1] != 0),
        ("k4", k4 != 0 and not is_fisheye),
        ("p1 and p2", is_fisheye and (p1 != 0 or p2 != 0)),
    ):
        if is_beyond:
            raise ExchangeError(
                f"{folder}: camera {camera.name}: no camera model of OpenSfM holds {name} of the model {camera.model}: "
                "calibrate without it"
            )
    size = max(camera.width_px, camera.height_px)
    cx, cy = camera.principal_point_px
    written: dict[str, object] = {
        "projection_type": "fisheye_opencv" if is_fisheye else "brown",
        "width": camera.width_px,
        "height": camera.height_px,
        "focal_x": float(camera.focal_px + camera.affinity[0]) / size,
        "focal_y": float(camera.focal_px) / size,
        "c_x": float(cx - (camera.width_px - 1) / 2) / size,
        "c_y": float(cy - (camera.height_px - 1) / 2) / size,
        "k1": float(camera.radial[0]),
        "k2": float(camera.radial[1]),
        "k3": float(camera.radial[2]),
    }
    return {**written, "k4": k4} if is_fisheye else {**written, "p1": p1, "p2": p2}


def _shot_written(photograph: ForeignPhotograph, pose: Pose, camera: str, enu: FloatArray | None) -> dict[str, object]:
    R = pose.rotation_world_from_camera.T
    written: dict[str, object] = {
        "rotation": Rotation.from_matrix(R).as_rotvec().tolist(),
        "translation": (-R @ pose.position_world_m).tolist(),
        "camera": camera,
    }
    if enu is not None:
        sigma = photograph.measured_sigma_m
        written["gps_position"] = enu.tolist()
        written["gps_dop"] = _USUAL_ACCURACY_M if sigma is None else float(np.max(sigma))
    return written


def _measured_enu(solution: ForeignSolution) -> dict[int, FloatArray]:
    """Return the measured positions of oriented photographs in the frame, by the photographs' numbers."""
    if solution.origin_lla is None or solution.crs != GEODETIC:
        return {}
    return {
        i: topocentric_from_geodetic(solution.origin_lla, photograph.measured[None])[0]
        for i, photograph in enumerate(solution.photographs)
        if photograph.measured is not None and photograph.pose is not None
    }


def _not_written(solution: ForeignSolution, has_measured: bool) -> Iterator[str]:
    photographs = solution.photographs
    if (solution.tie_points.feature < 0).any():
        yield "That some observations have no key point: they have the number 0."
    if any(p.file.name != str(p.file) for p in photographs):
        yield "The folders of photographs."
    yield from without_place(replace(solution, ground_points=None), has_origin=True, has_measured=has_measured)
    if has_measured and any(p.measured_sigma_m is not None and np.ptp(p.measured_sigma_m) > 0 for p in photographs):
        yield "Standard deviations of measured positions by their axes: the largest stands for all three."
    if has_measured and any(p.measured is not None and p.measured_sigma_m is None for p in photographs):
        yield f"That some measured positions have no accuracy: they have OpenSfM's {_USUAL_ACCURACY_M:g} m."
