"""The geo keys of a GeoTIFF, changed in place: what its format defines and GDAL 3.10 reads but does not write.

A map grid with ellipsoidal heights is its ProjectedCRSGeoKey and, as VerticalGeoKey, the code of the geographic CRS
with three axes that it is projected from (OGC 19-008r4, GeoTIFF 1.1, sec. 7.5.10).
"""

import struct
from pathlib import Path

VERTICAL_KEY = 4096
_DIRECTORY_TAG = 34735
_SHORT_BYTES = 2


def set_vertical_key(path: Path, code: int) -> None:
    """Put another code into the VerticalGeoKey of a GeoTIFF or BigTIFF.

    Raises OSError where the file holds no such key, or cannot be read or written.
    """
    with path.open("r+b") as stream:
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
        for at in range(4, length, 4):
            if keys[at] == VERTICAL_KEY:
                stream.seek(place + _SHORT_BYTES * (at + 3))
                stream.write(struct.pack(order + "H", code))
                return
    raise OSError(f"{path}: no vertical geo key")
