"""A project given by its folder, in every command and function that takes one."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.errors import ReportError
from photogram.pipeline.finished_report import write_report
from photogram.pipeline.opened_survey import open_survey
from photogram.pipeline.project_file import project_file
from photogram.pipeline.view import write_view

Run = Callable[..., Any]


def test_a_folder_stands_for_its_project_file(survey: Path) -> None:
    file = survey / "project.yaml"
    assert project_file(survey) == project_file(file) == file
    assert project_file(survey / "none.yaml") == survey / "none.yaml"
    assert open_survey(survey).project.path == file


def test_the_page_and_the_view_are_made_of_a_folder_of_a_project_too(
    adjusted_survey: Path, photogram: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = adjusted_survey / "results"
    assert write_report(adjusted_survey) == (results / "deliverables/report.html",)
    for given in (results, results / "deliverables", adjusted_survey, adjusted_survey / "project.yaml"):
        assert write_view(given, points=1000) == results / "deliverables/view.html"
    monkeypatch.chdir(adjusted_survey)
    assert photogram("view", "--points", 1000).code == 0
    with pytest.raises(ReportError, match=r"report\.json is missing: run photogram adjust first"):
        write_view(adjusted_survey / "photographs")


@pytest.mark.parametrize("command", [("check",), ("report",), ("mark", "--export", "gcp_list.txt")])
def test_commands_take_the_folder_and_the_working_one(
    adjusted_survey: Path, photogram: Run, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    name, *options = command
    monkeypatch.chdir(adjusted_survey)
    assert photogram(name, *options).code == 0
    assert photogram(name, ".", *options, *(["--overwrite"] if options else [])).code == 0
