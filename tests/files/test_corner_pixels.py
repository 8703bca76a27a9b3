"""Half a pixel added and taken off, exactly."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.files.marks.corner_pixels import from_corner, to_corner


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_round_trip(value: float) -> None:
    assert from_corner(to_corner(value)) == value


@given(value=st.floats(-1e9, 1e9))
def test_half_a_pixel_is_taken_off_with_one_rounding(value: float) -> None:
    assert from_corner(repr(value)) == float(Fraction(repr(value)) - Fraction(1, 2))


@pytest.mark.parametrize(
    ("text", "expected"),
    [("0.5", 0.0), ("0", -0.5), ("1e400", float("inf")), ("1e-999999999999999999999", -0.5), ("4000.1", 3999.6)],
)
def test_single_values(text: str, expected: float) -> None:
    assert from_corner(text) == expected
