"""Sparse models of COLMAP, binary or text, read and written.

COLMAP's camera frame is photogram's; its pixels are half a pixel more, and its poses are camera from world. A model
lies in a folder with cameras, images and points3D as .bin or .txt.
"""

from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Pose
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import (
    HALF_PIXEL,
    check_names,
    index_in,
    pose_of,
    rotation_of_quaternion,
    sentences,
    tie_points_of,
)
from photogram.exchange.formats.colmap.binary_models import binary_files, read_binary, sensors_of_rigs
from photogram.exchange.formats.colmap.records import ColmapImage, ColmapPoints, SparseModel, from_colmap, to_colmap
from photogram.exchange.formats.colmap.text_models import read_text, text_files
from photogram.exchange.formats.writing import (
    check_writable,
    oriented_tie_points,
    path_to_write,
    unoriented_photographs,
    without_place,
)
from photogram.files.atomic import make_folder, write_whole
from photogram.files.solutions.parsing import check_distinct, file_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.survey import TiePoints
from photogram.wording import things

_FILES = ("cameras", "images", "points3D")


def read_colmap(folder: Path) -> ForeignSolution:
    """Return the sparse model that lies in a folder, the binary files where there are both.

    Raises ExchangeError where the files are not there, damaged, contradict each other, or have a camera model that is
    none of photogram's.
    """
    binary = all((folder / f"{name}.bin").exists() for name in _FILES)
    if not binary and not all((folder / f"{name}.txt").exists() for name in _FILES):
        raise ExchangeError(
            f"{folder}: holds no model of COLMAP: name the folder with cameras, images and points3D, as .bin or .txt"
        )
    return _solution(folder, "bin", read_binary(folder)) if binary else _solution(folder, "txt", read_text(folder))


def _solution(folder: Path, suffix: str, model: SparseModel) -> ForeignSolution:
    where = {name: str(folder / f"{name}.{suffix}") for name in _FILES}
    check_distinct(where["cameras"], "CAMERA_ID", np.array([c.number for c in model.cameras], dtype=np.int64))
    check_distinct(where["images"], "IMAGE_ID", np.array([i.number for i in model.images], dtype=np.int64))
    check_distinct(where["points3D"], "POINT3D_ID", model.points.number)
    camera_index = {camera.number: i for i, camera in enumerate(model.cameras)}
    cameras = tuple(from_colmap(where["cameras"], camera) for camera in model.cameras)
    photographs = tuple(_photograph(where["images"], image, camera_index) for image in model.images)
    check_names(where["images"], (photograph.file for photograph in photographs))
    tie_points = _tie_points(where, model)
    keys = sum(len(image.point) for image in model.images)
    spare = keys - len(tie_points.photograph)
    rigs_file = folder / "rigs.bin"
    rigs = sum(n > 1 for n in sensors_of_rigs(rigs_file)) if suffix == "bin" and rigs_file.exists() else 0
    left_out = sentences(
        (spare, f"{things(spare, 'key point')} that observe no tie point."),
        (len(tie_points), "The mean reprojection error of each tie point."),
        (rigs, f"{things(rigs, 'rig')} of several cameras: their photographs stand on their own."),
    )
    return ForeignSolution("COLMAP", cameras, photographs, tie_points, left_out=tuple(left_out))


def _photograph(where: str, image: ColmapImage, camera_index: dict[int, int]) -> ForeignPhotograph:
    where = f"{where}: image {image.number}"
    if image.camera not in camera_index:
        raise ExchangeError(f"{where}: there is no camera {image.camera}: save the model again in COLMAP")
    R = rotation_of_quaternion(where, image.quaternion).T
    file = file_of(where, image.name)
    return ForeignPhotograph(file.name, camera_index[image.camera], pose_of(where, R, -R @ image.translation), file)


def _tie_points(where: dict[str, str], model: SparseModel) -> TiePoints:
    """Return the tie points of the images' key points, which the tracks of the points must be."""
    points, images = model.points, model.images
    ends = np.cumsum([0, *(len(image.point) for image in images)])
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *(image.point for image in images)])
    pixel = np.concatenate([np.zeros((0, 2)), *(image.pixel for image in images)])
    observing = np.flatnonzero(numbers >= 0)
    photograph = np.searchsorted(ends, observing, side="right") - 1
    point = index_in(np.argsort(points.number), points.number, numbers[observing])
    if (point < 0).any():
        number = numbers[observing][point < 0][0]
        raise ExchangeError(f"{where['images']}: there is no tie point {number}: save the model again in COLMAP")
    _check_tracks(where["points3D"], points, images, ends, observing, point)
    return tie_points_of(
        where["points3D"],
        photograph.astype(np.int64),
        point,
        pixel[observing] - HALF_PIXEL,
        points.position,
        feature=observing - ends[photograph],
        colour=points.colour,
    )


def _check_tracks(
    where: str,
    points: ColmapPoints,
    images: tuple[ColmapImage, ...],
    ends: IntArray,
    observing: IntArray,
    point: IntArray,
) -> None:
    """Raise ExchangeError unless the tracks name the key points that name their points."""
    ids = np.array([image.number for image in images], dtype=np.int64)
    image = index_in(np.argsort(ids), ids, points.track_image)
    agrees = bool((image >= 0).all()) and len(image) == len(observing)
    if agrees and len(image):
        key = ends[image] + points.track_feature
        order = np.argsort(key, kind="stable")
        agrees = bool((points.track_feature < np.diff(ends)[image]).all())
        agrees = agrees and np.array_equal(key[order], observing) and np.array_equal(points.track_point[order], point)
    if not agrees:
        raise ExchangeError(
            f"{where}: the tracks of its tie points are not the key points that the images name for them: save the "
            "model again in COLMAP"
        )


# ---- writing -------------------------------------------------------------------------------------------------------


def write_colmap(
    folder: Path, solution: ForeignSolution, form: Literal["binary", "text"] = "binary"
) -> tuple[str, ...]:
    """Write a sparse model for COLMAP; returns sentences on what has no place in it.

    Raises ExchangeError where a camera has b2, or k4 in the model brown, which no camera model of COLMAP holds, a
    name has a space and the form is text, or the folder has a model in the other form or of rigs, which would be read
    in place of this one; WorkspaceError where the folder cannot be written.
    """
    others = [f"{name}.{'txt' if form == 'binary' else 'bin'}" for name in _FILES]
    others += [f"{name}.{suffix}" for name in ("rigs", "frames") for suffix in ("bin", "txt")]
    stale = [name for name in others if (folder / name).exists()]
    if stale:
        raise ExchangeError(f"{folder}: holds {stale[0]} of another model: write to an empty folder")
    check_writable(folder, solution)
    cameras = tuple(to_colmap(str(folder), i + 1, camera) for i, camera in enumerate(solution.cameras))
    tie, others = oriented_tie_points(solution)
    feature = np.empty(len(tie.photograph), dtype=np.int64)
    order = np.argsort(tie.photograph, kind="stable")
    cuts = np.searchsorted(tie.photograph[order], np.arange(len(solution.photographs) + 1))
    images = []
    for i, photograph in enumerate(solution.photographs):
        if photograph.pose is None:
            continue
        mine = order[cuts[i] : cuts[i + 1]]
        feature[mine] = np.arange(len(mine))
        name = _name_to_write(photograph, form)
        images.append(_image(i, photograph.camera, photograph.pose, name, tie.pixel[mine], tie.point[mine]))
    points = ColmapPoints(
        np.arange(1, len(tie) + 1),
        tie.position_world_m,
        tie.colour,
        np.full(len(tie), -1.0),
        tie.point,
        tie.photograph + 1,
        feature,
    )
    model = SparseModel(cameras, tuple(images), points)
    make_folder(folder)
    for name, content in (binary_files(model) if form == "binary" else text_files(model)).items():
        write_whole(folder / name, content)
    renumbered = sentences((len(tie.feature), "The numbers of key points: they are numbered anew."))
    return (*unoriented_photographs(solution), *others, *renumbered, *without_place(solution))


def _name_to_write(photograph: ForeignPhotograph, form: str) -> str:
    name = path_to_write(photograph)
    if form == "text" and len(name.split()) != 1:
        raise ExchangeError(f"{name!r}: COLMAP ends names in text at a space: write the model in binary form")
    return name


def _image(i: int, camera: int, pose: Pose, name: str, pixel: FloatArray, point: IntArray) -> ColmapImage:
    """Return photograph ``i`` with its observations, all counted from 0, as COLMAP has it, all counted from 1."""
    R = pose.rotation_world_from_camera.T
    quaternion = Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)
    translation = -R @ pose.position_world_m
    return ColmapImage(i + 1, quaternion, translation, camera + 1, name, pixel + HALF_PIXEL, point + 1)
