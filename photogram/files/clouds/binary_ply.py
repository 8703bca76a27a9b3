"""Vertices of binary PLY files (Turk 1994) as structured arrays, whatever their properties are."""

import re

import numpy as np
from numpy.typing import NDArray

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 65536
_END = re.compile(rb"end_header\r?\n")


def vertices_of(data: bytes) -> NDArray[np.void]:
    """Return the first element of a binary PLY file, its vertices, as a structured array (N,) with its properties.

    What follows it is passed over. Raises ValueError, in words, where the header is none, the properties are not
    numbers, or the data end before the count is reached.
    """
    end = _END.search(data, 0, _LONGEST_HEADER)
    if not data.startswith(b"ply") or end is None:
        raise ValueError("it is no PLY file")
    order, count, fields = "", -1, list[tuple[str, str]]()
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isascii() and words[2].isdigit():
            if count >= 0:
                break
            count = int(words[2])
        elif words[0] == "property" and len(words) == 3 and words[1] in _TYPES:
            fields.append((words[2], _TYPES[words[1]]))
        else:
            raise ValueError(f"its header has the line {line[:60]!r}, which is not read")
    if not order or count < 0 or not fields or len({name for name, _ in fields}) != len(fields):
        raise ValueError("its header names no binary format, no element or no properties of their own")
    kind = np.dtype([(name, order + code) for name, code in fields])
    complete = (len(data) - end.end()) // kind.itemsize
    if complete < count:
        raise ValueError(f"it ends after {complete} of {count} vertices")
    return np.frombuffer(data, kind, count, end.end())
