"""Five aerial frames with surveyed control and check points, beside an independent adjustment (DBAT)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from makers import SharedData

from photogram.adjustment.adjustment import AdjustmentSettings, adjust
from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.frames import LocalFrame
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.report.record.report import oriented
from photogram.sfm.orientation import resections_of
from photogram.survey import Block, ControlPoints, Photograph, Role, TiePoints

FRAMES = ("8811.jpg", "8936.jpg", "8937.jpg", "8938.jpg", "9111.jpg")
CHECK = {"B4.6": (0.167, 0.008, -0.459), "B3.11": (0.096, -0.296, 0.136)}  # adjusted − surveyed, dbat_report.txt
CENTRES = np.array(
    [
        (999660.940086, 112368.368648, 1916.563176),
        (1000062.186284, 112625.534228, 1916.417372),
        (1000077.371177, 112417.544493, 1910.362078),
        (1000094.134327, 112202.936957, 1906.983111),
        (1000482.579395, 112370.473450, 1937.066185),
    ]
)
SIGMA_M = np.array(
    [
        (0.465, 0.657, 0.097),
        (0.397, 0.743, 0.0935),
        (0.343, 0.565, 0.0567),
        (0.376, 0.869, 0.103),
        (0.797, 0.655, 0.161),
    ]
)


def table(path: Path) -> tuple[FloatArray, list[str]]:
    """The figures of one of DBAT's tables, and its names where it has them."""
    rows = [
        [cell.strip() for cell in line.split(",")]
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.strip() and not line.startswith("#")
    ]
    named = path.name == "sxb-control.txt"
    return np.array([[float(c) for i, c in enumerate(row) if not (named and i == 1)] for row in rows]), [
        row[1] for row in rows if named
    ]


def dbat_block(data: Path) -> Block:
    """The block as DBAT adjusts it: its tie points, the map as a Cartesian frame, calibration held. The marks of check
    points, which count among DBAT's observations, come in as tie points."""
    control, names = table(data / "sxb-control.txt")
    marks, ties = table(data / "markpts.txt")[0], table(data / "smartpts.txt")[0]
    order = np.argsort(control[:, 0])
    control, names = control[order], [names[i] for i in order]
    check = np.array([name in CHECK for name in names])
    roles: tuple[Role, ...] = tuple("check" if c else "control" for c in check)
    point = np.searchsorted(control[:, 0], marks[:, 0])
    measured = [np.column_stack([ties, np.ones(len(ties))]), np.column_stack([marks, np.full(len(marks), 0.5)])]
    tied = np.vstack([measured[0], measured[1][check[point]]])
    tied = tied[np.lexsort((tied[:, 1], tied[:, 0]))]
    ids, number = np.unique(tied[:, 0], return_inverse=True)
    frame = LocalFrame("EPSG:27561", (1000000.0, 112400.0, 140.0), "grid")
    camera = Camera("Camera1", 8858, 12996, 123.9392 * 1000 / 6, np.array([4429.5, 6468.5]))
    photographs = tuple(Photograph(name, 0) for name in FRAMES)
    block = Block(
        frame, (camera,), photographs, (None,) * 5,
        TiePoints(
            (tied[:, 1] - 1).astype(np.int64), number.astype(np.int64), np.zeros(len(tied), np.int64), tied[:, 2:4],
            tied[:, 4], np.full((len(ids), 3), np.nan), np.zeros((len(ids), 3), np.uint8),
        ),
        ControlPoints(
            tuple(names), roles, frame.world_from_map(control[:, 1:4]), control[:, 4:7],
            (marks[:, 1] - 1).astype(np.int64), point.astype(np.int64), marks[:, 2:4], np.full(len(marks), 0.5),
        ),
    )  # fmt: skip
    resections, faults = resections_of(block)
    assert not faults
    assert all(r is not None and r.inliers.all() for r in resections)
    return replace(block, poses=tuple(r.refined for r in resections if r is not None))


def test_the_same_observations_give_the_same_adjustment(shared_data: SharedData) -> None:
    """sigma0 1.1786, redundancy 1261, centres to a micrometre, their sigmas and the check points as far as printed."""
    block = dbat_block(shared_data("dbat_sxb"))
    result = adjust(
        block, AdjustmentSettings(robust_loss="none", outlier_threshold=100.0, first_outlier_threshold_px=200.0)
    )
    assert (round(result.sigma0, 4), result.redundancy, result.discarded_observations) == (1.1786, 1261, 0)
    frame, points = block.frame, block.control_points
    centres = frame.map_from_world(np.array([p.position_world_m for p in result.block.poses if p is not None]))
    np.testing.assert_allclose(centres, CENTRES, rtol=0, atol=2e-6)
    sigma_m = result.sigma0 * np.sqrt(np.einsum("nii->ni", result.position_covariance_m2))  # DBAT's are scaled
    np.testing.assert_allclose(sigma_m, SIGMA_M, rtol=3e-3)
    off = frame.map_from_world(result.ground_world_m) - frame.map_from_world(points.position_world_m)
    for name, expected in CHECK.items():
        np.testing.assert_allclose(off[points.name.index(name)], expected, rtol=0, atol=6e-4)
    assert result.warnings == ()


@pytest.mark.survey
def test_a_survey_from_tables_and_frames_runs_to_the_report(
    tmp_path: Path, photogram: Callable[..., Any], shared_data: SharedData
) -> None:
    """Nothing but a focal length is known; the map's geographic CRS counts grads."""
    project, data = tmp_path / "project.yaml", shared_data("dbat_sxb")
    outcome = photogram(
        "init", data / "photographs", "--control", data / "points.csv", "--marks", data / "marks.csv",
        "--crs", "EPSG:27561", "--focal-px", 20656.5, "--project", project,
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    assert photogram("check", project).code == 0
    fast = "quality: low\ndense: {enabled: false}\northophoto: {enabled: false}\n"
    project.write_text(project.read_text(encoding="utf-8") + fast, encoding="utf-8")
    report = run_pipeline(load_project(project))
    block, adjustment = report["block"], report["adjustment"]
    assert (block["registered"], block["photographs"]) == (5, 5)
    assert adjustment["converged"]
    assert adjustment["sigma0"] is not None
    assert 0.6 < adjustment["sigma0"] < 1.2
    camera = next(iter(report["cameras"].values()))
    assert abs(camera["focal_px"] / 20656.5 - 1.0) < 2.0 * 620.0 / 20656.5
    np.testing.assert_allclose(camera["principal_point_px"], [4429.0, 6468.0], rtol=0, atol=40.0)
    # a longer focal length flies higher, and over this ground nothing else changes
    higher_m = (camera["focal_px"] / 20656.5 - 1.0) * 1776.0
    for name, expected in zip(FRAMES, CENTRES, strict=True):
        off = np.array(oriented(report["photographs"])[name]["position_map_m"]) - expected
        np.testing.assert_allclose(off, [0.0, 0.0, higher_m], rtol=0, atol=3.0)
    checks = {p["name"]: p for p in report["control_points"] if p["role"] == "check"}
    assert checks.keys() == CHECK.keys()
    off_m = {name: np.array(p["residual_m"], dtype=float) for name, p in checks.items()}
    for name, expected in CHECK.items():
        np.testing.assert_allclose(off_m[name], np.array(expected), rtol=0, atol=0.3)
    assert np.sqrt(np.mean([np.square(v[:2]).sum() for v in off_m.values()])) < 0.3
    # the one that no report of others names: northing, 7 sigma
    sigma_m = np.array(checks["B3.11"]["sigma_m"], dtype=float)
    assert abs(off_m["B3.11"][1]) > 5.0 * np.hypot(sigma_m[1], 0.02)
    assert (project.parent / "results" / "report.html").is_file()
