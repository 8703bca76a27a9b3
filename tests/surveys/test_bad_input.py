"""What a user can get wrong: each fault ends in one clear line, exit code 1 and no traceback."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from photogram.files.photographs.images import read_tags, write_photograph
from photogram.pipeline.pipeline import load_project, run_pipeline

Values = dict[str, Any]
Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[Values], object]], None]


def check_fault(outcome: Any, *fragments: str, lines: int = 1) -> None:
    assert outcome.code == 1, outcome
    assert "Traceback" not in outcome.err + outcome.out
    assert outcome.err.startswith("photogram: ")
    assert outcome.err.endswith("\n")
    assert outcome.err.count("\n") == lines, outcome.err
    for fragment in fragments:
        assert fragment in outcome.err


def point(values: Values, name: str) -> Values:
    return next(p for p in values["control_points"]["list"] if p["name"] == name)


# ---- the project file ----------------------------------------------------------------------------------------------


def misspell(values: Values) -> None:
    values["cameras"]["simulated"]["focal_lenght_px"] = values["cameras"]["simulated"].pop("focal_px")


def mark_outside(values: Values) -> None:
    point(values, "G02")["marks"]["sim_0003.JPG"] = [170, 301]


def name_twice(values: Values) -> None:
    point(values, "G04")["name"] = "G03"


def swap_one(values: Values) -> None:
    easting, northing, height = point(values, "G05")["position_m"]
    point(values, "G05")["position_m"] = [northing, easting, height]


def swap_all(values: Values) -> None:
    for p in values["control_points"]["list"]:
        p["position_m"] = [p["position_m"][1], p["position_m"][0], p["position_m"][2]]


def placeholder(values: Values) -> None:
    point(values, "G06")["position_m"][2] = 9999.0


def wrong_reference(values: Values) -> None:
    values["comparison"]["reference"] = "not_there.tif"


def absent_photograph(values: Values) -> None:
    values["photographs"]["list"].append({"name": "sim_0009.JPG"})


FILE_FAULTS: dict[str, tuple[Callable[[Values], object], tuple[str, ...]]] = {
    "unknown key": (lambda v: v["features"].update(maximun=800), ("features.maximun: unknown key", "'maximum'?")),
    "mark outside": (mark_outside, ("[G02].marks.sim_0003.JPG", "(170, 301)", "400 × 300 px", "check the order")),
    "one name twice": (name_twice, ("'G03' is used twice, first in line", "give each its own name")),
    "geographic CRS": (
        lambda v: v.update(crs="EPSG:4326"),
        ("'EPSG:4326' (WGS 84) is not a projected CRS", "UTM zone"),
    ),
    "unknown CRS": (lambda v: v.update(crs="EPSG:99999"), ("crs: 'EPSG:99999'", "expected e.g. EPSG:25832")),
    "far zone": (lambda v: v.update(crs="EPSG:2193"), ("outside the area of use of EPSG:2193", "check crs")),
    "no CRS": (lambda v: v.pop("crs"), ("crs: ",)),
    "swapped": (swap_one, ("[G05].position_m: easting and northing look swapped", "write [easting, northing")),
    "all swapped": (swap_all, ("easting and northing look swapped in all 12", "write [easting, northing, height]")),
    "height 9999": (placeholder, ("[G06].position_m: height 9999 m", "give the surveyed height")),
    "no reference": (wrong_reference, ("comparison.reference: file", "not_there.tif")),
    "missing photograph": (absent_photograph, ("1 of 5 photographs are not in", "sim_0009.JPG", "--photographs DIR")),
}


@pytest.mark.parametrize("kind", FILE_FAULTS)
def test_fault_of_the_project_file(survey: Path, photogram: Run, edit: Edit, kind: str) -> None:
    change, fragments = FILE_FAULTS[kind]
    edit(survey / "project.yaml", change)
    check_fault(photogram("adjust", survey / "project.yaml"), *fragments)
    assert not (survey / "work").exists()


def test_every_fault_of_one_file_at_once(survey: Path, photogram: Run, edit: Edit) -> None:
    changes = (misspell, mark_outside, name_twice, swap_one, placeholder, wrong_reference)

    def spoil(values: Values) -> None:
        for change in changes:
            change(values)

    edit(survey / "project.yaml", spoil)
    (survey / "photographs/sim_0002.JPG").unlink()
    outcome = photogram("adjust", survey / "project.yaml")
    # the misspelt focal length is an unknown key, and a missing one
    faults = len(changes) + 2
    check_fault(outcome, f"project.yaml has {faults} errors:", lines=faults + 1)
    for fragment in ("focal_lenght_px", "give focal_px", "(170, 301)", "'G03'", "swapped", "9999", "not_there", "0002"):
        assert fragment in outcome.err
    numbers = [int(line.split("project.yaml:")[1].split(":")[0]) for line in outcome.err.splitlines()[1:]]
    assert numbers == sorted(numbers)


@pytest.mark.parametrize("content", ["crs: [EPSG:25832\n", "photogram: 1\n\tcrs: x\n", "crs: 'EPSG\n"])
def test_project_file_is_not_yaml(tmp_path: Path, photogram: Run, content: str) -> None:
    (tmp_path / "project.yaml").write_text(content)
    check_fault(photogram("adjust", tmp_path / "project.yaml"), "project.yaml:", "not valid YAML", "check indentation")


def test_no_project_file(tmp_path: Path, photogram: Run) -> None:
    remedy = "give the path of a project.yaml"
    check_fault(photogram("adjust", tmp_path / "none.yaml"), "none.yaml: cannot be read (No such file", remedy)
    check_fault(photogram("adjust", tmp_path), f"{tmp_path}/project.yaml: cannot be read", remedy)
    check_fault(photogram("study", "ransac", tmp_path / "none.yaml"), "none.yaml: cannot be read (No such file", remedy)


# ---- photographs ---------------------------------------------------------------------------------------------------


def test_truncated_photographs_are_all_named(survey: Path, photogram: Run) -> None:
    for name in ("sim_0002.JPG", "sim_0003.JPG"):
        path = survey / "photographs" / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    outcome = photogram("adjust", survey / "project.yaml", "--no-check")
    check_fault(outcome, "sim_0002.JPG", "sim_0003.JPG", "truncated", lines=2)


def test_something_else_under_the_name_of_a_photograph(survey: Path, photogram: Run) -> None:
    (survey / "photographs/sim_0001.JPG").write_text("not a picture")
    check_fault(photogram("adjust", survey / "project.yaml", "--no-check"), "sim_0001.JPG")
    (survey / "photographs/sim_0001.JPG").write_bytes(b"")
    check_fault(photogram("adjust", survey / "project.yaml", "--no-check"), "sim_0001.JPG")


def test_photographs_of_another_size_than_the_camera(survey: Path, photogram: Run, edit: Edit) -> None:
    edit(survey / "project.yaml", lambda v: v["cameras"]["simulated"].update(width_px=480))
    outcome = photogram("adjust", survey / "project.yaml", "--no-check")
    check_fault(outcome, *(f"sim_000{i}.JPG" for i in range(1, 5)), "400 × 300", "480 × 300", lines=4)


def repaint(survey: Path, name: str, pixels: np.ndarray[Any, np.dtype[np.uint8]]) -> None:
    path = survey / "photographs" / name
    write_photograph(path, pixels, read_tags(path))


def test_blank_photograph(survey: Path, photogram: Run) -> None:
    repaint(survey, "sim_0003.JPG", np.full((300, 400, 3), 127, np.uint8))
    outcome = photogram("adjust", survey / "project.yaml")
    check_fault(outcome, "sim_0003.JPG: only 0 key points", "blank, blurred or black", "remove it")


def test_photographs_that_show_nothing_in_common(survey: Path, photogram: Run) -> None:
    for seed, path in enumerate(sorted((survey / "photographs").iterdir())):
        coarse = np.random.default_rng(seed).integers(0, 256, (60, 80, 3), dtype=np.uint8)
        repaint(survey, path.name, np.asarray(Image.fromarray(coarse).resize((400, 300), Image.Resampling.BICUBIC)))
    check_fault(
        photogram("adjust", survey / "project.yaml"),
        "no two of the 4 photographs have 20 verified matches",
        "overlap by 60 %",
    )


# ---- control -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def matched_survey(pristine_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the survey, its photographs without tags, up to its tie points; not to be written to."""
    folder = Path(shutil.copytree(pristine_survey, tmp_path_factory.mktemp("untagged") / "survey"))
    for path in (folder / "photographs").iterdir():
        pixels = np.asarray(Image.open(path))
        Image.fromarray(pixels).save(path, "JPEG", quality=95)
    run_pipeline(load_project(folder / "project.yaml"), until="tie_points")
    return folder


@pytest.fixture
def untagged(matched_survey: Path, tmp_path: Path) -> Path:
    """A copy of it, for one test."""
    return Path(shutil.copytree(matched_survey, tmp_path / "survey"))


def test_too_few_control_points_and_nothing_else(untagged: Path, photogram: Run, edit: Edit) -> None:
    """Two points: each photograph can be joined to the others, but the block cannot be placed in the map."""

    def leave_two(values: Values) -> None:
        points = values["control_points"]["list"]
        control = [p for p in points if p["role"] == "control"]
        values["control_points"]["list"] = control[:2] + [p for p in points if p["role"] == "check"]

    edit(untagged / "project.yaml", leave_two)
    outcome = photogram("adjust", untagged / "project.yaml", "--no-check")
    check_fault(
        outcome, "cannot be georeferenced in EPSG:25832", "control points are marked", "give at least three of either"
    )


def test_check_points_do_not_stand_in_for_control(untagged: Path, photogram: Run, edit: Edit) -> None:
    def demote(values: Values) -> None:
        for p in values["control_points"]["list"]:
            p["role"] = "check"

    edit(untagged / "project.yaml", demote)
    check_fault(photogram("adjust", untagged / "project.yaml", "--no-check"), "control points", "GNSS")


def test_collinear_control(untagged: Path, photogram: Run, edit: Edit) -> None:
    def line_up(values: Values) -> None:
        for i, p in enumerate(values["control_points"]["list"]):
            p["position_m"] = [602330.0 + 2.0 * i, 5794110.0 + 1.0 * i, 120.0]

    edit(untagged / "project.yaml", line_up)
    outcome = photogram("adjust", untagged / "project.yaml", "--no-check")
    check_fault(outcome, "cannot be georeferenced in EPSG:25832", "control points are marked", "not collinear")


def test_no_control_and_no_positions(untagged: Path, photogram: Run, edit: Edit) -> None:
    edit(untagged / "project.yaml", lambda v: v.pop("control_points"))
    outcome = photogram("adjust", untagged / "project.yaml", "--no-check")
    check_fault(outcome, "neither control points nor GNSS positions", "give control_points")


# ---- folders and files ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["results", "work"])
def test_a_file_where_a_folder_should_be(survey: Path, photogram: Run, edit: Edit, key: str) -> None:
    (survey / "taken").write_text("a file")
    edit(survey / "project.yaml", lambda v: v.update({key: "taken"}))
    outcome = photogram("adjust", survey / "project.yaml", "--no-check")
    check_fault(outcome, str(survey / "taken"))
    checked = photogram("check", survey / "project.yaml")
    assert checked.code == 1
    assert key in checked.out
    assert (survey / "taken").read_text() == "a file"


def test_a_file_where_a_command_should_write(adjusted_survey: Path, tmp_path: Path, photogram: Run) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file")
    cloud, surface = adjusted_survey / "results/technical/points_adjusted.txt", adjusted_survey / "truth_surface.tif"
    check_fault(photogram("compare", cloud, "--reference", surface, "--output", taken), str(taken), "choose another")
    check_fault(photogram("demo", taken / "demo"), str(taken / "demo"), "choose another")
    (adjusted_survey / "results/technical/study").write_text("a file")
    outcome = photogram(
        "study", "ransac", adjusted_survey / "project.yaml", "--iterations", "10", "--sample-sizes", "8"
    )
    check_fault(outcome, str(adjusted_survey / "results/technical/study"), "choose another")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="this user may write everywhere")
def test_results_that_may_not_be_written(adjusted_survey: Path, photogram: Run) -> None:
    (adjusted_survey / "results").chmod(0o500)
    outcome = photogram("adjust", adjusted_survey / "project.yaml", "--from", "results")
    (adjusted_survey / "results").chmod(0o700)
    check_fault(outcome, str(adjusted_survey / "results"), "Permission denied")


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
def test_damaged_reference(adjusted_survey: Path, photogram: Run) -> None:
    path = adjusted_survey / "truth_surface.tif"
    os.truncate(path, 300)
    outcome = photogram("adjust", adjusted_survey / "project.yaml", "--until", "comparison")
    assert outcome.code == 1, outcome
    assert "truth_surface.tif" in outcome.out.replace("\n", "")
    assert "Nothing was processed" in outcome.out


def test_reference_of_another_place(adjusted_survey: Path, photogram: Run, edit: Edit) -> None:
    (adjusted_survey / "elsewhere.txt").write_text("".join(f"{x},{y},{x + y}\n" for x in range(10) for y in range(10)))
    edit(adjusted_survey / "project.yaml", lambda v: v["comparison"].update(reference="elsewhere.txt"))
    outcome = photogram("adjust", adjusted_survey / "project.yaml", "--until", "comparison")
    check_fault(outcome, "does not overlap the cloud; it lies", "km south of the survey: check its CRS")


def test_damaged_clouds_of_a_comparison(finished_survey: Path, tmp_path: Path, photogram: Run) -> None:
    good, reference = finished_survey / "results/technical/points_adjusted.txt", finished_survey / "truth_surface.tif"
    check_fault(photogram("compare", tmp_path / "none.txt", "--reference", reference), "none.txt")
    check_fault(photogram("compare", good, "--reference", tmp_path / "none.tif", "--output", tmp_path), "none.tif")
    (tmp_path / "words.txt").write_text("x,y,z\n1,2,three\n")
    check_fault(photogram("compare", tmp_path / "words.txt", "--reference", reference), "words.txt")
    (tmp_path / "broken.laz").write_bytes(
        (finished_survey / "results/technical/points_adjusted.laz").read_bytes()[:2000]
    )
    check_fault(photogram("compare", tmp_path / "broken.laz", "--reference", reference), "broken.laz")
