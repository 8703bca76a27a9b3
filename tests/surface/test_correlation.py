"""What the photographs say of a height: correlations against numpy, samples against scipy, costs on a known plane."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from photogram.surface.dense.correlation import (
    LEFT_OUT,
    LOOKED_UP,
    NEUTRAL,
    Window,
    agreement,
    fill_costs,
    grey_of_cells,
    look_up_row,
    normalise,
    sample,
    sample_square,
    share_of,
    window_at,
)
from photogram.surface.dense.pyramid import choose_views
from photogram.surface.views import places_in_view

STEP_M = 0.3
REACH = 6


def normalised(samples: NDArray[np.float64], noise: float) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    p = samples.astype(np.float32)
    return p, np.array([normalise(row, noise) for row in p])


def agreed(samples: NDArray[np.float64], least: int, noise: float = 0.0) -> tuple[float, list[int]]:
    """Return the score of the photographs that agree best, and which these are."""
    p, own = normalised(samples, noise)
    a = np.empty(len(p))
    score = agreement(p, own, least, np.empty(p.shape[1], np.float32), a)
    return score, np.flatnonzero(a > LEFT_OUT).tolist()


def photographs_alike(rng: np.random.Generator, count: int, n: int) -> NDArray[np.float64]:
    """Return samples (count, n) of one texture with unlike noise, gain and offset."""
    noise = rng.uniform(0.2, 3.0, (count, 1)) * rng.normal(size=(count, n))
    grey = rng.normal(size=n) + noise
    return np.asarray(rng.uniform(5.0, 30.0, (count, 1)) * grey + rng.uniform(20.0, 200.0, (count, 1)))


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.sampled_from([9, 25, 49]))
def test_the_score_is_the_mean_correlation_of_all_pairs(seed: int, count: int, n: int) -> None:
    samples = photographs_alike(np.random.default_rng(seed), count, n)
    score, used = agreed(samples, count)
    correlation = np.atleast_2d(np.corrcoef(samples))
    assert score == pytest.approx(np.mean([correlation[i, j] for i, j in combinations(range(count), 2)]), abs=2e-5)
    assert used == list(range(count))


@given(st.integers(0, 2**32 - 1), st.integers(3, 9), st.data())
def test_the_photograph_that_agrees_least_goes_first(seed: int, count: int, data: st.DataObject) -> None:
    samples = photographs_alike(np.random.default_rng(seed), count, 25)
    least = data.draw(st.integers(2, count))
    correlation = np.atleast_2d(np.corrcoef(samples))
    left = list(range(count))
    while len(left) > least:
        left.remove(min(left, key=lambda i: sum(correlation[i, j] for j in left if j != i)))
    score, used = agreed(samples, least)
    assert used == left
    assert score == pytest.approx(np.mean([correlation[i, j] for i, j in combinations(left, 2)]), abs=2e-5)


def test_where_there_is_little_but_noise_the_score_shrinks() -> None:
    """Samples of half the noise's variance correlate as if they had a third of their length."""
    texture = np.tile([-1.0, 1.0], 32)
    samples = 100.0 + 2.0 * np.stack([texture, texture, texture])
    assert agreed(samples, 3)[0] == pytest.approx(1.0, abs=1e-6)
    assert agreed(samples, 3, noise=2.0 * np.sqrt(2.0))[0] == pytest.approx(1.0 / 3.0, abs=1e-6)
    assert agreed(np.full((3, 64), 77.0), 3, noise=1.0)[0] == 0.0


@pytest.mark.parametrize(("count", "share", "least"), [(1, 0.5, 1), (2, 0.1, 2), (3, 0.5, 2), (5, 0.5, 3), (6, 1.0, 6)])
def test_two_photographs_at_least_must_agree(count: int, share: float, least: int) -> None:
    assert share_of(count, share) == least


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4))
def test_samples_are_bilinear(photographed_plane: Any, seed: int, half: int) -> None:
    rng = np.random.default_rng(seed)
    picture, crops = photographed_plane.pictures[3], photographed_plane.crops()
    height, width = picture.shape
    way = np.concatenate([rng.uniform(-5.0, [width + 5.0, height + 5.0]), rng.uniform(-1.5, 1.5, 4)])
    side = np.arange(-half, half + 1, dtype=np.float32)
    offset = np.column_stack([np.tile(side, len(side)), np.repeat(side, len(side))])
    out, square = (np.full(len(offset), np.nan, np.float32) for _ in range(2))
    crop = crops.pixels[crops.start[3] :]
    place = way[:2] + offset.astype(np.float64) @ way[2:].reshape(2, 2)
    # the middle and the corners decide; a hundredth of a pixel at the edge is left to rounding
    inside = bool((place > 0.01).all() and (place < [width - 1.01, height - 1.01]).all())
    assert sample(crop, (width, height), way, offset, half, out) == inside
    assert sample_square(crop, (width, height), way, half, square) == inside
    if inside:
        assert np.abs(out - square).max() < 0.02
        expected = map_coordinates(picture.astype(np.float64), place.T[::-1], order=1)
        assert np.abs(out - expected).max() < 0.02  # float32 places, 1e-5 px


def test_windows_lie_where_the_photographs_show_them(photographed_plane: Any) -> None:
    """Quadratic between three heights, 6 % of the flying height apart, against the projection itself."""
    plane, row, half_m = photographed_plane, 21, 1.2
    ground, count = plane.ground(), plane.grid.columns
    found, way = np.full((count, ground.views.shape[2], LOOKED_UP), np.nan), np.empty(6)
    middle = plane.height_m[row].copy()
    middle[5] = np.nan
    look_up_row(plane.crops(), ground, row, middle - half_m, middle + half_m, plane.tilt[row], found)
    assert np.isnan(found[5]).all()
    for column, i, t in ((0, 0, 0.0), (33, 1, -1.0), (50, 2, 0.4), (79, 0, 1.0), (60, 1, -0.7)):
        view = ground.views[row // plane.patch, column // plane.patch, i]
        window_at(found[column, i], t, way)
        foot, up = ground.foot[row, column], ground.up[row, column]
        east, south = plane.tilt[row, column].astype(float)
        h = middle[column] + t * half_m
        corners = [foot + h * up, foot + ground.east + (h + east) * up, foot + ground.south + (h + south) * up]
        exact = places_in_view(plane.views, view, np.array(corners))
        assert np.abs(way[:2] - exact[0]).max() < 0.005
        assert np.abs(way[2:4] - (exact[1] - exact[0])).max() < 0.002
        assert np.abs(way[4:] - (exact[2] - exact[0])).max() < 0.002


def costs(plane: Any, pictures: Any = None, noise: float = 1.5) -> NDArray[np.uint8]:
    """Return the costs (rows, columns, hypotheses) from REACH steps below the true height to as many above it."""
    rows, columns = plane.grid.rows, plane.grid.columns
    # a step of hypotheses is moved to the truth by moving the feet of the verticals
    ground = plane.ground()
    moved = ground._replace(foot=np.ascontiguousarray(ground.foot + plane.height_m[..., None] * ground.up))
    count = 2 * REACH + 1
    start = np.arange(rows * columns + 1, dtype=np.int64) * count
    cost = np.empty(start[-1], np.uint8)
    first = np.full(rows * columns, -REACH, np.int32)
    fill_costs(plane.crops(pictures), moved, Window(2, noise, 0.5), STEP_M, start, first, plane.tilt, cost)
    return cost.reshape(rows, columns, count)


def test_the_true_height_costs_least(photographed_plane: Any) -> None:
    cost = costs(photographed_plane)
    best = cost.argmin(axis=2) - REACH
    assert np.mean(np.abs(best) <= 1) > 0.99
    assert np.mean(best == 0) > 0.9
    assert np.median(cost[..., REACH]) < 0.1 * NEUTRAL
    assert np.median(cost[..., 0]) > 0.5 * NEUTRAL


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
    views = photographed_plane.ground().views
    alone = np.full_like(views, -1)
    alone[..., 0] = 2
    rows, columns = photographed_plane.grid.rows, photographed_plane.grid.columns
    start = np.arange(rows * columns + 1, dtype=np.int64)
    cost = np.zeros(start[-1], np.uint8)
    fill_costs(
        photographed_plane.crops(), photographed_plane.ground()._replace(views=alone), Window(2, 1.5, 0.5), STEP_M,
        start, np.zeros(len(cost), np.int32), photographed_plane.tilt, cost,
    )  # fmt: skip
    assert np.all(cost == NEUTRAL)


def test_cells_have_the_grey_of_the_straightest_photograph(photographed_plane: Any) -> None:
    plane = photographed_plane
    ground, guide = plane.ground(), np.empty(plane.height_m.shape, np.float32)
    grey_of_cells(plane.crops(), ground, plane.height_m.astype(np.float32), guide)
    place = ground.foot + plane.height_m[..., None] * ground.up
    for row, column in ((0, 0), (13, 60), (79, 79)):
        view = ground.views[row // plane.patch, column // plane.patch, 0]
        pixel = places_in_view(plane.views, view, place[row, column][None])[0]
        expected = map_coordinates(plane.pictures[view].astype(np.float64), pixel[::-1, None], order=1)
        assert guide[row, column] == pytest.approx(expected[0], abs=0.02)


def test_views_are_the_straightest_that_show_a_place(photographed_plane: Any) -> None:
    views = photographed_plane.views
    rng = np.random.default_rng(2)
    places = np.column_stack([rng.uniform(-30.0, 30.0, (400, 2)), rng.uniform(-3.0, 3.0, 400)])
    chosen, tangent = choose_views(views, places, 3)
    seen = np.stack([places_in_view(views, v, places) for v in range(len(views))], axis=1)
    inside = ((seen >= 0) & (seen <= views.size_px - 1)).all(axis=-1)
    away = views.position_world_m - places[:, None]
    lean = np.where(inside, np.hypot(away[..., 0], away[..., 1]) / away[..., 2], np.inf)
    expected = np.where(np.isfinite(np.sort(lean, axis=1)), np.argsort(lean, axis=1), -1)[:, :3]
    assert np.array_equal(chosen, expected)
    assert np.allclose(tangent, np.sort(lean, axis=1)[:, :3])
    assert 0 < np.mean(inside) < 1
    below = replace(views, cameras=views.cameras._replace(position=-views.position_world_m))
    assert np.all(choose_views(below, places, 2)[0] == -1)
