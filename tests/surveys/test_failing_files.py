"""A change of a file that fails, anywhere in a survey: one sentence, nothing half, and the same command mends it.

tests/chaos/faults.py fails all of them; these are a few, spread evenly.
"""

from collections.abc import Callable
from pathlib import Path

import pytest
from chaos.faults import Ended, Trial, run, tried
from failing_files import failing

pytestmark = pytest.mark.survey


def faults(trial: Trial, folder: Path, count: int) -> None:
    """Try so many faults of a command, spread evenly."""
    said: list[str] = []
    seen = tried(trial, folder, count, said.append)
    assert [text for text in said if text != said[-1] and "differ from run to run" not in text] == []
    assert seen["wrong"] == 0
    assert seen["refused"] >= seen["faults"] // 2 > 0


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("stage", "until", "count"), [("photographs", "matches", 6), ("comparison", "results", 4)])
def test_adjust_loses_nothing(finished_survey: Path, tmp_path: Path, stage: str, until: str, count: int) -> None:
    def act(folder: Path) -> Ended:
        return run("adjust", folder / "project.yaml", "--no-check", "--from", stage, "--until", until)

    faults(Trial(f"{stage} to {until}", finished_survey, act), tmp_path / "survey", count)


@pytest.mark.parametrize(
    "arguments",
    [
        ("deliver", "{}/project.yaml", "--to", "dxf", "--to", "copc", "--to", "shapefile", "--to", "qgis"),
        ("export", "{}/project.yaml", "--output", "{}/solution", "--to", "opf"),
    ],
)
def test_products_are_whole_or_as_they_were(finished_survey: Path, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    def act(folder: Path) -> Ended:
        return run(*(argument.format(folder) for argument in arguments))

    faults(Trial(arguments[0], finished_survey, act), tmp_path / "survey", 6)


def test_init_leaves_no_half_of_a_project_file(pristine_survey: Path, tmp_path: Path) -> None:
    def act(folder: Path) -> Ended:
        known = ("--crs", "EPSG:25832", "--focal-px", "600", "--force")
        return run("init", folder / "photographs", *known, "--project", folder / "own.yaml")

    faults(Trial("init", pristine_survey, act), tmp_path / "survey", 4)


def test_what_fails_is_counted_once(tmp_path: Path) -> None:
    def write(act: Callable[[], object]) -> list[str]:
        try:
            act()
        except OSError as error:
            return [str(error)]
        return []

    path = tmp_path / "file.txt"
    with failing(tmp_path) as changes:
        path.write_text("a")
    assert changes.seen == [("open", "file.txt"), ("write", "file.txt")]
    with failing(tmp_path, 2) as changes:
        assert "Input/output error" in write(lambda: path.write_text("b"))[0]
        assert write(lambda: path.write_text("c")) == []
    assert changes.failed == ("write", "file.txt")
    assert path.read_text() == "c"
