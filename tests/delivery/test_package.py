"""A survey in one file, unpacked elsewhere: the files, their checksums, and what they were made of."""

import hashlib
import json
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.delivery.hand_over import deliver
from photogram.delivery.package import PACKAGE, RECORD
from photogram.errors import ExchangeError
from photogram.pipeline.store.results_record import read_record
from photogram.result_files import ResultFolder

Photogram = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_what_is_unpacked_is_the_survey(adjusted_survey: Path, tmp_path: Path, photogram: Photogram) -> None:
    results = adjusted_survey / "results"
    (results / "deliverables/letter.txt").write_text("Dear client,")
    outcome = photogram("deliver", adjusted_survey / "project.yaml", "--to", "qgis", "--zip")
    assert outcome.code == 0, outcome.err
    assert f"{PACKAGE}: " in outcome.out
    elsewhere = tmp_path / "elsewhere"
    with zipfile.ZipFile(results / PACKAGE) as archive:
        archive.extractall(elsewhere)
    for folder in ResultFolder:
        own = {path.relative_to(results) for path in (results / folder).rglob("*") if path.is_file()}
        assert own == {path.relative_to(elsewhere) for path in (elsewhere / folder).rglob("*") if path.is_file()}
        call = ["sha256sum", "--check", "--strict", "checksums.sha256"]
        assert subprocess.run(call, cwd=elsewhere / folder, capture_output=True).returncode == 0
    assert (elsewhere / "deliverables/letter.txt").read_text() == "Dear client,"
    assert "survey.qgz" in (elsewhere / "deliverables/README.txt").read_text(encoding="utf-8")
    assert (elsewhere / RECORD / "project.yaml").read_bytes() == (adjusted_survey / "project.yaml").read_bytes()
    record = json.loads((elsewhere / RECORD / "inputs.json").read_text(encoding="utf-8"))
    photographs = sorted((adjusted_survey / "photographs").glob("*.JPG"))
    assert {p["name"]: p["sha256"] for p in record["photographs"]} == {p.name: checksum(p) for p in photographs}
    assert all(p["bytes"] > 0 for p in record["photographs"])
    assert {key: file["name"] for key, file in record["files"].items()} == {"comparison.reference": "truth_surface.tif"}
    assert record["files"]["comparison.reference"]["sha256"] == checksum(adjusted_survey / "truth_surface.tif")
    assert record["project"]["sha256"] == checksum(adjusted_survey / "project.yaml")
    assert record["settings"]["dense"]["enabled"] is not None
    assert record["versions"]["numpy"]


def test_the_same_survey_gives_the_same_bytes_and_new_results_remove_them(
    adjusted_survey: Path, photogram: Photogram, edit: Edit
) -> None:
    path = adjusted_survey / "results" / PACKAGE
    written = deliver(adjusted_survey, ["dxf"], package=True)
    assert written[-1].path == path
    assert read_record(path.parent)[PACKAGE] == checksum(path)
    first = path.read_bytes()
    deliver(adjusted_survey, ["dxf"], package=True)
    assert path.read_bytes() == first
    edit(adjusted_survey / "project.yaml", lambda values: values.update(contours={"interval_m": 2.0}))
    with pytest.raises(ExchangeError, match="run photogram adjust first"):
        deliver(adjusted_survey, ["dxf"], package=True)
    outcome = photogram("adjust", adjusted_survey / "project.yaml")
    assert outcome.code == 0, outcome.err
    assert not path.exists()
    assert f"removed survey.dxf, {PACKAGE}, made from earlier results." in " ".join(outcome.out.split())


def test_an_archive_among_the_deliverables_does_not_hold_itself(adjusted_survey: Path) -> None:
    folder = adjusted_survey / "results/deliverables"
    for _ in range(2):
        deliver(adjusted_survey, ["dxf"], folder, package=True)
        with zipfile.ZipFile(folder / PACKAGE) as archive:
            assert f"deliverables/{PACKAGE}" not in archive.namelist()
            assert "deliverables/survey.dxf" in archive.namelist()


def test_a_file_of_the_same_name_is_not_replaced(adjusted_survey: Path, tmp_path: Path) -> None:
    (tmp_path / PACKAGE).write_text("mine")
    with pytest.raises(ExchangeError, match="was not written by photogram"):
        deliver(adjusted_survey, ["dxf"], tmp_path, package=True)
    assert (tmp_path / PACKAGE).read_text() == "mine"
    assert not (tmp_path / "survey.dxf").exists()


def test_results_that_lack_a_file_are_not_packed(adjusted_survey: Path) -> None:
    (adjusted_survey / "results/deliverables/dsm.tif").unlink()
    with pytest.raises(ExchangeError, match=r"results: is not complete: run photogram adjust first"):
        deliver(adjusted_survey, ["dxf"], package=True)
