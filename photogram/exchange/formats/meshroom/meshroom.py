"""Meshroom's scenes, .sfm files of JSON, as AliceVision's nodes write them.

AliceVision's camera frame is photogram's; a pose holds the rotation camera from world, column by column, and the
projection centre. Pixels have the centre of the top-left one at (0, 0); the principal point is an offset from
(w/2, h/2), before version 1.2.1 of the file a pixel (src/aliceVision/sfmDataIO/jsonIO.cpp). The models pinhole,
radial1, radial3, brown and fisheye4 are photogram's; radial3pt, fisheye1, equidistant, and those of 3DEqualizer are
not.
"""

from pathlib import Path

import numpy as np

from photogram.arrays import IntArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import camera_of, check_names, index_in, pose_of, tie_points_of
from photogram.exchange.formats.json_nodes import Node, read_json
from photogram.files.solutions.parsing import file_of, whole_numbers
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
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

_NONE = 2**32 - 1
"""The largest number of a view, a pose, a camera or a key point; of key points it stands for none."""


def read_meshroom(path: Path) -> ForeignSolution:
    """Return the scene of an .sfm file of JSON.

    Photographs of rigs have poses that depend on one another, and none here. Raises ExchangeError where the file is
    damaged, or a camera model is none of photogram's.
    """
    scene = read_json(path, numbers_are_text=True)
    version = tuple(scene.get("version").numbers(3).astype(int).tolist())
    cameras, index = [], {}
    for i, intrinsic in enumerate(scene.get("intrinsics", []).items()):
        number = _id(intrinsic, "intrinsicId")
        index[number] = i
        cameras.append(_camera(intrinsic, str(number), version))
    poses = {_id(owner, "poseId"): _pose(owner.get("pose")) for owner in scene.get("poses", []).items()}
    photographs, views = [], []
    of_rigs = 0
    for view in scene.get("views", []).items():
        file = file_of(view.place, view.get("path").text())
        camera_id = _id(view, "intrinsicId")
        if camera_id not in index:
            raise ExchangeError(
                f"{view.place}: {file.name} names camera {camera_id}, which is not there: it is damaged"
            )
        is_of_rig = not view.get("isPoseIndependant", True).flag()
        of_rigs += is_of_rig
        pose = None if is_of_rig or view.find("poseId") is None else poses.get(_id(view, "poseId"))
        views.append(_id(view, "viewId"))
        photographs.append(ForeignPhotograph(file.name, index[camera_id], pose, file))
    check_names(str(path), (photograph.file for photograph in photographs))
    structure = scene.get("structure", [])
    tie_points, has_features = _tie_points(structure, np.array(views, dtype=np.int64))
    left_out = [f"The poses of {things(of_rigs, 'photograph')} of rigs."] if of_rigs else []
    if len(tie_points) and not has_features:
        left_out.append("The observations of tie points: the file was saved without features.")
    if scene.find("controlPoints") is not None:
        left_out.append("Control points.")
    return ForeignSolution("Meshroom", tuple(cameras), tuple(photographs), tie_points, left_out=tuple(left_out))


def _id(owner: Node, key: str) -> int:
    return owner.get(key).whole(_NONE)


def _camera(intrinsic: Node, number: str, version: tuple[int, ...]) -> Camera:
    kind = intrinsic.get("type").text()
    distortion = intrinsic.get("distortionType", _DISTORTIONS.get(kind, kind)).text().lower()
    undistortion = intrinsic.get("undistortionType", "none").text().lower()
    for name, is_known in (
        (kind, kind in _DISTORTIONS),
        (distortion, distortion in _PARAMETERS),
        (undistortion, undistortion == "none"),
    ):
        if not is_known:
            raise ExchangeError(
                f"{intrinsic.place}: photogram has no camera model {shortened(printable(name))!r}: choose pinhole with "
                "brown, radialk3 or fisheye4 in Meshroom"
            )
    width, height = (intrinsic.get(key).number() for key in ("width", "height"))
    k = [value.number() for value in intrinsic.get("distortionParams", []).items()]
    if len(k) != _PARAMETERS[distortion] and not (distortion == "none" and not any(k)):
        raise ExchangeError(
            f"{intrinsic.place}: has {len(k)} parameters of distortion, {distortion} has {_PARAMETERS[distortion]}: it "
            "is damaged"
        )
    fx, fy = _focal_px(intrinsic, version, width)
    offset = intrinsic.get("principalPoint").numbers(2)
    centre = offset if version < (1, 2, 1) else offset + np.array([width / 2, height / 2])
    return camera_of(
        intrinsic.place,
        number,
        (width, height),
        fy,
        centre.tolist(),
        {"none": [], "brown": k[:3]}.get(distortion, k),
        (k[3], k[4]) if distortion == "brown" else (0.0, 0.0),
        (fx - fy, 0.0),
        "fisheye" if distortion == "fisheye4" else "brown",
    )


def _focal_px(intrinsic: Node, version: tuple[int, ...], width: float) -> tuple[float, float]:
    """Return the focal lengths fx and fy, which four versions of the file hold in four ways."""
    if version < (1, 2, 0):
        focal = intrinsic.get("pxFocalLength").number()
        return focal, focal
    if version < (1, 2, 2):
        fx, fy = intrinsic.get("pxFocalLength").numbers(2).tolist()
        return fx, fy
    focal = intrinsic.get("focalLength").number()
    sensor = intrinsic.get("sensorWidth", _SENSOR_WIDTH_MM).number()
    ratio = intrinsic.get("pixelRatio", 1.0).number()
    if not (sensor > 0 and ratio > 0):
        raise ExchangeError(f"{intrinsic.place}: sensorWidth and pixelRatio must be positive: it is damaged")
    fx = focal / sensor * width
    return fx, fx / ratio if version < (1, 2, 5) else fx * ratio


def _pose(node: Node) -> Pose | None:
    if not node.get("valid", True).flag():
        return None
    transform = node.get("transform")
    rotation = transform.get("rotation").numbers(9).reshape(3, 3)
    return pose_of(node.place, rotation, transform.get("center").numbers(3))


def _tie_points(structure: Node, views: IntArray) -> tuple[TiePoints, bool]:
    """Return the tie points, and whether their observations have pixels; ``views`` (F,) are the photographs' ids."""
    where = structure.place
    position, colour = structure.table("X", 3), structure.table("color", 3, [0, 0, 0])
    tracks = [landmark.get("observations", []).elements() for landmark in structure.items()]
    seen = Node([observation for track in tracks for observation in track], f"{where}: observations")
    point = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    has_features = len(point) > 0 and seen.item(0).find("x") is not None
    if not has_features:
        seen, point = Node([], seen.place), point[:0]
    wanted = whole_numbers(where, "observationId", seen.table("observationId", 1)[:, 0], 0, _NONE)
    feature = whole_numbers(where, "featureId", seen.table("featureId", 1, _NONE)[:, 0], 0, _NONE)
    photograph = index_in(np.argsort(views), views, wanted)
    if (photograph < 0).any():
        raise ExchangeError(f"{where}: an observation names a view that is not there: it is damaged")
    tie_points = tie_points_of(
        where,
        photograph,
        point.astype(np.int64),
        seen.table("x", 2),
        position,
        feature=np.where(feature == _NONE, TRANSFERRED, feature),
        colour=whole_numbers(where, "a color", colour.ravel(), 0, 255).astype(np.uint8),
    )
    return tie_points, has_features
