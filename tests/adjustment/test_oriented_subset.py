"""Blocks of which a part is oriented: cut out, adjusted, and put back among all photographs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.oriented_subset import registered_block, with_all_photographs
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import IntArray
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=6, check_points=3)
OUT = [1, 6]


@cache
def whole() -> Block:
    """Eight photographs, two of them not registered."""
    block = simulate_block(PLAN, 2, tie_points=200, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3).block
    return replace(block, poses=tuple(None if i in OUT else pose for i, pose in enumerate(block.poses)))


@cache
def cut() -> tuple[Block, IntArray]:
    return registered_block(whole())


@cache
def adjusted() -> Adjustment:
    return adjust(cut()[0], AdjustmentSettings())


def by_name(block: Block) -> set[tuple[str, int, float, float]]:
    """Image points under names that do not change with the numbering."""
    tie = block.tie_points
    names = [block.photographs[i].name for i in tie.photograph]
    return set(zip(names, tie.feature.tolist(), tie.pixel[:, 0].tolist(), tie.pixel[:, 1].tolist(), strict=True))


def marks(block: Block) -> set[tuple[str, str, float, float]]:
    c = block.control_points
    photographs = [block.photographs[i].name for i in c.mark_photograph]
    points = [c.name[g] for g in c.mark_point]
    return set(zip(photographs, points, *c.mark_pixel.T.tolist(), strict=True))


def test_the_part_holds_the_registered_photographs_and_what_they_show() -> None:
    block, (part, kept) = whole(), cut()
    assert kept.tolist() == [0, 2, 3, 4, 5, 7]
    assert [p.name for p in part.photographs] == [block.photographs[i].name for i in kept]
    assert all(pose is block.poses[i] for pose, i in zip(part.poses, kept, strict=True))
    out = {block.photographs[i].name for i in OUT}
    assert marks(part) == {m for m in marks(block) if m[0] not in out}
    assert 0 < len(marks(part)) < len(marks(block))
    assert part.control_points.name == block.control_points.name
    assert part.frame is block.frame


def test_tie_points_of_the_part_have_two_rays_at_least() -> None:
    block, (part, kept) = whole(), cut()
    tie = part.tie_points
    assert tie.rays.min() >= 2
    assert tie.photograph.max() == len(kept) - 1
    seen = np.isin(block.tie_points.photograph, kept)
    rays = np.bincount(block.tie_points.point[seen], minlength=len(block.tie_points))
    assert len(tie) == np.count_nonzero(rays >= 2) < len(block.tie_points)
    wanted = seen & (rays[block.tie_points.point] >= 2)
    expected = replace(block, tie_points=block.tie_points.select(np.ones(len(block.tie_points), dtype=bool), wanted))
    assert by_name(part) == by_name(expected)
    np.testing.assert_array_equal(tie.position_world_m, block.tie_points.position_world_m[rays >= 2])


def test_a_block_that_is_wholly_registered_stays_as_it_is() -> None:
    block = simulate_block(PLAN, 2, tie_points=200).block
    part, kept = registered_block(block)
    assert kept.tolist() == list(range(8))
    assert by_name(part) == by_name(block)
    assert marks(part) == marks(block)
    np.testing.assert_array_equal(part.tie_points.point, block.tie_points.point)


def test_nothing_registered_leaves_nothing() -> None:
    part, kept = registered_block(replace(whole(), poses=(None,) * 8))
    assert len(kept) == len(part.photographs) == len(part.tie_points) == len(part.control_points.mark_photograph) == 0


def test_the_adjusted_part_goes_back_among_all_photographs() -> None:
    block, (_, kept), part = whole(), cut(), adjusted()
    result = with_all_photographs(part, block, kept)
    assert result.block.photographs is block.photographs
    assert [i for i, pose in enumerate(result.block.poses) if pose is None] == OUT
    for i, pose in zip(kept.tolist(), part.block.poses, strict=True):
        assert result.block.poses[i] is pose
    for name in ("position_m2", "rotation_rad2"):
        values = getattr(result.covariances, name)
        assert values.shape == (8, 3, 3)
        assert np.isnan(values[OUT]).all()
        np.testing.assert_array_equal(values[kept], getattr(part.covariances, name))
    assert by_name(result.block) == by_name(part.block)
    np.testing.assert_array_equal(result.estimates.residual_px, part.estimates.residual_px)
    assert [c.focal_px for c in result.block.cameras] == [c.focal_px for c in part.block.cameras]


def test_marks_keep_their_own_residuals() -> None:
    block, (_, kept), part = whole(), cut(), adjusted()
    result = with_all_photographs(part, block, kept)
    c = block.control_points
    assert marks(result.block) == marks(block)
    assert result.estimates.mark_residual_px.shape == (len(c.mark_photograph), 2)
    out = np.isin(c.mark_photograph, OUT)
    assert np.isnan(result.estimates.mark_residual_px[out]).all()
    np.testing.assert_array_equal(result.estimates.mark_residual_px[~out], part.estimates.mark_residual_px)
    assert np.nanmax(np.abs(result.estimates.mark_residual_px)) < 5.0


def test_cut_and_put_back_is_cut_again() -> None:
    """The round trip: the adjusted whole block, cut, is the adjusted part."""
    part, kept = adjusted(), cut()[1]
    again, index = registered_block(with_all_photographs(part, whole(), kept).block)
    np.testing.assert_array_equal(index, kept)
    assert by_name(again) == by_name(part.block)
    assert marks(again) == marks(part.block)
    for name in ("photograph", "point", "pixel", "position_world_m"):
        np.testing.assert_array_equal(getattr(again.tie_points, name), getattr(part.block.tie_points, name))


def test_adjusting_the_whole_block_adjusts_its_registered_part() -> None:
    block, part, kept = whole(), adjusted(), cut()[1]
    result = adjust(block, AdjustmentSettings())
    expected = with_all_photographs(part, block, kept)
    assert result.sigma0 == pytest.approx(part.sigma0, rel=1e-9)
    np.testing.assert_allclose(result.covariances.position_m2, expected.covariances.position_m2, rtol=1e-6)
    np.testing.assert_allclose(result.estimates.mark_residual_px, expected.estimates.mark_residual_px, atol=1e-9)
    np.testing.assert_array_equal(result.block.tie_points.photograph, expected.block.tie_points.photograph)
    assert [pose is None for pose in result.block.poses] == [pose is None for pose in expected.block.poses]
