"""A LAZ file as Cloud Optimized Point Cloud (COPC 1.0, copc.io): the same points in an octree, one chunk of LAZ for a
node, so that a viewer loads the part it shows at the resolution it needs, over a network too.

Every reader of LAZ 1.4 reads the file. Its first record (user "copc", number 1) has the cube of the octree, its
extended record (user "copc", number 1000) the place of each node in the file.
"""

import struct
from collections.abc import Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import LasZipVlr
from laspy.vlrs.vlrlist import VLRList
from numpy.typing import NDArray

from photogram.arrays import BoolArray, IntArray
from photogram.errors import ProjectError
from photogram.files.atomic import scratch_folder
from photogram.files.clouds.las_headers import check_las
from photogram.files.clouds.laz_streams import laz_stream
from photogram.files.clouds.octree import (
    BRANCH_POINTS,
    GRID_CELLS,
    LEAF_POINTS,
    Cube,
    Node,
    branches_of,
    grouped_by_node,
    nodes_of,
    place,
    placed,
)

FORMATS = (6, 7, 8)
"""Point formats that a COPC may have."""

PART_POINTS = 1_000_000
"""Points that are read at a time."""

_USER, _INFO, _HIERARCHY = "copc", 1, 1000
_INFO_BYTES = struct.Struct("<5d2Q2d88x")
_ENTRY = struct.Struct("<4iQ2i")
_RECORD_BYTES = 60
_ONLY_PLACES = laspy.DecompressionSelection.XY_RETURNS_CHANNEL | laspy.DecompressionSelection.Z
_LASER = laspy.LazBackend.LazrsParallel

Points = NDArray[Any]  # records of a file's point format


@dataclass(frozen=True)
class CopcSummary:
    """What a COPC holds."""

    points: int
    nodes: int
    levels: int
    spacing: float
    """Of the points of the coarsest level, in units of the CRS; half of it at each level below."""


def write_copc(
    path: Path, cloud: Path, branch_points: int = BRANCH_POINTS, leaf_points: int = LEAF_POINTS
) -> CopcSummary:
    """Write the points of a LAZ file with all that it says of them as COPC, whole or not at all.

    In memory is a part of the file at a time, or a branch of the octree with up to ``branch_points``; beside the file
    stands every point once, uncompressed, while it is written. A node of ``leaf_points`` at most has no children. The
    same points in the same order give the same bytes. Raises ProjectError where the cloud is damaged, has no points,
    another point format than FORMATS or a scale of its own for each axis; WorkspaceError where the file cannot be
    written.
    """
    check_las(cloud)
    with laspy.open(cloud, laz_backend=_LASER) as reader:
        header = deepcopy(reader.header)
    _check(cloud, header)
    low, high = (
        np.rint((ends - header.offsets) / header.scales).astype(np.int64) for ends in (header.mins, header.maxs)
    )
    cube = Cube.around(low, high)
    branches = branches_of((cube.codes(_steps(part)) for part in _parts(cloud, only_places=True)), branch_points)
    with laz_stream(path) as stream, scratch_folder(Path(stream.name)) as folder:
        taken, begun = dict[Node, BoolArray](), set[Node]()
        times = np.array([np.inf, -np.inf])
        for part in _parts(cloud):
            code = cube.codes(_steps(part))
            for node, index in grouped_by_node(code, placed(code, branches, taken)):
                with _of(folder, node).open("ab") as own:
                    own.write(part[index].tobytes())
                begun.add(node)
            times = np.array([min(times[0], part["gps_time"].min()), max(times[1], part["gps_time"].max())])
        chunks = _chunks(folder, sorted(begun), frozenset(taken), cube, header.point_format.dtype(), leaf_points)
        return _write(stream, header, cube, (float(times[0]), float(times[1])), chunks)


def point_count(cloud: Path) -> int:
    """Return the number of points of a LAS or LAZ file. Raises ProjectError where it is damaged."""
    check_las(cloud)
    with laspy.open(cloud, laz_backend=_LASER) as reader:
        return int(reader.header.point_count)


def _check(cloud: Path, header: laspy.LasHeader) -> None:
    if header.point_format.id not in FORMATS:
        raise ProjectError(
            f"point cloud {cloud}: has point format {header.point_format.id}, a COPC 6, 7 or 8: export it as LAS 1.4"
        )
    if header.point_count == 0:
        raise ProjectError(f"point cloud {cloud}: it contains no points: export it again")
    if len(set(header.scales.tolist())) > 1:
        raise ProjectError(f"point cloud {cloud}: has scales {header.scales}: export it with one for all axes")


def _parts(cloud: Path, *, only_places: bool = False) -> Iterator[Points]:
    selection = _ONLY_PLACES if only_places else laspy.DecompressionSelection.all()
    with laspy.open(cloud, laz_backend=_LASER, decompression_selection=selection) as reader:
        for points in reader.chunk_iterator(PART_POINTS):
            yield points.array


def _steps(points: Points) -> NDArray[np.int32]:
    return np.column_stack([points["X"], points["Y"], points["Z"]])


def _of(folder: Path, node: Node) -> Path:
    return folder / "{}-{}".format(*node)


def _chunks(
    folder: Path, begun: Iterable[Node], whole: frozenset[Node], cube: Cube, kind: np.dtype[np.void], leaf: int
) -> Iterator[list[tuple[Node, Points]]]:
    """Yield the nodes with their points: those above the branches, which are ``whole``, one by one, the others branch
    by branch."""
    for node in begun:
        points = np.fromfile(_of(folder, node), kind)
        _of(folder, node).unlink()
        if node in whole:
            yield [(node, points)]
        else:
            yield [(one, points[index]) for one, index in nodes_of(cube.codes(_steps(points)), node[0], leaf)]


def _write(
    stream: BinaryIO,
    header: laspy.LasHeader,
    cube: Cube,
    times: tuple[float, float],
    chunks: Iterable[list[tuple[Node, Points]]],
) -> CopcSummary:
    kind = lazrs.LazVlr.new_for_compression(header.point_format.id, header.point_format.num_extra_bytes, True)
    scale = float(header.scales[0])
    info = laspy.VLR(_USER, _INFO, "COPC info", bytes(_INFO_BYTES.size))
    # in place: laspy makes the extra bytes anew for a list that is set
    header.vlrs.extract("LasZipVlr")
    header.vlrs.insert(0, info)
    header.vlrs.append(LasZipVlr(kind.record_data()))
    _clear_ranges(header)
    header.are_points_compressed = True
    header.write_to(stream)
    compressor, nodes, count = lazrs.ParLasZipCompressor(stream, kind), list[Node](), list[int]()
    for chunk in chunks:
        nodes += [node for node, _ in chunk]
        count += [len(points) for _, points in chunk]
        compressor.compress_chunks([np.frombuffer(points.tobytes(), np.uint8) for _, points in chunk])
    compressor.done()
    end = stream.seek(0, 2)
    stream.seek(header.offset_to_point_data)
    sizes = np.array([size for _, size in lazrs.read_chunk_table(stream, kind)], np.int64)
    hierarchy = _hierarchy(nodes, count, sizes, header.offset_to_point_data + 8)
    centre = header.offsets + (np.array(cube.low) + cube.side / 2) * scale
    half = cube.side * scale / 2
    spacing = 2 * half / GRID_CELLS
    info.record_data = _INFO_BYTES.pack(*centre, half, spacing, end + _RECORD_BYTES, len(hierarchy), *times)
    header.number_of_evlrs, header.start_of_first_evlr = 1, end
    stream.seek(end)
    VLRList([laspy.VLR(_USER, _HIERARCHY, "COPC hierarchy", hierarchy)]).write_to(stream, as_extended=True)
    stream.seek(0)
    header.write_to(stream, ensure_same_size=True)
    return CopcSummary(sum(count), len(nodes), max(level for level, _ in nodes) + 1, spacing)


def _clear_ranges(header: laspy.LasHeader) -> None:
    """Zero the ranges of extra bytes that state none: laspy leaves the largest numbers there, which other readers, as
    copc.js in browsers, refuse."""
    for record in header.vlrs.get("ExtraBytesVlr"):
        for field in record.extra_bytes_structs:
            if not field.options & (field.MIN_BIT_MASK | field.MAX_BIT_MASK):
                field._min, field._max = type(field._min)(), type(field._max)()


def _hierarchy(nodes: list[Node], count: list[int], sizes: IntArray, first: int) -> bytes:
    """Return the one page of the hierarchy: of each node its place in the octree, and in the file."""
    begin = first + np.concatenate([[0], np.cumsum(sizes)[:-1]])
    entries = zip(nodes, begin.tolist(), sizes.tolist(), count, strict=True)
    return b"".join(_ENTRY.pack(node[0], *place(node), *where) for node, *where in entries)
