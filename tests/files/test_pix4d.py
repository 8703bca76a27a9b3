"""PIX4D's marks: either order of names, half a pixel, and what the file cannot hold."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.errors import ControlPointError
from photogram.files.marks.formats import read_marks, read_points
from photogram.files.marks.pix4d import read_pix4d_marks, write_pix4d_marks
from photogram.files.tables.surveyed_points import Mark

letters = st.text(st.characters(categories=("L", "N"), include_characters="-_. "), min_size=1, max_size=8).filter(
    lambda text: text == text.strip() and text.isprintable()
)
pixels = st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))


@settings(deadline=None)
@given(
    marks=st.lists(
        st.builds(Mark, letters, letters.map(lambda t: f"{t}.JPG"), pixels, st.just((0.3, 0.4))),
        min_size=1, max_size=6, unique_by=lambda mark: mark.key,
    ),
)  # fmt: skip
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, marks: list[Mark]) -> None:
    path = tmp_path_factory.mktemp("pix4d") / "marks.txt"
    write_pix4d_marks(path, marks)
    ordered = sorted(marks, key=lambda mark: mark.key)
    assert [(m.point, m.photograph, m.pixel) for m in read_marks(path)] == [
        (m.point, m.photograph, m.pixel) for m in ordered
    ]


def test_what_is_written(tmp_path: Path) -> None:
    marks = [Mark("B", "a.jpg", (0.0, 10.25), (0.3, 0.4)), Mark("A 1", "b.jpg", (-0.5, 3.0), (0.5, 0.5))]
    write_pix4d_marks(tmp_path / "marks.csv", marks)
    assert (tmp_path / "marks.csv").read_text() == "b.jpg,A 1,0.0,3.5\na.jpg,B,0.5,10.75\n"


@pytest.mark.parametrize(
    "text",
    [
        "DJI_1.JPG,GCP1,3830.31,123.113,1.22678\nDJI_2.JPG,GCP1,10.5,0.5,1\n",
        "GCP1,DJI_1.JPG,3830.31,123.113\nGCP1,DJI_2.JPG,10.5,0.5\n",
        "DJI_1.JPG;GCP1;3830.31;123.113\nDJI_2.JPG;GCP1;10.5;0.5\n",
        "DJI_1.JPG\tGCP1\t3830.31\t123.113\r\nDJI_2.JPG\tGCP1\t10.5\t0.5\r\n",
        "DJI_1.JPG GCP1 3830.31 123.113 0.5\nDJI_2.JPG GCP1 10.5 0.5 0.5\n",
        "# marks\nDJI_1.JPG, GCP1, 3830.31, 123.113\n\nDJI_2.JPG, GCP1, 10.5, 0.5\n",
    ],
)
def test_either_order_and_any_separator(tmp_path: Path, text: str) -> None:
    (tmp_path / "marks.txt").write_text(text)
    first, second = read_marks(tmp_path / "marks.txt")
    assert (first.point, first.photograph, first.pixel) == ("GCP1", "DJI_1.JPG", (3829.81, 122.613))
    assert (second.pixel, second.sigma_px) == ((10.0, 0.0), None)  # the centre of the first pixel of column 10
    assert second.source.is_of_photogram


def test_folders_are_kept(tmp_path: Path) -> None:
    (tmp_path / "marks.txt").write_text("D:\\flight 1\\DJI_1.JPG,A,1,2\n")
    assert read_marks(tmp_path / "marks.txt")[0].photograph == "D:/flight 1/DJI_1.JPG"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.jpg,A,1,2\nb.jpg,A,1\n", "2: 3 fields, expected photograph, point, x, y and perhaps one more"),
        ("a.jpg,A,1,2\nb.jpg,A,1,x\n", "2: y must be a number, found 'x'"),
        ("a.jpg,A,1,2\nb.jpg,,1,2\n", "2: no photograph and point in the first two fields, found 'b.jpg'"),
        ("a.jpg,A,1,2\nA,b.jpg,1,2\na.jpg,C,1,2\n", "2: no photograph and point in the first two fields, found 'A'"),
        ("a.jpg,A,1,2\na.jpg,A,3,2\n", "2: point A is marked twice in a.jpg, first in line 1: write their folders"),
        ("a.jpg,A,1,2\nb.jpg,A,1,2,3,4\n", "2: 6 fields"),
    ],
)
def test_faults(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "marks.txt"
    path.write_text(text)
    with pytest.raises(ControlPointError) as raised:
        read_marks(path)
    assert str(raised.value).startswith(f"{path}:{expected}")


def test_it_holds_no_points(tmp_path: Path) -> None:
    (tmp_path / "marks.txt").write_text("a.jpg,A,1,2\n")
    with pytest.raises(ControlPointError, match=r"marks\.txt:1: holds PIX4D's marks .*: name it under marks"):
        read_points(tmp_path / "marks.txt")


@pytest.mark.parametrize(
    ("mark", "expected"),
    [
        (Mark("A,1", "a.jpg", (1.0, 2.0)), "PIX4D's marks cannot hold the names A,1: rename them"),
        (Mark("A", "#a.jpg", (1.0, 2.0)), "cannot hold the names #a.jpg"),
        (Mark("A", "a", (1.0, 2.0)), "a have no suffix of a picture"),
    ],
)
def test_what_it_cannot_hold(tmp_path: Path, mark: Mark, expected: str) -> None:
    with pytest.raises(ControlPointError, match=expected):
        write_pix4d_marks(tmp_path / "marks.txt", [mark])
    assert not list(tmp_path.iterdir())


@given(text=st.text(st.sampled_from("a.jpgA1,;\t \n\r#\"'-e\0é"), max_size=80))
def test_any_text_is_read_or_refused_with_its_line(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("any") / "marks.txt"
    path.write_text(text, encoding="utf-8")
    said: list[str] = []
    for reader in (read_pix4d_marks, read_marks):
        try:
            reader(path)
        except ControlPointError as fault:
            said += str(fault).splitlines()
    assert all(line.startswith(f"{path}:") for line in said)
