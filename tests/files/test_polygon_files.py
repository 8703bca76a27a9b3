"""Polygons of a site as GeoPackage and GeoJSON, and what is said of those that cannot be used."""

import json
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from changed_surveys import write_polygons

from photogram.errors import FrameError, ProjectError
from photogram.files.maps.polygon_files import read_polygons
from photogram.geodesy.crs import NO_CRS

CRS = "EPSG:25832"
SQUARE = shapely.box(500_000, 6_000_000, 500_010, 6_000_010)
RING = shapely.Point(500_030, 6_000_000).buffer(8) - shapely.Point(500_030, 6_000_000).buffer(3)
BOW_TIE = shapely.Polygon([(0, 0), (5, 5), (5, 0), (0, 5)])


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson"])
def test_polygons_are_read_with_their_names(tmp_path: Path, suffix: str) -> None:
    path = write_polygons(tmp_path / f"heaps{suffix}", [SQUARE, RING], ["sand", "Kies 0/16"])
    found = read_polygons(path, "EPSG:25832+5799")
    assert [p.name for p in found] == ["sand", "Kies 0/16"]
    assert found[0].polygon.equals(SQUARE)
    assert found[1].polygon.area == pytest.approx(RING.area)


def test_geojson_without_a_crs_is_the_maps_where_it_cannot_be_degrees(tmp_path: Path) -> None:
    path = write_polygons(tmp_path / "heaps.geojson", [SQUARE], ["sand"])
    data = json.loads(path.read_text())
    del data["crs"]
    data["features"][0]["properties"] = {"use": "storage"}
    path.write_text(json.dumps(data))
    assert [p.name for p in read_polygons(path, CRS)] == ["1"]
    data["features"][0]["geometry"]["coordinates"] = [[[9.0, 54.1], [9.1, 54.1], [9.1, 54.2], [9.0, 54.1]]]
    path.write_text(json.dumps(data))
    with pytest.raises(FrameError, match=r"in longitude and latitude, not in EPSG:25832: reproject them \(ogr2ogr"):
        read_polygons(path, CRS)
    assert len(read_polygons(path, NO_CRS)) == 1


def test_polygons_in_feet_come_back_in_metres(tmp_path: Path) -> None:
    foot = 1200 / 3937
    path = write_polygons(
        tmp_path / "heaps.gpkg", [shapely.box(980_000, 190_000, 980_100, 190_050)], ["a"], "EPSG:2263"
    )
    (found,) = read_polygons(path, "EPSG:2263+6360")
    np.testing.assert_allclose(found.polygon.bounds, np.array([980_000, 190_000, 980_100, 190_050]) * foot, rtol=1e-12)


def test_another_crs_is_refused(tmp_path: Path) -> None:
    path = write_polygons(tmp_path / "heaps.gpkg", [SQUARE], ["sand"], "EPSG:25833")
    with pytest.raises(FrameError, match="their CRS EPSG:25833 is not that of the surface, EPSG:25832"):
        read_polygons(path, CRS)


@pytest.mark.parametrize(
    ("polygons", "names", "words"),
    [
        ([SQUARE, BOW_TIE], ["a", "b"], r"polygon 2 \(b\): Self-intersection"),
        ([SQUARE, RING], ["a", "a"], "two are called 'a': rename one"),
        ([SQUARE, None], ["a", "b"], r"polygon 2 \(b\): is empty, a polygon is expected"),
        ([shapely.Point(1, 2)], ["a"], r"polygon 1 \(a\): is Point"),
    ],
)
def test_what_is_no_polygon_is_named(tmp_path: Path, polygons: list[object], names: list[str], words: str) -> None:
    path = tmp_path / "heaps.gpkg"
    shapes = np.array([None if p is None else shapely.to_wkb(p) for p in polygons], dtype=object)
    pyogrio.raw.write(
        path, geometry=shapes, field_data=[np.array(names, dtype=object)], fields=["name"], driver="GPKG",
        geometry_type="Unknown", crs=CRS,
    )  # fmt: skip
    with pytest.raises(ProjectError, match=words):
        read_polygons(path, CRS)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    write_polygons(tmp_path / "cut.gpkg", [SQUARE], ["a"])
    (tmp_path / "cut.gpkg").write_bytes((tmp_path / "cut.gpkg").read_bytes()[:5000])
    (tmp_path / "text.geojson").write_text("not json")
    (tmp_path / "folder.gpkg").mkdir()
    (tmp_path / "empty.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    for name in ("cut.gpkg", "text.geojson", "folder.gpkg", "empty.geojson", "none.gpkg", "heaps.shp"):
        with pytest.raises(ProjectError, match=name):
            read_polygons(tmp_path / name, CRS)
