"""Binary files of COLMAP's sparse models, little-endian: cameras.bin, images.bin, points3D.bin.

The layout is that of src/colmap/scene/reconstruction_io_binary.cc. Every count is compared with the bytes that are left
before anything is allocated for it. COLMAP 4 writes rigs.bin and frames.bin beside them; the poses that images.bin
holds are composed from those already, so only the number of sensors is looked at.
"""

from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, IntArray
from photogram.errors import ExchangeError
from photogram.exchange.formats.colmap.records import (
    ColmapCamera,
    ColmapImage,
    ColmapPoints,
    SparseModel,
    model_of,
)
from photogram.files.solutions.parsing import bytes_of

_COUNT = Struct("<Q")
_CAMERA = Struct("<IiQQ")
_IMAGE = Struct("<I7dI")
_RIG = Struct("<II")
_SENSOR = Struct("<iI")
_KEY_POINT = np.dtype([("pixel", "<f8", 2), ("point", "<u8")])
_POINT = np.dtype([("number", "<u8"), ("position", "<f8", 3), ("colour", "u1", 3), ("error", "<f8"), ("track", "<u8")])
_OBSERVATION = np.dtype([("image", "<u4"), ("feature", "<u4")])
_NONE = np.uint64(2**64 - 1)
_POSE_BYTES = 56


class _Bytes:
    """The content of a file, and how far it has been read."""

    def __init__(self, path: Path) -> None:
        self.path, self.data = path, bytes_of(path)
        self.place = 0

    def take(self, record: Struct) -> tuple[int | float, ...]:
        """Return the next record."""
        self.need(record.size)
        self.place += record.size
        return record.unpack_from(self.data, self.place - record.size)

    def count(self, least_bytes: int) -> int:
        """Return the next count, of things that take at least so many bytes each."""
        count = int(self.take(_COUNT)[0])
        self.need(count * least_bytes)
        return count

    def need(self, size: int) -> None:
        """Raise ExchangeError where fewer bytes are left."""
        left = len(self.data) - self.place
        if size > left:
            raise ExchangeError(
                f"{self.path}: at byte {self.place} it announces {size} bytes more and has {left}: it is cut off or "
                "damaged: save the model again in COLMAP"
            )

    def array(self, kind: np.dtype[np.void] | str, count: int) -> NDArray[Any]:
        """Return the next records as an array over the file's bytes."""
        size = np.dtype(kind).itemsize * count
        self.need(size)
        self.place += size
        return np.frombuffer(self.data, kind, count, self.place - size)

    def name(self) -> str:
        """Return the next name, which a null byte ends."""
        end = self.data.find(b"\0", self.place)
        if end < 0:
            self.need(len(self.data) + 1)
        try:
            text = self.data[self.place : end].decode("utf-8")
        except UnicodeDecodeError as error:
            raise ExchangeError(
                f"{self.path}: the name at byte {self.place} is not UTF-8: rename the photograph"
            ) from error
        self.place = end + 1
        return text

    def end(self) -> None:
        """Raise ExchangeError where bytes are left."""
        if self.place != len(self.data):
            raise ExchangeError(
                f"{self.path}: {len(self.data) - self.place} bytes follow its last record: it is damaged: save the "
                "model again in COLMAP"
            )


def read_binary(folder: Path) -> SparseModel:
    """Return what cameras.bin, images.bin and points3D.bin of a folder hold. Raises ExchangeError where one is missing
    or damaged."""
    return SparseModel(
        _cameras(folder / "cameras.bin"), _images(folder / "images.bin"), _points(folder / "points3D.bin")
    )


def _cameras(path: Path) -> tuple[ColmapCamera, ...]:
    file, cameras = _Bytes(path), []
    for _ in range(file.count(_CAMERA.size)):
        number, model, width, height = map(int, file.take(_CAMERA))
        parameters = file.array("<f8", len(model_of(str(path), model).parameters)).astype(np.float64)
        cameras.append(ColmapCamera(number, model, (width, height), parameters))
    file.end()
    return tuple(cameras)


def _numbers(path: Path, values: NDArray[np.generic]) -> IntArray:
    """Return numbers of points; the one that stands for none becomes −1."""
    numbers = values.astype(np.uint64)
    if ((numbers >= 2**63) & (numbers != _NONE)).any():
        raise ExchangeError(f"{path}: a tie point has a number beyond 2^63: the file is damaged")
    return numbers.view(np.int64).copy()


def _images(path: Path) -> tuple[ColmapImage, ...]:
    file, images = _Bytes(path), []
    for _ in range(file.count(_IMAGE.size + 1 + _COUNT.size)):
        number, *pose, camera = file.take(_IMAGE)
        name = file.name()
        keys = file.array(_KEY_POINT, file.count(_KEY_POINT.itemsize))
        images.append(
            ColmapImage(
                int(number),
                np.array(pose[:4]),
                np.array(pose[4:]),
                int(camera),
                name,
                keys["pixel"].astype(np.float64),
                _numbers(path, keys["point"]),
            )
        )
    file.end()
    return tuple(images)


def _points(path: Path) -> ColmapPoints:
    file = _Bytes(path)
    count = file.count(_POINT.itemsize)
    data, place = file.data, file.place
    starts = np.empty(count, dtype=np.int64)
    track, size = _POINT.fields["track"][1] if _POINT.fields else 0, _POINT.itemsize
    unpack = _COUNT.unpack_from
    for i in range(count):
        file.place = place
        if place + size > len(data):
            file.need(size)
        starts[i] = place
        length = unpack(data, place + track)[0]
        place += size + length * _OBSERVATION.itemsize
    if place > len(data):
        file.need(place - file.place)
    file.place = place
    file.end()
    everything: ByteArray = np.frombuffer(data, np.uint8)
    of_heads = starts[:, None] + np.arange(size)
    heads = np.ascontiguousarray(everything[of_heads]).view(_POINT).reshape(-1)
    lengths = heads["track"].astype(np.int64)
    tracked = np.ones(len(data), dtype=bool)
    tracked[: _COUNT.size] = False
    tracked[of_heads.ravel()] = False
    observations = everything[tracked].view(_OBSERVATION)
    numbers = _numbers(path, heads["number"])
    if (numbers < 0).any():
        raise ExchangeError(f"{path}: a tie point has the number that stands for none: the file is damaged")
    return ColmapPoints(
        numbers,
        heads["position"].astype(np.float64),
        heads["colour"].copy(),
        heads["error"].astype(np.float64),
        np.repeat(np.arange(count), lengths),
        observations["image"].astype(np.int64),
        observations["feature"].astype(np.int64),
    )


def sensors_of_rigs(path: Path) -> list[int]:
    """Return the number of sensors of every rig in rigs.bin. Raises ExchangeError where it is damaged."""
    file, sensors = _Bytes(path), []
    for _ in range(file.count(_RIG.size)):
        _, count = map(int, file.take(_RIG))
        sensors.append(count)
        for j in range(count):
            file.take(_SENSOR)
            if j and file.array("u1", 1)[0]:
                file.array("u1", _POSE_BYTES)
    file.end()
    return sensors


# ---- writing -------------------------------------------------------------------------------------------------------


def binary_files(model: SparseModel) -> dict[str, bytes]:
    """Return the content of the three files by their names."""
    return {
        "cameras.bin": _cameras_written(model.cameras),
        "images.bin": _images_written(model.images),
        "points3D.bin": _points_written(model.points),
    }


def _cameras_written(cameras: tuple[ColmapCamera, ...]) -> bytes:
    parts = [_COUNT.pack(len(cameras))]
    for camera in cameras:
        parts.append(_CAMERA.pack(camera.number, camera.model, *camera.size_px))
        parts.append(camera.parameters.astype("<f8").tobytes())
    return b"".join(parts)


def _images_written(images: tuple[ColmapImage, ...]) -> bytes:
    parts = [_COUNT.pack(len(images))]
    for image in images:
        parts.append(_IMAGE.pack(image.number, *image.quaternion, *image.translation, image.camera))
        parts.append(image.name.encode("utf-8") + b"\0")
        keys = np.empty(len(image.pixel), dtype=_KEY_POINT)
        keys["pixel"], keys["point"] = image.pixel, image.point.view(np.uint64)
        parts += [_COUNT.pack(len(keys)), keys.tobytes()]
    return b"".join(parts)


def _points_written(points: ColmapPoints) -> bytes:
    count = len(points.number)
    lengths = np.bincount(points.track_point, minlength=count).astype(np.int64)
    heads = np.empty(count, dtype=_POINT)
    heads["number"] = points.number
    heads["position"] = points.position
    heads["colour"] = points.colour
    heads["error"] = points.error_px
    heads["track"] = lengths
    observations = np.empty(len(points.track_point), dtype=_OBSERVATION)
    observations["image"], observations["feature"] = points.track_image, points.track_feature
    # the tracks lie in order, so each head is put before the first of its own
    size = _POINT.itemsize
    before = np.concatenate([[0], np.cumsum(lengths)[:-1]]) if count else np.zeros(0, dtype=np.int64)
    starts = (np.arange(count) * size + before * _OBSERVATION.itemsize).astype(np.int64)
    data = np.empty(count * size + observations.nbytes, dtype=np.uint8)
    is_head = np.zeros(len(data), dtype=bool)
    is_head[(starts[:, None] + np.arange(size)).ravel()] = True
    data[is_head], data[~is_head] = heads.view(np.uint8), observations.view(np.uint8)
    return _COUNT.pack(count) + data.tobytes()
