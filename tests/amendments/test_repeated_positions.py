"""Positions that a receiver has written once more while the camera moved on."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.repeated_positions import MOVED_M, repeated_positions
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=6, control_points=0, check_points=5, gnss_sigma_m=(1.0, 1.0, 1.5),
    gnss_offset_sigma_m=(2.0, 2.0, 3.0), attitude_sigma_deg=2.0,
)  # fmt: skip
REPEATED = (2, 3, 7, 12)


def survey(seed: int = 1) -> SimulatedBlock:
    return simulate_block(PLAN, seed, tie_points=500, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.2)


def repeating(block: Block, numbers: tuple[int, ...] = REPEATED) -> Block:
    """The block whose photographs have the position of the one before."""
    photographs = list(block.photographs)
    for i in numbers:
        photographs[i] = replace(photographs[i], gnss_world_m=photographs[i - 1].gnss_world_m)
    return replace(block, photographs=tuple(photographs))


def names(block: Block) -> list[str]:
    return [a.name for a in repeated_positions(block)[0]]


def test_all_that_repeat_are_found_and_named_in_one_sentence() -> None:
    block = repeating(survey().block)
    expected = [block.photographs[i].name for i in REPEATED]
    assert names(block) == expected
    (blunder,) = repeated_positions(block)[1]
    assert blunder.sentence.startswith("GNSS positions of 4 photographs (")
    assert "repeat that of the photograph before to the last digit" in blunder.sentence
    assert repeated_positions(survey().block) == ([], [])


def test_they_are_left_out_and_nobody_else_is_accused() -> None:
    made = survey(2)
    verdict = adjust_with_snooping(repeating(made.block), AdjustmentSettings())
    assert {a.name for a in verdict.rejected} == {made.block.photographs[i].name for i in REPEATED}
    assert len(verdict.blunders) == 1
    check = np.array(made.block.control_points.role) == "check"
    off = (verdict.result.estimates.ground_world_m - made.truth.control_position_world_m)[check]
    sigma = np.sqrt(np.einsum("gii->gi", verdict.result.covariances.ground_m2[check]))
    assert np.sqrt(np.mean((off / sigma) ** 2)) < 2.0


def test_the_order_is_that_of_time_where_it_is_told() -> None:
    block = survey().block
    start = datetime(2026, 5, 1, 10, tzinfo=UTC)
    backwards = tuple(
        replace(p, time=start - timedelta(seconds=3 * i)) for i, p in enumerate(repeating(block, (4,)).photographs)
    )
    assert names(replace(block, photographs=backwards)) == [block.photographs[3].name]


def test_who_hovers_or_shares_an_exposure_has_one_position() -> None:
    block = repeating(survey().block, (2,))
    poses = list(block.poses)
    there = poses[1]
    assert there is not None
    poses[2] = replace(there, position_world_m=there.position_world_m + np.array([0.5 * MOVED_M, 0.0, 0.0]))
    assert names(replace(block, poses=tuple(poses))) == []
    shared = tuple(replace(p, capture="one") if i in (1, 2) else p for i, p in enumerate(block.photographs))
    assert names(replace(block, photographs=shared)) == []
    unoriented = tuple(None if i == 2 else pose for i, pose in enumerate(block.poses))
    assert names(replace(block, poses=unoriented)) == []
