"""No decision hangs on a last digit: measurements that differ by 1e-12 of themselves, as other processors' libraries
leave them, lead to the same rejections, the same model and the same words."""

from dataclasses import replace

import numpy as np
import pytest
from seeds import seeds

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(strips=3, photographs_per_strip=4, control_points=6, check_points=3)
KINDS = {
    "control and consumer GNSS": replace(PLAN, gnss_sigma_m=(2.0, 2.0, 2.0)),
    "a blunder in height": replace(PLAN, control_height_blunder_m=0.4, blunder_point="G03"),
    "RTK, compass off": replace(PLAN, control_points=0, heading_error_deg=6.0, gnss_offset_sigma_m=(0.0, 0.0, 0.0)),
    "a lever arm that nobody states": replace(PLAN, control_points=0, lever_arm_m=(0.1, 0.0, 0.25)),
    "two flights, focal length by its tag": replace(PLAN, flights=2, calibration_source="exif", focal_tag_factor=1.05),
}
RELATIVE = 1e-12
CASES = [(kind, seed) for kind in KINDS for seed in seeds(10, 2)]


def perturbed(block: Block, seed: int) -> Block:
    """The block with every measurement, and every starting value, off by so little."""
    rng = np.random.default_rng([seed, 77])

    def off(values: np.ndarray) -> np.ndarray:
        return np.asarray(values * (1.0 + RELATIVE * rng.standard_normal(np.shape(values))))

    photographs = tuple(
        p if p.gnss_world_m is None else replace(p, gnss_world_m=off(p.gnss_world_m)) for p in block.photographs
    )
    poses = tuple(p if p is None else replace(p, position_world_m=off(p.position_world_m)) for p in block.poses)
    points, tie = block.control_points, block.tie_points
    return replace(
        block,
        photographs=photographs,
        poses=poses,
        control_points=replace(
            points, mark_pixel=off(points.mark_pixel), position_world_m=off(points.position_world_m)
        ),
        tie_points=replace(tie, pixel=off(tie.pixel), position_world_m=off(tie.position_world_m)),
    )


def decided(verdict: Verdict) -> dict[str, object]:
    decisions = verdict.result.decisions
    return {
        "rejected": [(a.kind, a.name, a.photograph, a.axes) for a in verdict.rejected],
        "blunders": [(b.kind, b.points, b.photograph) for b in verdict.blunders],
        "model": [(d.about, d.adopted, d.degrees) for d in decisions.made],
        "offsets": decisions.flights_without_offset,
        "common errors": [estimate.error.kind for estimate in decisions.common_errors],
        "tie points": len(verdict.result.block.tie_points.photograph),
        "rounds": verdict.result.rounds,
    }


@pytest.mark.parametrize(("kind", "seed"), CASES)
def test_the_last_digit_of_measurements_decides_nothing(kind: str, seed: int) -> None:
    block = simulate_block(KINDS[kind], seed, tie_points=200, mismatches=0.03).block
    one, other = (adjust_with_snooping(b, AdjustmentSettings()) for b in (block, perturbed(block, seed)))
    assert decided(one) == decided(other)
    for a, b in zip(one.result.block.poses, other.result.block.poses, strict=True):
        assert a is not None
        assert b is not None
        np.testing.assert_allclose(a.position_world_m, b.position_world_m, atol=1e-6)
    np.testing.assert_allclose(one.result.sigma0, other.result.sigma0, rtol=1e-8)
