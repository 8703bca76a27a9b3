"""Bundler's bundle.out with its list.txt, read and written (Snavely 2008, Bundler v0.4 User's Manual).

Bundler's cameras look along −z with y up, and its image coordinates are from the centre of the picture, x to the right
and y up: with D = diag(1, −1, −1), p = R X + t and q = −(p_x, p_y)/p_z,

    (x, y) = f (1 + k1 |q|² + k2 |q|⁴) q,    u = x + (w − 1)/2,  v = (h − 1)/2 − y,    R_cv = D R,  t_cv = D t

The distortion is photogram's own, in the same direction. Key points of Bundler have the centre of the top-left pixel at
(0, 0) and are moved by half of w − 1 and h − 1. Neither file holds the size w × h of a picture: it is given, or read
from the photographs.
"""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import camera_of, check_names, pose_of, sizes_of, tie_points_of
from photogram.exchange.formats.writing import check_writable, oriented_tie_points, path_to_write, without_place
from photogram.files.atomic import write_whole
from photogram.files.solutions.parsing import check_finite, counted_rows, file_of, number_rows, text_of, whole_numbers
from photogram.files.solutions.picture_sizes import Sizes, centre_px, size_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.survey import TiePoints
from photogram.wording import things

_HEADER = "# Bundle file v0.3"
_D = np.diag([1.0, -1.0, -1.0])
_CAMERA_LINES = (3, 3, 3, 3, 3)
"""Numbers on the lines of a camera: f k1 k2, three rows of R, t."""

_CENTRED = 1e-9
"""How far, px, a principal point may lie from the centre of the picture and count as there."""


def read_bundler(path: Path, list_path: Path | None = None, sizes_px: Sizes | None = None) -> ForeignSolution:
    """Return the solution of a bundle.out, with the photographs that list.txt names.

    ``list_path`` is that list, list.txt beside the file or in the folder above if not given. ``sizes_px`` are the sizes
    of photographs; those that it lacks are read from the photographs, where they lie as the list says. Photographs
    that Bundler did not orient have a focal length of 0 there, and no pose here; they share the camera of the first of
    their size. Raises ExchangeError where a file is damaged, the two do not fit together, or a size is not known.
    """
    lines = _lines(path)
    list_path = list_path or _list_file(path)
    files = _listed(list_path)
    counts, _ = number_rows(path, lines[:1])
    if len(counts) != 2:
        raise ExchangeError(f"{path}: its first line must hold the counts of cameras and points: it is damaged")
    cameras, points = whole_numbers(str(path), "a count of cameras or points", counts).tolist()
    if cameras != len(files):
        raise ExchangeError(
            f"{path}: has {things(cameras, 'camera')}, but {list_path} names {things(len(files), 'photograph')}: give "
            "the list that Bundler was run with"
        )
    body = 1 + len(_CAMERA_LINES) * cameras
    if len(lines) != body + 3 * points:
        raise ExchangeError(
            f"{path}: has {len(lines)} lines for {things(cameras, 'camera')} and {things(points, 'point')}, expected "
            f"{body + 3 * points}: it is cut off or damaged"
        )
    values, lengths = number_rows(path, lines[1:body])
    if cameras and (lengths.reshape(-1, 5) != _CAMERA_LINES).any():
        raise ExchangeError(f"{path}: the lines of a camera must hold three numbers each: it is damaged")
    sizes = [size_of(list_path, file, sizes_px or {}) for file in files]
    distinct, photographs = _photographs(path, values.reshape(-1, 15), files, sizes)
    check_names(str(list_path), files)
    tie_points = _tie_points(path, lines[body:], np.array(sizes, dtype=np.int64).reshape(-1, 2))
    return ForeignSolution("Bundler", distinct, photographs, tie_points)


def _lines(path: Path) -> list[tuple[int, str]]:
    lines = [(n, line) for n, line in enumerate(text_of(path).split("\n"), 1)]
    if not lines[0][1].startswith("# Bundle file"):
        raise ExchangeError(f"{path}:1: does not begin with {_HEADER!r}: name a bundle.out of Bundler")
    if lines[0][1].split()[-1] != "v0.3":
        raise ExchangeError(f"{path}:1: is of another version than v0.3: run Bundler 0.3 or later")
    kept = [(n, line) for n, line in lines[1:] if line.strip()]
    if not kept:
        raise ExchangeError(f"{path}: holds nothing after its first line: it is cut off")
    return kept


def _list_file(path: Path) -> Path:
    for folder in (path.parent, path.parent.parent):
        if (folder / "list.txt").exists():
            return folder / "list.txt"
    raise ExchangeError(f"{path}: there is no list.txt beside it or above: name the list of its photographs")


def _listed(path: Path) -> list[PurePosixPath]:
    """Return the photographs of a list; what follows a name, a zero and a focal length, is passed over."""
    files = []
    for n, line in enumerate(text_of(path).split("\n"), 1):
        words = line.strip().rsplit(maxsplit=2)
        if not words:
            continue
        name = words[0] if len(words) == 3 and words[1] == "0" else line.strip()
        files.append(file_of(f"{path}:{n}", name))
    return files


def _photographs(
    path: Path, rows: FloatArray, files: list[PurePosixPath], sizes: list[tuple[int, int]]
) -> tuple[tuple[Camera, ...], tuple[ForeignPhotograph, ...]]:
    """Return the cameras, one for each calibration, and the photographs; ``rows`` (F, 15) hold f k1 k2 R t."""
    check_finite(str(path), "a camera", rows)
    cameras: list[Camera] = []
    number: dict[tuple[float, ...], int] = {}
    of_size: dict[tuple[int, int], int] = {}
    for row, size in zip(rows, sizes, strict=True):
        key = (*row[:3].tolist(), *size)
        if row[0] != 0 and key not in number:
            where, name = str(path), str(len(cameras) + 1)
            cameras.append(camera_of(where, name, size, float(row[0]), centre_px(size), row[1:3].tolist()))
            number[key] = len(cameras) - 1
            of_size.setdefault(size, number[key])
    photographs = []
    for i, (row, file, size) in enumerate(zip(rows, files, sizes, strict=True)):
        where = f"{path}: camera {i}"
        if row[0] == 0:
            if size not in of_size:
                raise ExchangeError(f"{where}: no photograph of the size of {file.name} is oriented: leave it out")
            photographs.append(ForeignPhotograph(file.name, of_size[size], None, file))
            continue
        R = _D @ row[3:12].reshape(3, 3)
        pose = pose_of(where, R.T, -R.T @ (_D @ row[12:]))
        photographs.append(ForeignPhotograph(file.name, number[(*row[:3].tolist(), *size)], pose, file))
    return tuple(cameras), tuple(photographs)


def _tie_points(path: Path, lines: list[tuple[int, str]], sizes: IntArray) -> TiePoints:
    position, lengths = number_rows(path, lines[0::3])
    colour, colours = number_rows(path, lines[1::3])
    if (lengths != 3).any() or (colours != 3).any():
        raise ExchangeError(f"{path}: a point must have a position and a colour of three numbers each: it is damaged")
    where = str(path)
    _, table, point = counted_rows(where, "the views of a point", *number_rows(path, lines[2::3]), 1, 4)
    photograph = whole_numbers(where, "the camera of a view", table[:, 0], 0, len(sizes) - 1)
    feature = whole_numbers(where, "the key of a view", table[:, 1])
    centre = (sizes[photograph] - 1) / 2
    return tie_points_of(
        where,
        photograph,
        point,
        centre + table[:, 2:] * [1.0, -1.0],
        position.reshape(-1, 3),
        feature=feature,
        colour=whole_numbers(where, "a colour", colour, 0, 255).astype(np.uint8).reshape(-1, 3),
    )


# ---- writing -------------------------------------------------------------------------------------------------------


def write_bundler(path: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write a bundle.out, and list.txt beside it; returns sentences on what has no place in them.

    Raises ExchangeError where a camera is not a pinhole with k1 and k2 and its principal point in the centre of the
    picture, or a name has a space; WorkspaceError where the folder cannot be written.
    """
    check_writable(path, solution)
    for camera in solution.cameras:
        _check_camera(path, camera)
    names = [path_to_write(photograph) for photograph in solution.photographs]
    for name in names:
        if len(name.split()) != 1:
            raise ExchangeError(f"{path}: Bundler takes no name with a space, found {name!r}: rename the photograph")
    chosen, others = oriented_tie_points(solution)
    lines = [_HEADER, f"{len(names)} {len(chosen)}"]
    for photograph in solution.photographs:
        if photograph.pose is None:
            lines += ["0 0 0"] * 5
            continue
        camera = solution.cameras[photograph.camera]
        R = _D @ photograph.pose.rotation_world_from_camera.T
        t = -R @ photograph.pose.position_world_m
        lines += [_row([camera.focal_px, *camera.radial[:2]]), *(_row(row) for row in R), _row(t)]
    sizes = sizes_of(solution.cameras, solution.photographs)
    offset = chosen.pixel - (sizes[chosen.photograph] - 1) / 2
    key = np.where(chosen.feature < 0, 0, chosen.feature)
    views = [
        f" {i} {k} {x!r} {-y!r}"
        for i, k, (x, y) in zip(chosen.photograph.tolist(), key.tolist(), offset.tolist(), strict=True)
    ]
    first = chosen.first_observation.tolist()
    for i, (place, (r, g, b)) in enumerate(zip(chosen.position_world_m, chosen.colour.tolist(), strict=True)):
        lines += [_row(place), f"{r} {g} {b}", f"{first[i + 1] - first[i]}{''.join(views[first[i] : first[i + 1]])}"]
    write_whole(path, "\n".join(lines) + "\n")
    write_whole(path.with_name("list.txt"), "\n".join(names) + "\n")
    return (*_not_written(solution), *others, *without_place(solution))


def _row(values: FloatArray | list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _check_camera(path: Path, camera: Camera) -> None:
    centre = centre_px((camera.width_px, camera.height_px))
    if camera.model != "brown":
        beyond = "is a fisheye"
    elif np.any(camera.radial[2:]) or np.any(camera.tangential) or np.any(camera.affinity):
        beyond = "has more distortion than k1 and k2"
    elif np.abs(camera.principal_point_px - centre).max() > _CENTRED:
        beyond = "has its principal point off the centre of the picture"
    else:
        return
    raise ExchangeError(
        f"{path}: camera {camera.name} {beyond}, which Bundler's files cannot hold: write another format, COLMAP's for "
        "example"
    )


def _not_written(solution: ForeignSolution) -> Iterator[str]:
    yield "The sizes of the photographs."
    if any(photograph.pose is None for photograph in solution.photographs):
        yield "The cameras of photographs without an orientation."
    if (solution.tie_points.feature < 0).any():
        yield "That some observations have no key point: they have the number 0."
