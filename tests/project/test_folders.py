"""Photographs, inputs, intermediate results and results in one another: refused in words, or nothing is touched."""

import itertools
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.errors import ProjectError
from photogram.files.atomic import make_folder, make_folder_within, remove_leftovers, replacing
from photogram.files.matlab import read_camera
from photogram.files.stage_folders import stage_folder_around
from photogram.pipeline.store.results_record import recorded, remove_outdated
from photogram.pipeline.store.workspace import Workspace
from photogram.project.folders import input_files
from photogram.project.project import Project, read_project
from photogram.result_files import PICTURES, STUDY, ResultFolder

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]

TEXT = """\
photogram: 1
crs: EPSG:25832
cameras:
  one: {{width_px: 400, height_px: 300, focal_px: 600, principal_point_px: [199.5, 149.5]}}
photographs: {{folder: {photographs}}}
control_points:
  sigma_m: [0.02, 0.02, 0.02]
  mark_sigma_px: 0.5
  files: [{{path: {control}/points.csv, marks: {control}/marks.csv}}]
work: {work}
results: {results}
"""
POINTS = "name,easting,northing,height\nP1,600000,5800000,100\nP2,600050,5800000,101\nP3,600000,5800050,102\n"
WRITTEN = f"results/{PICTURES}"
PLACES = (".", "photographs", "work", "results", "work/photographs", "work/photographs.stage", WRITTEN)
OWN = (*PLACES, "work/features.stage.partial/inner", "work/Relief.STAGE", f"results/{STUDY}")


def site(folder: Path, photographs: str, work: str, results: str, control: str) -> tuple[Path, dict[Path, bytes]]:
    """Make a survey with something of the user's in every folder; return its project file and all that is there."""
    home = folder / "site"
    for name in {photographs, control}:
        (home / name).mkdir(parents=True, exist_ok=True)
    for name in ("points.csv", "marks.csv", "lock", "a.JPG", "dsm_2020.tif"):
        (home / name).write_text(f"the user's {name}")
    for name in ("a.JPG", "b.JPG"):
        (home / photographs / name).write_text(f"photograph {name}")
    (home / control / "points.csv").write_text(POINTS)
    (home / control / "marks.csv").write_text("name,photograph,u,v\nP1,a.JPG,10,20\n")
    project = home / "project.yaml"
    project.write_text(TEXT.format(photographs=photographs, work=work, results=results, control=control))
    return project, {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


STAGES = ("photographs", "features")
PRODUCTS = ("quality/report.json", "technical/photographs.csv", "deliverables/dsm.tif", f"{PICTURES}/plan.png")


def work_as_a_run_does(project: Project) -> None:
    """Make, replace and discard stages, and write, record and remove results."""
    workspace = Workspace(project.work)
    with workspace.locked():
        for mark in ("1", "2"):
            for stage in STAGES:
                with replacing(workspace.begin(stage, mark) / "a.JPG") as temporary:
                    temporary.write_text("of a stage")
                workspace.finish(stage, mark, {})
            make_folder(project.results)
            for name in (*ResultFolder, PICTURES):
                make_folder_within(project.results / name)
            remove_leftovers(project.results)
            with recorded(project.results):
                for name in PRODUCTS:
                    with replacing(project.results / name) as temporary:
                        temporary.write_text("a result")
            remove_outdated(project.results, PRODUCTS[:1])
        workspace.discard(STAGES[0])


def test_files_that_a_project_names_are_told_by_their_keys(tmp_path: Path) -> None:
    path, _ = site(tmp_path, "photographs", "work", "results", ".")
    home = path.parent
    assert input_files(path) == {
        "control_points.files.0.path": home / "points.csv",
        "control_points.files.0.marks": home / "marks.csv",
    }


@pytest.mark.parametrize("photographs", OWN)
def test_every_arrangement_is_refused_or_touches_nothing(tmp_path: Path, photographs: str) -> None:
    accepted = 0
    for number, (work, results) in enumerate(itertools.product(PLACES, (*PLACES[:-1], "..", "work/x.stage"))):
        control = "." if number % 3 else OWN[number // 3 % len(OWN)]
        folder = tmp_path / str(number)
        path, own = site(folder, photographs, work, results, control)
        words = ""
        try:
            project = read_project(path, read_matlab_camera=read_camera)
        except ProjectError as fault:
            words = str(fault)
        if words:
            assert "their own" in words or "of their own" in words or "lies in" in words
        else:
            work_as_a_run_does(project)  # nothing is found out later
            accepted += 1
        assert {p: p.read_bytes() for p in own} == own, (photographs, work, results, control)
        shutil.rmtree(folder)
    assert accepted > 0


@pytest.mark.parametrize(
    ("photographs", "work", "results", "control", "words"),
    [
        ("work/photographs.stage", "work", "results", ".", "work: the folder of the photographs "),
        ("photographs", "work", "work/x.stage/y", ".", "results: the folder of results "),
        ("photographs", "work", "results", "work/x.stage", "control_points.files[work/x.stage/points.csv].path: the f"),
        ("photographs", "photographs", "results", ".", "work: is the folder of the photographs too"),
        ("photographs", "out", "out", ".", "work: is the folder of the results too"),
        ("photographs", "work", "photographs", ".", "results: is the folder of the photographs too"),
        ("photographs", "work", "results", "results", "results: photogram writes its results to "),
        (WRITTEN, "work", "results", ".", "results: photogram writes its results to "),
        ("results/pictures", "work", "results", ".", "results: photogram writes its results to "),
    ],
)
def test_what_is_refused_is_said(
    tmp_path: Path, photographs: str, work: str, results: str, control: str, words: str
) -> None:
    path, _ = site(tmp_path, photographs, work, results, control)
    with pytest.raises(ProjectError) as fault:
        read_project(path, read_matlab_camera=read_camera)
    assert words in str(fault.value)
    assert str(path) in str(fault.value)


def test_links_count_as_what_they_lead_to(tmp_path: Path) -> None:
    path, _ = site(tmp_path, "work/photographs.stage", "work", "results", ".")
    home = path.parent
    (home / "elsewhere").symlink_to(home / "work/photographs.stage")
    path.write_text(TEXT.format(photographs="elsewhere", work="work", results="results", control="."))
    with pytest.raises(ProjectError, match=r"the folder of the photographs .* lies in "):
        read_project(path, read_matlab_camera=read_camera)

    (home / "linked").mkdir()
    (home / "linked/a.JPG").symlink_to(home / "work/photographs.stage/a.JPG")
    (home / "linked/b.JPG").write_text("b")
    path.write_text(TEXT.format(photographs="linked", work="work", results="results", control="."))
    with pytest.raises(ProjectError, match=r"the photograph .*a\.JPG lies in "):
        read_project(path, read_matlab_camera=read_camera)

    (home / "disk").mkdir()
    (home / "short").symlink_to(home / "disk")
    path.write_text(TEXT.format(photographs="linked", work="short", results="disk", control="."))
    with pytest.raises(ProjectError, match="work: is the folder of the results too"):
        read_project(path, read_matlab_camera=read_camera)


def test_folders_of_stages_have_names_of_their_own(tmp_path: Path) -> None:
    work = tmp_path / "work"
    assert stage_folder_around(work, work) is None
    assert stage_folder_around(work, tmp_path / "photographs.stage") is None
    assert stage_folder_around(work, work / "photographs") is None
    assert stage_folder_around(work, work / "inner" / "a.stage") is None
    for name in ("photographs.stage", "x.stage.partial", "x.stage.removed", "X.STAGE"):
        assert stage_folder_around(work, work / name / "deep" / "a.JPG") == work / name


@pytest.mark.parametrize(("folder", "work"), [("photographs", "."), ("work/photographs", "work")])
def test_a_whole_run_among_the_photographs_leaves_them(
    survey: Path, photogram: Run, edit: Edit, folder: str, work: str
) -> None:
    (survey / folder).parent.mkdir(exist_ok=True)
    (survey / "photographs").rename(survey / folder)
    edit(survey / "project.yaml", lambda v: (v["photographs"].update(folder=folder), v.update(work=work)))
    before = {p: p.read_bytes() for p in survey.rglob("*") if p.is_file()}
    assert len(before) >= 6
    for _ in range(2):
        outcome = photogram("adjust", survey / "project.yaml", "--until", "pairs", "--from", "photographs")
        assert outcome.code == 0, outcome.err
    assert {p: p.read_bytes() for p in before} == before
    assert (survey / work / "photographs.stage").is_dir()


def test_check_refuses_before_anything_is_written(survey: Path, photogram: Run, edit: Edit) -> None:
    (survey / "work").mkdir()
    (survey / "photographs").rename(survey / "work/photographs.stage")
    edit(survey / "project.yaml", lambda v: v["photographs"].update(folder="work/photographs.stage"))
    before = sorted(survey.rglob("*"))
    for command in (["check"], ["adjust"], ["adjust", "--no-check"], ["report"]):
        outcome = photogram(command[0], survey / "project.yaml", *command[1:])
        assert outcome.code == 1
        assert "photogram makes" in " ".join((outcome.out + outcome.err).split())
    assert sorted(survey.rglob("*")) == before


def test_check_names_folders_that_may_not_be_written(survey: Path, photogram: Run, monkeypatch: Any) -> None:
    (survey / "results").mkdir()
    monkeypatch.setattr("os.access", lambda path, _: Path(path) != survey / "results")
    outcome = photogram("check", survey / "project.yaml")
    assert outcome.code == 1
    assert "is not writable" in " ".join(outcome.out.split())
    outcome = photogram("adjust", survey / "project.yaml", "--no-check")
    assert outcome.code == 1
    assert outcome.err.startswith(f"photogram: {survey / 'results'}: {survey / 'results'} is not writable")
    assert outcome.err.count("\n") == 1


def test_check_tells_of_folders_of_an_earlier_version(adjusted_survey: Path, photogram: Run) -> None:
    work = adjusted_survey / "work"
    shutil.copytree(work / "features.stage", work / "features")
    (work / "matches").mkdir()  # somebody's own
    said = " ".join(photogram("check", adjusted_survey / "project.yaml").out.split())
    assert "an earlier version of photogram are no longer used: features" in said.replace("│ ", "")
    assert photogram("adjust", adjusted_survey / "project.yaml", "--until", "features").code == 0
    assert (work / "features/00000.npz").is_file()


def test_a_demonstration_does_not_write_over_a_project(tmp_path: Path, photogram: Run) -> None:
    (tmp_path / "project.yaml").write_text("mine")
    outcome = photogram("demo", tmp_path)
    assert outcome.code == 1
    assert "a project file exists already" in outcome.err
    assert [p.name for p in tmp_path.iterdir()] == ["project.yaml"]
