"""Flights before they are flown: geometry, predictions against simulated surveys, the file, the command."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.errors import AdjustmentError, ProjectError
from photogram.simulation.planning.flight_file import flight_plan
from photogram.simulation.planning.flight_plan import (
    Calibration,
    FlightPlan,
    Layout,
    control_places,
    courses,
    survey_of,
)
from photogram.simulation.planning.prediction import alternatives, changes, predict_accuracy

SMALL = FlightPlan(
    width_m=60, length_m=80, relief_m=8, width_px=1500, height_px=1125, focal_px=1200, flying_height_m=60,
    forward_overlap=0.7, side_overlap=0.65, tie_points_per_photograph=60,
    calibration=Calibration(focal_px=10, k3=0.0),
)  # fmt: skip
SEEDS = 20


@pytest.mark.parametrize(
    "plan",
    [
        replace(SMALL, gnss="consumer", control_points=5),
        replace(SMALL, control_points=0, oblique_strips=1, gnss_offset_sigma_m=(0.03, 0.03, 0.04)),
    ],
    ids=["consumer-gnss-and-5-points", "rtk-without-control-and-an-oblique-strip"],
)
def test_predictions_are_the_errors_of_simulated_surveys(plan: FlightPlan) -> None:
    """The same plan flown over other terrains, measured with all its errors and adjusted: RMS errors of check points
    over the site agree with what was predicted within 20 %, in plan and in height."""
    found = predict_accuracy(plan)
    seen = found.rays >= 2
    errors = []
    for seed in range(100, 100 + SEEDS):
        survey = survey_of(plan, seed, errors=True, extra=found.place_m[seen][::4])
        result = adjust(survey.block, AdjustmentSettings(robust_loss="none"))
        errors.append((result.estimates.ground_world_m - survey.truth.control_position_world_m)[plan.control :])
    rms = np.sqrt(np.nanmean(np.array(errors) ** 2, axis=(0, 1)))
    predicted = np.sqrt(np.mean(found.sigma_m[seen] ** 2, axis=0))
    assert np.hypot(rms[0], rms[1]) / np.hypot(predicted[0], predicted[1]) == pytest.approx(1.0, abs=0.2)
    assert rms[2] / predicted[2] == pytest.approx(1.0, abs=0.2)


def test_a_prediction_is_that_of_the_adjustment_without_errors() -> None:
    """Covariances at the truth, against the adjusted survey's own for the same terrain and the same places."""
    plan = replace(SMALL, control_points=4)
    found = predict_accuracy(plan)
    survey = survey_of(plan, 1, errors=False, extra=found.place_m)
    result = adjust(survey.block, AdjustmentSettings(robust_loss="none"))
    sigma = np.sqrt(np.einsum("gii->gi", result.covariances.ground_m2[plan.control :]))
    known = np.isfinite(sigma[:, 0])
    np.testing.assert_allclose(sigma[known], found.sigma_m[known], rtol=1e-3)
    assert known.sum() > 0.9 * len(known)


def test_what_helps() -> None:
    plan = replace(SMALL, width_m=120, length_m=160, gnss="consumer", control_points=4, relief_m=2)
    found, tried = predict_accuracy(plan), alternatives(plan)
    assert {a.what for a in tried} == set(changes(plan))
    best = {a.what: a.prediction.typical_m(a.prediction.sigma_m[:, 2])[0] for a in tried}
    now = found.typical_m(found.sigma_m[:, 2])[0]
    assert list(best.values()) == sorted(best.values())
    assert best["RTK"] < 0.8 * now
    assert best["one more control point, in the middle"] < 0.9 * now
    assert best["one more oblique strip"] < 0.9 * now
    middle = int(np.argmin(np.linalg.norm(found.place_m, axis=1)))
    corner = int(np.argmin(np.linalg.norm(found.place_m - found.control_m[0, :2], axis=1)))
    assert found.sigma_m[middle, 2] > found.sigma_m[corner, 2]  # the dome of four corners
    assert any("dome" in warning for warning in found.warnings)


def test_blunders_of_control_points_that_would_show() -> None:
    found = predict_accuracy(replace(SMALL, control_points=5))
    assert found.control_mdb_m.shape == (5, 3)
    assert np.all(found.control_mdb_m > 4.132 * np.array(found.plan.control_sigma_m) * (1 - 1e-9))
    assert np.all(found.control_mdb_m < 1.0)
    alone = predict_accuracy(replace(SMALL, control_points=3, gnss="none"))
    assert np.all(alone.control_mdb_m[:, 2] > found.control_mdb_m[:3, 2])


@given(
    st.floats(30, 400), st.floats(30, 400), st.floats(0.01, 0.05), st.floats(0.5, 0.9), st.floats(0.4, 0.8)
)  # fmt: skip
def test_strips_cover_the_site(width: float, length: float, gsd: float, forward: float, side: float) -> None:
    plan = FlightPlan(
        width_m=width, length_m=length, gsd_m=gsd, forward_overlap=forward, side_overlap=side, relief_m=1.0
    )
    centres = np.concatenate([course.poses()[1] for course in courses(plan)])
    assert len(centres) == plan.photographs
    assert np.all(np.ptp(centres[:, :2], axis=0) >= np.array([width, length]) - 1e-6)
    np.testing.assert_allclose(centres[:, 2], plan.height_m)
    strip = courses(plan)[0]
    along = np.diff(strip.poses()[1], axis=0)
    # the share of a photograph's ground along the strip that the next one shows again
    assert 1 - np.linalg.norm(along[0]) / (plan.height_px * gsd) == pytest.approx(forward)
    assert (courses(plan)[0].heading_deg % 180 == 0) == (length >= width)


def test_cross_strips_are_higher_and_oblique_strips_look_forward() -> None:
    plan = replace(SMALL, cross_strips=2, oblique_strips=1)
    cross, oblique = courses(plan)[-3:-1], courses(plan)[-1]
    for course in cross:
        assert course.height_world_m == pytest.approx(1.2 * plan.height_m)
        assert course.heading_deg % 180 == 90
    R, C = oblique.poses()
    looks_at = C[:, :2] + plan.height_m * R[:, :2, 2] / -R[:, 2:, 2]
    np.testing.assert_allclose(looks_at.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)


@pytest.mark.parametrize("layout", ["corners", "edges", "grid", "centre"])
@pytest.mark.parametrize("count", [0, 1, 4, 5, 7, 12])
def test_control_points_lie_where_they_are_asked_for(layout: Layout, count: int) -> None:
    plan = replace(SMALL, control_points=count, control_layout=layout, control_world_m=((1.0, 2.0),))
    places = control_places(plan)
    assert places.shape == (count + 1, 2)
    np.testing.assert_allclose(places[-1], [1.0, 2.0])
    laid_out = places[:-1]
    half = np.array([plan.width_m, plan.length_m]) / 2
    assert np.all(np.abs(laid_out) < half)
    if count > 1:
        apart = np.linalg.norm(laid_out[:, None] - laid_out[None], axis=2) + 1e9 * np.eye(count)
        assert apart.min() > 2.0
    if layout == "corners" and count >= 4:
        np.testing.assert_allclose(np.sort(np.abs(laid_out[:4]), axis=0), np.tile(0.92 * half, (4, 1)))
    if layout == "edges":
        assert np.all(np.isclose(np.abs(laid_out), 0.92 * half).any(axis=1))
    if layout == "centre" and count:
        assert np.all(np.abs(laid_out) < 0.2 * half)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"gsd_m": 0.02, "flying_height_m": 50.0}, "not both"),
        ({"forward_overlap": 0.99}, "forward_overlap: must be from 0 to 0.97, found 0.99"),
        ({"gsd_m": 0.002, "width_m": 2000.0, "length_m": 2000.0, "relief_m": 0.0}, "photographs are more than"),
        ({"gsd_m": 0.002}, "too low for a relief of 10 m"),
        ({"gnss": "none", "control_points": 2}, "give 3 at least, not 2"),
    ],
)  # fmt: skip
def test_plans_that_cannot_be(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ProjectError, match=r"^photogram plan: ") as fault:
        flight_plan(None, wrong)
    assert said in str(fault.value)


def test_a_flight_without_overlap_is_no_survey() -> None:
    with pytest.raises(AdjustmentError, match="overlap"):
        predict_accuracy(replace(SMALL, forward_overlap=0.0, side_overlap=0.0, gnss="none"))


def test_the_file_says_the_plan(tmp_path: Path) -> None:
    path = tmp_path / "flight.yaml"
    path.write_text(
        "site: {width_m: 250, length_m: 120}\n"
        "camera: {width_px: 5280, height_px: 3956, focal_px: 3710, sigmas: {focal_px: 20, k1: free}}\n"
        "flight: {flying_height_m: 70, cross_strips: 1}\n"
        "gnss: {kind: consumer, offset_sigma_m: [1, 1, 3]}\n"
        "control: {positions_m: [[-100, 50], [100, -50], [0, 0]], sigma_m: [0.02, 0.02, 0.03]}\n"
        "tie_points: {sigma_px: 0.7, detection: 0.4}\n",
        encoding="utf-8",
    )
    plan = flight_plan(path, {})
    assert (plan.width_m, plan.height_m, plan.cross_strips, plan.gnss) == (250, 70, 1, "consumer")
    assert (plan.control, plan.control_sigma_m) == (3, (0.02, 0.02, 0.03))
    assert (plan.calibration.focal_px, plan.calibration.k1, plan.calibration.k2) == (20, float("inf"), 0.02)
    assert (plan.offset_sigmas_m, plan.gnss_sigmas_m) == ((1, 1, 3), (2.0, 2.0, 2.0))
    assert (plan.tie_point_sigma_px, plan.tie_point_detection) == (0.7, 0.4)


def test_every_fault_of_the_file_at_once(tmp_path: Path) -> None:
    path = tmp_path / "flight.yaml"
    path.write_text(
        "site: {width_m: -5}\nflight: {forward_overlop: 0.8, side_overlap: 1.2}\ngnss: {kind: rtkk}\n"
        "control: {positions_m: [[1, 2, 3]]}\n",
        encoding="utf-8",
    )
    with pytest.raises(ProjectError) as fault:
        flight_plan(path, {})
    text = str(fault.value)
    assert "4 errors" not in text
    for said in (
        f"{path}:1: site.width_m", f"{path}:2: flight.forward_overlop: unknown key", "did you mean",
        f"{path}:2: flight.side_overlap", f"{path}:3: gnss.kind", f"{path}:4: control.positions_m",
    ):  # fmt: skip
        assert said in text, text


def test_the_command(photogram: Callable[..., Any], tmp_path: Path) -> None:
    path, picture = tmp_path / "flight.yaml", tmp_path / "plan.png"
    path.write_text(
        "site: {width_m: 60, length_m: 80}\n"
        "flight: {flying_height_m: 60, forward_overlap: 0.7}\n"
        "camera: {width_px: 1500, height_px: 1125, focal_px: 1200, sigmas: {focal_px: free}}\n"
        "tie_points: {per_photograph: 60}\n",
        encoding="utf-8",
    )
    outcome = photogram("plan", path, "--control", 4, "--gnss", "consumer", "--picture", picture)
    assert outcome.code == 0, outcome.err
    for said in ("photographs, strips", "ground points in height", "Effect of single changes", "RTK"):
        assert said in outcome.out
    with Image.open(picture) as image:
        assert image.size[0] > 1000
    outcome = photogram("plan", path, "--area", "40x50", "--gsd", "0.05", "--no-changes", "--json")
    assert outcome.code == 0, outcome.err
    value = json.loads(outcome.out)
    assert (value["plan"]["width_m"], value["plan"]["length_m"], value["changes"]) == (40, 50, [])
    assert value["gsd_m"] == pytest.approx(0.05)
    assert value["sigma_height_m"]["median"] <= value["sigma_height_m"]["worst"]
    assert len(value["control_mdb_m"]) == len(value["control_m"]) == 5
    assert value["simulated"] is True
    assert value["plan"]["calibration"]["focal_px"] == "free"


def test_changes_that_cannot_be_flown_are_left_out() -> None:
    plan = FlightPlan(width_m=900, length_m=800, gsd_m=0.02, relief_m=1.0)
    assert plan.photographs > 1200
    assert not any("overlaps" in what for what in changes(plan))
    assert "one more oblique strip" in changes(plan)


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--area", "200"), 2, "write two numbers"),
        (("--gnss", "rtkk"), 2, "is not one of 'rtk', 'consumer', 'none'"),
        (("--layout", "ring"), 2, "is not one of 'corners', 'edges', 'grid'"),
        (("--gsd", "0.02", "--height", "50"), 1, "not both"),
        (("nowhere.yaml",), 1, "nowhere.yaml"),
    ],
)  # fmt: skip
def test_wrong_usage(photogram: Callable[..., Any], options: tuple[str, ...], code: int, said: str) -> None:
    outcome = photogram("plan", *options)
    assert outcome.code == code, outcome.err
    assert said in " ".join(outcome.err.replace("│", " ").split())
