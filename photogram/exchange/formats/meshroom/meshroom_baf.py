"""Meshroom's bundle adjustment files, .baf, with the list of photographs that AliceVision writes beside them.

The layout is that of src/aliceVision/sfmDataIO/bafIO.cpp: counts, a line of parameters for each camera, a line of the
rotation camera from world, column by column, and the projection centre for each photograph, a line for each tie point.
Frames and pixels are those of ``meshroom``. The file names no camera model: three parameters are a pinhole, six are
radial3, of AliceVision before its version 2.4; what other numbers are cannot be told.
"""

from pathlib import Path, PurePosixPath

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import camera_of, check_names, index_in, pose_of, tie_points_of
from photogram.files.solutions.parsing import (
    check_distinct,
    counted_rows,
    file_of,
    number_rows,
    text_of,
    whole_number,
    whole_numbers,
)
from photogram.files.solutions.picture_sizes import Sizes, size_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.wording import things

_HEAD = 4
"""Numbers of a tie point before its observations."""

_POSE = 12
_RADIAL3 = 6
_PINHOLE = 3


def read_meshroom_baf(path: Path, sizes_px: Sizes | None = None) -> ForeignSolution:
    """Return the solution of a .baf file.

    The photographs are those of <name>_imgList.txt beside it; where that is missing they are named by the numbers of
    their poses, in rising order. ``sizes_px`` are width and height by the names of photographs; those that it lacks are
    read from the photographs. Raises ExchangeError where the file is damaged, a camera has another number of
    parameters than a pinhole or radial3, photographs cannot be told apart, or a size is not known.
    """
    lines = [(n, line) for n, line in enumerate(text_of(path).split("\n"), 1) if line.strip()]
    if len(lines) < 3:
        raise ExchangeError(f"{path}: must begin with the counts of cameras, photographs and points: it is cut off")
    cameras, views, points = (
        whole_number(f"{path}:{line}", "a count of cameras, photographs or points", text.strip())
        for line, text in lines[:3]
    )
    if len(lines) != 3 + cameras + views + points:
        raise ExchangeError(
            f"{path}: has {len(lines)} lines, expected {3 + cameras + views + points} by its counts: it is cut off or "
            "damaged"
        )
    values, lengths = number_rows(path, lines[3 : 3 + cameras])
    if not np.isin(lengths, (_PINHOLE, _RADIAL3)).all():
        raise ExchangeError(
            f"{path}: a camera has {lengths.max()} parameters, a pinhole {_PINHOLE} and radial3 {_RADIAL3}: of what "
            "model they are cannot be told: save an .sfm of JSON, or with these models"
        )
    interior = np.split(values, np.cumsum(lengths)[:-1]) if cameras else []
    poses, lengths = number_rows(path, lines[3 + cameras : 3 + cameras + views])
    if (lengths != _POSE).any():
        raise ExchangeError(f"{path}: a photograph must have {_POSE} numbers of its pose: it is damaged")
    position, pixel, table, point = _points(path, lines[3 + cameras + views :])
    files, pose_ids, camera_ids = _photographs_listed(path, views, table)
    check_distinct(str(path), "pose", pose_ids)
    photograph = index_in(np.argsort(pose_ids), pose_ids, table[:, 1])
    if (photograph < 0).any():
        raise ExchangeError(f"{path}: an observation names a pose that no photograph has: it is damaged")
    kinds = np.unique(np.concatenate([camera_ids, table[:, 0]]))
    if len(kinds) != cameras:
        raise ExchangeError(
            f"{path}: has {things(cameras, 'camera')}, but its photographs name {len(kinds)}: give the list of the "
            "photographs that belongs to it"
        )
    camera_index = np.searchsorted(kinds, camera_ids)
    observed = np.bincount(photograph, minlength=views) > 0
    distinct, photographs = _oriented(
        path, interior, camera_index, poses.reshape(-1, _POSE), files, observed, sizes_px or {}
    )
    check_names(str(path), files)
    tie_points = tie_points_of(str(path), photograph, point, pixel, position)
    left_out = () if _list_of(path).exists() else ("The names of the photographs: there is no list of them beside it.",)
    return ForeignSolution("Meshroom", distinct, photographs, tie_points, left_out=left_out)


def _points(path: Path, lines: list[tuple[int, str]]) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Return positions (P, 3), pixels (N, 2), camera and pose (N, 2) of the observations, and their points (N,)."""
    values, counts = number_rows(path, lines)
    head, rows, point = counted_rows(str(path), "a point", values, counts, _HEAD, 4)
    ids = whole_numbers(str(path), "a number of a camera or pose", rows[:, :2].ravel()).reshape(-1, 2)
    return head[:, :3], rows[:, 2:], ids, point


def _list_of(path: Path) -> Path:
    return path.with_name(f"{path.stem}_imgList.txt")


def _photographs_listed(path: Path, views: int, table: IntArray) -> tuple[list[PurePosixPath], IntArray, IntArray]:
    """Return the file, the pose and the camera of every photograph."""
    list_path = _list_of(path)
    if not list_path.exists():
        pose_ids, first = np.unique(table[:, 1], return_index=True)
        if len(pose_ids) != views:
            raise ExchangeError(
                f"{path}: has {things(views, 'photograph')}, of which {len(pose_ids)} observe points, and no "
                f"{list_path.name} beside it that tells which: put it there"
            )
        return [PurePosixPath(str(number)) for number in pose_ids], pose_ids, table[first, 0]
    files, ids = [], []
    for n, line in enumerate(text_of(list_path).split("\n"), 1):
        words = line.rsplit(maxsplit=2)
        if not words:
            continue
        if len(words) != 3:
            raise ExchangeError(f"{list_path}:{n}: must have a file, a camera and a pose: it is damaged")
        files.append(file_of(f"{list_path}:{n}", words[0]))
        ids += [whole_number(f"{list_path}:{n}", "a number of a camera or pose", word) for word in words[1:]]
    if len(files) != views:
        raise ExchangeError(f"{list_path}: names {things(len(files), 'photograph')}, but {path.name} has {views}")
    pairs = np.array(ids, dtype=np.int64).reshape(-1, 2)
    return files, pairs[:, 1], pairs[:, 0]


def _oriented(
    path: Path,
    interior: list[FloatArray],
    camera_index: IntArray,
    poses: FloatArray,
    files: list[PurePosixPath],
    observed: np.ndarray,
    sizes_px: Sizes,
) -> tuple[tuple[Camera, ...], tuple[ForeignPhotograph, ...]]:
    """Return cameras and photographs; one without a pose has the unit matrix at the origin, and observes nothing."""
    sizes: dict[int, tuple[int, int]] = {}
    nowhere = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    photographs = []
    for i, (file, row) in enumerate(zip(files, poses, strict=True)):
        camera = int(camera_index[i])
        size = size_of(path, file, sizes_px)
        if sizes.setdefault(camera, size) != size:
            raise ExchangeError(f"{path}: {file.name} has another size than others of its camera: check the sizes")
        pose: Pose | None = None
        if observed[i] or not np.array_equal(row, nowhere):
            pose = pose_of(f"{path}: {file.name}", row[:9].reshape(3, 3), row[9:])
        photographs.append(ForeignPhotograph(file.name, camera, pose, file))
    if len(sizes) != len(interior):
        raise ExchangeError(f"{path}: a camera has no photograph, so that its size is not known: it is damaged")
    cameras = tuple(
        camera_of(str(path), str(i + 1), sizes[i], float(q[0]), (float(q[1]), float(q[2])), q[3:].tolist())
        for i, q in enumerate(interior)
    )
    return cameras, tuple(photographs)
