"""Rough places and shapes of targets, of rendered ones."""

import numpy as np
import pytest
from lib.target_pictures import render

from photogram.marking.targets.initial_values import (
    corner_initial_values,
    region_initial_values,
    regions,
    saddle_initial_values,
    saddles,
)
from photogram.marking.targets.picture import Pattern


@pytest.mark.parametrize("tilt", [0.0, 50.0])
def test_a_saddle_is_found_with_the_directions_of_its_edges(tilt: float) -> None:
    picture = render(np.random.default_rng(5), "checker disc", 24.0, tilt, 0.6, ground="asphalt")
    grey = picture.grey.astype(np.float64)
    near = [s for s in saddles(grey, 30) if np.hypot(*(s[0] - picture.centre_px)) < 1.5]
    starts = [start for centre, normals in near for start in saddle_initial_values(grey, centre, normals, (0.7,))]
    assert max(s.explained for s in starts if s.pattern == Pattern.DISC_OF_QUADRANTS) > 0.7


def test_saddles_beyond_the_reach_are_left_out() -> None:
    picture = render(np.random.default_rng(5), "chequered", 24.0, 10.0, 0.6)
    grey = picture.grey.astype(np.float64)
    assert len(saddles(grey, 30)) > len(saddles(grey, 30, picture.centre_px, 5.0)) > 0
    assert all(np.hypot(*(s[0] - picture.centre_px)) <= 5.0 for s in saddles(grey, 30, picture.centre_px, 5.0))


@pytest.mark.parametrize(
    ("shape", "pattern"),
    [("circle", Pattern.CIRCLE), ("ring", Pattern.RING), ("cross", Pattern.OPEN_CROSS)],  # its bars end with the board
)
def test_a_region_is_taken_for_what_it_is(shape: str, pattern: Pattern) -> None:
    picture = render(np.random.default_rng(6), shape, 26.0, 30.0, 0.6, ground="asphalt")
    grey = picture.grey.astype(np.float64)
    starts = [s for region in regions(grey, picture.centre_px, 5.0) for s in region_initial_values(grey, region)]
    off = [np.hypot(*(s.theta[:2] - picture.centre_px)) for s in starts if s.pattern == pattern and s.explained > 0.7]
    assert min(off) < 1.5


def test_bars_that_go_on_start_at_their_outer_corner() -> None:
    grey = np.full((60, 60), 80.0)
    grey[30:33, 30:] = 200.0
    grey[30:, 30:33] = 200.0
    starts = [s for s in corner_initial_values(grey, np.array([32.0, 28.0]), 8.0) if s.pattern == Pattern.OPEN_CORNER]
    best = max(starts, key=lambda s: s.promise)
    assert np.hypot(*(best.theta[:2] - 29.5)) < 2.0


def test_an_empty_patch_has_nothing() -> None:
    grey = np.full((50, 50), 100.0)
    assert saddles(grey, 10) == []
    assert regions(grey) == []
    assert corner_initial_values(grey, np.array([25.0, 25.0]), 8.0) == []


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5, -0.4])
def test_a_saddle_between_pixels_is_found_to_a_fraction_of_one(shift: float) -> None:
    v, u = np.mgrid[:40, :40] - 20.0
    grey = 100.0 + 60.0 * np.tanh(0.3 * (u - shift)) * np.tanh(0.3 * (v + shift))
    centre, _ = saddles(grey, 1)[0]
    np.testing.assert_allclose(centre, [20.0 + shift, 20.0 - shift], atol=0.1)
