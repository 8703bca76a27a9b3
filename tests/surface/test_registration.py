"""How one band lies on another: shifts that were put in, of grey values turned round, and what says nothing."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from photogram.arrays import FloatArray
from photogram.grid import MapGrid
from photogram.surface.ortho.orthophoto import TILE_CELLS
from photogram.surface.ortho.registration import PATCH_CELLS, Registration, shift_of, shifts_in


def edges(seed: int = 1, size: int = 3 * PATCH_CELLS) -> FloatArray:
    """Return fields of several grey values, as roofs and roads have them, a little blurred."""
    rng = np.random.default_rng(seed)
    picture = np.full((size, size), 120.0)
    for _ in range(150):
        row, column = rng.integers(0, size, 2)
        height, width = rng.integers(8, 60, 2)
        picture[row : row + height, column : column + width] = rng.uniform(20.0, 230.0)
    return np.asarray(gaussian_filter(picture, 1.0))


def other_band(picture: FloatArray) -> FloatArray:
    """Return what another band makes of it: bright is dark, with noise of its own."""
    noise = np.random.default_rng(9).normal(0.0, 2.0, picture.shape)
    return np.asarray(np.clip(250.0 - 0.9 * picture + noise, 0.0, 255.0))


@pytest.mark.parametrize("east", [0.0, 0.3, -1.7, 4.25])
def test_the_shift_of_a_band_is_the_one_that_was_put_in(east: float) -> None:
    first, north = edges(), -0.6
    second = other_band(shift(first, (-north, east), order=3, mode="nearest"))
    shown = np.ones(first.shape, dtype=bool)
    found = shifts_in(first, second, shown)
    assert len(found) == 9
    np.testing.assert_allclose(found, np.tile([east, north], (9, 1)), atol=0.06)
    whole = Registration.of(found)
    assert whole.patches == 9
    np.testing.assert_allclose(whole.mean_cells, [east, north], atol=0.02)
    assert whole.rms_cells == pytest.approx(np.sqrt((east**2 + north**2) / 2.0), abs=0.02)


def test_only_patches_that_are_shown_whole_are_counted() -> None:
    first = edges()
    shown = np.ones(first.shape, dtype=bool)
    shown[10, 10] = False
    assert len(shifts_in(first, other_band(first), shown)) == 8
    assert shifts_in(first, other_band(first), np.zeros_like(shown)).shape == (0, 2)


def test_patches_without_edges_or_of_other_places_say_nothing() -> None:
    patch = edges(2, PATCH_CELLS)
    assert shift_of(patch, np.full_like(patch, 90.0)) is None
    flat = 90.0 + np.random.default_rng(2).normal(0.0, 0.5, patch.shape)
    assert shift_of(flat, other_band(flat) * 0.0 + flat) is None
    elsewhere = [shift_of(edges(s, PATCH_CELLS), other_band(edges(s + 50, PATCH_CELLS))) for s in range(20)]
    assert sum(found is not None for found in elsewhere) <= 2


def test_what_repeats_itself_says_nothing() -> None:
    """Rows of a crop match a row farther as well as their own place."""
    column = np.arange(PATCH_CELLS)
    rows = np.tile(120.0 + 80.0 * np.sin(2.0 * np.pi * column / 7.0), (PATCH_CELLS, 1))
    noise = np.random.default_rng(4).normal(0.0, 2.0, (2, *rows.shape))
    assert shift_of(rows + noise[0], np.roll(rows, 2, axis=1) + noise[1]) is None
    lone = edges(3, PATCH_CELLS)
    assert shift_of(lone, other_band(lone)) is not None


def test_a_shift_beyond_reach_is_none() -> None:
    first = edges(4, PATCH_CELLS + 40)
    assert shift_of(first[20:-20, 20:-20], first[20:-20, 2:-38]) is None
    found = shift_of(first[20:-20, 20:-20], first[20:-20, 12:-28])
    assert found is not None
    np.testing.assert_allclose(found, [8.0, 0.0], atol=0.06)


def test_without_patches_nothing_is_known() -> None:
    none = Registration.of(np.zeros((0, 2)))
    assert none.patches == 0
    assert np.isnan(none.rms_cells)


def test_tiles_of_an_orthophoto_begin_at_patches_and_cover_it_once() -> None:
    covered = np.zeros((700, 530), dtype=int)
    for window in MapGrid(0.0, 0.0, 0.1, 700, 530).tiles(TILE_CELLS):
        covered[window.slices] += 1
        assert window.row % PATCH_CELLS == window.column % PATCH_CELLS == 0
    assert np.all(covered == 1)
    assert [w.shape for w in MapGrid(0.0, 0.0, 0.1, 3, 2).tiles(TILE_CELLS)] == [(3, 2)]
