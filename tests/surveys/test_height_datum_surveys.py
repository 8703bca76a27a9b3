"""Height systems in the project file, what the check asks for and refuses, and a whole survey over a geoid."""

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import rasterio
from makers import SharedData

from photogram.amendments.undeclared_heights import WIDEST_M
from photogram.errors import ProjectError
from photogram.files.photographs.headers import read_headers
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.project.findings import Finding
from photogram.project.measured.measured_block import measured_block, photograph_note
from photogram.project.measured.measured_positions import known_position
from photogram.project.measured.measured_survey import gnss_positions
from photogram.project.project import Project
from photogram.project.validation.heights import height_system_findings
from photogram.project.validation.undeclared_heights import with_undeclared_heights
from photogram.report.record.report import oriented
from photogram.survey import Block

EXAMPLE = Path(__file__).parents[2] / "examples" / "dtu_phantom4" / "project.yaml"
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
Run = Callable[..., Any]


def lowered(values: dict[str, Any], by_m: float = 44.0) -> None:
    """Give the ground points heights of another system."""
    for point in values["control_points"]["list"]:
        point["position_m"][2] -= by_m


def tags_of(project: Project) -> list[PhotographTags | None]:
    with ThreadPoolExecutor(2) as executor:
        return [header.tags for header in read_headers([p.path for p in project.photographs], executor)]


def found(path: Path, **changed: Any) -> list[Finding]:
    project = load_project(path)
    return height_system_findings(project, [None if t is None else replace(t, **changed) for t in tags_of(project)])


# ---- what the file may say -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        ("orthometric", "needs a mapping of keys, output: orthometric and geoid: EGM96 for example"),
        ("sea level", "needs ellipsoidal, or a mapping of keys"),
        ({"gnss": "ellipsoidal"}, r"heights\.output: is missing"),
        ({"output": "orthometric"}, "orthometric needs a geoid"),
        ({"output": "ellipsoidal", "control_points": "orthometric"}, r"control_points: orthometric needs a geoid"),
        ({"output": "elipsoidal"}, "did you mean 'ellipsoidal'"),
        ({"output": "orthometric", "geoid": "EGM1996"}, "not a geoid known to PROJ"),
        ({"output": "orthometric", "geoid": "EPSG:25832"}, "not a vertical CRS"),
        ({"output": "orthometric", "geoid": "gone.gtx"}, r"file .*gone\.gtx"),
        ({"output": "orthometric", "geoid": "a.gtx", "grid": "b.gtx"}, "keep one of the two"),
        ({"output": "orthometric", "geoid": "EPSG:5773", "datum": 1}, "unknown key"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(survey: Path, edit: Edit, heights: Any, words: str) -> None:
    edit(survey / "project.yaml", lambda values: values.update(heights=heights))
    with pytest.raises(ProjectError, match=rf"project\.yaml:\d+: .*{words}"):
        load_project(survey / "project.yaml")


def test_a_geoid_that_does_not_reach_the_site_is_refused(survey: Path, edit: Edit, sloping_geoid: Any) -> None:
    heights = {"output": "orthometric", "control_points": "orthometric", "geoid": sloping_geoid.path}

    def move(values: dict[str, Any]) -> None:
        values.update(heights=heights, crs="EPSG:25833")  # 6° farther east
        for point in values["control_points"]["list"]:
            point["marks"] = {}

    edit(survey / "project.yaml", move)
    with pytest.raises(ProjectError, match=r"heights: position .* lies outside the grid of geoid slope\.gtx"):
        load_project(survey / "project.yaml")


def test_heights_of_the_file_are_brought_to_those_of_the_map(survey: Path, edit: Edit, sloping_geoid: Any) -> None:
    path = survey / "project.yaml"
    plain = np.array([p.position_map_m for p in load_project(path).control_points])
    n = sloping_geoid.at("EPSG:25832", plain)
    for output, given, raised in (
        ("ellipsoidal", "orthometric", n), ("orthometric", "ellipsoidal", -n), ("orthometric", "orthometric", 0 * n),
    ):  # fmt: skip
        block = {"output": output, "control_points": given, "gnss": "ellipsoidal", "geoid": sloping_geoid.path}
        edit(path, partial(dict.update, heights=block))
        project = load_project(path)
        moved = np.array([p.position_map_m for p in project.control_points])
        np.testing.assert_allclose(moved - plain, np.column_stack([0 * n, 0 * n, raised]), rtol=0, atol=2e-5)
        assert {p.heights for p in project.control_points} == {given}


def test_a_compound_crs_says_it_all(survey: Path, edit: Edit, sloping_geoid: Any) -> None:
    path = survey / "project.yaml"
    edit(path, lambda v: v.update(crs="EPSG:25832+5773", heights={"grid": sloping_geoid.path}))
    project = load_project(path)
    assert (project.heights.output, project.heights.control_points) == ("orthometric", "orthometric")
    assert project.heights.gnss is None  # those of the tags are as the tags say
    assert project.product_crs == "EPSG:25832+5773"
    assert project.heights.geoid is not None
    assert project.heights.geoid.name == "EGM96 (EPSG:5773)"
    edit(path, lambda v: v.update(heights={"grid": sloping_geoid.path, "output": "ellipsoidal"}))
    with pytest.raises(ProjectError, match=r"heights\.output: must be orthometric, as the crs EPSG:25832\+5773 says"):
        load_project(path)
    edit(path, lambda v: v.update(heights={"grid": sloping_geoid.path, "geoid": "EPSG:5799"}))
    with pytest.raises(ProjectError, match=r"heights\.geoid: is EPSG:5799, but the crs says EPSG:5773"):
        load_project(path)


def test_ellipsoidal_heights_need_the_ellipsoid_of_gnss(survey: Path, edit: Edit) -> None:
    edit(survey / "project.yaml", lambda v: v.update(crs="EPSG:31468"))
    with pytest.raises(ProjectError, match="an ellipsoid other than that of GNSS"):
        load_project(survey / "project.yaml")


TABLE = "name,easting,northing,height,sigma\nT1,602340,5794120,120,0.02\nT2,602360,5794140,121,0.02\n"


@pytest.mark.parametrize(
    ("entry", "system", "raised"),
    [
        ({}, "ellipsoidal", 0.0),
        ({"heights": "orthometric"}, "orthometric", 1.0),
        ({"crs": "EPSG:25832+5773"}, "orthometric", 1.0),
    ],
)
def test_files_say_what_their_heights_are(
    survey: Path, edit: Edit, sloping_geoid: Any, entry: dict[str, str], system: str, raised: float
) -> None:
    (survey / "points.csv").write_text(TABLE)
    heights = {
        "output": "ellipsoidal", "control_points": "ellipsoidal", "geoid": "EPSG:5773", "grid": sloping_geoid.path
    }  # fmt: skip

    def add(values: dict[str, Any]) -> None:
        values["heights"] = heights
        values["control_points"]["files"] = [{"path": "points.csv", **entry}]

    edit(survey / "project.yaml", add)
    points = [p for p in load_project(survey / "project.yaml").control_points if p.name in ("T1", "T2")]
    assert {p.heights for p in points} == {system}
    given = np.array([[602340.0, 5794120.0, 120.0], [602360.0, 5794140.0, 121.0]])
    expected = given[:, 2] + raised * sloping_geoid.at("EPSG:25832", given)
    np.testing.assert_allclose([p.position_map_m[2] for p in points], expected, rtol=0, atol=2e-5)


def test_a_file_cannot_say_two_things(survey: Path, edit: Edit, sloping_geoid: Any) -> None:
    (survey / "points.csv").write_text(TABLE)

    def add(values: dict[str, Any]) -> None:
        values["heights"] = {"output": "ellipsoidal", "geoid": "EPSG:5773", "grid": sloping_geoid.path}
        values["control_points"]["files"] = [
            {"path": "points.csv", "crs": "EPSG:25832+5773", "heights": "ellipsoidal", "role": "check"}
        ]

    edit(survey / "project.yaml", add)
    with pytest.raises(ProjectError, match=r"has orthometric heights, but heights says ellipsoidal"):
        load_project(survey / "project.yaml")


# ---- what the check finds ------------------------------------------------------------------------------------------


def test_nothing_is_found_in_a_survey_of_one_system(survey: Path) -> None:
    assert found(survey / "project.yaml") == []


def test_nothing_is_found_in_the_example(shared_data: SharedData) -> None:
    project = load_project(EXAMPLE, shared_data("dtu_phantom4/images"))
    assert height_system_findings(project, tags_of(project)) == []


def test_orthometric_control_declared_ellipsoidal_stops_check_and_adjust(
    survey: Path, edit: Edit, photogram: Run
) -> None:
    path = survey / "project.yaml"
    edit(path, lowered)
    checked = photogram("check", path)
    assert checked.code == 1
    table = " ".join(checked.out.replace("│", " ").split())
    (finding,) = [f for f in found(path) if f.text.startswith("control")]
    assert finding.severity == "error"
    assert finding.text.startswith("control heights look orthometric although declared ellipsoidal: they lie 4")
    assert "m below where their marks and the GNSS heights put them" in finding.text
    assert finding.remedy.startswith("write heights.control_points: orthometric with the geoid")
    assert "Not ready" in table
    stopped = photogram("adjust", path)
    assert stopped.code == 1
    assert "Nothing was processed" in stopped.out
    assert not (survey / "work").exists()
    adjusted = photogram("adjust", path, "--no-check")
    assert adjusted.code == 1
    assert finding.text in " ".join(adjusted.err.split())
    assert not (survey / "work" / "features.stage").exists()


def test_the_geoid_of_the_site_says_who_is_wrong(survey: Path, edit: Edit, sloping_geoid: Any) -> None:
    path = survey / "project.yaml"
    block = {"output": "ellipsoidal", "gnss": "ellipsoidal", "control_points": "ellipsoidal"}

    def text(by_m: float, **heights: str) -> str:
        def change(values: dict[str, Any]) -> None:
            lowered(values, by_m)
            values.update(heights=block | {"geoid": sloping_geoid.path} | heights)

        edit(path, change)
        findings = found(path, rtk_flag=None, height_is_ellipsoidal=None)
        (one,) = [str(f) for f in findings if "check points" not in f.text]
        edit(path, lambda v: lowered(v, -by_m))
        return one

    told = text(44.0)
    assert "control heights look orthometric although declared ellipsoidal" in told
    assert "the geoid lies 43.9 m above the ellipsoid here" in told
    assert "write heights.control_points: orthometric with the geoid slope.gtx" in told
    told = text(-44.0)
    assert "GNSS heights look orthometric although declared ellipsoidal" in told
    assert "heights.gnss: orthometric" in told
    told = text(0.0, control_points="orthometric")
    assert "control heights look ellipsoidal although declared orthometric" in told
    assert told.endswith("write heights.control_points: ellipsoidal, or heights.gnss: orthometric if those are")
    told = text(25.0)
    assert "which no height system explains: the geoid lies 43.9 m above" in told


def test_positions_that_prove_nothing_raise_no_alarm(survey: Path, edit: Edit) -> None:
    path = survey / "project.yaml"

    def barometric(values: dict[str, Any]) -> None:
        lowered(values, 30.0)
        values["photographs"].update(gnss_sigma_m=[2.0, 2.0, 5.0])

    edit(path, barometric)
    assert found(path) == []  # a barometer
    edit(path, lambda v: (v["photographs"].pop("gnss_sigma_m"), v["gnss"].update(offset_sigma_m=[0.3, 0.3, 50.0])))
    assert found(path) == []  # an offset that is said to be unknown


def test_what_nobody_declares_is_asked_for(survey: Path, edit: Edit) -> None:
    path = survey / "project.yaml"
    edit(path, lambda v: v.pop("heights"))
    (asked,) = found(path)
    assert (asked.severity, asked.where) == ("warning", "heights")  # the marks show that the two agree
    assert "not declared whether the heights of the control points, the check points are above" in asked.text
    assert "GNSS and ground points agree to" in asked.text
    assert "write heights: ellipsoidal if all are" in asked.remedy

    def bare(values: dict[str, Any]) -> None:
        for point in values["control_points"]["list"]:
            point["marks"] = dict(list(point["marks"].items())[:1]) if point["name"].endswith("1") else {}

    edit(path, lambda v: [point.update(role="check") for point in v["control_points"]["list"]])
    (asked,) = found(path)
    assert asked.severity == "warning"  # check points show it as well
    assert "GNSS and ground points agree to" in asked.text
    edit(path, bare)
    (asked,) = found(path)
    assert asked.severity == "warning"  # nothing shows it, and without control nothing has to
    assert "agree" not in asked.text
    edit(path, lambda v: v["photographs"].update(gnss_sigma_m=[2.0, 2.0, 5.0]))
    (asked,) = found(path)
    assert asked.severity == "warning"


def undeclared(values: dict[str, Any], by_m: float = 44.0) -> None:
    """Give the ground points heights of another system, and declare nothing."""
    values.pop("heights")
    values["comparison"].pop("heights", None)
    lowered(values, by_m)


def test_what_nobody_declares_and_contradicts_is_no_error(survey: Path, edit: Edit) -> None:
    path = survey / "project.yaml"
    edit(path, undeclared)
    findings = found(path)
    assert {f.severity for f in findings} == {"warning"}
    (control,) = [f for f in findings if f.text.startswith("control heights look orthometric and are not declared")]
    assert "the adjustment estimates the difference" in control.text
    edit(path, lambda v: lowered(v, -200.0))  # above every photograph
    assert {f.severity for f in found(path)} == {"warning"}


def test_positions_are_lowered_by_what_the_marks_show(survey: Path, edit: Edit) -> None:
    path = survey / "project.yaml"

    def blocks() -> tuple[Block, Block]:
        project = load_project(path)
        tags = tags_of(project)
        positions = zip(project.photographs, tags, gnss_positions(project, tags), strict=True)
        notes = [photograph_note(p, t, known_position(p, t, position)) for p, t, position in positions]
        block = measured_block(project, notes)
        return block, with_undeclared_heights(project, block, notes)

    block, same = blocks()
    assert same is block
    edit(path, undeclared)
    block, lower = blocks()
    assert lower.undeclared_heights is not None
    by_m = lower.undeclared_heights.lowered_m
    assert by_m == pytest.approx(44.0, abs=3.0)
    for before, after in zip(block.photographs, lower.photographs, strict=True):
        assert before.gnss_world_m is not None
        assert after.gnss_world_m is not None
        np.testing.assert_allclose(before.gnss_world_m - after.gnss_world_m, [0.0, 0.0, by_m], atol=1e-3)
    edit(path, lambda v: lowered(v, -44.0))
    agreeing = blocks()[1].undeclared_heights
    assert agreeing is not None
    assert agreeing.lowered_m == 0.0


@pytest.mark.usefixtures("undrawn")
def test_an_undeclared_difference_is_estimated(finished_survey: Path, survey: Path, edit: Edit) -> None:
    """Heights of the control points are those of the results; GNSS heights are 44 m above them."""
    plain = json.loads((finished_survey / "results" / "quality/report.json").read_text())
    edit(survey / "project.yaml", undeclared)
    report = run_pipeline(load_project(survey / "project.yaml"))
    difference = report["heights"]["difference"]
    assert difference is not None
    assert not difference["same"]
    assert difference["difference_m"] == pytest.approx(44.0, abs=4.0 * difference["sigma_m"])
    assert difference["sigma_m"] < 0.2
    assert (
        "GNSS heights are ellipsoidal and those orthometric if the geoid lies so much above"
        in (report["heights"]["sentence"])
    )
    assert any("differ by +4" in warning["sentence"] for warning in report["warnings"])
    assert report["blunders"] == []
    with open_run(load_project(survey / "project.yaml")) as run:  # later stages see the block as it was adjusted
        assert block_as_adjusted(run).gnss_offset_sigma_m[2] == WIDEST_M
    before = oriented(plain["photographs"])
    for name, photograph in oriented(report["photographs"]).items():
        moved = np.array(photograph["position_map_m"]) - before[name]["position_map_m"]
        assert np.all(np.abs(moved - [0.0, 0.0, -44.0]) < photograph["sigma_m"])
    assert report["check_points"]["rmse_v_m"] == pytest.approx(plain["check_points"]["rmse_v_m"], abs=0.02)


@pytest.mark.usefixtures("undrawn")
def test_heights_of_one_system_that_nobody_declares_give_the_same_result(
    finished_survey: Path, survey: Path, edit: Edit
) -> None:
    plain = json.loads((finished_survey / "results" / "quality/report.json").read_text())
    edit(survey / "project.yaml", lambda v: undeclared(v, 0.0))
    report = run_pipeline(load_project(survey / "project.yaml"))
    difference = report["heights"]["difference"]
    assert difference is not None
    assert difference["same"]
    assert abs(difference["difference_m"]) < 4.0 * difference["sigma_m"]
    assert "they are of one system" in report["heights"]["sentence"]
    before = oriented(plain["photographs"])
    for name, photograph in oriented(report["photographs"]).items():
        moved = np.array(photograph["position_map_m"]) - before[name]["position_map_m"]
        assert np.all(np.abs(moved) < photograph["sigma_m"])  # other rays are rejected, three of 1700


@pytest.mark.usefixtures("undrawn")
def test_check_points_of_an_undeclared_system_are_compared_in_plan(survey: Path, edit: Edit) -> None:
    def check(values: dict[str, Any]) -> None:
        undeclared(values)
        for point in values["control_points"]["list"]:
            point["role"] = "check"

    edit(survey / "project.yaml", check)
    report = run_pipeline(load_project(survey / "project.yaml"))
    assert report["check_points"]["n_axis"][2] == 0
    assert report["check_points"]["n_axis"][0] == len(report["control_points"]) == 12
    assert {tuple(p["axis_roles"]) for p in report["control_points"]} == {("check", "check", "left out")}
    assert report["blunders"] == []


def test_tags_that_say_otherwise_are_named(survey: Path) -> None:
    (said,) = found(survey / "project.yaml", height_is_ellipsoidal=False)
    assert said.severity == "warning"
    assert (
        "according to the tags the heights are near sea level, but heights.gnss declares them ellipsoidal"
    ) in said.text


# ---- a whole survey over a geoid -----------------------------------------------------------------------------------


@pytest.mark.usefixtures("undrawn")
def test_a_survey_over_a_geoid_is_the_same_survey(
    finished_survey: Path, survey: Path, edit: Edit, sloping_geoid: Any
) -> None:
    """Control above the geoid, GNSS above the ellipsoid, results above the geoid: all differ by its height alone."""
    plain = json.loads((finished_survey / "results" / "quality/report.json").read_text())

    def above_geoid(values: dict[str, Any]) -> None:
        values["heights"] = {
            "output": "orthometric", "gnss": "ellipsoidal", "control_points": "orthometric",
            "geoid": "EGM96", "grid": sloping_geoid.path,
        }  # fmt: skip
        values["comparison"]["heights"] = "ellipsoidal"
        for point in values["control_points"]["list"]:
            point["position_m"][2] -= float(sloping_geoid.at("EPSG:25832", np.array([point["position_m"]]))[0])

    edit(survey / "project.yaml", above_geoid)
    report = run_pipeline(load_project(survey / "project.yaml"))
    assert report["adjustment"]["sigma0"] == pytest.approx(plain["adjustment"]["sigma0"], rel=1e-3)
    before = oriented(plain["photographs"])
    for name, photograph in oriented(report["photographs"]).items():
        place = np.array(before[name]["position_map_m"])
        place[2] -= sloping_geoid.at("EPSG:25832", place[None])[0]
        np.testing.assert_allclose(photograph["position_map_m"], place, rtol=0, atol=0.002)
        np.testing.assert_allclose(photograph["omega_phi_kappa_deg"], before[name]["omega_phi_kappa_deg"], atol=0.003)
    heights = report["heights"]
    assert (heights["output"], heights["geoid"]) == ("orthometric", "EGM96 (EPSG:5773)")
    origin = np.array([report["world"]["origin_map_m"]])
    assert heights["geoid_height_m"] == pytest.approx(sloping_geoid.at("EPSG:25832", origin)[0], abs=2e-5)
    assert heights["crs"]["name"] == "ETRS89 / UTM zone 32N + EGM96 height"
    assert heights["inputs"]["gnss"] == {"ellipsoidal": 4, "orthometric": 0, "undeclared": 0}
    assert heights["inputs"]["control_points"] == {"ellipsoidal": 0, "orthometric": 12, "undeclared": 0}
    assert heights["sentence"].startswith("All heights are above the geoid EGM96 (EPSG:5773) (ETRS89 / UTM zone 32N + ")
    assert "4 GNSS heights were given above the ellipsoid and transformed to it" in heights["sentence"]
    for name, cloud in report["clouds"].items():  # the reference is above the ellipsoid still
        assert cloud["median_m"] == pytest.approx(plain["clouds"][name]["median_m"], abs=0.005)
    words = '"EPSG:25832, heights above the geoid EGM96 (EPSG:5773)"'
    header, *lines = (survey / "results" / "technical/photographs.csv").read_text().splitlines()
    assert header.startswith("name,camera,")
    assert all(line.endswith(words) for line in lines)
    with rasterio.open(survey / "results" / "deliverables/dsm.tif") as dataset:
        assert 'VERT_CS["EGM96 height"' in dataset.crs.to_wkt(version="WKT1_GDAL")
    with laspy.open(survey / "results" / "technical/points_adjusted.laz") as reader:
        crs = reader.header.parse_crs()
        assert crs is not None
        assert crs.sub_crs_list[1].to_epsg() == 5773
        assert reader.header.mins[2] == pytest.approx(120.0 - 43.9, abs=15.0)


def test_a_survey_above_the_ellipsoid_says_so(finished_survey: Path) -> None:
    heights = json.loads((finished_survey / "results" / "quality/report.json").read_text())["heights"]
    assert (heights["output"], heights["geoid"], heights["geoid_height_m"]) == ("ellipsoidal", None, None)
    assert heights["sentence"] == "All heights are above the ellipsoid (ETRS89 / UTM zone 32N)."
    assert "ellipsoidal height" in heights["crs"]["wkt"]
