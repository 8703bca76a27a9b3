"""gcp_list.txt written: read again as it was, and refused where it cannot hold something."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.errors import ControlPointError
from photogram.files.marks.formats import read_points
from photogram.files.marks.gcp_list import write_gcp_list
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint

words = st.text(st.characters(categories=("L", "N", "P"), exclude_characters="#"), min_size=1, max_size=8).filter(
    str.isprintable
)
phrases = st.lists(words, min_size=1, max_size=3).map(" ".join)
finite = st.floats(-1e7, 1e7)


def point(name: str, position: tuple[float, float, float] = (1.0, 2.0, 3.0)) -> SurveyedPoint:
    return SurveyedPoint(name, position)


@settings(deadline=None)
@given(
    crs=st.sampled_from(["EPSG:25832", "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs"]),
    places=st.dictionaries(phrases, st.tuples(finite, finite, finite), min_size=1, max_size=4),
    photographs=st.lists(words, min_size=1, max_size=3, unique=True),
    pixel=st.tuples(finite, finite),
)
def test_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    crs: str,
    places: dict[str, tuple[float, float, float]],
    photographs: list[str],
    pixel: tuple[float, float],
) -> None:
    path = tmp_path_factory.mktemp("round") / "gcp_list.txt"
    marks = [Mark(name, photograph, pixel) for name in places for photograph in photographs]
    write_gcp_list(path, crs, [point(*entry) for entry in places.items()], marks)
    read = read_points(path)
    assert (read.crs, {p.name: p.position for p in read.points}) == (crs, places)
    assert [(m.point, m.photograph, m.pixel) for m in read.marks] == [
        (*m.key, m.pixel) for m in sorted(marks, key=lambda m: m.key)
    ]


def test_what_is_written(tmp_path: Path) -> None:
    write_gcp_list(tmp_path / "gcp_list.txt", "EPSG:32617", [point("A"), point("B")], [Mark("A", "a.jpg", (0.0, 1.5))])
    assert (tmp_path / "gcp_list.txt").read_text() == "EPSG:32617\n1.0 2.0 3.0 0.0 1.5 a.jpg A\n"


@pytest.mark.parametrize(
    ("crs", "mark", "expected"),
    [
        ("PROJCS[...]", Mark("A", "a.jpg", (0.0, 0.0)), "cannot name the CRS"),
        ("EPSG:32617", Mark("B", "a.jpg", (0.0, 0.0)), "no coordinates of B, which a gcp_list.txt needs"),
        ("EPSG:32617", Mark("A", "my a.jpg", (0.0, 0.0)), "cannot hold the names my a.jpg"),
        ("EPSG:32617", Mark("A # 1", "a.jpg", (0.0, 0.0)), "cannot hold the names A # 1"),
    ],
)
def test_what_it_cannot_hold(tmp_path: Path, crs: str, mark: Mark, expected: str) -> None:
    with pytest.raises(ControlPointError, match=expected):
        write_gcp_list(tmp_path / "gcp_list.txt", crs, [point("A"), point("A # 1")], [mark])
    assert not list(tmp_path.iterdir())


# ---- what strangers write ------------------------------------------------------------------------------------------

ROW = ("602314.4768", "5794093.9147", "118.7493", "431", "614", "a.jpg", "G01")


@pytest.mark.parametrize(
    ("header", "crs"),
    [
        ("WGS84 UTM 32U", "EPSG:32632"),
        ("WGS84 UTM32N", "EPSG:32632"),
        ("WGS 84 / UTM zone 32N", "EPSG:32632"),
        ("WGS84 UTM 33H", "EPSG:32733"),
        ("WGS84 UTM 33S", "EPSG:32733"),
        ("WGS84", "EPSG:4326"),
        ("EPSG:25832", "EPSG:25832"),
    ],
)
def test_first_lines_name_the_crs(tmp_path: Path, header: str, crs: str) -> None:
    (tmp_path / "gcp_list.txt").write_text(f"{header}\n{' '.join(ROW)}\n")
    assert read_points(tmp_path / "gcp_list.txt").crs == crs


@pytest.mark.parametrize("join", ["\t".join, " ".join, ",".join, ", ".join, "; ".join])
def test_separators_of_rows(tmp_path: Path, join: Callable[[Sequence[str]], str]) -> None:
    (tmp_path / "gcp_list.txt").write_text(f"EPSG:25832\n{join(ROW)}\n")
    file = read_points(tmp_path / "gcp_list.txt")
    assert file.points[0].position == (602314.4768, 5794093.9147, 118.7493)
    assert (file.marks[0].pixel, file.marks[0].photograph, file.marks[0].point) == ((431.0, 614.0), "a.jpg", "G01")


def test_decimal_commas(tmp_path: Path) -> None:
    row = " ".join(ROW).replace(".", ",").replace("a,jpg", "a.jpg")
    (tmp_path / "gcp_list.txt").write_text(f"EPSG:25832\n{row}\n")
    assert read_points(tmp_path / "gcp_list.txt").points[0].position == (602314.4768, 5794093.9147, 118.7493)
