"""Tie points of the Open Photogrammetry Format: glTF with the extension OPF_mesh_primitive_matches.

Positions are single precision, with y up (OPF specification 1.0, OPF-glTF point cloud): the matrix of a node leads to
that frame, and a quarter turn about x to the processing CRS, with z up. Pixels of matches have the centre of the
top-left one at (0.5, 0.5). Those of a point are a range of the list of matches: an offset of 40 bits and a count of 24.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import HALF_PIXEL, no_tie_points, tie_points_of
from photogram.exchange.formats.json_nodes import Node, read_json
from photogram.files.atomic import write_whole
from photogram.files.solutions.parsing import bytes_of, check_finite, part_of
from photogram.survey import TRANSFERRED, TiePoints
from photogram.wording import things

_CODES = {np.dtype("<u1"): 5121, np.dtype("<u4"): 5125, np.dtype("<f4"): 5126}
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_NO_FEATURE = np.uint64(2**64 - 1)
_LARGEST_FLOAT = 3e38
_MOST_BYTES = 2_000_000_000
MOST_JSON_BYTES = 100_000_000
MOST_VALUES = 500_000_000
"""Of all accessors that are read: those of 60 million observations."""


class _Arrays:
    """The accessors of a glTF file, and the buffers that they lie in."""

    def __init__(self, path: Path, root: Node) -> None:
        self._folder, self._root = path.parent, root
        self._buffers: dict[Path, bytes] = {}
        self._left = MOST_VALUES

    def _buffer(self, number: int) -> bytes:
        uri = self._root.get("buffers").item(number).get("uri")
        path = part_of(uri.place, self._folder, unquote(uri.text()))
        if path not in self._buffers:
            self._buffers[path] = bytes_of(path, _MOST_BYTES)
        return self._buffers[path]

    def of(self, number: int, kind: str, width: int) -> NDArray[np.generic]:
        """Return an accessor (N, width), or (N,) for a scalar. Raises ExchangeError where it is of another type, or its
        buffer ends before it."""
        accessor = self._root.get("accessors").item(number)
        code, shape = accessor.get("componentType").whole(), accessor.get("type").text()
        expected = (_CODES[np.dtype(kind)], _SHAPES[width])
        if (code, shape) != expected or accessor.find("sparse") is not None:
            raise ExchangeError(
                f"{accessor.place}: is of type {shape} {code}, expected {_SHAPES[width]} of {kind[1:]}: "
                "export the project again"
            )
        view = self._root.get("bufferViews").item(accessor.get("bufferView").whole())
        data = self._buffer(view.get("buffer").whole())
        start = view.get("byteOffset").whole() if view.find("byteOffset") is not None else 0
        count, size = accessor.get("count").whole(), width * np.dtype(kind).itemsize
        if start + count * size > len(data):
            raise ExchangeError(
                f"{accessor.place}: has {things(count, 'element')}, its buffer has place for "
                f"{max(len(data) - start, 0) // size}: the file was cut off, export the project again"
            )
        self._left -= count * width
        if self._left < 0:
            raise ExchangeError(f"{accessor.place}: nodes share more values than the {MOST_VALUES} that are read")
        values = np.frombuffer(data, kind, count * width, start)
        return values if width == 1 else values.reshape(-1, width)


class _Part(NamedTuple):
    """The tracks (P) of a node with their observations (N)."""

    position: FloatArray
    colour: ByteArray
    photograph: IntArray
    point: IntArray
    pixel: FloatArray
    feature: IntArray


def read_tracks(path: Path, photograph_of: Mapping[int, int]) -> tuple[TiePoints, tuple[str, ...]]:
    """Return the tie points of a glTF file in the processing CRS, and sentences about what is left out.

    ``photograph_of`` are the numbers of photographs by those of OPF's cameras. Raises ExchangeError where the file or
    its buffers are missing, damaged, or lead out of their folder.
    """
    root = read_json(path, MOST_JSON_BYTES)
    arrays = _Arrays(path, root)
    parts: list[_Part] = []
    first = 0
    left_out: list[str] = []
    for node in root.get("nodes").items():
        if node.find("mesh") is None:
            continue
        primitive = root.get("meshes").item(node.get("mesh").whole()).get("primitives").item(0)
        position, colour = _points(arrays, node, primitive)
        extensions = primitive.find("extensions")
        matches = None if extensions is None else extensions.find("OPF_mesh_primitive_matches")
        if matches is None or matches.find("imagePoints") is None:
            left_out.append(f"{things(len(position), 'track')} without image points.")
            continue
        photograph, point, pixel, feature = _matches(arrays, matches, len(position), photograph_of, left_out)
        parts.append(_Part(position, colour, photograph, first + point, pixel, feature))
        first += len(position)
    if not parts:
        return no_tie_points(), tuple(left_out)
    whole = _Part(*map(np.concatenate, zip(*parts, strict=True)))
    points = tie_points_of(
        str(path),
        whole.photograph,
        whole.point,
        whole.pixel,
        whole.position,
        feature=whole.feature,
        colour=whole.colour,
    )
    return points, (*left_out, "The scales of key points.")


def _doubles(array: NDArray[np.generic]) -> FloatArray:
    with np.errstate(invalid="ignore"):  # a float that is a signalling NaN is refused as one that is not finite
        return np.asarray(array, dtype=np.float64)


def _points(arrays: _Arrays, node: Node, primitive: Node) -> tuple[FloatArray, ByteArray]:
    """Return positions (P, 3) in the processing CRS and colours (P, 3)."""
    attributes = primitive.get("attributes")
    position = _doubles(arrays.of(attributes.get("POSITION").whole(), "<f4", 3))
    matrix = node.find("matrix")
    M = np.eye(4) if matrix is None else matrix.numbers(16).reshape(4, 4).T
    with np.errstate(over="ignore", invalid="ignore"):
        position = (position @ M[:3, :3].T + M[:3, 3]) @ _Z_UP_FROM_Y_UP.T
    check_finite(node.place, "position of a track", position)
    number = attributes.find("COLOR_0")
    if number is None:
        return position, np.zeros((len(position), 3), np.uint8)
    colour = np.asarray(arrays.of(number.whole(), "<u1", 4), dtype=np.uint8)[:, :3]
    if len(colour) != len(position):
        raise ExchangeError(
            f"{attributes.place}: has {things(len(position), 'position')} and {things(len(colour), 'colour')}"
        )
    return position, colour


def _matches(
    arrays: _Arrays, matches: Node, points: int, photograph_of: Mapping[int, int], left_out: list[str]
) -> tuple[IntArray, IntArray, FloatArray, IntArray]:
    """Return photograph (N,), point (N,), pixel (N, 2) and key point (N,) of the matches of known photographs."""
    image_points = matches.get("imagePoints")
    camera = np.asarray(arrays.of(matches.get("cameraIds").whole(), "<u4", 1), dtype=np.int64)
    pixel = _doubles(arrays.of(image_points.get("pixelCoordinates").whole(), "<f4", 2))
    words = np.asarray(arrays.of(image_points.get("featureIds").whole(), "<u4", 2), dtype=np.uint64)
    packed = np.asarray(arrays.of(matches.get("pointIndexRanges").whole(), "<u4", 2), dtype=np.uint64)
    uids = [photograph_of.get(uid.whole(), -1) for uid in matches.get("cameraUids").items()]
    value = packed[:, 0] | packed[:, 1] << np.uint64(32)
    offset, count = (value & np.uint64(2**40 - 1)).astype(np.int64), (value >> np.uint64(40)).astype(np.int64)
    place = matches.place
    if len(packed) != points or len(pixel) != len(camera) or len(words) != len(camera):
        raise ExchangeError(f"{place}: its lists have different lengths: export the project again")
    if np.any(offset + count > len(camera)) or count.sum() > len(camera):
        raise ExchangeError(f"{place}: has ranges beyond the {things(len(camera), 'match', 'matches')} that it has")
    if len(camera) and camera.max() >= len(uids):
        raise ExchangeError(f"{place}: match of camera {camera.max()}, it has {things(len(uids), 'camera')}")
    index = np.arange(count.sum()) + np.repeat(offset - np.cumsum(count) + count, count)
    point = np.repeat(np.arange(points), count)
    photograph = np.array(uids, dtype=np.int64)[camera[index]] if len(uids) else np.zeros(0, dtype=np.int64)
    pixel = pixel[index]
    check_finite(place, "pixel of a match", pixel)
    feature64 = (words[:, 0] | words[:, 1] << np.uint64(32))[index]
    feature = np.where(feature64 < np.uint64(2**63), feature64, np.uint64(0)).astype(np.int64)
    feature[feature64 >= np.uint64(2**63)] = TRANSFERRED
    known = photograph >= 0
    if not known.all():
        left_out.append(f"{things(int((~known).sum()), 'match', 'matches')} in photographs that are not read.")
    return photograph[known], point[known], pixel[known] - HALF_PIXEL, feature[known]


def write_tracks(path: Path, tie_points: TiePoints, photographs: int) -> tuple[list[str], tuple[str, ...]]:
    """Write tie points in the processing CRS as glTF, its buffers beside it; returns the names of these, and sentences
    about what is left out. OPF's cameras are the photographs, counted from 1.

    Raises ExchangeError where a coordinate is beyond single precision, WorkspaceError where a file cannot be written.
    """
    placed: BoolArray = np.asarray(np.isfinite(tie_points.position_world_m).all(axis=1))
    tie = tie_points.select(placed)
    left_out = (f"{things(int((~placed).sum()), 'tie point')} without a position.",) if not placed.all() else ()
    if len(tie) and max(np.abs(tie.position_world_m).max(), np.abs(tie.pixel).max(initial=0.0)) > _LARGEST_FLOAT:
        raise ExchangeError(f"{path}: tie points lie beyond single precision: remove those far away")
    n = len(tie.point)
    offset, count = tie.first_observation[:-1].astype(np.uint64), tie.rays.astype(np.uint64)
    feature = np.where(tie.feature >= 0, tie.feature.astype(np.uint64), _NO_FEATURE)
    position = tie.position_world_m.astype("<f4")
    colour = np.column_stack([tie.colour, np.full(len(tie), 255, np.uint8)])
    arrays: dict[str, NDArray[np.generic]] = {
        "positions.bin": position,
        "colors.bin": colour,
        "matchCameraIds.bin": tie.photograph.astype("<u4"),
        "matchPointIndexRanges.bin": (offset | count << np.uint64(40)).astype("<u8").view("<u4").reshape(-1, 2),
        "matchPixelCoordinates.bin": (tie.pixel + HALF_PIXEL).astype("<f4"),
        "matchFeatureIds.bin": feature.astype("<u8").view("<u4").reshape(-1, 2),
        "matchScales.bin": np.zeros(n, "<f4"),
    }
    for name, array in arrays.items():
        write_whole(path.parent / name, array.tobytes())
    write_whole(path, json.dumps(_gltf(arrays, position, photographs), indent=1))
    return list(arrays), left_out


def _gltf(arrays: Mapping[str, NDArray[np.generic]], position: Float32Array, photographs: int) -> object:
    """Return the glTF document of the arrays, one to a buffer."""
    accessors: list[dict[str, object]] = [
        {
            "bufferView": i,
            "componentType": _CODES[array.dtype.newbyteorder("<")],
            "count": len(array),
            "type": _SHAPES[1 if array.ndim == 1 else array.shape[1]],
        }
        for i, array in enumerate(arrays.values())
    ]
    accessors[0] |= {"min": position.min(axis=0).tolist(), "max": position.max(axis=0).tolist()}
    accessors[1] |= {"normalized": True}
    image_points = {"pixelCoordinates": 4, "featureIds": 5, "scales": 6}
    matches = {
        "cameraUids": list(range(1, photographs + 1)),
        "cameraIds": 2,
        "pointIndexRanges": 3,
        "imagePoints": image_points,
    }
    y_up = np.eye(4)
    y_up[:3, :3] = _Z_UP_FROM_Y_UP.T
    return {
        "asset": {"version": "2.0", "generator": "photogram", "extensions": {"OPF_asset_version": {"version": "1.0"}}},
        "extensionsUsed": ["KHR_materials_unlit", "OPF_asset_version", "OPF_mesh_primitive_matches"],
        "extensionsRequired": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "matrix": y_up.T.ravel().tolist()}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0, "COLOR_0": 1},
                        "material": 0,
                        "mode": 0,
                        "extensions": {"OPF_mesh_primitive_matches": matches},
                    }
                ]
            }
        ],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": i, "byteOffset": 0, "byteLength": array.nbytes, "target": 34962}
            for i, array in enumerate(arrays.values())
        ],
        "buffers": [{"uri": name, "byteLength": array.nbytes} for name, array in arrays.items()],
    }
