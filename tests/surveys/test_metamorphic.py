"""A survey that is told in another way is the same: another zone of the map, feet for metres, other names in another
order, a photograph twice, a check point as control."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from makers import read_json

from photogram.geodesy.frames import map_from_crs

pytestmark = [pytest.mark.survey, pytest.mark.usefixtures("undrawn")]
Photogram = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
SPARSE: dict[str, Any] = {"dense": {"enabled": False}, "orthophoto": {"enabled": False}}
FOOT_M = 1200.0 / 3937.0
"""US survey foot."""


@pytest.fixture
def told(survey: Path, edit: Edit, photogram: Photogram) -> Callable[..., dict[str, Any]]:
    """Adjust the survey with its project file changed, and return its report."""

    def adjusted(change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        def sparse(values: dict[str, Any]) -> None:
            values.update(SPARSE)
            values.pop("comparison", None)
            change(values)

        edit(survey / "project.yaml", sparse)
        outcome = photogram("adjust", survey / "project.yaml", "--quiet")
        assert outcome.code == 0, outcome.err
        return dict(read_json(survey / "results" / "quality" / "report.json"))

    return adjusted


@pytest.fixture
def as_told(finished_survey: Path) -> dict[str, Any]:
    """The report of the survey as its project file tells it."""
    return dict(read_json(finished_survey / "results" / "quality" / "report.json"))


def points(report: dict[str, Any], key: str, role: str = "check") -> np.ndarray:
    """Return what a report says of its ground points of a role, by name."""
    named = sorted((p["name"], p[key]) for p in report["control_points"] if p["role"] == role)
    return np.array([value for _, value in named])


def replaced(
    values: dict[str, Any], crs: str, place: Callable[[np.ndarray], np.ndarray], key: str = "position_m"
) -> None:
    values["crs"] = crs
    given = values["control_points"]["list"]
    positions = [point.pop("position_m") for point in given]
    for point, position in zip(given, place(np.array(positions)), strict=True):
        point[key] = [float(value) for value in position]


def assert_same_block(one: dict[str, Any], other: dict[str, Any]) -> None:
    """Hold that two reports have the same noise, tie points and precision."""
    for key in ("sigma0", "redundancy", "tie_points", "observations", "reprojection_rms_px"):
        assert one["adjustment"][key] == pytest.approx(other["adjustment"][key], rel=1e-5), key
    off, off_again = points(one, "residual_m"), points(other, "residual_m")
    # residuals in plan turn with the grid, by what its north is off
    lengths = [np.hypot(*part.T[:2]) for part in (off, off_again)]
    np.testing.assert_allclose(lengths[0], lengths[1], atol=5e-5)
    np.testing.assert_allclose(off[:, 2], off_again[:, 2], atol=5e-5)
    variances = [points(report, "sigma_m") ** 2 for report in (one, other)]
    np.testing.assert_allclose(variances[0][:, :2].sum(axis=1), variances[1][:, :2].sum(axis=1), rtol=1e-4)
    np.testing.assert_allclose(variances[0][:, 2], variances[1][:, 2], rtol=1e-4)


def test_another_zone_of_the_map(told: Callable[..., dict[str, Any]], as_told: dict[str, Any]) -> None:
    there = told(lambda v: replaced(v, "EPSG:25833", lambda p: map_from_crs("EPSG:25832", "EPSG:25833", p)))
    assert_same_block(there, as_told)


@pytest.mark.parametrize("bound", ["", "+towgs84=0,0,0 "], ids=("plain", "bound to WGS 84"))
def test_feet_for_metres(bound: str, told: Callable[..., dict[str, Any]], as_told: dict[str, Any]) -> None:
    crs = f"+proj=utm +zone=32 +ellps=GRS80 {bound}+units=us-ft +no_defs"
    assert_same_block(told(lambda v: replaced(v, crs, lambda p: p / FOOT_M, "position")), as_told)


def test_other_names_in_another_order(
    survey: Path, told: Callable[..., dict[str, Any]], as_told: dict[str, Any]
) -> None:
    names = sorted(path.name for path in (survey / "photographs").glob("*.JPG"))
    new = {name: f"{len(names) - i} photo.JPG" for i, name in enumerate(names)}
    for name in names:
        (survey / "photographs" / name).rename(survey / "photographs" / new[name])

    def renamed(values: dict[str, Any]) -> None:
        values["photographs"]["list"] = [{**p, "name": new[p["name"]]} for p in values["photographs"]["list"]][::-1]
        for point in values["control_points"]["list"]:
            point["name"] = f"P{ord(point['name'][0])}{point['name'][1:]}"
            point["marks"] = {new[name]: pixel for name, pixel in reversed(point["marks"].items())}
        values["control_points"]["list"].reverse()

    report = told(renamed)
    # tie points are drawn in another order, so that a few are others: nothing moves by what the block is known to
    off, expected = points(report, "residual_m"), points(as_told, "residual_m")
    assert np.all(np.abs(off - expected) < 0.5 * points(as_told, "sigma_m"))
    assert report["adjustment"]["tie_points"] == pytest.approx(as_told["adjustment"]["tie_points"], rel=0.05)
    assert report["block"]["registered"] == as_told["block"]["registered"]


def test_a_photograph_that_is_there_twice_counts_once(
    survey: Path, told: Callable[..., dict[str, Any]], as_told: dict[str, Any]
) -> None:
    shutil.copy(survey / "photographs" / "sim_0002.JPG", survey / "photographs" / "sim_0009.JPG")
    report = told(lambda v: v["photographs"]["list"].append({"name": "sim_0009.JPG", "flight": "1"}))
    assert report["adjustment"]["sigma0"] == as_told["adjustment"]["sigma0"]
    np.testing.assert_array_equal(points(report, "residual_m"), points(as_told, "residual_m"))
    np.testing.assert_array_equal(points(report, "sigma_m"), points(as_told, "sigma_m"))


def test_a_check_point_that_becomes_control_makes_nothing_less_precise(
    told: Callable[..., dict[str, Any]], as_told: dict[str, Any]
) -> None:
    def controlled(values: dict[str, Any]) -> None:
        point = next(p for p in values["control_points"]["list"] if p["name"] == "C02")
        point["role"] = "control"

    report = told(controlled)
    before = {p["name"]: np.array(p["sigma_m"]) for p in as_told["control_points"]}
    after = {p["name"]: np.array(p["sigma_m"]) for p in report["control_points"]}
    scale = report["adjustment"]["sigma0"] / as_told["adjustment"]["sigma0"]
    assert np.all(after["C02"] < before["C02"])
    for name, sigma in after.items():
        # standard deviations of tie points are estimated anew, and change a little
        assert np.all(sigma <= before[name] * 1.02), (name, scale)
