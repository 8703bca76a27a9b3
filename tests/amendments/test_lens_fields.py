from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.amendment import Solution
from photogram.amendments.lens_fields import FEWEST_PHOTOGRAPHS, LensFields, cross_validated
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import IntArray
from photogram.camera import field_at
from photogram.errors import AdjustmentError
from photogram.lens.field_basis import field_basis
from photogram.lens.fields import free_field, prior_sigmas
from photogram.projection import CAMERA_PARAMETERS, READOUT
from photogram.quality.residual_patterns import residual_patterns
from photogram.results import LensFieldDecision
from photogram.simulation.simulated_survey import SimulatedBlock, simulate_block
from photogram.simulation.survey_plan import whole_survey_plan
from photogram.survey import Block

SETTINGS = AdjustmentSettings()


@cache
def survey(expected_px: float, strips: int = 4) -> SimulatedBlock:
    """Simulate photographs straight down on GNSS alone, of a lens whose field is a draw from the prior."""
    whole = whole_survey_plan()
    sigmas = tuple(p.in_its_unit(p.unknown, whole.focal_px, whole.width_px) for p in CAMERA_PARAMETERS[:READOUT])
    plan = replace(
        whole, attitude_sigma_deg=2.0, calibration_sigmas=sigmas, strips=strips, control_points=0, check_points=0,
        gnss_sigma_m=(0.015, 0.015, 0.025), gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    )  # fmt: skip
    made = simulate_block(
        plan, 1, tie_points=800, sigma_px=0.3, detection=0.8, start_position_sigma_m=0.3,
        start_attitude_sigma_deg=0.3, start_point_sigma_m=0.5,
    )  # fmt: skip
    if expected_px == 0.0:
        return made
    camera = made.block.cameras[0]
    field = free_field(camera, expected_px)
    drawn = replace(field, coefficients=field.sigmas * np.random.default_rng(7).standard_normal(len(field.sigmas)))
    tie = made.block.tie_points
    bent = replace(tie, pixel=tie.pixel + field_at(replace(camera, field=drawn), tie.pixel))
    return replace(made, block=replace(made.block, tie_points=bent))


PLAIN = replace(SETTINGS, lens_field="none")


@cache
def judged(expected_px: float, strips: int = 4) -> Verdict:
    return adjust_with_snooping(survey(expected_px, strips).block, PLAIN)


def decided(block: Block, verdict: Verdict, settings: AdjustmentSettings = SETTINGS) -> LensFieldDecision:
    """Return the decision on the only camera of a block whose field must stay off without another adjustment."""
    fields = LensFields(settings)
    assert fields.propose(Solution(block, (), verdict.result)) is None
    (decision,) = fields.decisions
    assert not decision.estimated
    return decision


def test_a_field_that_the_photographs_show_is_estimated_and_takes_the_pattern() -> None:
    made, before = survey(0.3), judged(0.3)
    after = adjust_with_snooping(made.block, SETTINGS)
    decision = after.result.decisions.lens_fields[0]
    assert decision.estimated, decision.why
    assert decision.gain > 0.0
    assert decision.gain_errors > 5.0
    assert decision.left_px < 0.3 * decision.pattern_px
    assert not residual_patterns(after.result)[decision.camera].significant
    assert residual_patterns(before.result)[decision.camera].significant
    assert 0.1 < decision.rms_px < 0.5
    assert decision.sigma_px < 0.5 * decision.rms_px
    assert after.block.cameras[0].field is not None
    assert made.block.cameras[0].field is None
    field = after.result.block.cameras[0].field
    assert field is not None
    assert decision.largest_px == pytest.approx(np.linalg.norm(field.shift, axis=2).max())
    truth = made.tie_point_position_world_m
    off = [np.sqrt(np.mean((v.result.block.tie_points.position_world_m[:, 2] - truth[kept][:, 2]) ** 2))
           for v in (before, after) for kept in [_kept(made, v)]]  # fmt: skip
    assert off[1] < off[0]


def _kept(made: SimulatedBlock, verdict: Verdict) -> IntArray:
    tie, kept = made.block.tie_points, verdict.result.block.tie_points
    number = {(i, f): n for n, (i, f) in enumerate(zip(tie.photograph.tolist(), tie.feature.tolist(), strict=True))}
    first = kept.first_observation[:-1]
    keys = zip(kept.photograph[first].tolist(), kept.feature[first].tolist(), strict=True)
    return np.asarray(tie.point[[number[key] for key in keys]])


def test_without_a_pattern_nothing_is_adjusted_again() -> None:
    decision = decided(survey(0.0).block, judged(0.0))
    assert decision.why == "the residuals have no significant pattern"
    assert decision.photographs == 24
    assert decision.covered > 0.9
    assert np.isnan([decision.gain, decision.rms_px, decision.sigma_px]).all()


def test_fields_that_are_not_asked_for_are_not_looked_for() -> None:
    verdict = judged(0.3)
    fields = LensFields(PLAIN)
    assert fields.propose(Solution(survey(0.3).block, (), verdict.result)) is None
    assert fields.decisions == verdict.result.decisions.lens_fields == ()


def test_few_photographs_do_not_hold_a_field() -> None:
    block = survey(0.3, strips=1).block
    decision = decided(block, judged(0.3, 1), replace(SETTINGS, lens_field="always"))
    assert decision.why == f"6 photographs are too few to hold it, {FEWEST_PHOTOGRAPHS} are needed"


def test_a_picture_that_is_half_empty_does_not_hold_a_field() -> None:
    block = survey(0.3).block
    tie, camera = block.tie_points, block.cameras[0]
    left = tie.pixel[:, 0] < 0.5 * camera.width_px
    rays = np.bincount(tie.point[left], minlength=len(tie)) >= 2
    half = replace(block, tie_points=tie.select(rays, left & rays[tie.point]))
    decision = decided(half, adjust_with_snooping(half, PLAIN))
    assert "of the picture, 70\u202f% are needed" in decision.why
    assert decision.covered < 0.6


def test_a_calibration_that_is_fixed_has_no_field_beside_it() -> None:
    block, verdict = survey(0.3).block, judged(0.3)
    fixed = replace(block, cameras=tuple(replace(c, sigmas=np.zeros_like(c.sigmas)) for c in block.cameras))
    assert decided(fixed, verdict).why == "its calibration is fixed"


def proposed() -> tuple[LensFields, Solution, Solution]:
    """Return the amendment that has proposed a field, the solution at which it did, and the one with the field."""
    before = Solution(survey(0.3).block, (), judged(0.3).result)
    fields = LensFields(SETTINGS)
    proposal = fields.propose(before)
    assert proposal is not None
    after = Solution(proposal.block, (), adjust(proposal.block, SETTINGS, near=before.result))
    return fields, before, after


def test_a_block_that_cannot_be_adjusted_with_a_field_stays_without() -> None:
    fields, before, _ = proposed()
    assert fields.judged(before, AdjustmentError("no solution")) is before
    assert fields.decisions[0].why == "the block cannot be adjusted with it: no solution"
    assert not fields.decisions[0].estimated
    assert fields.propose(before) is None


def test_a_field_that_the_block_does_not_hold_is_taken_back() -> None:
    fields, before, after = proposed()
    unknown = 400.0 * after.result.covariances.lens_field_px2
    vague = replace(after.result, covariances=replace(after.result.covariances, lens_field_px2=unknown))
    assert fields.judged(before, replace(after, result=vague)) is before
    (decision,) = fields.decisions
    assert not decision.estimated
    assert decision.why.startswith("the block does not hold it")
    assert decision.sigma_px > 0.5 * decision.rms_px
    assert fields.propose(before) is None


def test_a_field_that_the_block_holds_stands() -> None:
    fields, before, after = proposed()
    assert fields.judged(before, after) is after
    assert fields.decisions[0].estimated
    assert fields.propose(after) is None


def test_halves_predict_each_other_only_where_they_have_something_in_common() -> None:
    camera = survey(0.0).block.cameras[0]
    basis = field_basis(camera, 6)
    rng = np.random.default_rng(5)
    n, sigmas = 8000, prior_sigmas(basis.degree, 0.1)
    photograph = np.sort(rng.integers(0, 24, n))
    pixel = rng.uniform(0.0, [camera.width_px - 1, camera.height_px - 1], (n, 2))
    noise, stated = 0.3 * rng.standard_normal((n, 2)), np.full(n, 0.3)
    pattern = basis.at(pixel) @ (sigmas * rng.standard_normal(len(basis)))
    common = cross_validated(basis, sigmas, photograph, pixel, noise + pattern, stated)
    opposed = np.where(photograph % 2 == 0, 1.0, -1.0)[:, None] * pattern
    expected = float(np.sum(pattern**2) / np.sum((noise + pattern) ** 2))
    assert common.share == pytest.approx(expected, rel=0.2)
    assert common.errors > 8.0
    assert cross_validated(basis, sigmas, photograph, pixel, noise, stated).errors < 1.0
    assert cross_validated(basis, sigmas, photograph, pixel, noise + opposed, stated).errors < 0.0
