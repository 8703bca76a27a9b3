"""Epochs in a project file: which photographs each has, and what is wrong with them, said with its line."""

from pathlib import Path

import pytest

from photogram.errors import ProjectError
from photogram.pipeline.pipeline import load_project
from photogram.project.epochs.entries import ProjectEpoch

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


FLIGHTS = "flights:\n  - {name: first, photographs: ['may/[01].jpg']}\n  - {name: second, photographs: [may/2.jpg]}\n"


def test_flights_are_named_by_patterns_and_have_their_calibrations(tmp_path: Path) -> None:
    path = project(tmp_path, BOTH)
    text = path.read_text(encoding="utf-8").replace("[50, 40]}", "[50, 40], per_flight: true}")
    path.write_text(text + FLIGHTS, encoding="utf-8")
    survey = load_project(path)
    assert [p.flight for p in survey.photographs] == ["first", "first", "second", "June", "June", "June"]
    assert [c.name for c in survey.cameras] == ["a (flight first)", "a (flight second)", "a (flight June)"]


@pytest.mark.parametrize(
    ("flights", "words"),
    [
        (FLIGHTS.replace("may/2.jpg", "nowhere/*"), "match none of 6 photographs: patterns are a shell's"),
        (FLIGHTS.replace("may/2.jpg", "may/*"), "match may/0.jpg, may/1.jpg, of the flight first already"),
        (FLIGHTS.replace("name: first, ", ""), "name: is missing"),
    ],
)
def test_what_is_wrong_with_flights_is_said(tmp_path: Path, flights: str, words: str) -> None:
    path = project(tmp_path, BOTH)
    path.write_text(path.read_text(encoding="utf-8") + flights, encoding="utf-8")
    with pytest.raises(ProjectError) as fault:
        load_project(path)
    assert words in str(fault.value)


def test_a_photograph_of_a_flight_in_the_list_is_of_no_other(tmp_path: Path) -> None:
    listed = [f"{{name: {name}{', flight: night' if name == 'may/0.jpg' else ''}}}" for name in NAMES]
    path = project(tmp_path, BOTH, listed)
    assert load_project(path).photographs[0].flight == "night"
    path.write_text(path.read_text(encoding="utf-8") + FLIGHTS, encoding="utf-8")
    with pytest.raises(ProjectError, match=r"match may/0\.jpg, of the flight night already"):
        load_project(path)


@pytest.mark.parametrize(
    ("epochs", "words"),
    [
        ("  - {name: May, photographs: ['*']}", "epochs: names one epoch: a change needs two"),
        (BOTH.replace("June", "May"), "epochs[May].name: 'May' is there twice: name each by itself"),
        (BOTH.replace("may/*", "april/*"), "match 0 photographs of 6: an epoch needs 3; patterns are those of a shell"),
        (BOTH.replace("june/2.jpg", "may/0.jpg"), "match may/0.jpg, which are of the epoch May already"),
        (BOTH.replace("'june/[01]*', june/2.jpg", "june/*, 'x'").replace("may/*", "'may/[01]*'"), "an epoch needs 3"),
        (BOTH.replace("June", "MAY"), "'MAY' is there twice"),
        (BOTH.replace("June", "../June"), "'../June' cannot be part of a folder's name"),
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
