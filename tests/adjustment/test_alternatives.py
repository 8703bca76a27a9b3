"""Alternatives to a solved block: they say what an adjustment with all rays says."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.solutions.alternatives import Summarised, alternative, summarised, summarised_at
from photogram.amendments.gross_errors.data_snooping import hypotheses, without
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.errors import AdjustmentError
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

SETTINGS = AdjustmentSettings()
PLAN = SurveyPlan(
    strips=3, photographs_per_strip=5, control_points=6, check_points=3, attitude_sigma_deg=1.0,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip


def solved(seed: int = 1, plan: SurveyPlan = PLAN) -> tuple[Block, Summarised]:
    block = simulate_block(plan, seed, tie_points=500, mismatches=0.01, start_position_sigma_m=0.3).block
    return block, summarised(adjust(block, SETTINGS), SETTINGS)


def statistics(result: Adjustment) -> dict[tuple[object, ...], float]:
    return {(*a.what, *a.axes): a.statistic for a in hypotheses(result)}


def rejections(block: Block) -> list[list[Hypothesis]]:
    """What may be rejected: nothing, a point, a mark, positions and attitudes, the focal length's source."""
    names, points = block.photograph_names, block.control_points
    control = points.name[points.role.index("control")]
    mark = int(np.flatnonzero(points.mark_point == points.role.index("control"))[0])
    positions = [unmeasured("GNSS position", name) for name in names[:4]]
    return [
        [],
        [unmeasured("control point", control)],
        [unmeasured("mark", control, names[points.mark_photograph[mark]])],
        [*positions, unmeasured("attitude", names[7])],
        [unmeasured("focal length", block.cameras[0].name)],
    ]


@pytest.mark.parametrize("number", range(5))
def test_an_alternative_says_what_all_rays_say(number: int) -> None:
    block, base = solved()
    other = without(block, rejections(block)[number])
    quick = alternative(base, other, SETTINGS)
    whole = adjust(other, SETTINGS, near=base.result, sigmas=base.result.decisions.sigmas)
    ours, theirs = statistics(quick), statistics(whole)
    assert ours.keys() == theirs.keys()
    np.testing.assert_allclose(
        [np.sqrt(ours[key]) for key in theirs], [np.sqrt(value) for value in theirs.values()], atol=0.05
    )
    ours_m, theirs_m = (np.sqrt(np.einsum("nii->ni", r.covariances.position_m2)) for r in (quick, whole))
    np.testing.assert_allclose(ours_m, theirs_m, rtol=0.02)
    sigma_m = np.sqrt(np.einsum("gii->gi", whole.covariances.ground_m2))
    off = np.abs(quick.estimates.ground_world_m - whole.estimates.ground_world_m)
    assert np.nanmax(off / sigma_m) < 0.1
    assert quick.cost == pytest.approx(whole.cost, abs=0.5)


def test_it_is_deterministic_and_has_no_tie_points() -> None:
    block, base = solved()
    first, second = (alternative(base, block, SETTINGS) for _ in range(2))
    assert not len(first.block.tie_points)
    assert first.cost == second.cost
    assert first.decisions.sigmas is base.result.decisions.sigmas


def test_what_is_not_determined_is_named() -> None:
    block, base = solved()
    everything = [unmeasured("GNSS position", name) for name in block.photograph_names]
    points = block.control_points
    everything += [unmeasured("control point", name) for name in points.name]
    attitudes = [unmeasured("attitude", name) for name in block.photograph_names]
    with pytest.raises(AdjustmentError, match="its position is not determined"):
        alternative(base, without(block, [*everything, *attitudes]), SETTINGS)


def test_summaries_one_after_the_other_lead_to_the_minimum() -> None:
    """A focal length that is held 3 % off bends the block beyond what one quadratic form tells."""
    block, base = solved()
    camera = block.cameras[0]
    held = replace(camera, focal_px=1.03 * camera.focal_px, sigmas=np.concatenate([[0.0], camera.sigmas[1:]]))
    other = replace(block, cameras=(held,))
    whole = adjust(other, SETTINGS, near=base.result, sigmas=base.result.decisions.sigmas)
    for _ in range(4):
        quick = alternative(base, other, SETTINGS)
        base = summarised_at(base, quick, SETTINGS)
    sigma_m = np.sqrt(np.einsum("nii->ni", whole.covariances.position_m2))
    positions = [
        np.array([pose.position_world_m for pose in result.block.poses if pose is not None])
        for result in (quick, whole)
    ]
    assert np.max(np.abs(positions[0] - positions[1]) / sigma_m) < 0.5


def test_an_adjustment_near_another_is_that_from_the_beginning() -> None:
    block, base = solved()
    again = adjust(block, SETTINGS, near=base.result)
    first = adjust(block, SETTINGS)
    assert again.iterations < first.iterations
    sigma_m = np.sqrt(np.einsum("gii->gi", first.covariances.ground_m2))
    off = np.abs(again.estimates.ground_world_m - first.estimates.ground_world_m)
    assert np.nanmax(off / sigma_m) < 0.05
    np.testing.assert_allclose(again.decisions.sigmas.factor, first.decisions.sigmas.factor, rtol=0.01)
    assert [e.error.kind for e in again.decisions.common_errors] == [
        e.error.kind for e in first.decisions.common_errors
    ]
