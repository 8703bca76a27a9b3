"""Values of other programs' files as cameras, poses and tie points.

Values that make none become an ExchangeError that begins with ``where``, the place that the reader names.
"""

from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.files.solutions.parsing import check_finite
from photogram.files.solutions.solution import ForeignPhotograph
from photogram.measures.mark_covariances import isotropic_px2
from photogram.projection import Model
from photogram.survey import TRANSFERRED, ControlPoints, Role, TiePoints
from photogram.wording import printable

HALF_PIXEL = 0.5
"""What the pixels of programs have more whose top-left pixel has its centre at (0.5, 0.5)."""

_LARGEST_SIDE_PX = 1_000_000
_LARGEST_COEFFICIENT = 1e12
_EXACT, _CROOKED = 1e-14, 1e-3
"""What of RᵀR − I is the rounding of doubles, and what is more than rounding to four digits."""


def camera_of(
    where: str,
    name: str,
    size_px: tuple[float, float],
    focal_px: float,
    principal_point_px: Sequence[float],
    radial: Sequence[float] = (),
    tangential: Sequence[float] = (0.0, 0.0),
    affinity: Sequence[float] = (0.0, 0.0),
    model: Model = "brown",
) -> Camera:
    """Return a camera; coefficients of ``radial`` that are not given are zero. Raises ExchangeError where its size, its
    focal length or another number is none that a camera can have."""
    name = printable(name)
    where = f"{where}: camera {name}"
    width, height = size_px
    if not all(1 <= side <= _LARGEST_SIDE_PX and side == int(side) for side in size_px):
        raise ExchangeError(f"{where}: {width:g} × {height:g} px are no size of a photograph: correct it")
    k = np.zeros(4)
    k[: len(radial)] = radial
    values = np.array([focal_px, *principal_point_px, *k, *tangential, *affinity], dtype=np.float64)
    check_finite(where, "calibration", values)
    if not focal_px > 0:
        raise ExchangeError(
            f"{where}: the focal length must be positive, found {focal_px:g} px: correct the calibration"
        )
    largest = float(np.abs(values).max())
    if largest > _LARGEST_COEFFICIENT:
        raise ExchangeError(f"{where}: the calibration has the value {largest:g}, which no lens has: correct it")
    return Camera(
        name,
        int(width),
        int(height),
        float(focal_px),
        np.array(principal_point_px, dtype=np.float64),
        k,
        np.array(tangential, dtype=np.float64),
        affinity=np.array(affinity, dtype=np.float64),
        model=model,
    )


def pose_of(where: str, rotation_world_from_camera: FloatArray, position: FloatArray) -> Pose:
    """Return a pose; a rotation (3, 3) that was written with few digits becomes the nearest orthogonal matrix, one with
    all its digits stays as it is. Raises ExchangeError where it is no rotation, or a number is not finite."""
    R = np.asarray(rotation_world_from_camera, dtype=np.float64)
    check_finite(where, "rotation", R)
    check_finite(where, "position", position)
    with np.errstate(over="ignore", invalid="ignore"):
        departure = np.abs(R.T @ R - np.eye(3)).max()
    if not departure < _CROOKED or np.linalg.det(R) < 0:
        raise ExchangeError(f"{where}: the rotation is none: its matrix is not orthogonal: export the solution again")
    if departure > _EXACT:
        U, _, Vt = np.linalg.svd(R)
        R = np.ascontiguousarray(U @ Vt)
    return Pose(R, np.array(position, dtype=np.float64))


def rotation_of_quaternion(where: str, quaternion: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) of a unit quaternion (4,), w first. Raises ExchangeError where it is not of unit
    length."""
    check_finite(where, "quaternion", quaternion)
    length = float(np.linalg.norm(np.clip(quaternion, -2.0, 2.0)))  # so that no damaged number overflows
    if not abs(length - 1.0) < _CROOKED:
        raise ExchangeError(f"{where}: the quaternion has a length other than 1: export the solution again")
    w, x, y, z = quaternion / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def sentences(*rows: tuple[object, str]) -> list[str]:
    """Return of pairs of a count or condition and a sentence the sentences of what is not 0, empty, None or false."""
    return [sentence for is_there, sentence in rows if is_there]


def check_names(where: str, files: Iterable[PurePosixPath]) -> None:
    """Raise ExchangeError where two photographs have the same file name, in whatever folders."""
    first: dict[str, PurePosixPath] = {}
    for file in files:
        if file.name in first:
            raise ExchangeError(
                f"{where}: {first[file.name]} and {file} have the same file name: give every photograph a name of its "
                "own, whatever its folder"
            )
        first[file.name] = file


def sizes_of(cameras: Sequence[Camera], photographs: Sequence[ForeignPhotograph]) -> IntArray:
    """Return width and height of photographs (F, 2), px."""
    sizes = np.array([(camera.width_px, camera.height_px) for camera in cameras], dtype=np.int64).reshape(-1, 2)
    index = np.array([photograph.camera for photograph in photographs], dtype=np.int64)
    return np.asarray(sizes[index], dtype=np.int64)


def no_tie_points() -> TiePoints:
    """Return no tie points."""
    none = np.zeros(0, dtype=np.int64)
    return TiePoints(none, none, none, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))


def tie_points_of(
    where: str,
    photograph: NDArray[np.integer],
    point: NDArray[np.integer],
    pixel: FloatArray,
    position: FloatArray,
    *,
    feature: NDArray[np.integer] | None = None,
    colour: ByteArray | None = None,
    sigma_px: float = 1.0,
) -> TiePoints:
    """Return tie points with their observations sorted by point, then photograph.

    Observations (N,) in any order, with pixels (N, 2) and the numbers of their key points, TRANSFERRED where the format
    has none; points (P, 3) with their colours (P, 3), black where the format has none. ``sigma_px`` is that of every
    observation: 1 where the program states none. Raises ExchangeError where a number is not finite.
    """
    check_finite(where, "position of a tie point", position)
    check_finite(where, "observation of a tie point", pixel)
    order = np.lexsort((photograph, point))
    number = np.full(len(order), TRANSFERRED) if feature is None else feature
    return TiePoints(
        np.ascontiguousarray(photograph[order], dtype=np.int64),
        np.ascontiguousarray(point[order], dtype=np.int64),
        np.ascontiguousarray(number[order], dtype=np.int64),
        np.ascontiguousarray(pixel[order], dtype=np.float64).reshape(-1, 2),
        np.full(len(order), sigma_px),
        np.ascontiguousarray(position, dtype=np.float64).reshape(-1, 3),
        np.zeros((len(position), 3), np.uint8)
        if colour is None
        else np.ascontiguousarray(colour, dtype=np.uint8).reshape(-1, 3),
    )


def ground_points_of(
    names: Sequence[str],
    roles: Sequence[Role],
    positions: Sequence[FloatArray],
    sigmas: Sequence[Sequence[float] | FloatArray],
    marks: Sequence[tuple[float, ...]],
) -> ControlPoints:
    """Return ground points (G) with their marks: photograph, point, u, v and the standard deviation of both, px."""
    M = np.array(marks, dtype=np.float64).reshape(-1, 5)
    return ControlPoints(
        tuple(names),
        tuple(roles),
        np.array(positions, dtype=np.float64).reshape(-1, 3),
        np.array(sigmas, dtype=np.float64).reshape(-1, 3),
        M[:, 0].astype(np.int64),
        M[:, 1].astype(np.int64),
        M[:, 2:4],
        isotropic_px2(M[:, 4]),
    )


def index_in(sorted_by: IntArray, ids: IntArray, wanted: IntArray) -> IntArray:
    """Return where ``wanted`` (N,) stand in ``ids`` (M,), −1 for what is not among them; ``sorted_by`` sorts ids."""
    if not len(ids):
        return np.full(len(wanted), -1, dtype=np.int64)
    place = np.minimum(np.searchsorted(ids, wanted, sorter=sorted_by), len(ids) - 1)
    index = sorted_by[place]
    return np.where(ids[index] == wanted, index, -1).astype(np.int64)
