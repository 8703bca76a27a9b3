"""What readers of other programs' files have in common: bounded reading, checked numbers and names, sorted tie points.

Everything here raises ExchangeError with the place that it is given, such as a file and a line.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.files.exchange.solution import ForeignPhotograph, ForeignSolution
from photogram.files.reading import read_whole
from photogram.files.text_lines import LONGEST_NAME
from photogram.projection import Model
from photogram.survey import TRANSFERRED, TiePoints
from photogram.wording import printable, shortened

MOST_BYTES = 2_000_000_000
"""Of one file; that of 20 million observations is smaller."""

_EPSG_AT_END = re.compile(r'(?:AUTHORITY|ID)\["EPSG",\s*"?(\d+)"?\]\]\s*$')
_LARGEST_SIDE_PX = 1_000_000
_LARGEST_COEFFICIENT = 1e12
_ROTATION_TOLERANCE = 1e-5
HALF_PIXEL = 0.5
"""What the programs add whose top-left pixel has its centre at (0.5, 0.5)."""


def bytes_of(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Return the content of a file. Raises ExchangeError where it cannot be read or is larger."""
    try:
        return read_whole(path, most_bytes)
    except OSError as fault:
        raise ExchangeError(f"{path}: cannot be read ({fault.strerror}): check its name and folder") from fault


def text_of(path: Path, most_bytes: int = MOST_BYTES) -> str:
    """Return the text of a file in UTF-8. Raises ExchangeError where it is none."""
    data = bytes_of(path, most_bytes)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        raise ExchangeError(
            f"{path}:{line}: byte {data[fault.start]:#04x} is not UTF-8: save the file as text in UTF-8"
        ) from fault


def numbers_of(text: str, count: int, what: str, place: str) -> FloatArray:
    """Return the ``count`` finite numbers (count,) of a text, between blanks. Raises ExchangeError where it has
    others."""
    words = text.split(maxsplit=count)
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.zeros(0)
    if len(words) != count or len(values) != count or not np.isfinite(values).all():
        kind = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ExchangeError(
            f"{place}: {what} must be {kind}, found {printable(shortened(text.strip()))!r}: "
            "export the file again, or correct it"
        )
    return values


def number_of(text: str, what: str, place: str) -> float:
    """Return the finite number of a text. Raises ExchangeError where it is none."""
    return float(numbers_of(text, 1, what, place)[0])


def file_of(text: str, place: str) -> PurePosixPath:
    """Return a path of another machine, as its program names it; its last part is the photograph's name.

    Nothing is ever opened by it. Raises ExchangeError where its last part is no name of a file.
    """
    file = PurePosixPath(text.replace("\\", "/"))
    name = file.name
    if name in ("", ".", "..") or not name.isprintable() or len(name) > LONGEST_NAME or "\0" in text:
        raise ExchangeError(
            f"{place}: {printable(shortened(text))!r} is no name of a photograph: name the file in the other program"
        )
    return file


def part_of(folder: Path, text: str, place: str) -> Path:
    """Return the path of a file that another names, within ``folder``.

    Raises ExchangeError where the name leads out of the folder, or through a link.
    """
    parts = PurePosixPath(text.replace("\\", "/"))
    if not text or "\0" in text or parts.is_absolute() or ".." in parts.parts or ":" in text:
        raise ExchangeError(
            f"{place}: {printable(shortened(text))!r} leads out of the folder of the project: "
            "only files within it are read"
        )
    path = folder
    for part in parts.parts:
        path = path / part
        if path.is_symlink():
            raise ExchangeError(f"{path}: is a link in a project of another program: put the file in its place")
    return path


def pose_of(rotation: FloatArray, position: FloatArray, place: str) -> Pose:
    """Return the pose of a rotation (3, 3), world from camera, and a position (3,).

    Raises ExchangeError where the matrix is no rotation; small departures, those of rounded digits, stay as they are.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(rotation.T @ rotation - np.eye(3)).max()
        turned = np.linalg.det(rotation) > 0 if np.isfinite(error) else False
    if not error < _ROTATION_TOLERANCE or not turned or not np.isfinite(position).all():
        raise ExchangeError(
            f"{place}: is no rotation with a position (the columns depart by {error:.2g} from a right-handed "
            "orthonormal frame): export the file again"
        )
    return Pose(rotation, position)


def camera_of(
    place: str,
    name: str,
    size_px: tuple[float, float],
    focal_px: float,
    principal_point_px: Sequence[float],
    radial: Sequence[float] = (),
    tangential: Sequence[float] = (0.0, 0.0),
    affinity: Sequence[float] = (0.0, 0.0),
    model: Model = "brown",
) -> Camera:
    """Return a camera of numbers in photogram's terms; ``radial`` may have fewer than four coefficients.

    Raises ExchangeError where they are not those of a camera.
    """
    k = np.array([*radial, *[0.0] * (4 - len(radial))])
    sides = np.array(size_px, dtype=np.float64)
    values = np.array([focal_px, *principal_point_px, *k, *tangential, *affinity])
    if not np.isfinite(sides).all() or np.any(sides < 1) or np.any(sides > _LARGEST_SIDE_PX) or np.any(sides % 1):
        raise ExchangeError(f"{place}: a photograph of {size_px[0]:g} × {size_px[1]:g} px: correct width and height")
    if not 0 < focal_px < _LARGEST_COEFFICIENT:
        raise ExchangeError(
            f"{place}: the focal length is {focal_px:g} px: it must be positive, correct the calibration"
        )
    if not np.abs(values).max() <= _LARGEST_COEFFICIENT:
        raise ExchangeError(
            f"{place}: the calibration has the value {np.abs(values).max():g}, which no lens has: correct it"
        )
    return Camera(
        printable(name), int(sides[0]), int(sides[1]), focal_px, np.array(principal_point_px, dtype=np.float64), k,
        np.array(tangential, dtype=np.float64), affinity=np.array(affinity, dtype=np.float64), model=model,
    )  # fmt: skip


def crs_of(wkt: str) -> str | None:
    """Return a CRS by the EPSG code with which its WKT ends, else as WKT; None for local coordinates and for none."""
    text = " ".join(wkt.split())
    if not text or text.upper().startswith(("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS")):
        return None
    code = _EPSG_AT_END.search(text)
    return f"EPSG:{code[1]}" if code else printable(text)


def no_tie_points() -> TiePoints:
    """Return no tie points."""
    none = np.zeros(0, dtype=np.int64)
    return TiePoints(none, none, none, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))


def sorted_tie_points(
    photograph: NDArray[np.integer],
    point: NDArray[np.integer],
    pixel: FloatArray,
    position: FloatArray,
    *,
    feature: IntArray | None = None,
    sigma_px: float = 1.0,
    colour: ByteArray | None = None,
) -> TiePoints:
    """Return tie points of observations (N,) in any order; ``position`` (P, 3), black where no ``colour`` is given."""
    order = np.lexsort((photograph, point))
    number = np.full(len(point), TRANSFERRED) if feature is None else feature
    return TiePoints(
        photograph[order].astype(np.int64),
        point[order].astype(np.int64),
        number[order].astype(np.int64),
        np.ascontiguousarray(pixel[order]),
        np.full(len(point), sigma_px),
        position,
        np.zeros((len(position), 3), np.uint8) if colour is None else colour,
    )


def check_photographs(place: str, photographs: Sequence[ForeignPhotograph]) -> None:
    """Raise ExchangeError where two photographs have the same name, which photogram could not tell apart."""
    seen: dict[str, PurePosixPath] = {}
    for photograph in photographs:
        if photograph.name in seen:
            raise ExchangeError(
                f"{place}: two photographs are called {photograph.name} ({printable(str(seen[photograph.name]))} and "
                f"{printable(str(photograph.file))}): rename one of them"
            )
        seen[photograph.name] = photograph.file


def check_writable(path: Path, solution: ForeignSolution) -> None:
    """Raise ExchangeError where a solution holds what no file can: values that are not finite, names that are none."""
    for photograph in solution.photographs:
        if "/" in photograph.name or "\\" in photograph.name or not photograph.name.isprintable():
            raise ExchangeError(f"{path}: photograph {printable(photograph.name)!r} has a name that is no file's")
        pose = photograph.pose
        if pose is not None and not (
            np.isfinite(pose.rotation_world_from_camera).all() and np.isfinite(pose.position_world_m).all()
        ):
            raise ExchangeError(f"{path}: photograph {photograph.name} has a pose that is not finite: leave it out")
    for camera in solution.cameras:
        if not np.isfinite(camera.parameters).all():
            raise ExchangeError(f"{path}: camera {camera.name} has parameters that are not finite: leave it out")


def rotation_from_omega_phi_kappa(angles_deg: Sequence[float] | FloatArray) -> FloatArray:
    """Return the rotation (3, 3), world from camera, of photogrammetric angles in degrees.

    R = Rx(ω) Ry(φ) Rz(κ) diag(1, −1, −1): the photogrammetric image frame has x right, y up, z backward (Kraus 2007,
    sec. 2.1).
    """
    (so, sp, sk), (co, cp, ck) = np.sin(np.radians(angles_deg)), np.cos(np.radians(angles_deg))
    Rx = np.array([[1.0, 0.0, 0.0], [0.0, co, -so], [0.0, so, co]])
    Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    Rz = np.array([[ck, -sk, 0.0], [sk, ck, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(Rx @ Ry @ Rz @ np.diag([1.0, -1.0, -1.0]))


def exact_omega_phi_kappa_deg(rotation: FloatArray) -> FloatArray:
    """Return the angles (3,) in degrees of which ``rotation_from_omega_phi_kappa`` is the rotation, to all digits for
    level views too, where the arcsine would lose half of them; ω is 0 where φ is ±90°."""
    R = rotation @ np.diag([1.0, -1.0, -1.0])
    level = np.hypot(R[0, 0], R[0, 1])
    phi = np.arctan2(R[0, 2], level)
    if level < 1e-9:
        return np.degrees([0.0, phi, np.arctan2(R[1, 0], R[1, 1])])
    return np.degrees([np.arctan2(-R[1, 2], R[2, 2]), phi, np.arctan2(-R[0, 1], R[0, 0])])
