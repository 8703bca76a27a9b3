"""Rows of tables by the quantities of their columns, and what is said of columns that are not known."""

from pathlib import Path

import pytest

from photogram.errors import ControlPointError
from photogram.files.tables.column_names import POINTS
from photogram.files.tables.table import Table, read_table


def table(text: str, needed: tuple[str, ...] = ("name",), columns: tuple[str, ...] | None = None) -> Table:
    lines = list(enumerate(text.splitlines(), 1))
    return read_table(Path("t.csv"), lines, ControlPointError, POINTS, needed, columns=columns)


def test_the_first_of_several_names_counts() -> None:
    read = table("name,x,easting,northing,y,h\nA,1,1,2,2,3\n")
    assert [row["easting"] for _, row in read.rows] == ["1"]
    assert read.columns["height"] == "h"


def test_columns_that_are_not_known_are_noted_and_a_slip_of_the_pen_is_an_error() -> None:
    assert "crew" in table("name,e,n,h,crew\nA,1,2,3,4\n").notes[0].text
    assert table("name,e,n,h,code\nA,1,2,3,4\n").notes == ()
    with pytest.raises(ControlPointError, match="unknown column 'nothing': did you mean 'northing'"):
        table("name,e,nothing,h\nA,1,2,3\n")


def test_units() -> None:
    read = table("name,easting (ft),northing [US survey feet],h\nA,1,2,3\n")
    assert read.units_m(("easting", "northing", "height")) == (0.3048, 1200 / 3937, None)
    with pytest.raises(ControlPointError, match=r"t.csv:1: the unit 'chains' of 'h \(chains\)' is not read"):
        table("name,e,n,h (chains)\nA,1,2,3\n")


def test_rivals_that_differ_are_an_error_and_equal_ones_are_not() -> None:
    read = table("name,e,n,h,elevation\nA,1,2,3,3\n")
    read.errors.raise_all()
    read = table("name,e,n,h,elevation\nA,1,2,3,4\n")
    with pytest.raises(ControlPointError, match=r"t\.csv:2: the columns 'h' and 'elevation' differ"):
        read.errors.raise_all()


def test_columns_that_are_given() -> None:
    read = table("A 10 20 30\nB 11 21 31\n", columns=("name", "northing", "easting", "height"))
    assert [(row["easting"], row["northing"]) for _, row in read.rows] == [("20", "10"), ("21", "11")]
    with pytest.raises(ControlPointError, match="no column for name: the first line, or columns in the project file"):
        table("A 10 20 30\n", columns=("-", "northing", "easting", "height"))
