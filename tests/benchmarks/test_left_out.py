"""What is predicted for measurements that took no part, in simulated surveys with stated noise."""

from dataclasses import replace

import numpy as np
import pytest
from lib.left_out import Predicted, Start, control_left_out, folds, one_by_one, positions_left_out
from makers import simulated

from photogram.adjustment.problem import AdjustmentSettings
from photogram.geodesy.frames import LocalFrame
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=6, check_points=0, gnss_sigma_m=(0.05, 0.05, 0.08),
    gnss_offset_sigma_m=(0.0, 0.0, 0.0),
)  # fmt: skip
START = Start(AdjustmentSettings())


def made(seed: int) -> Block:
    block = simulated(PLAN, seed).block
    return replace(block, frame=LocalFrame.local())  # its world is its map


def rms_z(found: list[Predicted]) -> float:
    return float(np.sqrt(np.mean([row.z**2 for row in found])))


def test_what_is_left_out_is_predicted_to_its_standard_deviation() -> None:
    control, positions = list[Predicted](), list[Predicted]()
    for seed in (1, 2):
        block = made(seed)
        for study_of, found in ((control_left_out, control), (positions_left_out, positions)):
            own, failed = study_of(block, START)
            assert failed == []
            found += own
    assert len(control) == 2 * 3 * 6
    assert len(positions) == 2 * 3 * 6
    assert rms_z(control) == pytest.approx(1.0, abs=0.3)
    assert rms_z(positions) == pytest.approx(1.0, abs=0.3)
    # predicted control points have their own survey's part, and more
    assert all(0.0 < row.own < row.sigma for row in control + positions)


def test_sigmas_that_are_stated_three_times_too_large_show() -> None:
    block = made(1)
    photographs = tuple(
        p if p.gnss_sigma_m is None else replace(p, gnss_sigma_m=3.0 * p.gnss_sigma_m) for p in block.photographs
    )
    found, _ = positions_left_out(replace(block, photographs=photographs), START)
    assert rms_z(found) < 0.75 * rms_z(positions_left_out(block, START)[0])


def test_one_adjustment_tells_what_it_would_predict_without_each() -> None:
    block = made(2)
    together = one_by_one(block, START)
    assert {row.kind for row in together} == {"marks, one by one", "positions, one by one"}
    assert {row.unit for row in together if row.kind.startswith("marks")} == {"px"}
    assert rms_z([row for row in together if row.kind.startswith("positions")]) == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize(("count", "parts"), [(0, 0), (3, 3), (10, 10), (11, 5), (190, 5)])
def test_each_measurement_is_left_out_once(count: int, parts: int) -> None:
    masks = folds(count)
    assert len(masks) == parts
    assert np.array_equal(np.sum(masks, axis=0), np.ones(count)) or not count
