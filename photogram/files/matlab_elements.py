"""The elements of a MAT file of level 5, checked before a reader of them sees any.

SciPy's compiled reader, on which mat-io stands, looks up the type of numbers without asking whether there is one: a
damaged file ends the process. Format: MATLAB, MAT-File Format, R2023b, chapter "Level 5 MAT-Files".
"""

import struct
import zlib

HEADER_BYTES, LARGEST_BYTES, DEEPEST = 128, 50_000_000, 30
"""Of a file: its header, what it may unpack to, and how deep its arrays lie in one another."""

_NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
_TEXTS = _NUMBERS | {16, 17, 18}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHARACTERS, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMERIC = range(6, 16)
_COMPLEX = 0x0800

Element = tuple[int, bytes]


def is_level_5(data: bytes) -> bool:
    """Return whether SciPy's reader takes a file for one of level 5, whatever its header says in words."""
    if len(data) < HEADER_BYTES or 0 in data[:4]:
        return False
    return data[125 if data[126:127] == b"I" else 124] == 1


def check_elements(data: bytes) -> None:
    """Raise ValueError, in words, where a MAT file of level 5 is damaged."""
    order = {b"IM": "<", b"MI": ">"}.get(data[126:HEADER_BYTES])
    if order is None:
        raise ValueError("its header is damaged")
    left = LARGEST_BYTES
    for kind, content in _elements(data[HEADER_BYTES:], order, padded=False):
        inner = [(kind, content)]
        if kind == _COMPRESSED:
            unpacked = _unpacked(content, left)
            left -= len(unpacked)
            inner = _elements(unpacked, order)
        for each in inner:
            _check_matrix(each, order, 0)


def _unpacked(content: bytes, most: int) -> bytes:
    stream = zlib.decompressobj()
    try:
        unpacked = stream.decompress(content, most)
    except zlib.error as error:
        raise ValueError(f"it cannot be unpacked ({error})") from error
    if not stream.eof:
        raise ValueError(f"it is cut off, or unpacks to more than {LARGEST_BYTES} bytes")
    return unpacked


def _elements(data: bytes, order: str, *, padded: bool = True) -> list[Element]:
    """Return the elements of some bytes: the number of each one's type, and its content."""
    elements, place = list[Element](), 0
    while place < len(data):
        if len(data) - place < 8:
            raise ValueError("it is cut off")
        kind, count = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:
            kind, count, begin, after = kind & 0xFFFF, kind >> 16, place + 4, place + 8
            if count > 4:
                raise ValueError("a short element is longer than 4 bytes")
        else:
            begin = place + 8
            after = begin + (count if kind == _COMPRESSED or not padded else -(-count // 8) * 8)
        if begin + count > len(data):
            raise ValueError("it is cut off")
        elements.append((kind, data[begin : begin + count]))
        place = after
    return elements


def _check_matrix(element: Element, order: str, depth: int) -> None:
    kind, content = element
    if kind != _MATRIX:
        raise ValueError(f"an array is expected, found an element of type {kind}")
    if depth > DEEPEST:
        raise ValueError("its arrays lie too deep in one another")
    if not content:
        return  # an empty array has nothing more
    parts = _elements(content, order)
    if len(parts) < 2 or parts[0][0] != 6 or len(parts[0][1]) < 4:
        raise ValueError("an array has no flags")
    (flags,) = struct.unpack_from(f"{order}I", parts[0][1])
    held = flags & 0xFF
    if held == _OPAQUE:
        for part in parts[1:]:
            if part[0] == _MATRIX:
                _check_matrix(part, order, depth + 1)
            elif part[0] not in _TEXTS:
                raise ValueError(f"an object has an element of type {part[0]}")
        return
    if len(parts) < 3 or parts[1][0] != 5 or parts[2][0] not in (1, 2):
        raise ValueError("an array has no size or no name")
    body = parts[3:]
    if held in _NUMERIC or held == _SPARSE:
        _check_numbers(held, flags, parts[1][1], body, order)
    elif held == _CHARACTERS:
        if len(body) != 1 or body[0][0] not in _TEXTS:
            raise ValueError("a text has no characters")
    elif held in (_CELL, _STRUCT, _OBJECT, _FUNCTION):
        named = {_CELL: 0, _STRUCT: 2, _OBJECT: 3, _FUNCTION: 0}[held]
        if any(part[0] not in _NUMBERS for part in body[:named]):
            raise ValueError("a structure has no names")
        for part in body[named:]:
            _check_matrix(part, order, depth + 1)
    else:
        raise ValueError(f"an array is of class {held}, which there is not")


def _check_numbers(held: int, flags: int, size: bytes, body: list[Element], order: str) -> None:
    """Raise ValueError where an array of numbers is not all there."""
    expected = (2 if held == _SPARSE else 0) + 1 + bool(flags & _COMPLEX)
    if len(body) != expected or any(kind not in _NUMBERS for kind, _ in body):
        raise ValueError("an array of numbers lacks some, or they are of no type")
    sides = struct.unpack(f"{order}{len(size) // 4}i", size[: len(size) // 4 * 4])
    count = 1
    for side in sides:
        count *= side
    if len(sides) < 2 or min(sides) < 0 or count > LARGEST_BYTES:
        raise ValueError(f"an array has the size {sides}")
    widths = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
    if held != _SPARSE and any(len(content) != count * widths[kind] for kind, content in body):
        raise ValueError(f"an array of {count} numbers has another count of them")
