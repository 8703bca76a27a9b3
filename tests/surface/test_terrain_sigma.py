"""On ground with known roughness: simulated."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from photogram.surface.dtm import linear_between
from photogram.surface.terrain_sigma import fitted, interpolated_sigma, own_variance, roughness

SIDE_M = 0.5


def ground_of(seed: int, smooth_cells: float, rms_m: float) -> np.ndarray:
    heights = gaussian_filter(np.random.default_rng(seed).normal(size=(240, 240)), smooth_cells)
    return np.asarray(rms_m * heights / heights.std())


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_the_law_of_the_variance_is_found_again(exponent: float) -> None:
    rng = np.random.default_rng(1)
    distance, rough = rng.uniform(0.5, 10.0, 40_000), rng.uniform(0.5, 3.0, 40_000)
    own = 0.01
    error = rng.normal(0.0, np.sqrt(own + 0.02 + 0.03 * rough * distance**exponent))
    a, b, c = fitted(distance, rough, error, own)
    for at in (1.0, 3.0, 9.0):
        assert a + b * at**c == pytest.approx(0.02 + 0.03 * at**exponent, rel=0.15)


@pytest.mark.parametrize("smooth_cells", [4.0, 10.0])
def test_errors_below_houses_are_as_large_as_stated(smooth_cells: float) -> None:
    ratios = []
    for seed in range(3):
        truth = ground_of(seed, smooth_cells, 0.5)
        heights = truth + np.random.default_rng(seed + 9).normal(0.0, 0.02, truth.shape)
        ground = np.ones(truth.shape, dtype=bool)
        for row, column in np.random.default_rng(seed).integers(0, 210, (25, 2)):
            ground[row : row + 18, column : column + 24] = False
        sigma = interpolated_sigma(heights, ground, SIDE_M, linear_between)
        ratios.append(((linear_between(heights, ground) - truth) / sigma)[~ground])
    assert 0.75 < np.sqrt(np.mean(np.concatenate(ratios) ** 2)) < 1.25


def test_sigma_grows_with_the_distance_and_beside_rough_ground() -> None:
    heights = ground_of(1, 3.0, 0.3)
    heights[:, 120:] *= 5.0
    ground = np.ones(heights.shape, dtype=bool)
    ground[100:130, 30:60] = ground[100:130, 180:210] = False
    rough = roughness(heights, ground, SIDE_M, linear_between)
    assert rough[:, 180:].mean() > 3 * rough[:, :60].mean()
    sigma = interpolated_sigma(heights, ground, SIDE_M, linear_between)
    assert sigma[115, 45] > 1.5 * sigma[101, 45]
    assert sigma[115, 195] > 1.5 * sigma[115, 45]


def test_noise_of_single_heights_is_told_from_the_ground() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.1, (240, 240))
    ground = np.ones(noise.shape, dtype=bool)
    assert own_variance(ground_of(1, 20.0, 1.0) + noise, ground) == pytest.approx(0.01, rel=0.1)


def test_too_little_ground_says_so_by_a_wide_sigma() -> None:
    ground = np.zeros((20, 20), dtype=bool)
    ground[:2, :2] = True
    sigma = interpolated_sigma(np.full((20, 20), 5.0), ground, SIDE_M, linear_between)
    assert (sigma == SIDE_M).all()


def test_ground_that_is_seen_in_single_cells_has_true_sigmas_too() -> None:
    truth = ground_of(1, 10.0, 0.5)
    heights, ground = truth + np.random.default_rng(3).normal(0.0, 0.02, truth.shape), np.zeros(truth.shape, bool)
    ground[::4, ::4] = True
    sigma = interpolated_sigma(np.where(ground, heights, np.nan), ground, SIDE_M, linear_between)
    error = linear_between(heights, ground) - truth
    assert 0.5 < np.sqrt(np.mean((error / sigma)[~ground] ** 2)) < 1.25
