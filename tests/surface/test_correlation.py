"""What the photographs say of a height: who agrees, against a slow second way, and costs on a known plane."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from patch_windows import same_windows

from photogram.arrays import ByteArray
from photogram.surface.dense.correlation import (
    LEFT_OUT,
    NEUTRAL,
    Hypotheses,
    fill_agreement,
    fill_costs,
    leave_out_hidden,
    scratch_for_agreement,
    share_of,
)
from photogram.surface.dense.lattice import NOTHING_HIDDEN, CellWindow, GroundCells

STEP_M = 0.3
REACH = 6


def agreed(pairs: NDArray[Any], share: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the scores (n,) of the photographs that agree best, and which these are (K, n)."""
    count, _, n = pairs.shape
    found = scratch_for_agreement(count, n + 5)
    fill_agreement(np.ascontiguousarray(pairs, np.float32), share, found)
    return found.score[:n].copy(), found.sums[:, :n] > LEFT_OUT


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.sampled_from([0.3, 0.5, 0.75, 1.0]))
def test_the_photograph_that_agrees_least_goes_first(seed: int, count: int, share: float) -> None:
    """And the score is the mean correlation of all pairs of the others."""
    rng = np.random.default_rng(seed)
    texture = rng.normal(size=(25, 7)) + rng.uniform(0.2, 3.0, (count, 1, 1)) * rng.normal(size=(count, 25, 7))
    pairs = np.stack([np.atleast_2d(np.corrcoef(texture[..., n])) for n in range(7)], axis=-1)
    hidden = rng.random((count, 7)) < 0.2
    for n in range(7):
        pairs[hidden[:, n], :, n] = pairs[:, hidden[:, n], n] = 0.0
        pairs[hidden[:, n], hidden[:, n], n] = np.nan
    score, used = agreed(pairs, share)
    for n in range(7):
        left = np.flatnonzero(~hidden[:, n]).tolist()
        least = share_of(len(left), share)
        if len(left) < 2:
            assert score[n] == -1.0
            continue
        while len(left) > least:
            left.remove(min(left, key=lambda i: sum(pairs[i, j, n] for j in left if j != i)))
        assert np.flatnonzero(used[:, n]).tolist() == left
        expected = np.mean([pairs[i, j, n] for i, j in combinations(left, 2)])
        assert score[n] == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(("count", "share", "least"), [(1, 0.5, 1), (2, 0.1, 2), (3, 0.5, 2), (5, 0.5, 3), (6, 1.0, 6)])
def test_two_photographs_at_least_must_agree(count: int, share: float, least: int) -> None:
    assert share_of(count, share) == least


def costs(plane: Any, pictures: Any = None, noise: float = 1.5, ground: GroundCells | None = None) -> ByteArray:
    """Return the costs (rows, columns, hypotheses) from REACH steps below the true height to as many above it."""
    rows, columns = plane.grid.rows, plane.grid.columns
    count = 2 * REACH + 1
    start = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns) * count
    cost = np.empty(start.size * count, np.uint8)
    first, counts = np.full(start.shape, -REACH, np.int32), np.full(start.shape, count)
    tried = Hypotheses(plane.height_m.astype(np.float32), STEP_M, first, counts, start)
    looked_up = plane.ground() if ground is None else ground
    fill_costs(plane.crops(pictures), looked_up, same_windows(looked_up, 2, noise, 0.5), tried, cost)
    return cost.reshape(rows, columns, count)


def test_the_true_height_costs_least(photographed_plane: Any) -> None:
    cost = costs(photographed_plane)
    best = cost.argmin(axis=2) - REACH
    assert np.mean(np.abs(best) <= 1) > 0.99
    assert np.mean(best == 0) > 0.9
    assert np.median(cost[..., REACH]) < 0.1 * NEUTRAL
    assert np.median(cost[..., 0]) > 0.5 * NEUTRAL


def test_costs_do_not_depend_on_what_else_is_asked_for(photographed_plane: Any) -> None:
    """Some hypotheses of some cells cost what they cost among all; rounding may move a cost by one."""
    plane, all_of_them = photographed_plane, costs(photographed_plane).astype(int)
    rng = np.random.default_rng(7)
    shape = plane.height_m.shape
    first = rng.integers(-REACH, 3, shape).astype(np.int32)
    count = np.where(rng.random(shape) < 0.3, rng.integers(0, 5, shape), 0)
    count[:20] = 0
    ends = np.cumsum(count.ravel())
    cost = np.full(ends[-1], 255, np.uint8)
    start = (ends - count.ravel()).reshape(shape)
    tried = Hypotheses(plane.height_m.astype(np.float32), STEP_M, first, count, start)
    fill_costs(plane.crops(), plane.ground(), same_windows(plane.ground(), 2, 1.5, 0.5), tried, cost)
    cell = np.repeat(np.arange(count.size), count.ravel())
    k = np.arange(len(cost)) - (ends - count.ravel())[cell] + first.ravel()[cell]
    expected = all_of_them.reshape(-1, 2 * REACH + 1)[cell, k + REACH]
    assert np.abs(cost.astype(int) - expected).max() <= 1


def test_gain_and_offset_of_a_photograph_change_nothing(photographed_plane: Any) -> None:
    pictures = list(photographed_plane.pictures)
    expected = costs(photographed_plane, noise=1e-3).astype(int)
    pictures[1] = 0.5 * pictures[1] + 60.0
    pictures[4] = 1.7 * pictures[4] - 30.0
    found = costs(photographed_plane, pictures, noise=1e-3).astype(int)
    assert np.abs(found - expected).max() <= 1  # a cost is a whole number


def test_a_photograph_of_something_else_is_left_out(photographed_plane: Any) -> None:
    pictures = list(photographed_plane.pictures)
    pictures[2] = np.ascontiguousarray(pictures[2][::-1, ::-1])
    cost = costs(photographed_plane, pictures)
    assert np.mean(np.abs(cost.argmin(axis=2) - REACH) <= 1) > 0.97
    assert np.median(cost[..., REACH]) < 0.1 * NEUTRAL


def test_what_fewer_than_two_photographs_show_is_neutral(photographed_plane: Any) -> None:
    plane = photographed_plane
    alone = np.full_like(plane.ground().views, -1)
    alone[..., 0] = 2
    start = np.arange(plane.height_m.size, dtype=np.int64).reshape(plane.height_m.shape)
    cost = np.zeros(start.size, np.uint8)
    first, count = np.zeros(start.shape, np.int32), np.ones(start.shape, np.int64)
    tried = Hypotheses(plane.height_m.astype(np.float32), STEP_M, first, count, start)
    ground = plane.ground()._replace(views=alone)
    fill_costs(plane.crops(), ground, same_windows(ground, 2, 1.5, 0.5), tried, cost)
    assert np.all(cost == NEUTRAL)


def cells_without(views: NDArray[np.int64], hidden: NDArray[np.bool_], patch: int) -> GroundCells:
    """Return cells of which only the views and what these do not see count."""
    nothing, step = np.zeros((*hidden.shape[:2], 3)), np.zeros(3)
    return GroundCells(nothing, nothing, step, step, 1, views, patch, hidden)


@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.sampled_from([0.3, 0.5, 1.0]))
def test_a_view_that_does_not_see_a_cell_has_no_part_in_it(seed: int, count: int, share: float) -> None:
    """What is left is what the others say without it, whatever places in the list of a patch are empty."""
    rng = np.random.default_rng(seed)
    slots = np.sort(rng.choice(8, count, replace=False))
    views = np.full((2, 2, 8), -1)
    views[..., slots] = rng.permutation(20)[:count]
    box, width, more = CellWindow(5, 9, 3, 4), 6, 2
    hidden = rng.random((10, 16, 8)) < 0.3
    pairs = rng.uniform(-1.0, 1.0, (count, count, box.rows * width + more)).astype(np.float32)
    pairs = np.ascontiguousarray((pairs + pairs.swapaxes(0, 1)) / 2)
    found = pairs.copy()
    leave_out_hidden(cells_without(views, hidden, 5), box, width, found)
    for r in range(box.rows):
        for c in range(width):
            n = r * width + c
            if c >= box.columns:
                assert np.array_equal(found[..., n], pairs[..., n])
                continue
            sees = np.flatnonzero(~hidden[box.row + r, box.column + c, slots])
            kept = np.ix_(sees, sees)
            assert np.array_equal(found[..., n][kept], pairs[..., n][kept])
            score, used = agreed(found[..., n : n + 1], share)
            assert not used[np.setdiff1d(np.arange(count), sees), 0].any()
            if len(sees) < 2:
                assert score[0] == -1.0
                continue
            expected, also = agreed(pairs[..., n : n + 1][kept], share)
            assert score[0] == pytest.approx(expected[0], abs=1e-6)
            assert np.array_equal(used[sees, 0], also[:, 0])


def test_nothing_hidden_changes_no_pair() -> None:
    pairs = np.random.default_rng(3).random((3, 3, 20)).astype(np.float32)
    found = pairs.copy()
    leave_out_hidden(cells_without(np.zeros((2, 2, 3), np.int64), NOTHING_HIDDEN, 5), CellWindow(0, 0, 4, 5), 5, found)
    assert np.array_equal(found, pairs)


@pytest.mark.parametrize("left_out", [0, 2, 4])
def test_costs_without_a_view_that_is_hidden(photographed_plane: Any, left_out: int) -> None:
    """On half of the cells, those that it would have without it in its list; on the others, as if nothing were."""
    plane, whole = photographed_plane, costs(photographed_plane)
    ground = plane.ground()
    fewer = np.where(ground.views == left_out, -1, ground.views)
    hidden = np.zeros((*plane.height_m.shape, ground.views.shape[2]), bool)
    of_cells = ground.views.repeat(ground.patch, axis=0).repeat(ground.patch, axis=1)
    hidden[:, 30:] = (of_cells == left_out)[: hidden.shape[0], 30 : hidden.shape[1]]
    assert hidden.any()
    found = costs(plane, ground=ground._replace(hidden=hidden))
    without = costs(plane, ground=ground._replace(views=fewer))
    assert np.array_equal(found[:, :30], whole[:, :30])
    assert np.abs(found[:, 30:].astype(int) - without[:, 30:]).max() <= 1  # of what is rounded
    assert np.mean(found[:, 30:] != whole[:, 30:]) > 0.3
