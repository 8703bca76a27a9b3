"""`photogram import`, as a user runs it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.exchange.solution_export import export_solution

Run = Callable[..., Any]


def test_a_solution_becomes_a_project(adjusted_survey: Path, tmp_path: Path, photogram: Run) -> None:
    export_solution(adjusted_survey / "project.yaml", "opf", tmp_path / "out")
    project = tmp_path / "project.yaml"
    found = photogram(
        "import", tmp_path / "out", "--photographs", adjusted_survey / "photographs", "--check", "G02",
        "--project", project,
    )  # fmt: skip
    assert found.code == 0
    said = " ".join(found.out.split())
    for words in (
        "tie points │ those of the solution",
        "poses │ those of the solution, as initial values",
        "Next: photogram check",
    ):
        assert words in said
    assert "Left out: " in found.out
    files = {path.name for path in tmp_path.iterdir()}
    assert {"project.yaml", "solution.npz", "positions.csv", "ground_points.csv", "ground_marks.csv"} <= files
    rows = (tmp_path / "ground_points.csv").read_text(encoding="utf-8").splitlines()
    assert next(row for row in rows if row.startswith("G02,")).endswith("check,check")
    assert photogram("check", project).code == 0
    again = photogram("import", tmp_path / "out", "--photographs", adjusted_survey / "photographs",
                      "--project", project)  # fmt: skip
    assert again.code == 1
    assert "already exists; choose another --project or use --force" in again.err


def test_what_is_no_solution_is_said_in_a_line(tmp_path: Path, photogram: Run) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    found = photogram("import", tmp_path / "notes.txt", "--project", tmp_path / "p.yaml")
    assert found.code == 1
    assert "holds no solution that photogram knows" in found.err
    assert not (tmp_path / "p.yaml").exists()


@pytest.mark.parametrize("crs", ["EPSG:999999", "rubbish"])
def test_a_crs_that_is_none_is_named(adjusted_survey: Path, tmp_path: Path, photogram: Run, crs: str) -> None:
    export_solution(adjusted_survey / "project.yaml", "opf", tmp_path / "out")
    found = photogram("import", tmp_path / "out", "--photographs", adjusted_survey, "--crs", crs,
                      "--project", tmp_path / "p.yaml")  # fmt: skip
    assert found.code == 1
    assert crs in found.err
    assert not (tmp_path / "p.yaml").exists()
