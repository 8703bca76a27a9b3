"""Models of VisualSFM, .nvm files of version 3 (Wu 2013, the page VisualSFM: Documentation, section Output Format).

Cameras look along +z with y down, as photogram's; a model holds the rotation camera from world as a quaternion and the
projection centre. A measurement m is relative to the principal point, the centre of the picture, or counted from the
outer corner of its top-left pixel: whichever leaves more of them within the pictures. The radial distortion has the
inverse direction,

    q = m/f,   (X/Z, Y/Z) = q (1 + r |q|²),

so k1 to k4 of photogram's direction are fitted over the picture, and how far they differ is said. No file holds the
size of a picture: it is given, or read from the photographs.
"""

from pathlib import Path, PurePosixPath

import numpy as np
from numpy.polynomial import polynomial

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import camera_of, check_names, pose_of, rotation_of_quaternion, tie_points_of
from photogram.files.solutions.parsing import (
    check_finite,
    counted_rows,
    file_of,
    number_rows,
    numbers,
    text_of,
    whole_number,
    whole_numbers,
)
from photogram.files.solutions.picture_sizes import Sizes, centre_px, size_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.survey import TiePoints
from photogram.wording import things

_HEAD = 7
"""Numbers of a point before its measurements: X Y Z, a colour, a count."""

_SAMPLES = 400
"""Radii at which the fitted distortion is compared."""

_EXACT_PX = 1e-6


def read_visualsfm(path: Path, sizes_px: Sizes | None = None) -> ForeignSolution:
    """Return the largest model of an .nvm file.

    ``sizes_px`` are width and height by the names of photographs; those that it lacks are read from the photographs,
    where they lie as the file names them. Raises ExchangeError where the file is damaged or of another version, its
    cameras have a calibration that was fixed for all, or a size is not known.
    """
    lines = [(n, line.strip()) for n, line in enumerate(text_of(path).split("\n"), 1)]
    lines = [(n, line) for n, line in lines if line and not line.startswith("#")]
    words = lines[0][1].split() if lines else []
    if not words or words[0] not in ("NVM_V3", "NVM_V3_R9T"):
        raise ExchangeError(f"{path}:1: does not begin with NVM_V3: name an .nvm file of VisualSFM")
    if len(words) > 1 or words[0] != "NVM_V3":
        raise ExchangeError(
            f"{path}:1: {' '.join(words)[:60]!r} is a form that photogram does not read: let VisualSFM estimate the "
            "calibration, and save as NVM_V3"
        )
    models, place = [], 1
    while place < len(lines):
        cameras, place = _block(path, lines, place)
        if not cameras:
            break
        points, place = _block(path, lines, place)
        models.append((cameras, points))
    if not models:
        raise ExchangeError(f"{path}: holds no model: save it again in VisualSFM")
    cameras, points = max(models, key=lambda model: len(model[0]))
    return _solution(path, cameras, points, sizes_px or {}, len(models) - 1)


def _block(path: Path, lines: list[tuple[int, str]], place: int) -> tuple[list[tuple[int, str]], int]:
    """Return the lines of cameras or points that a count announces, and where the next begins."""
    if place >= len(lines):
        raise ExchangeError(f"{path}: ends where a count of points must stand: it is cut off")
    line, text = lines[place]
    count = whole_number(f"{path}:{line}", "a count of cameras or points", text)
    left = len(lines) - place - 1
    if count > left:
        raise ExchangeError(f"{path}:{line}: announces {count} lines more and has {left}: it is cut off or damaged")
    return lines[place + 1 : place + 1 + count], place + 1 + count


def _solution(
    path: Path, camera_lines: list[tuple[int, str]], point_lines: list[tuple[int, str]], sizes_px: Sizes, others: int
) -> ForeignSolution:
    files, rows = _camera_rows(path, camera_lines)
    sizes = [size_of(path, file, sizes_px) for file in files]
    cameras, photographs, worst_px = _photographs(path, files, rows, sizes)
    check_names(str(path), files)
    tie_points, from_corner = _tie_points(path, point_lines, np.array(sizes, dtype=np.int64))
    left_out = []
    if worst_px > _EXACT_PX:
        left_out.append(
            f"The radial distortion, which has the inverse direction: k1 to k4 differ by at most {worst_px:.2g} px."
        )
    if others:
        left_out.append(f"{things(others, 'smaller model')} of the file.")
    if not from_corner:
        left_out.append(
            "The principal points, from which measurements count: the centres of the pictures stand in their place."
        )
    return ForeignSolution("VisualSFM", cameras, photographs, tie_points, left_out=tuple(left_out))


def _camera_rows(path: Path, lines: list[tuple[int, str]]) -> tuple[list[PurePosixPath], FloatArray]:
    """Return files, and f, quaternion, centre and r (F, 9); VisualSFM writes a quotation mark for a space."""
    files, rows = [], []
    for line, text in lines:
        where, parts = f"{path}:{line}", text.rsplit(maxsplit=10)
        if len(parts) != 11:
            raise ExchangeError(f"{where}: a camera must have a name and ten numbers: the file is cut off or damaged")
        row = numbers(where, parts[1:])
        check_finite(where, "a camera", row)
        files.append(file_of(where, parts[0].replace('"', " ")))
        rows.append(row[:9])
    return files, np.array(rows).reshape(-1, 9)


def _photographs(
    path: Path, files: list[PurePosixPath], rows: FloatArray, sizes: list[tuple[int, int]]
) -> tuple[tuple[Camera, ...], tuple[ForeignPhotograph, ...], float]:
    """Return the cameras, one for each calibration, the photographs, and how far the fitted distortions differ, px."""
    cameras: list[Camera] = []
    number: dict[tuple[float, ...], int] = {}
    photographs, worst_px = [], 0.0
    for i, (file, row, size) in enumerate(zip(files, rows, sizes, strict=True)):
        where = f"{path}: camera {i}"
        key = (float(row[0]), float(row[8]), *size)
        if key not in number:
            plain = camera_of(where, str(len(cameras) + 1), size, float(row[0]), centre_px(size))
            radial, differ_px = forward_radial(where, float(row[8]), float(np.hypot(*size)) / 2 / plain.focal_px)
            worst_px = max(worst_px, differ_px * plain.focal_px)
            number[key] = len(cameras)
            cameras.append(camera_of(where, plain.name, size, plain.focal_px, centre_px(size), radial.tolist()))
        R = rotation_of_quaternion(where, row[1:5]).T
        photographs.append(ForeignPhotograph(file.name, number[key], pose_of(where, R, row[5:8]), file))
    return tuple(cameras), tuple(photographs), worst_px


def forward_radial(where: str, r: float, radius: float) -> tuple[FloatArray, float]:
    """Return k1 to k4 (4,) that undo x_u = x_d (1 + r x_d²) up to the distorted radius ``radius``, and the largest
    difference of the distorted radius, both at unit focal length.

    Least squares at Chebyshev's nodes, which keep the largest difference near its minimum (Trefethen 2013, ch. 16).
    Raises ExchangeError where the distortion folds back within the picture.
    """
    if r == 0.0:
        return np.zeros(4), 0.0
    if not 1.0 + 3.0 * r * radius**2 > 0.1:
        raise ExchangeError(f"{where}: its radial distortion {r:g} folds back within the picture: check the model")
    nodes = radius * np.sin(np.pi / 2 * (np.arange(_SAMPLES) + 0.5) / _SAMPLES)
    distorted, ideal = nodes, nodes * (1.0 + r * nodes**2)
    # scaled to the unit interval, where the powers stay far enough apart
    largest = radius * (1.0 + r * radius**2)
    powers = (ideal / largest)[:, None] ** np.array([3, 5, 7, 9])
    scaled = np.linalg.lstsq(powers, distorted - ideal, rcond=None)[0]
    radial = scaled / largest ** np.array([3.0, 5.0, 7.0, 9.0])
    squares = ideal**2
    differ = ideal * (1.0 + squares * polynomial.polyval(squares, radial)) - distorted
    return radial, float(np.abs(differ).max())


def _from_corner(path: Path, measured: FloatArray, sizes: IntArray) -> bool:
    """Return whether measurements (N, 2) in pictures of these sizes (N, 2) count from the corner: whether more of them
    then lie in the picture than if they counted from its centre."""
    corner = int(((measured >= 0) & (measured <= sizes)).all(axis=1).sum())
    centre = int((np.abs(measured) <= sizes / 2).all(axis=1).sum())
    if corner == centre and len(measured):
        raise ExchangeError(
            f"{path}: its measurements do not show whether they count from the corner or the centre of the pictures: "
            "check the sizes of the photographs, or save the model again in VisualSFM"
        )
    return corner > centre


def _tie_points(path: Path, lines: list[tuple[int, str]], sizes: IntArray) -> tuple[TiePoints, bool]:
    """Return the tie points, and whether measurements count from the corner of the picture."""
    where = str(path)
    values, counts = number_rows(path, lines)
    head, table, point = counted_rows(where, "a point", values, counts, _HEAD, 4)
    photograph = whole_numbers(where, "the camera of a measurement", table[:, 0], 0, len(sizes) - 1)
    check_finite(where, "a measurement", table[:, 2:])
    from_corner = _from_corner(path, table[:, 2:], sizes[photograph])
    shift = np.full((len(table), 2), -0.5) if from_corner else (sizes[photograph] - 1) / 2
    tie_points = tie_points_of(
        where,
        photograph,
        point,
        table[:, 2:] + shift,
        head[:, :3],
        feature=whole_numbers(where, "the key point of a measurement", table[:, 1]),
        colour=whole_numbers(where, "a colour", head[:, 3:6].ravel(), 0, 255).astype(np.uint8),
    )
    return tie_points, from_corner
