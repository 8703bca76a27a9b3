"""How tables are written: headers, separators, units, remarks, found out from their text."""

import time
from pathlib import Path

import pytest

from photogram.errors import ControlPointError
from photogram.files.tables.column_names import MARKS, POINTS
from photogram.files.tables.control_files import read_points
from photogram.files.tables.layout import layout_of, separator_of, unnamed_columns


def lines(text: str) -> list[tuple[int, str]]:
    return [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]


@pytest.mark.parametrize("separator", [";", "\t", ",", "|", " "])
@pytest.mark.parametrize("before", ["", "# exported 2026\n", "Project: North\n\n", "# by a program\n# 2026\n"])
@pytest.mark.parametrize("mark", ["", "#", "# ", "%"])
def test_the_header_is_found(separator: str, before: str, mark: str) -> None:
    text = before + mark + separator.join(("Point", "Easting", "Northing", "Elevation"))
    rows = [separator.join((f"P{n}", "720123.4", "6192345.6", "34.5")) for n in range(3)]
    layout = layout_of(lines("\n".join((text, *rows))), POINTS)
    assert (layout.names, layout.separator) == (("Point", "Easting", "Northing", "Elevation"), separator)
    assert layout.line == len(before.splitlines()) + 1
    assert [line for _, line in layout.body] == rows


def test_a_line_of_units_belongs_to_the_header() -> None:
    layout = layout_of(lines("name,east,north,height\n,[m],[m],[ft]\nA,1,2,3\n"), POINTS)
    assert layout.names == ("name", "east (m)", "north (m)", "height (ft)")
    assert len(layout.body) == 1


def test_columns_of_the_project_stand_in_place_of_a_line_of_words() -> None:
    columns = ("name", "northing", "easting", "height")
    named = layout_of(lines("alfa,beta,gamma,delta\nA,1,2,3\n"), POINTS, columns)
    bare = layout_of(lines("A,1,2,3\n"), POINTS, columns)
    assert named.names == bare.names == columns
    assert [line for _, line in named.body] == [line for _, line in bare.body] == ["A,1,2,3"]


@pytest.mark.parametrize(
    ("row", "separator"),
    [
        ("P 1,720123.4,6192345.6,34", ","), ("P 1;720123,4;6192345,6;34,1", ";"), ("P 1\t7,4\t6,6\t3,1", "\t"),
        ("P1 7 6 3", " "),
    ],
)  # fmt: skip
def test_blanks_in_names_and_decimal_commas_separate_nothing(row: str, separator: str) -> None:
    assert separator_of([(1, row)] * 3) == separator


def test_rows_that_nothing_names() -> None:
    layout = layout_of(lines("P1,6192345.6,720123.4,34.5,nail\n"), POINTS)
    assert unnamed_columns(layout, POINTS) == ("name", "x", "y", "height", "description")
    assert unnamed_columns(layout, MARKS) == (), "marks have no form that is understood without names"
    assert unnamed_columns(layout_of(lines("P1,6192345.6,nail\n"), POINTS), POINTS) == ()
    assert unnamed_columns(layout_of(lines("P1,1,2,3,4\n"), POINTS), POINTS) == (), "a fourth figure may be anything"


LONG = ("9" * 200_000 + "x", "[" * 200_000, "9" * 100_000 + " " + "9" * 100_000, "1 " * 100_000)


@pytest.mark.parametrize("cell", LONG, ids=["digits", "brackets", "groups", "blanks"])
def test_a_cell_of_any_length_is_told_at_once(tmp_path: Path, cell: str) -> None:
    path, start = tmp_path / "points.csv", time.process_time()
    for text in (
        f"name,easting,northing,height\nP1,719970.7,6191955.2,69.6\n{cell},719970.7,6191955.2,{cell}\n",
        f"{cell},easting,northing,height\nP1,719970.7,6191955.2,69.6\n",
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ControlPointError) as refused:
            read_points(path)
        assert max(map(len, str(refused.value).splitlines())) < 1000
    assert time.process_time() - start < 3.0  # it took minutes
