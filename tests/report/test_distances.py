"""Sigmas of distances in view.html: the page's grid against the covariances of the tie points themselves."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.factors.covariance import covariances
from photogram.factors.functionals import functions_of_tie_points
from photogram.quality.deformation import places_of
from photogram.quality.ground_errors import ground_errors
from photogram.report.numbers.diagnosis import ground_error_numbers
from photogram.report.record.diagnosis import GroundErrorsRecord
from photogram.report.record.report import Report
from photogram.report.view.distances import NODES, ErrorGrid, error_grid
from photogram.results import Deformation
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block


def reported(errors: GroundErrorsRecord | None) -> Report:
    """The part of a report that distances need."""
    diagnosis = {"ground_errors": errors, "intersection_sigma_m": [None] * 3}
    return cast(Report, {"diagnosis": diagnosis})


def at(grid: ErrorGrid, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the page does: bilinear between the nodes, the last beyond them; sigmas (3,) and L (3, R)."""
    u = np.clip((place[:2] - grid["low_m"]) / grid["step_m"], 0, NODES - 1)
    c = np.minimum(np.floor(u), NODES - 2).astype(int)
    p = u - c
    values = np.concatenate([np.array(grid["sigma_m"])[:, :, None], np.array(grid["factor_m"])], axis=2)
    values = values.reshape(NODES, NODES, 3, -1)
    low, high = values[c[1] : c[1] + 2, c[0]], values[c[1] : c[1] + 2, c[0] + 1]
    rows = (1 - p[0]) * low + p[0] * high
    mean = (1 - p[1]) * rows[0] + p[1] * rows[1]
    return mean[:, 0], mean[:, 1:]


@pytest.mark.parametrize("control", [6, 0], ids=["control", "GNSS only"])
def test_sigmas_of_height_differences_are_those_of_the_whole_system(control: int) -> None:
    plan = SurveyPlan(
        strips=3, photographs_per_strip=5, control_points=control, check_points=0,
        gnss_sigma_m=(2.0, 2.0, 3.0), gnss_offset_sigma_m=(5.0, 5.0, 10.0),
    )  # fmt: skip
    made = simulate_block(
        plan, 3, tie_points=1500, start_position_sigma_m=0.0, start_attitude_sigma_deg=0.0, start_point_sigma_m=0.0
    )
    problem = make_problem(made.block, AdjustmentSettings(robust_loss="none"))
    state = start_state(problem)
    found, places = covariances(problem, state), places_of(problem, state)
    assert places is not None
    position, covariance = ground_errors(problem, state, found, places)
    frame = made.block.frame
    known = replace(Deformation.unknown(), ground_place_world_m=position, ground_covariance_m2=covariance)
    numbers = ground_error_numbers(SimpleNamespace(block=made.block, covariances=SimpleNamespace(deformation=known)))  # type: ignore[arg-type]
    assert numbers is not None
    assert len(json.dumps(numbers)) < 120_000
    record = reported(numbers)
    map_m = frame.map_from_world(state.tie_point)
    origin = np.floor(map_m.min(axis=0))
    low, high = map_m[places.points].min(axis=0) - origin, map_m[places.points].max(axis=0) - origin
    grid = error_grid(record, origin, low, high, in_plan=True)
    assert grid is not None
    rng, ratio = np.random.default_rng(2), []
    for _ in range(60):
        points = np.sort(rng.choice(places.points, 2, replace=False))
        a = np.stack([np.eye(3), -np.eye(3)])
        functions = functions_of_tie_points(problem, state, found.layout, points, a)
        exact = functions.covariance(found)[2, 2]
        own = functions.own[2, 2]
        ends = [at(grid, map_m[k] - origin)[1] for k in points]
        modelled = np.sum((ends[0] - ends[1])[2] ** 2)
        ratio.append(np.sqrt((modelled + own) / exact))
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    assert np.percentile(ratio, 10) > 0.75
    assert np.percentile(ratio, 90) < 1.25
    # the sigmas of single points hold the datum, those of differences do not
    total = np.sqrt(found.tie_point[places.points][:, 2, 2].mean())
    assert (total > 1.0) == (control == 0)


def errors(places: list[list[float]]) -> Report:
    count = len(places)
    factor = [[[k * 1e-3]] * 3 for k in range(count)]
    return reported({"position_map_m": places, "sigma_m": [[0.01] * 3] * count, "factor_m": factor})


@pytest.mark.parametrize(
    "places", [[[5.0, 5.0, 1.0]], [[0.0, 0.0, 1.0], [5.0, 5.0, 1.0], [9.0, 9.0, 1.0], [4.0, 4.0, 0.0]]]
)
def test_few_places_or_places_in_a_line_give_the_nearest(places: list[list[float]]) -> None:
    grid = error_grid(errors(places), np.zeros(3), np.zeros(3), np.full(3, 9.0), in_plan=False)
    assert grid is not None
    assert np.isfinite(grid["factor_m"]).all()
    np.testing.assert_allclose(grid["sigma_m"], 0.01)
    assert grid["own_m"] == [None, None]


def test_without_ground_errors_there_is_no_grid() -> None:
    assert error_grid(reported(None), np.zeros(3), np.zeros(3), np.ones(3), in_plan=True) is None
