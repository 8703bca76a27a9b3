"""Measurements that the page keeps, in report.json and on both parts of report.html."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photogram.desk.kept_measurements import KeptMeasurements
from photogram.errors import ProjectError
from photogram.files.maps.measurement_files import StoredMeasurement, write_measurements
from photogram.files.maps.rasters import read_raster
from photogram.languages.codes import CODES
from photogram.languages.language import Language
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.publishing.report_files import measurements_of, remake_report
from photogram.project.project import Project
from photogram.report.client.measurements import figure_label, measurement_rows, measurement_sentences
from photogram.report.kept_measurements import FILE, measurement_records
from photogram.report.reading import read_report
from photogram.report.record.report import Report
from photogram.result_files import result_path

CRS = "EPSG:25832"
SURFACE = "0" * 64


@pytest.fixture
def project(finished_survey: Path, tmp_path: Path) -> Project:
    """A finished survey with a named height and a named area, whose report is to have them."""
    folder = Path(shutil.copytree(finished_survey, tmp_path / "site"))
    given = load_project(folder / "project.yaml")
    surface = read_raster(result_path(given.results, "dsm.tif"))[0]
    row, column = np.argwhere(np.isfinite(surface.values)).mean(axis=0)
    middle = np.array(
        [surface.west_map_m + (column + 0.5) * surface.cell_m, surface.north_map_m - (row + 0.5) * surface.cell_m]
    )
    kept = KeptMeasurements(folder / FILE, given.results, given.crs)
    kept.add("height", [middle.tolist()])
    kept.add("area", (middle + 4.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])).tolist())
    kept.rename(0, "Manhole <1> & more")
    return replace(given, report=replace(given.report, measurements=True))


def numbers(project: Project) -> Report:
    return read_report(result_path(project.results, "report.json"))


def test_a_report_has_them_where_the_project_asks_for_it(project: Project) -> None:
    without = replace(project, report=replace(project.report, measurements=False))
    assert measurements_of(without) is None
    remake_report(without)
    former = numbers(project)
    assert "measurements" not in former
    page = remake_report(project).read_text(encoding="utf-8")
    report = numbers(project)
    assert report["report_id"] != former["report_id"]
    height, area = report["measurements"]
    assert (height["name"], height["kind"], height["is_current"]) == ("Manhole <1> & more", "height", True)
    kept = KeptMeasurements(project.path.parent / FILE, project.results, project.crs).all()
    for record, item in zip(report["measurements"], kept, strict=True):
        assert item["measurement"] is not None
        assert record["figures"] == item["measurement"]["figures"]
        assert record["corners_map_m"] == item["corners_map_m"]
    assert area["figures"][0]["value"] == pytest.approx(64.0)
    assert page.count("Manhole &lt;1&gt; &amp; more") == 2
    assert figure_label(height["figures"][2]) in page
    assert "64" in figure_label(area["figures"][0])
    remake_report(without)
    assert "measurements" not in numbers(project)
    assert numbers(project)["report_id"] == former["report_id"]


def test_what_was_measured_on_another_surface_is_said_to_be_so(project: Project) -> None:
    path = result_path(project.results, "report.json")
    content = json.loads(path.read_text(encoding="utf-8"))
    for one in content["deliverables"]:
        if one["file"].endswith("/dsm.tif"):
            one["sha256"] = SURFACE  # as a run with another surface would have it
    path.write_text(json.dumps(content), encoding="utf-8")
    page = remake_report(project).read_text(encoding="utf-8")
    assert [m["is_current"] for m in numbers(project)["measurements"]] == [False, False]
    assert page.count("of an earlier run") >= 2
    assert "Measured on the surface of an earlier run, not on this one: Manhole" in page


@pytest.mark.parametrize("code", CODES)
def test_they_are_said_in_every_language(code: str, project: Project) -> None:
    remake_report(project)
    report, language = numbers(project), Language(code)  # type: ignore[arg-type]
    height, area = measurement_rows(report, language)
    assert len(height.figures) == 1, "a client is told no coordinates"
    assert len(measurement_rows(report, language, whole=True)[0].figures) == 3
    english = measurement_rows(report)
    assert (height.kind == english[0].kind) is (code == "en")
    assert (area.figures == english[1].figures) is (code == "en")
    assert ("," in height.figures[0]) is (code != "en")
    assert len(measurement_sentences(report, language)) == 1


@pytest.mark.parametrize(
    ("value", "sigma", "unit", "label"),
    [
        (12.3456, 0.0123, "m", "12.346 ± 0.012 m"),
        (1234.5, 87.0, "m³", "1234 ± 87 m³"),
        (2.0, None, "m²", "2.00 m²"),
        (1.23456789, 1e-7, "m", "1.2346 ± 0.0000 m"),
        (None, None, "m", "unknown"),
    ],
)
def test_a_figure_has_the_digits_of_its_sigma(value: float | None, sigma: float | None, unit: str, label: str) -> None:
    assert figure_label({"name": "height", "value": value, "sigma": sigma, "unit": unit}) == label


def test_what_could_not_be_measured_says_why_and_what_is_damaged_is_refused(tmp_path: Path) -> None:
    def kept(record: str) -> Path:
        stored = StoredMeasurement("Heap", "volume", np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), True, "", record)
        write_measurements(tmp_path / FILE, [stored], CRS)
        return tmp_path / FILE

    problem = {"surface": f"0.3.0 {SURFACE}", "measurement": None, "problem": "no height there"}
    deliverables = [{"file": "deliverables/dsm.tif", "bytes": 1, "sha256": SURFACE}]
    records = measurement_records(kept(json.dumps(problem)), CRS, deliverables)  # type: ignore[arg-type]
    assert [(m["problem"], m["figures"], m["is_current"]) for m in records] == [("no height there", [], True)]
    said = measurement_sentences({"measurements": records})  # type: ignore[typeddict-item]
    assert said[-1] == "Could not be measured: Heap."
    assert measurement_records(tmp_path / "none.gpkg", CRS, []) == []
    for damaged in ("", "{}", '{"surface": 1, "measurement": null, "problem": ""}'):
        with pytest.raises(ProjectError, match="what is kept of 'Heap' is damaged"):
            measurement_records(kept(damaged), CRS, [])
