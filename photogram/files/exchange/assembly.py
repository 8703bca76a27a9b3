"""What all readers of foreign solutions share: files read whole, names, numbers and rotations checked, tie points
sorted.

Whatever is wrong with a file becomes an ExchangeError here, with the place that the reader names in ``where``.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.files.exchange.solution import ForeignPhotograph, ForeignSolution
from photogram.files.reading import read_whole
from photogram.projection import Model
from photogram.survey import TiePoints
from photogram.wording import printable, shortened

MOST_BYTES = 8_000_000_000
"""Of one file of a solution."""

LARGEST_SIDE_PX = 1_000_000
LARGEST_WHOLE = 2**53
"""Above it, a double no longer holds every whole number."""

_LONGEST_NAME = 255
_LONGEST_PATH = 4096
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")
_CROOKED = 1e-3
"""What of RᵀR − I is more than rounding to four digits."""


def bytes_of(path: Path) -> bytes:
    """Return the content of a file. Raises ExchangeError where it cannot be read or is far too large."""
    try:
        return read_whole(path, MOST_BYTES)
    except OSError as fault:
        raise ExchangeError(f"{path}: cannot be read ({fault.strerror}): check its name and folder") from fault


def text_of(path: Path) -> str:
    """Return the text of a file. Raises ExchangeError where it cannot be read, or is not UTF-8."""
    data = bytes_of(path)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        raise ExchangeError(
            f"{path}:{line}: byte {data[fault.start]:#04x} is not UTF-8: save the file as text in UTF-8"
        ) from fault


def file_of(where: str, text: str) -> PurePosixPath:
    """Return the path by which a program names a photograph; backslashes become slashes. Raises ExchangeError where it
    names none, is too long, or holds ``..`` or a character that cannot be printed."""
    file = PurePosixPath(text.replace("\\", "/"))
    shown = repr(shortened(printable(text)))
    if not file.name or ".." in file.parts:
        raise ExchangeError(f"{where}: {shown} is no name of a photograph: name its file, without '..'")
    if len(file.name.encode("utf-8", "surrogatepass")) > _LONGEST_NAME or len(text) > _LONGEST_PATH:
        raise ExchangeError(f"{where}: the name {shown} is longer than that of any file: check the file")
    if _CONTROL.search(text) or any("\ud800" <= c <= "\udfff" for c in text):
        raise ExchangeError(f"{where}: the name {shown} holds a character that cannot be printed: rename the file")
    return file


def check_names(where: str, photographs: Sequence[ForeignPhotograph]) -> None:
    """Raise ExchangeError where two photographs have the same file name, in whatever folders."""
    first: dict[str, PurePosixPath] = {}
    for photograph in photographs:
        if photograph.name in first:
            raise ExchangeError(
                f"{where}: {first[photograph.name]} and {photograph.file} have the same file name: give every "
                "photograph a name of its own, whatever its folder"
            )
        first[photograph.name] = photograph.file


def numbers(where: str, texts: Iterable[str]) -> FloatArray:
    """Return numbers (N,) as they are written; any may be infinite or NaN."""
    texts = list(texts)
    try:
        values = np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
    except ValueError as fault:
        wrong = next((text for text in texts if not _is_number(text)), "")
        raise ExchangeError(f"{where}: {shortened(printable(wrong))!r} is not a number: check the file") from fault
    return values


def number_rows(path: Path, lines: Iterable[tuple[int, str]]) -> tuple[FloatArray, IntArray]:
    """Return the numbers (N,) of numbered lines that hold nothing else, and how many each line has."""
    flat, counts, before = array("d"), array("q"), 0
    for line, text in lines:
        try:
            flat.extend(map(float, text.split()))
        except ValueError:
            numbers(f"{path}:{line}", text.split())
        counts.append(len(flat) - before)
        before = len(flat)
    return np.frombuffer(flat, dtype=np.float64), np.frombuffer(counts, dtype=np.int64)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def check_finite(where: str, what: str, values: FloatArray) -> None:
    """Raise ExchangeError where a number is infinite or NaN."""
    if not np.isfinite(values).all():
        wrong = values[~np.isfinite(values)].ravel()[0]
        raise ExchangeError(f"{where}: {what}: found {wrong}, which is no number: export the solution again")


def whole_numbers(where: str, what: str, values: FloatArray, low: int = 0, high: int = LARGEST_WHOLE) -> IntArray:
    """Return values (N,) as whole numbers. Raises ExchangeError unless they are that, and from low to high."""
    good: BoolArray = np.asarray((values >= low) & (values <= high) & (values == np.floor(values)))
    if not good.all():
        wrong = np.asarray(values)[~good].ravel()[0]
        raise ExchangeError(
            f"{where}: {what} must be a whole number from {low} to {high}, found {wrong:.17g}: export the solution "
            "again"
        )
    return np.asarray(values, dtype=np.int64)


def whole_number(where: str, what: str, text: str, low: int = 0, high: int = LARGEST_WHOLE) -> int:
    """Return the whole number that a text holds, as ``whole_numbers``."""
    return int(whole_numbers(where, what, numbers(where, [text]), low, high)[0])


def camera_of(
    where: str,
    name: str,
    size_px: tuple[int, int],
    focal_px: float,
    principal_point_px: Sequence[float],
    radial: Sequence[float] = (),
    tangential: Sequence[float] = (0.0, 0.0),
    affinity: Sequence[float] = (0.0, 0.0),
    model: Model = "brown",
) -> Camera:
    """Return a camera; coefficients of ``radial`` that are not given are zero. Raises ExchangeError where its size, its
    focal length or another number is none that a camera can have."""
    if not all(1 <= side <= LARGEST_SIDE_PX for side in size_px):
        raise ExchangeError(f"{where}: camera {name}: {size_px[0]} × {size_px[1]} px are no size of a photograph")
    values = np.array([focal_px, *principal_point_px, *radial, *tangential, *affinity], dtype=np.float64)
    check_finite(where, f"camera {name}", values)
    if not focal_px > 0:
        raise ExchangeError(f"{where}: camera {name}: the focal length must be positive, found {focal_px:g}")
    k = np.zeros(4)
    k[: len(radial)] = radial
    return Camera(
        name,
        size_px[0],
        size_px[1],
        float(focal_px),
        np.array(principal_point_px, dtype=np.float64),
        k,
        np.array(tangential, dtype=np.float64),
        affinity=np.array(affinity, dtype=np.float64),
        model=model,
    )


def pose_of(where: str, rotation_world_from_camera: FloatArray, position: FloatArray) -> Pose:
    """Return a pose; the rotation (3, 3) becomes the nearest orthogonal matrix, which undoes the rounding of what was
    written with few digits. Raises ExchangeError where it is no rotation, or a number is not finite."""
    R = np.asarray(rotation_world_from_camera, dtype=np.float64)
    check_finite(where, "rotation", R)
    check_finite(where, "position", position)
    if not np.abs(R.T @ R - np.eye(3)).max() < _CROOKED or np.linalg.det(R) < 0:
        raise ExchangeError(f"{where}: the rotation is none: its matrix is not orthogonal: export the solution again")
    U, _, Vt = np.linalg.svd(R)
    return Pose(np.ascontiguousarray(U @ Vt), np.array(position, dtype=np.float64))


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


def tie_points_of(
    where: str,
    photograph: IntArray,
    point: IntArray,
    feature: IntArray,
    pixel: FloatArray,
    position: FloatArray,
    colour: ByteArray,
    sigma_px: float = 1.0,
) -> TiePoints:
    """Return tie points with their observations sorted by point, then photograph.

    Observations (N,) with their pixels (N, 2); points (P, 3) with their colours (P, 3). ``sigma_px`` is that of every
    observation: 1 where the program states none. Raises ExchangeError where a number is not finite.
    """
    check_finite(where, "position of a tie point", position)
    check_finite(where, "observation of a tie point", pixel)
    order = np.lexsort((photograph, point))
    return TiePoints(
        np.ascontiguousarray(photograph[order], dtype=np.int64),
        np.ascontiguousarray(point[order], dtype=np.int64),
        np.ascontiguousarray(feature[order], dtype=np.int64),
        np.ascontiguousarray(pixel[order], dtype=np.float64).reshape(-1, 2),
        np.full(len(order), sigma_px),
        np.ascontiguousarray(position, dtype=np.float64).reshape(-1, 3),
        np.ascontiguousarray(colour, dtype=np.uint8).reshape(-1, 3),
    )


def index_in(sorted_by: IntArray, ids: IntArray, wanted: IntArray) -> IntArray:
    """Return where ``wanted`` (N,) stand in ``ids`` (M,), −1 for what is not among them; ``sorted_by`` sorts ids."""
    if not len(ids):
        return np.full(len(wanted), -1, dtype=np.int64)
    place = np.minimum(np.searchsorted(ids, wanted, sorter=sorted_by), len(ids) - 1)
    index = sorted_by[place]
    return np.where(ids[index] == wanted, index, -1).astype(np.int64)


def check_distinct(where: str, what: str, ids: NDArray[np.generic]) -> None:
    """Raise ExchangeError where a number comes twice."""
    values, count = np.unique(ids, return_counts=True)
    if (count > 1).any():
        raise ExchangeError(f"{where}: {what} {values[count > 1][0]} comes twice: export the solution again")


def path_to_write(photograph: ForeignPhotograph) -> str:
    """Return the path that another program shall find a photograph by: the one it was read with where that is relative
    to a folder, else its name."""
    return photograph.name if _is_absolute(photograph.file) else str(photograph.file)


def _is_absolute(file: PurePosixPath) -> bool:
    return file.is_absolute() or re.match(r"[A-Za-z]:", file.parts[0]) is not None


def without_place(solution: ForeignSolution) -> list[str]:
    """Return sentences on what a format cannot hold that knows neither ground, nor measured positions, nor a frame."""
    said = []
    if solution.frame != "local":
        said.append(f"What the coordinates are: {solution.frame}.")
    if solution.ground_points is not None:
        said.append("Ground points and their marks.")
    if any(photograph.measured is not None for photograph in solution.photographs):
        said.append("Measured positions of photographs.")
    return said
