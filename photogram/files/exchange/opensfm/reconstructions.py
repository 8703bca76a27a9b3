"""Reconstructions of OpenSfM and OpenDroneMap: reconstruction.json, tracks.csv, reference_lla.json, read and written.

OpenSfM's camera frame is photogram's; a shot holds the rotation vector and the translation camera from world, a camera
its focal length and principal point in normalised image coordinates, see ``tracks`` (OpenSfM documentation,
Geometric Models). Perspective, simple_radial, radial and brown are Brown's model, fisheye and fisheye_opencv the
equidistant one, all in photogram's direction. The world is east, north, up at ``reference_lla``, which OpenSfM sets to
zeros where no photograph has a position: then it is the frame of a free network.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera
from photogram.errors import ExchangeError
from photogram.files.atomic import make_folder, replacing
from photogram.files.exchange.assembly import camera_of, check_names, file_of, pose_of, tie_points_of, without_place
from photogram.files.exchange.json_values import (
    Object,
    as_list,
    as_number,
    as_object,
    as_rows,
    as_text,
    as_vector,
    as_whole,
    member,
    read_json,
)
from photogram.files.exchange.opensfm.tracks import (
    Tracks,
    normalised_of_pixel,
    pixel_of_normalised,
    read_tracks,
    tracks_text,
)
from photogram.files.exchange.solution import ForeignPhotograph, ForeignSolution
from photogram.frames import geodetic_from_topocentric, topocentric_from_geodetic
from photogram.survey import TiePoints
from photogram.wording import printable, shortened, things

GEODETIC = "EPSG:4979"
"""CRS of measured positions: longitude, latitude, ellipsoidal height."""

_KINDS = {
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

    tracks.csv and reference_lla.json are read where they lie beside it. Measured positions have the CRS EPSG:4979,
    longitude before latitude. Raises ExchangeError where a file is damaged, or a camera model is none of photogram's.
    """
    path = path / "reconstruction.json" if path.is_dir() else path
    held = as_list(str(path), read_json(path))
    parts = [as_object(f"{path}: {i}", part) for i, part in enumerate(held)]
    sizes = [
        len(as_object(f"{path}: {i}: shots", member(f"{path}: {i}", part, "shots"))) for i, part in enumerate(parts)
    ]
    if not parts:
        raise ExchangeError(f"{path}: holds no reconstruction: run OpenSfM's reconstruct first")
    chosen = int(np.argmax(sizes))
    left_out = []
    if len(parts) > 1:
        left_out.append(f"{things(len(parts) - 1, 'smaller reconstruction')} of the file.")
    return _solution(path, f"{path}: {chosen}", parts[chosen], left_out)


def _solution(path: Path, where: str, part: Object, left_out: list[str]) -> ForeignSolution:
    shots = as_object(f"{where}: shots", part["shots"])
    cameras_held = as_object(f"{where}: cameras", member(where, part, "cameras"))
    index = {key: i for i, key in enumerate(cameras_held)}
    cameras = tuple(_camera(where, key, value) for key, value in cameras_held.items())
    lla = _origin(path, where, part)
    origin = lla if lla != (0.0, 0.0, 0.0) else None
    photographs = tuple(_photograph(where, key, value, index, origin) for key, value in shots.items())
    check_names(where, photographs)
    points = as_object(f"{where}: points", part.get("points", {}))
    tie_points, others = _tie_points(path, where, photographs, cameras, list(shots), points)
    tracks = path.with_name("tracks.csv")
    if not tracks.exists():
        left_out.append("The observations of tie points: there is no tracks.csv beside the reconstruction.")
    if others:
        left_out.append(f"{things(others, 'observation')} of tie points or photographs without a position.")
    if any(key in part for key in ("rig_cameras", "rig_instances")):
        left_out.append("Rigs: their photographs stand on their own.")
    if any("vertices" in as_object(where, shot) for shot in shots.values()):
        left_out.append("Meshes of the photographs.")
    if part.get("pano_shots"):
        left_out.append("Panoramas.")
    return ForeignSolution(
        "OpenSfM",
        cameras,
        photographs,
        tie_points,
        frame="local" if origin is None else "topocentric",
        origin_lla=origin,
        crs=GEODETIC if any(photograph.measured is not None for photograph in photographs) else None,
        left_out=tuple(left_out),
    )


def _origin(path: Path, where: str, part: Object) -> tuple[float, float, float] | None:
    beside = path.with_name("reference_lla.json")
    if "reference_lla" in part:
        held = as_object(f"{where}: reference_lla", part["reference_lla"])
    elif beside.exists():
        where, held = str(beside), as_object(str(beside), read_json(beside))
    else:
        return None
    latitude, longitude, height = (
        as_number(f"{where}: {key}", member(where, held, key)) for key in ("latitude", "longitude", "altitude")
    )
    if not (abs(latitude) <= 90 and abs(longitude) <= 360 and abs(height) < 1e6):
        raise ExchangeError(f"{where}: reference_lla ({latitude:g}, {longitude:g}, {height:g}) is no place on Earth")
    return latitude, longitude, height


def _camera(where: str, key: str, value: object) -> Camera:
    where = f"{where}: camera {shortened(printable(key))}"
    held = as_object(where, value)
    kind = as_text(where, held.get("projection_type", "perspective"))
    if kind not in _KINDS:
        raise ExchangeError(
            f"{where}: photogram has no camera model {shortened(printable(kind))!r}: set camera_projection_type of "
            "OpenSfM to BROWN or FISHEYE_OPENCV"
        )

    def number(name: str) -> float:
        return as_number(f"{where}: {name}", held.get(name, 0.0))

    width, height = (as_whole(f"{where}: {name}", member(where, held, name)) for name in ("width", "height"))
    size = max(width, height)
    simple = "focal" in held
    focal_x, focal_y = (
        as_number(where, member(where, held, n)) for n in (["focal"] * 2 if simple else ["focal_x", "focal_y"])
    )
    return camera_of(
        where,
        key,
        (width, height),
        focal_y * size,
        (number("c_x") * size + (width - 1) / 2, number("c_y") * size + (height - 1) / 2),
        [number(name) for name in ("k1", "k2", "k3", "k4")],
        (number("p1"), number("p2")) if kind == "brown" else (0.0, 0.0),
        ((focal_x - focal_y) * size, 0.0),
        "fisheye" if _KINDS[kind] == "fisheye" else "brown",
    )


def _photograph(
    where: str, key: str, value: object, index: dict[str, int], origin: tuple[float, float, float] | None
) -> ForeignPhotograph:
    file = file_of(where, key)
    where = f"{where}: shot {file.name}"
    held = as_object(where, value)
    camera = as_text(where, member(where, held, "camera"))
    if camera not in index:
        raise ExchangeError(f"{where}: there is no camera {shortened(printable(camera))!r}: it is damaged")
    vector = as_vector(f"{where}: rotation", member(where, held, "rotation"), 3)
    if np.abs(vector).max() > 1e3:
        raise ExchangeError(f"{where}: its rotation vector is none: export it again")
    R = Rotation.from_rotvec(vector).as_matrix().T
    translation = as_vector(f"{where}: translation", member(where, held, "translation"), 3)
    measured = sigma = None
    position, accuracy = held.get("gps_position"), held.get("gps_dop")
    if origin is not None and position is not None and accuracy is not None:
        accuracy_m = as_number(f"{where}: gps_dop", accuracy)
        if 0 < accuracy_m < _NO_ACCURACY_M:
            enu = as_vector(f"{where}: gps_position", position, 3)
            measured = geodetic_from_topocentric(origin, enu[None])[0]
            sigma = np.full(3, accuracy_m)
    return ForeignPhotograph(file.name, index[camera], pose_of(where, R, -R @ translation), file, measured, sigma)


def _tie_points(
    path: Path,
    where: str,
    photographs: tuple[ForeignPhotograph, ...],
    cameras: tuple[Camera, ...],
    keys: list[str],
    points: Object,
) -> tuple[TiePoints, int]:
    where = f"{where}: points"
    held = [as_object(where, point) for point in points.values()]
    position = as_rows(f"{where}: coordinates", (member(where, point, "coordinates") for point in held), 3)
    colour = as_rows(f"{where}: color", (point.get("color", [0, 0, 0]) for point in held), 3)
    if ((colour < 0) | (colour > 255)).any():
        raise ExchangeError(f"{where}: a color lies outside of 0 to 255: it is damaged")
    none = np.zeros(0, dtype=np.int64)
    tracks = Tracks(none, none, none, np.zeros((0, 2)), 0)
    beside = path.with_name("tracks.csv")
    if beside.exists():
        tracks = read_tracks(beside, {key: i for i, key in enumerate(keys)}, {key: i for i, key in enumerate(points)})
    camera = np.array([photograph.camera for photograph in photographs], dtype=np.int64)
    sizes = np.array([(c.width_px, c.height_px) for c in cameras], dtype=np.int64).reshape(-1, 2)
    pixel = pixel_of_normalised(sizes[camera[tracks.photograph]], tracks.normalised)
    rounded = np.rint(colour).astype(np.uint8)
    tie = tie_points_of(str(beside), tracks.photograph, tracks.point, tracks.feature, pixel, position, rounded)
    return tie, tracks.others


# ---- writing -------------------------------------------------------------------------------------------------------


def write_opensfm(folder: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write reconstruction.json and tracks.csv, and reference_lla.json where the frame has an origin; returns sentences
    on what has no place in them.

    Raises ExchangeError where a camera has b2, k4 in the model brown or p1 or p2 in the model fisheye, which no camera
    model of OpenSfM holds, or a name has a tab; WorkspaceError where the folder cannot be written.
    """
    names = [camera.name for camera in solution.cameras]
    keys = [name if names.count(name) == 1 else f"{name} {i}" for i, name in enumerate(names)]
    cameras = {key: _camera_written(folder, camera) for key, camera in zip(keys, solution.cameras, strict=True)}
    enu = _measured_enu(solution)
    shots = {}
    for i, photograph in enumerate(solution.photographs):
        file_of(str(folder), photograph.name)
        if photograph.pose is not None:
            shots[photograph.name] = _shot_written(photograph, keys[photograph.camera], enu.get(i))
    tie = solution.tie_points
    known: BoolArray = np.asarray(np.isfinite(tie.position_world_m).all(axis=1))
    oriented = np.array([photograph.pose is not None for photograph in solution.photographs], dtype=bool)
    kept: BoolArray = np.asarray(known[tie.point] & oriented[tie.photograph])
    chosen = tie.select(known, kept)
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
    sizes = np.array([(c.width_px, c.height_px) for c in solution.cameras], dtype=np.int64).reshape(-1, 2)
    camera = np.array([photograph.camera for photograph in solution.photographs], dtype=np.int64)
    normalised = normalised_of_pixel(sizes[camera[chosen.photograph]], chosen.pixel)
    feature = np.where(chosen.feature < 0, 0, chosen.feature)
    tracks = Tracks(chosen.photograph, chosen.point, feature, normalised, 0)
    files["reconstruction.json"] = json.dumps([part], allow_nan=False, ensure_ascii=False)
    files["tracks.csv"] = tracks_text([p.name for p in solution.photographs], tracks, chosen.colour[chosen.point])
    make_folder(folder)
    for name, text in files.items():
        with replacing(folder / name) as partial:
            partial.write_text(text, encoding="utf-8")
    return _not_written(solution, int((~known).sum()), int((~kept).sum()), bool(enu))


def _camera_written(folder: Path, camera: Camera) -> dict[str, object]:
    k4, (p1, p2) = float(camera.radial[3]), camera.tangential.tolist()
    is_fisheye = camera.model == "fisheye"
    beyond = (
        "b2"
        if camera.affinity[1]
        else "k4"
        if k4 and not is_fisheye
        else "p1 and p2"
        if is_fisheye and (p1 or p2)
        else ""
    )
    if beyond:
        raise ExchangeError(
            f"{folder}: camera {camera.name}: no camera model of OpenSfM holds {beyond} of the model {camera.model}: "
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


def _shot_written(photograph: ForeignPhotograph, camera: str, enu: FloatArray | None) -> dict[str, object]:
    if photograph.pose is None:
        raise ValueError("a photograph without a pose has no place in a reconstruction")
    R = photograph.pose.rotation_world_from_camera.T
    written: dict[str, object] = {
        "rotation": Rotation.from_matrix(R).as_rotvec().tolist(),
        "translation": (-R @ photograph.pose.position_world_m).tolist(),
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


def _not_written(solution: ForeignSolution, unknown: int, lost: int, measured: bool) -> tuple[str, ...]:
    said = []
    bare = sum(photograph.pose is None for photograph in solution.photographs)
    if bare:
        said.append(f"{things(bare, 'photograph')} without an orientation.")
    if unknown:
        said.append(f"{things(unknown, 'tie point')} without a position.")
    if lost:
        said.append(f"{things(lost, 'observation')} of those.")
    if (solution.tie_points.feature < 0).any():
        said.append("That some observations have no key point: they have the number 0.")
    if any(p.file.name != str(p.file) for p in solution.photographs):
        said.append("The folders of photographs.")
    for sentence in without_place(solution):
        is_held = ("topocentric" in sentence) or (measured and "Measured" in sentence)
        said += [] if is_held else [sentence]
    unequal = [p for p in solution.photographs if p.measured_sigma_m is not None and np.ptp(p.measured_sigma_m) > 0]
    if measured and unequal:
        said.append("Standard deviations of measured positions by their axes: the largest stands for all three.")
    if measured and any(p.measured is not None and p.measured_sigma_m is None for p in solution.photographs):
        said.append(f"That some measured positions have no accuracy: they have OpenSfM's {_USUAL_ACCURACY_M:g} m.")
    return tuple(said)
