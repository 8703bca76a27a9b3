"""The geo keys of a GeoTIFF, changed in place: what its format defines and GDAL 3.10 reads but does not write.

A map grid with ellipsoidal heights is its ProjectedCRSGeoKey and, as VerticalGeoKey, the code of the geographic CRS
with three axes that it is projected from (OGC 19-008r4, GeoTIFF 1.1, sec. 7.5.10).
"""

import struct
from pathlib import Path
from typing import BinaryIO

VERTICAL_KEY = 4096
_VERTICAL_KEYS = 4  # the CRS, its citation, datum and unit
_DIRECTORY_TAG = 34735
_SHORT_BYTES = 2


def set_vertical_key(path: Path, code: int) -> None:
    """Put another code into the VerticalGeoKey of a GeoTIFF or BigTIFF.

    Raises OSError where the file holds no such key, or cannot be read or written.
    """
    with path.open("r+b") as stream:
        order, place, keys = _directory(stream)
        for at in range(4, len(keys), 4):
            if keys[at] == VERTICAL_KEY:
                stream.seek(place + _SHORT_BYTES * (at + 3))
                stream.write(struct.pack(order + "H", code))
                return
    raise OSError(f"{path}: no vertical geo key")


def has_vertical_keys(path: Path) -> bool:
    """Return whether a GeoTIFF or BigTIFF names a vertical CRS. Raises OSError where it cannot be read."""
    with path.open("rb") as stream:
        _, _, keys = _directory(stream)
    return any(_is_vertical(key) for key in keys[4::4])


def _is_vertical(key: int) -> bool:
    return VERTICAL_KEY <= key < VERTICAL_KEY + _VERTICAL_KEYS


def drop_vertical_keys(path: Path) -> None:
    """Take the keys of the vertical CRS out of a GeoTIFF or BigTIFF, which is then on the map grid alone. Nothing else
    of the file moves.

    Raises OSError where the file cannot be read or written.
    """
    with path.open("r+b") as stream:
        order, place, keys = _directory(stream)
        rows = [keys[at : at + 4] for at in range(4, len(keys), 4)]
        kept = [row for row in rows if not _is_vertical(row[0])]
        # keys stand in ascending order, and their number in the last word of the first row: what follows is not read
        flat = [*keys[:3], len(kept), *(word for row in kept for word in row)]
        stream.seek(place)
        stream.write(struct.pack(f"{order}{len(flat)}H", *flat))


def _directory(stream: BinaryIO) -> tuple[str, int, tuple[int, ...]]:
    """Return the order of bytes of a file, where its directory of keys is, and the directory; empty without one."""
    head = stream.read(16)
    order = "<" if head[:2] == b"II" else ">"
    (version,) = struct.unpack_from(order + "H", head, 2)
    big = version == 43
    (directory,) = struct.unpack_from(order + ("Q" if big else "I"), head, 8 if big else 4)
    stream.seek(directory)
    count_of, entry = (order + "Q", order + "HHQQ") if big else (order + "H", order + "HHII")
    (count,) = struct.unpack(count_of, stream.read(struct.calcsize(count_of)))
    size = struct.calcsize(entry)
    entries = (struct.unpack(entry, stream.read(size)) for _ in range(count))
    place, length = next(((at, n) for tag, _, n, at in entries if tag == _DIRECTORY_TAG), (0, 0))
    stream.seek(place)
    keys = struct.unpack(f"{order}{length}H", stream.read(_SHORT_BYTES * length))
    return order, place, keys[: 4 + 4 * keys[3]] if keys else keys
