"""Heights that contradict a smooth surface around them: which go, and which stay."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import Float32Array
from photogram.surface.islands import OFF_PLANE_CELLS, REACH_CELLS, without_islands
from photogram.surface.levels import LevelSurface

CELL_M = 0.1
FAR_M = 2.0 * OFF_PLANE_CELLS * CELL_M
SIDE = 60
BOX = (slice(25, 35), slice(20, 40))


def plane(rows: int = SIDE, columns: int = SIDE, rise: float = 0.4) -> Float32Array:
    """Heights that rise to the south and fall to the east."""
    row, column = np.indices((rows, columns)) * CELL_M
    return np.asarray(100.0 + rise * row - 0.7 * rise * column, np.float32)


def surface(height_m: Float32Array, **layers: Any) -> LevelSurface:
    """A surface of the finest level on which all of five photographs agree, but for the layers that are given."""
    whole = np.ones(height_m.shape, np.uint8)
    given = {"rays": 5 * whole, "seen": 5 * whole, "cells": whole} | layers
    return LevelSurface(height_m, np.full_like(height_m, 0.02), np.full_like(height_m, 0.8), **given)


def with_box(
    off_m: float, agree: int, look: int, cells: int, ground: Float32Array | None = None, alike: float = 0.8
) -> LevelSurface:
    """A plane with a box that is off it, in which so many photographs agree of those that look, with a correlation."""
    height = plane() if ground is None else ground.copy()
    rays, seen, side = (np.full(height.shape, n, np.uint8) for n in (5, 5, 1))
    height[BOX] += np.float32(off_m)
    rays[BOX], seen[BOX], side[BOX] = agree, look, cells
    made = surface(height, rays=rays, seen=seen, cells=side)
    made.correlation[BOX] = alike
    return made


@pytest.mark.parametrize(
    ("off_m", "agree", "look", "cells", "alike", "stays"),
    [
        (-FAR_M, 3, 6, 4, 0.8, False),  # a pit
        (-FAR_M, 5, 5, 8, 0.8, False),  # nothing lies beneath smooth ground, whoever agrees on it in larger cells
        (-FAR_M, 2, 3, 1, 0.8, False),
        (FAR_M, 3, 6, 4, 0.8, True),  # a crown
        (FAR_M, 3, 6, 4, 0.7, False),  # asphalt: they correlate weakly
        (FAR_M, 4, 6, 1, 0.7, True),  # what two thirds tell is sure itself
        (FAR_M, 2, 3, 2, 0.8, False),  # two photographs
        (FAR_M, 3, 6, 1, 0.8, False),  # detail that the finest level took for one
        (FAR_M, 4, 6, 1, 0.8, True),
        (0.5 * OFF_PLANE_CELLS * CELL_M, 2, 4, 4, 0.7, True),  # near the plane
    ],
)
def test_what_goes_is_far_below_the_plane_or_far_above_it_and_doubtful(
    off_m: float, agree: int, look: int, cells: int, alike: float, stays: bool
) -> None:
    before = with_box(off_m, agree, look, cells, alike=alike)
    after = without_islands(before, CELL_M)
    inside = np.zeros(before.height_m.shape, bool)
    inside[BOX] = True
    assert np.isfinite(after.height_m[~inside]).all()
    assert np.isfinite(after.height_m[inside]).all() == stays
    assert np.isfinite(after.height_m[inside]).any() == stays
    gone = np.isnan(after.height_m)
    assert np.isnan(after.sigma_m[gone]).all()
    for name in ("correlation", "rays", "seen", "cells"):
        assert not getattr(after, name)[gone].any()
        np.testing.assert_array_equal(getattr(after, name)[~gone], getattr(before, name)[~gone])


def test_rough_ground_hardly_contradicts_its_own_heights() -> None:
    generator = np.random.default_rng(1)
    rough = plane() + generator.uniform(-2.0 * FAR_M, 2.0 * FAR_M, (SIDE, SIDE)).astype(np.float32)
    rays = np.where(generator.random((SIDE, SIDE)) < 0.3, 3, 5).astype(np.uint8)
    cells = np.where(rays == 3, 4, 1).astype(np.uint8)
    after = without_islands(surface(rough, rays=rays, cells=cells), CELL_M)
    assert np.isnan(after.height_m[rays == 3]).mean() < 0.02
    assert np.isfinite(after.height_m[rays == 5]).all()


def test_three_of_eight_directions_may_meet_something_else() -> None:
    ground = plane()
    ground[:, 40:] += np.float32(5.0 * FAR_M)  # a house to the east
    gone = np.isnan(without_islands(with_box(-FAR_M, 3, 6, 4, ground), CELL_M).height_m)
    assert gone[BOX].all()
    ground[35:] += np.float32(8.0 * FAR_M)  # a higher one to the south: four directions at most are left beside it
    gone = np.isnan(without_islands(with_box(-FAR_M, 3, 6, 4, ground), CELL_M).height_m)
    assert not gone[34].any()


def test_the_doubtful_edge_of_a_roof_is_held_by_the_roof() -> None:
    height, rays, seen = plane(rise=0.0), np.full((SIDE, SIDE), 5, np.uint8), np.full((SIDE, SIDE), 5, np.uint8)
    height[BOX] += np.float32(FAR_M)
    edge = np.zeros(height.shape, bool)
    edge[BOX] = True
    edge[26:34, 21:39] = False
    rays[edge], seen[edge] = 2, 4
    after = without_islands(surface(height, rays=rays, seen=seen), CELL_M)
    corners = np.zeros_like(edge)
    corners[np.ix_((25, 34), (20, 39))] = True  # of a corner the roof lies on one side alone
    np.testing.assert_array_equal(np.isnan(after.height_m), corners)


@settings(max_examples=10, deadline=None)
@given(row=st.integers(0, 40), column=st.integers(0, 40), seed=st.integers(0, 99))
def test_a_window_with_the_reach_around_it_finds_the_same(row: int, column: int, seed: int) -> None:
    side, generator = 2 * REACH_CELLS + 60, np.random.default_rng(seed)
    height = plane(side, side)
    rays = generator.integers(2, 6, height.shape).astype(np.uint8)
    cells = generator.choice(np.array([1, 1, 2, 8], np.uint8), height.shape)
    height[generator.random(height.shape) < 0.1] -= np.float32(FAR_M)
    height[generator.random(height.shape) < 0.3] = np.nan
    whole = surface(height, rays=rays, seen=np.full_like(rays, 5), cells=cells)
    expected = without_islands(whole, CELL_M).height_m
    window = (slice(row, row + 2 * REACH_CELLS + 20), slice(column, column + 2 * REACH_CELLS + 20))
    part = LevelSurface(**{name: layer[window].copy() for name, layer in vars(whole).items()})
    inside = slice(REACH_CELLS, REACH_CELLS + 20)
    found = without_islands(part, CELL_M).height_m[inside, inside]
    np.testing.assert_array_equal(found, expected[window][inside, inside])
    assert np.isnan(expected).sum() > np.isnan(height).sum()
