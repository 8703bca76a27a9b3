"""LandXML as a parser of this test reads it, against the raster."""

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from delivered import CELL, NORTH, WEST, handed_over, hill

from photogram.delivery.land_xml import write_land_xml
from photogram.delivery.thinned_tin import thinned_tin

NAMESPACE = "{http://www.landxml.org/schema/LandXML-1.2}"
US_FOOT = 1200.0 / 3937.0
ERROR_M = 0.05


def parsed(path: Path) -> Element:
    root = ElementTree.parse(path).getroot()
    assert root.tag == f"{NAMESPACE}LandXML"
    for element in root.iter():
        assert element.tag.startswith(NAMESPACE)
        element.tag = element.tag.removeprefix(NAMESPACE)
    return root


def places(root: Element, of: str) -> np.ndarray:
    """Easting, northing, height (N, 3) of elements that hold northing, easting, height."""
    rows = [[float(x) for x in str(element.text).split()] for element in root.findall(of)]
    return np.array(rows)[:, [1, 0, 2]]


def heights_of_cells(vertex: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Heights of the cells of the hill in triangles, by barycentric coordinates, one triangle after the other."""
    rows, columns = hill().values.shape
    found = np.full((rows, columns), np.nan)
    at = np.column_stack([(vertex[:, 0] - WEST) / CELL - 0.5, (NORTH - vertex[:, 1]) / CELL - 0.5])
    for corner in face:
        (ax, ay), (bx, by), (cx, cy) = at[corner]
        x = np.arange(int(np.ceil(min(ax, bx, cx) - 1e-3)), int(max(ax, bx, cx) + 1e-3) + 1)
        y = np.arange(int(np.ceil(min(ay, by, cy) - 1e-3)), int(max(ay, by, cy) + 1e-3) + 1)[:, None]
        whole = (by - cy) * (ax - cx) + (cx - bx) * (ay - cy)
        p = ((by - cy) * (x - cx) + (cx - bx) * (y - cy)) / whole
        q = ((cy - ay) * (x - cx) + (ax - cx) * (y - cy)) / whole
        inside = (p > -1e-3) & (q > -1e-3) & (p + q < 1 + 1e-3)
        z = p * vertex[corner[0], 2] + q * vertex[corner[1], 2] + (1 - p - q) * vertex[corner[2], 2]
        part = found[y[0, 0] : y[-1, 0] + 1, x[0] : x[-1] + 1]
        part[inside] = z[inside]
    return found


@pytest.mark.parametrize(
    ("crs", "unit_m", "unit"),
    [("EPSG:25832", 1.0, "meter"), ("EPSG:2193", 1.0, "meter"), ("EPSG:2263", US_FOOT, "USSurveyFoot")],
)
def test_the_surface_is_within_what_the_file_states(tmp_path: Path, crs: str, unit_m: float, unit: str) -> None:
    path, survey = tmp_path / "survey.xml", handed_over(crs)
    tin = thinned_tin(hill(), ERROR_M)
    holds = write_land_xml(path, survey, tin)
    assert holds.startswith(f"3 ground points, terrain of {len(tin.triangle)} triangles, within 0.0")
    root = parsed(path)
    (units,) = root.findall("Units/*")
    assert (units.tag, units.get("linearUnit")) == ("Metric" if unit_m == 1.0 else "Imperial", unit)
    system = root.find("CoordinateSystem")
    assert system is not None
    assert system.get("epsgCode") == crs.removeprefix("EPSG:")
    definition = root.find("Surfaces/Surface/Definition")
    assert definition is not None
    assert definition.get("surfType") == "TIN"
    assert [p.get("id") for p in definition.findall("Pnts/P")] == [str(i) for i in range(1, len(tin.vertex_map_m) + 1)]
    vertex = places(definition, "Pnts/P") * unit_m
    face = np.array([[int(i) for i in str(f.text).split()] for f in definition.findall("Faces/F")]) - 1
    np.testing.assert_allclose(vertex, tin.vertex_map_m, atol=6e-5)
    np.testing.assert_array_equal(face, tin.triangle)
    stated = {p.get("label"): float(str(p.get("value"))) for p in root.findall("Surfaces/Surface/Feature/Property")}
    own, heights = hill().values, heights_of_cells(vertex, face)
    off = np.abs(heights - own)[np.isfinite(heights) & np.isfinite(own)]
    assert off.max() == pytest.approx(stated["greatest vertical error, m"], abs=3e-4)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(stated["RMS vertical error, m"], abs=3e-4)
    assert off.max() <= ERROR_M + 3e-4
    assert stated["cells with a height"] == np.isfinite(own).sum()
    assert len(off) == pytest.approx(stated["of these covered"], rel=1e-3)


def test_ground_points_have_northing_first_and_their_role(tmp_path: Path) -> None:
    path, survey = tmp_path / "survey.xml", handed_over()
    assert write_land_xml(path, survey, None) == "3 ground points"
    root = parsed(path)
    assert root.find("Surfaces") is None
    assert (root.get("version"), root.get("date")) == ("1.2", "2026-05-04")
    for title, kind, of_role in (("Control points", "control", True), ("Check points", "reference", False)):
        (group,) = (g for g in root.findall("CgPoints") if g.get("name") == title)
        names, expected = survey.points.role(of_role)
        assert [p.get("name") for p in group] == list(names)
        assert {p.get("pntSurv") for p in group} == {kind}
        np.testing.assert_allclose(places(group, "CgPoint"), expected, atol=6e-5)


def test_the_same_survey_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.xml", "b.xml"):
        (tmp_path / name[0]).mkdir()
        write_land_xml(tmp_path / name[0] / "survey.xml", handed_over(), thinned_tin(hill(), 0.5))
    assert (tmp_path / "a/survey.xml").read_bytes() == (tmp_path / "b/survey.xml").read_bytes()
