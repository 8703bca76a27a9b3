"""A point cloud as Entwine Point Tiles (EPT 1.0, entwine.io): the octree of a COPC with a file of LAZ for each node, as
Potree 1 and so WebODM load it.

The nodes are LAS 1.2 with places, intensity, returns, class and colour: older decoders in browsers read no newer point
format. What else a cloud has of its points stays in the cloud itself.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
from laspy.copc import CopcReader
from numpy.typing import NDArray

from photogram.files.atomic import make_folder
from photogram.files.clouds.octree import GRID_CELLS
from photogram.files.npz_json import write_json

ENTRY = "ept.json"
_POINT_FORMAT = 2
_TAKEN = ("X", "Y", "Z", "intensity", "return_number", "number_of_returns", "classification", "red", "green", "blue")
_SCHEMA = (
    ("Intensity", "unsigned", 2), ("ReturnNumber", "unsigned", 1), ("NumberOfReturns", "unsigned", 1),
    ("Classification", "unsigned", 1), ("Red", "unsigned", 2), ("Green", "unsigned", 2), ("Blue", "unsigned", 2),
)  # fmt: skip


def write_ept(folder: Path, copc: Path) -> int:
    """Write the points of a COPC with colours as EPT into a folder that is made for it; return how many nodes there
    are. One node is in memory at a time. Raises WorkspaceError where the folder or ``ept.json`` cannot be written,
    OSError where a node cannot."""
    for name in ("ept-data", "ept-hierarchy"):
        make_folder(folder / name)
    counts = dict[str, int]()
    with CopcReader.open(str(copc)) as reader:
        for name, points in _nodes(reader, copc):
            counts[name] = len(points)
            node = laspy.LasData(_header(reader.header))
            node.points = laspy.ScaleAwarePointRecord.zeros(len(points), header=node.header)
            for dimension in _TAKEN:
                node[dimension] = points[dimension]
            node.write(str(folder / "ept-data" / f"{name}.laz"))
        write_json(folder / "ept-hierarchy" / "0-0-0-0.json", counts)
        write_json(folder / ENTRY, _description(reader))  # last: a reader begins here
    return len(counts)


def _nodes(reader: CopcReader, copc: Path) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the nodes of a COPC by their names in EPT, level-x-y-z, with their points."""
    record, kind = reader.laszip_vlr.record_data, reader.header.point_format
    with copc.open("rb") as stream:
        for key, entry in reader.root_page.entries.items():
            if entry.point_count <= 0:
                continue
            stream.seek(entry.offset)
            packed = np.frombuffer(stream.read(entry.byte_size), np.uint8)
            points = np.zeros(entry.point_count * kind.size, np.uint8)
            lazrs.decompress_points_with_chunk_table(packed, record, points, [(entry.point_count, entry.byte_size)])
            own = laspy.PackedPointRecord.from_buffer(points, kind)
            yield f"{key.level}-{key.x}-{key.y}-{key.z}", own


def _header(of_cloud: laspy.LasHeader) -> laspy.LasHeader:
    header = laspy.LasHeader(point_format=_POINT_FORMAT, version="1.2")
    header.scales, header.offsets = of_cloud.scales, of_cloud.offsets
    return header


def _description(reader: CopcReader) -> dict[str, object]:
    """Return what ``ept.json`` says of the cloud."""
    header, info = reader.header, reader.copc_info
    low, high = info.center - info.halfsize, info.center + info.halfsize
    places = [
        {"name": name, "type": "signed", "size": 4, "scale": scale, "offset": offset, "minimum": least, "maximum": most}
        for name, scale, offset, least, most in zip(
            "XYZ", header.scales, header.offsets, header.mins, header.maxs, strict=True
        )
    ]
    crs = header.parse_crs()
    plan = None if crs is None else (crs.sub_crs_list[0] if crs.is_compound else crs.to_2d())
    authority = None if plan is None else plan.to_authority()
    srs = {} if authority is None else {"authority": authority[0], "horizontal": authority[1]}
    return {
        "bounds": [*low, *high],
        "boundsConforming": [*header.mins, *header.maxs],
        "dataType": "laszip",
        "hierarchyType": "json",
        "points": int(header.point_count),
        "schema": [*places, *({"name": name, "type": kind, "size": size} for name, kind, size in _SCHEMA)],
        "span": GRID_CELLS,
        "srs": srs if crs is None else {**srs, "wkt": crs.to_wkt()},
        "version": "1.0.0",
    }
