"""Files of positions: DJI's MRK, RTKLIB's .pos, tables of PPK programs. All are made here in the documented forms."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.errors import ProjectError
from photogram.files.tables.column_names import POSITIONS as COLUMNS
from photogram.files.tables.position_files import GPS_EPOCH, PositionFile, PositionRow, format_of, gps_time, read_mrk
from photogram.files.tables.position_tables import read_positions, write_positions
from photogram.gnss import Sigma3, Solution
from photogram.project.positions.matching import match_rows, sequence_number

MRK = (
    "3\t505369.172143\t[2364]\t  -339,N\t  -361,E\t   348,V\t"
    "51.10917679,Lat\t-115.38278248,Lon\t1368.634,Ellh\t0.012459, 0.010243, 0.020338\t50,Q\n"
    "4\t505370.496265\t[2364]\t  -359,N\t  -395,E\t   261,V\t"
    "51.10917663,Lat\t-115.38282037,Lon\t1368.367,Ellh\t0.212445, 0.310182, 0.420323\t34,Q\n"
)
POS = """% program   : RTKLIB ver.2.4.3
% obs start : 2024/05/01 09:58:00.0 GPST (week2312 295080.0s)
%
%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio
2024/05/01 10:00:00.250   47.400000000    8.500000000   500.1000   1  14   0.0080   0.0060   0.0150   0.0010   0.0010   0.0010   0.00   12.0
2024/05/01 10:00:02.250   47.400100000    8.500000000   500.2000   2  12   0.2080   0.1060   0.4150   0.0010   0.0010   0.0010   0.00    1.0
2024/05/01 10:00:04.250   47.400200000    8.500000000   500.3000   5   9   2.0000   1.5000   4.0000   0.0010   0.0010   0.0010   0.00    0.0
"""  # noqa: E501 - as RTKLIB writes it


def read(tmp_path: Path, text: str, name: str) -> PositionFile:
    (tmp_path / name).write_text(text, encoding="utf-8")
    return read_positions(tmp_path / name)


def errors(tmp_path: Path, text: str, name: str) -> list[str]:
    """The faults as ``line: message``."""
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ProjectError) as raised:
        read_positions(path)
    lines = str(raised.value).splitlines()
    assert all(line.startswith(f"{path}:") for line in lines)
    return [line.removeprefix(f"{path}:") for line in lines]


# ---- MRK -------------------------------------------------------------------------------------------------------------


def test_an_mrk_line_as_the_manual_says(tmp_path: Path) -> None:
    first, second = read(tmp_path, MRK, "100_0001_Timestamp.MRK").rows
    assert (first.number, first.position) == (3, (-115.38278248, 51.10917679, 1368.634))
    assert first.sigma_m == (0.010243, 0.012459, 0.020338)  # the file has north before east
    assert (first.solution, second.solution) == ("fix", "float")
    # north and east as they are, down to up: the camera is below the antenna
    assert first.lever_arm_m == (-0.361, -0.339, -0.348)
    assert first.gps_time == GPS_EPOCH + timedelta(weeks=2364, seconds=505369.172143)
    assert first.photograph is None


def test_zero_sigmas_are_none_and_separators_vary(tmp_path: Path) -> None:
    text = "1 12.5 [2200] 1,N -2,E 3,V -30.5,Lat 120.25,Lon 100.123,Ellh 0.0, 0.0, 0.0 16,Q\r\n\r\n"
    (row,) = read(tmp_path, text, "a.mrk").rows
    assert (row.sigma_m, row.solution, row.position) == (None, "single", (120.25, -30.5, 100.123))


def test_every_fault_of_an_mrk_is_named_at_once(tmp_path: Path) -> None:
    good = MRK.splitlines()[0]
    bad = [
        good,
        good.replace("51.10917679", "151.1"),
        good.replace("3\t5", "5\t5", 1).replace(",Lat", ""),
        "name,lat,lon",
    ]
    found = errors(tmp_path, "\n".join(bad), "x.MRK")
    assert [f.split(":")[0] for f in found] == ["2", "2", "3", "4"]
    assert any("number 3 is given twice, first in line 1" in f for f in found)
    assert any("are impossible" in f for f in found)
    assert "is not a line of a DJI MRK file" in found[-1]
    assert "the file is empty" in errors(tmp_path, "\n\n", "y.MRK")[0]
    many = errors(tmp_path, "rubbish\n" * 50, "z.MRK")
    assert len(many) == 21
    assert "30 more errors" in many[-1]


@given(
    number=st.integers(1, 9999),
    week=st.integers(1800, 2600),
    seconds=st.floats(0, 604_799),
    arm=st.tuples(*[st.integers(-999, 999)] * 3),
    place=st.tuples(st.floats(-180, 180), st.floats(-90, 90), st.floats(-400, 8000)),
    sigma=st.tuples(*[st.floats(1e-3, 9.0)] * 3),
    flag=st.sampled_from([0, 16, 34, 50, 52]),
)
def test_what_is_written_as_an_mrk_line_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    number: int,
    week: int,
    seconds: float,
    arm: tuple[int, int, int],
    place: tuple[float, float, float],
    sigma: Sigma3,
    flag: int,
) -> None:
    north, east, down = arm
    lon, lat, height = place
    text = (
        f"{number}\t{seconds:.6f}\t[{week}]\t{north:6d},N\t{east:6d},E\t{down:6d},V\t{lat:.8f},Lat\t{lon:.8f},Lon\t"
        f"{height:.3f},Ellh\t{sigma[0]:.6f}, {sigma[1]:.6f}, {sigma[2]:.6f}\t{flag},Q\n"
    )
    path = tmp_path_factory.getbasetemp() / "round_Timestamp.MRK"
    path.write_text(text, encoding="utf-8")
    (row,) = read_mrk(path).rows
    np.testing.assert_allclose(row.position, (lon, lat, height), atol=6e-4)
    np.testing.assert_allclose(row.position[:2], (lon, lat), atol=1e-8)
    assert row.sigma_m is not None
    np.testing.assert_allclose(row.sigma_m, (sigma[1], sigma[0], sigma[2]), atol=1e-6)
    assert row.lever_arm_m == (east / 1000, north / 1000, -down / 1000)
    assert (row.number, row.solution) == (number, {0: "single", 16: "single", 34: "float", 50: "fix", 52: "fix"}[flag])
    assert row.gps_time is not None
    expected = gps_time(week, seconds)
    assert expected is not None
    assert abs((row.gps_time - expected).total_seconds()) < 2e-6


# ---- tables ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "row", "expected"),
    [
        (
            "photo,latitude,longitude,height,sde,sdn,sdu,Q",
            "A.JPG,47.4,8.5,500.1,0.01,0.02,0.03,1",
            PositionRow(2, (8.5, 47.4, 500.1), "A.JPG", sigma_m=(0.01, 0.02, 0.03), solution="fix"),
        ),
        (
            "Image Name;Easting [m];Northing [m];Ellipsoidal height [m];Easting RMS;Northing RMS;Elevation RMS;"
            "Solution status",
            "A.JPG;465000.5;5250000.25;500.1;0.01;0.02;0.03;FLOAT",
            PositionRow(2, (465000.5, 5250000.25, 500.1), "A.JPG", sigma_m=(0.01, 0.02, 0.03), solution="float"),
        ),
        (
            "#name\tlon\tlat\talt\tyaw\tpitch\troll\taccuracy_horz\taccuracy_vert\tfix type",
            "sub/A.JPG\t8.5\t47.4\t500.1\t90\t-2\t1.5\t0.02\t0.04\tFixed integer",
            PositionRow(
                2, (8.5, 47.4, 500.1), "sub/A.JPG", sigma_m=(0.02, 0.02, 0.04), solution="fix",
                attitude_deg=(90.0, -2.0, 1.5),
            ),
        ),
        (
            "Label,X/Longitude,Y/Latitude,Z/Altitude,accuracy,GPS time,RtkFlag,temperature",
            "A.JPG,8.5,47.4,500.1,0.5,2024-05-01 10:00:00.25,34,warm",
            PositionRow(
                2, (8.5, 47.4, 500.1), "A.JPG", gps_time=datetime(2024, 5, 1, 10, 0, 0, 250_000),
                sigma_m=(0.5, 0.5, 0.5), solution="float",
            ),
        ),
        ("file,x,y,z", "A.JPG,465000,5250000,500", PositionRow(2, (465000.0, 5250000.0, 500.0), "A.JPG")),
    ],
)  # fmt: skip
def test_tables_as_ppk_programs_write_them(tmp_path: Path, header: str, row: str, expected: PositionRow) -> None:
    found = read(tmp_path, f"{header}\n{row}\n", "ppk.csv")
    assert found.rows == (expected,)
    assert found.geographic == (abs(expected.position[0]) <= 180)
    assert found.format == "csv"


@pytest.mark.parametrize(
    ("word", "solution"),
    [
        ("1", "fix"), ("2", "float"), ("4", "single"), ("5", "single"), ("6", "float"), ("50", "fix"), ("34", "float"),
        ("16", "single"), ("0", "single"), ("FIX", "fix"), ("rtk float", "float"), ("Single", "single"),
        ("not fixed", "single"), ("no fix", "single"), ("", "unknown"), ("Autonomous", "single"), ("DGPS", "single"),
    ],
)  # fmt: skip
def test_solutions_by_number_and_by_word(tmp_path: Path, word: str, solution: Solution) -> None:
    assert read(tmp_path, f"photo,lon,lat,h,quality\na.jpg,8,47,1,{word}\n", "t.csv").rows[0].solution == solution


def test_faults_of_a_table_are_named_at_once(tmp_path: Path) -> None:
    text = (
        "photo,lon,lat,h,sde,Q\n"
        "a.jpg,8.5,47.4,abc,0.01,1\n"
        ",8.5,47.4,1,0.01,1\n"
        "b.jpg,8.5,97.4,1,-0.01,wobbly\n"
        "c.jpg,8.5,47.4,1,0.01,1,9,9\n"
        'd.jpg,"8,5",47.4,1,0.01,1\n'
    )
    found = errors(tmp_path, text, "t.csv")
    assert [f.split(":")[0] for f in found] == ["2", "3", "4", "4", "4", "5", "6"]
    for part in (
        "'abc'",
        "has no photograph",
        "must not be below 0",
        "impossible",
        "'wobbly'",
        "8 fields",
        "write 8.5",
    ):
        assert any(part in f for f in found), part


def test_columns_that_are_missing_are_all_named(tmp_path: Path) -> None:
    found = errors(tmp_path, "photo,where\n1,2\n", "t.csv")
    assert len(found) == 1
    assert "no line names its columns, and 'photo,where' does not tell them" in found[0]
    found = errors(tmp_path, "photo,lon,q\n1,2,3\n", "t.csv")
    assert len(found) == 2
    assert "longitude and latitude, or easting and northing" in found[0] + found[1]
    assert "no rows" in errors(tmp_path, "photo,lon,lat,h\n", "t.csv")[0]


@given(
    st.lists(
        st.tuples(st.floats(-180, 180), st.floats(-90, 90), st.floats(-400, 8000), st.floats(1e-3, 10)),
        min_size=1, max_size=8,
    ),
    st.sampled_from([",", ";", "\t"]),
    st.sampled_from(COLUMNS["height"][:4]),
)  # fmt: skip
def test_what_is_written_as_a_table_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[float, float, float, float]],
    separator: str,
    height: str,
) -> None:
    lines = [separator.join(("photo", "lon", "lat", height, "sigma"))]
    lines += [separator.join((f"p{i}.jpg", *(repr(v) for v in row))) for i, row in enumerate(rows)]
    path = tmp_path_factory.getbasetemp() / "round.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    found = read_positions(path)
    assert [r.position for r in found.rows] == [row[:3] for row in rows]
    assert [r.sigma_m for r in found.rows] == [(row[3],) * 3 for row in rows]
    assert [r.photograph for r in found.rows] == [f"p{i}.jpg" for i in range(len(rows))]


# ---- RTKLIB ----------------------------------------------------------------------------------------------------------


def test_rtklib_events(tmp_path: Path) -> None:
    found = read(tmp_path, POS, "flight_events.pos")
    assert (found.format, found.geographic) == ("pos", True)
    assert [r.solution for r in found.rows] == ["fix", "float", "single"]
    assert found.rows[0].sigma_m == (0.006, 0.008, 0.015)
    assert found.rows[0].position == (8.5, 47.4, 500.1)
    assert found.rows[1].gps_time == datetime(2024, 5, 1, 10, 0, 2, 250_000)
    weeks = POS.replace("2024/05/01 10:00:0", "2312 29520").replace("2952004.250", "295204.25")
    assert read(tmp_path, weeks, "w.pos").rows[0].gps_time is not None


def test_rtklib_in_other_coordinates_is_refused(tmp_path: Path) -> None:
    text = "%  GPST  x-ecef(m) y-ecef(m) z-ecef(m) Q\n2024/05/01 10:00:00 4 5 6 1\n"
    assert "choose latitude, longitude and height" in errors(tmp_path, text, "e.pos")[0]


# ---- which photograph ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("100_0001_0023.JPG", 23),
        ("DJI_20240501101500_0001_V.JPG", 1),
        ("DJI_20240501101500_0107_D_site1234.JPG", 107),
        ("flight/DJI_0042.JPG", 42),
        ("DSC01234.ARW", 1234),
        ("picture.jpg", None),
        ("a1.jpg", None),
    ],
)
def test_numbers_in_names(name: str, number: int | None) -> None:
    assert sequence_number(name) == number


def mrk_of(name: str, *numbers: int) -> PositionFile:
    return PositionFile(Path(name), "mrk", True, tuple(PositionRow(k, (8.0, 47.0, 1.0), number=k) for k in numbers))


def table_of(*names: str) -> PositionFile:
    rows = tuple(PositionRow(i, (8.0, 47.0, 1.0), name) for i, name in enumerate(names, 2))
    return PositionFile(Path("t.csv"), "csv", True, rows)


def test_an_mrk_takes_the_photographs_that_begin_as_it_does() -> None:
    names = ["100_0001_0001.JPG", "100_0001_0002.JPG", "100_0002_0001.JPG"]
    found = match_rows(mrk_of("100_0001_Timestamp.MRK", 1, 2, 3), names)
    assert set(found.rows) == set(names[:2])
    assert [row.number for row in found.unmatched] == [3]
    later = match_rows(mrk_of("DJI_202405011015_001_Timestamp.MRK", 1, 2), ["DJI_20240501101501_0002_V.JPG"])
    assert {n: r.number for n, r in later.rows.items()} == {"DJI_20240501101501_0002_V.JPG": 2}


def test_names_match_whatever_their_folder_case_and_suffix_where_only_one_fits() -> None:
    found = match_rows(
        table_of("C:\\flight\\IMG_1.jpg", "img_2", "IMG_3.DNG", "other.jpg"), ["a/IMG_1.JPG", "IMG_2.JPG"]
    )
    assert {n: r.line for n, r in found.rows.items()} == {"a/IMG_1.JPG": 2, "IMG_2.JPG": 3}
    assert [row.photograph for row in found.unmatched] == ["IMG_3.DNG", "other.jpg"]
    # two folders have one of that name: the bare name says neither
    assert "none of its 1 photographs" in match_rows(table_of("IMG_1.JPG"), ["a/IMG_1.JPG", "b/IMG_1.JPG"]).error


def test_what_cannot_be_matched_says_which() -> None:
    assert "100 to 101" in match_rows(mrk_of("x.MRK", 100, 101), ["DJI_0001.JPG"]).error
    assert "DJI_0001.JPG" in match_rows(mrk_of("x.MRK", 100, 101), ["DJI_0001.JPG"]).error
    assert "(a.jpg)" in match_rows(table_of("a.jpg"), ["DJI_0001.JPG"]).error
    assert "lines 2 and 3" in match_rows(table_of("a.jpg", "a.jpg"), ["a.jpg"]).error
    pos = PositionFile(Path("e.pos"), "pos", True, tuple(PositionRow(k, (8.0, 47.0, 1.0)) for k in (5, 6)))
    assert {n: r.line for n, r in match_rows(pos, ["b.jpg", "a.jpg"]).rows.items()} == {"a.jpg": 5, "b.jpg": 6}
    assert "2 positions for 1 photographs" in match_rows(pos, ["a.jpg"]).error


def test_formats_by_name() -> None:
    assert [format_of(Path(n)) for n in ("a.MRK", "b.pos", "c.csv", "d.txt")] == ["mrk", "pos", "csv", "csv"]


@pytest.mark.parametrize("geographic", [False, True])
def test_written_positions_are_read_back_with_every_digit(tmp_path: Path, geographic: bool) -> None:
    given = {
        "a/IMG 1.JPG": (np.array([8.1 + 1 / 3, 50.2, 118.123456789]), np.array([0.01, 0.02, 0.03])),
        'pole, "north".JPG': (np.array([-7.5, 1e-7, -3.0]), None),
    }
    write_positions(tmp_path / "positions.csv", given, geographic=geographic)
    found = read_positions(tmp_path / "positions.csv")
    assert found.geographic is geographic
    for row, (name, (position, sigma)) in zip(found.rows, given.items(), strict=True):
        assert (row.photograph, row.position) == (name, tuple(position))
        assert row.sigma_m == (None if sigma is None else tuple(sigma))


def test_units_in_the_header_are_those_of_positions_and_sigmas(tmp_path: Path) -> None:
    path = tmp_path / "positions.csv"
    path.write_text(
        "photo,latitude,longitude,altitude(feet),sigma_plan (cm),sigma_height [mm]\na.jpg,52,10,1000,2,35\n"
    )
    file = read_positions(path)
    assert file.unit_m == (None, None, 0.3048)
    assert file.rows[0].position == (10.0, 52.0, 1000.0)
    assert file.rows[0].sigma_m == pytest.approx((0.02, 0.02, 0.035))
