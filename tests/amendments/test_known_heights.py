"""Heights and slopes of a known surface against a quadratic, and ground that is none."""

import numpy as np
import pytest

from photogram.amendments.surfaces.known_heights import KnownSurface
from photogram.arrays import FloatArray
from photogram.survey import Raster

WEST_M, NORTH_M, CELL_M, ROWS, COLUMNS = 1000.0, 2000.0, 2.0, 60, 50


def quadratic(east: FloatArray, north: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Height and slopes."""
    x, y = east - 1050.0, north - 1950.0
    height = 100.0 + 0.3 * x - 0.2 * y + 0.004 * x * x + 0.003 * x * y - 0.005 * y * y
    return height, 0.3 + 0.008 * x + 0.003 * y, -0.2 + 0.003 * x - 0.010 * y


def made(noise_m: float = 0.0, seed: int = 1) -> KnownSurface:
    east, north = np.meshgrid(WEST_M + (np.arange(COLUMNS) + 0.5) * CELL_M, NORTH_M - (np.arange(ROWS) + 0.5) * CELL_M)
    height = quadratic(east, north)[0] + noise_m * np.random.default_rng(seed).standard_normal(east.shape)
    return KnownSurface("made.tif", Raster(height.astype(np.float32), WEST_M, NORTH_M, CELL_M), 0.1, 0.05)


PLACES = np.random.default_rng(0).uniform((1010.0, 1890.0), (1090.0, 1990.0), (200, 2))


def test_height_and_slopes_are_those_of_the_ground() -> None:
    there = made().at(PLACES)
    height, east, north = quadratic(*PLACES.T)
    np.testing.assert_allclose(there.height_m, height, atol=2e-5)
    np.testing.assert_allclose(there.slope, np.column_stack([east, north]), atol=1e-5)
    assert made().smooth(there).all()


def test_the_standard_deviation_is_that_of_the_errors() -> None:
    z = []
    for seed in range(20):
        there = made(0.1, seed).at(PLACES)
        z.append((there.height_m - quadratic(*PLACES.T)[0]) / there.sigma_m)
    assert 0.95 < np.sqrt(np.mean(np.square(z))) < 1.05
    assert there.sigma_m.max() < 0.1
    assert made().smooth(there).mean() > 0.99


def test_nothing_is_said_beside_the_cells_and_at_a_wall() -> None:
    surface = made()
    beside = surface.at(np.array([[1001.0, 1950.0], [1050.0, 2100.0], [np.nan, 1950.0]]))
    assert np.isnan(beside.height_m).all()
    assert not surface.smooth(beside).any()
    surface.raster.values[:, 25:] += 3.0
    assert surface.smooth(surface.at(np.array([[1050.0, 1950.0], [1030.0, 1950.0]]))).tolist() == [False, True]


def test_a_surface_of_few_cells_says_nothing() -> None:
    surface = KnownSurface("small.tif", Raster(np.zeros((3, 3), np.float32), 0.0, 6.0, 2.0), 0.1, 0.1)
    assert np.isnan(surface.at(np.array([[3.0, 3.0]])).height_m).all()


def test_a_surface_without_a_standard_deviation_is_refused() -> None:
    with pytest.raises(ValueError, match="must be positive"):
        KnownSurface("made.tif", made().raster, 0.0, 0.1)
