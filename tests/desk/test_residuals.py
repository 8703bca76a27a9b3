"""Residuals of ground points for the map, against report.json."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from photogram.desk.map_layers.residuals import residuals
from photogram.errors import ReportError, WorkspaceError
from photogram.result_files import result_path


@pytest.fixture
def results(finished_survey: Path, tmp_path: Path) -> Path:
    path = result_path(tmp_path / "results", "report.json")
    path.parent.mkdir(parents=True)
    shutil.copy(result_path(finished_survey / "results", "report.json"), path)
    return tmp_path / "results"


def test_they_are_those_of_the_report_with_their_own_sigmas(results: Path) -> None:
    report = json.loads(result_path(results, "report.json").read_text())
    found = residuals(results)
    assert {p["name"] for p in found["points"]} == {p["name"] for p in report["control_points"] if p["residual_m"]}
    by_name = {p["name"]: p for p in report["control_points"]}
    for point in found["points"]:
        record = by_name[point["name"]]
        difference = np.subtract(record["adjusted_map_m"], record["surveyed_map_m"])
        np.testing.assert_allclose(point["residual_m"], difference, atol=1e-6)
        sigma = np.array(point["sigma_m"], dtype=float)
        if point["role"] == "check":  # z-scores are of the same standard deviations
            np.testing.assert_allclose(np.array(point["residual_m"]) / sigma, record["z"], rtol=1e-5)
        else:  # and so are normalised residuals, of the other sign
            np.testing.assert_allclose(np.abs(point["residual_m"] / sigma), np.abs(record["w"]), rtol=1e-3, atol=1e-3)
            assert point["name"] in point["sentences"][0]
        assert [mark["photograph"] for mark in point["marks"]] == [mark["photograph"] for mark in record["marks"]]


def test_suspects_come_first_with_what_is_said_of_them(results: Path) -> None:
    path = result_path(results, "report.json")
    report = json.loads(path.read_text())
    last, photograph = report["control_points"][-1]["name"], "one.jpg"
    suspect = {"kind": "control", "name": last, "axis": "height", "w": 5.0, "off": 0.3, "sentence": f"{last} is off."}
    report["suspects"] = [suspect]
    blunder: dict[str, object] = {
        "kind": "gnss",
        "points": [],
        "photograph": photograph,
        "sentence": "It repeats.",
        "camera": None,
    }
    report["blunders"] = [blunder]
    path.write_text(json.dumps(report))
    found = residuals(results)
    assert found["points"][0]["name"] == last
    assert found["points"][0]["suspect"]
    assert found["points"][0]["sentences"] == [f"{last} is off."]
    assert not any(point["suspect"] for point in found["points"][1:])
    assert found["others"] == ["It repeats."]


def test_without_a_report_the_next_step_is_said(results: Path) -> None:
    result_path(results, "report.json").write_text("{")
    with pytest.raises(ReportError):
        residuals(results)
    result_path(results, "report.json").unlink()
    with pytest.raises(WorkspaceError, match="start the run first"):
        residuals(results)
