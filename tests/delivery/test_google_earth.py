"""The KMZ, read as Google Earth reads it: links followed from its first document."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from defusedxml import ElementTree
from delivered import COLUMNS, ROWS, WEST, handed_over
from delivered import NORTH as TOP
from PIL import Image
from pyproj import Transformer
from rasterio.transform import from_origin

from photogram.delivery.google_earth import write_kmz

KML = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """An orthophoto of the hill, 2000 × 2400 cells, without a picture in a corner."""
    path, (rows, columns) = tmp_path / "orthophoto.tif", (ROWS * 5, COLUMNS * 5)
    rgba = np.full((4, rows, columns), 255, np.uint8)
    rgba[3, :200, :300] = 0
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 4, "dtype": "uint8", "photometric": "RGB"}
    at = from_origin(WEST, TOP, 0.05, 0.05)
    with rasterio.open(path, "w", crs="EPSG:25832", transform=at, alpha="yes", **profile) as to:
        to.write(rgba)
    return path


def test_links_lead_to_tiles_and_places_are_the_surveys(tmp_path: Path, picture: Path) -> None:
    path, stations = tmp_path / "survey.kmz", (("DJI_0001.JPG", np.array([602_320.0, 5_794_130.0, 180.0])),)
    whole = replace(handed_over(), orthophoto=picture, stations=stations)
    holds = write_kmz(path, whole)
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        assert names[0] == "doc.kml"
        root = ElementTree.fromstring(archive.read("doc.kml"))
        reached, waiting = set[str](), [root]
        pictures = 0
        while waiting:
            document = waiting.pop()
            for link in document.iter(f"{KML}Link"):
                name = f"tiles/{Path(link.findtext(f'{KML}href')).name}"
                reached.add(name)
                waiting.append(ElementTree.fromstring(archive.read(name)))
            for overlay in document.iter(f"{KML}GroundOverlay"):
                name = f"tiles/{overlay.findtext(f'{KML}Icon/{KML}href')}"
                reached.add(name)
                with Image.open(io.BytesIO(archive.read(name))) as shown:
                    assert shown.size == (512, 512)
                    assert shown.format == ("JPEG" if name.endswith("jpg") else "PNG")
                pictures += 1
        assert reached == set(names[1:])
    assert holds == f"{pictures} tiles, 3 ground points, 1 photograph"
    assert "absolute" not in ElementTree.tostring(root, "unicode")
    to_degrees = Transformer.from_crs("EPSG:25832", "EPSG:4326", always_xy=True)
    marks = {mark.findtext(f"{KML}name"): mark for mark in root.iter(f"{KML}Placemark")}
    for name, control, place in zip(
        whole.points.name, whole.points.is_control, whole.points.position_map_m, strict=True
    ):
        written = [float(x) for x in marks[name].findtext(f"{KML}Point/{KML}coordinates").split(",")]
        np.testing.assert_allclose(written, to_degrees.transform(*place[:2]), rtol=0, atol=1e-9)
        role = "control" if control else "check"
        assert marks[name].findtext(f"{KML}description") == f"{role} point, height {place[2]:.3f} m"
    assert marks["DJI_0001.JPG"].findtext(f"{KML}visibility") == "0"
    rings = marks["Rim of the orthophoto"].findall(f".//{KML}LinearRing")
    assert len(rings) == 2, "the rim and the hole in it"


def test_the_same_survey_gives_the_same_bytes(tmp_path: Path, picture: Path) -> None:
    made = []
    for _ in range(2):
        write_kmz(tmp_path / "survey.kmz", replace(handed_over(), orthophoto=picture))
        made.append((tmp_path / "survey.kmz").read_bytes())
    assert made[0] == made[1]
    assert write_kmz(tmp_path / "survey.kmz", handed_over()) == "3 ground points"
