"""Positions in the units of a CRS, and a CRS from a file of WKT, in project files."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from photogram.errors import ProjectError
from photogram.geodesy.height_systems import UNDECLARED, DeclaredHeights, Geoid
from photogram.project.crs_units import with_listed_in_metres, with_read_crs
from photogram.project.document import Document, read_entry
from photogram.project.schema import ProjectFile

US_FOOT = 1200.0 / 3937.0
ELLIPSOIDAL = DeclaredHeights("ellipsoidal")
ORTHOMETRIC = DeclaredHeights("orthometric", geoid=Geoid("EPSG:6360"))


def read(folder: Path, crs: str, lines: str, heights: DeclaredHeights) -> ProjectFile:
    path = folder / "project.yaml"
    path.write_text(f"photogram: 1\ncrs: {crs}\ncameras: {{c: {{width_px: 9, height_px: 9}}}}\n{lines}\n")
    document = Document(path)
    file = with_read_crs(document, read_entry(document, ProjectFile))
    file = with_listed_in_metres(document, file, heights)
    document.raise_errors()
    return file


def point(crs: str, heights: DeclaredHeights, folder: Path, key: str = "position") -> list[float]:
    lines = f"photographs: {{folder: .}}\ncontrol_points:\n  list:\n    - {{name: A, {key}: [1000000, 200000, 100]}}"
    file = read(folder, crs, lines, heights)
    return list(file.control_points.list[0].position_m or ())


@pytest.mark.parametrize(
    ("crs", "heights", "factors"),
    [
        ("EPSG:2263", ELLIPSOIDAL, (US_FOOT, US_FOOT, US_FOOT)),
        ("EPSG:2222", ELLIPSOIDAL, (0.3048, 0.3048, 0.3048)),
        ("EPSG:2263+6360", ORTHOMETRIC, (US_FOOT, US_FOOT, US_FOOT)),
        ("EPSG:26918+6360", ORTHOMETRIC, (1.0, 1.0, US_FOOT)),
        ("EPSG:26918", ELLIPSOIDAL, (1.0, 1.0, 1.0)),
        ("EPSG:26918", UNDECLARED, (1.0, 1.0, 1.0)),
        ("none", UNDECLARED, (1.0, 1.0, 1.0)),
    ],
)
def test_positions_are_in_the_units_of_the_crs(
    tmp_path: Path, crs: str, heights: DeclaredHeights, factors: tuple[float, float, float]
) -> None:
    expected = np.array([1e6, 2e5, 100.0]) * factors
    np.testing.assert_allclose(point(crs, heights, tmp_path), expected, rtol=1e-15)


def test_positions_of_photographs_too(tmp_path: Path) -> None:
    lines = "photographs: {folder: ., list: [{name: a.jpg, gnss: [10, 20, 30]}, {name: b.jpg}]}"
    listed = read(tmp_path, "EPSG:2263", lines, ELLIPSOIDAL).photographs.list
    assert listed is not None
    assert listed[0].gnss_m == pytest.approx([10 * US_FOOT, 20 * US_FOOT, 30 * US_FOOT])
    assert listed[1].gnss_m is None


def test_metres_beside_a_crs_in_feet_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match="the crs is in US survey foot: write position, in the units of the crs"):
        point("EPSG:2263", ELLIPSOIDAL, tmp_path, "position_m")
    assert point("EPSG:26918", ELLIPSOIDAL, tmp_path, "position_m") == [1e6, 2e5, 100.0]
    both = "position_m: [1, 2, 3], position"
    with pytest.raises(ProjectError, match="is given here and as position_m: keep one of the two"):
        point("EPSG:26918", ELLIPSOIDAL, tmp_path, both)


def test_a_crs_in_feet_must_say_what_heights_are_in(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"leaves open what heights are in: .*EPSG:2263\+6360"):
        point("EPSG:2263", UNDECLARED, tmp_path)


def test_a_crs_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "site.wkt2").write_text(CRS("EPSG:2263").to_wkt(pretty=True))
    lines = "photographs: {folder: .}\ncontrol_points: {files: [{path: a.csv, crs: site.wkt2}]}"
    file = read(tmp_path, "site.wkt2", lines, ELLIPSOIDAL)
    assert CRS(file.crs) == CRS("EPSG:2263")
    assert file.control_points.files[0].crs == file.crs


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "not found"),
        (b"\xff\xfe", "is not text"),
        (b"x" * 200_000, "which is no CRS"),
        (b"PROJCRS[", "not a CRS"),
    ],
)
def test_a_file_that_holds_no_crs_is_one_error(tmp_path: Path, content: bytes | None, says: str) -> None:
    if content is not None:
        (tmp_path / "site.wkt2").write_bytes(content)
    lines = "photographs: {folder: .}"
    if content == b"PROJCRS[":
        assert read(tmp_path, "site.wkt2", lines, UNDECLARED).crs == "PROJCRS["  # what it holds is noted with positions
        return
    with pytest.raises(ProjectError, match=says):
        read(tmp_path, "site.wkt2", lines, UNDECLARED)
