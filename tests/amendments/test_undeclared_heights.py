"""Whether GNSS heights and those of control points are of one system, on simulated surveys."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.amendments.undeclared_heights import POOR_M, WIDEST_M, with_heights_open
from photogram.simulation.observations import simulate_block
from photogram.simulation.survey_plan import RTK_GNSS_SIGMA_M, SurveyPlan
from photogram.survey import Block, UndeclaredHeights

PLAN = SurveyPlan(
    strips=3, photographs_per_strip=5, gnss_sigma_m=RTK_GNSS_SIGMA_M, gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    control_points=6, check_points=6,
)  # fmt: skip


def block_of(geoid_m: float, seed: int = 4, lowered_m: float = 0.0) -> Block:
    """Return a survey whose ground points are above a geoid, and whose positions were lowered before."""
    block = simulate_block(PLAN, seed, tie_points=600).block
    points, up = block.control_points, np.array([0.0, 0.0, 1.0])
    photographs = tuple(replace(p, gnss_world_m=np.asarray(p.gnss_world_m) - lowered_m * up) for p in block.photographs)
    return replace(
        block,
        photographs=photographs,
        control_points=replace(points, position_world_m=points.position_world_m - geoid_m * up),
        undeclared_heights=UndeclaredHeights(lowered_m),
    )


def adjusted(block: Block) -> Verdict:
    return adjust_with_snooping(block, AdjustmentSettings())


def test_heights_of_one_system_are_adjusted_as_declared_ones() -> None:
    block = block_of(0.0)
    verdict, declared = adjusted(block), adjusted(replace(block, undeclared_heights=None))
    decision = verdict.result.decisions.heights
    assert decision is not None
    assert decision.same
    assert abs(decision.difference_m) < 4.0 * decision.sigma_m
    assert declared.result.decisions.heights is None
    assert verdict.rejected == declared.rejected == ()
    assert verdict.result.estimates.flights == ()
    for pose, other in zip(verdict.result.block.poses, declared.result.block.poses, strict=True):
        assert pose is not None
        assert other is not None
        np.testing.assert_allclose(pose.position_world_m, other.position_world_m, atol=1e-4)


@pytest.mark.parametrize(("geoid_m", "lowered_m"), [(47.0, 45.0), (-32.0, -33.0), (1.2, 0.0), (47.0, 0.0)])
def test_a_difference_is_found_and_control_says_how_high_the_ground_is(geoid_m: float, lowered_m: float) -> None:
    verdict, plain = adjusted(block_of(geoid_m, 5, lowered_m)), adjusted(block_of(0.0, 5))
    decision = verdict.result.decisions.heights
    assert decision is not None
    assert not decision.same
    assert decision.difference_m == pytest.approx(geoid_m, abs=4.0 * decision.sigma_m)
    assert decision.sigma_m < 0.3
    assert verdict.rejected == ()
    off = verdict.result.estimates.ground_world_m[:, 2] + geoid_m - plain.result.estimates.ground_world_m[:, 2]
    sigma = np.sqrt(verdict.result.covariances.ground_m2[:, 2, 2])
    assert np.max(np.abs(off) / sigma) < 3.0
    kind = "too little for two height systems" if geoid_m == 1.2 else "declare both under heights"
    assert kind in decision.sentence


def test_a_wrong_control_height_is_named_beside_the_difference() -> None:
    block = block_of(40.0, 6, 39.0)
    points = block.control_points
    wrong = points.role.index("control")
    position = points.position_world_m.copy()
    position[wrong, 2] += 2.0
    verdict = adjusted(replace(block, control_points=replace(points, position_world_m=position)))
    assert [a.name for a in verdict.rejected] == [points.name[wrong]]
    decision = verdict.result.decisions.heights
    assert decision is not None
    assert decision.difference_m == pytest.approx(40.0, abs=4.0 * decision.sigma_m)


def test_what_cannot_be_of_two_systems_is_left_as_it_is() -> None:
    block = block_of(0.0)
    declared = replace(block, undeclared_heights=None)
    assert with_heights_open(declared) is declared
    unpositioned = replace(
        block, photographs=tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in block.photographs)
    )
    assert with_heights_open(unpositioned) is unpositioned
    points = block.control_points
    checked = replace(block, control_points=points.with_roles(["check"] * len(points)))
    assert with_heights_open(checked) is checked
    np.testing.assert_array_equal(with_heights_open(block).gnss_offset_sigma_m, [0.0, 0.0, WIDEST_M])


def test_poor_heights_say_nothing_of_systems() -> None:
    block = block_of(20.0, 7)
    poor = tuple(replace(p, gnss_sigma_m=np.array([2.0, 2.0, 3.0 * POOR_M])) for p in block.photographs)
    verdict = adjusted(replace(block, photographs=poor))
    assert verdict.result.decisions.heights is None
    assert verdict.rejected == ()
