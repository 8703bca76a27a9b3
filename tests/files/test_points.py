from datetime import date
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from makers import SharedData

from photogram.errors import FrameError, ProjectError, WorkspaceError
from photogram.files.clouds.points import read_cloud, write_laz, write_xyz
from photogram.survey import PointCloud

CRS = "EPSG:25832"


def cloud(points: int = 500, colour: bool = True, sigma: bool = True) -> PointCloud:
    rng = np.random.default_rng(3)
    position = np.array([719_900.0, 6_191_900.0, 60.0]) + rng.uniform(0, 1, (points, 3)) * [120.0, 90.0, 20.0]
    return PointCloud(
        position,
        rng.integers(0, 256, (points, 3)).astype(np.uint8) if colour else None,
        rng.uniform(0.005, 0.3, (points, 3)) if sigma else None,
    )


def text(tmp_path: Path, content: str, suffix: str = ".txt") -> Path:
    path = tmp_path / f"cloud{suffix}"
    path.write_text(content, encoding="utf-8")
    return path


def test_xyz_text_is_three_numbers_with_commas(tmp_path: Path) -> None:
    path = tmp_path / "points.txt"
    write_xyz(path, PointCloud(np.array([[719980.0821, 6191940.1, 69.5674], [1.0, -2.5, 0.0005]])))
    assert path.read_bytes() == b"719980.082,6191940.100,69.567\n1.000,-2.500,0.001\n"
    assert list(tmp_path.iterdir()) == [path]


def test_xyz_survives_to_the_millimetre(tmp_path: Path) -> None:
    write_xyz(tmp_path / "points.txt", cloud())
    back = read_cloud(tmp_path / "points.txt")
    assert np.abs(back.position_map_m - cloud().position_map_m).max() <= 0.0005 + 1e-9
    assert back.colour is None
    assert back.sigma_m is None


@pytest.mark.parametrize("colour", [True, False])
@pytest.mark.parametrize("sigma", [True, False])
def test_laz_survives_to_the_millimetre(tmp_path: Path, colour: bool, sigma: bool) -> None:
    points, path = cloud(colour=colour, sigma=sigma), tmp_path / "points.laz"
    write_laz(path, points, CRS)
    back = read_cloud(path)
    assert np.abs(back.position_map_m - points.position_map_m).max() <= 0.0005 + 1e-9
    for field in ("colour", "sigma_m"):
        ours, theirs = getattr(points, field), getattr(back, field)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_allclose(theirs, ours, rtol=1e-7)
    assert list(tmp_path.iterdir()) == [path]


def test_laz_header_says_what_other_programs_ask(tmp_path: Path) -> None:
    write_laz(tmp_path / "points.laz", cloud(), CRS, date(2019, 5, 9))
    with laspy.open(tmp_path / "points.laz") as reader:
        header, points = reader.header, reader.read()
    assert str(header.version) == "1.4"
    assert header.point_format.id == 7
    assert header.are_points_compressed
    assert header.creation_date == date(2019, 5, 9)
    assert header.global_encoding.wkt
    crs = header.parse_crs()
    assert crs is not None
    assert crs.to_epsg() == 25832
    assert header.vlrs.get("WktCoordinateSystemVlr")[0].string.startswith("PROJCS[")
    np.testing.assert_array_equal(header.scales, 0.001)
    assert list(header.point_format.extra_dimension_names) == ["sigma x", "sigma y", "sigma xy", "sigma z"]
    sigma = cloud().sigma_m
    assert sigma is not None
    np.testing.assert_allclose(points["sigma xy"], np.hypot(sigma[:, 0], sigma[:, 1]), rtol=1e-6)
    np.testing.assert_allclose(points["sigma z"], sigma[:, 2], rtol=1e-6)
    described = {d.name: (d.dtype, d.description) for d in header.point_format.extra_dimensions}
    assert described["sigma xy"] == (np.float32, "st. deviation in plan [m]")
    assert described["sigma z"] == (np.float32, "st. deviation in height [m]")
    np.testing.assert_allclose(header.mins, cloud().position_map_m.min(axis=0), atol=0.0006)
    assert points.return_number.min() == points.number_of_returns.min() == 1
    assert points.red.max() == 257 * int(cloud().colour[:, 0].max())  # type: ignore[index]


def test_same_cloud_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.laz", "b.laz"):
        write_laz(tmp_path / name, cloud(), CRS)
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()


def test_eight_bit_colours_in_las_are_taken_as_they_are(tmp_path: Path) -> None:
    las = laspy.create(point_format=2, file_version="1.2")
    las.x, las.y, las.z = np.arange(9.0).reshape(3, 3)
    las.red, las.green, las.blue = np.array([[0, 128, 255], [1, 2, 3], [9, 8, 7]], np.uint16)
    las.write(tmp_path / "old.las")
    back = read_cloud(tmp_path / "old.las")
    np.testing.assert_array_equal(back.colour, [[0, 1, 9], [128, 2, 8], [255, 3, 7]])
    np.testing.assert_allclose(back.position_map_m, np.arange(9.0).reshape(3, 3).T, atol=0.006)


EXPECTED = [[719980.082, 6191940.162, 69.567], [719989.659, 6191933.783, -1.5]]


@pytest.mark.parametrize(
    "content",
    [
        "719980.082,6191940.162,69.567\n719989.659,6191933.783,-1.5\n",
        "719980.082, 6191940.162, 69.567\r\n719989.659, 6191933.783, -1.5",
        "719980.082;6191940.162;69.567\n719989.659;6191933.783;-1.5\n",
        "719980.082\t6191940.162\t69.567\n719989.659\t6191933.783\t-1.5\n",
        "  719980.082   6191940.162 69.567 \n\n 719989.659 6191933.783 -1.5e0\n\n",
        "\ufeff# made by hand\n719980.082 6191940.162 69.567 # first, of two\n# between\n719989.659 6191933.783 -1.5\n",
        "//X Y Z\n719980.082 6191940.162 69.567\n719989.659 6191933.783 -1.5\n",
        "x,y,z\n719980.082,6191940.162,69.567\n719989.659,6191933.783,-1.5\n",
        "Easting[m] Northing[m] Height[m]\n719980.082,6191940.162,69.567\n719989.659,6191933.783,-1.5\n",
        'name;height_m;"northing_m";easting_m\na;69.567;6191940.162;719980.082\nb;-1.5;6191933.783;719989.659\n',
        "719980.082 6191940.162 69.567 0.25 17 0\n719989.659 6191933.783 -1.5 0.25 18 300\n",
        "719980.082 6191940.162 69.567 rock a b\n719989.659 6191933.783 -1.5 sand a b\n",
    ],
)
def test_text_of_every_layout_is_read(tmp_path: Path, content: str) -> None:
    back = read_cloud(text(tmp_path, content))
    np.testing.assert_array_equal(back.position_map_m, EXPECTED)
    assert back.colour is None


@pytest.mark.parametrize(
    ("content", "suffix"),
    [
        ("1 2 3 255 0 7\n4 5 6 10 11 12\n", ".xyz"),
        ("1,2,3,255,0,7,0.1,0.2,1\n4,5,6,10,11,12,0.1,0.2,1\n", ".csv"),
        ("R;G;B;X;Y;Z\n255;0;7;1;2;3\n10;11;12;4;5;6\n", ".TXT"),
    ],
)
def test_colours_in_text_are_read(tmp_path: Path, content: str, suffix: str) -> None:
    back = read_cloud(text(tmp_path, content, suffix))
    np.testing.assert_array_equal(back.position_map_m, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(back.colour, [[255, 0, 7], [10, 11, 12]])


@given(
    st.lists(st.tuples(*[st.floats(-1e7, 1e7)] * 3), min_size=1, max_size=20), st.sampled_from([",", " ", ";", "\t"])
)
def test_text_round_trip(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]], separator: str
) -> None:
    lines = "".join(separator.join(map(repr, row)) + "\n" for row in rows)
    back = read_cloud(text(tmp_path_factory.mktemp("text"), lines))
    np.testing.assert_array_equal(back.position_map_m, rows)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "contains no points"),
        ("# nothing\n\n", "contains no points"),
        ("x y z\n\n", "contains no points, only a header"),
        ("1 2 3\n\n# note\n4 five 6\n", "line 4: '4 five 6' is not a point"),
        ("1 2 3\n4 5\n", "line 2: '4 5' is not a point, expected at least 3 numbers"),
        ("1,2\n3,4\n", "line 1: '1,2' is not a point"),
        ("2\n1 2 3\n4 5 6\n", "line 1: '2' is not a point"),
        ("1 2 3\n4 nan 6\n", "line 2: '4 nan 6' is not a point"),
        ("1;2;3\n4;5,5;6\n", "line 2: '4;5,5;6' is not a point.*decimal point"),
        ("# x y z\nP1 1 2 3\n", "line 2: 'P1 1 2 3' is not a point"),
        ("name a b\n1 2 3\n", "line 1: no column x, y, z in 'name a b'"),
        ("lat lon height\n1 2 3\n", "line 1: no column x, y in"),
        ("1 2 3 4 5 6\n1 2 3\n", "line 2: '1 2 3' is not a point, expected at least 6"),
    ],
)
def test_text_that_is_no_cloud_is_refused(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(ProjectError, match=rf"cloud\.txt.*{message}"):
        read_cloud(text(tmp_path, content))


def test_nonsense_far_down_is_found(tmp_path: Path) -> None:
    lines = ["1.0 2.0 3.0"] * 5000
    lines[4321] = "1.0 2.0 \xff"
    path = tmp_path / "cloud.txt"
    path.write_text("\n".join(lines), encoding="latin-1")
    with pytest.raises(ProjectError, match="line 4322"):
        read_cloud(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"cloud\.ply: photogram reads .txt .csv .xyz .las .laz, not \.ply"):
        read_cloud(tmp_path / "cloud.ply")
    for name in ("gone.txt", "gone.laz"):
        with pytest.raises(ProjectError, match="file not found"):
            read_cloud(tmp_path / name)
    binary = tmp_path / "binary.txt"
    binary.write_bytes(bytes(range(256)))
    with pytest.raises(ProjectError, match="not UTF-8 text"):
        read_cloud(binary)


def test_damaged_laz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.laz"
    write_laz(path, cloud(), CRS)
    whole = path.read_bytes()
    for kept in (0, 50, 300, 1500, len(whole) // 2, len(whole) - 100):
        path.write_bytes(whole[:kept])
        with pytest.raises(ProjectError, match=r"points\.laz: (cannot be read|damaged or truncated)"):
            read_cloud(path)
    write_laz(path, PointCloud(np.zeros((0, 3))), CRS)
    with pytest.raises(ProjectError, match="contains no points"):
        read_cloud(path)


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "points.laz"
    with pytest.raises(FrameError, match="not a projected CRS"):
        write_laz(path, cloud(), "EPSG:4326")
    with pytest.raises(ValueError, match="does not fit LAZ"):
        write_laz(path, PointCloud(np.array([[0.0, 0, 0], [5e6, 0, 0]])), CRS)
    for write in (write_xyz, lambda p, c: write_laz(p, c, CRS)):
        with pytest.raises(ValueError, match="non-finite"):
            write(path, PointCloud(np.array([[0.0, np.nan, 0]])))
        with pytest.raises(WorkspaceError, match="cannot be written"):
            write(tmp_path / "nowhere" / "points", cloud())
    assert list(tmp_path.iterdir()) == []


def test_real_clouds_are_read(shared_data: SharedData) -> None:
    names = "dtu_phantom4/points_agisoft.txt", "brighton_beach/model.laz"
    survey, beach = (read_cloud(shared_data(name)) for name in names)
    assert len(survey) == 93_763
    np.testing.assert_array_equal(survey.position_map_m[0], [719980.082, 6191940.162, 69.567])
    assert len(beach) == 940_393
    assert beach.colour is not None
    assert beach.colour.max() == 255
