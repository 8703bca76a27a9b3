"""The command `photogram audit`."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from audited_solutions import solution_with

from photogram.exchange.formats.colmap.sparse_models import write_colmap
from photogram.exchange.formats.opensfm.reconstructions import write_opensfm

Photogram = Callable[..., Any]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sparse model of COLMAP in its usual folder."""
    folder = tmp_path_factory.mktemp("project") / "sparse" / "0"
    folder.mkdir(parents=True)
    write_colmap(folder, solution_with("none"))
    return folder


def test_a_solution_is_audited(tmp_path: Path, photogram: Photogram, model: Path) -> None:
    outcome = photogram("audit", model.parents[1], "--output", tmp_path / "audit")
    assert outcome.code == 0, outcome.err
    assert "Nothing contradicts the result." in outcome.out
    found = json.loads((tmp_path / "audit" / "audit.json").read_text(encoding="utf-8"))
    assert found["program"].startswith("COLMAP")
    assert found["contradictions"] == []
    assert len(found["poses"]) == 15
    page = (tmp_path / "audit" / "audit.html").read_text(encoding="utf-8")
    assert "Audit of a solution of COLMAP" in page
    assert "free network" in page
    for row in found["figures"]:
        assert row["name"] in page
        assert row["ours"] in page
    assert "<script" not in page


def test_the_same_solution_by_way_of_another_program_has_the_same_figures(
    tmp_path: Path, photogram: Photogram, model: Path
) -> None:
    written = tmp_path / "opensfm"
    written.mkdir()
    write_opensfm(written, solution_with("none"))
    rms = []
    for name, path in (("colmap", model), ("opensfm", written)):
        assert photogram("audit", path, "--output", tmp_path / name).code == 0
        found = json.loads((tmp_path / name / "audit.json").read_text(encoding="utf-8"))
        rms.append(found["figures"][0]["theirs"])
    assert rms[0] == rms[1]


def test_solutions_of_other_programs_stand_beside_it(tmp_path: Path, photogram: Photogram, model: Path) -> None:
    written = tmp_path / "opensfm"
    written.mkdir()
    write_opensfm(written, solution_with("principal point"))
    outcome = photogram("audit", model, "--beside", written, "--beside", model, "--output", tmp_path / "audit")
    assert outcome.code == 0, outcome.err
    found = json.loads((tmp_path / "audit" / "audit.json").read_text(encoding="utf-8"))
    assert [name.split(" ")[0] for name in found["beside"]] == ["OpenSfM", "COLMAP"]
    assert found["beside"][1] == f"{found['program']} (2)"
    for row in found["figures"]:
        assert len(row["beside"]) == 2
        assert row["beside"][1] == row["theirs"]
    point = next(row for row in found["calibrations"] if row["parameter"] == "principal point in x")
    assert float(point["beside"][0].split()[0]) - float(point["theirs"].split()[0]) == pytest.approx(30.0, abs=0.01)
    assert [row["program"] for row in found["poses"][:3]] == [found["program"], *found["beside"]]
    page = (tmp_path / "audit" / "audit.html").read_text(encoding="utf-8")
    assert all(name in page for name in found["beside"])
    assert found["beside"][0] in outcome.out.replace("\n", " ")


def test_what_shares_no_photograph_is_refused_before_anything_is_adjusted(
    tmp_path: Path, photogram: Photogram, model: Path
) -> None:
    solution = solution_with("none")
    other = replace(solution, photographs=tuple(replace(p, name=f"x{p.name}") for p in solution.photographs))
    folder = tmp_path / "other"
    folder.mkdir()
    write_opensfm(folder, other)
    outcome = photogram("audit", model, "--beside", folder, "--output", tmp_path / "audit")
    assert outcome.code == 1
    assert "shares no photograph with COLMAP" in " ".join(outcome.err.split())
    assert not (tmp_path / "audit").exists()


def test_a_check_point_that_is_nowhere_is_said(tmp_path: Path, photogram: Photogram, model: Path) -> None:
    outcome = photogram("audit", model, "--check", "410", "--output", tmp_path / "audit")
    assert outcome.code == 1
    assert "410: no such ground point in the solution; there are none" in " ".join(outcome.err.split())


def test_what_is_no_solution_is_said_and_nothing_written(tmp_path: Path, photogram: Photogram) -> None:
    outcome = photogram("audit", tmp_path, "--output", tmp_path / "audit")
    assert outcome.code == 1
    assert "holds no solution that photogram knows" in outcome.err
    assert not (tmp_path / "audit").exists()
