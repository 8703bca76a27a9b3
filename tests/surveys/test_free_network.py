"""Photographs without any georeference, from `photogram init` to the report: a free network, the scale by a distance,
and control points that come later, without matching again."""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import rasterio
from PIL import Image
from pyproj import CRS

from photogram.pipeline.pipeline import load_project
from photogram.sfm.similarity import fit_similarity
from photogram.simulation.simulated_survey import SimulatedSurvey, SurveyPlan, render_photographs, simulate

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
NO_POSITION_TAGS = {0x010F: "Maker", 0x0110: "Model"}
FOCAL_35MM, EXIF = 0xA405, 0x8769


@pytest.fixture(scope="module")
def made(small_plan: SurveyPlan, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SimulatedSurvey]:
    """Eight photographs with a focal length in their tags and nothing else, and `photogram init` of them."""
    folder = tmp_path_factory.mktemp("free")
    plan = replace(small_plan, photographs_per_strip=4, forward_overlap=0.8, control_marks_per_photograph=0)
    survey = simulate(plan, 5)
    (folder / "photographs").mkdir()
    for name, pixels in render_photographs(survey):
        exif = Image.Exif()
        exif.update(NO_POSITION_TAGS)
        exif.get_ifd(EXIF)[FOCAL_35MM] = plan.focal_35mm_mm
        Image.fromarray(pixels).save(folder / "photographs" / name, quality=95, exif=exif)
    return folder, survey


@pytest.fixture(scope="module")
def finished(made: tuple[Path, SimulatedSurvey], edit: Edit) -> Path:
    """The same, drafted and adjusted without a scale."""
    from photogram.pipeline.new_project import init
    from photogram.pipeline.pipeline import run_pipeline

    folder, _ = made
    project = init(folder / "photographs", project=folder / "project.yaml").path
    assert "crs: none" in project.read_text()
    assert "# distances:" in project.read_text()
    edit(project, lambda values: values.update(features={"maximum": 800}, matching={"ratio": 0.8}))
    run_pipeline(load_project(project))
    return folder


def report_of(folder: Path) -> Any:
    return json.loads((folder / "results" / "quality/report.json").read_text())


def centres(folder: Path, columns: tuple[str, str, str]) -> dict[str, np.ndarray[Any, Any]]:
    with (folder / "results" / "technical/photographs.csv").open() as stream:
        return {row["name"]: np.array([float(row[c]) for c in columns]) for row in csv.DictReader(stream)}


def shape_error_m(found: dict[str, np.ndarray[Any, Any]], survey: SimulatedSurvey) -> tuple[float, float]:
    """Return the scale that takes the centres to the truth, and what the best similarity leaves (RMS)."""
    truth = {p.name: pose.position_world_m for p, pose in zip(survey.photographs, survey.truth.poses, strict=True)}
    source, target = np.array([found[name] for name in truth]), np.array(list(truth.values()))
    fit = fit_similarity(source, target)
    return fit.scale, float(np.sqrt(np.mean(np.sum((fit.points(source) - target) ** 2, axis=1))))


def test_without_a_scale_everything_is_in_units(
    finished: Path, made: tuple[Path, SimulatedSurvey], photogram: Run
) -> None:
    report, survey = report_of(finished), made[1]
    assert report["crs"] == "none"
    assert report["block"]["registered"] == 8
    assert report["adjustment"]["converged"]
    local = report["local_frame"]
    assert not local["scale_known"]
    assert (local["vertical_by"], local["vertical_sure"]) == ("down", True)
    sigma0 = report["adjustment"]["sigma0"]  # rendered key points scatter by less than the 0.5 px that are stated
    units = centres(finished, ("easting", "northing", "height"))
    scale, error_m = shape_error_m(units, survey)
    # the shape of the centres alone; predicted is that of centres and object together
    assert error_m / np.sqrt(3.0) < 2.5 * sigma0 * scale * local["relative"]["photographs"]
    places = np.array(list(units.values()))
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e9 * np.eye(len(places))
    assert apart.min(axis=1).mean() == pytest.approx(1.0, abs=0.05)
    # the photographs look down: up is away from what they show, and the tie points lie about the origin
    assert np.all(places[:, 2] > 1.0)
    assert "no scale" in report["dsm"]["left_out"]
    products = {p.name for p in (finished / "results").iterdir()}
    assert not products & {"dsm.tif", "orthophoto.tif", "photographs.prj", "photographs.geojson", "contours.gpkg"}
    page = (finished / "results" / "deliverables/report.html").read_text()
    assert "not in metres" in page
    assert "Free network without georeference" in page
    for sentence in [report["verdict"]["sentence"], *(w["sentence"] for w in report["warnings"])]:
        assert " cm" not in sentence
    said = photogram("adjust", finished / "project.yaml")
    assert said.code == 0
    assert "Local frame" in said.out
    assert photogram("view", finished / "results").code != 0
    assert photogram("check", finished / "project.yaml").code == 0


def with_distance(folder: Path, survey: SimulatedSurvey, edit: Edit) -> tuple[float, list[str]]:
    """Add a distance between two marked points; return its true length and the names of all points by their marks."""
    points, names = survey.control_points, [p.name for p in survey.photographs]
    seen = np.bincount(points.mark_point, minlength=len(points))
    position = survey.truth.control_position_world_m
    best = np.argsort(-seen, kind="stable")[:5]
    pairs = [(a, b) for a in best for b in best if a < b]
    a, b = max(pairs, key=lambda pair: float(np.linalg.norm(position[pair[0]] - position[pair[1]])))
    length = float(np.linalg.norm(position[a] - position[b]))

    def marks(g: int) -> dict[str, list[float]]:
        own = np.flatnonzero(points.mark_point == g)
        return {names[points.mark_photograph[m]]: points.mark_pixel[m].tolist() for m in own}

    def change(values: dict[str, Any]) -> None:
        values["distances"] = [{"between": ["A", "B"], "length_m": length, "sigma_m": 0.01}]
        ends = [{"name": "A", "marks": marks(a)}, {"name": "B", "marks": marks(b)}]
        values["control_points"] = {"mark_sigma_px": 0.5, "list": ends}

    edit(folder / "project.yaml", change)
    return length, [points.name[g] for g in best]


def written_at(folder: Path, *stages: str) -> list[int]:
    return [(folder / "work" / f"{stage}.stage").stat().st_mtime_ns for stage in stages]


@pytest.mark.usefixtures("undrawn")
def test_a_distance_gives_the_scale_and_control_later_a_place_without_matching_again(
    finished: Path, made: tuple[Path, SimulatedSurvey], tmp_path: Path, photogram: Run, edit: Edit
) -> None:
    survey, folder = made[1], tmp_path / "survey"
    shutil.copytree(finished, folder)
    matching = ("features", "pairs", "matches", "tie_points")
    before = written_at(folder, *matching)
    length, best = with_distance(folder, survey, edit)
    done = photogram("adjust", folder / "project.yaml")
    assert done.code == 0, done.err
    assert written_at(folder, *matching) == before
    report = report_of(folder)
    local, (bar,) = report["local_frame"], report["distances"]
    assert local["scale_known"]
    assert bar["residual_m"] == pytest.approx(0.0, abs=1e-4)
    assert bar["adjusted_sigma_m"] == pytest.approx(0.01, rel=1e-2)
    assert bar["w"] is None  # nothing else tests it
    assert [p["name"] for p in report["marked_points"]] == ["A", "B"]
    assert report["control_points"] == []
    scale, error_m = shape_error_m(centres(folder, ("easting_m", "northing_m", "height_m")), survey)
    # the bar, 1 cm, and what its marks are good for
    assert scale == pytest.approx(1.0, abs=4.0 * np.hypot(0.01, 0.05) / length)
    assert error_m < 0.3
    # products in plan, since the photographs look down, and without a CRS
    with rasterio.open(folder / "results" / "deliverables/dsm.tif") as dataset:
        assert dataset.crs is None
    with laspy.open(folder / "results" / "technical/points_adjusted.laz") as cloud:
        assert cloud.header.parse_crs() is None
        assert cloud.header.scales[0] == 1e-5
    assert (folder / "results" / "deliverables/orthophoto.tif").is_file()
    page = (folder / "results" / "deliverables/report.html").read_text()
    assert "scale by 1 measured distance" in page
    assert photogram("view", folder / "results").code == 0

    def place(values: dict[str, Any]) -> None:
        points, names = survey.control_points, [p.name for p in survey.photographs]
        values["crs"] = survey.plan.crs
        position = survey.frame.world_from_map(np.array([survey.plan.origin_map_m]))  # the frame's own origin
        assert np.allclose(position, 0.0, atol=1e-6)
        map_m = survey.frame.map_from_world(points.position_world_m)
        values["control_points"]["list"] += [
            {
                "name": points.name[g],
                "position_m": map_m[g].tolist(),
                "sigma_m": [0.01, 0.01, 0.015],
                "marks": {
                    names[points.mark_photograph[m]]: points.mark_pixel[m].tolist()
                    for m in np.flatnonzero(points.mark_point == g)
                },
            }
            for g, name in enumerate(points.name)
            if name in best[:3]
        ]

    edit(folder / "project.yaml", place)
    done = photogram("adjust", folder / "project.yaml")
    assert done.code == 0, done.err
    assert written_at(folder, *matching[2:]) == before[2:]
    report = report_of(folder)
    assert "local_frame" not in report
    assert len(report["control_points"]) == 3
    assert report["distances"][0]["w"] is not None  # control tests it
    with rasterio.open(folder / "results" / "deliverables/dsm.tif") as dataset:
        assert dataset.crs.to_epsg() == CRS(survey.plan.crs).to_epsg()


@pytest.mark.usefixtures("undrawn")
def test_photographs_said_to_look_sideways_make_no_surface_in_plan(
    finished: Path, made: tuple[Path, SimulatedSurvey], tmp_path: Path, photogram: Run, edit: Edit
) -> None:
    folder = tmp_path / "survey"
    shutil.copytree(finished, folder)
    with_distance(folder, made[1], edit)
    edit(folder / "project.yaml", lambda values: values.update(orientation={"vertical": "level"}))
    done = photogram("adjust", folder / "project.yaml")
    assert done.code == 0, done.err
    report = report_of(folder)
    assert report["local_frame"]["vertical_by"] == "level"
    assert "sideways" in report["dsm"]["left_out"]
    assert "sideways" in report["orthophoto"]["left_out"]
    assert not (folder / "results" / "deliverables/dsm.tif").exists()
    assert "look sideways" in (folder / "results" / "deliverables/report.html").read_text()
