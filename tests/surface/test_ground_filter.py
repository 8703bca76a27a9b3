"""On made ground with known objects: simulated."""

import numpy as np
import pytest

from photogram.surface.ground_filter import on_ground

SIDE_M, CELLS = 0.5, 200
ROW, COLUMN = np.indices((CELLS, CELLS)) * SIDE_M


def noisy(heights: np.ndarray, seed: int = 1) -> np.ndarray:
    return heights + np.random.default_rng(seed).normal(0.0, 0.05, heights.shape)


@pytest.mark.parametrize("slope_deg", [0.0, 15.0, 30.0, 40.0])
def test_bare_slopes_with_hills_are_ground(slope_deg: float) -> None:
    hills = 3.0 * np.sin(ROW / 9.0) * np.sin(COLUMN / 11.0)
    assert on_ground(noisy(np.tan(np.radians(slope_deg)) * COLUMN + hills), SIDE_M).mean() > 0.99


@pytest.mark.parametrize("slope_deg", [0.0, 20.0])
def test_roofs_of_all_sizes_are_objects(slope_deg: float) -> None:
    ground = np.tan(np.radians(slope_deg)) * COLUMN
    objects = np.zeros(ground.shape, dtype=bool)
    for row, column, wide in ((10, 10, 40.0), (10, 70, 12.0), (60, 10, 8.0), (70, 60, 4.0)):
        objects |= (np.abs(ROW - row - wide / 2) < wide / 2) & (np.abs(COLUMN - column - wide / 2) < wide / 2)
    surface = noisy(np.where(objects, ground + 6.0, ground))
    found = on_ground(surface, SIDE_M)
    assert found[objects].mean() < 0.01
    assert found[~objects].mean() > 0.98


def test_a_heap_and_a_stair_of_terraces_are_ground() -> None:
    heap = np.clip(6.0 - 0.75 * np.hypot(ROW - 75, COLUMN - 50), 0.0, None)
    terraces = 2.0 * np.floor(np.clip(60.0 - ROW, 0.0, None) / 10.0)
    assert on_ground(noisy(heap + terraces), SIDE_M).mean() > 0.98


def test_a_deck_between_two_dams_is_an_object() -> None:
    valley = (COLUMN > 35) & (COLUMN < 65)
    road = np.abs(ROW - 50) < 4.5
    ground = np.where(valley, -6.0, 0.0)
    found = on_ground(noisy(np.where(road, 0.0, ground)), SIDE_M)
    middle = road & (np.abs(COLUMN - 50) < 12)
    assert found[middle].mean() < 0.05
    assert found[~(road & valley)].mean() > 0.97


def test_ground_between_crowns_on_a_slope_is_found() -> None:
    rng = np.random.default_rng(3)
    slope = 0.4 * COLUMN
    crowns = np.zeros(slope.shape)
    for row, column in rng.uniform(0, CELLS * SIDE_M, (700, 2)):
        near = np.hypot(ROW - row, COLUMN - column) / 3.0
        crowns = np.maximum(crowns, np.where(near < 1, 4.0 + 8.0 * np.sqrt(np.maximum(1 - near**2, 0)), 0.0))
    bare = crowns == 0
    assert 0.05 < bare.mean() < 0.2
    found = on_ground(noisy(slope + crowns), SIDE_M)
    assert found[bare].mean() > 0.95
    assert found[~bare].mean() < 0.01


def test_holes_are_no_ground_and_nothing_is_no_ground() -> None:
    heights = noisy(np.zeros(ROW.shape))
    heights[50:60, 50:60] = np.nan
    found = on_ground(heights, SIDE_M)
    assert not found[50:60, 50:60].any()
    assert found[np.isfinite(heights)].all()
    assert not on_ground(np.full((9, 9), np.nan), SIDE_M).any()
