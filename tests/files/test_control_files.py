"""gcp_list.txt and tables of ground points and marks: what is read, and what is refused with its line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from makers import SharedData

from photogram.errors import ControlPointError
from photogram.files.tables.control_files import read_marks, read_points
from photogram.files.tables.point_file import PointFile
from photogram.files.tables.surveyed_points import IMPORTED


def points(tmp_path: Path, text: str, name: str = "points.txt") -> PointFile:
    (tmp_path / name).write_text(text, encoding="utf-8")
    return read_points(tmp_path / name)


def faults(tmp_path: Path, text: str, name: str, reader: object = read_points) -> list[str]:
    """The faults as ``line: message``."""
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ControlPointError) as raised:
        reader(path)  # type: ignore[operator]
    lines = str(raised.value).splitlines()
    assert all(line.startswith(f"{path}:") for line in lines)
    return [line.removeprefix(f"{path}:") for line in lines]


# -- gcp_list.txt -----------------------------------------------------------------------------------------------------


def test_sheffield_as_known(shared_data: SharedData) -> None:
    read = read_points(shared_data("sheffield_cross/gcp_file.txt"))
    assert read.crs == "+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
    assert [p.name for p in read.points] == ["p1", "p2", "p3", "p4", "p5"]
    assert {p.position[2] for p in read.points if p.position is not None} == {3.0}
    assert (len(read.marks), read.holds_marks) == (25, True)
    assert {m.photograph for m in read.marks} == {f"DJI_00{n}.JPG" for n in (65, 66, 67, 68, 81)}
    assert np.bincount([int(m.point[1:]) for m in read.marks]).tolist() == [0, 5, 5, 5, 5, 5]
    assert read.points[3].position == (333208.38, 3102906.46, 3.0)
    assert (read.marks[-1].point, read.marks[-1].pixel, read.marks[-1].source.line) == ("p5", (3458.46, 817.40), 26)


@pytest.mark.parametrize(
    ("header", "crs"),
    [
        ("EPSG:32617", "EPSG:32617"),
        ("epsg:25832", "EPSG:25832"),
        ("WGS84 UTM 17N", "EPSG:32617"),
        ("WGS84 UTM 5S", "EPSG:32705"),
        ("wgs84 utm 32n", "EPSG:32632"),
        ("'+proj=utm +zone=17 +datum=WGS84 +units=m'", "+proj=utm +zone=17 +datum=WGS84 +units=m"),
        ("+proj=longlat +datum=WGS84 # as measured", "+proj=longlat +datum=WGS84"),
    ],
)
def test_header_names_the_crs(tmp_path: Path, header: str, crs: str) -> None:
    assert points(tmp_path, f"# made by hand\n\n{header}\n1 2 3 4 5 a.jpg\n").crs == crs


def test_names_comments_tabs_and_blanks(tmp_path: Path) -> None:
    text = (
        "EPSG:32617\r\n#all in the shade\r\n"
        "1.5\t2\t-3\t10\t20\tmy photo.jpg\tupper corner # not sure\r\n"
        "1.5 2 -3 11 21 b.jpg upper corner\r\n"
        "\r\n7 8 9 12 22 a.jpg\r\n1.5 2.0 -3 13 23 c.jpg\r\n"
        "7 8 9.0 12 22 b.jpg\r\n1 1 1 5 5 a.jpg p1\r\n4 4 4 5 5 a.jpg"
    )
    read = points(tmp_path, text)
    assert [(p.name, p.position, p.line) for p in read.points] == [
        ("upper corner", (1.5, 2.0, -3.0), 3),
        ("p2", (7.0, 8.0, 9.0), 6),
        ("p1", (1.0, 1.0, 1.0), 9),
        ("p3", (4.0, 4.0, 4.0), 10),
    ]
    assert [(m.point, m.photograph) for m in read.marks] == [
        ("upper corner", "my photo.jpg"),
        ("upper corner", "b.jpg"),
        ("p2", "a.jpg"),
        ("upper corner", "c.jpg"),
        ("p2", "b.jpg"),
        ("p1", "a.jpg"),
        ("p3", "a.jpg"),
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("EPSG:32617\n1 2 3 4 a.jpg\n", ["2: 5 fields, expected x y z u v photograph [name]"]),
        ("EPSG:32617\n1 2,5 3 4 5 a.jpg\n", ["2: y must be a number, found '2,5': write 2.5, with a decimal point"]),
        (
            "EPSG:32617\n1 2 nan 4 5 a.jpg\n1 2 3 x 1_0 a.jpg\n",
            [
                "2: z must be a number, found 'nan'",
                "3: u must be a number, found 'x'",
                "3: v must be a number, found '1_0'",
            ],
        ),
        ("EPSG:32617\n", ["1: no points after the first line"]),
        ("# nothing\n\n", ["1: the file is empty: give the file with the points"]),
        (
            "EPSG:32617\n1 2 3 4 5 a.jpg A\n1 2 4 4 5 b.jpg A\n",
            ["3: point A has another position than in line 2: correct it, or give another name"],
        ),
        (
            "EPSG:32617\n1 2 3 4 5 a.jpg A\n1 2 3 9 9 a.jpg\n",
            ["3: point A is marked twice in a.jpg, first in line 2: write their folders if two photographs"],
        ),
        (
            "EPSG:32617\n1 2 3 4 5 a.jpg A\n1 2 3 9 9 a.jpg A\n2 2 3 4 5 b.jpg B\n2 2 3 9 9 b.jpg B\n",
            ["3: point A is marked twice in a.jpg, first in line 2, and so are B in b.jpg (4 and 5): write"],
        ),
        (
            "EPSG:32617\n1 2 3 4 5 a.jpg A\n1 2 3 9 9 b.jpg B\n1 2 3 9 9 c.jpg\n",
            ["4: has no name, and its position is that of A and B: name the point"],
        ),
    ],
)
def test_faults_of_a_gcp_list(tmp_path: Path, text: str, expected: list[str]) -> None:
    found = faults(tmp_path, text, "gcp_list.txt")
    assert len(found) == len(expected), found
    for line, start in zip(found, expected, strict=True):
        assert line.startswith(start)


def test_first_line_without_a_crs_is_data(tmp_path: Path) -> None:
    read = points(tmp_path, "1 2 3 4 5 a.jpg\n")
    assert (read.crs, len(read.points), read.points[0].line) == (None, 1, 1)


def test_hundreds_of_faults_are_not_all_shown(tmp_path: Path) -> None:
    found = faults(tmp_path, "EPSG:32617\n" + "1 2 3\n" * 300, "gcp_list.txt")
    assert len(found) == 21
    assert found[-1] == "22: from this line on 280 more errors: fix those above first"


def test_what_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "photo.txt").write_bytes(b"EPSG:32617\n\xff\xd8\xff\xe0\x00\x10JFIF")
    with pytest.raises(ControlPointError, match=r"photo\.txt:2: byte 0xff is not UTF-8"):
        read_points(tmp_path / "photo.txt")
    with pytest.raises(ControlPointError, match=r"none\.txt:1: cannot be read \(No such file"):
        read_points(tmp_path / "none.txt")


finite = st.floats(-1e7, 1e7)
words = st.text(st.characters(categories=("L", "N"), include_characters="-_.()"), min_size=1, max_size=12)


@given(
    crs=st.sampled_from(["EPSG:25832", "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs"]),
    places=st.dictionaries(words, st.tuples(finite, finite, finite), min_size=1, max_size=5),
    photographs=st.lists(words, min_size=1, max_size=4, unique=True),
    pixels=st.lists(st.tuples(finite, finite), min_size=20, max_size=20),
    separator=st.sampled_from([" ", "\t", "   "]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_round_trip_of_a_gcp_list(
    tmp_path_factory: pytest.TempPathFactory,
    crs: str,
    places: dict[str, tuple[float, float, float]],
    photographs: list[str],
    pixels: list[tuple[float, float]],
    separator: str,
    end: str,
) -> None:
    rows = [(name, photograph) for name in places for photograph in photographs]
    marks = [(*row, pixel) for row, pixel in zip(rows, pixels, strict=False)]
    lines = [crs] + [
        separator.join([*map(repr, places[name]), *map(repr, pixel), photograph, name])
        for name, photograph, pixel in marks
    ]
    path = tmp_path_factory.mktemp("round") / "gcp_list.txt"
    path.write_bytes((end.join(lines) + end).encode())
    read = read_points(path)
    assert read.crs == crs
    assert {p.name: p.position for p in read.points} == places
    assert [(m.point, m.photograph, m.pixel) for m in read.marks] == marks
    assert [m.source.line for m in read.marks] == list(range(2, len(marks) + 2))


@given(text=st.text(st.sampled_from("EPSG:25832 \t\n\r#1234567890.,;-+e\"'ax\0é"), max_size=200), table=st.booleans())
def test_any_text_is_read_or_refused_with_its_line(
    tmp_path_factory: pytest.TempPathFactory, text: str, table: bool
) -> None:
    path = tmp_path_factory.mktemp("any") / ("points.csv" if table else "points.txt")
    path.write_text(("name,x,y,z,sigma\n" if table else "") + text, encoding="utf-8")
    said: list[str] = []
    for reader in (read_points, read_marks):
        try:
            reader(path)
        except ControlPointError as fault:
            said += str(fault).splitlines()
    assert all(line.startswith(f"{path}:") for line in said)


# -- tables -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
def test_table_of_points(tmp_path: Path, separator: str) -> None:
    rows = [
        ["Name", "Easting [m]", "Northing_m", "Height", "sigma", "sigma_plan", "Sigma Height", "role", "code"],
        ["P1", "500000.25", "6.1e6", "-3", "0.05", "0.01", "0.02", "Check", "nail"],
        ['"upper, corner"' if separator[0] == "," else "upper, corner", "1", "2", "3", "0.05", "", "", "", ""],
        ["", "", "", "", "", "", "", "", ""],
        ["P3", "1", "2", "3"],
    ]
    read = points(tmp_path, "\ufeff# list\n" + "\n".join(separator.join(row) for row in rows), "points.csv")
    assert (read.crs, read.geographic, read.holds_marks, read.marks) == (None, False, False, ())
    assert [(p.name, p.position, p.sigma_m, p.role, p.line) for p in read.points] == [
        ("P1", (500000.25, 6.1e6, -3.0), (0.01, 0.01, 0.02), ("check", "check"), 3),
        ("upper, corner", (1.0, 2.0, 3.0), (0.05, 0.05, 0.05), None, 4),
        ("P3", (1.0, 2.0, 3.0), (None, None, None), None, 6),
    ]


@pytest.mark.parametrize(
    ("header", "geographic"),
    [("id,lon,lat,h", True), ("point,Longitude,Latitude,z", True), ("name,x,y,z", None), ("label,e,n,h", False)],
)
def test_columns_by_any_of_their_names(tmp_path: Path, header: str, geographic: bool | None) -> None:
    read = points(tmp_path, f"{header}\nA,12.5,55.8,7\n")  # a .txt: told by its first line
    assert (read.geographic, read.holds_marks, read.points[0].position) == (geographic, False, (12.5, 55.8, 7.0))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "name,easting,northing\nA,1,2\n",
            ["1: no column for height: the first line, or columns in the project file, must name it, as height, h,"],
        ),
        (
            "name,easting,northing,height,sigma_hieght\nA,1,2,3,4\n",
            ["1: unknown column 'sigma_hieght': did you mean 'sigma_height'?"],
        ),
        ("name,x,y,z,sigma_plam\nA,1,2,3,4\n", ["1: unknown column 'sigma_plam': did you mean 'sigma_plan'?"]),
        ("name,x,y,z,elev\nA,1,2,3,4\n", ["2: the columns 'z' and 'elev' differ, and both are names of the height"]),
        ("name;x;y;z\nA;1,512;2;3\n", ["2: 1,512 may be 1.512 or 1512: write the figures of this file with a decimal"]),
        ("name,x,y,z\nA,1,2,3\n\nA,1,2,3\n", ["4: 'A' is used twice, first in line 2: give each point its own name"]),
        ("name,x,y,z\n,1,2,3\n", ["2: the point has no name: give it one"]),
        ("name,x,y,z\nA,1,2,3,4\n", ["2: 5 fields, but the first line names 4: check separators, quotes"]),
        ("name,x,y,z\nA,1\n", ["2: y of A must be a number, found ''", "2: z of A must be a number, found ''"]),
        ("name,x,y,z\n", ["1: no rows after the first line"]),
        (
            "name,x,y,z,sigma\nA,1,2,3,0\n",
            ["2: sigma must be from 1e-05 to 10000, found 0: give the standard deviation"],
        ),
        ("name,x,y,z,role\nA,1,2,3,chek\n", ["2: role must be control or check, found 'chek'"]),
        ("name,x,y,z,role_plan\nA,1,2,3,control\n", ["2: role_height is empty: give both, or one column role"]),
        ("name,x,y,z,role_height\nA,1,2,3,controll\n", ["2: role_height must be control or check, found 'controll'"]),
    ],
)
def test_faults_of_a_table_of_points(tmp_path: Path, text: str, expected: list[str]) -> None:
    found = faults(tmp_path, text, "points.csv")
    assert len(found) == len(expected), found
    for line, start in zip(found, expected, strict=True):
        assert line.startswith(start)


def test_roles_in_plan_and_in_height(tmp_path: Path) -> None:
    text = "name,x,y,z,role,role_plan,role_height\nA,1,2,3,,control,Check\nB,1,2,3,,,\nC,1,2,3,check,,control\n"
    assert [p.role for p in points(tmp_path, text, "points.csv").points] == [
        ("control", "check"), None, ("check", "control"),
    ]  # fmt: skip


def test_table_of_marks(tmp_path: Path) -> None:
    (tmp_path / "marks.csv").write_text("image,point,px,py,sigma_px\na.jpg,A,1.5,2,0.5\nb.jpg,A,3,-4e1,\n")
    first, second = read_marks(tmp_path / "marks.csv")
    assert (first.key, first.pixel, first.sigma_px) == (("A", "a.jpg"), (1.5, 2.0), (0.5, 0.5))
    assert first.source.line == 2
    assert (second.photograph, second.pixel, second.sigma_px) == ("b.jpg", (3.0, -40.0), None)


@pytest.mark.parametrize(
    ("header", "kinds"),
    [
        ("name,photograph,u,v,kind", ["circle", IMPORTED]),
        ("name,photograph,u,v,raw_u,raw_v,kind", ["circle", "raw"]),
        ("name,photograph,u,v,#kind", [IMPORTED, IMPORTED]),
        ("name,photograph,u,v", [IMPORTED, IMPORTED]),
    ],
)
def test_the_kind_of_a_mark_is_what_its_table_says(tmp_path: Path, header: str, kinds: list[str]) -> None:
    """An empty one is a click in photogram's own table, and not known in others."""
    empty = ",," if "raw_u" in header else ""
    rows = [f"A,{n}.jpg,1,2{empty}{kind}" for n, kind in enumerate((",circle", ","))]
    cut = [row if "kind" in header else row.rpartition(",")[0] for row in rows]
    (tmp_path / "marks.csv").write_text("\n".join([header, *cut]) + "\n")
    assert [mark.kind for mark in read_marks(tmp_path / "marks.csv")] == kinds


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "name,photograph,u\nA,a,1\n",
            ["1: no column for v: the first line, or columns in the project file, must name it, as v, y"],
        ),
        ("name,photograph,u,v\nA,,1,2\n", ["2: photograph is empty: say which point is marked, and in which"]),
        ("name,photo,u,v\nA,a,1,b\n", ["2: v must be a number, found 'b'"]),
        ("name,photo,u,v\nA,a,1,2\nB,a,1,2\nA,a,3,4\n", ["4: point A is marked twice in a, first in line 2"]),
        ("name,photo,u,v,sigma\nA,a,1,2,-1\n", ["2: sigma must be from 0.0001 to 1000, found -1"]),
        ("name,photo,u,v,kind\nA,a,1,2,By hand\n", ["2: kind must be a word in lower case, found 'By hand': correct"]),
    ],
)
def test_faults_of_a_table_of_marks(tmp_path: Path, text: str, expected: list[str]) -> None:
    found = faults(tmp_path, text, "marks.csv", read_marks)
    assert len(found) == len(expected), found
    for line, start in zip(found, expected, strict=True):
        assert line.startswith(start)
