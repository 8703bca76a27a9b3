"""Bytes of other programs' files as values: numbers, names, paths."""

from pathlib import Path

import numpy as np
import pytest

from photogram.errors import ExchangeError
from photogram.files.solutions import parsing


@pytest.mark.parametrize("text", ["", "nan", "inf", "1e400", "1 2", "1,5", "x", "0x10"])
def test_what_is_no_finite_number_is_refused(text: str) -> None:
    with pytest.raises(ExchangeError, match=r"^a\.txt:3: width must be a finite number"):
        parsing.number_of("a.txt:3", "width", text)


@pytest.mark.parametrize("text", ["", "/", "a/..", "..", ".", "a\0b", "x" * 300, "a/b\n", "\x1b[2J"])
def test_what_is_no_name_of_a_file_is_refused(text: str) -> None:
    with pytest.raises(ExchangeError, match=r"^a\.txt:3: .*(no name of a photograph|longer than|cannot be printed)"):
        parsing.file_of("a.txt:3", text)


@pytest.mark.parametrize("text", ["D:\\flight\\IMG 1.JPG", "../flight/IMG 1.JPG", "/flight/IMG 1.JPG"])
def test_paths_of_other_machines_keep_their_name(text: str) -> None:
    assert parsing.file_of("", text).name == "IMG 1.JPG"


@pytest.mark.parametrize("text", ["", "../a", "a/../../b", "/a", "C:/a", "a\0", "\\\\host\\a"])
def test_paths_out_of_the_folder_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ExchangeError, match="leads out of the folder"):
        parsing.part_of("a.xml:1", tmp_path, text)


def test_links_within_the_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "in").symlink_to("/etc")
    with pytest.raises(ExchangeError, match="is a link"):
        parsing.part_of("a.xml:1", tmp_path, "in/passwd")
    assert parsing.part_of("a.xml:1", tmp_path, "a/b.zip") == tmp_path / "a" / "b.zip"


def test_text_that_is_no_utf_8_has_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"a\nb\xff")
    with pytest.raises(ExchangeError, match=r"a\.txt:2: byte 0xff"):
        parsing.text_of(path)
    with pytest.raises(ExchangeError, match="at most 0 MB"):
        parsing.bytes_of(path, 2)
    with pytest.raises(ExchangeError, match="cannot be read"):
        parsing.bytes_of(Path("/dev/zero"))


def test_rows_of_many_lengths_are_taken_apart() -> None:
    values, counts = np.array([7.0, 2, 1, 2, 3, 4, 8, 0, 9, 1, 5, 6]), np.array([6, 2, 4])
    head, rest, row = parsing.counted_rows("here", "a point", values, counts, 2, 2)
    assert head.tolist() == [[7, 2], [8, 0], [9, 1]]
    assert rest.tolist() == [[1, 2], [3, 4], [5, 6]]
    assert row.tolist() == [0, 0, 2]
    none = np.zeros(0, dtype=np.int64)
    assert [part.shape for part in parsing.counted_rows("here", "a point", np.zeros(0), none, 2, 2)] == [
        (0, 2), (0, 2), (0,),
    ]  # fmt: skip


@pytest.mark.parametrize("wrong", [[7.0, 3, 1, 2], [7.0, np.nan, 1, 2], [7.0, 1e300, 1, 2], [7.0, 1.5, 1, 2], [7.0]])
def test_rows_that_count_otherwise_are_refused(wrong: list[float]) -> None:
    values, counts = np.array([8.0, 0, *wrong]), np.array([2, len(wrong)])
    with pytest.raises(ExchangeError, match=r"^here: a point must have 2 numbers and 2 for each that it counts"):
        parsing.counted_rows("here", "a point", values, counts, 2, 2)
