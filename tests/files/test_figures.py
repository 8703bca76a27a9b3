"""Figures of tables: decimal commas, groups of thousands, degrees with minutes and seconds."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.files.tables.figures import Mark, decimal_mark, degrees_of, in_plain_form


@pytest.mark.parametrize(
    ("cells", "mark"),
    [
        (["1.5", "2"], "point"),
        (["720123,5", "6192345,25"], "comma"),
        (["1.234,5", "2"], "comma"),
        (["1,234.5"], "point"),
        (["1,234"], "unclear"),
        (["1,234", "0.5"], "point"),
        (["1,234", "0,5"], "comma"),
        (["12°30'44,7\"", "36,154"], "comma"),
        (["12", "abc", ""], "point"),
    ],
)
def test_the_decimal_mark_is_that_of_all_figures(cells: list[str], mark: Mark) -> None:
    assert decimal_mark(cells) == mark


@pytest.mark.parametrize(
    ("cell", "mark", "plain"),
    [
        ("1,5", "comma", "1.5"),
        ("1.234,5", "comma", "1234.5"),
        ("1,234.5", "point", "1234.5"),
        ("6'192'345.25", "point", "6192345.25"),
        ("6 192 345,25", "comma", "6192345.25"),
        ("6\u202f192\u202f345", "point", "6192345"),
        ("1,5", "point", "1,5"),
        ("nail", "comma", "nail"),
        ("IMG_1,2", "comma", "IMG_1,2"),
    ],
)
def test_figures_in_plain_form(cell: str, mark: Mark, plain: str) -> None:
    assert in_plain_form(cell, mark) == plain


@given(value=st.floats(-1e7, 1e7), mark=st.sampled_from(["point", "comma"]), gap=st.sampled_from(["", ",", "'", " "]))
def test_what_is_written_in_groups_is_read_back(value: float, mark: Mark, gap: str) -> None:
    text = f"{value:,.3f}".replace(",", "\0").replace(".", "," if mark == "comma" else ".")
    text = text.replace("\0", {",": "." if mark == "comma" else ","}.get(gap, gap))
    assert math.isclose(float(in_plain_form(text, mark)), value, abs_tol=0.0006)


@pytest.mark.parametrize(
    ("cell", "degrees"),
    [
        ("12°30'36\"", 12.51),
        ("12°30'36\"W", -12.51),
        ("S 12 30 36", -12.51),
        ("-12:30:36", -12.51),
        ("12d30m36s", 12.51),
        ("12° 30.6'", 12.51),
        ("12.51 N", 12.51),
        ("W12,51", -12.51),
        ("12.51°", 12.51),
    ],
)
def test_angles(cell: str, degrees: float) -> None:
    assert float(degrees_of(cell)) == pytest.approx(degrees, abs=1e-12)


@pytest.mark.parametrize("cell", ["12°61'00\"", "12,51", "720,123", "12.51 O", "N 12.51 W", "-12.51 S", "nail", ""])
def test_what_is_no_angle_or_may_mean_two_is_left_as_it_is(cell: str) -> None:
    assert degrees_of(cell) == cell
