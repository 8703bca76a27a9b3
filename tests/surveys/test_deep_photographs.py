"""A simulated survey whose photographs have 16 bits a channel, of which they use little: it comes out as that of its
8-bit photographs does, and every part of the program sees the same 8 bits."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import yaml
from deep_files import tags_of_jpeg, write_tiff
from PIL import Image

from photogram.errors import ImageError
from photogram.exchange.solution_export import export_solution
from photogram.files.npz_json import read_json
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.images import read_photograph
from photogram.files.photographs.stretches import find_stretch
from photogram.marking.marking_survey import open_marking
from photogram.marking.page.patches import PatchReader, Window
from photogram.pipeline.input_validation import check_project
from photogram.pipeline.new_project import init
from photogram.pipeline.pipeline import load_project, open_run, remaining_stages, run_pipeline
from photogram.pipeline.view import read_pictures, read_results
from photogram.report.record.report import Report

Run = Callable[..., Any]
LOW, HIGH = 4000, 9000


def deepened(folder: Path) -> Path:
    """Put 16-bit TIFF with values from LOW to HIGH, and their tags, in place of the photographs of a survey."""
    for path in sorted((folder / "photographs").glob("*.JPG")):
        values = np.rint(LOW + read_photograph(path) * ((HIGH - LOW) / 255.0)).astype(np.uint16)
        write_tiff(path.with_suffix(".tif"), values, tags_of_jpeg(path))
        path.unlink()
    project = folder / "project.yaml"
    project.write_text(project.read_text(encoding="utf-8").replace(".JPG", ".tif"), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def pristine_deep(pristine_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The survey with deep photographs, not adjusted; not to be written to."""
    return deepened(Path(shutil.copytree(pristine_survey, tmp_path_factory.mktemp("deep") / "survey")))


@pytest.fixture(scope="module")
def finished(pristine_deep: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Report]:
    """The same, adjusted; not to be written to."""
    folder = Path(shutil.copytree(pristine_deep, tmp_path_factory.mktemp("finished") / "survey"))
    return folder, run_pipeline(load_project(folder / "project.yaml"))


@pytest.fixture
def deep(pristine_deep: Path, tmp_path: Path) -> Path:
    """A copy of the survey with deep photographs, not adjusted, for one test."""
    return Path(shutil.copytree(pristine_deep, tmp_path / "survey"))


def stretch_of(report: Report) -> Stretch:
    (own,) = report["stretches"].values()
    return Stretch(own["low_dn"], own["high_dn"])


def test_it_is_as_accurate_as_with_8_bits(finished: tuple[Path, Report], finished_survey: Path) -> None:
    """Against the simulated truth: 5000 values of 65 536 carry all of the contrast."""
    _, deep = finished
    shallow = read_json(finished_survey / "results" / "quality/report.json")
    assert deep["block"]["registered"] == shallow["block"]["registered"] == 4
    assert deep["suspects"] == shallow["suspects"] == []
    ours_m, theirs_m = (np.array(r["check_points"]["rmse_m"]) for r in (deep, shallow))
    assert (ours_m < 1.1 * theirs_m + 0.002).all()
    counts = [r["adjustment"]["observations"] for r in (deep, shallow)]
    assert counts[0] == pytest.approx(counts[1], rel=0.1)


def test_the_stretch_is_that_of_the_photographs(finished: tuple[Path, Report]) -> None:
    folder, report = finished
    paths = sorted((folder / "photographs").iterdir())
    stretch = stretch_of(report)
    assert stretch == find_stretch(paths)
    assert LOW <= stretch.low < LOW + 500
    assert HIGH - 600 < stretch.high <= HIGH
    with open_run(load_project(folder / "project.yaml")) as run:
        np.testing.assert_array_equal(run.pixels(1), read_photograph(paths[1], stretch=stretch))
        np.testing.assert_array_equal(
            run.grey(2), np.asarray(Image.fromarray(read_photograph(paths[2], stretch=stretch)).convert("L"))
        )
    page = (folder / "results" / "deliverables/report.html").read_text(encoding="utf-8")
    assert f"from {stretch.low} to {stretch.high} are stretched linearly to 0 to 255" in page
    assert report["marks"]["not_shown"] == []


def test_the_orthophoto_has_the_stretched_colours(finished: tuple[Path, Report], finished_survey: Path) -> None:
    folder, report = finished
    stretch = stretch_of(report)
    shares = np.linspace(0.1, 0.9, 9)
    tones = []
    for survey in (folder, finished_survey):
        with rasterio.open(survey / "results" / "deliverables/orthophoto.tif") as file:
            *colours, shown = file.read()
        tones.append(np.quantile(np.stack(colours)[:, shown > 0], shares, axis=1))
    values = LOW + tones[1] * (HIGH - LOW) / 255.0
    expected = np.clip(255.0 * (values - stretch.low) / (stretch.high - stretch.low), 0.0, 255.0)
    np.testing.assert_allclose(tones[0], expected, atol=4.0)


def test_a_finished_run_stays_and_another_stretch_is_made_again(finished: tuple[Path, Report], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(finished[0], tmp_path / "survey"))
    project = folder / "project.yaml"
    assert remaining_stages(load_project(project), until="orthophoto") == ()
    path = folder / "photographs" / "sim_0001.tif"
    bright = np.minimum(np.full((300, 400, 3), LOW) + np.arange(400)[:, None] * 150, 65535).astype(np.uint16)
    write_tiff(path, bright)
    again = remaining_stages(load_project(project))
    assert {"photographs", "features", "dense", "orthophoto"} <= set(again)


def test_the_view_has_stretched_pictures(finished: tuple[Path, Report], tmp_path: Path) -> None:
    results = finished[0] / "results"
    pictures = read_pictures(results, read_results(results), None)
    assert len(pictures.jpeg) == 4
    assert pictures.notes == ()
    preview = tmp_path / "preview.jpg"
    preview.write_bytes(pictures.jpeg["sim_0001.tif"])
    with Image.open(preview) as picture:
        assert np.ptp(np.asarray(picture.convert("L"))) > 150


def test_undistorted_photographs_are_stretched(finished: tuple[Path, Report], tmp_path: Path) -> None:
    export_solution(finished[0] / "project.yaml", "undistorted", tmp_path / "out")
    pixels = read_photograph(tmp_path / "out" / "images" / "sim_0002.jpg").astype(np.float64)
    original = read_photograph(finished[0] / "photographs" / "sim_0002.tif", stretch=stretch_of(finished[1]))
    assert abs(np.median(pixels) - np.median(original)) < 3.0


def test_marking_shows_the_same_8_bits_before_and_after(finished: tuple[Path, Report], deep: Path) -> None:
    before, after = (open_marking(folder / "project.yaml") for folder in (deep, finished[0]))
    assert before.stretches == after.stretches == (stretch_of(finished[1]),) * 4
    paths = [photograph.path for photograph in before.project.photographs]
    reader = PatchReader(paths, [(400, 300)] * 4, stretches=before.stretches)
    part = reader.pixels(3, Window(40, 60, 80, 50))
    reader.close()
    np.testing.assert_array_equal(part, read_photograph(paths[3], stretch=before.stretches[3])[60:110, 40:120])


def test_init_and_check_take_them_as_any_photograph(deep: Path, photogram: Run) -> None:
    found = init(deep / "photographs", focal_px=600.0, crs="EPSG:25832", project=deep / "new.yaml")
    assert [p.name for p in found.draft.photographs] == [f"sim_{i:04d}.tif" for i in range(1, 5)]
    assert not [f for f in check_project(deep / "new.yaml") if f.severity == "error"]
    outcome = photogram("check", deep / "project.yaml")
    assert outcome.code == 0, outcome.out


def test_one_photograph_of_8_bits_is_named_by_check_and_run(deep: Path) -> None:
    path = deep / "photographs" / "sim_0003.tif"
    Image.fromarray(read_photograph(path, stretch=Stretch(LOW, HIGH))).save(path, "TIFF")
    said = r"1 photograph of 4 \(sim_0003\.tif\) has 8 bits a channel, the others 16"
    errors = [f for f in check_project(deep / "project.yaml") if f.severity == "error"]
    assert len(errors) == 1
    assert re.search(said, errors[0].text)
    with pytest.raises(ImageError, match=rf"^camera \S+: {said}: export all .* alike[^\n]*\Z"):
        run_pipeline(load_project(deep / "project.yaml"))
    with pytest.raises(ImageError, match=said):
        open_marking(deep / "project.yaml")


def test_black_and_damaged_photographs_end_the_run_at_once(deep: Path) -> None:
    project = deep / "project.yaml"
    for path in (deep / "photographs").iterdir():
        write_tiff(path, np.full((300, 400, 3), 512, np.uint16))
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    with pytest.raises(ImageError, match="all its pixels have the value 512, and those of 3 further photographs too"):
        run_pipeline(load_project(project))
    path = deep / "photographs" / "sim_0002.tif"
    path.write_bytes(path.read_bytes()[:-5000])
    with pytest.raises(ImageError, match=r"\Aphotograph \S+sim_0002\.tif: cannot be decoded[^\n]*\Z"):
        run_pipeline(load_project(project))
    assert values["photographs"]


def test_8_bit_surveys_store_no_stretch(finished_survey: Path) -> None:
    assert not (finished_survey / "work" / "photographs.stage" / "stretches.json").exists()
    assert "stretches" not in read_json(finished_survey / "results" / "quality/report.json")
