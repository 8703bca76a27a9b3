"""The velocity of the aircraft at the exposure, as DJI's photographs have it: in XMP, or in the maker note."""

import math
import struct
from collections.abc import Mapping

FASTEST_M_S = 100.0
"""Speed along an axis beyond which a figure is none."""

_XMP = ("FlightXSpeed", "FlightYSpeed", "FlightZSpeed")
_SPEEDS = (3, 4, 5)
_FLOAT = 11  # TIFF 6.0, type of an entry
_ENTRY = struct.Struct("<HHI4s")

Velocity = tuple[float, float, float]


def velocity_of(xmp: Mapping[str, str], maker_note: object) -> Velocity | None:
    """Return the velocity over ground along north, east and down, m/s to 0.1, None where there is none.

    ``xmp`` are the properties by name, ``maker_note`` the bytes of EXIF's tag 37500. Their axes were told from
    photographs whose flights are known: X points north, Y east, whatever the heading.
    """
    try:
        return _believed([float(xmp[name]) for name in _XMP])
    except (KeyError, ValueError):
        return _of_maker_note(maker_note) if isinstance(maker_note, bytes) else None


def _of_maker_note(note: bytes) -> Velocity | None:
    """Return the velocity of a maker note of DJI, a little-endian TIFF directory without a header: tags 3, 4 and 5."""
    count = int.from_bytes(note[:2], "little")
    if len(note) < 2 + count * _ENTRY.size:
        return None
    entries = {tag: (kind, n, value) for tag, kind, n, value in _ENTRY.iter_unpack(note[2 : 2 + count * _ENTRY.size])}
    if entries.get(1, (0, 0, b""))[2] != b"DJI\0":
        return None
    own = [entries.get(tag) for tag in _SPEEDS]
    speeds = [struct.unpack("<f", e[2])[0] for e in own if e is not None and e[:2] == (_FLOAT, 1)]
    return _believed(speeds) if len(speeds) == len(_SPEEDS) else None


def _believed(speeds: list[float]) -> Velocity | None:
    north, east, down = (round(speed, 3) for speed in speeds)
    good = all(math.isfinite(speed) and abs(speed) <= FASTEST_M_S for speed in (north, east, down))
    return (north, east, down) if good else None
