"""Epochs in a project file: which photographs each has, and what is wrong with them, said with its line."""

from pathlib import Path

import pytest

from photogram.errors import ProjectError
from photogram.pipeline.pipeline import load_project
from photogram.project.epochs.entries import ProjectEpoch, flights_of

TEXT = """photogram: 1
crs: EPSG:25832
cameras:
  a: {width_px: 100, height_px: 80, focal_px: 90, principal_point_px: [50, 40]}
photographs:
  folder: pictures
  list: [%s]
epochs:
%s
"""
NAMES = [f"{month}/{n}.jpg" for month in ("may", "june") for n in range(3)]
BOTH = "  - {name: May, photographs: [may/*]}\n  - {name: June, photographs: ['june/[01]*', june/2.jpg]}"


def project(folder: Path, epochs: str, listed: list[str] | None = None) -> Path:
    for name in NAMES:
        path = folder / "pictures" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    entries = ", ".join(listed or [f"{{name: {name}}}" for name in NAMES])
    (folder / "project.yaml").write_text(TEXT % (entries, epochs), encoding="utf-8")
    return folder / "project.yaml"


def test_epochs_have_their_photographs_and_flights(tmp_path: Path) -> None:
    survey = load_project(project(tmp_path, BOTH))
    assert survey.epochs == (ProjectEpoch("May", (0, 1, 2)), ProjectEpoch("June", (3, 4, 5)))
    assert [p.flight for p in survey.photographs] == ["May"] * 3 + ["June"] * 3
    assert survey.epoch == ""
    assert survey.photographs_without_products == frozenset()


def test_a_flight_that_somebody_named_stays() -> None:
    assert flights_of(["1", "2", "1"], [ProjectEpoch("May", (0, 1)), ProjectEpoch("June", (2,))]) == [
        "May",
        "2",
        "June",
    ]


@pytest.mark.parametrize(
    ("epochs", "words"),
    [
        ("  - {name: May, photographs: ['*']}", "epochs: names one epoch: a change needs two"),
        (BOTH.replace("June", "May"), "epochs[May].name: 'May' is there twice: name each by itself"),
        (BOTH.replace("may/*", "april/*"), "match 0 photographs of 6: an epoch needs 3; patterns are those of a shell"),
        (BOTH.replace("june/2.jpg", "may/0.jpg"), "match may/0.jpg, which are of the epoch May already"),
        (BOTH.replace("'june/[01]*', june/2.jpg", "june/*, 'x'").replace("may/*", "'may/[01]*'"), "an epoch needs 3"),
        (BOTH + "\n  - {photographs: [x]}", "name: is missing"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, epochs: str, words: str) -> None:
    with pytest.raises(ProjectError) as fault:
        load_project(project(tmp_path, epochs))
    said = str(fault.value)
    assert words in said or words.replace("[May]", "[1]") in said
    assert "project.yaml:" in said


def test_photographs_of_no_epoch_are_named(tmp_path: Path) -> None:
    extra = [f"{{name: {name}}}" for name in [*NAMES, "may/3.jpg"]]
    (tmp_path / "pictures" / "may").mkdir(parents=True)
    (tmp_path / "pictures" / "may" / "3.jpg").touch()
    with pytest.raises(ProjectError, match=r"may/3\.jpg: in no epoch: add a pattern"):
        load_project(project(tmp_path, BOTH.replace("may/*", "'may/[0-2]*'"), extra))
