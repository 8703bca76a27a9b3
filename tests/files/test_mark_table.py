"""marks.csv and proposals.csv: read back exactly, the same bytes for the same marks, read for a project."""

from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.errors import ControlPointError
from photogram.files.marks.mark_table import read_marks, read_proposals, write_marks, write_proposals
from photogram.files.tables import control_files
from photogram.files.tables.surveyed_points import Mark, Proposal

names = st.text(st.characters(categories=("L", "N", "P", "S"), include_characters=" "), min_size=1, max_size=8).filter(
    lambda text: text == text.strip() and text.isprintable()
)
pixels = st.tuples(st.floats(-1e9, 1e9, exclude_min=True, exclude_max=True), st.floats(-1e6, 1e6))
sigmas = st.floats(1e-4, 1e3)
some_marks = st.lists(
    st.builds(
        Mark,
        names,
        names,
        pixels,
        st.none() | st.tuples(sigmas, sigmas),
        st.floats(-1.0, 1.0, exclude_min=True, exclude_max=True),
        st.from_regex(r"[a-z][a-z0-9_-]{0,9}", fullmatch=True),
        st.sampled_from(["", "2026-05-01T10:20:30Z", "2026-05-01T10:20:30.125Z"]),
        st.none() | pixels,
        st.booleans(),
    ),
    max_size=6,
    unique_by=lambda mark: mark.key,
)
HEADER = "point,photograph,u,v,sigma_u,sigma_v,rho,kind,time,raw_u,raw_v,doubtful\n"


@settings(deadline=None)
@given(marks=some_marks, seed=st.integers(0, 99))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, marks: list[Mark], seed: int) -> None:
    folder = tmp_path_factory.mktemp("table")
    write_marks(folder / "marks.csv", marks)
    assert read_marks(folder / "marks.csv") == tuple(sorted(marks, key=lambda mark: mark.key))
    mixed = Random(seed).sample(marks, len(marks))
    write_marks(folder / "again.csv", mixed)
    assert (folder / "again.csv").read_bytes() == (folder / "marks.csv").read_bytes()
    if marks:
        found = control_files.read_marks(folder / "marks.csv")
        assert [(m.key, m.pixel, m.sigma_px, m.rho) for m in found] == [
            (m.key, m.pixel, m.sigma_px, m.rho) for m in read_marks(folder / "marks.csv")
        ]
        assert all(m.source.is_of_photogram for m in found)


@settings(deadline=None)
@given(marks=some_marks, scores=st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6))
def test_round_trip_of_proposals(
    tmp_path_factory: pytest.TempPathFactory, marks: list[Mark], scores: list[float]
) -> None:
    path = tmp_path_factory.mktemp("table") / "proposals.csv"
    proposals = [Proposal(mark, score) for mark, score in zip(marks, scores, strict=False)]
    write_proposals(path, proposals)
    assert read_proposals(path) == tuple(sorted(proposals, key=lambda proposal: proposal.mark.key))
    for reader in (read_marks, control_files.read_marks, control_files.read_points):
        with pytest.raises(ControlPointError) as raised:
            reader(path)
        assert str(raised.value) == (
            f"{path}:1: holds proposals, which are no marks yet: confirm them, and give the table of marks"
        )


def test_marks_are_no_proposals(tmp_path: Path) -> None:
    write_marks(tmp_path / "marks.csv", [Mark("A", "1.jpg", (1.0, 2.0))])
    with pytest.raises(ControlPointError, match=r"marks\.csv:1: holds marks, no proposals: give a table of proposals"):
        read_proposals(tmp_path / "marks.csv")


def test_what_earlier_versions_called_quartered_is_a_checker_target(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text(HEADER + "A,1.jpg,1.5,2.0,0.03,0.04,-0.25,quartered,,1.0,2.0,\n", encoding="utf-8")
    assert [mark.kind for mark in read_marks(path)] == ["checker"]
    assert [mark.kind for mark in control_files.read_marks(path)] == ["checker"]


def test_what_a_table_looks_like(tmp_path: Path) -> None:
    time = "2026-05-01T10:20:30Z"
    marks = [
        Mark("B, north", "1.jpg", (10.25, 20.5)),
        Mark("A", "1.jpg", (1.5, 2.0), (0.03, 0.04), -0.25, "checker", time, (1.0, 2.0), True),
    ]
    write_marks(tmp_path / "marks.csv", marks)
    assert (tmp_path / "marks.csv").read_text() == (
        HEADER + f'A,1.jpg,1.5,2.0,0.03,0.04,-0.25,checker,{time},1.0,2.0,yes\n"B, north",1.jpg,10.25,20.5,,,,raw,,,,\n'
    )
    first, second = control_files.read_marks(tmp_path / "marks.csv")
    assert (first.sigma_px, first.rho) == ((0.03, 0.04), -0.25)
    assert (second.point, second.sigma_px) == ("B, north", None)


def test_a_table_edited_by_hand(tmp_path: Path) -> None:
    (tmp_path / "marks.csv").write_text("\ufeff# mine\nPhotograph; point; U; V; Doubtful\n1.jpg; A; 1; 2.50; YES\n\n")
    assert read_marks(tmp_path / "marks.csv") == (Mark("A", "1.jpg", (1.0, 2.5), is_doubtful=True),)


def test_an_empty_table(tmp_path: Path) -> None:
    write_marks(tmp_path / "marks.csv", [])
    assert read_marks(tmp_path / "marks.csv") == ()
    with pytest.raises(ControlPointError, match="no rows after the first line"):
        control_files.read_marks(tmp_path / "marks.csv")


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("A,1.jpg,1,x,,,,,,,,", "v must be a number, found 'x'"),
        ("A,1.jpg,,,,,,,,,,", "u and v are empty: remove the line, or give the mark"),
        (",1.jpg,1,2,,,,,,,,", "point '': must be 1 to 255 printable characters"),
        ("A,1.jpg,1,2,0.1,,,,,,,", "sigma_v must be a number, found ''"),
        ("A,1.jpg,1,2,0.1,0,,,,,,", "standard deviations (px) must be from 0.0001 to 1000, found 0.0"),
        ("A,1.jpg,1,2,,,2,,,,,", "rho must lie between -1 and 1, found 2.0"),
        ("A,1.jpg,1,2,,,,By hand,,,,", "kind must be a word in lower case, found 'By hand'"),
        ("A,1.jpg,1,2,,,,,yesterday,,,", "time must be UTC as 2026-05-01T10:20:30Z, found 'yesterday'"),
        ("A,1.jpg,1,2,,,,,,3,,", "raw_v must be a number, found ''"),
        ("A,1.jpg,1,2,,,,,,,,perhaps", "doubtful must be yes, no or empty, found 'perhaps'"),
        ("B,1.jpg,1,2,,,,,,,,", "point B is marked twice in 1.jpg, first in line 2: write their folders"),
    ],
)
def test_faults(tmp_path: Path, row: str, expected: str) -> None:
    path = tmp_path / "marks.csv"
    path.write_text(f"{HEADER}B,1.jpg,1,2,,,,,,,,\n{row}\n")
    with pytest.raises(ControlPointError) as raised:
        read_marks(path)
    assert str(raised.value).startswith(f"{path}:3: ")
    assert expected in str(raised.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name,photo,u,v,sigma_u\nA,1,1,2,0.5\n", "2: sigma_v is empty: give both, or one column sigma_px"),
        ("name,photo,u,v,sigma_u,sigma_v\nA,1,1,2,0.5,-1\n", "2: sigma_v must be from 0.0001 to 1000, found -1"),
    ],
)
def test_faults_of_sigmas_for_a_project(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "marks.csv").write_text(text)
    with pytest.raises(ControlPointError) as raised:
        control_files.read_marks(tmp_path / "marks.csv")
    assert str(raised.value).startswith(f"{tmp_path / 'marks.csv'}:{expected}")


def test_sigmas_of_u_and_v_come_before_that_of_both(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("name,photo,u,v,sigma_px,sigma_u,sigma_v\nA,1,1,2,9,0.3,0.3\nA,2,1,2,9,,\n")
    assert [m.sigma_px for m in control_files.read_marks(tmp_path / "m.csv")] == [(0.3, 0.3), (9.0, 9.0)]
    assert not any(m.source.is_of_photogram for m in control_files.read_marks(tmp_path / "m.csv"))
