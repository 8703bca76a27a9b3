"""Comparisons on the page: the figures of `photogram compare`, and nothing but what was chosen is read or removed."""

import json
import shlex
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from makers import write_platform

import photogram as pg
from photogram.desk.kept_measurements import KeptMeasurements
from photogram.desk.map_layers.asked import Asked, request_of
from photogram.desk.map_layers.choosing import parts_of, surfaces_in
from photogram.desk.map_layers.contour_layer import contour_layer
from photogram.desk.map_layers.kept_comparisons import FOLDER, ComparisonView, KeptComparisons
from photogram.errors import PhotogramError, ProjectError, SettingError, SurfaceError, WorkspaceError
from photogram.files.maps.rasters import read_raster
from photogram.grid import MapGrid
from photogram.report.kept_measurements import FILE
from photogram.result_files import result_path
from photogram.volumes.surfaces import StatedSigma

CRS = "EPSG:25832"
HALF_M = 7.0
DESIGN: Asked = {
    "path": "", "relation": "design", "own": "surface", "parts": [], "sigma_m": None, "correlation_m": None,
    "outlines": [], "stable": [], "taken_off": None,
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(finished_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(finished_survey, tmp_path_factory.mktemp("compared") / "survey"))


@pytest.fixture
def own(folder: Path) -> Path:
    """The survey without comparisons and measurements of another test."""
    shutil.rmtree(folder / FOLDER, ignore_errors=True)
    (folder / FILE).unlink(missing_ok=True)
    return folder


def middle(folder: Path) -> tuple[np.ndarray, float]:
    """The middle of the surface in plan, and its median height."""
    surface = read_raster(result_path(folder / "results", "dsm.tif"))[0]
    known = np.isfinite(surface.values)
    row, column = np.argwhere(known).mean(axis=0).astype(int)
    east, north = MapGrid.of(surface).centres_map_m(MapGrid.of(surface).whole)
    return np.array([east[column], north[row]]), float(np.median(surface.values[known]))


def square(folder: Path, half_m: float, east_m: float = 0.0) -> np.ndarray:
    place = middle(folder)[0] + [east_m, 0.0]
    return np.asarray(place + half_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))


@pytest.fixture(scope="module")
def design(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A level platform as LandXML."""
    path = tmp_path_factory.mktemp("designs") / "platform of Q1.xml"
    return write_platform(path, square(folder, HALF_M), middle(folder)[1])


@pytest.fixture(scope="module")
def earlier(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same survey half a metre lower, as an earlier one."""
    there = Path(shutil.copytree(folder, tmp_path_factory.mktemp("earlier") / "may"))
    path = result_path(there / "results", "dsm.tif")
    surface, crs = read_raster(path)
    lower = pg.Raster(surface.values - np.float32(0.5), surface.west_map_m, surface.north_map_m, surface.cell_m)
    pg.write_raster(path, lower, crs)
    return there


def compared(folder: Path, asked: Asked) -> ComparisonView:
    """Compare and wait for the end."""
    kept = KeptComparisons(folder)
    kept.start(asked, folder / "results", KeptMeasurements(folder / FILE, folder / "results", CRS))
    while kept.view()["under_way"]["name"] is not None:
        time.sleep(0.05)
    return kept.view()["comparisons"][0]


def figures(view: ComparisonView) -> dict[str, dict[str, tuple[float | None, float | None]]]:
    assert view["told"] is not None, view["problem"]
    return {v["name"]: {f["name"]: (f["value"], f["sigma"]) for f in v["figures"]} for v in view["told"]["volumes"]}


def test_volumes_of_a_design_are_those_of_compare(own: Path, design: Path, tmp_path: Path) -> None:
    measured = KeptMeasurements(own / FILE, own / "results", CRS)
    measured.add("height", [middle(own)[0].tolist()])
    measured.add("area", square(own, 3.0).tolist())
    measured.add("area", square(own, 1.0, east_m=4.5).tolist())
    view = compared(own, {**DESIGN, "path": str(design), "outlines": [1, 2]})
    request = pg.SurfaceRequest(
        design, own / "results", own / FOLDER / view["name"] / "outlines.gpkg", sigma=StatedSigma(0.0, 0.0)
    )
    change = pg.compare_surfaces(request, tmp_path / "out")
    found = figures(view)
    assert list(found) == ["Area 1", "Area 2", "all"]
    assert change.total is not None
    for volume in (*change.volumes, change.total):
        for name, pair in (
            ("fill", (volume.fill_m3, volume.fill_sigma_m3)),
            ("cut", (volume.cut_m3, volume.cut_sigma_m3)),
            ("net", (volume.net_m3, volume.net_sigma_m3)),
        ):
            np.testing.assert_allclose(np.array(found[volume.name][name], float), pair, rtol=0, atol=1e-9)
    assert found["Area 1"]["net"][1] is not None
    assert view["told"] is not None
    said = " ".join(view["told"]["said"])
    assert "platform of Q1.xml minus dsm.tif. Fill is what is still to be placed" in said
    assert "names no CRS: it is taken in that of dsm.tif" in said


def test_the_command_it_shows_does_the_same(
    own: Path, design: Path, tmp_path: Path, photogram: Callable[..., Any]
) -> None:
    view = compared(own, {**DESIGN, "path": str(design)})
    words = shlex.split(view["command"])
    assert words[:2] == ["photogram", "compare"]
    words[-1] = str(tmp_path / "out")
    outcome = photogram(*words[1:])
    assert outcome.code == 0, outcome.err
    for name in ("difference.tif", "difference_sigma.tif", "change.tif", "comparison.json", "volumes.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (own / FOLDER / view["name"] / name).read_bytes(), name


def test_another_epoch_and_what_it_says(own: Path, earlier: Path) -> None:
    measured = KeptMeasurements(own / FILE, own / "results", CRS)
    measured.add("area", square(own, 4.0).tolist())
    asked: Asked = {**DESIGN, "path": str(earlier), "relation": "earlier"}
    view = compared(own, asked)
    everywhere = figures(view)["everywhere"]
    assert everywhere["area in plan"][0] is not None
    assert everywhere["net"][0] == pytest.approx(0.5 * everywhere["area in plan"][0], rel=1e-4)
    assert view["told"] is not None
    said = " ".join(view["told"]["said"])
    for words in (
        "survey/dsm.tif minus may/dsm.tif",
        "common control points for example, is not taken off",
        "has not moved",
    ):
        assert words in said
    assert "surface" in [layer["name"] for layer in view["other_layers"]]
    told = compared(own, {**asked, "stable": [0]})["told"]
    assert told is not None
    assert any("offset +0.5000" in words and "not taken off (choose what is" in words for words in told["said"])
    taken = compared(own, {**asked, "stable": [0], "taken_off": "offset"})
    net = figures(taken)["everywhere"]["net"][0]
    assert net is not None
    assert abs(net) < 1e-3 * everywhere["area in plan"][0]
    turned = figures(compared(own, {**asked, "relation": "later"}))["everywhere"]
    assert turned["cut"][0] == pytest.approx(everywhere["fill"][0], abs=1e-9)


def test_terrain_is_compared_with_terrain_alone(own: Path, earlier: Path) -> None:
    """Never with the plants on the other survey's surface."""
    asked: Asked = {**DESIGN, "path": str(earlier), "relation": "earlier", "own": "terrain"}
    terrains = [result_path(folder / "results", "dtm.tif") for folder in (own, earlier)]
    assert all(path.is_file() for path in terrains)
    request = request_of(asked, own / "results", None, None)
    assert [request.later, request.earlier] == terrains
    terrains[1].rename(terrains[1].with_name("away.tif"))
    try:
        with pytest.raises(ProjectError, match="that survey has no terrain"):
            request_of(asked, own / "results", None, None)
    finally:
        terrains[1].with_name("away.tif").rename(terrains[1])


def test_what_changes_afterwards_is_said(own: Path, design: Path) -> None:
    own_design = shutil.copy(design, design.with_name("moved.xml"))
    kept = KeptComparisons(own)
    view = compared(own, {**DESIGN, "path": str(own_design)})
    assert not view["is_outdated"]
    Path(own_design).write_text(Path(own_design).read_text() + "\n")
    assert kept.view()["comparisons"][0]["is_outdated"]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"path": " "}, "choose a file or a folder"),
        ({"path": "/nowhere/design.xml"}, "not found"),
        ({"path": "@folder/photographs", "relation": "earlier"}, "no surface among its results"),
        ({"path": "@folder"}, "the folder of a survey is no design"),
        ({"path": "@design", "relation": "later"}, "says nothing of its errors"),
        ({"path": "@design", "outlines": [0]}, "there is no outline 1"),
        ({"path": "@design", "outlines": [7]}, "there is no outline 8"),
        ({"path": "@design", "outlines": [-1]}, "there is no outline 0"),
        ({"path": "@design", "stable": [1]}, "a design has no errors and no stable ground"),
        ({"path": "@folder", "relation": "earlier", "taken_off": "tilt"}, "has not moved"),
        ({"path": "@folder", "relation": "earlier", "sigma_m": [-1.0, 0.0]}, "two lengths in m"),
    ],
)
def test_what_cannot_be_compared_says_why(asked: Asked, message: str, own: Path, design: Path) -> None:
    measured = KeptMeasurements(own / FILE, own / "results", CRS)
    measured.add("height", [middle(own)[0].tolist()])
    path = asked["path"].replace("@folder", str(own)).replace("@design", str(design))
    with pytest.raises(PhotogramError, match=message):
        KeptComparisons(own).start({**DESIGN, **asked, "path": path}, own / "results", measured)
    assert not (own / FOLDER).exists()


def test_what_fails_on_the_way_is_kept_with_its_reason(own: Path, design: Path) -> None:
    other = design.with_name("elsewhere.xml")
    other.write_text(design.read_text().replace(">5", ">6"))
    view = compared(own, {**DESIGN, "path": str(other)})
    assert view["told"] is None
    assert "do not overlap" in view["problem"]
    KeptComparisons(own).remove(view["name"])
    assert KeptComparisons(own).view()["comparisons"] == []


def test_only_what_was_written_is_served_and_removed(own: Path, earlier: Path) -> None:
    view = compared(own, {**DESIGN, "path": str(earlier), "relation": "earlier"})
    kept, name = KeptComparisons(own), view["name"]
    assert kept.file(name, "difference.tif").is_file()
    assert kept.file(name, "other/surface") == result_path(earlier / "results", "dsm.tif")
    for file in ("asked.json", "../../project.yaml", "other/../project.yaml", "other/nothing", "/etc/passwd", ""):
        with pytest.raises(WorkspaceError, match="no raster of this comparison"):
            kept.file(name, file)
    for wrong in ("..", "", "../results", "results", f"{name}/.."):
        with pytest.raises(WorkspaceError, match="no comparison is called so"):
            kept.file(wrong, "difference.tif")
        with pytest.raises(WorkspaceError, match="no comparison is called so"):
            kept.remove(wrong)
    mine = own / FOLDER / name / "mine.txt"
    mine.write_text("kept")
    with pytest.raises(WorkspaceError, match="see what else lies in it"):
        kept.remove(name)
    assert mine.is_file()


def test_one_that_was_interrupted_is_said_to_be(own: Path, design: Path) -> None:
    view = compared(own, {**DESIGN, "path": str(design)})
    path = own / FOLDER / view["name"] / "asked.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "told": None}))
    assert KeptComparisons(own).view()["comparisons"][0]["problem"] == "It was interrupted: compare again."
    path.write_text("{")
    with pytest.raises(WorkspaceError, match="cannot be read"):
        KeptComparisons(own).view()


def test_one_that_ends_while_it_is_asked_for_is_not_taken_for_interrupted(
    own: Path, design: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The comparison ends between the reading of its record and what is said to be under way."""
    kept = KeptComparisons(own)
    read = KeptComparisons._record

    def slow(self: KeptComparisons, name: str) -> Any:
        record = read(self, name)
        while kept._under_way["name"] is not None:
            time.sleep(0.01)
        return record

    monkeypatch.setattr(KeptComparisons, "_record", slow)
    asked: Asked = {**DESIGN, "path": str(design)}
    kept.start(asked, own / "results", KeptMeasurements(own / FILE, own / "results", CRS))
    view = kept.view()
    (comparison,) = view["comparisons"]
    assert comparison["told"] is not None or (view["under_way"]["name"], comparison["problem"]) == (
        comparison["name"],
        "",
    )


def test_what_can_be_chosen_is_listed(own: Path, design: Path) -> None:
    listing = surfaces_in(own.parent)
    assert [(one["name"], one["is_folder"], one["is_survey"]) for one in listing["entries"]] == [("survey", True, True)]
    assert design.name in [one["name"] for one in surfaces_in(design.parent)["entries"]]
    names = [one["name"] for one in surfaces_in(own / "results/deliverables")["entries"]]
    assert "dsm.tif" in names
    assert "contours.gpkg" not in names
    with pytest.raises(WorkspaceError, match="cannot be read"):
        surfaces_in(own / "none")


def test_parts_of_a_design_are_listed_and_chosen(own: Path, design: Path) -> None:
    other = design.with_name("two.xml")
    text = design.read_text()
    surface = text[text.index("<Surface name") : text.index("</Surfaces>")]
    other.write_text(
        text.replace(
            "</Surfaces>", surface.replace('"platform"', '"rim"').replace(">1 2 3<", " i='1'>1 2 3<") + "</Surfaces>"
        )
    )
    assert parts_of(design) == {"what": "surface", "triangles": {"platform": 2}}
    assert parts_of(other) == {"what": "surface", "triangles": {"platform": 2, "rim": 1}}
    asked: Asked = {**DESIGN, "path": str(other)}
    assert "choose (--part NAME) of 'platform'" in compared(own, asked)["problem"]
    areas = [
        figures(compared(own, {**asked, "parts": [part]}))["everywhere"]["area in plan"][0]
        for part in ("rim", "platform")
    ]
    assert areas[0] == pytest.approx(0.5 * float(areas[1] or 0.0), rel=0.1)
    with pytest.raises(ProjectError, match="are read as triangulations"):
        parts_of(own)


def test_contour_lines_are_those_delivered_or_of_another_interval(own: Path, tmp_path: Path) -> None:
    results = own / "results"
    delivered = contour_layer(results, CRS)
    assert delivered["of"] == "contours.gpkg of the results"
    heights = {line["height_m"] for line in delivered["lines"]}
    assert heights
    for height in heights:
        assert height / delivered["interval_m"] == pytest.approx(round(height / delivered["interval_m"]), abs=1e-6)
    for line in delivered["lines"]:
        assert line["is_index"] == (round(line["height_m"] / delivered["interval_m"]) % 5 == 0)
    finer = contour_layer(results, CRS, delivered["interval_m"] / 2)
    assert "traced from cells" in finer["of"]
    assert len({line["height_m"] for line in finer["lines"]}) > len(heights)
    with pytest.raises(SettingError, match=r"0\.01 to 1000 m"):
        contour_layer(results, CRS, 0.0)
    with pytest.raises(SettingError):
        contour_layer(results, CRS, float("nan"))
    with pytest.raises(SurfaceError, match="run the survey first"):
        contour_layer(tmp_path, CRS)
    (tmp_path / "deliverables").mkdir()
    (tmp_path / "deliverables/contours.gpkg").write_bytes(b"damaged")
    with pytest.raises(ProjectError, match="cannot be read"):
        contour_layer(tmp_path, CRS)
