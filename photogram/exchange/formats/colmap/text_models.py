"""Text files of COLMAP's sparse models: cameras.txt, images.txt, points3D.txt (COLMAP documentation, Output Format).

What begins with # is a comment. An image has two lines, of which the second, its key points, may be empty.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ExchangeError
from photogram.exchange.formats.colmap.records import (
    MODELS,
    NUMBERS,
    ColmapCamera,
    ColmapImage,
    ColmapPoints,
    SparseModel,
)
from photogram.files.solutions.parsing import number_rows, numbers, split_rows, text_of, whole_number, whole_numbers
from photogram.wording import printable, shortened

_LARGEST_ID = 2**32 - 1
_HEAD = 8
"""Numbers of a tie point before its track."""


def read_text(folder: Path) -> SparseModel:
    """Return what cameras.txt, images.txt and points3D.txt of a folder hold. Raises ExchangeError where one is missing
    or damaged, with the line."""
    return SparseModel(
        _cameras(folder / "cameras.txt"), _images(folder / "images.txt"), _points(folder / "points3D.txt")
    )


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Give the lines that are no comment, with their numbers."""
    for number, line in enumerate(text_of(path).split("\n"), 1):
        if not line.lstrip().startswith("#"):
            yield number, line.strip()


def _cut_off(where: str, what: str) -> ExchangeError:
    return ExchangeError(f"{where}: {what}: the file is cut off or damaged: save the model again in COLMAP")


def _cameras(path: Path) -> tuple[ColmapCamera, ...]:
    cameras = []
    for line, text in _lines(path):
        if not text:
            continue
        where, parts = f"{path}:{line}", text.split()
        if len(parts) < 4 or parts[1] not in NUMBERS:
            name = shortened(printable(parts[1] if len(parts) > 1 else text))
            raise ExchangeError(f"{where}: COLMAP has no camera model {name!r}: check the file")
        model = NUMBERS[parts[1]]
        expected = len(MODELS[model].parameters)
        if len(parts) != 4 + expected:
            raise _cut_off(where, f"{parts[1]} has {expected} parameters, found {len(parts) - 4}")
        number, width, height = (
            whole_number(where, what, parts[i], 0, _LARGEST_ID)
            for i, what in ((0, "CAMERA_ID"), (2, "WIDTH"), (3, "HEIGHT"))
        )
        cameras.append(ColmapCamera(number, model, (width, height), numbers(where, parts[4:])))
    return tuple(cameras)


def _images(path: Path) -> tuple[ColmapImage, ...]:
    images, lines = [], _lines(path)
    for line, text in lines:
        if not text:
            continue
        where, parts = f"{path}:{line}", text.split(maxsplit=9)
        if len(parts) != 10:
            raise _cut_off(where, "an image has an ID, seven numbers of its pose, a camera and a name")
        pose = numbers(where, parts[1:8])
        below = next(lines, None)
        if below is None:
            raise _cut_off(where, "the line of its key points is missing")
        keys, count = number_rows(path, [below])
        if count[0] % 3:
            raise _cut_off(f"{path}:{below[0]}", f"key points are X, Y, POINT3D_ID each, found {count[0]} numbers")
        keys = keys.reshape(-1, 3)
        images.append(
            ColmapImage(
                whole_number(where, "IMAGE_ID", parts[0], 0, _LARGEST_ID),
                pose[:4],
                pose[4:],
                whole_number(where, "CAMERA_ID", parts[8], 0, _LARGEST_ID),
                parts[9],
                np.array(keys[:, :2]),
                whole_numbers(f"{path}:{below[0]}", "POINT3D_ID", keys[:, 2], low=-1),
            )
        )
    return tuple(images)


def _points(path: Path) -> ColmapPoints:
    lines = [(line, text) for line, text in _lines(path) if text]
    values, counts = number_rows(path, lines)
    wrong = np.flatnonzero((counts < _HEAD) | (counts % 2 == 1))
    if len(wrong):
        where = f"{path}:{lines[wrong[0]][0]}"
        raise _cut_off(where, f"a tie point has {_HEAD} numbers and a pair for each image, found {counts[wrong[0]]}")
    head, tracks = split_rows(values, counts, _HEAD)
    track = tracks.reshape(-1, 2)
    where = str(path)
    colour = [whole_numbers(where, "a colour", head[:, i], 0, 255) for i in (4, 5, 6)]
    return ColmapPoints(
        whole_numbers(where, "POINT3D_ID", head[:, 0]),
        head[:, 1:4],
        np.column_stack(colour).astype(np.uint8),
        head[:, 7],
        np.repeat(np.arange(len(counts)), (counts - _HEAD) // 2),
        whole_numbers(where, "IMAGE_ID of a track", track[:, 0], 0, _LARGEST_ID),
        whole_numbers(where, "POINT2D_IDX of a track", track[:, 1], 0, _LARGEST_ID),
    )


# ---- writing -------------------------------------------------------------------------------------------------------


def text_files(model: SparseModel) -> dict[str, bytes]:
    """Return the content of the three files by their names; numbers with all their digits."""
    cameras = [
        f"{c.number} {MODELS[c.model].name} {c.size_px[0]} {c.size_px[1]} {_digits(c.parameters)}\n"
        for c in model.cameras
    ]
    images = []
    for image in model.images:
        pose = _digits(np.concatenate([image.quaternion, image.translation]))
        images.append(f"{image.number} {pose} {image.camera} {image.name}\n")
        keys = zip(image.pixel.tolist(), image.point.tolist(), strict=True)
        images.append(" ".join(f"{x!r} {y!r} {point}" for (x, y), point in keys) + "\n")
    points, counts = model.points, np.bincount(model.points.track_point, minlength=len(model.points.number))
    ends = np.cumsum(counts)
    pairs = [f" {i} {k}" for i, k in zip(points.track_image.tolist(), points.track_feature.tolist(), strict=True)]
    rows = [
        f"{n} {x!r} {y!r} {z!r} {r} {g} {b} {e!r}{''.join(pairs[end - count : end])}\n"
        for n, (x, y, z), (r, g, b), e, count, end in zip(
            points.number.tolist(),
            points.position.tolist(),
            points.colour.tolist(),
            points.error_px.tolist(),
            counts.tolist(),
            ends.tolist(),
            strict=True,
        )
    ]
    heads = {
        "cameras.txt": "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n",
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n",
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n",
    }
    bodies = ("".join(cameras), "".join(images), "".join(rows))
    return {name: (head + body).encode("utf-8") for (name, head), body in zip(heads.items(), bodies, strict=True)}


def _digits(values: FloatArray) -> str:
    return " ".join(repr(value) for value in values.tolist())
