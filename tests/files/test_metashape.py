"""Metashape's markers: what is a mark, half a pixel, hostile XML, and what is refused with its line."""

import zipfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from makers import SharedData

from photogram.errors import ControlPointError
from photogram.files.marks.formats import read_marks, read_points
from photogram.files.marks.metashape import read_markers, write_markers
from photogram.files.tables import control_files
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint

WKT = 'PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],\n  AUTHORITY["EPSG","32632"]]'
EXPORT = f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <cameras next_id="3" next_group_id="1">
      <camera id="0" sensor_id="0" label="DJI_0001"/>
      <group id="0" label="second" type="folder">
        <camera id="1" sensor_id="0" label="DJI_0002"/>
      </group>
    </cameras>
    <markers next_id="3" next_group_id="0">
      <marker id="0" label="A">
        <reference x="500000.25" y="6100000.5" z="12.125" sx="0.01" sy="0.02" sz="0.03" enabled="true"/>
      </marker>
      <marker id="1" label="B &amp; C">
        <reference x="500010" y="6100000" z="13" enabled="false"/>
      </marker>
      <marker id="2" label="bare"/>
    </markers>
    <frames next_id="1">
      <frame id="0">
        <cameras>
          <camera camera_id="1"><photo path="../images/DJI_0002.JPG"/></camera>
        </cameras>
        <markers>
          <marker marker_id="0">
            <location camera_id="0" pinned="true" x="0.5" y="100.25"/>
            <location camera_id="1" pinned="false" x="7" y="8"/>
          </marker>
          <marker marker_id="2">
            <location camera_id="1" pinned="1" x="10.1" y="20"/>
          </marker>
        </markers>
      </frame>
    </frames>
    <reference>{WKT}</reference>
  </chunk>
</document>
"""


def written(tmp_path: Path, text: str) -> Path:
    (tmp_path / "markers.xml").write_text(text, encoding="utf-8")
    return tmp_path / "markers.xml"


def test_an_export(tmp_path: Path) -> None:
    path = written(tmp_path, EXPORT)
    read = read_markers(path)
    points = read.points
    assert (points.crs, points.holds_marks, points.format) == ("EPSG:32632", True, "metashape")
    assert [(p.name, p.position, p.sigma_m, p.role, p.line) for p in points.points] == [
        ("A", (500000.25, 6100000.5, 12.125), (0.01, 0.02, 0.03), None, 12),
        ("B & C", (500010.0, 6100000.0, 13.0), (None, None, None), ("check", "check"), 15),
    ]
    assert [(m.point, m.photograph, m.pixel, m.source.line) for m in points.marks] == [
        ("A", "DJI_0001", (0.0, 99.75), 26),
        ("bare", "DJI_0002.JPG", (9.6, 19.5), 30),
    ]
    assert all(m.source.is_of_photogram and m.sigma_px is None for m in points.marks)
    assert [(m.point, m.photograph, m.pixel) for m in read.proposals] == [("A", "DJI_0002.JPG", (6.5, 7.5))]
    assert read.without_position == ("bare",)


def test_as_a_file_of_points_and_as_one_of_marks(tmp_path: Path) -> None:
    path = written(tmp_path, EXPORT)
    assert [m.point for m in read_points(path).marks] == ["A"]
    assert read_points(path).without_position == ("bare",)
    assert [m.point for m in read_marks(path)] == ["A", "bare"]


@pytest.mark.parametrize(
    ("wkt", "crs"),
    [
        ('LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0]]', None),
        ("", None),
        ('PROJCS["own"]', 'PROJCS["own"]'),
    ],
)
def test_its_crs(tmp_path: Path, wkt: str, crs: str | None) -> None:
    assert read_points(written(tmp_path, EXPORT.replace(WKT, wkt))).crs == crs


def test_a_project_of_photoscan(shared_data: SharedData, tmp_path: Path) -> None:
    with zipfile.ZipFile(shared_data("dbat_sxb/sxb.psz")) as archive:
        path = written(tmp_path, archive.read("doc.xml").decode())
    read = read_markers(path)
    assert (len(read.points.points), len(read.points.marks), read.proposals) == (16, 47, ())
    assert read.points.points[0].sigma_m == (0.02, 0.02, 0.04)
    # the same marks, which PhotoScan keeps with single precision, as another program's table has them
    table = control_files.read_marks(shared_data("dbat_sxb/marks.csv"))
    others = {(m.photograph, m.pixel[0], m.pixel[1]) for m in table}
    for mark in read.points.marks:
        u, v = (value + 0.5 for value in mark.pixel)
        assert any(p == mark.photograph and abs(x - u) < 1e-3 and abs(y - v) < 1e-3 for p, x, y in others)


names = st.text(st.characters(categories=("L", "N", "P", "S"), include_characters=" "), min_size=1, max_size=8).filter(
    lambda text: text == text.strip() and text.isprintable()
)
finite = st.floats(-1e7, 1e7)
roles = st.sampled_from([None, ("check", "check")])


@settings(deadline=None)
@given(
    places=st.dictionaries(names, st.tuples(finite, finite, finite), min_size=1, max_size=3),
    others=st.lists(names, max_size=2),
    photographs=st.lists(names, min_size=1, max_size=3, unique=True),
    pixel=st.tuples(finite, finite),
    sigma=st.none() | st.floats(1e-5, 1e4),
    role=roles,
)
def test_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    places: dict[str, tuple[float, float, float]],
    others: list[str],
    photographs: list[str],
    pixel: tuple[float, float],
    sigma: float | None,
    role: tuple[str, str] | None,
) -> None:
    path = tmp_path_factory.mktemp("round") / "markers.xml"
    points = [SurveyedPoint(name, place, (sigma, sigma, sigma), role) for name, place in places.items()]  # type: ignore[arg-type]
    every = sorted({*places, *others})
    marks = [Mark(name, photographs[0], pixel) for name in every]
    proposals = [Mark(name, photographs[-1], pixel) for name in every] if len(photographs) > 1 else []
    write_markers(path, points, marks, WKT, proposals)
    read = read_markers(path)
    assert {p.name: (p.position, p.sigma_m, p.role) for p in read.points.points} == {
        p.name: (p.position, p.sigma_m, role) for p in points
    }
    assert [(m.point, m.photograph, m.pixel) for m in read.points.marks] == [(*m.key, m.pixel) for m in marks]
    assert [(m.point, m.photograph, m.pixel) for m in read.proposals] == [(*m.key, m.pixel) for m in proposals]
    assert read.points.crs == "EPSG:32632"
    assert set(read.without_position) == {name for name in others if name not in places}


def test_one_role_for_plan_and_height(tmp_path: Path) -> None:
    point = SurveyedPoint("A", (1.0, 2.0, 3.0), (None, None, None), ("control", "check"))
    with pytest.raises(ControlPointError, match="Metashape has one role for plan and height of A"):
        write_markers(tmp_path / "markers.xml", [point], [])


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('y="100.25"', 'y="a"', "26: y of A must be a number, found 'a'"),
        ('camera_id="0" pinned', 'camera_id="9" pinned', "26: camera_id '9' of marker A is no camera of the chunk"),
        ('<marker marker_id="2">', '<marker marker_id="7">', "29: marker_id '7' is no marker of the chunk"),
        ('label="bare"', 'label="A"', "17: marker A is there twice, first in line 11: rename one of the two"),
        ('label="bare"', 'label=" "', "17: a marker without a printable label"),
        ('z="13"', "", "15: z of B & C must be a number, found ''"),
        ('sx="0.01"', 'sx="0"', "12: sx of A must be from 1e-05 to 10000, found 0: correct it in Metashape"),
        ('camera_id="1" pinned="false"', 'camera_id="0" pinned="true"', "27: point A is marked twice in DJI_0001"),
        ("</chunk>", "", "38: is not valid XML (mismatched tag)"),
        ("<markers next", "<spots next", "18: is not valid XML (mismatched tag)"),
    ],
)  # fmt: skip
def test_faults(tmp_path: Path, old: str, new: str, expected: str) -> None:
    path = written(tmp_path, EXPORT.replace(old, new))
    with pytest.raises(ControlPointError) as raised:
        read_points(path)
    assert str(raised.value).startswith(f"{path}:{expected}")


def test_without_a_pinned_projection(tmp_path: Path) -> None:
    text = EXPORT.replace('pinned="true"', 'pinned="false"').replace('pinned="1"', "")
    with pytest.raises(ControlPointError, match=r"markers\.xml:26: none of the 3 projections is pinned"):
        read_points(written(tmp_path, text))


def test_two_chunks_and_two_frames(tmp_path: Path) -> None:
    chunk = EXPORT[EXPORT.index("  <chunk") : EXPORT.index("</document>")]
    with pytest.raises(ControlPointError, match="holds markers of 2 chunks: export those of one chunk at a time"):
        read_points(written(tmp_path, EXPORT.replace("</document>", chunk + "</document>")))
    frame = EXPORT[EXPORT.index("      <frame id") : EXPORT.index("    </frames>")]
    with pytest.raises(ControlPointError, match="holds markers of 2 frames: export one at a time"):
        read_points(written(tmp_path, EXPORT.replace("    </frames>", frame + "    </frames>")))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            '<!DOCTYPE d [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>\n<document>&b;</document>',
            "is XML that is not read",
        ),
        ('<!DOCTYPE d SYSTEM "file:///etc/passwd">\n<document/>', "is XML that is not read"),
        ('<?xml version="1.0" encoding="klingon"?><document/>', "is XML that is not read (unknown encoding"),
        ('<?xml version="1.0" encoding="UTF-16"?><document/>', "is not valid XML"),
        ("<a>" * 100_000, "is XML that is not read (elements lie too deep in one another)"),
        ("<document/>", "holds no markers of Metashape"),
        ("<", "is not valid XML"),
    ],
)
def test_hostile_xml(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ControlPointError) as raised:
        read_points(written(tmp_path, text))
    assert str(raised.value).startswith(f"{tmp_path / 'markers.xml'}:")
    assert expected in str(raised.value)
