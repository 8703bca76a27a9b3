"""The stage `volumes` of a simulated survey: what it measures is what the command measures, and it is shown."""

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import shapely
from changed_surveys import write_polygons

from photogram.change.surface_change import SurfaceRequest, compare_surfaces
from photogram.errors import ProjectError
from photogram.files.maps.rasters import open_raster
from photogram.pipeline.input_validation import check_project
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.result_files import result_path
from photogram.terminal.volume_table import volume_table
from photogram.volumes.outlines import coverage
from photogram.volumes.surfaces import StatedSigma

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def polygons_of(results: Path) -> tuple[list[Any], str]:
    """Return two squares about the middle of a surface, and its CRS."""
    raster = open_raster(results / "deliverables/dsm.tif")
    west, east, south, north = raster.grid.extent_map_m
    side = min(east - west, north - south) / 8
    x, y = (west + east) / 2, (south + north) / 2
    return [shapely.box(x - side, y - side, x, y), shapely.box(x + side / 2, y, x + side, y + side)], raster.crs


@pytest.fixture
def asked(adjusted_survey: Path) -> Path:
    """A survey whose project can ask for volumes: its folder, with heaps.gpkg."""
    shapes, crs = polygons_of(adjusted_survey / "results")
    write_polygons(adjusted_survey / "heaps.gpkg", shapes, ["sand", "gravel"], crs)
    return adjusted_survey


def ask(edit: Edit, folder: Path, **settings: object) -> Path:
    project = folder / "project.yaml"
    section = {"polygons": "heaps.gpkg", "correlation_m": 2.0, **settings}
    edit(project, lambda values: values.update(volumes=section))
    return project


@pytest.mark.parametrize("base", ["rim", "level", "reference"])
def test_the_survey_measures_what_the_command_measures(asked: Path, edit: Edit, tmp_path: Path, base: str) -> None:
    results, settings = asked / "results", {"base": base}
    earlier = tmp_path / "before.tif"
    with rasterio.open(results / "deliverables/dsm.tif") as file:
        profile, heights = file.profile, file.read(1, masked=True)
    level_m = round(float(np.median(heights.compressed())) - 1.0, 2)
    request = SurfaceRequest(results, None, asked / "heaps.gpkg", correlation_m=2.0)
    if base == "level":
        settings["level_m"] = level_m  # type: ignore[assignment]
        request = SurfaceRequest(results, None, asked / "heaps.gpkg", correlation_m=2.0, level_m=level_m)
    elif base == "reference":
        for part in ("", "_sigma", "_sigma_own"):
            with rasterio.open(result_path(results, f"dsm{part}.tif")) as file:
                values = file.read(1)
            shift = 0.5 if part == "" else 0.0
            with rasterio.open(earlier.with_name(f"before{part}.tif"), "w", **{**profile, "driver": "GTiff"}) as file:
                file.write(np.where(values == profile["nodata"], values, values - shift), 1)
        settings["reference"] = str(earlier)
        request = SurfaceRequest(results, earlier, asked / "heaps.gpkg", correlation_m=2.0)
    report = run_pipeline(load_project(ask(edit, asked, **settings)))
    assert report is not None
    found = report["volumes"]
    assert "left_out" not in found
    expected = compare_surfaces(request, tmp_path / "compared")
    assert [v["name"] for v in found["polygons"]] == ["sand", "gravel"]
    assert expected.total is not None
    assert found["total"] is not None
    for mine, theirs in zip([*found["polygons"], found["total"]], [*expected.volumes, expected.total], strict=True):
        assert mine["net_sigma_m3"] > 0.0
        for key, value in mine.items():
            if key != "name":
                assert value == pytest.approx(getattr(theirs, key), rel=1e-6, abs=1e-9), key
    if base == "reference":
        sand = found["polygons"][0]
        assert sand["net_m3"] == pytest.approx(0.5 * (sand["measured_m2"] + sand["interpolated_m2"]), rel=1e-3)
    if base == "level":
        truth = open_raster(asked / "truth_surface.tif")
        heights_m = truth.read(truth.grid.whole).astype(np.float64)
        for shape, volume in zip(polygons_of(results)[0], found["polygons"], strict=True):
            inside = coverage(shape, truth.grid, truth.grid.whole)
            true_m3 = float(np.nansum(inside * (heights_m - level_m)) * truth.grid.cell_m**2)
            assert abs(volume["net_m3"] - true_m3) < 3.0 * volume["net_sigma_m3"]
    with (results / "deliverables/volumes.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == ["sand", "gravel", "all"]
    assert float(rows[0]["net_m3"]) == pytest.approx(found["polygons"][0]["net_m3"], abs=1e-4)
    assert json.loads((results / "quality/report.json").read_text())["volumes"]["base"] == base


def test_the_page_the_terminal_and_a_picture_show_them(asked: Path, edit: Edit) -> None:
    report = run_pipeline(load_project(ask(edit, asked, correlation_m=None)))
    assert report is not None
    volumes = report["volumes"]
    assert "left_out" not in volumes
    assert volumes["correlation_m"] == pytest.approx(5.0 * volumes["cell_m"])  # the windows of the matching
    page = (asked / "results" / "deliverables/report.html").read_text(encoding="utf-8")
    for part in ('id="table-client-volumes"', 'id="table-volumes"', 'id="figure-volumes"'):
        assert part in page
    assert "The base is the plane through the ground around each polygon." in page
    assert (asked / "results" / "technical/pictures" / "volumes.png").is_file()
    table = volume_table(report)
    assert table is not None
    assert table.row_count == 3


def test_what_cannot_be_measured_is_said_by_name(asked: Path, edit: Edit) -> None:
    shapes, crs = polygons_of(asked / "results")
    west, _, _, north = open_raster(asked / "results" / "deliverables/dsm.tif").grid.extent_map_m
    beside = shapely.box(west - 1.0, north + 0.5, west - 0.5, north + 1.0)
    write_polygons(asked / "heaps.gpkg", [shapes[0], beside], ["sand", "beside"], crs)
    report = run_pipeline(load_project(ask(edit, asked)))
    assert report is not None
    volumes = report["volumes"]
    assert "left_out" not in volumes
    assert [v["name"] for v in volumes["polygons"]] == ["sand"]
    assert volumes["not_measured"] == [{"name": "beside", "reason": "it lies beyond the surface"}]
    assert (
        "beside: no volume, it lies beyond the surface." in (asked / "results" / "deliverables/report.html").read_text()
    )


def test_polygons_that_lie_elsewhere_are_an_error_before_the_work(asked: Path, edit: Edit) -> None:
    shapes, crs = polygons_of(asked / "results")
    write_polygons(asked / "heaps.gpkg", [shapely.transform(shapes[0], lambda at: at + 50_000.0)], ["far"], crs)
    findings = [f for f in check_project(ask(edit, asked)) if f.where == "volumes.polygons"]
    assert [f.severity for f in findings] == ["error"]
    assert "'far': it lies 71 km north-east of the survey" in findings[0].text
    write_polygons(asked / "heaps.gpkg", shapes[:1], ["here"], crs)
    assert [f for f in check_project(asked / "project.yaml") if f.where.startswith("volumes")] == []


def test_a_reference_whose_errors_nothing_tells_is_an_error_before_the_work(asked: Path, edit: Edit) -> None:
    shutil.copy(asked / "results/deliverables/dsm.tif", asked / "before.tif")
    ask(edit, asked, base="reference", reference="before.tif")
    (finding,) = [f for f in check_project(asked / "project.yaml") if f.where == "volumes.reference"]
    assert finding.severity == "error"
    assert "no standard deviations beside it (before_sigma.tif)" in finding.text
    assert finding.remedy == "state reference_own_sigma_m and reference_common_sigma_m"
    ask(
        edit, asked, base="reference", reference="before.tif", reference_own_sigma_m=0.02, reference_common_sigma_m=0.03
    )
    assert [f for f in check_project(asked / "project.yaml") if f.where == "volumes.reference"] == []


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"base": "level"}, "level needs level_m"),
        ({"level_m": 3.0}, "is the base of base: level, found base: rim"),
        ({"base": "level", "level_m": 3.0, "reference": "before.tif"}, "reference: is the base of base: reference"),
        ({"base": "reference", "reference": "before.tif"}, "before.tif not found"),
        ({"bese": "rim"}, "bese"),
        ({"polygons": "none.gpkg"}, "none.gpkg not found: correct the path"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(
    asked: Path, edit: Edit, settings: dict[str, object], words: str
) -> None:
    with pytest.raises(ProjectError, match=words):
        load_project(ask(edit, asked, **settings))


def test_without_dense_matching_the_correlation_must_be_stated(asked: Path, edit: Edit) -> None:
    edit(asked / "project.yaml", lambda values: values.update(dense={"enabled": False}))
    load_project(ask(edit, asked))
    with pytest.raises(ProjectError, match=r"volumes.correlation_m: is missing: without dense matching"):
        load_project(ask(edit, asked, correlation_m=None))


def test_a_design_is_a_reference(asked: Path, edit: Edit, tmp_path: Path) -> None:
    """A level platform half a metre below the middle of the survey, as LandXML without a CRS."""
    results = asked / "results"
    with rasterio.open(results / "deliverables/dsm.tif") as file:
        west, south, east, north = file.bounds
        level_m = float(np.median(file.read(1, masked=True).compressed())) - 0.5
    rows = [(south, west), (south, east), (north, east), (north, west)]
    points = "".join(f'<P id="{n}">{y:.4f} {x:.4f} {level_m:.4f}</P>' for n, (y, x) in enumerate(rows, 1))
    design = asked / "platform.xml"
    design.write_text(
        f'<LandXML><Surfaces><Surface name="platform"><Definition surfType="TIN"><Pnts>{points}</Pnts><Faces>'
        "<F>1 2 3</F><F>1 3 4</F></Faces></Definition></Surface></Surfaces></LandXML>"
    )
    project = ask(edit, asked, base="reference", reference="platform.xml")
    (finding,) = [f for f in check_project(project) if f.where == "volumes.reference"]
    assert (finding.severity, "says nothing of its errors" in finding.text) == ("error", True)
    exact = {"reference_own_sigma_m": 0.0, "reference_common_sigma_m": 0.0}
    project = ask(edit, asked, base="reference", reference="platform.xml", **exact)
    (finding,) = [f for f in check_project(project) if f.where == "volumes.reference"]
    assert (finding.severity, "names no CRS" in finding.text) == ("note", True)
    report = run_pipeline(load_project(project))
    assert report is not None
    request = SurfaceRequest(
        results, design, asked / "heaps.gpkg", earlier_sigma=StatedSigma(0.0, 0.0), correlation_m=2.0
    )
    expected = compare_surfaces(request, tmp_path / "compared")
    found = report["volumes"]
    assert "left_out" not in found
    assert found["base_words"] == "the surface platform.xml"
    for mine, theirs in zip(found["polygons"], expected.volumes, strict=True):
        for key, value in mine.items():
            if key in ("net_m3", "net_sigma_m3", "fill_m3", "cut_m3"):
                assert value == pytest.approx(getattr(theirs, key), abs=1e-9)
