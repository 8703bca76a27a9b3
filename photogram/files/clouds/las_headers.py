"""The header of a LAS or LAZ file compared with the file itself, before a decoder trusts it.

A header may claim two thousand million points in a file of a kilobyte, and a file that was cut between two points reads
as a smaller cloud. What cannot be is refused here, by the tables of the ASPRS LAS specification 1.4, section 2.4.
"""

import struct
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from photogram.errors import ProjectError
from photogram.files.reading import regular_file_size

_POINT_BYTES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""Of each point format, 0 to 10, without extra bytes."""

_HEADER_BYTES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}
"""Of each minor version, at least."""

_VLR_BYTES, _EVLR_BYTES = 54, 60
_COMPRESSED, _FORMAT = 0x80, 0x3F
_VARIABLE_CHUNKS = 2**32 - 1
LARGEST_EXTENT = 1e9
"""Of a coordinate, in units of the file: farther than the moon in metres."""


@dataclass(frozen=True)
class _Header:
    """What a header says of its file: sizes in bytes, counts, offsets."""

    minor: int
    size: int
    data_offset: int
    vlrs: int
    point_format: int
    compressed: bool
    point_bytes: int
    points: int
    scales: tuple[float, ...]
    offsets: tuple[float, ...]
    first_evlr: int
    evlrs: int


def _read(data: bytes) -> _Header:
    """Take the header apart. Raises struct.error where it is too short."""
    minor = data[25]
    size, data_offset, vlrs, kind, point_bytes, points = struct.unpack_from("<HIIBHI", data, 94)
    scales, offsets = struct.unpack_from("<3d", data, 131), struct.unpack_from("<3d", data, 155)
    first_evlr = evlrs = 0
    if minor >= 4:
        first_evlr, evlrs, whole = struct.unpack_from("<QIQ", data, 235)
        points = whole or points
    compressed = bool(kind & _COMPRESSED)
    return _Header(
        minor, size, data_offset, vlrs, kind & _FORMAT, compressed, point_bytes, points, scales, offsets, first_evlr,
        evlrs,
    )  # fmt: skip


def _errors_in(header: _Header, size: int) -> str:
    """Return what cannot be in a file of so many bytes, empty where all can."""
    h = header
    if h.minor not in _HEADER_BYTES:
        return f"version 1.{h.minor}, versions 1.0 to 1.4 are read"
    if h.size < _HEADER_BYTES[h.minor] or not h.size <= h.data_offset <= size:
        return f"a header of {h.size} bytes and points from byte {h.data_offset} in a file of {size} bytes"
    if h.vlrs * _VLR_BYTES > h.data_offset - h.size:
        return f"{h.vlrs} variable length records in {h.data_offset - h.size} bytes"
    if h.point_format >= len(_POINT_BYTES):
        return f"point format {h.point_format}, formats 0 to {len(_POINT_BYTES) - 1} are read"
    if h.point_bytes < _POINT_BYTES[h.point_format]:
        return f"points of {h.point_bytes} bytes, format {h.point_format} needs {_POINT_BYTES[h.point_format]}"
    if not all(isfinite(s) and 0 < s <= 1e6 for s in h.scales) or not all(abs(o) <= LARGEST_EXTENT for o in h.offsets):
        return f"scales {h.scales} and offsets {h.offsets}"
    if h.evlrs and not h.data_offset <= h.first_evlr <= size - h.evlrs * _EVLR_BYTES:
        return f"{h.evlrs} extended records from byte {h.first_evlr} in a file of {size} bytes"
    if not h.compressed:
        end = h.first_evlr if h.evlrs else size
        room = (end - h.data_offset) // h.point_bytes
        if h.points != room and (h.points > room or not h.evlrs):
            return f"{h.points} points, but the file has room for {room}"
    return ""


def _chunks(path: Path, header: _Header) -> str:
    """Return what is wrong with the table of chunks of a LAZ file, empty where nothing is.

    The table names as many chunks as the points need; it stands at the end, so a file that was cut has none.
    """
    with path.open("rb") as stream:
        stream.seek(header.size)
        records = stream.read(header.data_offset - header.size)
        chunk_points = _chunk_points(records, header.vlrs)
        if chunk_points is None:
            return "compressed points without the LASzip record"
        stream.seek(header.data_offset)
        (table,) = struct.unpack("<q", stream.read(8))
        size = regular_file_size(path)
        if table == -1:  # a writer that could not go back to fill it in put it into the last 8 bytes
            stream.seek(size - 8)
            (table,) = struct.unpack("<q", stream.read(8))
        if not header.data_offset + 8 <= table <= size - 8:
            return f"a table of chunks at byte {table} in a file of {size} bytes"
        stream.seek(table)
        _, chunks = struct.unpack("<II", stream.read(8))
    if chunk_points == _VARIABLE_CHUNKS:
        return "" if chunks <= max(header.points, 1) else f"{chunks} chunks for {header.points} points"
    if chunk_points == 0 or -(-header.points // chunk_points) != chunks:
        return f"{header.points} points in {chunks} chunks of {chunk_points}"
    return ""


def _chunk_points(records: bytes, count: int) -> int | None:
    """Return the number of points in a chunk as the record of LASzip gives it, None where there is no such record."""
    place = 0
    for _ in range(count):
        if place + _VLR_BYTES > len(records):
            return None
        user = records[place + 2 : place + 18].rstrip(b"\0")
        number, length = struct.unpack_from("<HH", records, place + 18)
        if user == b"laszip encoded" and number == 22204 and length >= 16:
            return int(struct.unpack_from("<I", records, place + _VLR_BYTES + 12)[0])
        place += _VLR_BYTES + length
    return None


def check_las(path: Path) -> None:
    """Check that a LAS or LAZ file can be what its header says. Raises ProjectError where it cannot, OSError where it
    cannot be read."""
    size = regular_file_size(path)
    with path.open("rb") as stream:
        data = stream.read(375)
    try:
        if data[:4] != b"LASF":
            error = "not a LAS file (no LASF signature)"
        else:
            header = _read(data)
            error = _errors_in(header, size)
            if not error and header.compressed and header.points:
                error = _chunks(path, header)
    except (struct.error, IndexError):
        error = f"truncated header, the file has {size} bytes"
    if error:
        raise ProjectError(f"point cloud {path}: damaged or truncated ({error}): copy or export it again")
