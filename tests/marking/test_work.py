"""The command photogram mark --export and --detect-only: what it says, and which options go together."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.files.marks.formats import read_points
from photogram.marking import work

Photogram = Callable[..., Any]


def test_the_files_and_what_they_hold_are_said(photogram: Photogram, survey: Path) -> None:
    assert work.export.__doc__
    target = survey / "gcp_list.txt"
    said = photogram("mark", survey / "project.yaml", "--export", target)
    assert said.code == 0, said.err
    file = read_points(target)
    assert f"Exported: {len(file.points)} points in EPSG:25832" in said.out
    assert f"{len(file.marks)} marks" in said.out
    assert str(target) in said.out
    assert "check points become control points" in said.out
    again = photogram("mark", survey / "project.yaml", "--export", target)
    assert (again.code, again.err.count("\n")) == (1, 1)
    assert "--overwrite" in again.err
    assert photogram("mark", survey / "project.yaml", "--export", target, "--overwrite").code == 0


def test_the_format_is_asked_for_where_the_name_does_not_tell_it(photogram: Photogram, survey: Path) -> None:
    target = survey / "marks.txt"
    said = photogram("mark", survey / "project.yaml", "--export", target)
    assert (said.code, said.err.count("\n")) == (1, 1)
    assert "give --format" in said.err
    said = photogram("mark", survey / "project.yaml", "--export", target, "--format", "pix4d")
    assert said.code == 0, said.err
    assert target.is_file()
    assert str(survey / "marks_points.csv") in said.out


@pytest.mark.parametrize(
    "options",
    [("--format", "csv"), ("--overwrite",), ("--export", "a.csv", "--propose"), ("--export", "a.csv", "--detect-only")],
)
def test_options_that_contradict_each_other_are_wrong_usage(
    photogram: Photogram, survey: Path, options: tuple[str, ...]
) -> None:
    said = photogram("mark", survey / "project.yaml", *options)
    assert said.code == 2
    assert "--export" in said.err


def test_detect_only_leaves_the_table_of_marks_byte_for_byte(photogram: Photogram, survey: Path) -> None:
    table = survey / "marks.csv"
    table.write_bytes(b"point,photograph,u,v\r\n# my own\r\nG01,sim_0001.JPG,1,2\r\n")
    os.utime(table, ns=(1_700_000_000_000_000_000,) * 2)
    before = table.read_bytes(), table.stat().st_mtime_ns, sorted(path.name for path in survey.iterdir())
    said = photogram("mark", survey, "--detect-only")
    assert said.code == 0, said.err
    work = sorted({path.name for path in survey.iterdir()} - set(before[2]))
    assert work in ([], ["work"])
    names = sorted(path.name for path in survey.iterdir() if path.name not in work)
    assert (table.read_bytes(), table.stat().st_mtime_ns, names) == before
    assert (survey / "work" / "marking" / "proposals.csv").is_file()
