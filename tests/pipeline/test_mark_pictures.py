"""Pictures of marks cut from the photographs of a survey, and how the kinds of marks come to the report."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from makers import read_json

from photogram.errors import ImageError
from photogram.files.photographs.images import read_patches, read_photograph
from photogram.files.tables.surveyed_points import IMPORTED
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.publishing import mark_pictures as module
from photogram.pipeline.stages.publishing.mark_pictures import (
    FINEST_PX,
    HALF_PX,
    MOST_HALF_PX,
    mark_kinds,
    mark_pictures,
)
from photogram.report.figures.mark_patches import PhotographPatch, figure_key, mark_figure
from photogram.report.record.ground import GroundPointRecord

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def points_of(survey: Path) -> list[GroundPointRecord]:
    return list(read_json(survey / "results/quality/report.json")["control_points"])


def test_each_photograph_is_decoded_once_and_gives_what_is_around_its_marks(
    finished_survey: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = points_of(finished_survey)
    decoded: list[str] = []
    taken: dict[str, dict[str, PhotographPatch]] = {}
    read, draw = read_patches, mark_figure

    def noted(path: Path, *arguments: Any) -> Any:
        decoded.append(path.name)
        return read(path, *arguments)

    def kept(point: GroundPointRecord, patches: dict[str, PhotographPatch]) -> Any:
        taken[point["name"]] = patches
        return draw(point, patches)

    monkeypatch.setattr(module, "read_patches", noted)
    monkeypatch.setattr(module, "mark_figure", kept)
    with open_run(load_project(finished_survey / "project.yaml")) as run:
        made = mark_pictures(run, points)
    assert made.not_shown == []
    marked = {mark["photograph"] for point in points for mark in point["marks"]}
    assert sorted(decoded) == sorted(marked)
    assert [f.key for f in made.figures] == [figure_key(p["name"]) for p in points if p["marks"]]
    for point in points:
        for mark in point["marks"]:
            patch = taken[point["name"]][mark["photograph"]]
            whole = read_photograph(finished_survey / "photographs" / mark["photograph"])
            left, upper = int(patch.left_px), int(patch.upper_px)
            rows, columns = patch.pixels.shape[:2]
            np.testing.assert_array_equal(patch.pixels, whole[upper : upper + rows, left : left + columns])
            u, v = mark["pixel"]
            assert left - 0.5 <= u <= left + columns - 0.5
            assert upper - 0.5 <= v <= upper + rows - 0.5


def test_a_photograph_that_cannot_be_read_is_told_and_the_others_are_shown(adjusted_survey: Path) -> None:
    points = points_of(adjusted_survey)
    photographs = adjusted_survey / "photographs"
    with open_run(load_project(adjusted_survey / "project.yaml")) as run:
        assert run.photograph_fingerprints
        (photographs / "sim_0002.JPG").unlink()
        (photographs / "sim_0003.JPG").write_bytes((photographs / "sim_0001.JPG").read_bytes())
        made = mark_pictures(run, points)
    reasons = {entry["photograph"]: entry["reason"] for entry in made.not_shown}
    assert set(reasons) == {"sim_0002.JPG", "sim_0003.JPG"}
    assert "not found" in reasons["sim_0002.JPG"]
    assert "modified since the run began" in reasons["sim_0003.JPG"]
    assert not any(str(adjusted_survey) in reason for reason in reasons.values())
    assert made.figures


@pytest.mark.usefixtures("undrawn")
def test_the_report_says_which_photographs_could_not_be_read(
    adjusted_survey: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(path: Path, *_: object) -> list[object]:
        raise ImageError(f"photograph {path}: cannot be read (Input/output error): check its permissions")

    monkeypatch.setattr(module, "read_patches", unreadable)
    run_pipeline(load_project(adjusted_survey / "project.yaml"), start="results")
    said = read_json(adjusted_survey / "results/quality/report.json")["marks"]["not_shown"]
    assert {entry["reason"] for entry in said} == {"cannot be read (Input/output error): check its permissions"}
    page = (adjusted_survey / "results/deliverables/report.html").read_text(encoding="utf-8")
    assert f"Marks in {len(said)} photographs are not shown" in page
    assert "cannot be read (Input/output error)" in page
    assert "No pictures of the marks" not in page


@pytest.mark.parametrize("pixel", [(0.0, 0.0), (-0.5, 899.4), (1199.4, 450.0), (600.2, 300.7)])
@pytest.mark.parametrize("off_px", [0.1, 60.0, 190.0, 900.0])
def test_what_is_cut_lies_within_the_photograph_and_shows_the_adjusted_place_where_it_is_near(
    pixel: tuple[float, float], off_px: float
) -> None:
    camera: Any = type("Camera", (), {"width_px": 1200, "height_px": 900})
    towards = 1.0 if pixel[0] < 600 else -1.0
    mark: Any = {"pixel": list(pixel), "residual_px": [towards * off_px, 0.0]}
    window = module._window(mark, camera)
    left, upper, right, lower = window.box
    assert 0 <= left < right <= 1200
    assert 0 <= upper < lower <= 900
    assert left - 0.5 <= pixel[0] <= right - 0.5
    assert upper - 0.5 <= pixel[1] <= lower - 0.5 + window.reduction
    assert max(right - left, lower - upper) / window.reduction <= FINEST_PX + 2
    if off_px == 0.1 or off_px > MOST_HALF_PX:
        assert (window.half_px, window.reduction) == (HALF_PX, 1)
    else:
        assert window.half_px > off_px
        assert left - 1 <= pixel[0] + towards * off_px <= right + window.reduction


# ---- kinds ---------------------------------------------------------------------------------------------------------


def with_tables(survey: Path, edit: Edit, kinds: Callable[[int], str]) -> int:
    """Give the points of a survey in a table, and their marks in another with their kinds; returns their number."""
    marks = ["point,photograph,u,v,sigma_u,sigma_v,kind,raw_u,raw_v"]

    def moved(values: dict[str, Any]) -> None:
        points = ["name,easting,northing,height,role"]
        for point in values["control_points"].pop("list"):
            points.append(",".join(map(str, (point["name"], *point["position_m"], point["role"]))))
            for photograph, (u, v) in point["marks"].items():
                marks.append(f"{point['name']},{photograph},{u},{v},0.3,0.3,{kinds(len(marks) - 1)},,")
        (survey / "points.csv").write_text("\n".join(points) + "\n")
        values["control_points"]["files"] = [{"path": "points.csv", "marks": "marks.csv"}]

    edit(survey / "project.yaml", moved)
    (survey / "marks.csv").write_text("\n".join(marks) + "\n")
    return len(marks) - 1


@pytest.mark.usefixtures("undrawn")
def test_kinds_come_from_the_table_of_marks_to_the_report(adjusted_survey: Path, edit: Edit) -> None:
    kinds = ("circle", "checker", "")
    total = with_tables(adjusted_survey, edit, lambda n: kinds[n % 3])
    project = adjusted_survey / "project.yaml"
    run_pipeline(load_project(project))
    report = read_json(adjusted_survey / "results/quality/report.json")
    found = {record["kind"]: record["marks"] for record in report["marks"]["kinds"]}
    assert found == {name: len(range(n, total, 3)) for n, name in enumerate(("circle", "checker", "raw"))}
    table = adjusted_survey / "marks.csv"
    table.write_text(table.read_text().replace("checker", "ring"))
    made = run_pipeline(load_project(project))
    assert made is not None
    report = read_json(adjusted_survey / "results/quality/report.json")
    assert {record["kind"] for record in report["marks"]["kinds"]} == {"circle", "ring", "raw"}


def test_marks_of_the_project_file_are_imported(finished_survey: Path) -> None:
    report = read_json(finished_survey / "results/quality/report.json")
    (record,) = report["marks"]["kinds"]
    assert record["kind"] == IMPORTED
    assert record["marks"] == sum(len(point["marks"]) for point in report["control_points"])


def test_a_copy_of_a_photograph_gives_it_the_kinds_of_its_marks(
    adjusted_survey: Path, edit: Edit, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_tables(adjusted_survey, edit, lambda _: "circle")
    with open_run(load_project(adjusted_survey / "project.yaml")) as run:
        kinds = mark_kinds(run)
        assert set(kinds.values()) == {"circle"}
        first = run.project.control_points[0]
        i, j = first.mark_photograph[:2].tolist()
        other = replace(first, mark_kind=("ring", *first.mark_kind[1:]))
        object.__setattr__(run.project, "control_points", (other,))
        original = np.arange(len(run.names))
        original[i] = j  # the first photograph is a copy of the second, which has a mark of its own
        stored = SimpleNamespace(original=original)
        monkeypatch.setattr("photogram.pipeline.stages.publishing.mark_pictures.read_record", lambda *_: stored)
        assert mark_kinds(run)[first.name, run.names[j]] == "circle"
        assert (first.name, run.names[i]) not in mark_kinds(run)
        alone = replace(
            other, mark_photograph=first.mark_photograph[:1], mark_pixel=first.mark_pixel[:1],
            mark_covariance_px2=first.mark_covariance_px2[:1], mark_kind=("ring",),
        )  # fmt: skip
        object.__setattr__(run.project, "control_points", (alone,))
        assert mark_kinds(run) == {(first.name, run.names[j]): "ring"}
