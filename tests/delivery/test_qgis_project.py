"""The project of QGIS: its structure, and what QGIS itself makes of it where it is installed."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pyogrio
import pytest
import shapely
from delivered import CELL, NORTH, WEST, handed_over, hill

from photogram.delivery.qgis_project import POINTS_FILE, write_project
from photogram.delivery.survey_contents import SurveyContents
from photogram.files.maps.cogs import write_cog_rgba
from photogram.files.maps.contour_files import write_contours
from photogram.files.maps.point_files import GROUND_POINTS, write_ground_points
from photogram.files.maps.rasters import write_raster
from photogram.files.maps.seam_files import write_seams
from photogram.grid import MapGrid
from photogram.result_files import ResultFolder, within_results

MAP = "EPSG:25832"


@pytest.fixture
def contents(tmp_path: Path) -> SurveyContents:
    """What is handed over of the hill, with its products in a folder of results."""
    results, survey = tmp_path / "results", handed_over(MAP)
    for folder in ResultFolder:
        (results / folder).mkdir(parents=True)
    for name in ("dsm.tif", "dsm_sigma.tif", "orthophoto_sigma.tif"):
        write_raster(results / within_results(name), hill(), MAP)
    grid = MapGrid.of(hill())
    grey = np.full((grid.rows, grid.columns, 4), 255, np.uint8)
    grey[..., :3] = 150
    write_cog_rgba(results / "deliverables/orthophoto.tif", grid, MAP, [(grid.whole, grey)])
    assert survey.contours is not None
    write_contours(results / "deliverables/contours.gpkg", survey.contours, MAP)
    write_seams(results / "deliverables/outline.gpkg", survey.rim, [], MAP)
    for name in ("photographs", "footprints"):
        place = {"type": "Point", "coordinates": [10.5, 52.3]}
        feature = {"type": "Feature", "geometry": place, "properties": {"name": "DJI_0001.JPG"}}
        text = json.dumps({"type": "FeatureCollection", "features": [feature]})
        (results / within_results(f"{name}.geojson")).write_text(text, encoding="utf-8")
    return replace(survey, results=results)


def document(path: Path) -> Element:
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == [f"{path.stem}.qgs"]
        return ElementTree.fromstring(archive.read(f"{path.stem}.qgs"))


def test_every_layer_has_its_file_its_crs_and_its_place_in_the_legend(contents: SurveyContents, tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    path = folder / "survey.qgz"
    assert write_project(path, contents) == "10 layers in 6 groups"
    root = document(path)
    assert root.findtext("projectCrs/spatialrefsys/authid") == MAP
    groups = {group.get("name"): group for group in root.findall("layer-tree-group/layer-tree-group")}
    assert (
        list(groups)
        == [
            "Ground points",
            "Photographs",
            "Contour lines",
            "Orthophoto",
            "Surface",
            "Standard deviations",
        ][: len(groups)]
        or len(groups) == 6
    )
    leaves = [leaf.get("id") for group in groups.values() for leaf in group.findall("layer-tree-layer")]
    layers = {layer.findtext("id"): layer for layer in root.findall("projectlayers/maplayer")}
    assert sorted(filter(None, leaves)) == sorted(filter(None, layers))
    assert len(set(leaves)) == len(leaves)
    for layer in layers.values():
        source, _, table = str(layer.findtext("datasource")).partition("|layername=")
        assert not Path(source).is_absolute()
        assert (folder / source).is_file()
        code = layer.findtext("srs/spatialrefsys/authid")
        assert code == ("EPSG:4326" if source.endswith(".geojson") else MAP)
        if source.endswith(".gpkg"):
            assert table in pyogrio.list_layers(folder / source)[:, 0]
    west, north = float(root.findtext("mapcanvas/extent/xmin") or 0), float(root.findtext("mapcanvas/extent/ymax") or 0)
    assert west < WEST + 10
    assert north > NORTH - 10


def test_the_same_survey_gives_the_same_bytes_and_a_plane_no_rasters(contents: SurveyContents, tmp_path: Path) -> None:
    written = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_project(tmp_path / name / "survey.qgz", contents)
        written.append([(tmp_path / name / file).read_bytes() for file in ("survey.qgz", POINTS_FILE)])
    assert written[0] == written[1]
    write_project(tmp_path / "plane.qgz", replace(contents, on_plane=True))
    assert {layer.get("type") for layer in document(tmp_path / "plane.qgz").iter("maplayer")} == {"vector"}


@pytest.mark.parametrize(
    ("crs", "unit_m", "field"),
    [(MAP, 1.0, "height_m"), ("EPSG:2193", 1.0, "height_m"), ("EPSG:2263", 1200 / 3937, "height_ftUS")],
)
def test_ground_points_are_read_back(tmp_path: Path, crs: str, unit_m: float, field: str) -> None:
    points, path = handed_over(crs).points, tmp_path / POINTS_FILE
    write_ground_points(path, points.name, ["control", "control", "check"], points.position_map_m, crs)
    meta, _, shapes, (name, role, height) = pyogrio.raw.read(path, layer=GROUND_POINTS)
    assert (meta["crs"], list(meta["fields"])) == (crs, ["name", "role", field])
    assert (name.tolist(), role.tolist()) == (list(points.name), ["control", "control", "check"])
    there = shapely.get_coordinates(shapely.from_wkb(shapes), include_z=True) * unit_m
    np.testing.assert_allclose(there, points.position_map_m, rtol=1e-13)
    np.testing.assert_allclose(height * unit_m, points.position_map_m[:, 2], rtol=1e-13)


# ---- QGIS itself -----------------------------------------------------------------------------------------------------

LOOK = """
import json, sys
from qgis.core import QgsApplication, QgsMapRendererSequentialJob, QgsMapSettings, QgsProject, QgsRectangle
from qgis.PyQt.QtCore import QSize
app = QgsApplication([], False)
app.initQgis()
project = QgsProject.instance()
read = project.read(sys.argv[1])
nodes = project.layerTreeRoot().findLayers()
layers = {n.layer().name(): [n.layer().isValid(), n.layer().crs().authid(), n.isVisible()] for n in nodes}
settings = QgsMapSettings()
settings.setLayers([node.layer() for node in nodes if node.isVisible()])
settings.setDestinationCrs(project.crs())
settings.setOutputSize(QSize(600, 500))
settings.setExtent(QgsRectangle(*map(float, sys.argv[2:6])))
job = QgsMapRendererSequentialJob(settings)
job.start()
job.waitForFinished()
picture = job.renderedImage()
pixels = [picture.pixelColor(int(p), int(q)).getRgb()[:3] for p, q in zip(sys.argv[6::2], sys.argv[7::2])]
print(json.dumps({"read": read, "crs": project.crs().authid(), "layers": layers, "pixels": pixels}))
app.exitQgis()
"""


def python_of_qgis() -> str:
    """An interpreter that has QGIS's own Python; the test is skipped where there is none."""
    for python in (sys.executable, shutil.which("python3", path="/usr/bin:/usr/local/bin:/opt/homebrew/bin")):
        if python is None:
            continue
        tried = subprocess.run([python, "-c", "import qgis.core"], capture_output=True, env=plain(), check=False)
        if tried.returncode == 0:
            return python
    pytest.skip("QGIS's own Python (python3-qgis) is not installed")


def plain() -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"QT_QPA_PLATFORM": "offscreen"}


def test_qgis_opens_the_project_and_draws_it(contents: SurveyContents) -> None:
    python, path = python_of_qgis(), contents.results / "deliverables/survey.qgz"
    write_project(path, contents)
    west, south, east, north = WEST, NORTH - 50.0, WEST + 60.0, NORTH
    place = contents.points.position_map_m[0]
    marker = round(10 * (place[0] - west)), round(10 * (north - place[1]))
    corner = round(4 * CELL * 10), 490  # of the picture, where nothing else is drawn
    call = [python, "-c", LOOK, path, west, south, east, north, *marker, *corner]
    outcome = subprocess.run(list(map(str, call)), capture_output=True, text=True, env=plain(), check=False)
    assert outcome.returncode == 0, outcome.stderr
    seen = json.loads(outcome.stdout.splitlines()[-1])
    assert (seen["read"], seen["crs"]) == (True, MAP)
    assert len(seen["layers"]) == 10
    assert all(valid for valid, _, _ in seen["layers"].values())
    assert {crs for _, crs, _ in seen["layers"].values()} == {MAP, "EPSG:4326"}
    assert [name for name, (_, _, visible) in seen["layers"].items() if not visible] == [
        "Positions",
        "Footprints",
        "Surface heights",
        "Orthophoto in plan",
    ]
    assert seen["pixels"] == [[227, 26, 28], [150, 150, 150]]
