"""A simulated survey's report against the truth beside it."""

import json
from pathlib import Path
from typing import Any

import pytest

from photogram.simulation.judgement import judge


def test_errors_are_those_of_registered_photographs_and_of_the_focal_length(full_report: Any, tmp_path: Path) -> None:
    registered = [name for name, p in full_report["photographs"].items() if p["registered"]]
    positions = {name: full_report["photographs"][name]["position_map_m"] for name in registered}
    first = registered[0]
    positions[first] = [positions[first][0] - 0.3, positions[first][1], positions[first][2] + 0.4]
    camera = full_report["cameras"]["simulated"]
    truth = {
        "gsd_m": 0.02,
        "positions_map_m": {**positions, "sim_0099.JPG": [0.0, 0.0, 0.0]},  # is not registered
        "camera": {"name": "simulated", "parameters": [camera["focal_px"] - 1.5]},
    }
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    found = judge(tmp_path, full_report)
    assert found.camera_rmse_m == pytest.approx(0.5 / len(registered) ** 0.5)
    assert found.focal_error_px == pytest.approx(1.5)
    assert found.focal_sigma_px == camera["sigma"]["focal_px"]
    assert (found.check_points, found.check_rmse_plan_m) == (
        full_report["check_points"]["n"],
        full_report["check_points"]["rmse_h_m"],
    )
    nmad = {name: cloud["nmad_m"] for name, cloud in full_report["clouds"].items()}
    assert found.gain == pytest.approx(nmad["linear_3view"] / nmad["adjusted"])
