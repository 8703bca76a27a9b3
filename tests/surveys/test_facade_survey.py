"""A facade photographed sideways, with and without georeference: surface and orthophoto on a plane of their own."""

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
from lib.simulated.facade import turned_survey, upright_rotation
from PIL import Image
from scipy.ndimage import map_coordinates

from photogram.camera import project_points
from photogram.geodesy.frames import LocalFrame
from photogram.pipeline.input_validation import checked_project
from photogram.pipeline.new_project import init
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.result_files import result_path
from photogram.sfm.similarity import fit_similarity
from photogram.simulation.simulated_survey import SimulatedSurvey, SurveyPlan, render_photographs, simulate
from photogram.simulation.survey_files import write_survey

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
Array = np.ndarray[Any, Any]
FACING_DEG, SCALE, SHIFT_M = 200.0, 0.2, (3.0, -2.0, 8.0)
ROTATION = upright_rotation(FACING_DEG)
CELL_M = 0.05
ON_PLANE = {
    "surface": {"cell_m": CELL_M, "plane": "auto"},
    "orthophoto": {"cell_m": 0.04},
    "features": {"maximum": 1000},
    "matching": {"ratio": 0.8},
}

pytestmark = pytest.mark.survey


@pytest.fixture(scope="module")
def site(small_plan: SurveyPlan) -> SimulatedSurvey:
    """A nearly flat site with houses, which become bays and balconies of up to 2 m."""
    same = (0.05, 0.05, 0.05)
    plan = replace(
        small_plan, photographs_per_strip=4, forward_overlap=0.8, relief_m=0.5, trees=0, buildings=4, turns=False,
        gnss_sigma_m=same, gnss_offset_sigma_m=(0.0, 0.0, 0.0), control_sigma_m=same, control_marks_per_photograph=0,
        check_points=5, whole_pixel_marks=False, mark_sigma_px=0.2, calibration_source="exif",
    )  # fmt: skip
    return simulate(plan, 5)


@pytest.fixture(scope="module")
def pictures(site: SimulatedSurvey) -> dict[str, Array]:
    return dict(render_photographs(site))


@pytest.fixture(scope="module")
def facade(
    site: SimulatedSurvey, pictures: dict[str, Array], tmp_path_factory: pytest.TempPathFactory, edit: Edit
) -> Path:
    """The survey in the map: RTK, control and check points, `photogram init`, and surface and orthophoto on a plane."""
    folder = tmp_path_factory.mktemp("facade")
    write_survey(folder, turned_survey(site, ROTATION, SCALE, SHIFT_M), pictures.items())
    drafted = init(
        folder / "photographs",
        project=folder / "project.yaml",
        control=[folder / "points.csv"],
        marks=folder / "marks.csv",
        crs=site.plan.crs,
    ).path
    edit(drafted, lambda values: values.update(**ON_PLANE, heights="ellipsoidal"))
    run_pipeline(load_project(drafted))
    return folder


def report_of(folder: Path) -> Any:
    return json.loads((folder / "results" / "quality/report.json").read_text())


def centres(transform: Any, row: Array, column: Array) -> tuple[Array, Array]:
    return np.asarray(transform.c + transform.a * (column + 0.5)), np.asarray(transform.f + transform.e * (row + 0.5))


def cells(folder: Path, name: str) -> tuple[Array, Array, Array]:
    """Return x and y of the cells of a raster that have a value, as a GIS gives them, and the values."""
    with rasterio.open(result_path(folder / "results", name)) as dataset:
        assert dataset.crs is None
        assert "plane.json" in dataset.tags()["TIFFTAG_IMAGEDESCRIPTION"]
        values = dataset.read(1, masked=True)
        row, column = np.nonzero(~np.ma.getmaskarray(values))
        x, y = centres(dataset.transform, row, column)
        return x, y, values.data[row, column].astype(np.float64)


def world_of(folder: Path, xyz: Array, frame: str = "world") -> Array:
    plane = json.loads((folder / "results" / "deliverables/plane.json").read_text())
    axes = plane[f"axes_{frame}"]
    return np.asarray(plane[f"origin_{frame}_m"] + xyz @ np.array([axes["x"], axes["y"], axes["z"]]))


def off_the_scene(site: SimulatedSurvey, upright_m: Array) -> Array:
    """Return by how much points (N, 3) of the facade lie in front of the true surface, m, NaN near its steps, where a
    cell is two surfaces at once."""
    level = (upright_m - np.array(SHIFT_M)) @ ROTATION / SCALE
    height = site.scene.height(level[:, :2])
    reach = 1.5 * CELL_M / SCALE
    around = [
        site.scene.height(level[:, :2] + reach * np.array([np.cos(a), np.sin(a)]))
        for a in np.arange(0, 6.28, np.pi / 4)
    ]
    near_step = np.ptp(around, axis=0) > 3.0
    return np.where(near_step, np.nan, SCALE * (level[:, 2] - height))


def check_surface(folder: Path, site: SimulatedSurvey, to_upright: Callable[[Array], Array], gsd_m: float) -> None:
    x, y, z = cells(folder, "dsm.tif")
    off_m = off_the_scene(site, to_upright(world_of(folder, np.column_stack([x, y, z]))))
    off_m = off_m[np.isfinite(off_m)]
    assert len(off_m) > 10_000
    assert abs(np.median(off_m)) < 0.5 * gsd_m
    assert 1.4826 * np.median(np.abs(off_m - np.median(off_m))) < 1.0 * gsd_m
    assert np.mean(np.abs(off_m) < 4.0 * gsd_m) > 0.97
    assert z.max() > 0.8, "the bays stand out of the wall"
    assert abs(np.median(z)) < 0.1
    _, _, sigma_m = cells(folder, "dsm_sigma.tif")
    assert 0.1 * gsd_m < np.median(sigma_m) < 3.0 * gsd_m


def test_a_facade_in_the_map(facade: Path, site: SimulatedSurvey) -> None:
    report = report_of(facade)
    plane, gsd_m = report["plane"], SCALE * site.plan.gsd_m
    assert plane["used"]
    assert plane["tilt_deg"] == pytest.approx(90.0, abs=1.0)
    assert plane["facing_deg"] == pytest.approx(FACING_DEG, abs=1.0)
    origin = np.array(report["world"]["origin_map_m"])

    def upright(world_m: Array) -> Array:
        """From the world of the adjustment to that of the simulation: two tangent planes a few metres apart."""
        frame = LocalFrame(site.plan.crs, (float(origin[0]), float(origin[1]), float(origin[2])))
        return site.frame.world_from_map(frame.map_from_world(world_m))

    check_surface(facade, site, upright, gsd_m)
    # report, page, terminal
    assert "left_out" not in report["dsm"]
    assert report["dense"]["check_points"]["n"] >= 3
    assert "across the plane" in report["dense"]["check_points"]["sentence"]
    assert report["dense"]["check_points"]["rmse_m"] < 2.0 * gsd_m
    shown = report["orthophoto"]["check_points"]
    assert "along the plane" in shown["sentence"]
    assert shown["fit_rmse_h_m"] is None or shown["fit_rmse_h_m"] < 1.5 * gsd_m
    assert report["asprs"]["products"] == [], "the standard knows heights and plan"
    assert plane["left_out"] == ["contour lines"]
    page = (facade / "results" / "deliverables/report.html").read_text()
    assert "leans 90" in page or "leans 89" in page
    products = {p.name for p in (facade / "results").rglob("*")}
    assert {"dsm.tif", "dsm_sigma.tif", "dsm_filled.tif", "orthophoto.tif", "plane.json"} <= products
    assert not products & {"contours.gpkg", "dtm.tif"}
    assert "plane.json" in (facade / "results/deliverables/checksums.sha256").read_text()
    assert "deliverables/plane.json" in [product["file"] for product in report["deliverables"]]


def test_points_above_a_camera_that_looks_level_accuse_nobody(facade: Path) -> None:
    found = checked_project(load_project(facade / "project.yaml")).findings
    assert not [f.text for f in (*found.errors, *found.warnings) if " above " in f.text or "disagree" in f.text]


def test_the_cloud_of_a_facade_stays_in_the_map(facade: Path, site: SimulatedSurvey) -> None:
    with laspy.open(facade / "results" / "deliverables/dense.laz") as file:
        assert file.header.parse_crs() is not None
        points = file.read()
    upright = site.frame.world_from_map(np.asarray(points.xyz))
    off_m = off_the_scene(site, upright)
    assert np.nanmedian(np.abs(off_m)) < 0.02
    names = list(points.point_format.extra_dimension_names)
    assert names == ["sigma across plane", "confidence", "rays", "level"]
    # the same points as the raster's, within the millimetre of the file
    x, y, z = cells(facade, "dsm.tif")
    in_map = world_of(facade, np.column_stack([x, y, z]), "map")
    assert np.abs(in_map.min(axis=0) - points.xyz.min(axis=0)).max() < 0.1
    assert len(points) <= len(z)


def test_the_orthophoto_shows_the_wall_as_the_photographs_do(
    facade: Path, site: SimulatedSurvey, pictures: dict[str, Array]
) -> None:
    """What a cell of the wall shows is what a photograph shows of its place, by the true pose."""
    with rasterio.open(facade / "results" / "deliverables/orthophoto.tif") as dataset:
        rgba = dataset.read().astype(np.float64)
        row, column = np.nonzero(rgba[3] > 0)
        x, y = centres(dataset.transform, row, column)
    assert np.mean(rgba[3] > 0) > 0.5
    in_map = world_of(facade, np.column_stack([x, y, np.zeros(len(x))]), "map")
    level = (site.frame.world_from_map(in_map) - np.array(SHIFT_M)) @ ROTATION / SCALE
    height = site.scene.height(level[:, :2])
    wall = np.abs(height - np.median(height)) < 0.5
    level[:, 2] = height
    photograph = site.photographs[1]
    pixel = project_points(site.truth.camera, site.truth.poses[1], level)
    shown = pictures[photograph.name].mean(axis=2)
    inside = wall & (np.abs(pixel - np.array(shown.shape)[::-1] / 2) < np.array(shown.shape)[::-1] / 2 - 5).all(axis=1)
    assert inside.sum() > 5000
    grey = rgba[:3, row, column].mean(axis=0)[inside]
    expected = map_coordinates(shown, pixel[inside].T[::-1], order=1)
    assert np.corrcoef(grey, expected)[0, 1] > 0.8


def test_a_survey_that_is_up_to_date_is_not_made_again(facade: Path, photogram: Run) -> None:
    before = (facade / "work" / "surface.stage").stat().st_mtime_ns
    done = photogram("adjust", facade / "project.yaml", "--no-check")
    assert done.code == 0, done.err
    assert (facade / "work" / "surface.stage").stat().st_mtime_ns == before
    assert "from level" in done.out
    assert photogram("view", facade / "results").code == 0


@pytest.mark.usefixtures("undrawn")
def test_without_the_key_there_is_no_surface_and_the_message_names_it(
    facade: Path, tmp_path: Path, photogram: Run, edit: Edit
) -> None:
    folder = Path(shutil.copytree(facade, tmp_path / "survey"))
    edit(folder / "project.yaml", lambda values: values["surface"].pop("plane"))
    done = photogram("adjust", folder / "project.yaml", "--no-check")
    assert done.code == 0, done.err
    report = report_of(folder)
    assert "plane: auto" in report["dsm"]["left_out"]
    assert "plane: auto" in report["orthophoto"]["left_out"]
    assert "plane" not in report
    products = {p.name for p in (folder / "results").iterdir()}
    assert not products & {"dsm.tif", "orthophoto.tif", "plane.json", "dense.laz"}


@pytest.mark.usefixtures("undrawn")
def test_a_facade_without_georeference(
    site: SimulatedSurvey, pictures: dict[str, Array], tmp_path: Path, photogram: Run, edit: Edit
) -> None:
    """A free network: the vertical by photographs held level, the scale by a distance, no dense matching."""
    (tmp_path / "photographs").mkdir()
    for name, pixels in pictures.items():
        exif = Image.Exif()
        exif.update({0x010F: "Maker", 0x0110: "Model"})
        exif.get_ifd(0x8769)[0xA405] = site.plan.focal_35mm_mm
        Image.fromarray(pixels).save(tmp_path / "photographs" / name, quality=95, exif=exif)
    drafted = init(tmp_path / "photographs", project=tmp_path / "project.yaml").path
    points, names = site.control_points, [p.name for p in site.photographs]
    seen = np.bincount(points.mark_point, minlength=len(points))
    a, b = np.argsort(-seen, kind="stable")[:2]
    position = SCALE * site.truth.control_position_world_m
    length_m = float(np.linalg.norm(position[a] - position[b]))

    def marks(g: int) -> dict[str, list[float]]:
        own = np.flatnonzero(points.mark_point == g)
        return {names[points.mark_photograph[m]]: points.mark_pixel[m].tolist() for m in own}

    def change(values: dict[str, Any]) -> None:
        values.update(ON_PLANE, dense={"enabled": False}, orientation={"vertical": "level"})
        values["distances"] = [{"between": ["A", "B"], "length_m": length_m, "sigma_m": 0.001}]
        ends = [{"name": "A", "marks": marks(int(a))}, {"name": "B", "marks": marks(int(b))}]
        values["control_points"] = {"mark_sigma_px": 0.2, "list": ends}

    edit(drafted, change)
    done = photogram("adjust", drafted)
    assert done.code == 0, done.err
    report = report_of(tmp_path)
    assert report["crs"] == "none"
    plane = report["plane"]
    assert plane["used"]
    assert plane["tilt_deg"] == pytest.approx(90.0, abs=6.0)  # photographs are held level to 1.5°
    assert plane["facing_deg"] is None, "a free network knows no north"
    truth = turned_survey(site, ROTATION, SCALE, SHIFT_M).truth
    found = np.array([report["photographs"][name]["position_map_m"] for name in names])
    fit = fit_similarity(found, np.array([pose.position_world_m for pose in truth.poses]))
    assert fit.scale == pytest.approx(1.0, abs=0.02)
    x, y, z = cells(tmp_path, "dsm.tif")
    off_m = off_the_scene(site, fit.points(world_of(tmp_path, np.column_stack([x, y, z]))))
    off_m = off_m[np.isfinite(off_m)]
    # interpolated between tie points: right where the wall is smooth
    assert abs(np.median(off_m)) < 0.03
    assert np.median(np.abs(off_m)) < 0.03
    assert (tmp_path / "results" / "deliverables/orthophoto.tif").is_file()
    assert np.allclose(world_of(tmp_path, np.eye(3), "map"), world_of(tmp_path, np.eye(3)))


@pytest.mark.usefixtures("undrawn")
def test_a_level_site_is_made_on_the_map_as_without_the_key(adjusted_survey: Path, photogram: Run, edit: Edit) -> None:
    names = ("dsm.tif", "dsm_sigma.tif", "orthophoto.tif", "contours.gpkg")
    results = adjusted_survey / "results"
    before = {name: result_path(results, name).read_bytes() for name in names if result_path(results, name).is_file()}
    assert "dsm.tif" in before
    edit(adjusted_survey / "project.yaml", lambda values: values.setdefault("surface", {}).update(plane="auto"))
    done = photogram("adjust", adjusted_survey / "project.yaml", "--no-check")
    assert done.code == 0, done.err
    plane = report_of(adjusted_survey)["plane"]
    assert not plane["used"]
    assert plane["tilt_deg"] < 10.0
    assert not (results / "deliverables/plane.json").exists()
    assert {name: result_path(results, name).read_bytes() for name in before if name.endswith(".tif")} == {
        name: content for name, content in before.items() if name.endswith(".tif")
    }
    assert "The surface lies on the map" in (results / "deliverables/report.html").read_text()


@pytest.mark.usefixtures("undrawn")
def test_where_no_plane_is_found_nothing_is_made_and_the_reason_is_said(
    adjusted_survey: Path, photogram: Run, edit: Edit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("photogram.surface.reference_plane.MINIMUM_POINTS", 10**9)
    edit(adjusted_survey / "project.yaml", lambda values: values.setdefault("surface", {}).update(plane="auto"))
    done = photogram("adjust", adjusted_survey / "project.yaml", "--no-check")
    assert done.code == 0, done.err
    report = report_of(adjusted_survey)
    assert "too few for a plane" in report["dsm"]["left_out"]
    assert "too few for a plane" in report["orthophoto"]["left_out"]
    assert "plane" not in report
