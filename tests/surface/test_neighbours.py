"""Heights of weak texture combined with their neighbours, against noise that windows share as photographs' do."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import uniform_filter

from photogram.arrays import Float32Array, FloatArray
from photogram.surface.dense.neighbours import (
    BEND_STEPS,
    MOST_CELLS,
    OWN_SIGMA,
    WANTED_STEPS,
    combine_with_neighbours,
    combined_where_weak,
    independent_means,
    smoothed_where_weak,
)

SIGMA = 0.1


def shared_noise(seed: int, window: int, side: int = 300) -> FloatArray:
    """Return errors (side, side) of SIGMA, each the mean over a window of white noise."""
    white = np.random.default_rng(seed).normal(0.0, SIGMA * window, (side, side))
    return np.asarray(uniform_filter(white, window, mode="wrap"))


@pytest.mark.parametrize(("side", "window"), [(3, 7), (7, 7), (9, 5), (15, 4), (1, 6), (21, 1)])
def test_variance_of_a_mean_of_overlapping_windows(side: int, window: int) -> None:
    """400 000 cells: by far the most that it is off by is chance."""
    errors = np.concatenate([shared_noise(seed, window) for seed in range(5)])
    mean = uniform_filter(errors, side, mode="wrap")
    assert errors.var() / mean.var() == pytest.approx(independent_means(float(side), float(window)), rel=0.12)


@settings(max_examples=50)
@given(st.floats(1.0, 30.0), st.floats(1.0, 30.0))
def test_more_cells_never_make_it_worse(side: float, window: float) -> None:
    least = independent_means(side, window)
    assert least >= 1.0 - 1e-9
    assert independent_means(side + 1.0, window) >= least
    assert least <= side * side + 1e-6


def combined(
    z: Any, sigma: Any, window: float, wanted: float, slope: tuple[float, float] = (0.0, 0.0), most: int = 10
) -> tuple[Float32Array, Float32Array]:
    z, sigma = np.asarray(z, np.float32), np.asarray(sigma, np.float32)
    out, out_sigma = np.empty_like(z), np.empty_like(z)
    of = np.ascontiguousarray(np.broadcast_to(np.array(slope, np.float32), (*z.shape, 2)))
    combine_with_neighbours(z, sigma, of, np.full(z.shape, window, np.float32), wanted, most, out, out_sigma)
    return out, out_sigma


@pytest.mark.parametrize("window", [3, 5, 8])
@pytest.mark.parametrize("wanted", [0.02, 0.05, 0.08])
def test_sigma_of_a_combined_height_is_that_of_its_error(window: int, wanted: float) -> None:
    """On a tilted plane, whose slope is known."""
    row, column = np.mgrid[:300, :300]
    truth = 0.03 * column - 0.02 * row
    error = shared_noise(window, window)
    out, sigma = combined(truth + error, np.full(error.shape, SIGMA), window, wanted, (0.03, -0.02))
    inner = slice(12, -12), slice(12, -12)
    after = (out - truth)[inner]
    assert after.std() < 0.9 * error.std()
    assert after.std() == pytest.approx(float(np.sqrt(np.mean(sigma[inner] ** 2))), rel=0.2)
    reached = independent_means(21.0, float(window)) > (SIGMA / wanted) ** 2
    assert (np.median(sigma[inner]) <= 1.01 * wanted) == reached


def test_a_step_stays() -> None:
    z = np.where(np.arange(60) < 30, 0.0, 2.0) * np.ones((40, 1))
    out, sigma = combined(z, np.full(z.shape, SIGMA), 4.0, 0.03)
    assert np.abs(out - z).max() < 1e-6
    assert sigma[20, 29] > 1.2 * sigma[20, 10]  # it has half of the neighbours


def test_what_is_good_enough_and_what_is_textured_stays_to_the_bit() -> None:
    rng = np.random.default_rng(2)
    z, sigma = (rng.normal(size=(30, 30)).astype(np.float32) for _ in range(2))
    z[4, 5], sigma = np.nan, np.abs(sigma)
    out, out_sigma = combined(z, sigma, 5.0, 10.0)
    assert (out.tobytes(), out_sigma.tobytes()) == (z.tobytes(), sigma.tobytes())
    out, out_sigma = combined(z, sigma, 0.0, 1e-3)
    assert (out.tobytes(), out_sigma.tobytes()) == (z.tobytes(), sigma.tobytes())
    out, _ = combined(z, sigma, 5.0, 1e-3)
    assert np.array_equal(np.isnan(out), np.isnan(z))


def test_nothing_weak_is_returned_as_it_is() -> None:
    z, slope, none = np.zeros((8, 8), np.float32), np.zeros((8, 8, 2), np.float32), np.zeros((8, 8), bool)
    assert combined_where_weak(z, z, slope, np.zeros((8, 8)), np.ones((8, 8)), 0.1, 0.1)[0] is z
    assert smoothed_where_weak(z, slope, none, 0.1, 0.1)[0] is z


def test_weak_heights_alone_are_combined_and_their_sigma_is_larger() -> None:
    step_m = 0.2
    error = shared_noise(9, 6).astype(np.float32)
    weak = np.zeros(error.shape, bool)
    weak[:, :150] = True
    flat, sigma = np.zeros((*error.shape, 2), np.float32), np.full(error.shape, SIGMA / OWN_SIGMA, np.float32)
    out, out_sigma = combined_where_weak(error, sigma, flat, 4.0 * weak, np.full(error.shape, 6.0), step_m, 0.1)
    assert np.array_equal(out[:, 150:], error[:, 150:])
    assert np.array_equal(out_sigma[:, 150:], sigma[:, 150:])
    inner = slice(MOST_CELLS, -MOST_CELLS), slice(MOST_CELLS, 150 - MOST_CELLS)
    assert np.median(out_sigma[inner]) == pytest.approx(WANTED_STEPS * step_m, rel=0.3)
    assert out[inner].std() == pytest.approx(np.median(out_sigma[inner]), rel=0.3)


def test_sigma_of_weak_texture_grows_around_what_rises() -> None:
    """By the largest rise of what is combined and by the root of noise over texture, where texture is weak alone."""
    z, sigma, slope = np.zeros((60, 70), np.float32), np.full((60, 70), 0.01, np.float32), np.zeros((60, 70, 2))
    slope[30, 20] = 0.03, -0.04
    noise = np.where(np.arange(70) < 40, 4.0, 0.0) * np.ones((60, 1))
    noise[:, :10] = 1.0
    _, level = combined_where_weak(z, sigma, 0.0 * slope.astype(np.float32), noise, np.full(z.shape, 6.0), 0.2, 0.1)
    _, found = combined_where_weak(z, sigma, slope.astype(np.float32), noise, np.full(z.shape, 6.0), 0.2, 0.1)
    near = np.zeros(z.shape, bool)
    near[30 - MOST_CELLS : 31 + MOST_CELLS, 20 - MOST_CELLS : 21 + MOST_CELLS] = True
    assert np.array_equal(found[~near], level[~near])
    assert np.allclose(found[near], np.hypot(level, BEND_STEPS * 0.2 * 0.5 * np.sqrt(noise))[near], rtol=1e-4)
    assert np.array_equal(found[:, 40:], sigma[:, 40:])


def test_the_surface_of_weak_texture_is_smoother() -> None:
    row, column = np.mgrid[:60, :60]
    truth = (0.05 * column + 0.02 * row).astype(np.float32)
    noisy = (truth + np.random.default_rng(3).normal(0.0, 0.02, truth.shape)).astype(np.float32)
    weak = np.zeros(truth.shape, bool)
    weak[:, :30] = True
    smooth, slope = smoothed_where_weak(noisy, np.zeros((60, 60, 2), np.float32), weak, 0.2, 0.1)
    inner = slice(8, -8), slice(8, 24)
    assert (smooth - truth)[inner].std() < 0.3 * (noisy - truth)[inner].std()
    assert np.median(slope[inner][..., 0]) == pytest.approx(0.05, abs=0.005)
    assert np.array_equal(smooth[:, 30:], noisy[:, 30:])
    assert not slope[:, 30:].any()
