"""Targets taken for ground points, in simulated surveys that show them at their true places, and others beside."""

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated, without_marks

from photogram.arrays import FloatArray
from photogram.camera import project_points
from photogram.errors import AdjustmentError
from photogram.marking.assignment import SURE_PX, DetectedCentres, Pair, assigned_targets, with_targets
from photogram.marking.predictions import predicted_places
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block

WIDE = replace(whole_survey_plan(), control_points=12, check_points=4, mark_sigma_px=0.1, heading_error_deg=4.0)
"""Positions good to 2 m, attitudes to 1°, and a compass 4° off: every ellipse holds several targets."""
NARROW = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=3, mark_sigma_px=0.1)
"""Held together by tie points."""
SIGMA_PX = 0.1


@pytest.fixture(scope="module")
def wide() -> SimulatedBlock:
    return simulate_block(WIDE, 1)


@pytest.fixture(scope="module")
def narrow() -> SimulatedBlock:
    return simulated(NARROW, tie_points=150)


def true_places(made: SimulatedBlock) -> dict[Pair, FloatArray]:
    """Where the photographs show the points, by point and photograph."""
    places: dict[Pair, FloatArray] = {}
    for i, pose in enumerate(made.truth.poses):
        pixel = project_points(made.truth.camera, pose, made.truth.control_position_world_m)
        inside = made.truth.camera.contains(pixel)
        places |= {(g, i): pixel[g] for g in np.flatnonzero(inside).tolist()}
    return places


def targets(shown: dict[Pair, FloatArray], decoys: list[tuple[int, FloatArray]] | None = None) -> DetectedCentres:
    """Targets with noise at these places, in their order, and decoys (photograph and place) after them."""
    decoys = decoys or []
    noise = SIGMA_PX * np.random.default_rng(5).standard_normal((len(shown), 2))
    pixel = np.array([*shown.values()]).reshape(-1, 2) + noise
    photograph = [i for _, i in shown] + [i for i, _ in decoys]
    beside = np.array([place for _, place in decoys]).reshape(-1, 2)
    return DetectedCentres(
        np.array(photograph, dtype=np.int64), np.vstack([pixel, beside]), np.full(len(photograph), SIGMA_PX)
    )


def decoys_of(made: SimulatedBlock, each: int, apart_px: float = 40.0) -> list[tuple[int, FloatArray]]:
    """Targets that are no ground points, anywhere but near to one that is."""
    rng, true, camera = np.random.default_rng(7), true_places(made), made.truth.camera
    found = []
    for i in range(len(made.truth.poses)):
        own = np.array([place for (_, there), place in true.items() if there == i]).reshape(-1, 2)
        drawn = rng.uniform(0.0, [camera.width_px, camera.height_px], (100 * each, 2))
        far = [p for p in drawn if not len(own) or np.linalg.norm(own - p, axis=1).min() > apart_px]
        found += [(i, place) for place in far[:each]]
    return found


def with_marks_of(made: SimulatedBlock, pairs: set[Pair]) -> Block:
    """The block of a survey with its marks of these points and photographs alone."""
    p = made.block.control_points
    keep = [
        m for m, pair in enumerate(zip(p.mark_point.tolist(), p.mark_photograph.tolist(), strict=True)) if pair in pairs
    ]
    few = replace(
        p,
        mark_photograph=p.mark_photograph[keep],
        mark_point=p.mark_point[keep],
        mark_pixel=p.mark_pixel[keep],
        mark_covariance_px2=p.mark_covariance_px2[keep],
    )
    return replace(made.block, control_points=few)


def marks_made(made: SimulatedBlock) -> list[Pair]:
    p = made.block.control_points
    return list(zip(p.mark_point.tolist(), p.mark_photograph.tolist(), strict=True))


@pytest.mark.parametrize("seed", [1, 2])
def test_targets_are_taken_for_their_points_and_decoys_are_not(seed: int) -> None:
    """From tags alone, in all photographs though few of them fit before the others tell the compass."""
    made = simulate_block(WIDE, seed)
    true = true_places(made)
    block = tagged_block(without_marks(made.block))
    found = targets(true, decoys_of(made, 1))
    assert np.median(predicted_places(block).radius_px) > SURE_PX
    assignment = assigned_targets(block, found)
    right = {pair: k for k, pair in enumerate(true)}
    wrong = [pair for pair, k in assignment.target.items() if right.get(pair) != k]
    assert len(wrong) <= 1
    assert len(assignment.target) > 0.9 * len(true)
    assert len(set(assignment.target.values())) == len(assignment.target)
    assert assignment.comparison is not None


def test_narrow_ellipses_need_no_pattern(narrow: SimulatedBlock) -> None:
    """Two targets a photograph are too few to be laid over its places together."""
    block = without_marks(narrow.block)
    assert predicted_places(block).radius_px.max() < SURE_PX
    true = true_places(narrow)
    few: dict[Pair, FloatArray] = {}
    for pair, place in true.items():
        if sum(i == pair[1] for _, i in few) < 2:
            few[pair] = place
    found = targets(few, decoys_of(narrow, 2, apart_px=150.0))
    assert dict(assigned_targets(block, found).target) == {pair: k for k, pair in enumerate(few)}


def test_marked_and_hidden_ones_are_left_alone(narrow: SimulatedBlock) -> None:
    true = true_places(narrow)
    marked, hidden = set(marks_made(narrow)[::4]), frozenset(marks_made(narrow)[2::4])
    assert marked
    assert hidden
    block = with_marks_of(narrow, marked)
    assignment = assigned_targets(block, targets(true), hidden)
    assert not set(assignment.target) & (marked | hidden)
    right = {pair: k for k, pair in enumerate(true)}
    assert all(right[pair] == k for pair, k in assignment.target.items())
    assert set(assignment.target) == set(true) - marked - hidden


def test_a_wide_ellipse_with_two_targets_alone_assigns_none(wide: SimulatedBlock) -> None:
    block = tagged_block(without_marks(wide.block))
    places = predicted_places(block)
    k = int(np.argmax(places.radius_px * places.inside))
    i = int(places.photograph[k])
    two = DetectedCentres(
        np.array([i, i], dtype=np.int64), places.pixel[k] + [[-8.0, 0.0], [8.0, 3.0]], np.full(2, SIGMA_PX)
    )
    assert not assigned_targets(block, two).target


def test_a_narrow_ellipse_with_two_targets_assigns_none(narrow: SimulatedBlock) -> None:
    block = without_marks(narrow.block)
    (pair, place), *_ = true_places(narrow).items()
    alone = targets({pair: place})
    assert dict(assigned_targets(block, alone).target) == {pair: 0}
    both = targets({pair: place}, [(pair[1], place + np.array([4.0, -3.0]))])
    assert not assigned_targets(block, both).target


def test_a_target_that_contradicts_the_marks_is_not_taken(narrow: SimulatedBlock) -> None:
    """The place of a point that many marks tell leaves no room for a target 8 px beside it."""
    true, made = true_places(narrow), marks_made(narrow)
    pair = next(pair for pair in made if sum(g == pair[0] for g, _ in made) >= 4)
    block = with_marks_of(narrow, set(made) - {pair})
    assert dict(assigned_targets(block, targets({pair: true[pair]})).target) == {pair: 0}
    assert not assigned_targets(block, targets({pair: true[pair] + [8.0, 0.0]})).target


def test_nothing_found_assigns_nothing(narrow: SimulatedBlock) -> None:
    for block in (without_marks(narrow.block), narrow.block):
        assert not assigned_targets(block, targets({})).target


def test_targets_become_marks_of_their_points(narrow: SimulatedBlock) -> None:
    true, block = true_places(narrow), narrow.block
    found, (first, second, *_) = targets(true), list(true)
    before, after = block.control_points, with_targets(block, found, {second: 1, first: 0}).control_points
    n = len(before.mark_point)
    np.testing.assert_array_equal(after.mark_pixel[:n], before.mark_pixel)
    added = list(zip(after.mark_point[n:].tolist(), after.mark_photograph[n:].tolist(), strict=True))
    assert added == sorted([first, second])
    number = {first: 0, second: 1}
    np.testing.assert_array_equal(after.mark_pixel[n:], found.pixel[[number[pair] for pair in added]])
    np.testing.assert_array_equal(after.mark_sigma_px[n:], [SIGMA_PX, SIGMA_PX])
    assert len(with_targets(block, found, {}).control_points.mark_point) == n


def test_a_block_that_is_not_determined_is_refused(narrow: SimulatedBlock) -> None:
    lost = replace(narrow.block, poses=tuple(None for _ in narrow.block.poses))
    with pytest.raises(AdjustmentError):
        assigned_targets(lost, targets(true_places(narrow)))
