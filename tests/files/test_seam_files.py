"""Rim and seams as a GeoPackage, and what is said of edited seams that cannot be used."""

from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely

from photogram.errors import ProjectError
from photogram.files.maps.seam_files import NamedPolygon, read_rim, read_seams, write_seams
from photogram.geodesy.crs import NO_CRS

MAP = "EPSG:25832"
NAMES = ("DJI_0001.JPG", "DJI_0002.JPG", "other.tif")
LEFT, RIGHT = shapely.box(0, 0, 10, 20), shapely.box(10, 0, 30, 20)


def written(folder: Path, seams: list[NamedPolygon], crs: str = MAP) -> Path:
    path = folder / "outline.gpkg"
    write_seams(path, shapely.box(0, 0, 30, 20), seams, crs)
    return path


def drawn(folder: Path, polygons: list[Any], names: list[Any], layer: str = "seams", **other: str) -> Path:
    path = folder / "drawn.gpkg"
    fields = (
        {"photograph": np.array(names, dtype=object)} if not other else {k: np.array([v]) for k, v in other.items()}
    )
    pyogrio.raw.write(
        path, geometry=shapely.to_wkb(np.array(polygons, dtype=object)), field_data=list(fields.values()),
        fields=list(fields), layer=layer, driver="GPKG", geometry_type="Unknown", crs=MAP,
    )  # fmt: skip
    return path


@pytest.mark.parametrize("crs", [MAP, "EPSG:25832+5799", NO_CRS])
def test_what_is_written_is_read_again(tmp_path: Path, crs: str) -> None:
    path = written(tmp_path, [NamedPolygon(NAMES[0], LEFT), NamedPolygon(NAMES[2], RIGHT)], crs)
    found = read_seams(path, NAMES, crs)
    assert read_rim(path, crs).equals(shapely.box(0, 0, 30, 20))
    assert [seam.photograph for seam in found] == [NAMES[0], NAMES[2]]
    assert [seam.polygon.equals(other) for seam, other in zip(found, (LEFT, RIGHT), strict=True)] == [True, True]
    assert pyogrio.list_layers(path)[:, 0].tolist() == ["outline", "seams"]
    info = pyogrio.read_info(path, layer="outline")
    assert (info["features"], info["geometry_type"]) == (1, "MultiPolygon")
    assert (info["crs"] == "EPSG:25832") == (crs != NO_CRS)


def test_the_same_polygons_give_the_same_bytes(tmp_path: Path) -> None:
    files = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        files.append(written(tmp_path / name, [NamedPolygon(NAMES[0], LEFT)]).read_bytes())
    assert files[0] == files[1]


def test_names_are_known_without_suffix_and_in_any_case(tmp_path: Path) -> None:
    path = drawn(tmp_path, [LEFT, RIGHT], ["dji_0002", "OTHER.TIF"], layer="my polygons")
    assert [seam.photograph for seam in read_seams(path, NAMES, MAP)] == [NAMES[1], NAMES[2]]


BOW_TIE = shapely.Polygon([(0, 0), (5, 5), (5, 0), (0, 5)])


@pytest.mark.parametrize(
    ("polygons", "names", "words"),
    [
        ([LEFT], ["DJI_0009.JPG"], r"polygon 1: photograph 'DJI_0009.JPG' is none of the project's: write the name"),
        ([LEFT], [None], "polygon 1: photograph 'None' is none"),
        ([LEFT, shapely.Point(1, 2)], ["DJI_0001", "DJI_0002"], "polygon 2 is Point, a polygon is expected"),
        ([BOW_TIE], ["DJI_0001"], r"polygon 1 \(DJI_0001\): Self-intersection\[2.5 2.5\]: repair its outline"),
        (
            [LEFT, shapely.box(8, 0, 30, 20)], ["DJI_0001", "DJI_0002"],
            r"polygons of DJI_0001.JPG and DJI_0002.JPG overlap by 40 m² at 9.00, 10.00: cut one of them",
        ),
    ],
)  # fmt: skip
def test_polygons_that_cannot_be_used_are_named(
    tmp_path: Path, polygons: list[Any], names: list[Any], words: str
) -> None:
    path = drawn(tmp_path, polygons, names)
    with pytest.raises(ProjectError, match=words) as caught:
        read_seams(path, NAMES, MAP)
    assert str(path) in str(caught.value)


def test_polygons_of_one_photograph_may_overlap_and_slivers_are_forgiven(tmp_path: Path) -> None:
    path = drawn(
        tmp_path, [LEFT, shapely.box(8, 0, 12, 20), shapely.box(11.999, 0, 30, 20)], ["DJI_0001"] * 2 + ["other"]
    )
    assert len(read_seams(path, NAMES, MAP)) == 3


def test_files_that_cannot_be_used_are_refused_with_what_was_found(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match="cannot be read"):
        read_seams(tmp_path / "missing.gpkg", NAMES, MAP)
    (tmp_path / "text.gpkg").write_text("no file of polygons")
    with pytest.raises(ProjectError, match=r"cannot be read .*: export them again"):
        read_seams(tmp_path / "text.gpkg", NAMES, MAP)
    path = drawn(tmp_path, [LEFT], [], picture="DJI_0001")
    with pytest.raises(ProjectError, match="layer seams: no field photograph, found picture"):
        read_seams(path, NAMES, MAP)
    with pytest.raises(
        ProjectError, match=r"CRS is not that of the project, EPSG:32633: reproject the layer \(ogr2ogr"
    ):
        read_seams(written(tmp_path, [NamedPolygon(NAMES[0], LEFT)]), NAMES, "EPSG:32633")
    with pytest.raises(ProjectError, match="layer seams: no polygons"):
        read_seams(written(tmp_path, []), NAMES, MAP)


@pytest.mark.parametrize(
    ("ring", "name", "reason"),
    [
        ("[[0, 0], [10, 0], [10, 20], [0, 21]]", b"DJI_0001.JPG", "closed linestring"),
        ("[[0, 0], [10, 0], [10, 20], [0, 0]]", b"DJI_\xf41.JPG", "can't decode byte 0xf4"),
    ],
)
def test_seams_that_are_damaged_are_refused(tmp_path: Path, ring: str, name: bytes, reason: str) -> None:
    path = tmp_path / "seams.geojson"
    polygon = f'"geometry": {{"type": "Polygon", "coordinates": [{ring}]}}'.encode()
    feature = b'{"type": "Feature", "properties": {"photograph": "%b"}, %b}' % (name, polygon)
    path.write_bytes(b'{"type": "FeatureCollection", "name": "seams", "features": [%b]}' % feature)
    with pytest.raises(ProjectError, match=rf"seams .*cannot be read \(.*{reason}.*export them again as GeoPackage"):
        read_seams(path, NAMES, NO_CRS)


def test_a_name_of_any_length_fits_into_the_message(tmp_path: Path) -> None:
    path = drawn(tmp_path, [LEFT, RIGHT], ["x" * 20_000, "DJI_0001.JPG"])
    with pytest.raises(ProjectError, match="is none of the project's") as refused:
        read_seams(path, NAMES, MAP)
    assert len(str(refused.value)) < 1000
