"""Sigmas of GNSS positions that nobody has stated: known scatter, blunders, bounds."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.stochastic_model.assumed_gnss import LEAST_M, robust_factor
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=4, photographs_per_strip=6, control_points=5, check_points=2, flights=2,
    gnss_sigma_m=(0.4, 0.4, 0.8), gnss_offset_sigma_m=(2.0, 2.0, 3.0),
)  # fmt: skip
ASSUMED_M = np.array([2.0, 2.0, 3.0])


def assumed(plan: SurveyPlan, seed: int) -> Block:
    """A survey with the sigmas of a receiver that states none."""
    block = simulate_block(
        plan, seed, tie_points=300, start_position_sigma_m=0.1, start_attitude_sigma_deg=0.1, start_point_sigma_m=0.1
    ).block
    photographs = tuple(replace(p, gnss_sigma_m=ASSUMED_M, gnss_sigma_assumed=True) for p in block.photographs)
    return replace(block, photographs=photographs)


def test_the_factor_is_that_of_the_scatter_and_a_blunder_moves_it_little() -> None:
    rng = np.random.default_rng(1)
    r = rng.uniform(0.2, 1.0, 4000)
    w = 0.3 * rng.standard_normal(4000)
    assert robust_factor(w, r) == pytest.approx(0.3, rel=0.05)
    few, of_few = w[:40].copy(), r[:40]
    before = robust_factor(few, of_few)
    few[0] = 1e3
    assert robust_factor(few, of_few) < 1.15 * before


def test_sigmas_are_found_for_each_flight_in_plan_and_in_height() -> None:
    ratios = []
    for seed in range(5):
        result = adjust(assumed(PLAN, seed), AdjustmentSettings())
        s = result.decisions.sigmas
        mine = np.char.startswith(s.kind, "gnss")
        assert list(zip(s.kind[mine].tolist(), s.of[mine].tolist(), strict=True)) == [
            ("gnss_plan", "1"), ("gnss_height", "1"), ("gnss_plan", "2"), ("gnss_height", "2"),
        ]  # fmt: skip
        np.testing.assert_allclose(s.stated_sigma[mine], [2.0, 3.0, 2.0, 3.0])
        np.testing.assert_allclose(s.estimated_sigma[mine], s.used_sigma[mine], rtol=0.021)
        used = np.array([p.gnss_sigma_m for p in result.block.photographs])
        np.testing.assert_allclose(used[0], [s.used_sigma[mine][0]] * 2 + [s.used_sigma[mine][1]])
        ratios.append(s.used_sigma[mine] / [0.4, 0.8, 0.4, 0.8])
    # redundancies are 20 in plan and 11 in height, so that one estimate has a standard deviation of 0.16 and 0.22
    both_flights = np.reshape(ratios, (10, 2))
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(both_flights), axis=0)), 1.0, atol=0.25)


def test_what_is_stated_or_has_no_offset_stays() -> None:
    block = assumed(PLAN, 1)
    stated = replace(block, photographs=tuple(replace(p, gnss_sigma_assumed=False) for p in block.photographs))
    without_offset = replace(block, gnss_offset_sigma_m=np.zeros(3))
    for given in (stated, without_offset):
        result = adjust(given, AdjustmentSettings())
        assert not np.char.startswith(result.decisions.sigmas.kind, "gnss").any()
        for photograph in result.block.photographs:
            np.testing.assert_array_equal(photograph.gnss_sigma_m, ASSUMED_M)


def test_no_sigma_falls_below_the_bound() -> None:
    result = adjust(assumed(replace(PLAN, gnss_sigma_m=(0.01, 0.01, 0.01)), 2), AdjustmentSettings())
    gnss = np.char.startswith(result.decisions.sigmas.kind, "gnss")
    np.testing.assert_allclose(result.decisions.sigmas.used_sigma[gnss], LEAST_M)
