"""What readers of other programs' files have in common: numbers, names, paths, rotations, cameras, order."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from foreign import small_solution

from photogram.errors import ExchangeError
from photogram.files.exchange import parsing
from photogram.files.exchange.solution import ForeignPhotograph


@pytest.mark.parametrize("text", ["", "nan", "inf", "1e400", "1 2", "1,5", "x", "0x10"])
def test_what_is_no_finite_number_is_refused(text: str) -> None:
    with pytest.raises(ExchangeError, match=r"^a\.txt:3: width must be a finite number"):
        parsing.number_of(text, "width", "a.txt:3")


@pytest.mark.parametrize("text", ["", "/", "a/..", "..", ".", "a\0b", "x" * 300, "a/b\n", "\x1b[2J"])
def test_what_is_no_name_of_a_file_is_refused(text: str) -> None:
    with pytest.raises(ExchangeError, match="no name of a photograph"):
        parsing.file_of(text, "a.txt:3")


def test_windows_paths_keep_their_name() -> None:
    assert parsing.file_of("D:\\flight\\IMG 1.JPG", "").name == "IMG 1.JPG"


@pytest.mark.parametrize("text", ["", "../a", "a/../../b", "/a", "C:/a", "a\0", "\\\\host\\a"])
def test_paths_out_of_the_folder_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ExchangeError, match="leads out of the folder"):
        parsing.part_of(tmp_path, text, "a.xml:1")


def test_links_within_the_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "in").symlink_to("/etc")
    with pytest.raises(ExchangeError, match="is a link"):
        parsing.part_of(tmp_path, "in/passwd", "a.xml:1")
    assert parsing.part_of(tmp_path, "a/b.zip", "a.xml:1") == tmp_path / "a" / "b.zip"


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), 1.001 * np.eye(3), np.full((3, 3), np.nan), 1e200 * np.eye(3)],
)
def test_what_is_no_rotation_is_refused(matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> None:
    with pytest.raises(ExchangeError, match="is no rotation"):
        parsing.pose_of(matrix, np.zeros(3), "a.xml:1")


@pytest.mark.parametrize(
    ("size", "focal", "radial"),
    [((0, 10), 5.0, ()), ((2**63, 10), 5.0, ()), ((10.5, 10), 5.0, ()), ((10, 10), 0.0, ()), ((10, 10), -1.0, ()),
     ((10, 10), 5.0, (1e300,)), ((10, 10), np.nan, ())],
)  # fmt: skip
def test_what_is_no_camera_is_refused(size: tuple[float, float], focal: float, radial: tuple[float, ...]) -> None:
    with pytest.raises(ExchangeError, match=r"^here: "):
        parsing.camera_of("here", "a", size, focal, (5.0, 5.0), radial)


@pytest.mark.parametrize(
    ("wkt", "expected"),
    [
        ("", None),
        ('LOCAL_CS["x"]', None),
        ('ENGCRS["x"]', None),
        ('PROJCS["a", AUTHORITY["EPSG","25832"]]', "EPSG:25832"),
        ('PROJCRS["a",\n  ID["EPSG",25832]]', "EPSG:25832"),
        ('PROJCS["a"]', 'PROJCS["a"]'),
        ("EPSG:25832+7837", "EPSG:25832+7837"),
    ],
)
def test_a_crs_is_known_by_its_code(wkt: str, expected: str | None) -> None:
    assert parsing.crs_of(wkt) == expected


def test_observations_are_sorted_by_point_then_photograph() -> None:
    tie = parsing.sorted_tie_points(
        np.array([2, 0, 1, 0]), np.array([1, 1, 0, 0]), np.arange(8.0).reshape(4, 2), np.zeros((2, 3)),
        feature=np.array([9, 8, 7, 6]),
    )  # fmt: skip
    assert tie.point.tolist() == [0, 0, 1, 1]
    assert tie.photograph.tolist() == [0, 1, 0, 2]
    assert tie.feature.tolist() == [6, 7, 8, 9]
    assert tie.pixel[:, 0].tolist() == [6, 4, 2, 0]


def test_two_photographs_of_one_name_are_named() -> None:
    photographs = [ForeignPhotograph("a.jpg", 0, None, PurePosixPath(f"{i}/a.jpg")) for i in range(2)]
    with pytest.raises(ExchangeError, match=r"called a\.jpg \(0/a\.jpg and 1/a\.jpg\)"):
        parsing.check_photographs("file", photographs)


def test_a_name_that_is_no_files_is_not_written(tmp_path: Path) -> None:
    from dataclasses import replace

    solution = small_solution()
    bad = replace(solution.photographs[0], name="../a.jpg")
    with pytest.raises(ExchangeError, match="name that is no file's"):
        parsing.check_writable(tmp_path, replace(solution, photographs=(bad, *solution.photographs[1:])))


def test_text_that_is_no_utf_8_has_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"a\nb\xff")
    with pytest.raises(ExchangeError, match=r"a\.txt:2: byte 0xff"):
        parsing.text_of(path)
    with pytest.raises(ExchangeError, match="at most 0 MB"):
        parsing.bytes_of(path, 2)
    with pytest.raises(ExchangeError, match="cannot be read"):
        parsing.bytes_of(Path("/dev/zero"))
