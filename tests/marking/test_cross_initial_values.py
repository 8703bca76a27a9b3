"""Rough places and shapes of crosses, of rendered ones."""

import numpy as np
import pytest
from lib.target_pictures import render

from photogram.marking.targets.cross_initial_values import cross_initial_values, middles
from photogram.marking.targets.picture import Pattern, box


@pytest.mark.parametrize("tilt", [0.0, 50.0])
@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_a_cross_is_found_on_its_board_and_painted(seed: int, tilt: float) -> None:
    picture = render(np.random.default_rng(seed), "cross", 30.0, tilt, 0.8, ground="asphalt")
    grey = picture.grey.astype(np.float64)
    starts = cross_initial_values(grey, picture.centre_px + np.array([2.0, -1.0]), 6.0)
    off = [np.hypot(*(s.theta[:2] - picture.centre_px)) for s in starts if s.explained > 0.6]
    assert min(off) < 1.2


def test_the_middle_of_a_figure_is_where_half_a_turn_changes_nothing() -> None:
    v, u = np.mgrid[:60, :60].astype(np.float64)
    grey = 100.0 + 80.0 * ((np.abs(u - 31.0) < 3) | (np.abs(v - 27.0) < 3))
    found = middles(grey.astype(np.float32), np.array([28.0, 29.0]), 8.0, 6.0)
    assert np.hypot(*(found[0] - [31.0, 27.0])) <= 1.0


def test_level_ground_and_the_edge_of_the_patch_have_none() -> None:
    grey = np.full((50, 50), 100.0)
    assert cross_initial_values(grey, np.array([25.0, 25.0]), 8.0) == []
    assert cross_initial_values(grey, np.array([0.0, 0.0]), 8.0) == []


def test_parameters_of_starts_can_be_drawn() -> None:
    picture = render(np.random.default_rng(9), "cross", 24.0, 20.0, 0.8, ground="asphalt")
    for start in cross_initial_values(picture.grey.astype(np.float64), picture.centre_px, 5.0):
        rows, columns = picture.grey.shape
        left, _, right, _ = box(int(start.pattern), start.theta, rows, columns, start.reach)
        assert right > left
        assert start.pattern in (Pattern.OPEN_CROSS, Pattern.CROSS, Pattern.CROSSED_SQUARE)
