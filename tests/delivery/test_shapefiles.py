"""Shapefiles, as pyshp and GDAL read them."""

import codecs
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapefile
import shapely
from delivered import handed_over
from pyproj import CRS

from photogram.delivery.shapefiles import write_shapefiles
from photogram.delivery.survey_contents import GroundPoints
from photogram.geodesy.crs import map_units

SUFFIXES = {".shp", ".shx", ".dbf", ".cpg", ".prj"}


@pytest.mark.parametrize(("crs", "symbol"), [("EPSG:25832", "m"), ("EPSG:2193+7839", "m"), ("EPSG:2263+6360", "ftUS")])
def test_pyshp_reads_what_was_surveyed(tmp_path: Path, crs: str, symbol: str) -> None:
    path, whole, units = tmp_path / "survey_shp.zip", handed_over(crs), map_units(crs)
    contours = whole.contours
    assert contours is not None
    holds = write_shapefiles(path, whole)
    assert holds == f"{len(contours)} contour lines, 3 ground points, 1 rim, 2 footprints"
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    found = {file.stem for file in tmp_path.glob("*.shp")}
    assert found == {"contours", "ground_points", "rim", "footprints"}
    read = {}
    for name in found:
        assert {file.suffix for file in tmp_path.glob(f"{name}.*")} == SUFFIXES
        written = CRS.from_wkt((tmp_path / f"{name}.prj").read_text())
        assert written.to_epsg(min_confidence=25) == int(crs.split("+")[0].removeprefix("EPSG:"))
        with shapefile.Reader(str(tmp_path / name)) as reader:
            assert codecs.lookup(reader.encoding).name == "utf-8"
            read[name] = reader.shapes(), [record.as_dict() for record in reader.records()]

    shapes, rows = read["contours"]
    heights = contours.height_m / units.height_m
    for line, (shape, row) in enumerate(zip(shapes, rows, strict=True)):
        own = contours.vertex_map_m[contours.first[line] : contours.first[line + 1]] / units.plan_m
        np.testing.assert_allclose(np.array(shape.points)[:, :2], own, rtol=0, atol=1e-8)
        np.testing.assert_allclose(np.array(shape.z), heights[line], rtol=0, atol=1e-9)
        assert (row["height"], row["unit"]) == (pytest.approx(heights[line], abs=1e-9), symbol)
        assert bool(row["index"]) == contours.is_index[line]

    shapes, rows = read["ground_points"]
    place = units.from_metres(whole.points.position_map_m)
    np.testing.assert_allclose([[*shape.points[0][:2], shape.z[0]] for shape in shapes], place, rtol=0, atol=1e-8)
    assert [row["name"] for row in rows] == list(whole.points.name), "umlauts survive"
    assert [row["role"] for row in rows] == ["control", "control", "check"]
    np.testing.assert_allclose([row["height"] for row in rows], place[:, 2], rtol=0, atol=1e-9)

    assert whole.rim is not None
    rim = shapely.transform(shapely.geometry.shape(read["rim"][0][0]), lambda at: at * units.plan_m)
    assert rim.symmetric_difference(whole.rim).area < 1e-6
    for shape, row, footprint in zip(*read["footprints"], whole.footprints, strict=True):
        assert row["name"] == footprint.name
        there = shapely.Polygon(np.array(shape.points)[:, :2] * units.plan_m)
        assert there.symmetric_difference(shapely.Polygon(footprint.corner_map_m[:, :2])).area < 1e-6
        np.testing.assert_allclose(np.array(shape.z) * units.height_m, footprint.corner_map_m[0, 2], atol=1e-9)


def test_the_same_survey_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.zip", "b.zip"):
        write_shapefiles(tmp_path / name, handed_over())
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zip", "b.zip"]


def test_a_local_survey_without_lines_and_a_point_without_height(tmp_path: Path) -> None:
    path, whole = tmp_path / "survey_shp.zip", handed_over("none")
    points = GroundPoints(("A",), np.array([True]), np.array([[12.5, 7.25, np.nan]]))
    holds = write_shapefiles(path, replace(whole, contours=None, rim=None, footprints=(), points=points))
    assert holds == "1 ground point"
    with zipfile.ZipFile(path) as archive:
        assert {Path(name).suffix for name in archive.namelist()} == SUFFIXES - {".prj"}
    meta, _, shapes, fields = pyogrio.raw.read(f"/vsizip/{path}/ground_points.shp")
    assert meta["crs"] is None
    assert shapely.get_coordinates(shapely.from_wkb(shapes), include_z=True).tolist() == [[12.5, 7.25, 0.0]]
    assert np.isnan(dict(zip(meta["fields"], fields, strict=True))["height"][0])
