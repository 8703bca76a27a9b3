"""Meshroom's scenes, .sfm files of JSON, as AliceVision's nodes write them.

AliceVision's camera frame is photogram's; a pose holds the rotation camera from world, column by column, and the
projection centre. Pixels have the centre of the top-left one at (0, 0); the principal point is an offset from
(w/2, h/2), before version 1.2.1 of the file a pixel (src/aliceVision/sfmDataIO/jsonIO.cpp). The models pinhole,
radial1, radial3, brown and fisheye4 are photogram's; radial3pt, fisheye1, equidistant, and those of 3DEqualizer are
not.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.files.exchange.assembly import camera_of, check_names, file_of, pose_of, tie_points_of, whole_numbers
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
from photogram.files.exchange.solution import ForeignPhotograph, ForeignSolution
from photogram.survey import TRANSFERRED, TiePoints
from photogram.wording import printable, shortened, things

_DISTORTIONS = {
    "pinhole": "none",
    "radial1": "radialk1",
    "radial3": "radialk3",
    "brown": "brown",
    "fisheye4": "fisheye4",
}
"""What a type of camera of files without distortionType distorts by."""

_PARAMETERS = {"none": 0, "radialk1": 1, "radialk3": 3, "brown": 5, "fisheye4": 4}
_SENSOR_WIDTH_MM = 36.0
"""What AliceVision takes where a file has none."""


def read_meshroom(path: Path) -> ForeignSolution:
    """Return the scene of an .sfm file of JSON.

    Photographs of rigs have poses that depend on one another, and none here. Raises ExchangeError where the file is
    damaged, or a camera model is none of photogram's.
    """
    where = str(path)
    scene = as_object(where, read_json(path))
    version = tuple(int(v) for v in as_vector(f"{where}: version", member(where, scene, "version"), 3))
    held = as_list(f"{where}: intrinsics", scene.get("intrinsics", []))
    cameras, index = [], {}
    for i, value in enumerate(held):
        camera = as_object(f"{where}: intrinsics: {i}", value)
        number = _id(f"{where}: intrinsics: {i}", camera, "intrinsicId")
        index[number] = i
        cameras.append(_camera(f"{where}: camera {number}", number, camera, version))
    poses = {}
    for i, value in enumerate(as_list(f"{where}: poses", scene.get("poses", []))):
        owner = as_object(f"{where}: poses: {i}", value)
        number = _id(f"{where}: poses: {i}", owner, "poseId")
        poses[number] = _pose(f"{where}: pose {number}", owner)
    photographs, views, of_rigs = [], {}, 0
    for i, value in enumerate(as_list(f"{where}: views", scene.get("views", []))):
        view = as_object(f"{where}: views: {i}", value)
        file = file_of(f"{where}: views: {i}", as_text(where, member(where, view, "path")))
        camera_id = _id(f"{where}: view of {file.name}", view, "intrinsicId")
        if camera_id not in index:
            raise ExchangeError(f"{where}: {file.name} names camera {camera_id}, which is not there: it is damaged")
        is_of_rig = str(view.get("isPoseIndependant", "true")).lower() in ("false", "0")
        of_rigs += is_of_rig
        pose = None if is_of_rig else poses.get(str(view.get("poseId", "")))
        views[_id(where, view, "viewId")] = i
        photographs.append(ForeignPhotograph(file.name, index[camera_id], pose, file))
    check_names(where, photographs)
    tie_points, has_features = _tie_points(where, as_list(f"{where}: structure", scene.get("structure", [])), views)
    left_out = [f"The poses of {things(of_rigs, 'photograph')} of rigs."] if of_rigs else []
    if len(tie_points) and not has_features:
        left_out.append("The observations of tie points: the file was saved without features.")
    if "controlPoints" in scene:
        left_out.append("Control points.")
    return ForeignSolution("Meshroom", tuple(cameras), tuple(photographs), tie_points, left_out=tuple(left_out))


def _id(where: str, owner: Object, key: str) -> str:
    return str(as_whole(f"{where}: {key}", member(where, owner, key)))


def _camera(where: str, number: str, held: Object, version: tuple[int, ...]) -> Camera:
    kind = as_text(f"{where}: type", member(where, held, "type"))
    distortion = as_text(where, held.get("distortionType", _DISTORTIONS.get(kind, kind))).lower()
    undistortion = as_text(where, held.get("undistortionType", "none")).lower()
    beyond = next((k for k, bad in ((kind, kind not in _DISTORTIONS), (distortion, distortion not in _PARAMETERS),
                                    (undistortion, undistortion != "none")) if bad), None)  # fmt: skip
    if beyond is not None:
        raise ExchangeError(
            f"{where}: photogram has no camera model {shortened(printable(beyond))!r}: choose pinhole with brown, "
            "radialk3 or fisheye4 in Meshroom"
        )
    width, height = (as_whole(f"{where}: {key}", member(where, held, key)) for key in ("width", "height"))
    k = [as_number(where, v) for v in as_list(f"{where}: distortionParams", held.get("distortionParams", []))]
    if len(k) != _PARAMETERS[distortion] and not (distortion == "none" and not any(k)):
        raise ExchangeError(
            f"{where}: has {len(k)} parameters of distortion, {distortion} has {_PARAMETERS[distortion]}: it is damaged"
        )
    fx, fy = _focal_px(where, held, version, width)
    offset = as_vector(f"{where}: principalPoint", member(where, held, "principalPoint"), 2)
    centre = offset if version < (1, 2, 1) else offset + np.array([width / 2, height / 2])
    radial = {"none": [], "brown": k[:3]}.get(distortion, k)
    tangential = (k[3], k[4]) if distortion == "brown" else (0.0, 0.0)
    model = "fisheye" if distortion == "fisheye4" else "brown"
    return camera_of(
        where, number, (width, height), fy, centre.tolist(), radial, tangential, (fx - fy, 0.0),
        "fisheye" if model == "fisheye" else "brown",
    )  # fmt: skip


def _focal_px(where: str, held: Object, version: tuple[int, ...], width: int) -> tuple[float, float]:
    """Return the focal lengths fx and fy, which four versions of the file hold in four ways."""
    if version < (1, 2, 0):
        focal = as_number(f"{where}: pxFocalLength", member(where, held, "pxFocalLength"))
        return focal, focal
    if version < (1, 2, 2):
        fx, fy = as_vector(f"{where}: pxFocalLength", member(where, held, "pxFocalLength"), 2).tolist()
        return fx, fy
    focal = as_number(f"{where}: focalLength", member(where, held, "focalLength"))
    sensor = as_number(f"{where}: sensorWidth", held.get("sensorWidth", _SENSOR_WIDTH_MM))
    ratio = as_number(f"{where}: pixelRatio", held.get("pixelRatio", 1.0))
    if not (sensor > 0 and ratio > 0):
        raise ExchangeError(f"{where}: sensorWidth and pixelRatio must be positive: it is damaged")
    fx = focal / sensor * width
    return fx, fx / ratio if version < (1, 2, 5) else fx * ratio


def _pose(where: str, owner: Object) -> Pose | None:
    held = as_object(where, member(where, owner, "pose"))
    if str(held.get("valid", "1")).lower() in ("0", "false"):
        return None
    transform = as_object(where, member(where, held, "transform"))
    rotation = as_vector(f"{where}: rotation", member(where, transform, "rotation"), 9)
    centre = as_vector(f"{where}: center", member(where, transform, "center"), 3)
    return pose_of(where, rotation.reshape(3, 3), centre)


def _tie_points(where: str, structure: object, views: Mapping[str, int]) -> tuple[TiePoints, bool]:
    """Return the tie points, and whether their observations have places."""
    where = f"{where}: structure"
    landmarks = [as_object(where, landmark) for landmark in as_list(where, structure)]
    position = as_rows(f"{where}: X", (member(where, landmark, "X") for landmark in landmarks), 3)
    colour = as_rows(f"{where}: color", (landmark.get("color", [0, 0, 0]) for landmark in landmarks), 3)
    found = [as_list(where, landmark.get("observations", [])) for landmark in landmarks]
    point = np.repeat(np.arange(len(found)), [len(observations) for observations in found])
    seen = [as_object(where, observation) for observations in found for observation in observations]
    has_features = bool(seen) and "x" in seen[0]
    if not has_features:
        seen, point = [], point[:0]
    pixel = as_rows(f"{where}: x", (member(where, observation, "x") for observation in seen), 2)
    feature = as_rows(f"{where}: featureId", ([o.get("featureId", TRANSFERRED)] for o in seen), 1)[:, 0]
    photograph = np.array([views.get(str(o.get("observationId", "")), -1) for o in seen], dtype=np.int64)
    if (photograph < 0).any():
        raise ExchangeError(f"{where}: an observation names a view that is not there: it is damaged")
    # what has no key point has the largest number of 32 bits
    feature = np.where(feature >= 2**32 - 1, TRANSFERRED, feature)
    tie_points = tie_points_of(
        where,
        photograph,
        point.astype(np.int64),
        whole_numbers(where, "featureId", feature, TRANSFERRED),
        pixel,
        position,
        whole_numbers(where, "a color", colour.ravel(), 0, 255).astype(np.uint8),
    )
    return tie_points, has_features
