"""Velocities in the tags of drones: XMP, DJI's maker note, and what is none."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.files.photographs.velocities import velocity_of

XMP = {"FlightXSpeed": "+3.40", "FlightYSpeed": "-0.10", "FlightZSpeed": "+0.00"}


def maker_note(speeds: dict[int, float], maker: bytes = b"DJI\0", kind: int = 11) -> bytes:
    entries = [(1, 2, 4, maker)] + [(tag, kind, 1, struct.pack("<f", speed)) for tag, speed in speeds.items()]
    return struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHI4s", *entry) for entry in entries) + b"\0" * 9


def test_north_east_and_down_come_from_xmp_before_the_maker_note() -> None:
    assert velocity_of(XMP, maker_note({3: 1.0, 4: 2.0, 5: 3.0})) == (3.4, -0.1, 0.0)
    assert velocity_of({}, maker_note({3: 0.3, 4: -0.4, 5: 0.1})) == (0.3, -0.4, 0.1)


@pytest.mark.parametrize(
    ("xmp", "note"),
    [
        ({}, None),
        ({}, b""),
        ({}, b"Nikon\0\2\0"),
        ({"FlightXSpeed": "fast"}, None),
        ({**XMP, "FlightYSpeed": "1e9"}, None),
        ({**XMP, "FlightYSpeed": "nan"}, None),
        ({}, maker_note({3: 0.3, 4: 0.4})),
        ({}, maker_note({3: 0.3, 4: 0.4, 5: float("inf")})),
        ({}, maker_note({3: 0.3, 4: 0.4, 5: 0.1}, b"APP\0")),
        ({}, maker_note({3: 0.3, 4: 0.4, 5: 0.1}, kind=4)),
    ],
)
def test_what_is_no_velocity_is_none(xmp: dict[str, str], note: object) -> None:
    assert velocity_of(xmp, note) is None


@given(note=st.binary(max_size=200))
def test_any_maker_note_is_read_or_none(note: bytes) -> None:
    found = velocity_of({}, note)
    assert found is None or len(found) == 3
