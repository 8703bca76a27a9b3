"""GNSS heights that are one figure for a whole flight."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.constant_heights import FEWEST, constant_heights
from photogram.amendments.gross_errors.data_snooping import without
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.gnss import UNKNOWN_M
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=6, control_points=6, check_points=6, position_noise_m=4.0,
    gnss_sigma_m=(0.02, 0.02, 0.03), gnss_offset_sigma_m=(0.02, 0.02, 0.03),
)  # fmt: skip
HEIGHT_M = 190.0


def survey(seed: int = 1, plan: SurveyPlan = PLAN) -> SimulatedBlock:
    return simulate_block(plan, seed, tie_points=500, start_position_sigma_m=0.1, start_attitude_sigma_deg=0.2)


def levelled(block: Block) -> Block:
    """The block whose GNSS positions have one height in the map."""
    map_m = block.frame.map_from_world(np.array([p.gnss_world_m for p in block.photographs]))
    map_m[:, 2] = HEIGHT_M
    pairs = zip(block.photographs, block.frame.world_from_map(map_m), strict=True)
    return replace(block, photographs=tuple(replace(p, gnss_world_m=place) for p, place in pairs))


@pytest.mark.parametrize("seed", [1, 2])
def test_they_are_withdrawn_alone_and_nobody_else_is_accused(seed: int) -> None:
    made = survey(seed)
    verdict = adjust_with_snooping(levelled(made.block), AdjustmentSettings())
    assert {(a.kind, a.name) for a in verdict.rejected} == {("GNSS height", n) for n in made.block.photograph_names}
    (blunder,) = verdict.blunders
    assert blunder.sentence.startswith("GNSS heights of 18 photographs (sim_0001.JPG")
    assert "all are 190.00 m" in blunder.sentence
    sigma_m = np.array([p.gnss_sigma_m for p in verdict.result.block.photographs])
    np.testing.assert_allclose(sigma_m, [[0.02, 0.02, UNKNOWN_M]] * 18)
    right = adjust_with_snooping(made.block, AdjustmentSettings())
    check = np.array(made.block.control_points.role) == "check"
    off, best = (
        (v.result.estimates.ground_world_m - made.truth.control_position_world_m)[check] for v in (verdict, right)
    )
    assert np.sqrt(np.mean(off**2)) < 1.5 * np.sqrt(np.mean(best**2))


def test_an_aircraft_that_holds_its_height_has_measured_it() -> None:
    single = replace(PLAN, gnss_sigma_m=(2.0, 2.0, 3.0))
    assert constant_heights(levelled(survey(1, single).block)) == ([], [])
    still = replace(PLAN, position_noise_m=0.02)
    exact = simulate_block(still, 1, tie_points=300, start_position_sigma_m=0.0)
    assert constant_heights(levelled(exact.block)) == ([], [])
    assert constant_heights(survey().block) == ([], [])


def test_each_flight_is_looked_at_by_itself() -> None:
    block = survey().block
    photographs = [replace(p, flight="2") if i < 6 else p for i, p in enumerate(levelled(block).photographs)]
    photographs[6:] = [
        replace(p, gnss_world_m=q.gnss_world_m) for p, q in zip(photographs[6:], block.photographs[6:], strict=True)
    ]
    mixed = replace(block, photographs=tuple(photographs))
    assert [a.name for a in constant_heights(mixed)[0]] == list(block.photograph_names[:6])
    few = replace(mixed, photographs=(*photographs[: FEWEST - 1], replace(photographs[FEWEST - 1], flight="1"),
                                      *photographs[FEWEST:]))  # fmt: skip
    assert constant_heights(few) == ([], [])


def test_what_is_withdrawn_already_is_not_withdrawn_again() -> None:
    block = levelled(survey().block)
    assert constant_heights(without(block, constant_heights(block)[0])) == ([], [])
