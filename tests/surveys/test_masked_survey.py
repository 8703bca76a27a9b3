"""A survey whose drone has its own landing gear in every photograph: without a mask the orthophoto shows it all over;
with one, nothing is measured in it and nothing shows it. What depends on a mask is made again when it changes."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from makers import undrawing_unless_all

from photogram.errors import ImageError
from photogram.files.npz_json import read_json
from photogram.files.photographs.images import read_photograph, read_tags, write_photograph
from photogram.files.photographs.masks import read_mask, write_mask
from photogram.pipeline.pipeline import load_project, open_run, remaining_stages, run_pipeline
from photogram.pipeline.stages.features import stored_features
from photogram.pipeline.stages.orientation import transferred_tie_points
from photogram.report.record.report import Report
from photogram.result_files import result_path

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
GEAR = (slice(100, 200), slice(130, 270))
USED = np.ones((300, 400), dtype=bool)
USED[GEAR] = False


def paint(folder: Path) -> None:
    """Put the same textured, magenta patch into the middle of every photograph."""
    rng = np.random.default_rng(1)
    texture = np.kron(rng.integers(60, 256, (25, 35)), np.ones((4, 4)))
    patch = np.stack([texture, 0.0 * texture, texture], axis=-1).astype(np.uint8)
    for path in sorted((folder / "photographs").iterdir()):
        pixels, tags = read_photograph(path).copy(), read_tags(path)
        pixels[GEAR] = patch
        write_photograph(path, pixels, tags)


def magenta_cells(folder: Path) -> int:
    with rasterio.open(folder / "results" / "deliverables/orthophoto.tif") as file:
        red, green, blue, alpha = (band.astype(int) for band in file.read())
    return int(np.count_nonzero((red - green > 40) & (blue - green > 40) & (alpha > 0)))


def with_gear_mask(values: dict[str, Any]) -> None:
    for camera in values["cameras"].values():
        camera["mask"] = "gear.png"


@pytest.fixture(scope="module")
def both(pristine_survey: Path, edit: Edit, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Report]]:
    """The survey with the gear in its photographs, run without a mask and with one; not to be written to."""
    found = {}
    for name in ("free", "masked"):
        folder = tmp_path_factory.mktemp(name) / "survey"
        shutil.copytree(pristine_survey, folder)
        paint(folder)
        if name == "masked":
            write_mask(folder / "gear.png", USED)
            edit(folder / "project.yaml", with_gear_mask)
        with undrawing_unless_all():
            found[name] = folder, run_pipeline(load_project(folder / "project.yaml"))
    return found


def test_the_orthophoto_shows_the_gear_only_without_a_mask(both: dict[str, tuple[Path, Report]]) -> None:
    assert magenta_cells(both["free"][0]) > 2000
    assert magenta_cells(both["masked"][0]) == 0


def test_nothing_is_measured_in_masked_pixels(both: dict[str, tuple[Path, Report]]) -> None:
    folder, _ = both["masked"]
    with open_run(load_project(folder / "project.yaml")) as run:
        places = [stored_features(run, i).pixel for i in range(4)] + [transferred_tie_points(run).pixel]
        free = [stored_features(run, i) for i in range(4)]
    for pixel in places:
        column, row = np.rint(pixel).astype(int).T
        assert USED[row, column].all()
    assert min(map(len, free)) > 300
    with open_run(load_project(both["free"][0] / "project.yaml")) as run:
        column, row = np.rint(stored_features(run, 0).pixel).astype(int).T
    assert np.count_nonzero(~USED[row, column]) > 20


def test_the_report_counts_masks_and_what_they_leave_out(both: dict[str, tuple[Path, Report]]) -> None:
    folder, report = both["masked"]
    masks = report["masks"]
    share = 1.0 - USED.mean()
    assert (masks["given"], masks["automatic"]) == (4, 0)
    assert masks["given_share"] == pytest.approx(share)
    assert all(m["given"] == pytest.approx(share) and m["automatic"] is None for m in masks["photographs"].values())
    page = (folder / "results" / "deliverables/report.html").read_text(encoding="utf-8")
    assert "4 of 4 photographs have masks, which leave out 11.7\u202f% of them" in page
    assert "masks" not in both["free"][1]


def test_cells_that_only_masked_photographs_show_are_no_holes(both: dict[str, tuple[Path, Report]]) -> None:
    rim = read_json(both["masked"][0] / "work" / "orthophoto.stage" / "rim.json")
    free = read_json(both["free"][0] / "work" / "orthophoto.stage" / "rim.json")
    assert free["masked"] == 0
    assert rim["masked"] > 0
    assert rim["transparent"] <= free["transparent"] + 0.01 * rim["cells"]


def test_a_changed_mask_repeats_what_depends_on_it(both: dict[str, tuple[Path, Report]], tmp_path: Path) -> None:
    folder = tmp_path / "survey"
    shutil.copytree(both["masked"][0], folder)
    assert remaining_stages(load_project(folder / "project.yaml"), until="orthophoto") == ()
    other = USED.copy()
    other[:10] = False
    write_mask(folder / "gear.png", other)
    again = remaining_stages(load_project(folder / "project.yaml"))
    assert "photographs" not in again
    assert {"features", "matches", "transfer", "adjustment", "dense", "orthophoto"} <= set(again)
    write_mask(folder / "gear.png", USED)
    assert remaining_stages(load_project(folder / "project.yaml"), until="orthophoto") == ()


@pytest.mark.usefixtures("undrawn")
def test_masks_that_leave_everything_change_no_result(finished_survey: Path, edit: Edit, tmp_path: Path) -> None:
    """But for the few pixels at no border: there is none, so every key point is the same."""
    folder = tmp_path / "survey"
    shutil.copytree(finished_survey, folder)
    write_mask(folder / "gear.png", np.ones_like(USED))
    edit(folder / "project.yaml", with_gear_mask)
    run_pipeline(load_project(folder / "project.yaml"))
    for name in ("tie_points.npz", "points_adjusted.txt", "dsm.tif", "orthophoto.tif"):
        masked, whole = (result_path(of / "results", name).read_bytes() for of in (folder, finished_survey))
        assert masked == whole, name


def test_a_mask_that_cannot_be_used_ends_the_run_before_key_points(
    both: dict[str, tuple[Path, Report]], tmp_path: Path
) -> None:
    folder = tmp_path / "survey"
    shutil.copytree(both["masked"][0], folder)
    write_mask(folder / "gear.png", np.zeros_like(USED))
    with pytest.raises(ImageError, match="all of it is black") as raised:
        run_pipeline(load_project(folder / "project.yaml"))
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.usefixtures("undrawn")
def test_photographs_that_look_straight_down_show_no_sky(
    both: dict[str, tuple[Path, Report]], edit: Edit, tmp_path: Path
) -> None:
    folder = tmp_path / "survey"
    shutil.copytree(both["masked"][0], folder)
    edit(folder / "project.yaml", lambda v: v["photographs"].update(masks={"auto": ["sky"]}))
    project = load_project(folder / "project.yaml")
    again = remaining_stages(project)
    assert again[0] == "transfer"
    report = run_pipeline(project)
    assert report is not None
    assert report["masks"]["automatic"] == 0
    assert report["masks"]["given"] == 4
    assert not (folder / "results" / "technical/masks").exists()
    assert read_mask(folder / "gear.png").sum() == USED.sum()
